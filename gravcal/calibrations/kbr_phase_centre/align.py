"""Grid, frame and gaps of a pair: orbits and attitudes on whole seconds, ranging with its corrections."""

import numpy as np
import xarray as xr
from scipy.interpolate import make_interp_spline

from gravcal.calibrations.align import QUATERNION, STATE, own_tags, sorted_samples, usable
from gravcal.calibrations.kbr_phase_centre.model import SCHEMAS
from gravcal.calibrations.schemas import build
from gravcal.errors import EstimationError, refuse
from gravcal.physics import earth, frames

READINGS = ("biased_range", "range_rate", "range_accl", "lighttime_corr", "lighttime_rate", "lighttime_accl")
FILLED = 0b10000000  # quality bit of ranging: a filled sample within 5 s, where the weight of the filter is
PHASE_BREAK = 1
LONG_GAP = 30.0  # s, after which the phase is not trusted to go on
PER_DAY = 5  # files


def align(*observed: xr.Dataset, gap_limit_s: float, break_limit_m: float) -> xr.Dataset:
    """Product "kbr_phase_centre.align": orbits and attitudes on whole seconds, ranging at its own epochs.

    Observed are KBR1B or LRI1B, both orbits, both SCA1B, then the same of the next day; break_limit_m as of `breaks`.
    """
    observed = _joined(observed)
    kbr, orbits, cameras = observed[0], observed[1:3], observed[3:5]
    time_kbr, values, flag, _ = sorted_samples(kbr, own_tags(kbr), (*READINGS, "ant_centr_corr", "qualflg"))
    quality = values[:, 7].astype(int)
    readings = [values[:, k] + values[:, k + 3] for k in range(3)]  # range, rate, acceleration
    phase_break = ((quality & PHASE_BREAK) != 0) | breaks(time_kbr, *readings, break_limit_m)
    streams = [states(orbit) for orbit in orbits]
    for camera in cameras:
        time, q, marked, _ = sorted_samples(camera, own_tags(camera), QUATERNION)
        norm = np.linalg.norm(q, axis=1)
        good = (marked == 0) & np.isfinite(norm) & (np.abs(norm - 1) < 1e-3)
        streams.append((time[good], frames.continuous(q[good] / norm[good, None])))
    time = _common_grid([*(stream[0] for stream in streams), time_kbr], [*observed[1:], kbr])
    on_grid = [interpolated(*stream, time, gap_limit_s) for stream in streams]
    with np.errstate(invalid="ignore"):
        unit = [q / np.linalg.norm(q, axis=1, keepdims=True) for q in on_grid[2:]]
    aligned = {
        "time": time,
        "time_kbr": time_kbr,
        "position_i": np.stack(on_grid[:2]),
        "quaternion": np.stack(unit),
        "reading_range": readings[0],
        "reading_range_rate": readings[1],
        "reading_range_acceleration": readings[2],
        "antenna_correction": values[:, 6],
        "kbr_flag": (flag != 0) | ((quality & FILLED) != 0) | ~np.isfinite(values[:, :6]).all(axis=1),
        "segment": np.cumsum(phase_break),
    }
    attrs = {"satellites": "".join(camera.attrs["satellite"] for camera in cameras)}
    attrs |= {"ranging": kbr.attrs.get("product", ""), "orbit": orbits[0].attrs.get("product", "")}
    return build(SCHEMAS["align"], aligned, title="Ranging, orbits and attitudes on GPS time", **attrs)


def _joined(observed):
    """Ranging, both orbits and both star cameras, five Datasets, each with the records of all days in a row."""
    if len(observed) == PER_DAY:
        return observed
    joined = []
    for files in (observed[k::PER_DAY] for k in range(PER_DAY)):
        products = {one.attrs.get("product") for one in files}
        if len(products) > 1:
            mixture = f"{' and '.join(sorted(map(str, products)))} on different days"
            remedy = "Put the same product there for every day, or give --date."
            refuse(files[0].attrs.get("file", ""), mixture, "one product", remedy, EstimationError)
        names = sorted(set.intersection(*(set(one.data_vars) for one in files)))
        dim = files[0]["time_second"].dims[0]
        joined.append(xr.concat([one[names] for one in files], dim=dim, combine_attrs="override"))
    return joined


