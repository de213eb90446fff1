"""Attitude of every manoeuvre: fitted dynamics, edge times in both instruments, what the star camera alone sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import attitude_fit, motion, timing_fit
from gravcal.calibrations.com_offset.attitude_fit import Choice
from gravcal.calibrations.com_offset.schemas import ATTITUDE
from gravcal.calibrations.com_offset.star_camera_wave import fit_star_camera_wave, shape
from gravcal.calibrations.com_offset.windows import Window, field_at, windows
from gravcal.estimation.noise import NoiseModel, fit_noise
from gravcal.estimation.resampling import operator_for
from gravcal.physics import frames

VECTORS = ("rate_b", "rate_dot_mtq_b", "rate_dot_sca_b", "magnetic_b", "smooth_b")
JOINED = dict.fromkeys(VECTORS, (0, 3)) | {"time_acc": (0,), "gradient_b": (0, 3, 3), "sca_modes": (6, 0, 3)}
#: Degree of the slow torque where no manoeuvre is there and control goes on.
SURVEY_DEGREE = 5
#: A noise model takes this many samples a coefficient, few manoeuvres a short one: else it follows the fit's own notch.
SAMPLES_PER_ORDER, FEW_ORDER = 84, 6
#: A change of the noise's reflection coefficients that moves the weights by less than their own error.
SETTLED = 0.02
WHITE = [NoiseModel(np.zeros(0), np.ones(1), 1.0)] * 3


def fit_all(found: list[Window], choice: Choice, order: int) -> tuple[list, list[NoiseModel]]:
    """Fit every manoeuvre, first with white noise, then with the noise that the residuals show.

    Parameters
    ----------
    found : windows
    choice : Choice
    order : highest of the noise model

    Returns
    -------
    fits : list of Fit or None where the star camera has too little
    noise : noise model of each axis
    """
    usable = [w for w in found if w.good.sum() >= 8]
    if not usable:
        return [None] * len(found), WHITE
    sigma = 3e-6  # rad, only the start of the iteration
    noise = [NoiseModel(np.zeros(0), np.array([sigma**2]), 1.0)] * 3
    samples = sum(int(w.good.sum()) for w in usable)
    order = min(order, max(FEW_ORDER, samples // SAMPLES_PER_ORDER))
    fits, before = {}, np.inf
    for _ in range(3):
        start = {key: fit.solution for key, fit in fits.items()}
        fits = {
            id(w): attitude_fit.fit_attitude(w.arc, w.time, w.quaternion, w.good, noise, choice, start.get(id(w)))
            for w in usable
        }
        unknowns = len(attitude_fit.names_of(choice)) * len(usable) // 3
        noise = [_axis_noise(usable, fits, axis, order, unknowns) for axis in range(3)]
        shape = np.concatenate([n.reflection for n in noise])
        if np.abs(shape - before).max(initial=0.0) < SETTLED:
            break
        before = shape
    return [fits.get(id(w)) for w in found], noise


def _axis_noise(usable, fits, axis, order, unknowns):
    segments = [np.where(w.good, fits[id(w)].residual[:, axis], np.nan) for w in usable]
    return fit_noise(segments, order, 1.0, removed=unknowns)


def fit_timing(found, fits, aligned: xr.Dataset, filters: dict, degree: int, order: int) -> list:
    """Wave in the angular acceleration of every manoeuvre, with the noise that its residuals show.

    Parameters
    ----------
    found, fits : windows and their attitude
    aligned : Dataset, "align"
    filters : lowpass_hz, half_width_s, step_s
    degree : of the drift
    order : of the noise model

    Returns
    -------
    timings : list of WaveFit or None where there is no angular acceleration
    """
    time, angular = aligned["time_acc"].values, aligned["angular_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(angular).all(axis=1)
    noise, timings = [NoiseModel(np.zeros(0), np.array([1e-16]), 0.5)] * 3, []
    for _ in range(2):
        timings = [
            _timing(w, f, time[w.acc], angular[w.acc], good[w.acc], noise, filters, degree)
            for w, f in zip(found, fits, strict=True)
        ]
        seen = [t for t in timings if t is not None]
        if not seen:
            break
        removed = len(seen) * (degree + 2)
        noise = [fit_noise([t.residual[:, a] for t in seen], order, filters["step_s"], removed) for a in range(3)]
    return timings


def _timing(window, fit, time, angular, good, noise, filters, degree):
    if fit is None or good.sum() < 100 or np.ptp(angular[good], axis=0).max() == 0:
        return None
    field_b = field_at(window, fit, time)
    width = float(np.median(np.diff(time)))

    def wave(shift):
        late = fit.solution.shift + shift
        return motion.magnetic_acceleration(window.arc, late, time, field_b, width)

    ends = window.arc.edges[[0, -1]] + fit.solution.shift
    operator = operator_for(time, good, max(ends[0], time[0]), min(ends[1], time[-1]), **filters)
    if operator.valid.sum() < 40:
        return None
    return timing_fit.fit_wave(np.nan_to_num(angular), wave, operator, noise, degree)


def attitude(aligned: xr.Dataset, field: xr.Dataset, **settings) -> xr.Dataset:
    """Smoothed attitude of every manoeuvre on the star-camera and on the accelerometer epochs.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    settings : dynamics, torque_degree, estimate_torque_scale, torque_scale_sigma, estimate_inertia,
        inertia_scale_sigma, edge_shift_sigma_s,
        integration_step_s, iteration_limit, attitude_noise_order, lowpass_hz, half_width_s, step_s,
        calibration_drift_degree, inertia, dipole_per_current

    Returns
    -------
    smoothed : Dataset, "com_offset.attitude"
    """
    full = settings["dynamics"] == "full"
    found = windows(aligned, field, settings["inertia"], np.asarray(settings["dipole_per_current"]), full)
    scale_sigma = settings["torque_scale_sigma"] if full and settings["estimate_torque_scale"] else 0.0
    choice = Choice(
        torque_degree=settings["torque_degree"] if full else -1,
        scale_sigma=scale_sigma,
        inertia_sigma=settings["inertia_scale_sigma"] if full and settings["estimate_inertia"] else 0.0,
        shift_sigma=settings["edge_shift_sigma_s"] if full else 0.0,
        step_s=settings["integration_step_s"],
        iterations=settings["iteration_limit"],
    )
    if found[0].rod < 0:  # nothing is calibrated: follow the controlled attitude, hold the torquers
        choice = replace(
            choice, torque_degree=max(choice.torque_degree, SURVEY_DEGREE), scale_sigma=0.0, shift_sigma=0.0
        )
    fits, noise = fit_all(found, choice, settings["attitude_noise_order"])
    filters = {name: settings[name] for name in ("lowpass_hz", "half_width_s", "step_s")}
    timings = fit_timing(
        found, fits, aligned, filters, settings["calibration_drift_degree"], settings["attitude_noise_order"]
    )
    parts = [_manoeuvre(w, f, t, aligned, noise, choice) for w, f, t in zip(found, fits, timings, strict=True)]
    return _as_dataset(parts, found, fits, timings, aligned)


def _manoeuvre(window: Window, fit, timing, aligned, noise, choice):
    """Motion on the accelerometer epochs of one manoeuvre, in the accelerometer's own time."""
    time = aligned["time_acc"].values[window.acc]
    if fit is None:
        return None
    late = timing.shift if timing is not None else 0.0
    at = np.clip(time - late, window.arc.origin, None)
    quaternion, rate, rate_dot = motion.evaluate(window.arc, fit.solution, at, choice.step_s)
    field_b = field_at(window, fit, at)
    width = float(np.median(np.diff(time)))
    smooth = rate_dot - _point_magnetic(window, fit, at, field_b)
    magnetic = motion.magnetic_acceleration(window.arc, fit.solution.shift, at, field_b, width)
    gradient = _gradient_b(window, quaternion, at)
    rod = window.rod
    amplitude, root = np.zeros((2, 3)), np.zeros((6, 6))
    if rod >= 0:
        amplitude, root = fit_star_camera_wave(window, fit, noise, rod, max(choice.torque_degree, 0))
    parts = shape(window.arc, rod, fit.solution.shift, at, width) if rod >= 0 else np.zeros((time.size, 2))
    return {
        "time_acc": time,
        "rate_b": rate,
        "rate_dot_mtq_b": smooth + magnetic,
        "rate_dot_sca_b": smooth + parts @ amplitude,
        "sca_modes": np.einsum("nk,kam->mna", parts, root.reshape(2, 3, 6)),
        "magnetic_b": magnetic,
        "gradient_b": gradient,
        "smooth_b": smooth,
    }


