"""The published table as blocks and candidates: one offset for seven manoeuvres, and what may disturb it."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.published_table import geometry
from gravcal.effects import Context, catalogue

AXES = ("x", "y", "z")
HEADINGS = {(1, 1): "+x north", (-1, -1): "+x south", (1, -1): "+x north, yaw south", (-1, 1): "+x south, yaw north"}


def view(rows: list[dict], inertia_b, dipole: float, generation: int) -> tuple[list[dict], list[dict], dict]:
    """Blocks and candidates of one variant of the table.

    Parameters
    ----------
    rows : {"order", "kind", "latitude_class", "value" (3,), "sigma" (3,)} m, NaN where nothing is printed
    inertia_b : (3, 3) kg m2
    dipole : A m2, full scale of a rod
    generation : of the IGRF

    Returns
    -------
    blocks, candidates : fields of `gravcal.discovery.blocks.Block` and `Candidate`
    facts : how much larger than printed the errors are by repeated manoeuvres, and by one offset for all
    """
    factor, freedom = repeatability(rows)
    value, sigma = (np.array([r[k] for r in rows]) for k in ("value", "sigma"))
    known = np.isfinite(value)
    sigma = np.where(known, sigma * factor, 1.0)
    mean = np.nansum(value / sigma**2, axis=0) / np.sum(known / sigma**2, axis=0)
    blocks = [_block(r, value[i], sigma[i], known[i]) for i, r in enumerate(rows)]
    found = _candidates(rows, mean, (tuple(np.diag(inertia_b)), dipole, generation))
    for candidate in found:
        columns = zip(candidate["columns"], sigma, known, strict=True)
        candidate["columns"] = [c[k] / s[k][:, None] for c, s, k in columns]
    blocks = _with_priors(blocks, found)
    chi2 = float(np.nansum(((value - mean) / sigma) ** 2))
    needed = factor * np.sqrt(chi2 / (known.sum() - 3))
    facts = {"error_factor_by_repeats": factor, "repeats": freedom, "error_factor_for_one_offset": float(needed)}
    return blocks, found, facts | {"mean_um": (1e6 * mean).tolist(), "numbers": int(known.sum())}


def repeatability(rows: list[dict]) -> tuple[float, int]:
    """Scatter of repeated manoeuvres of a kind and area over the printed errors, at least 1, and how many numbers.

    Parameters
    ----------
    rows : as for `view`
    """
    chi2, count = 0.0, 0
    for kind in {(r["kind"], r["latitude_class"]) for r in rows}:
        same = [r for r in rows if (r["kind"], r["latitude_class"]) == kind]
        value, sigma = (np.array([r[k] for r in same]) for k in ("value", "sigma"))
        used = np.isfinite(value).all(axis=0) & (len(same) > 1)
        if used.any():
            weight = sigma[:, used] ** -2
            mean = np.sum(value[:, used] * weight, axis=0) / weight.sum(axis=0)
            chi2 += float(np.sum((value[:, used] - mean) ** 2 * weight))
            count += int(used.sum()) * (len(same) - 1)
    return max(float(np.sqrt(chi2 / max(count, 1))), 1.0), count


def _block(row, value, sigma, known):
    observed = (value / sigma)[known]
    return {
        "label": f"{row['order']} {row['kind']} {row['latitude_class']}",
        "observed": observed,
        "shared": (np.eye(3) / sigma[:, None])[known],
        "own": np.zeros((observed.size, 0)),
        "channel": np.array(["table"] * observed.size),
        "axis": np.flatnonzero(known),
        "time": np.full(observed.size, float(row["order"])),
    }


def _with_priors(blocks, found):
    """Blocks with rows that hold every parameter of a listed effect to its prior, a share of them in each block.

    With them an explanation that asks for a scale error of one half gains little. The channel of these rows has no
    axis: they are no record.
    """
    sizes = [len(c["names"]) if c["cause"] in catalogue() else 0 for c in found]
    total, begin = sum(sizes), 0
    for candidate, size in zip(found, sizes, strict=True):
        rows = np.zeros((total, len(candidate["names"])))
        if size:
            prior = {p.name: p.prior_sigma for p in catalogue()[candidate["cause"]].parameters}
            rows[begin : begin + size] = np.diag([1 / prior.get(n, 1.0) for n in candidate["names"]])
        begin += size
        candidate["columns"] = [np.concatenate([c, rows / np.sqrt(len(blocks))]) for c in candidate["columns"]]
    more = {"observed": np.zeros(total), "shared": np.zeros((total, 3)), "own": np.zeros((total, 0))}
    more |= {"channel": np.array(["prior"] * total), "axis": np.full(total, 3), "time": np.zeros(total)}
    return [b | {k: np.concatenate([b[k], v]) for k, v in more.items()} for b in blocks]


def _candidates(rows, mean, about):
    """Causes with what they do to the offset of each manoeuvre (3, q) m."""
    found = []
    for (pitch, yaw), form in HEADINGS.items():
        heading = {"pitch": pitch, "roll": pitch, "yaw": yaw}
        arcs = {k: geometry.arc(*k, heading[k[0]], about) for k in geometry.AREAS}
        each = [arcs[r["kind"], r["latitude_class"]] for r in rows]
        found += [_readings(slug, form, each, mean) for slug in READINGS]
        found += [_only_y(form, each), _scale(form, each, mean)]
    count = len(rows)
    share = [-mean[:, None]] * count
    found.append(_case("timing.accelerometer_delay", "", ["one_minus_cosine"], ["1"], share))
    order = [(r["order"] - 4.0) * np.eye(3) for r in rows]
    found.append(_case("unknown:time", "offset moves between manoeuvres", AXES, ["m"] * 3, order))
    low = [float(r["latitude_class"] == "low") * np.eye(3) for r in rows]
    found.append(_case("unknown:latitude", "offset differs at low latitude", AXES, ["m"] * 3, low))
    return found


#: Effects that add to the linear reading.
READINGS = (
    "accelerometer.current_leak",
    "accelerometer.angular_leak",
    "accelerometer.scale",
    "accelerometer.misalignment",
)


def _case(cause, form, names, units, columns):
    return {"cause": cause, "form": form, "names": list(names), "units": list(units), "columns": columns}


def _readings(slug, form, arcs, mean):
    """Effect of the catalogue on the linear reading, as an error of each manoeuvre's offset."""
    entry, columns = catalogue()[slug], []
    for arc in arcs:
        linear = geometry.euler_columns(arc.alpha_b) @ mean
        time = np.arange(len(linear), dtype=float)
        context = Context(time=time, dipole_b=arc.dipole_b, angular_b=arc.alpha_b, linear_b=linear)
        columns.append(arc.answer(entry.columns(context)))
    return _case(slug, form, [p.name for p in entry.parameters], [p.unit for p in entry.parameters], columns)


