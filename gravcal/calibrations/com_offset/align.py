"""Manoeuvres in the sampled torquer currents, and the Level-1 records on GPS time round each of them."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import align as records
from gravcal.calibrations import schemas
from gravcal.calibrations.align import in_windows, near_windows, own_tags, sorted_samples
from gravcal.calibrations.schemas import build
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import noise
from gravcal.physics import frames

SCHEMAS = schemas.of("com_offset.toml")

#: Bits of `gap`: what is missing for longer than the limit inside a manoeuvre.
GAPS = {"orbit": 1, "sca": 2}
#: Flag of an isolated outlier; {instrument: (neighbours on either side, weights that predict a sample from them or None
#: for a median, smallest sigma)}: of quaternions half of 2 urad, by which an edge of a manoeuvre bends the attitude.
OUTLIER = 2
REACH = {"acc": (4, None, 0.0), "sca": (2, np.array([-1, 4, 0, 4, -1]) / 6, 1e-6)}
#: s, longest piece that is processed of a record without manoeuvre.
SURVEY_S = 180.0
MANOEUVRE = ("start", "stop", "kind", "rod", "edge_lower", "edge_upper", "level", "regular")


@dataclass(frozen=True)
class Wave:
    """One square wave of one rod."""

    rod: int  #: 0, 1, 2 for x, y, z
    lower: np.ndarray  #: (m + 1,) s, last sample before each edge
    upper: np.ndarray  #: (m + 1,) s, first sample after it
    level: np.ndarray  #: (m,) mA, mean current of each half period


def plateaus(time: np.ndarray, current: np.ndarray, threshold: float, longest_step: float) -> list[tuple]:
    """Runs of samples of one sign beyond the threshold (mA): (first index, last index, mean mA).

    A jump of more than half of the size ends a run: a control current of the same sign that follows the wave at once is
    not part of its last half period. So does a step between samples longer than `longest_step` (s).
    """
    size = np.abs(np.nan_to_num(current))
    sign = np.where(size > threshold, np.sign(np.nan_to_num(current)), 0)
    jump = np.abs(np.diff(size)) > np.maximum(size[1:], size[:-1]) / 2
    change = (np.diff(sign) != 0) | (np.diff(time) > longest_step) | jump
    first = np.concatenate([[0], np.flatnonzero(change) + 1])
    last = np.concatenate([np.flatnonzero(change), [sign.size - 1]])
    return [(a, b, float(current[a : b + 1].mean())) for a, b in zip(first, last, strict=True) if sign[a] != 0]


def find_waves(time: np.ndarray, current: np.ndarray, rod: int, settings: dict) -> list[Wave]:
    """Square waves of one rod in its current (n,) mA at increasing times (n,) s.

    Neighbouring runs belong to one wave if their signs alternate, their sizes agree within 30 % and their lengths are
    half a period within the tolerance and the sampling.
    """
    if time.size < 3:
        return []
    step = float(np.median(np.diff(time)))
    half = settings["period_s"] / 2
    slack = settings["period_tolerance_s"] + step
    waves, group = [], []
    for first, last, mean in plateaus(time, current, settings["current_threshold_ma"], 3 * step):
        fits = abs(time[last] - time[first] + step - half) <= slack
        previous, _, before = group[-1] if group else (0, 0, 0.0)
        follows = (
            before * mean < 0
            and abs(abs(mean) - abs(before)) < 0.3 * abs(before)
            and abs(time[first] - time[previous] - half) <= slack
        )
        if not (fits and follows):
            waves.append(group)
            group = []
        group = [*group, (first, last, mean)] if fits else []
    waves.append(group)
    return [_wave(time, rod, g, step) for g in waves if len(g) >= settings["minimum_half_periods"]]


def _wave(time, rod, group, step):
    """Wave of a group of runs, as of `plateaus`: edges between the last sample of a run and the first of the next."""
    first = np.array([run[0] for run in group])
    last = np.array([run[1] for run in group])
    before = np.append(np.maximum(first - 1, 0), last[-1])
    after = np.append(first, np.minimum(last[-1] + 1, time.size - 1))
    before[1:-1] = last[:-1]
    lower, upper = time[before].astype(float), time[after].astype(float)
    at_end = before == after  # the data begin or end with the wave
    lower = np.where(at_end & (np.arange(lower.size) == 0), lower - step, lower)
    upper = np.where(at_end & (np.arange(upper.size) > 0), upper + step, upper)
    lower[0] = max(lower[0], upper[0] - 3 * step)
    upper[-1] = min(upper[-1], lower[-1] + 3 * step)
    return Wave(rod, lower, upper, np.array([run[2] for run in group]))


def detect(magnetometer: xr.Dataset, **settings: float) -> xr.Dataset:
    """Square waves of the torquers in a MAG1B, one manoeuvre each.

    The kind is the body axis about which the current turns the satellite in the measured field, m x B.
    """
    names = [f"Mfv{a}_RAW" if f"Mfv{a}_RAW" in magnetometer else f"Mfv{a}" for a in "XYZ"]
    time, values, flag, _ = sorted_samples(magnetometer, own_tags(magnetometer), ("current_b", *names))
    time, current, field_b = time[flag == 0], values[flag == 0, :3], values[flag == 0, 3:]
    waves = [w for rod in range(3) for w in find_waves(time, current[:, rod], rod, settings)]
    kept: list[Wave] = []
    for wave in sorted(waves, key=lambda w: -np.mean(np.abs(w.level))):  # of those that overlap the strongest
        if all(wave.upper[-1] < other.lower[0] or wave.lower[0] > other.upper[-1] for other in kept):
            kept.append(wave)
    waves = sorted(kept, key=lambda w: w.lower[0])
    count = max((w.level.size for w in waves), default=0)
    delay = np.arange(count + 1) * settings["period_s"] / 2
    first = [(np.max(w.lower - delay[: w.lower.size]), np.min(w.upper - delay[: w.upper.size])) for w in waves]
    filled = lambda values, size: np.append(values, np.full(size - values.size, np.nan))  # noqa: E731
    torques = [np.cross(np.eye(3)[w.rod], field_b[(time >= w.lower[0]) & (time <= w.upper[-1])]) for w in waves]
    values = {
        "edge_lower": np.array([filled(w.lower, count + 1) for w in waves]).reshape(-1, count + 1),
        "edge_upper": np.array([filled(w.upper, count + 1) for w in waves]).reshape(-1, count + 1),
        "level": np.array([filled(w.level, count) for w in waves]).reshape(len(waves), count),
        "regular": [settings["period_s"] % 1 == 0 and b - a > 1e-4 for a, b in first],  # edges whole half periods apart
        "start": [(w.lower[0] + w.upper[0]) / 2 for w in waves],
        "stop": [(w.lower[-1] + w.upper[-1]) / 2 for w in waves],
        "kind": [int(np.argmax(np.sum(turning**2, axis=0))) for turning in torques],
        "rod": [w.rod for w in waves],
        "record_start": time[0] if time.size else np.nan,
        "record_stop": time[-1] if time.size else np.nan,
    }
    return build(SCHEMAS["detect"], values, title="Manoeuvres found in the torquer currents")


def align(*observed: xr.Dataset, **settings: float) -> xr.Dataset:
    """Product "com_offset.align": Level-1 records on GPS time, round each manoeuvre.

    Without a manoeuvre the first `survey_s` of the record are taken as one window, so that field and attitude can be
    checked all the same. A manoeuvre in which orbit or star camera are missing for longer than their limit is marked
    in `gap`, and not used. Observed are "com_offset.detect" and "ingest" of ACC1A, SCA1B, MAG1B, an orbit, TIM1B and
    CLK1B.
    """
    detected, acc, sca, mag, orbit, tim1b, clk1b = observed
    spans = _spans(detected, acc, sca, mag, orbit, settings["margin_s"], settings["survey_s"])
    acc, sca, mag, orbit = (near_windows(one, spans) for one in (acc, sca, mag, orbit))
    parts, counts = {}, {}
    readings = tuple(f"{kind}_accl_{axis}" for kind in ("lin", "ang") for axis in "xyz")
    acc = acc.assign({n: ("record", np.full(acc.sizes["record"], np.nan)) for n in readings if n not in acc})
    field = tuple(f"Mfv{a}{suffix}" for a in "XYZ" for suffix in ("_RAW", "") if f"Mfv{a}{suffix}" in mag)
    sources = {
        "acc": (acc, records.gps_tags(acc, tim1b, clk1b, settings["clock_gap_limit_s"]), readings),
        "sca": (sca, own_tags(sca), records.QUATERNION),
        "mag": (mag, own_tags(mag), (*field, "current_b")),
        "orbit": (orbit, own_tags(orbit), records.STATE),
    }
    for name, (source, tags, columns) in sources.items():
        time, values, flag, counts[name] = sorted_samples(source, tags, columns)
        inside = in_windows(time, spans, 8.0 if name == "orbit" else 0.0)
        flag[inside] |= _outliers(name, time[inside], values[inside], flag[inside], settings["outlier_sigma"])
        parts[name] = (time[inside], values[inside], flag[inside])
        if not inside.any():
            product, file = source.attrs.get("product", name), source.attrs.get("file", "")
            have = f"{time[0]:.0f} to {time[-1]:.0f} s" if time.size else "no usable record"
            expected = f"records between {spans[0, 0]:.0f} and {spans[-1, 1]:.0f} s GPS"
            remedy = "Give files of the same satellite and day, and check that TIM1B and CLK1B cover it."
            refuse(file or product, have, expected, remedy, EstimationError, product=product, file=file)
    gap_limits = {"orbit": settings["orbit_gap_limit_s"], "sca": settings["star_camera_gap_limit_s"]}
    processed = spans[:, 0], np.minimum(spans[:, 1], spans[:, 0] + SURVEY_S)  # what is looked at without a manoeuvre
    if detected.sizes["manoeuvre"]:
        processed = detected["start"].values, detected["stop"].values
    gap = np.zeros(len(spans), dtype=np.uint8)
    for name, bit in GAPS.items():
        time, _, flag = parts[name]
        for k, (start, stop) in enumerate(zip(*processed, strict=True)):
            known = time[(flag == 0) & (time > start) & (time < stop)]
            if np.diff(np.concatenate([[start], known, [stop]])).max() > gap_limits[name]:
                gap[k] |= bit
    values = {f"time_{name}": part[0] for name, part in parts.items()}
    values |= {f"{name}_flag": part[2] for name, part in parts.items()}
    readings, magnetic, quaternion = parts["acc"][1], parts["mag"][1], np.full_like(parts["sca"][1], np.nan)
    good = (parts["sca"][2] == 0) & np.isfinite(parts["sca"][1]).all(axis=1)  # unit, continuous in sign
    if good.any():
        known = parts["sca"][1][good]
        quaternion[good] = frames.continuous(known / np.linalg.norm(known, axis=1, keepdims=True))
    values |= {
        "gap": gap,
        "window_start": spans[:, 0],
        "window_stop": spans[:, 1],
        "linear_b": readings[:, :3],
        "angular_b": readings[:, 3:],
        "quaternion": quaternion,
        "field_measured_b": 1e-6 * magnetic[:, :3],
        "current_b": magnetic[:, 3:],
    }
    values |= records.orbit_states(*parts["orbit"][:2], orbit.attrs.get("product", ""))
    values |= {name: detected[name].values for name in MANOEUVRE}
    attrs = {f"{n}_{k}": v for n, c in counts.items() for k, v in c.items()}
    return build(SCHEMAS["align"], values, title="Level-1 records on GPS time", **attrs)


def _outliers(name, time, values, flag, limit):
    """Flags (n,), OUTLIER where a usable sample alone deviates from its neighbours (star camera: from their cubic)."""
    outliers, usable = np.zeros_like(flag), np.flatnonzero(flag == 0)
    reach, weights, floor = REACH.get(name, (0, None, 0.0))
    if usable.size < max(2 * reach, 1) or not reach:
        return outliers
    values = values[usable] if name != "sca" else frames.continuous(values[usable])
    values = values[:, np.isfinite(values).all(axis=0)]
    isolated = noise.isolated(values, reach, limit, weights, floor)
    step = np.median(np.diff(time[usable]))
    complete = np.zeros(usable.size, dtype=bool)  # with all its neighbours
    span = time[usable][2 * reach :] - time[usable][: usable.size - 2 * reach]
    complete[reach : usable.size - reach] = span < (2 * reach + 0.5) * step
    outliers[usable[isolated & complete]] = OUTLIER
    return outliers


def _spans(detected, acc, sca, mag, orbit, margin, survey):
    """Windows (w, 2) s around the manoeuvres with a margin (s); without one, `survey` (s) from the common beginning."""
    if detected.sizes["manoeuvre"]:
        return np.stack([detected["start"].values - margin, detected["stop"].values + margin], axis=1)
    times = [records.usable(d, ())[0] for d in (acc, sca, mag, orbit)]
    if any(t.size == 0 for t in times):
        each = zip((acc, sca, mag, orbit), times, strict=True)
        empty = ", ".join(str(d.attrs.get("file", d.attrs.get("product"))) for d, t in each if not t.size)
        refuse(empty, "no usable record", "those of a day", "Fetch the file again.", EstimationError)
    first = np.floor(max(float(t[0]) for t in times))
    return np.array([[first, min(float(times[1][-1]), float(times[3][-1]), first + survey)]])