def _point_magnetic(window, fit, time, field_b):
    """Magnetic part that the integrator put into the angular acceleration at each epoch, fitted scale."""
    torque = fit.solution.scale_b * np.cross(motion.dipole_at(window.arc, time, fit.solution.shift), field_b)
    return np.linalg.solve(window.arc.inertia, torque.T).T


def _gradient_b(window, quaternion, time):
    """Gravity gradient in the body, zero when the dynamics leave it out."""
    if window.arc.gradient_i is None:
        return np.zeros((time.size, 3, 3))
    from scipy.interpolate import CubicSpline

    R_bi = frames.R_bi_from_quaternion(quaternion)
    return R_bi @ CubicSpline(window.arc.field_time, window.arc.gradient_i)(time) @ np.swapaxes(R_bi, 1, 2)


def _as_dataset(parts, found, fits, timings, aligned):
    """Everything of all manoeuvres, one after the other."""
    values = _joined([(i, p) for i, p in enumerate(parts) if p is not None])
    values |= {"rod": [w.rod for w in found], "gap": aligned["gap"].values}
    values |= _per_manoeuvre(found, fits, timings) | _residuals(found, fits) | _delays(found, fits, timings, aligned)
    return build(ATTITUDE, values, title="Attitude of the manoeuvres, fitted to the star camera")