def states(orbit: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) s and inertial position (n, 3) m of the usable records of an orbit file."""
    time, state = usable(orbit, STATE)
    if orbit.attrs.get("product") != "GNI1B" and time.size:
        return time, earth.state_to_inertial(time, state[:, :3], state[:, 3:])[0]
    return time, state[:, :3]


def _common_grid(times, observed):
    """Whole seconds (n,) that orbits, attitudes and, within a minute, ranging share; epochs (n_i,) s of the five."""
    names = [one.attrs.get("file", one.attrs.get("product", "")) for one in observed]
    for time, name in zip(times, names, strict=True):
        if time.size < 2:
            records, remedy = f"{time.size} usable records", "Check flags and time of this file."
            refuse(name, records, "a day's", remedy, EstimationError, file=name, records=int(time.size))
    margin = [0.0] * 4 + [60.0]  # s
    first = np.ceil(max(time[0] - extra for time, extra in zip(times, margin, strict=True)))
    last = np.floor(min(time[-1] + extra for time, extra in zip(times, margin, strict=True)))
    if last - first < 600:
        spans = ", ".join(f"{name} {time[0]:.0f} to {time[-1]:.0f}" for time, name in zip(times, names, strict=True))
        overlap, shared = f"{max(last - first, 0):.0f} s in common ({spans} s GPS)", float(last - first)
        remedy = "Give files of one pair and one day."
        refuse("orbits, attitudes and ranging", overlap, "at least 600 s", remedy, EstimationError, shared=shared)
    return np.arange(first, last + 1)


def interpolated(time: np.ndarray, values: np.ndarray, at: np.ndarray, gap_limit_s: float) -> np.ndarray:
    """Samples (n, m) at other epochs (k,) s: as they are where epochs coincide, by a spline of degree 7 elsewhere.

    Of quaternions, m = 4, gaps are bridged by one of 3, for the other amplifies noise tenfold there. Between samples
    further apart than `gap_limit_s`, and outside, the result is NaN; time is strictly increasing.
    """
    result = np.full((at.size, values.shape[1]), np.nan)
    after = np.clip(np.searchsorted(time, at - 1e-7), 0, time.size - 1)
    same = np.abs(time[after] - at) < 1e-6
    result[same] = values[after[same]]
    if same.all():
        return result
    for limit, highest in ((gap_limit_s, 3), (0.0, 7)) if values.shape[1] == 4 else ((gap_limit_s, 7),):
        cuts = np.flatnonzero(np.diff(time) > max(limit, 1.5 * np.median(np.diff(time)))) + 1
        for run in np.split(np.arange(time.size), cuts):
            wanted = ~same & (at > time[run[0]]) & (at < time[run[-1]])
            if not wanted.any():
                continue
            degree = min(highest, (run.size - 1) // 2 * 2 - 1) if run.size > 2 else 1
            nearest = np.searchsorted(time[run], at[wanted])[:, None] + np.arange(-12, 13)
            near = run[np.unique(np.clip(nearest, 0, run.size - 1))]
            spline = make_interp_spline(time[near] - time[run[0]], values[near], k=degree)
            result[wanted] = spline(at[wanted] - time[run[0]])
    return result


def breaks(time: np.ndarray, distance: np.ndarray, rate: np.ndarray, acceleration: np.ndarray, limit: float):
    """True for records (n,) before which the range bias may change: a step against its derivatives, or a long gap.

    Hermite: rho_1 - rho_0 = h (rho'_0 + rho'_1)/2 - h^2 (rho''_1 - rho''_0)/12 + O(h^5); limit in m.
    """
    known = np.isfinite([distance, rate, acceleration]).all(axis=0)
    time, distance, rate, acceleration = (one[known] for one in (time, distance, rate, acceleration))
    h, broken = np.diff(time), np.zeros(known.size, dtype=bool)
    expected = h * (rate[1:] + rate[:-1]) / 2 - h**2 * np.diff(acceleration) / 12
    broken[np.flatnonzero(known)[1:]] = (np.abs(np.diff(distance) - expected) > limit) | (h > LONG_GAP)
    return broken
