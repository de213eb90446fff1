"""What voltages, attitude and orbit of the manoeuvres must satisfy against each other, and what the result must."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations import checks
from gravcal.calibrations.checks import Check, at_least, at_most
from gravcal.calibrations.inertial_sensor import roll_bins
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError
from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS

STEP = 10.0  # s, of means while rolling
LEAST = 3000.0  # s of a roll, of which the torque of gravity is told to 3 %
TORQUE = "angular reading y over gravity torque while rolling, from one"


def inputs(
    detected: xr.Dataset,
    days: Sequence[tuple[Callable, Callable, Callable]],
    *,
    margin_s,
    constant_limit_s,
    norm_limit,
    jump_limit_rad,
    velocity_limit_m_s,
    height_limit_m,
    pointing_limit_rad,
    expected_beta,
    factor_limit,
    orbit_height,
    inertia,
) -> xr.Dataset:
    """Checks of the records of all manoeuvres, the worst of all days.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    days : functions that read sensor, tracker and orbit of each day
    margin_s : s on either side of a swing that are looked at
    constant_limit_s .. pointing_limit_rad, factor_limit : limits
    expected_beta : (2,) rad s-2 V-1, about x and about y and z
    orbit_height : m, catalogued; inertia : (3,) kg m2, of the test mass

    Returns
    -------
    checked : Dataset, schema `checks.CHECKS`
    """
    swing = np.stack([detected.swing_start, detected.swing_stop], axis=1)[:1] + [-margin_s, margin_s]
    roll = np.stack([detected.roll_start, detected.roll_stop], axis=1)
    known = orbit_height, expected_beta[1], np.diag(inertia)
    found = [one for one in (_day(*(read() for read in day), swing, roll, known) for day in days) if one]
    if not found:
        raise EstimationError("found no record of a manoeuvre, expected voltages, attitude and orbit. Check the files.")
    worst = {name: np.max([one[name] for one in found]) for name in found[0] if name != TORQUE}
    torque = np.fmax.reduce([one[TORQUE] for one in found])
    limits = {
        "constant readings": (constant_limit_s, "s"),
        "quaternion norm": (norm_limit, "1"),
        "attitude jump": (jump_limit_rad, "rad"),
        "orbit velocity against position": (velocity_limit_m_s, "m/s"),
        "orbit height against the catalogue": (height_limit_m, "m"),
        "attitude against orbit": (pointing_limit_rad, "rad"),
    }
    tests = [at_most(name, worst[name], *limits[name]) for name in limits]
    return checks.product(tests + ([] if np.isnan(torque) else [at_most(TORQUE, torque, factor_limit, "1")]))


def _day(sensor, tracker, orbit, swing, roll, known):
    """Largest departure of each check in the manoeuvres of one day, {} without any."""
    spans = np.concatenate([swing, roll])
    sensor, tracker, orbit = (_within(one, spans) for one in (sensor, tracker, orbit))
    seen = np.isfinite(tracker["quaternion"]).all(axis=1)
    time, quaternion = tracker["time"][seen], tracker["quaternion"][seen]
    if min(one.size for one in (sensor["time"], time, orbit["time"])) < 3:
        return {}
    columns = ((sensor["time"], sensor["volts"]), (time, quaternion), (orbit["time"], orbit["position"]))
    norm = np.linalg.norm(quaternion, axis=1)
    constant = [checks.longest_constant(*one) for one in (*columns, (orbit["time"], orbit["velocity"]))]
    position, radius = orbit["position"], np.linalg.norm(orbit["position"], axis=1)
    height, *mass = known
    return {
        "constant readings": max(constant),
        "quaternion norm": np.abs(norm - 1).max(initial=0.0),
        "attitude jump": checks.attitude_jump(time, quaternion),
        "orbit velocity against position": checks.velocity_error(orbit["time"], position, orbit["velocity"]),
        "orbit height against the catalogue": np.nanmax(np.abs(radius - EARTH_RADIUS - height)),
        "attitude against orbit": _pointing(time, quaternion, orbit, _inside(time, roll)),
        TORQUE: _torque(*(_within(one, roll) for one in (sensor, tracker, orbit)), *mass),
    }


def _within(record, spans):
    """Part of a record that lies in spans."""
    inside = _inside(record["time"], spans)
    return {name: values[inside] for name, values in record.items()}


def _torque(sensor, tracker, orbit, beta, inertia):
    """Change of the angular readout y over that of the torque of gravity, from one; NaN of a short roll."""
    if min(one["time"].size for one in (sensor, tracker, orbit)) < 3 or np.ptp(sensor["time"]) < LEAST:
        return np.nan
    bins = roll_bins.reduced(sensor, tracker, orbit, STEP)
    edges = np.append(bins["time"] - STEP / 2, bins["time"][-1] + STEP / 2)
    readout = roll_bins.clipped_means(sensor["time"], sensor["volts"] @ electrodes.READOUT[4:5].T, edges)[0][:, 0]
    gradient, rate = bins["gradient_b"], bins["rate_b"]
    own = frames.vex(inertia @ gradient - gradient @ inertia) - np.cross(rate, rate @ inertia)
    model = -own[:, 1] / inertia[1, 1] / beta
    good = np.isfinite(readout) & np.isfinite(model)
    if np.count_nonzero(good) * STEP < LEAST:
        return np.nan
    model, readout = (one[good] - one[good].mean() for one in (model, readout))
    return abs(model @ readout / (model @ model) - 1)


def _inside(time, spans):
    """Whether an epoch lies in a span (n,)."""
    return np.any((time[:, None] >= spans[:, 0]) & (time[:, None] <= spans[:, 1]), axis=1)


def _pointing(time, quaternion, orbit, rolling):
    """Largest angle from the flight attitude (rad); while rolling about y, of y from the orbit normal."""
    state = np.concatenate([orbit["position"], orbit["velocity"]], axis=1)
    known = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1) > 0
    if not known.any():
        return np.nan
    covered = (time >= orbit["time"][known][0]) & (time <= orbit["time"][known][-1])
    covered &= np.linalg.norm(quaternion, axis=1) > 0.5
    if not covered.any():
        return np.nan
    state = np.stack([np.interp(time[covered], orbit["time"][known], c) for c in state[known].T], axis=1)
    R_bo = frames.R_bi_from_quaternion(quaternion[covered]) @ np.swapaxes(roll_bins.orbit_frame(state), 1, 2)
    whole = np.trace(R_bo, axis1=1, axis2=2) / 2 - 0.5
    cosine = np.where(rolling[covered], R_bo[:, 1, 1], whole)
    return np.arccos(np.clip(cosine, -1, 1)).max()


def result(given: Mapping[str, xr.Dataset], limits: Mapping) -> list[Check]:
    """Checks of what was found: quality of the fits, solutions against each other, plausible size.

    Parameters
    ----------
    given : {name: Dataset}, "align", "scale", "offset" of a swing, "bias" of a roll, as far as they are there
    limits : all settings
    """
    found = []
    if "scale" in given:
        found += _of_swing(given["scale"], given["offset"], limits)
    if "bias" in given and "not_determined" not in given["bias"].attrs:
        found += _of_roll(given["bias"], limits)
        if "align" in given:
            swing = electrodes.readouts(given["align"].volts.values)[:, :3].mean(axis=0)
            change = np.abs(1 + given["bias"].bias_volt.values / swing).max()
            found.append(
                at_most("mean linear reading, roll over swing, from one", change, limits["reading_limit"], "1")
            )
    return found


def _of_swing(scaled, moved, limits):
    """Fits, factors, delay and offset of a swing."""
    expected = np.array(limits["expected_beta"])
    off = np.abs(scaled.beta.values[:2] / expected - 1)
    last = np.abs((scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1])
    return [
        at_most("chi2 per degree of freedom, scale factors", scaled.chi2 / scaled.dof, limits["fit_limit"], "1"),
        at_most("chi2 per degree of freedom, offset", moved.chi2 / moved.dof, limits["fit_limit"], "1"),
        at_most("filter against batch", last.max(), limits["filter_limit"], "sigma"),
        *(
            at_most(f"beta_{n} over the catalogue, from one", v, limits["factor_limit"], "1")
            for n, v in zip("xy", off, strict=True)
        ),
        at_most("delay of the tracker", abs(scaled.delay), limits["delay_limit_s"], "s"),
        at_most("size of the offset", 1e6 * np.abs(moved.offset).max(), limits["offset_limit_um"], "um"),
        at_most("offset with and without a_y", _apart(moved), limits["agreement_limit"], "sigma"),
    ]


def _apart(moved):
    """Largest difference of the two solutions over its sigma: the second has part of the data of the first."""
    first, second = moved.covariance.values
    variance = np.diag(second - first) + np.sum(np.diff(moved["shift"].values, axis=0)[0] ** 2, axis=0)
    return (np.abs(np.diff(moved.offset.values, axis=0)[0]) / np.sqrt(np.maximum(variance, 1e-300))).max()


def _of_roll(biased, limits):
    """Segments of a roll, drag as its axes see it, and the size of the bias."""
    used = biased.used.values.astype(bool)
    own, sigma = (biased[f"segment_{name}"].values[used] for name in ("bias", "sigma"))
    wander = np.sqrt(np.mean(np.diff(own, axis=0) ** 2, axis=0) / 2 / np.mean(sigma**2, axis=0))[[0, 2]]
    by_x, by_z = biased.amplitude.values
    drag = np.linalg.norm(by_x)
    return [
        *(
            at_most(f"segments of the roll, {n}", v, limits["segments_limit"], "sigma")
            for n, v in zip("xz", wander, strict=True)
        ),
        at_most("drag by z against x", np.linalg.norm(by_z - by_x) / drag, limits["drag_agreement_limit"], "1"),
        at_most("drag", drag, limits["drag_limit_m_s2"], "m s-2"),
        at_least("drag, least", drag, limits["drag_least_m_s2"], "m s-2"),
        at_most("size of the bias", np.abs(biased.bias).max(), limits["bias_limit_m_s2"], "m s-2"),
    ]
