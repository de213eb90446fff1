"""Grid, frame and gaps: Level-1 records of a satellite on GPS time round each manoeuvre. Shared by the calibrations."""

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import robust, timing
from gravcal.physics import earth, frames

#: Bits of a reader's flag that make a sample unusable; order and repetition are settled here.
UNUSABLE = 1 | 2 | 16 | 32 | 64 | 128
#: Quality bits of the products that make a sample unusable.
QUALITY = {"ACC1A": 0b1101010, "ACT1A": 0b1101010, "SCA1B": 0b1, "MAG1B": 0b11000010, "GNV1B": 0, "GNI1B": 0}
#: Bits of `gap`: what is missing for longer than the limit inside a manoeuvre.
GAPS = {"orbit": 1, "sca": 2}
#: Flag of a sample that stands alone; its neighbours on either side, their weights where a median bends too little, and
#: the smallest standard deviation: of half an angle of 2 urad, which an edge of a manoeuvre bends an attitude by.
OUTLIER = 2
REACH = {"acc": (4, None, 0.0), "sca": (2, np.array([-1, 4, 0, 4, -1]) / 6, 1e-6)}
#: Longest piece that is looked at where there is no manoeuvre.
SURVEY_S = 180.0
MANOEUVRE = ("start", "stop", "kind", "rod", "edge_lower", "edge_upper", "level", "regular")
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")
QUATERNION = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")


def sorted_samples(observed: xr.Dataset, tags: timing.Tags, names: tuple[str, ...], bad=None):
    """Samples of an "ingest" in order of their GPS tags, repeated ones dropped, doubtful and bad (n,) ones marked.

    Time (m,) s, values (m, k) of the variables wanted, each of one column or more, flag (m,) uint8 (0 usable), and
    counts of records: out_of_order, repeated, conflicting, marked and undated.
    """
    columns = [one for n in names for one in np.atleast_2d(np.asarray(observed[n].values, dtype=float).T)]
    flagged = (observed["flag"].values & UNUSABLE) != 0
    if "qualflg" in observed:
        mask = QUALITY.get(observed.attrs.get("product", ""), 0)
        flagged = flagged | ((observed["qualflg"].values & mask) != 0)
    if bad is not None:
        flagged = flagged | bad
    dated = np.isfinite(tags.fraction)
    kept = np.flatnonzero(dated)
    usable = timing.Tags(tags.second[kept], tags.fraction[kept])
    order = timing.ordered(usable, [c[kept] for c in columns])
    index = kept[order.index]
    flag = (flagged[index] | order.conflicting).astype(np.uint8)
    counts = order.counts | {"undated": int((~dated).sum()), "marked": int(flag.sum())}
    values = np.stack([c[index] for c in columns], axis=1) if columns else np.zeros((index.size, 0))
    return usable.time[order.index], values, flag, counts


def own_tags(observed: xr.Dataset) -> timing.Tags:
    """Tags of an "ingest" as they stand in its file."""
    return timing.normalised(observed["time_second"].values, observed["time_fraction"].values)


