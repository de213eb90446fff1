"""Range minus orbit without the antenna correction: means of a minute, blocks of a revolution, candidates."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.effects import Context, catalogue
from gravcal.estimation import least_squares
from gravcal.estimation.noise import fit_noise, whiten
from gravcal.physics import orbit_environment

MEAN_S = 60.0
#: Effects that a range can show; a phase break would need its epoch and is found as a step.
EFFECTS = (
    "ranging.antenna_correction",
    "ranging.phase_centre",
    "ranging.star_camera_misalignment",
    "ranging.multipath",
    "ranging.once_per_revolution",
    "ranging.delay",
    "ranging.scale",
    "ranging.thermal",
)


def view(equations: xr.Dataset, aligned: xr.Dataset, nominal, **settings) -> tuple[list[dict], list[dict], dict]:
    """Blocks and candidates of one day.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable" of the range
    aligned : Dataset, "kbr_phase_centre.align"
    nominal : (2, 3) m, phase centres of the catalogue
    settings : range_block_s, range_degree, noise_order, correction_left_out

    Returns
    -------
    blocks, candidates : fields of `gravcal.discovery.blocks.Block` and `Candidate`
    facts : what is in the data
    """
    time, observed, segment, extra = _minutes(equations, aligned, np.asarray(nominal, dtype=float))
    if not settings["correction_left_out"]:
        observed = observed + extra["antenna_correction"]
    parts = _parts(time, segment, settings["range_block_s"])
    grid = [np.rint((time[p] - time[p[0]]) / MEAN_S).astype(int) for p in parts]
    own = [least_squares.polynomial(time[p], settings["range_degree"], time[p[0]], time[p[-1]]) for p in parts]
    rest = [least_squares.without(o, observed[p]) for o, p in zip(own, parts, strict=True)]
    noise = _noises(rest, grid, settings)
    rows = lambda k, values: whiten(noise[k], *_on_grid(grid[k], values))  # noqa: E731
    blocks = [_block(k, time[p], observed[p], own[k], grid[k], rows) for k, p in enumerate(parts)]
    found = [_candidate(slug, time, extra) for slug in EFFECTS]
    for candidate in found:
        sharp = [least_squares.without(own[k], candidate["columns"][p]) for k, p in enumerate(parts)]
        candidate["columns"] = [rows(k, c) for k, c in enumerate(sharp)]  # what bias and slow error leave of it
    correction = extra["antenna_correction"]
    facts = {
        "minutes": int(sum(p.size for p in parts)),
        "rms_of_blocks_mm": 1e3 * float(np.sqrt(np.mean(np.concatenate(rest) ** 2))),
        "antenna_correction_mean_m": float(correction.mean()),
        "antenna_correction_scatter_um": 1e6 * float(correction.std()),
        "pointing_scatter_mrad": (1e3 * extra["angle"].std(axis=0)).ravel().tolist(),
    }
    return blocks, found, facts


def _minutes(equations, aligned, nominal):
    """Means of a minute: time, observed, segment, and what the effects look at."""
    column, at = equations["column"].values, equations["time_kbr"].values
    line = -column.reshape(-1, 2, 3)
    rate = np.gradient(aligned["reading_range"].values, aligned["time_kbr"].values)
    known = np.isin(aligned["time_kbr"].values, at)
    series = [equations["observed"].values, *line.reshape(-1, 6).T, aligned["reading_range"].values[known], rate[known]]
    group = (np.floor((at - at[0]) / MEAN_S) * 8 + equations["segment"].values).astype(int)
    _, index, count = np.unique(group, return_inverse=True, return_counts=True)
    mean = lambda v: (np.bincount(index, v - v[0]) / count + v[0])[count > 6]  # noqa: E731
    time, observed, *rest = (mean(v) for v in (at, *series))
    segment = np.rint(mean(equations["segment"].values.astype(float))).astype(int)
    line = np.stack(rest[:6], axis=1).reshape(-1, 2, 3)
    extra = {"line_of_sight_b": line, "range": rest[6], "range_rate": rest[7], "antenna_x": nominal[:, 0]}
    extra["antenna_correction"] = np.einsum("nka,ka->n", line, nominal)
    angles = [np.arctan2(-line[:, k, 2], line[:, k, 0]) for k in (0, 1)]
    angles = [np.stack([a, np.arctan2(line[:, k, 1], line[:, k, 0])], axis=1) for k, a in enumerate(angles)]
    extra |= {"angle": np.stack(angles, axis=1)} | _environment(aligned, time)
    return time, observed, segment, extra


def _environment(aligned, time):
    """Argument of latitude of the first satellite and its warmth."""
    position = aligned["position_i"].values[0]
    kept = np.isfinite(position).all(axis=1)
    orbit, position = aligned["time"].values[kept][::10], position[kept][::10]
    normal = np.cross(position[0], position[len(position) // 60])
    argument = np.unwrap(orbit_environment.argument_of_latitude(position, normal))
    return {"argument": np.interp(time, orbit, argument), "warmth": orbit_environment.warmth(time, orbit, position)}


def _parts(time, segment, block_s):
    """Indices of each block: no change of bias inside, at least half of its length."""
    index = np.floor((time - time[0]) / block_s).astype(int) * 8 + segment
    rows = [np.flatnonzero(index == i) for i in np.unique(index)]
    return [r for r in rows if r.size * MEAN_S > block_s / 2]


def _on_grid(place, values):
    """Values on the even grid of a block, and where there are any."""
    grid, valid = np.zeros((place[-1] + 1, values.shape[1])), np.zeros(place[-1] + 1, dtype=bool)
    grid[place], valid[place] = values, True
    return grid, valid


def _noises(rest, grid, settings):
    """Noise model of each block, measured in the other half of the day."""
    count = len(rest)
    series = []
    for values, place in zip(rest, grid, strict=True):
        series.append(np.full(place[-1] + 1, np.nan))
        series[-1][place] = values
    models = []
    for half in (range(count // 2), range(count // 2, count)):
        others = [series[k] for k in range(count) if k not in half]
        removed = len(others) * (settings["range_degree"] + 1)
        models += [fit_noise(others, settings["noise_order"], MEAN_S, removed)] * len(half)
    return models


def _block(k, time, observed, own, grid, rows):
    size = grid[-1] + 1
    return {
        "label": f"from {time[0]:.0f} s",
        "observed": rows(k, (observed - observed.mean())[:, None])[:, 0],
        "shared": np.zeros((size, 0)),
        "own": rows(k, own),
        "channel": np.array(["range"] * size),
        "axis": np.zeros(size, dtype=int),
        "time": time[0] + MEAN_S * np.arange(size),
    }


def _candidate(slug, time, extra):
    entry = catalogue()[slug]
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    columns = entry.columns(Context(time=time, extra=extra))
    return {"cause": slug, "form": "", "names": names, "units": units, "columns": columns}