def _only_y(form, arcs):
    """The part of the current leak that goes into a_y alone: erratum C-11."""
    entry = catalogue()["accelerometer.current_leak"]
    kept = [i for i, p in enumerate(entry.parameters) if p.name.startswith("y_from")]
    columns = []
    for arc in arcs:
        context = Context(time=np.arange(len(arc.dipole_b), dtype=float), dipole_b=arc.dipole_b)
        columns.append(arc.answer(entry.columns(context)[..., kept]))
    names, units = zip(*((entry.parameters[i].name, entry.parameters[i].unit) for i in kept), strict=True)
    return _case(entry.slug, f"into a_y, {form}", names, units, columns)


def _scale(form, arcs, mean):
    """Angular acceleration too large by a share about each axis: a gain of dipole or inertia, or of the sensor."""
    entry, columns = catalogue()["accelerometer.angular_scale"], []
    for arc in arcs:
        parts = [geometry.euler_columns(arc.alpha_b * unit) @ -mean for unit in np.eye(3)]
        columns.append(arc.answer(np.stack(parts, axis=2)))
    return _case(entry.slug, form, [p.name for p in entry.parameters], ["1"] * 3, columns)


def variants(records) -> dict[str, list[dict]]:
    """Rows of `view` by variant, from the published records.

    Parameters
    ----------
    records : of `catalog.published`, section "manoeuvres"
    """
    found = {}
    for record in records:
        words = {k: record.labels[k] for k in ("kind", "latitude_class")} | {"order": int(record.labels["order"])}
        pair = (record.value, record.sigma)
        value, sigma = (np.array([np.nan if v is None else 1e-6 * v for v in one]) for one in pair)
        found.setdefault(record.labels["variant"], []).append(words | {"value": value, "sigma": sigma})
    return found