def usable(observed: xr.Dataset, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Time (m,) s and values (m, k) of the usable samples of an "ingest", all of them known, by its own tags."""
    time, values, flag, _ = sorted_samples(observed, own_tags(observed), names)
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    return time[good], values[good]


def gps_tags(observed: xr.Dataset, tim1b: xr.Dataset, clk1b: xr.Dataset, clock_gap_limit_s: float):
    """GPS time of on-board tags: TIM1B to receiver time, CLK1B to GPS time."""
    limits = timing.Limits(clock_gap_limit_s, clock_gap_limit_s, 1e-6)
    onboard = timing.tim1b_clock(
        tim1b["obctime"].values,
        tim1b["rcvtime_intg"].values,
        1e-9 * tim1b["rcvtime_frac"].values,
        tim1b["qualflg"].values,
    )
    receiver = timing.clk1b_clock(
        clk1b["rcv_time"].values, clk1b["eps_time"].values, clk1b["eps_drift"].values, clk1b["qualflg"].values
    )
    received, _ = timing.converted(own_tags(observed), onboard, limits)
    gps, _ = timing.converted(received, receiver, limits)
    return gps


def align(*observed: xr.Dataset, **settings: float) -> xr.Dataset:
    """Everything that the solution needs, on GPS time, round each manoeuvre: an "align".

    Without a manoeuvre the first `survey_s` of the record are taken as one window, so that field and attitude can be
    looked at all the same. A manoeuvre in which orbit or star camera are missing for longer than their limit is marked
    in `gap`, and not used.

    observed : Dataset, "com_offset.detect" and "ingest" of ACC1A, SCA1B, MAG1B, an orbit, TIM1B and CLK1B
    settings : s; margin_s, kept on either side of a manoeuvre; survey_s; clock_gap_limit_s, orbit_gap_limit_s and
        star_camera_gap_limit_s, distance of records that may be bridged; outlier_sigma, distance of an isolated outlier
        from its neighbours, which is left out
    """
    detected, acc, sca, mag, orbit, tim1b, clk1b = observed
    spans = _spans(detected, acc, sca, mag, orbit, settings["margin_s"], settings["survey_s"])
    acc, sca, mag, orbit = (_near(one, spans) for one in (acc, sca, mag, orbit))
    parts, counts = {}, {}
    linear = tuple(f"{kind}_accl_{axis}" for kind in ("lin", "ang") for axis in "xyz")
    acc = acc.assign({n: ("record", np.full(acc.sizes["record"], np.nan)) for n in linear if n not in acc})
    field = tuple(f"Mfv{a}{suffix}" for a in "XYZ" for suffix in ("_RAW", "") if f"Mfv{a}{suffix}" in mag)
    sources = {
        "acc": (acc, gps_tags(acc, tim1b, clk1b, settings["clock_gap_limit_s"]), linear),
        "sca": (sca, own_tags(sca), QUATERNION),
        "mag": (mag, own_tags(mag), (*field, "current_b")),
        "orbit": (orbit, own_tags(orbit), STATE),
    }
    for name, (source, tags, columns) in sources.items():
        time, values, flag, counts[name] = sorted_samples(source, tags, columns)
        margin = 8.0 if name == "orbit" else 0.0
        inside = _inside(time, spans, margin)
        flag[inside] |= _outliers(name, time[inside], values[inside], flag[inside], settings["outlier_sigma"])
        parts[name] = (time[inside], values[inside], flag[inside])
        if not inside.any():
            product, file = source.attrs.get("product", name), source.attrs.get("file", "")
            have = f"{time[0]:.0f} to {time[-1]:.0f} s" if time.size else "no usable record"
            expected = f"records between {spans[0, 0]:.0f} and {spans[-1, 1]:.0f} s GPS"
            remedy = "Give files of the same satellite and day, and check that TIM1B and CLK1B cover it."
            refuse(file or product, have, expected, remedy, EstimationError, product=product, file=file)
    gap_limits = {"orbit": settings["orbit_gap_limit_s"], "sca": settings["star_camera_gap_limit_s"]}
    inner = spans[:, 0], np.minimum(spans[:, 1], spans[:, 0] + SURVEY_S)  # what is looked at without a manoeuvre
    if detected.sizes["manoeuvre"]:
        inner = detected["start"].values, detected["stop"].values
    gap = np.zeros(len(spans), dtype=np.uint8)
    for name, bit in GAPS.items():
        time, _, flag = parts[name]
        for k, (start, stop) in enumerate(zip(*inner, strict=True)):
            known = time[(flag == 0) & (time > start) & (time < stop)]
            if np.diff(np.concatenate([[start], known, [stop]])).max() > gap_limits[name]:
                gap[k] |= bit
    values = {f"time_{name}": part[0] for name, part in parts.items()}
    values |= {f"{name}_flag": part[2] for name, part in parts.items()}
    readings, magnetic = parts["acc"][1], parts["mag"][1]
    values |= {
        "gap": gap,
        "window_start": spans[:, 0],
        "window_stop": spans[:, 1],
        "linear_b": readings[:, :3],
        "angular_b": readings[:, 3:],
        "quaternion": _usable_quaternion(*parts["sca"][1:]),
        "field_measured_b": 1e-6 * magnetic[:, :3],
        "current_b": magnetic[:, 3:],
    }
    values |= _orbit(*parts["orbit"][:2], orbit.attrs.get("product", ""))
    values |= {name: detected[name].values for name in MANOEUVRE}
    attrs = {f"{n}_{k}": v for n, c in counts.items() for k, v in c.items()}
    return build(schemas.of("com_offset.toml")["align"], values, title="Level-1 records on GPS time", **attrs)


def _outliers(name, time, values, flag, limit):
    """Flag of isolated outliers among the usable samples of an instrument; of a star camera beside a local cubic."""
    found, usable = np.zeros_like(flag), np.flatnonzero(flag == 0)
    reach, weights, least = REACH.get(name, (0, None, 0.0))
    if not reach or usable.size < 2:
        return found
    values = values[usable] if name != "sca" else frames.continuous(values[usable])
    values = values[:, np.isfinite(values).all(axis=0)]
    apart = robust.isolated(values, reach, limit, weights, least)
    step = np.median(np.diff(time[usable]))
    whole = np.zeros(usable.size, dtype=bool)  # with all its neighbours
    span = time[usable][2 * reach :] - time[usable][: usable.size - 2 * reach]
    whole[reach : usable.size - reach] = span < (2 * reach + 0.5) * step
    found[usable[apart & whole]] = OUTLIER
    return found


def orbit_i(orbit: xr.Dataset, spans: np.ndarray):
    """Epochs (n,) s, inertial positions (n, 3) m and velocities m s-1 of GNI1B or GNV1B in windows (w, 2) s."""
    orbit = _near(orbit, spans)
    time, values, flag, _ = sorted_samples(orbit, own_tags(orbit), STATE)
    usable = _inside(time, spans, 0.0) & (flag == 0)
    states = _orbit(time[usable], values[usable], orbit.attrs.get("product", ""))
    return time[usable], states["position_i"], states["velocity_i"]


def between(at: np.ndarray, time: np.ndarray, limit: float) -> np.ndarray:
    """True for each epoch (m,) on or between two ordered samples (n,) that are at most `limit` apart (s)."""
    index = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    inside = (at >= time[0]) & (at <= time[-1])
    return inside & (time[index] - time[index - 1] <= limit)


def _spans(detected, acc, sca, mag, orbit, margin, survey):
    """Windows round the manoeuvres; the common beginning of all records where there is none."""
    if detected.sizes["manoeuvre"]:
        return np.stack([detected["start"].values - margin, detected["stop"].values + margin], axis=1)
    times = [d["time_tag"].values for d in (acc, sca, mag, orbit)]
    if any(t.size == 0 for t in times):
        empty = [d.attrs.get("file", d.attrs.get("product")) for d in (acc, sca, mag, orbit) if not d.sizes["record"]]
        refuse(", ".join(empty), "no record", "those of a day", "Fetch the file again.", EstimationError)
    first = np.floor(max(float(np.nanmin(t)) for t in times))
    last = min(float(np.nanmax(d["time_tag"].values)) for d in (sca, orbit))
    return np.array([[first, min(last, first + survey)]])


def _near(observed, spans):
    """Records whose own tags are within a minute of the windows; a clock is never off by more."""
    near = _inside(observed["time_tag"].values, spans, 60.0)
    return observed if near.all() else observed.isel(record=np.flatnonzero(near))


def _inside(time, spans, margin):
    inside = np.zeros(time.size, dtype=bool)
    for start, stop in spans:
        inside |= (time >= start - margin) & (time <= stop + margin)
    return inside


def _usable_quaternion(values, flag):
    """Unit quaternions continuous in sign, NaN where marked."""
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    result = np.full_like(values, np.nan)
    if good.any():
        unit = values[good] / np.linalg.norm(values[good], axis=1, keepdims=True)
        result[good] = frames.continuous(unit)
    return result


def _orbit(time, values, product):
    """Inertial and Earth-fixed states from GNI1B or GNV1B."""
    position, velocity = values[:, :3], values[:, 3:]
    if product == "GNI1B":
        fixed = earth.state_to_fixed(time, position, velocity)
        return {"position_i": position, "velocity_i": velocity, "position_e": fixed[0]}
    inertial = earth.state_to_inertial(time, position, velocity)
    return {"position_i": inertial[0], "velocity_i": inertial[1], "position_e": position}
