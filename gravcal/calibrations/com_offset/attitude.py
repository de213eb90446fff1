"""Attitude of every manoeuvre: fitted dynamics, edge times in both instruments, what the star camera alone says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import motion
from gravcal.calibrations.com_offset.motion import (
    Arc,
    Solution,
    Window,
    field_at,
    propagator,
    torque_of,
    updated,
    windows,
)
from gravcal.calibrations.com_offset.schemas import ATTITUDE
from gravcal.estimation.least_squares import covariance, polynomial, stable_inverse, without
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.estimation.resampling import Resampler, operator_for
from gravcal.physics import dynamics, frames

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
            id(w): fit_attitude(w.arc, w.time, w.quaternion, w.good, noise, choice, start.get(id(w))) for w in usable
        }
        unknowns = len(names_of(choice)) * len(usable) // 3
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
    return fit_wave(np.nan_to_num(angular), wave, operator, noise, degree)


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
        acc, acc_sigma = delay_from_brackets(sca + relative, np.hypot(relative_sigma, sample), lower, upper)
        weight = 1 / (sca_sigma**2 + relative_sigma**2 + sample**2)
        between = float(np.sum(weight * -relative) / np.sum(weight))
        result["acc_delay"], result["acc_delay_sigma"] = acc, acc_sigma
        result["sca_delay"] = acc + between
        result["sca_delay_sigma"] = float(np.hypot(acc_sigma, 1 / np.sqrt(np.sum(weight))))
    return result


INERTIA_STEP = 1e-4  # relative, of the differences by the principal moments


@dataclass(frozen=True)
class Choice:
    """What is estimated beside the start attitude and rate.

    Attributes
    ----------
    torque_degree : degree of a slowly varying torque, -1 for none
    scale_sigma : prior of the torque scale per axis; 0 holds it at the catalogue
    inertia_sigma : relative prior of the principal moments; 0 holds them at the catalogue
    shift_sigma : s, prior of the common edge shift; 0 holds it
    step_s : s, longest integration step
    iterations : at most
    """

    torque_degree: int
    scale_sigma: float
    inertia_sigma: float
    shift_sigma: float
    step_s: float
    iterations: int


@dataclass(frozen=True)
class Fit:
    """Result of one arc.

    Attributes
    ----------
    solution : Solution
    residual : (n, 3) rad, star camera minus model, in the body
    design : (n, 3, p) rad, columns of the last step
    covariance : (p, p) of the unknowns `names`
    names : (p,)
    """

    solution: Solution
    residual: np.ndarray
    design: np.ndarray
    covariance: np.ndarray
    names: tuple[str, ...]


def names_of(choice: Choice) -> tuple[str, ...]:
    """Names of the unknowns in the order of the columns."""
    groups = ["angle", "rate", *(f"torque{k}" for k in range(choice.torque_degree + 1))]
    groups += ["scale"] if choice.scale_sigma > 0 else []
    groups += ["inertia"] if choice.inertia_sigma > 0 else []
    names = [f"{group}_{axis}" for group in groups for axis in "xyz"]
    return (*names, *(["shift"] if choice.shift_sigma > 0 else []))


def first_guess(arc: Arc, time: np.ndarray, quaternion: np.ndarray, degree: int) -> Solution:
    """State at the origin from a quadratic through the first measured attitudes."""
    near = slice(0, min(7, time.size))
    reference = quaternion[near][0]
    angle = frames.rotation_vector(frames.quaternion_product(frames.conjugate(reference), quaternion[near]))
    order = min(2, time[near].size - 1)
    fit = np.polynomial.polynomial.polyfit(time[near] - arc.origin, angle, order)
    start = frames.quaternion_product(reference, frames.from_rotation_vector(fit[0]))
    state = dynamics.State(arc.origin, start / np.linalg.norm(start), fit[1] if order else np.zeros(3))
    return Solution(state, np.zeros((degree + 1, 3)), np.ones(3), 0.0)


def fit_attitude(
    arc: Arc, time, quaternion, good, noise: list[NoiseModel], choice: Choice, start: Solution | None = None
) -> Fit:
    """Gauss-Newton on the three-parameter attitude error (CoM paper eqs. 19-30, errata C-5, C-6).

    Parameters
    ----------
    arc : Arc
    time : (n,) s, evenly spaced grid from the origin on
    quaternion : (n, 4) measured, continuous in sign
    good : (n,) bool
    noise : noise model of each axis
    choice : Choice
    start : solution to begin with; from the first attitudes if None

    Returns
    -------
    fit : Fit
    """
    solution = start or first_guess(arc, time[good], quaternion[good], choice.torque_degree)
    prior = _prior(choice)
    previous, slow = np.inf, None
    for _ in range(max(choice.iterations, 1)):
        residual, design, slow = _linearised(arc, solution, time, quaternion, choice, slow)
        y, A = _whitened(residual, design, good, noise)
        away = _deviation(solution, choice)
        normal = A.T @ A + np.diag(prior)
        right = A.T @ y - prior * away
        scale = np.sqrt(np.diag(normal))
        step = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-14)[0] / scale
        cost = float(y @ y + prior @ away**2)
        if abs(previous - cost) <= 1e-6 * max(cost, 1.0):
            break
        previous = cost
        solution = updated(solution, _unpacked(step, choice))
    return Fit(solution, residual, design, covariance(normal), names_of(choice))


def _linearised(arc, solution, time, quaternion, choice, slow):
    """Residual angles, their derivatives by the unknowns, and those by the slow torque, which stay as they are."""
    modelled, _, _, sensitivity = dynamics.integrate_with_sensitivity(
        time, solution.state, torque_of(arc, solution), max_step=choice.step_s
    )
    residual = frames.rotation_vector(frames.quaternion_product(frames.conjugate(modelled), quaternion))
    columns = [sensitivity[:, :3, :6]]
    if choice.torque_degree >= 0:
        if slow is None:
            slow = slow_torque_response(arc, time, sensitivity[:, :, :6], choice.torque_degree)
        columns.append(slow)
    if choice.scale_sigma > 0:
        columns.append(sensitivity[:, :3, 9:12])
    if choice.inertia_sigma > 0:
        columns.append(_inertia_response(arc, solution, time, modelled, choice.step_s))
    if choice.shift_sigma > 0:
        columns.append(sensitivity[:, :3, 12:13])
    return residual, np.concatenate(columns, axis=2), slow


def _inertia_response(arc, solution, time, modelled, step_s):
    """Derivative of the attitude by each principal moment, relative, (n, 3, 3) rad, by one-sided differences."""
    columns = []
    for axis in range(3):
        scale = solution.inertia_scale.copy()
        scale[axis] += INERTIA_STEP
        changed = replace(solution, inertia_scale=scale)
        moved, _, _ = dynamics.integrate(time, changed.state, torque_of(arc, changed), max_step=step_s)
        columns.append(frames.rotation_vector(frames.quaternion_product(frames.conjugate(modelled), moved)))
    return np.stack(columns, axis=2) / INERTIA_STEP


def slow_torque_response(arc: Arc, time, transition, degree: int) -> np.ndarray:
    """Response (n, 3, 3 (degree + 1)) rad to Legendre torques of 1 N m, degree by degree, axis by axis."""
    inverse = np.linalg.inv(arc.inertia)

    def basis(at):
        u = (2 * at - arc.origin - arc.stop) / (arc.stop - arc.origin)
        shape = np.polynomial.legendre.legvander(u, degree)
        return np.einsum("mk,ca->mkac", shape, inverse).reshape(at.size, -1, 3)

    return propagator(time, transition, np.zeros(0))(basis)


def _whitened(residual, design, good, noise):
    stacked = np.concatenate([residual[:, :, None], design], axis=2)
    rows = [whiten(noise[axis], stacked[:, axis], good) for axis in range(3)]
    rows = np.concatenate(rows)
    return rows[:, 0], rows[:, 1:]


def _prior(choice):
    """Inverse variance of each unknown; the slow torque has a loose one that keeps the sum solvable."""
    loose = 1e-3  # N m, above any torque of the environment
    count = 3 * (choice.torque_degree + 1)
    weights = [np.zeros(6), np.full(count, loose**-2.0)]
    weights += [np.full(3, choice.scale_sigma**-2.0)] if choice.scale_sigma > 0 else []
    weights += [np.full(3, choice.inertia_sigma**-2.0)] if choice.inertia_sigma > 0 else []
    weights += [np.full(1, choice.shift_sigma**-2.0)] if choice.shift_sigma > 0 else []
    return np.concatenate(weights)


def _deviation(solution, choice):
    """Present distance of each unknown from its prior mean."""
    parts = [np.zeros(6), solution.torque_coefficients.ravel()]
    parts += [solution.scale_b - 1] if choice.scale_sigma > 0 else []
    parts += [solution.inertia_scale - 1] if choice.inertia_sigma > 0 else []
    parts += [np.array([solution.shift])] if choice.shift_sigma > 0 else []
    return np.concatenate(parts)


def _unpacked(step, choice):
    """Parts of a step by name, zero for what is held."""
    count = 3 * (choice.torque_degree + 1)
    parts, rest = (
        {"angle": step[:3], "rate": step[3:6], "torque": step[6 : 6 + count].reshape(-1, 3)},
        step[6 + count :],
    )
    for name, estimated in (("scale", choice.scale_sigma > 0), ("inertia", choice.inertia_sigma > 0)):
        parts[name], rest = (rest[:3], rest[3:]) if estimated else (np.zeros(3), rest)
    return parts | {"shift": float(rest[0]) if choice.shift_sigma > 0 else 0.0}


@dataclass(frozen=True)
class WaveFit:
    """Square wave seen in a measured angular acceleration.

    Attributes
    ----------
    shift, shift_sigma : s, by which the wave appears later than assumed
    scale, scale_sigma : (3,) measured over modelled, sigma infinite for an axis that is not turned
    residual : (n, 3) rad s-2, resampled, drift removed
    """

    shift: float
    shift_sigma: float
    scale: np.ndarray
    scale_sigma: np.ndarray
    residual: np.ndarray


def fit_wave(measured, wave, operator: Resampler, noise: list[NoiseModel], degree: int, iterations: int = 8) -> WaveFit:
    """Scale per axis and common shift of a modelled wave in a measured angular acceleration.

    The model is noise-free and stands on the right-hand side, so the scale has no attenuation.

    Parameters
    ----------
    measured : (n, 3) rad s-2
    wave : callable, shift s -> (n, 3) rad s-2
    operator : applied to the measurement and to the model alike
    noise : noise model of each axis on the operator's grid
    degree : of the drift
    iterations : Gauss-Newton steps
    """
    drift = polynomial(operator.time, degree, operator.time[0], operator.time[-1])
    y = operator(measured - measured[len(measured) // 2])
    shift, scale = coarse_shift(y, operator(wave(0.0)), operator, drift, noise), np.ones(3)
    for _ in range(iterations):
        model = operator(wave(shift))
        slope = (operator(wave(shift + 0.01)) - operator(wave(shift - 0.01))) / 0.02
        rows = [_axis(y, model, slope, scale, drift, operator.valid, noise, axis) for axis in range(3)]
        values, design = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
        inverse = stable_inverse(design.T @ design)
        unknown = inverse @ design.T @ values
        scale = unknown[:3]
        shift = float(np.clip(shift + unknown[3], -4.0, 4.0))
        if abs(unknown[3]) < 1e-5:
            break
    size = np.linalg.norm(design[:, :3], axis=0)
    seen = size > 1e-6 * size.max(initial=1e-300)
    sigma = np.sqrt(np.clip(np.diag(inverse), 0.0, None))
    residual = y - model * scale
    used = np.nan_to_num(residual[operator.valid])
    residual = np.full_like(y, np.nan)
    residual[operator.valid] = without(drift[operator.valid], used)
    return WaveFit(shift, float(sigma[3]), np.where(seen, scale, 1.0), np.where(seen, sigma[:3], np.inf), residual)


def coarse_shift(y, model, operator: Resampler, drift, noise: list[NoiseModel], longest: float = 3.0) -> float:
    """Shift in steps of the grid at which measurement and model agree best, the start of the Gauss-Newton steps.

    Parameters
    ----------
    y, model : (n, 3) rad s-2, resampled
    operator : Resampler
    drift : (n, k)
    noise : noise model of each axis
    longest : s, beyond which it is not looked for
    """
    valid = operator.valid
    weight = np.array([1 / n.variance[0] if n.variance[0] > 0 else 0.0 for n in noise])
    clean = np.zeros((2, *y.shape))
    for k, series in enumerate((y, model)):
        clean[k][valid] = without(drift[valid], series[valid])
    step = float(operator.time[1] - operator.time[0])
    count = int(longest / step)
    lags = np.arange(-count, count + 1)
    inner = slice(count, len(y) - count)
    agreement = [
        np.sum(weight * np.sum(clean[0][inner] * np.roll(clean[1], lag, axis=0)[inner], axis=0)) for lag in lags
    ]
    return float(lags[int(np.argmax(agreement))] * step)


def _axis(y, model, slope, scale, drift, valid, noise, axis):
    """Whitened observation and columns (three scales, shift) of one axis, drift removed."""
    columns = np.zeros((y.shape[0], 5))
    columns[:, 0] = y[:, axis]
    columns[:, 1 + axis] = model[:, axis]
    columns[:, 4] = scale[axis] * slope[:, axis]
    both = whiten(noise[axis], np.concatenate([columns, drift], axis=1), valid)
    clean = without(both[:, 5:], both[:, :5])
    return clean[:, 0], clean[:, 1:]


def delay_from_brackets(shift, sigma, lower, upper) -> tuple[float, float]:
    """Delay of an instrument's tags against the torquer telemetry.

    Telemetry at 2 Hz only says between which samples the first edge lies. The edge seen by the instrument, less the
    delay, has to lie there in every manoeuvre; a flat prior gives mean and standard deviation of what is left.

    Parameters
    ----------
    shift, sigma : (k,) s, apparent first edge and its error
    lower, upper : (k,) s, interval that telemetry leaves, on the same origin

    Returns
    -------
    delay, delay_sigma : s
    """
    from scipy.special import log_ndtr, ndtr

    half = (np.max(upper - lower) + np.max(np.abs(shift))) + 5 * float(np.max(sigma))
    grid = np.linspace(-half, half, 8001)
    true = shift[:, None] - grid
    with np.errstate(divide="ignore"):
        inside = ndtr((upper[:, None] - true) / sigma[:, None]) - ndtr((lower[:, None] - true) / sigma[:, None])
        log = np.where(inside > 1e-280, np.log(np.maximum(inside, 1e-300)), 0.0)
    far = np.minimum(
        log_ndtr((upper[:, None] - true) / sigma[:, None]), log_ndtr((true - lower[:, None]) / sigma[:, None])
    )
    log = np.sum(np.where(inside > 1e-280, log, far), axis=0)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2))


def shape(arc: Arc, rod: int, shift: float, time: np.ndarray, width: float) -> np.ndarray:
    """Sign of the wave times (1, u), u from -1 to 1 over the arc, (n, 2)."""
    amplitude = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    sign = motion.mean_dipole(arc, time, shift, width)[:, rod] / (amplitude or 1.0)
    u = (2 * time - arc.origin - arc.stop) / (arc.stop - arc.origin)
    return np.stack([sign, sign * u], axis=1)


def fit_star_camera_wave(window, fit, noise, rod: int, degree: int):
    """Amplitudes of the wave about each body axis from the star camera, nothing of the torquer's strength used.

    Start attitude, rate and a slow torque are estimated along; the timing is that of the attitude fit.

    Parameters
    ----------
    window : Window
    fit : Fit, whose motion is the reference
    noise : noise model of each axis
    rod : excited torquer
    degree : of the slow torque

    Returns
    -------
    amplitude : (2, 3) rad s-2, coefficients of `shape` about each axis
    root : (6, 6) with root root^T the covariance, ordered (shape, axis)
    """
    arc, shift = window.arc, fit.solution.shift
    _, _, _, sensitivity = dynamics.integrate_with_sensitivity(
        window.time, fit.solution.state, motion.torque_of(arc, fit.solution), max_step=1.0
    )
    transition = sensitivity[:, :, :6]

    def basis(at):
        parts = shape(arc, rod, shift, at, 1e-6)
        return np.einsum("mk,ca->mkac", parts, np.eye(3)).reshape(at.size, 6, 3)

    columns = [transition[:, :3, :6], motion.propagator(window.time, transition, arc.edges + shift)(basis)]
    if degree >= 0:
        columns.insert(1, slow_torque_response(arc, window.time, transition, degree))
    design = np.concatenate(columns, axis=2)
    removed = design[:, :, -6:] @ _modelled(arc, fit, rod)
    observed = fit.residual + removed
    rows = [
        whiten(noise[a], np.concatenate([observed[:, a, None], design[:, a]], axis=1), window.good) for a in range(3)
    ]
    rows = np.concatenate(rows)
    inverse = stable_inverse(rows[:, 1:].T @ rows[:, 1:])
    unknown = inverse @ rows[:, 1:].T @ rows[:, 0]
    size, vectors = np.linalg.eigh(inverse[-6:, -6:])
    return unknown[-6:].reshape(2, 3), vectors * np.sqrt(np.clip(size, 0, None))


def _modelled(arc, fit, rod):
    """Amplitudes that the fitted torque model already put into the reference motion, projected on the shape."""
    from scipy.interpolate import CubicSpline

    from gravcal.physics import frames

    time = np.linspace(arc.origin, arc.stop, 361)[1:-1]
    quaternion, _, _ = dynamics.integrate(time, fit.solution.state, motion.torque_of(arc, fit.solution), max_step=1.0)
    field_b = np.matvec(frames.R_bi_from_quaternion(quaternion), CubicSpline(arc.field_time, arc.field_i)(time))
    unit = np.zeros(3)
    unit[rod] = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    torque = fit.solution.scale_b * np.cross(unit, field_b)
    u = (2 * time - arc.origin - arc.stop) / (arc.stop - arc.origin)
    constant_linear = np.linalg.lstsq(np.stack([np.ones_like(u), u], axis=1), torque, rcond=None)[0]
    return np.linalg.solve(arc.inertia, constant_linear.T).T.ravel()
