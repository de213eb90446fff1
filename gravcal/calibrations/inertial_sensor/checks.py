"""Checks of voltages, attitude and orbit of the manoeuvres against each other, and of the result."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr
from scipy.ndimage import median_filter

from gravcal.calibrations import checks
from gravcal.calibrations.align import in_windows
from gravcal.calibrations.checks import Check, at_least, at_most
from gravcal.calibrations.inertial_sensor import align
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError
from gravcal.estimation import noise
from gravcal.estimation.resampling import lines_between
from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS

STEP = 10.0  # s, of means while rolling
GUARD = 20.0  # s kept clear of the swing where voltages are to be quiet
MEDIAN = 11  # samples of the running median before changes are looked at
LEAST = 3000.0  # s of a roll that determine the torque of gravity to 3 %
LOST = 60.0  # s without attitude in which a swing is not detected
IDLE = "attitude against orbit on days without swing and roll"
TORQUE = "angular reading y over gravity torque while rolling, from one"
#: Setting and unit of the limit of each check of the records.
LIMITS = {
    "constant readings": ("constant_limit_s", "s"),
    "quaternion norm": ("norm_limit", "1"),
    "attitude jump": ("jump_limit_rad", "rad"),
    "orbit velocity against position": ("velocity_limit_m_s", "m/s"),
    "orbit height against the catalogue": ("height_limit_m", "m"),
    "attitude against orbit": ("pointing_limit_rad", "rad"),
    "quiet voltages, rms over median change": ("quiet_step_limit", "1"),
    TORQUE: ("factor_limit", "1"),
}


def inputs(
    detected: xr.Dataset,
    days: Sequence[tuple[Callable, Callable, Callable]],
    *,
    expected_beta,
    orbit_height,
    inertia,
    **limits: float,
) -> xr.Dataset:
    """Checks of the records of all manoeuvres, the worst of all days; of days without any, of the attitude alone.

    Days are functions that read sensor, tracker and orbit of each; expected_beta (2,) rad s-2 V-1 is about x and about
    y and z, orbit_height m catalogued, inertia (3,) kg m2 of the test mass.
    """
    margin_s = limits["margin_s"]
    still = [[detected.swing_start[0] - margin_s, detected.swing_start[0] - GUARD]] if detected.sizes["swing"] else []
    still += [[detected.swing_stop[0] + GUARD, detected.swing_stop[0] + margin_s]] if still else []
    swing = np.stack([detected.swing_start, detected.swing_stop], axis=1)[:1] + [-margin_s, margin_s]
    roll = np.stack([detected.roll_start, detected.roll_stop], axis=1)
    departures, idle, spans = [], [], np.concatenate([swing, roll])
    for read_sensor, read_tracker, read_orbit in days:
        tracker, orbit = read_tracker(), read_orbit()
        if not in_windows(tracker["time"], spans, 0.0).any():
            time, quaternion = tracker["time"], tracker["quaternion"]
            begin, end = noise.runs(~(np.linalg.norm(quaternion, axis=1) > 0.5))
            few, nothing = slice(None, None, max(1, time.size // 8640)), np.zeros((0, 2))
            lost = np.max(time[end - 1] - time[begin], initial=0.0) > LOST  # a roll with it is not detected
            pointing = _pointing(time[few], quaternion[few], orbit, in_windows(time[few], nothing, 0.0))
            idle.append(np.inf if lost else pointing)
            continue
        sensor, tracker, orbit = (_within(one, spans) for one in (read_sensor(), tracker, orbit))
        known = np.isfinite(tracker["quaternion"]).all(axis=1)
        time, quaternion = tracker["time"][known], tracker["quaternion"][known]
        if min(one.size for one in (sensor["time"], time, orbit["time"])) < 3:
            continue
        position, velocity = orbit["position"], orbit["velocity"]
        series = ((sensor["time"], sensor["volts"]), (time, quaternion), (orbit["time"], np.c_[position, velocity]))
        rolling = [_within(one, roll) for one in (sensor, tracker, orbit)]
        departures.append([
            max(checks.longest_constant(*one) for one in series),
            np.abs(np.linalg.norm(quaternion, axis=1) - 1).max(initial=0.0),
            checks.attitude_jump(time, quaternion),
            checks.velocity_error(orbit["time"], position, velocity),
            np.nanmax(np.abs(np.linalg.norm(position, axis=1) - EARTH_RADIUS - orbit_height)),
            _pointing(time, quaternion, orbit, in_windows(time, roll, 0.0)),
            _steps(sensor, still),
            _torque(*rolling, expected_beta[1], np.diag(inertia)),
        ])  # fmt: skip
    if not departures:
        raise EstimationError("found no record of a manoeuvre, expected voltages, attitude and orbit. Check the files.")
    worst = np.append(np.max(departures, axis=0)[:-1], np.fmax.reduce(departures)[-1])
    judged = zip(LIMITS.items(), worst, strict=True)
    tests = [at_most(name, value, limits[limit], unit) for (name, (limit, unit)), value in judged]
    tests += [at_most(IDLE, np.max(idle), limits["pointing_limit_rad"], "rad")] if idle else []
    return checks.product([one for one in tests if one.name != TORQUE or not np.isnan(one.value)])


def _within(record, spans):
    """Part of a record {variable: (n, ...)} that lies in spans (k, 2) s."""
    inside = in_windows(record["time"], spans, 0.0)
    return {name: values[inside] for name, values in record.items()}


def _steps(sensor, spans):
    """Largest rms over median of the change of a voltage in a second of quiet spans, less short spikes; at least 1.

    Changes of noise give one; a sign, a scale or an offset of some seconds gives steps, which the noise would hold.
    """
    largest = 1.0
    for start, stop in spans:
        volts = _within(sensor, np.array([[float(start), float(stop)]]))["volts"]
        if len(volts) > 10 * MEDIAN:
            smooth = median_filter(volts, size=(MEDIAN, 1))
            change = smooth[MEDIAN:] - smooth[:-MEDIAN]
            change -= np.median(change, axis=0)
            typical = 1.4826 * np.median(np.abs(change), axis=0)
            rms = np.sqrt(np.mean(change**2, axis=0))
            largest = max(largest, float(np.max(np.divide(rms, typical, out=np.ones_like(rms), where=typical > 0))))
    return largest


def _torque(sensor, tracker, orbit, beta, inertia):
    """Departure from one of the ratio of angular readout y to that by torques on the test mass; NaN if short."""
    if min(one["time"].size for one in (sensor, tracker, orbit)) < 3 or np.ptp(sensor["time"]) < LEAST:
        return np.nan
    means = align.reduced(sensor, tracker, orbit, STEP)
    edges = np.append(means["time"] - STEP / 2, means["time"][-1] + STEP / 2)
    readout = align.clipped_means(sensor["time"], sensor["volts"] @ electrodes.READOUT[4:5].T, edges)[0][:, 0]
    gradient, rate = means["gradient_b"], means["rate_b"]
    torque = frames.vex(inertia @ gradient - gradient @ inertia) - np.cross(rate, rate @ inertia)
    model = -torque[:, 1] / inertia[1, 1] / beta
    good = np.isfinite(readout) & np.isfinite(model)
    if np.count_nonzero(good) * STEP < LEAST:
        return np.nan
    model, readout = (one[good] - one[good].mean() for one in (model, readout))
    return abs(model @ readout / (model @ model) - 1)


def _pointing(time, quaternion, orbit, rolling):
    """Largest angle rad from the flight attitude; where rolling (n,) about y, angle of y from the orbit normal."""
    state = np.concatenate([orbit["position"], orbit["velocity"]], axis=1)
    valid = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1) > 0
    if not valid.any():
        return np.nan
    covered = (time >= orbit["time"][valid][0]) & (time <= orbit["time"][valid][-1])
    covered &= np.linalg.norm(quaternion, axis=1) > 0.5
    if not covered.any():
        return np.nan
    state = lines_between(time[covered], orbit["time"][valid], state[valid])
    R_bo = frames.R_bi_from_quaternion(quaternion[covered]) @ np.swapaxes(frames.flight_frame(state), 1, 2)
    cosine = np.trace(R_bo, axis1=1, axis2=2) / 2 - 0.5
    return np.arccos(np.clip(np.where(rolling[covered], R_bo[:, 1, 1], cosine), -1, 1)).max()


def result(products: Mapping[str, xr.Dataset], limits: Mapping) -> list[Check]:
    """Checks of the results of swing and roll: quality of the fits, solutions against each other, plausible size.

    `limits` are all settings.
    """
    tests = []
    if "scale" in products:
        scaled = products["scale"]
        moved = products["offset"]
        off_x, off_y = np.abs(scaled.beta.values[:2] / np.array(limits["expected_beta"]) - 1)
        last = np.abs((scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1])
        first, second = moved.covariance.values  # the second solution has part of the data of the first
        variance = np.diag(second - first) + np.sum(np.diff(moved["shift"].values, axis=0)[0] ** 2, axis=0)
        deviation = np.abs(np.diff(moved.offset.values, axis=0)[0]) / np.sqrt(np.maximum(variance, 1e-300))
        tests += [
            at_most("chi2 per degree of freedom, scale factors", scaled.chi2 / scaled.dof, limits["fit_limit"], "1"),
            at_most("chi2 per degree of freedom, offset", moved.chi2 / moved.dof, limits["fit_limit"], "1"),
            at_most("filter against batch", last.max(), limits["filter_limit"], "sigma"),
            at_most("beta_x over the catalogue, from one", off_x, limits["factor_limit"], "1"),
            at_most("beta_y over the catalogue, from one", off_y, limits["factor_limit"], "1"),
            at_most("delay of the tracker", abs(scaled.delay), limits["delay_limit_s"], "s"),
            at_most("size of the offset", 1e6 * np.abs(moved.offset).max(), limits["offset_limit_um"], "um"),
            at_most("offset with and without a_y", deviation.max(), limits["agreement_limit"], "sigma"),
        ]
    if "bias" in products and "not_determined" not in products["bias"].attrs:
        biased = products["bias"]  # segments of the roll, drag as its axes see it, and the size of the bias
        used = biased.used.values.astype(bool)
        own, sigma = (biased[f"segment_{name}"].values[used] for name in ("bias", "sigma"))
        x, _, z = np.sqrt(np.mean(np.diff(own, axis=0) ** 2, axis=0) / 2 / np.mean(sigma**2, axis=0))
        by_x, by_z = biased.amplitude.values
        drag = np.linalg.norm(by_x)
        tests += [
            at_most("segments of the roll, x", x, limits["segments_limit"], "sigma"),
            at_most("segments of the roll, z", z, limits["segments_limit"], "sigma"),
            at_most("drag by z against x", np.linalg.norm(by_z - by_x) / drag, limits["drag_agreement_limit"], "1"),
            at_most("drag", drag, limits["drag_limit_m_s2"], "m s-2"),
            at_least("drag, least", drag, limits["drag_least_m_s2"], "m s-2"),
            at_most("size of the bias", np.abs(biased.bias).max(), limits["bias_limit_m_s2"], "m s-2"),
        ]
        if "align" in products:
            swing = electrodes.readouts(products["align"].volts.values)[:, :3].mean(axis=0)
            change = np.abs(1 + products["bias"].bias_volt.values / swing).max()
            name = "mean linear reading, roll over swing, from one"
            tests.append(at_most(name, change, limits["reading_limit"], "1"))
    return tests