def _joined(kept):
    joined = {}
    for name, size in JOINED.items():
        empty = np.zeros(size)
        axis = 1 if name == "sca_modes" else 0
        joined[name] = np.concatenate([empty, *(p[name] for _, p in kept)], axis=axis)
    joined["acc_manoeuvre"] = np.concatenate([np.zeros(0), *(np.full(p["time_acc"].size, i) for i, p in kept)])
    return joined


def _per_manoeuvre(found, fits, timings):
    """Shifts, torque scales, rms and the scale of the angular accelerometer, one row a manoeuvre."""
    count = len(found)
    table = {n: np.full(count, np.nan) for n in ("sca_shift", "sca_shift_sigma", "acc_shift", "acc_shift_sigma")}
    wide = {
        n: np.full((count, 3), np.nan)
        for n in (
            "torque_scale",
            "torque_scale_sigma",
            "inertia_scale",
            "inertia_scale_sigma",
            "angular_scale",
            "angular_scale_sigma",
            "residual_rms",
        )
    }
    for i, (w, f, t) in enumerate(zip(found, fits, timings, strict=True)):
        if f is None:
            continue
        sigma = dict(zip(f.names, np.sqrt(np.diag(f.covariance)), strict=True))
        table["sca_shift"][i], table["sca_shift_sigma"][i] = f.solution.shift, sigma.get("shift", np.nan)
        wide["torque_scale"][i] = f.solution.scale_b
        wide["torque_scale_sigma"][i] = [sigma.get(f"scale_{a}", np.nan) for a in "xyz"]
        wide["inertia_scale"][i] = f.solution.inertia_scale
        wide["inertia_scale_sigma"][i] = [sigma.get(f"inertia_{a}", np.nan) for a in "xyz"]
        wide["residual_rms"][i] = np.sqrt(np.mean(f.residual[w.good] ** 2, axis=0))
        if t is not None:
            table["acc_shift"][i] = f.solution.shift + t.shift
            table["acc_shift_sigma"][i] = t.shift_sigma
            wide["angular_scale"][i], wide["angular_scale_sigma"][i] = t.scale, t.scale_sigma
    return table | wide


def _residuals(found, fits):
    """Star camera minus model on the star-camera epochs."""
    rows = [(w.time[w.good], f.residual[w.good], i) for i, (w, f) in enumerate(zip(found, fits, strict=True)) if f]
    return {
        "time_sca": np.concatenate([np.zeros(0), *(r[0] for r in rows)]),
        "sca_residual_b": np.concatenate([np.zeros((0, 3)), *(r[1] for r in rows)]),
        "sca_manoeuvre": np.concatenate([np.zeros(0), *(np.full(r[0].size, r[2]) for r in rows)]),
    }


def _delays(found, fits, timings, aligned):
    """Delay of each instrument's tags against the torquer telemetry; NaN where nothing says so."""
    rows = [
        (f.solution.shift, np.sqrt(f.covariance[-1, -1]), t.shift, t.shift_sigma, w.lower, w.upper)
        for w, f, t in zip(found, fits, timings, strict=True)
        if f is not None and t is not None and w.rod >= 0 and f.names[-1] == "shift"
    ]
    result = dict.fromkeys(("acc_delay", "acc_delay_sigma", "sca_delay", "sca_delay_sigma"), np.nan)
    if rows:
        sca, sca_sigma, relative, relative_sigma, lower, upper = np.array(rows).T
        sample = np.median(np.diff(aligned["time_acc"].values)) / np.sqrt(12)  # an edge is known to one sample
        acc, acc_sigma = timing_fit.delay_from_brackets(sca + relative, np.hypot(relative_sigma, sample), lower, upper)
        weight = 1 / (sca_sigma**2 + relative_sigma**2 + sample**2)
        between = float(np.sum(weight * -relative) / np.sum(weight))
        result["acc_delay"], result["acc_delay_sigma"] = acc, acc_sigma
        result["sca_delay"] = acc + between
        result["sca_delay_sigma"] = float(np.hypot(acc_sigma, 1 / np.sqrt(np.sum(weight))))
    return result
