"""Rotation of every manoeuvre: torques that act, dynamics fitted to the star camera, edge times in both instruments."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag
from scipy.special import log_ndtr, ndtr

from gravcal.calibrations.com_offset.align import SCHEMAS, SURVEY_S
from gravcal.calibrations.schemas import build
from gravcal.estimation.least_squares import covariance, polynomial, project_out, stable_inverse
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten, whitened
from gravcal.estimation.resampling import Resampler, operator_for
from gravcal.physics import dynamics, frames, gravity

SURVEY_DEGREE = 5  # of the slow torque of a record without manoeuvre, in which attitude control goes on
#: A noise model takes this many samples a coefficient, few manoeuvres a short one: else it follows the fit's own notch.
SAMPLES_PER_ORDER, FEW_ORDER = 84, 6
#: A change of the noise's reflection coefficients that moves the weights by less than their own error.
SETTLED = 0.02
LOOSE_TORQUE = 1e-3  # N m, above any torque of the environment: a prior that keeps the sum solvable


@dataclass(frozen=True, kw_only=True)
class Arc(dynamics.Torque):
    """Torques on the satellite during one manoeuvre, a priori: nothing of them is fitted."""

    origin: float  #: s, epoch of the state
    stop: float  #: s, end of the arc


@dataclass(frozen=True)
class Solution:
    """Estimated parameters of the motion in an arc."""

    state: dynamics.State  #: attitude and rate at the origin
    torque_coefficients: np.ndarray  #: (d + 1, 3) N m, Legendre polynomials over the arc
    scale_b: np.ndarray  #: (3,) 1, factor of the magnetic torque about each axis
    shift: float  #: s, by which all edges are later than in the arc


def dipole_history(edges, level, rod, time, current, per_current):
    """Breaks (s + 1,) s and dipole (s, 3) A m2 between them: excited rod by its edges, others held around each sample.

    The square wave has edges (m + 1,) s and levels (m,) mA of a rod; None and -1 without one. Samples (n,) s, (n, 3) mA
    cover the arc; per_current is (3,) A m2 mA-1.
    """
    others = [axis for axis in range(3) if axis != rod]
    middle = (time[1:] + time[:-1]) / 2
    changes = middle[np.any(np.diff(current[:, others], axis=0) != 0, axis=1)]
    low, high = (edges[0], edges[-1]) if edges is not None else (time[0], time[-1])
    inner = changes[(changes > low) & (changes < high)]
    breaks = np.unique(np.concatenate([[low, high], inner, edges if edges is not None else []]))
    centre = (breaks[1:] + breaks[:-1]) / 2
    held_current = current[np.searchsorted(middle, centre)].copy()
    if rod >= 0:
        held_current[:, rod] = level[np.clip(np.searchsorted(edges, centre) - 1, 0, level.size - 1)]
    return breaks, held_current * per_current


def torque_of(arc: Arc, solution: Solution) -> dynamics.Torque:
    """Torque of an arc for the integrator, with edge shift, torque scale and slow torque of a solution."""
    nodes = np.linspace(arc.origin, arc.stop + 1.0, 60)
    degree = solution.torque_coefficients.shape[0] - 1
    extra = polynomial(nodes, degree, arc.origin, arc.stop) @ solution.torque_coefficients
    return replace(
        arc,
        edges=arc.edges + solution.shift,
        scale_b=solution.scale_b,
        extra_time=nodes if degree >= 0 else None,
        extra_b=extra if degree >= 0 else None,
    )


def mean_dipole(arc: Arc, time: np.ndarray, shift: float, width: float) -> np.ndarray:
    """Dipole averaged over a sampling interval (s) centred on each epoch, (n, 3) A m2, all edges later by a shift (s).

    An edge between two samples is spread over it, so that the mean moves smoothly with it; 0 for momentary readings.
    """
    if not width:
        return dipole_at(arc, time, shift)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(np.diff(arc.edges)[:, None] * arc.dipole_b, axis=0)])
    edges = arc.edges + shift
    ends = [np.stack([np.interp(time + d, edges, c) for c in total.T], axis=1) for d in (-width / 2, width / 2)]
    return (ends[1] - ends[0]) / width


def dipole_at(arc: Arc, time: np.ndarray, shift: float) -> np.ndarray:
    """Dipole (n, 3) A m2 at epochs (n,) s, edges `shift` s later; on an edge that after it, zero outside the edges."""
    index = np.searchsorted(arc.edges + shift, time, side="right") - 1
    inside = (index >= 0) & (index < len(arc.dipole_b))
    return np.where(inside[:, None], arc.dipole_b[np.clip(index, 0, len(arc.dipole_b) - 1)], 0.0)


def large_edges(arc: Arc) -> np.ndarray:
    """Edges (k,) s of the square wave: jumps of the dipole above a quarter of the largest, none of control currents."""
    change = np.abs(np.diff(arc.dipole_b.sum(axis=1), prepend=0.0, append=0.0))
    return arc.edges[change > 0.25 * change.max()]


def shifts_between_samples(arc: Arc, time: np.ndarray, near: float, width: float) -> np.ndarray:
    """Shifts (q,) s near one (s), a representative of each set of shifts that leave the edges between the same samples.

    It is midway between those at which an edge meets one of the samples (n,) s; `width` (s) on either side is searched.
    """
    edges = large_edges(arc) + near
    distances = [time[slice(*np.searchsorted(time, [e - width, e + width]))] - e for e in edges]
    distances = np.unique(np.round(np.concatenate(distances), 4))
    return near + (distances[1:] + distances[:-1]) / 2 if distances.size else distances


def propagator(time: np.ndarray, transition: np.ndarray, breaks: np.ndarray) -> Callable[[Callable], np.ndarray]:
    """Function from small angular accelerations to the attitude response, by variation of constants.

    It takes `basis`, (m,) s -> (m, p, 3) rad s-2, smooth between the breaks (s), to (n, 3, p) rad at epochs (n,) s;
    transition (n, 6, 6) of angle and rate from the origin. Gauss-Legendre, four nodes in each interval without a jump.
    x(t) = Phi(t) int Phi(s)^-1 (0; b(s)) ds; CoM paper eqs. 21-25 with a source.
    """
    ends = np.unique(np.concatenate([[time[0]], breaks[(breaks > time[0]) & (breaks < time[-1])], time]))
    node, weight = np.polynomial.legendre.leggauss(4)
    span = np.diff(ends)
    at = ((ends[:-1, None] + ends[1:, None]) / 2 + span[:, None] / 2 * node).ravel()
    inverse = CubicSpline(time, np.linalg.inv(transition)[:, :, 3:])(at)
    weights, index = (span[:, None] / 2 * weight).reshape(-1, 1, 1) * inverse, np.searchsorted(ends, time)

    def response(basis):
        integrand = weights @ basis(at).transpose(0, 2, 1)
        pieces = integrand.reshape(-1, 4, *integrand.shape[1:]).sum(axis=1)
        total = np.concatenate([np.zeros((1, *pieces.shape[1:])), np.cumsum(pieces, axis=0)])
        return transition[:, :3] @ total[index]

    return response


def magnetic_acceleration(arc: Arc, shift: float, time: np.ndarray, field_b: np.ndarray, width: float) -> np.ndarray:
    """Angular acceleration (n, 3) rad s-2 by the torquers alone, catalogue scale: J^-1 (m x B), CoM paper eq. 18.

    The dipole is the mean over the sampling interval `width` (s); all edges later by `shift` (s).
    """
    return np.linalg.solve(arc.inertia, np.cross(mean_dipole(arc, time, shift, width), field_b).T).T


def updated(solution: Solution, step: dict[str, np.ndarray]) -> Solution:
    """Solution with a Gauss-Newton step {group of `_unknowns`: increments} added; groups not in it are held."""
    turned = frames.quaternion_product(solution.state.quaternion, frames.from_rotation_vector(step["angle"]))
    quaternion = turned / np.linalg.norm(turned)
    state = replace(solution.state, quaternion=quaternion, rate_b=solution.state.rate_b + step["rate"])
    slow = solution.torque_coefficients
    return Solution(
        state,
        slow + step["slow"].reshape(slow.shape) if "slow" in step else slow,
        solution.scale_b + step.get("torque", 0.0),
        solution.shift + float(step["shift"][0]) if "shift" in step else solution.shift,
    )


@dataclass(frozen=True)
class Window:
    """Torques and observations of one manoeuvre."""

    arc: Arc  #: torques
    rod: int  #: excited torquer, -1 if none
    time: np.ndarray  #: (n,) s, star-camera grid with the origin in front
    quaternion: np.ndarray  #: (n, 4)
    good: np.ndarray  #: (n,) bool, usable star-camera samples
    acc: slice  #: slice of the accelerometer samples inside the arc
    lower: float  #: s, begin of the telemetry interval of the first edge, relative to the edge of the arc
    upper: float  #: s, end of it, likewise


def windows(aligned: xr.Dataset, field: xr.Dataset, inertia, per_current, full: bool) -> list[Window]:
    """Window of every manoeuvre, or a single one at the beginning of a record without manoeuvre.

    A gap that forbids to use a manoeuvre leaves it without star camera. Products are "align" and "com_offset.field";
    inertia (3, 3) kg m2, per_current (3,) A m2 mA-1; full: with gravity-gradient torque.
    """
    arcs = []
    for i in range(aligned.sizes["manoeuvre"]):
        count = int(np.isfinite(aligned["edge_lower"].values[i]).sum())
        lower, upper = aligned["edge_lower"].values[i, :count], aligned["edge_upper"].values[i, :count]
        shift = np.round(np.median(np.diff(lower)) * 2) / 2 * np.arange(lower.size)
        edges = (np.max(lower - shift) + np.min(upper - shift)) / 2 + shift  # common, whole half periods apart
        edges = edges if aligned["regular"][i] else _single_edges(lower, upper, aligned)
        square_wave = int(aligned["rod"][i]), edges, aligned["level"].values[i, : count - 1]
        ends = float(lower[0] - edges[0]), float(upper[0] - edges[0])
        arcs.append((float(lower[0]), float(upper[-1]), square_wave, ends))
    if not arcs:
        start = float(aligned["window_start"][0])
        stop = min(start + SURVEY_S, float(aligned["time_sca"].values[-1]), float(aligned["time_orbit"].values[-1]))
        arcs = [(start, stop, (-1, None, np.zeros(0)), (0.0, 0.0))]
    mag_time, acc_time = aligned["time_mag"].values, aligned["time_acc"].values
    orbit_time = field["time_orbit"].values
    observed = []
    for (origin, stop, (rod, edges, level), ends), gap in zip(arcs, aligned["gap"].values, strict=True):
        near = (mag_time > origin - 2) & (mag_time < stop + 2) & (aligned["mag_flag"].values == 0)
        current = np.nan_to_num(aligned["current_b"].values[near])
        breaks, dipole_b = dipole_history(edges, level, rod, mag_time[near], current, per_current)
        nodes = (orbit_time > origin - 31) & (orbit_time < stop + 31)  # past a gap of 30 s, which is bridged
        origin, stop = (origin, stop) if gap else np.clip([origin, stop], *orbit_time[nodes][[0, -1]])
        arc = Arc(
            origin=origin,
            stop=stop,
            edges=breaks,
            dipole_b=dipole_b,
            field_time=orbit_time[nodes],
            field_i=field["field_i"].values[nodes],
            gradient_i=gravity.gradient_i(field["position_i"].values[nodes]) if full else None,
            inertia=np.asarray(inertia),
        )
        time, quaternion, good = _star_camera(aligned, origin, stop)
        acc = slice(*np.searchsorted(acc_time, [origin + 0.1, stop - 0.1]))
        observed.append(Window(arc, rod, time, quaternion, good & (gap == 0), acc, *ends))
    return observed


def _single_edges(lower, upper, aligned):
    """Edges (m + 1,) s of an irregular wave as the angular accelerometer shows them; mid interval where it shows none.

    With levels a before and b after, the integral over (s, e) is a (t - s) + b (e - t), which gives t.
    """
    time, angular = aligned["time_acc"].values, aligned["angular_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(angular).all(axis=1)
    time, angular = time[good], angular[good]
    edges = (lower + upper) / 2
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        before, after = (time > low - 2) & (time < low), (time > high) & (time < high + 2)
        inside = (time > low - 2) & (time < high + 2)
        if min(before.sum(), after.sum()) < 10 or np.any(np.diff(time[inside]) > 0.2):
            continue
        a, b = angular[before].mean(axis=0), angular[after].mean(axis=0)
        axis = int(np.argmax(np.abs(b - a)))
        step = np.diff(time[inside]).mean()
        start, stop = time[inside][0] - step / 2, time[inside][-1] + step / 2
        total = angular[inside, axis].sum() * step
        edge = (b[axis] * stop - a[axis] * start - total) / (b[axis] - a[axis]) if a[axis] != b[axis] else edges[k]
        edges[k] = np.clip(edge, low - 0.1, high + 0.1)
    return edges


def _star_camera(aligned, origin, stop):
    """Epochs (n,) s, quaternions (n, 4) and usable (n,) bool on the star camera's 1 Hz grid, the origin in front."""
    time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    good = (aligned["sca_flag"].values == 0) & np.isfinite(quaternion).all(axis=1)
    inside = good & (time > origin) & (time < stop)
    if inside.sum() < 8:
        return np.array([origin]), np.zeros((1, 4)), np.zeros(1, dtype=bool)
    phase = float(np.median((time[inside] - np.floor(time[inside][0]) + 0.5) % 1.0)) - 0.5
    phase = 0.0 if abs(phase) < 1e-3 else phase
    grid = np.arange(np.ceil(origin - phase + 1e-6), stop - phase, 1.0) + phase
    index = np.clip(np.searchsorted(time, grid - 1e-6), 0, time.size - 1)
    present = inside[index] & (np.abs(time[index] - grid) < 1e-3)
    values = frames.continuous(np.where(present[:, None], quaternion[index], quaternion[inside][0]))
    return np.append(origin, grid), np.concatenate([values[:1], values]), np.append(False, present)


def field_at(window: Window, fit, time: np.ndarray) -> np.ndarray:
    """IGRF field in the body (n, 3) T at epochs (n,) s, with the fitted attitude."""
    at = np.clip(time, window.arc.origin, None)
    quaternion, _, _ = dynamics.integrate(at, fit.solution.state, torque_of(window.arc, fit.solution), max_step=1.0)
    field_i = CubicSpline(window.arc.field_time, window.arc.field_i)(at)
    return np.matvec(frames.R_bi_from_quaternion(quaternion), field_i)


@dataclass(frozen=True)
class Choice:
    """Parameters to estimate beside start attitude and rate, with their priors, and limits of the fit."""

    torque_degree: int  #: degree of the Legendre polynomial of a slow torque, -1 for none
    scale_sigma: float  #: 1, prior sigma of the torque scale per axis; 0 holds it at the catalogue
    shift_sigma: float  #: s, prior sigma of the common edge shift; 0 holds it
    step_s: float  #: s, longest integration step
    iterations: int  #: largest number of Gauss-Newton steps


@dataclass(frozen=True)
class Fit:
    """Result of the attitude fit of one arc."""

    solution: Solution
    residual: np.ndarray  #: (n, 3) rad, star camera minus model, in the body
    covariance: np.ndarray  #: (p, p) of the unknowns `names`
    names: tuple[str, ...]  #: (p,)


def attitude(aligned: xr.Dataset, field: xr.Dataset, **settings) -> xr.Dataset:
    """Product "com_offset.attitude": fitted attitude of every manoeuvre at the epochs of star camera and accelerometer.

    Settings are those of the stage, with inertia and dipole_per_current.
    """
    full = settings["dynamics"] == "full"
    manoeuvres = windows(aligned, field, settings["inertia"], np.asarray(settings["dipole_per_current"]), full)
    choice = Choice(
        torque_degree=settings["torque_degree"] if full else -1,
        scale_sigma=settings["torque_scale_sigma"] if full else 0.0,
        shift_sigma=settings["edge_shift_sigma_s"] if full else 0.0,
        step_s=settings["integration_step_s"],
        iterations=settings["iteration_limit"],
    )
    if manoeuvres[0].rod < 0:  # nothing is calibrated: follow the controlled attitude, hold the torquers
        degree = max(choice.torque_degree, SURVEY_DEGREE)
        choice = replace(choice, torque_degree=degree, scale_sigma=0.0, shift_sigma=0.0)
    order = settings["attitude_noise_order"]
    fits, noise = _fit_all(manoeuvres, choice, order)
    filters = {name: settings[name] for name in ("lowpass_hz", "half_width_s", "step_s")}
    timings = _fit_timing(manoeuvres, fits, aligned, filters, settings["calibration_drift_degree"], order)
    fitted = [  # of the manoeuvres with enough attitudes
        (i, w, f, t) for i, (w, f, t) in enumerate(zip(manoeuvres, fits, timings, strict=True)) if f is not None
    ]
    motions = [_motion(w, f, t, aligned, noise, choice) for _, w, f, t in fitted]
    names = ("rate_b", "rate_dot_mtq_b", "rate_dot_sca_b", "magnetic_b", "smooth_b")
    empty = dict.fromkeys(names, np.zeros((0, 3)))
    empty |= {"time_acc": np.zeros(0), "gradient_b": np.zeros((0, 3, 3)), "sca_modes": np.zeros((6, 0, 3))}
    values = {
        name: np.concatenate([blank, *(one[name] for one in motions)], axis=int(name == "sca_modes"))
        for name, blank in empty.items()
    }
    residuals = [(w.time[w.good], f.residual[w.good], np.full(w.good.sum(), i)) for i, w, f, _ in fitted]
    values |= {
        "rod": [w.rod for w in manoeuvres],
        "gap": aligned["gap"].values,
        "acc_manoeuvre": np.repeat([i for i, *_ in fitted], [one["time_acc"].size for one in motions]),
        "time_sca": np.concatenate([np.zeros(0), *(time for time, _, _ in residuals)]),
        "sca_residual_b": np.concatenate([np.zeros((0, 3)), *(angle for _, angle, _ in residuals)]),
        "sca_manoeuvre": np.concatenate([np.zeros(0), *(index for _, _, index in residuals)]),
    }
    values |= _per_manoeuvre(len(manoeuvres), fitted) | _delays(fitted, aligned)
    return build(SCHEMAS["attitude"], values, title="Attitude of the manoeuvres, fitted to the star camera")


def _fit_all(manoeuvres, choice, order):
    """Fits of all windows (None with too few attitudes) and NoiseModel of each axis, iterated from white noise."""
    white = NoiseModel(np.zeros(0), np.array([3e-6**2]), 1.0)  # rad, only the start of the iteration
    noise, fits, previous = [white] * 3, [None] * len(manoeuvres), np.inf
    usable = [k for k, w in enumerate(manoeuvres) if w.good.sum() >= 8]
    order = min(order, max(FEW_ORDER, sum(int(manoeuvres[k].good.sum()) for k in usable) // SAMPLES_PER_ORDER))
    removed = sum(size for size, _ in _unknowns(choice).values()) * len(usable) // 3
    for _ in range(3 if usable else 0):
        for k in usable:
            fits[k] = fit_attitude(manoeuvres[k], noise, choice, None if fits[k] is None else fits[k].solution)
        residuals = [np.where(manoeuvres[k].good[:, None], fits[k].residual, np.nan) for k in usable]
        noise = [fit_noise([one[:, axis] for one in residuals], order, 1.0, removed=removed) for axis in range(3)]
        reflection = np.concatenate([one.reflection for one in noise])
        if np.abs(reflection - previous).max(initial=0.0) < SETTLED:
            break
        previous = reflection
    return fits, noise


def _fit_timing(manoeuvres, fits, aligned, filters, degree, order):
    """WaveFit of each manoeuvre in the angular acceleration, with noise from the residuals of a first fit; or None."""
    time, angular = aligned["time_acc"].values, aligned["angular_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(angular).all(axis=1)
    noise, timings = [NoiseModel(np.zeros(0), np.array([1e-16]), 0.5)] * 3, []  # white and alike, for the first fit
    for _ in range(2):
        inputs = [(time[w.acc], angular[w.acc], good[w.acc], noise, filters, degree) for w in manoeuvres]
        timings = [_timing(w, f, *one) for w, f, one in zip(manoeuvres, fits, inputs, strict=True)]
        residuals = [t.residual for t in timings if t is not None]
        if not residuals:
            break
        removed = len(residuals) * (degree + 2)
        noise = [fit_noise([r[:, a] for r in residuals], order, filters["step_s"], removed) for a in range(3)]
    return timings


def _timing(window, fit, time, angular, good, noise, filters, degree):
    """WaveFit of one manoeuvre in its angular acceleration (n, 3) rad s-2, None with too few samples or no signal."""
    if fit is None or good.sum() < 100 or np.ptp(angular[good], axis=0).max() == 0:
        return None
    arc, shift = window.arc, fit.solution.shift
    field_b, width = field_at(window, fit, time), float(np.median(np.diff(time)))
    ends = max(arc.edges[0] + shift, time[0]), min(arc.edges[-1] + shift, time[-1])
    operator = operator_for(time, good, *ends, **filters)
    if operator.valid.sum() < 40:
        return None

    def wave(later, momentary=False):
        return magnetic_acceleration(arc, shift + later, time, field_b, 0.0 if momentary else width)

    def between(later):
        return shifts_between_samples(arc, time, shift + later, width) - shift

    return fit_wave(np.nan_to_num(angular), wave, operator, noise, degree, between)


def _motion(window, fit, timing, aligned, noise, choice):
    """{variable of "com_offset.attitude": values at the accelerometer epochs} of one manoeuvre, its delay removed."""
    arc, rod, shift = window.arc, window.rod, fit.solution.shift
    time = aligned["time_acc"].values[window.acc]
    at = np.clip(time - (0.0 if timing is None else timing.shift), arc.origin, arc.field_time[-1])
    width = 0.0 if (timing is not None and timing.momentary) or time.size < 2 else float(np.median(np.diff(time)))
    motion = at, fit.solution.state, torque_of(arc, fit.solution)
    quaternion, rate, rate_dot = dynamics.integrate(*motion, max_step=choice.step_s)
    field_b = field_at(window, fit, at)
    # the momentary magnetic part at the fitted scale is taken out; its sampling mean at catalogue scale is added below
    torque = fit.solution.scale_b * np.cross(dipole_at(arc, at, shift), field_b)
    smooth = rate_dot - np.linalg.solve(arc.inertia, torque.T).T
    magnetic = magnetic_acceleration(arc, shift, at, field_b, width)
    gradient_b = np.zeros((time.size, 3, 3))
    if arc.gradient_i is not None:
        R_bi = frames.R_bi_from_quaternion(quaternion)
        gradient_b = R_bi @ CubicSpline(arc.field_time, arc.gradient_i)(at) @ np.swapaxes(R_bi, 1, 2)
    amplitude, root, parts = np.zeros((2, 3)), np.zeros((6, 6)), np.zeros((time.size, 2))
    if rod >= 0:
        amplitude, root = fit_star_camera_wave(window, fit, noise, max(choice.torque_degree, 0))
        parts = shape(arc, rod, shift, at, width)
    return {
        "time_acc": time,
        "rate_b": rate,
        "rate_dot_mtq_b": smooth + magnetic,
        "rate_dot_sca_b": smooth + parts @ amplitude,
        "sca_modes": np.einsum("nk,kam->mna", parts, root.reshape(2, 3, 6)),
        "magnetic_b": magnetic,
        "gradient_b": gradient_b,
        "smooth_b": smooth,
    }


def _per_manoeuvre(count, fitted):
    """{variable: (count, ...)}: shifts, scales, residual rms of fitted (index, Window, Fit, WaveFit); others NaN."""
    single, wide = ("sca_shift", "acc_shift"), ("torque_scale", "angular_scale")
    table = {f"{name}{tail}": np.full(count, np.nan) for name in single for tail in ("", "_sigma")}
    table |= {f"{name}{tail}": np.full((count, 3), np.nan) for name in wide for tail in ("", "_sigma")}
    table["residual_rms"] = np.full((count, 3), np.nan)
    for i, window, fit, timing in fitted:
        solution, sigma = fit.solution, dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True))
        table["sca_shift"][i], table["sca_shift_sigma"][i] = solution.shift, sigma.get("shift", np.nan)
        table["torque_scale"][i] = solution.scale_b
        table["torque_scale_sigma"][i] = [sigma.get(f"torque_{axis}", np.nan) for axis in "xyz"]
        table["residual_rms"][i] = np.sqrt(np.mean(fit.residual[window.good] ** 2, axis=0))
        if timing is not None:
            table["acc_shift"][i], table["acc_shift_sigma"][i] = solution.shift + timing.shift, timing.shift_sigma
            table["angular_scale"][i], table["angular_scale_sigma"][i] = timing.scale, timing.scale_sigma
    return table


def _delays(fitted, aligned):
    """{"acc_delay", "sca_delay" and "..._sigma": s} of tags against the torquer telemetry; NaN where undetermined."""
    rows = [
        (f.solution.shift, np.sqrt(f.covariance[-1, -1]), t.shift, t.shift_sigma, w.lower, w.upper)
        for _, w, f, t in fitted
        if t is not None and w.rod >= 0 and f.names[-1] == "shift"
    ]
    if not rows:
        return dict.fromkeys(("acc_delay", "acc_delay_sigma", "sca_delay", "sca_delay_sigma"), np.nan)
    sca, sca_sigma, relative, relative_sigma, lower, upper = np.array(rows).T
    sample = np.median(np.diff(aligned["time_acc"].values)) / np.sqrt(12)  # an edge is known to one sample
    acc, acc_sigma = delay_from_brackets(sca + relative, np.hypot(relative_sigma, sample), lower, upper)
    weight = 1 / (sca_sigma**2 + relative_sigma**2 + sample**2)
    return {
        "acc_delay": acc,
        "acc_delay_sigma": acc_sigma,
        "sca_delay": acc + float(np.sum(weight * -relative) / np.sum(weight)),
        "sca_delay_sigma": float(np.hypot(acc_sigma, 1 / np.sqrt(np.sum(weight)))),
    }


def _unknowns(choice: Choice) -> dict[str, tuple[int, float]]:
    """Unknowns in the order of the design columns, {group: (number of parameters, inverse prior variance of each)}."""
    groups = {"angle": (3, 0.0), "rate": (3, 0.0)}
    if choice.torque_degree >= 0:
        groups["slow"] = 3 * (choice.torque_degree + 1), LOOSE_TORQUE**-2.0
    groups |= {"torque": (3, choice.scale_sigma**-2.0)} if choice.scale_sigma > 0 else {}
    return groups | ({"shift": (1, choice.shift_sigma**-2.0)} if choice.shift_sigma > 0 else {})


def first_guess(arc: Arc, time: np.ndarray, quaternion: np.ndarray, degree: int) -> Solution:
    """Solution to start from: state by a quadratic through the first of attitudes (n, 4), torques of the catalogue."""
    near = slice(0, min(7, time.size))
    reference = quaternion[near][0]
    angle = frames.rotation_vector(frames.quaternion_product(frames.conjugate(reference), quaternion[near]))
    order = min(2, time[near].size - 1)
    fit = np.polynomial.polynomial.polyfit(time[near] - arc.origin, angle, order)
    start = frames.quaternion_product(reference, frames.from_rotation_vector(fit[0]))
    state = dynamics.State(arc.origin, start / np.linalg.norm(start), fit[1] if order else np.zeros(3))
    return Solution(state, np.zeros((degree + 1, 3)), np.ones(3), 0.0)


def fit_attitude(window: Window, noise: list[NoiseModel], choice: Choice, start: Solution | None = None) -> Fit:
    """Gauss-Newton on the three-parameter attitude error (CoM paper eqs. 19-30, errata C-5, C-6).

    The window holds evenly spaced attitudes from the origin on, continuous in sign; one noise model an axis. Without a
    Solution to start from, `first_guess` makes one.
    """
    arc, good, unknowns = window.arc, window.good, _unknowns(choice)
    solution = start or first_guess(arc, window.time[good], window.quaternion[good], choice.torque_degree)
    prior = np.repeat([weight for _, weight in unknowns.values()], [size for size, _ in unknowns.values()])
    previous, slow = np.inf, None
    for _ in range(max(choice.iterations, 1)):
        motion = window.time, solution.state, torque_of(arc, solution)
        modelled, _, _, sensitivity = dynamics.integrate_with_sensitivity(*motion, max_step=choice.step_s)
        residual = frames.attitude_error(window.quaternion, modelled)
        parts = dict(zip(("angle", "rate", "torque", "shift"), np.split(sensitivity[:, :3], [3, 6, 9], 2), strict=True))
        if slow is None and "slow" in unknowns:  # stays as it is
            slow = slow_torque_response(arc, window.time, sensitivity[:, :, :6], choice.torque_degree)
        design = np.concatenate([(parts | {"slow": slow})[name] for name in unknowns], axis=2)
        rows = whitened(noise, np.concatenate([residual[:, :, None], design], axis=2), good)
        y, A = rows[:, 0], rows[:, 1:]
        deviation = {  # distance of each unknown from its prior mean
            "slow": solution.torque_coefficients.ravel(),
            "torque": solution.scale_b - 1,
            "shift": np.array([solution.shift]),
        }
        from_prior = np.concatenate([deviation.get(name, np.zeros(size)) for name, (size, _) in unknowns.items()])
        normal = A.T @ A + np.diag(prior)
        right = A.T @ y - prior * from_prior
        scale = np.sqrt(np.diag(normal))
        step = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-14)[0] / scale
        cost = float(y @ y + prior @ from_prior**2)
        if abs(previous - cost) <= 1e-6 * max(cost, 1.0):
            break
        previous = cost
        ends = np.cumsum([size for size, _ in unknowns.values()])
        solution = updated(solution, dict(zip(unknowns, np.split(step, ends[:-1]), strict=True)))
    names = tuple(
        name if name == "shift" else f"{name}{k // 3 if name == 'slow' else ''}_{'xyz'[k % 3]}"
        for name, (size, _) in unknowns.items()
        for k in range(size)
    )
    return Fit(solution, residual, covariance(normal), names)


def slow_torque_response(arc: Arc, time, transition, degree: int) -> np.ndarray:
    """Attitude response (n, 3, 3 (degree + 1)) rad to Legendre torques of 1 N m, degree by degree, axis by axis."""
    inverse = np.linalg.inv(arc.inertia)

    def basis(at):
        return np.einsum("mk,ca->mkac", polynomial(at, degree, arc.origin, arc.stop), inverse).reshape(at.size, -1, 3)

    return propagator(time, transition, np.zeros(0))(basis)


@dataclass(frozen=True)
class WaveFit:
    """Square wave fitted to a measured angular acceleration."""

    shift: float  #: s, by which the wave appears later than assumed
    shift_sigma: float  #: s
    scale: np.ndarray  #: (3,) measured over modelled
    scale_sigma: np.ndarray  #: (3,) infinite for an axis that is not turned
    residual: np.ndarray  #: (n, 3) rad s-2, resampled, drift removed
    momentary: bool  #: readings are those at their epochs, not means over the sampling interval


def fit_wave(measured, wave, operator: Resampler, noise: list[NoiseModel], degree: int, between=None) -> WaveFit:
    """Scale per axis and common shift of a modelled wave in a measured angular acceleration (n, 3) rad s-2.

    The model is noise-free and stands on the right-hand side, so the scale has no attenuation. A wave of means over the
    sampling interval moves smoothly with its shift. One of momentary readings only changes where an edge meets a
    sample; with tags whose spacing is no part of the period some edges do so before others, and no smooth wave fits.

    wave : callable, shift s and whether readings are momentary -> (n, 3) rad s-2; the operator low-passes both sides
    noise, degree : noise model of each axis on the operator's grid; degree of the polynomial drift
    between : callable, shift s -> (q,) s near it, one for each distinct momentary wave; None for none of these
    """
    drift = polynomial(operator.time, degree, operator.time[0], operator.time[-1])
    y = operator(measured - measured[len(measured) // 2])

    def rows(columns):
        """Whitened columns (n, 3, q) of each axis, drift removed."""
        with_drift = [np.concatenate([columns[:, axis], drift], axis=1) for axis in range(3)]
        white = [whiten(noise[axis], with_drift[axis], operator.valid) for axis in range(3)]
        return [project_out(one[:, -drift.shape[1] :], one[:, : -drift.shape[1]]) for one in white]

    shift, scale = coarse_shift(y, operator(wave(0.0)), operator, drift, noise), np.ones(3)
    for _ in range(8):
        model = operator(wave(shift))
        slope = (operator(wave(shift + 0.01)) - operator(wave(shift - 0.01))) / 0.02
        by_axis = rows(np.stack([y, model, scale * slope], axis=2))
        observed = np.concatenate([one[:, 0] for one in by_axis])
        design = np.c_[block_diag(*(one[:, 1:2] for one in by_axis)), np.concatenate([one[:, 2] for one in by_axis])]
        inverse = stable_inverse(design.T @ design)
        unknown = inverse @ design.T @ observed
        scale = unknown[:3]
        shift = float(np.clip(shift + unknown[3], -4.0, 4.0))
        if abs(unknown[3]) < 1e-5:
            break
    size = np.linalg.norm(design[:, :3], axis=0)
    turned = size > 1e-6 * size.max(initial=1e-300)
    shifts_near = [] if between is None else between(shift)
    momentary_waves = [operator(wave(one, momentary=True)) for one in shifts_near]
    by_axis = rows(np.stack([y, operator(wave(shift)), *momentary_waves], axis=2))
    square = np.array([np.sum(one[:, 1:] ** 2, axis=0) for one in by_axis])
    product = np.array([one[:, 0] @ one[:, 1:] for one in by_axis])
    gain = np.sum(product[turned] ** 2 / square[turned], axis=0)
    gain[1:] += 2.0  # the smooth wave has its shift as one parameter more
    best = int(np.argmax(gain))
    if best:
        shift, model = float(shifts_near[best - 1]), momentary_waves[best - 1]
        scale = np.where(turned, product[:, best] / np.where(turned, square[:, best], 1.0), 1.0)
    sigma = np.sqrt(np.clip(np.diag(inverse), 0.0, None))
    residual = np.full_like(y, np.nan)
    residual[operator.valid] = project_out(drift[operator.valid], np.nan_to_num((y - model * scale)[operator.valid]))
    scale, scale_sigma = np.where(turned, scale, 1.0), np.where(turned, sigma[:3], np.inf)
    return WaveFit(shift, float(sigma[3]), scale, scale_sigma, residual, best > 0)


def coarse_shift(y, model, operator: Resampler, drift, noise: list[NoiseModel]) -> float:
    """Shift (s), up to 3 s in steps of the grid, of largest weighted cross-correlation of data and model (n, 3)."""
    valid = operator.valid
    weight = np.array([1 / n.variance[0] if n.variance[0] > 0 else 0.0 for n in noise])
    detrended = np.zeros((2, *y.shape))
    detrended[:, valid] = [project_out(drift[valid], series[valid]) for series in (y, model)]
    step = float(operator.time[1] - operator.time[0])
    count = int(3.0 / step)
    inner = weight * detrended[0][count : len(y) - count]
    agreement = sum(np.correlate(detrended[1][:, axis], inner[:, axis], "valid") for axis in range(3))
    return float((count - np.argmax(agreement)) * step)


def delay_from_brackets(shift, sigma, lower, upper) -> tuple[float, float]:
    """Delay of an instrument's tags against the torquer telemetry and its standard deviation, s.

    Telemetry at 2 Hz only brackets the first edge, (k,) s lower and upper. The edge shift seen by the instrument, (k,)
    s with sigma (k,) s, less the delay, has to lie there in every manoeuvre; mean and standard deviation are those of
    the posterior with a flat prior.
    """
    reach = (np.max(upper - lower) + np.max(np.abs(shift))) + 5 * float(np.max(sigma))
    grid = np.linspace(-reach, reach, 8001)
    true_shift = shift[:, None] - grid
    above, below = ((end[:, None] - true_shift) / sigma[:, None] for end in (upper, lower))
    inside = ndtr(above) - ndtr(below)
    log_tail = np.minimum(log_ndtr(above), log_ndtr(-below))
    log_likelihood = np.sum(np.where(inside > 1e-280, np.log(np.maximum(inside, 1e-300)), log_tail), axis=0)
    weight = np.exp(log_likelihood - log_likelihood.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2))


def shape(arc: Arc, rod: int, shift: float, time: np.ndarray, width: float) -> np.ndarray:
    """Unit square wave times (1, u), u from -1 to 1 over the arc, (n, 2), mean over a sampling interval `width` (s)."""
    amplitude = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    sign = mean_dipole(arc, time, shift, width)[:, rod] / (amplitude or 1.0)
    return sign[:, None] * polynomial(time, 1, arc.origin, arc.stop)


def fit_star_camera_wave(window: Window, fit: Fit, noise: list[NoiseModel], degree: int):
    """Amplitude of the wave about each body axis from the star camera alone, independent of the torquer's strength.

    Start attitude, rate and a slow torque of some degree are estimated along; timing and reference motion are those of
    the attitude fit. Returned are amplitude (2, 3) rad s-2, coefficients of `shape` about each axis, and root (6, 6),
    root root^T their covariance, ordered (shape, axis).
    """
    arc, rod, solution = window.arc, window.rod, fit.solution
    motion = window.time, solution.state, torque_of(arc, solution)
    _, _, _, sensitivity = dynamics.integrate_with_sensitivity(*motion, max_step=1.0)
    transition = sensitivity[:, :, :6]

    def basis(at):
        parts = shape(arc, rod, solution.shift, at, 0.0)
        return np.einsum("mk,ca->mkac", parts, np.eye(3)).reshape(at.size, 6, 3)

    columns = [transition[:, :3, :6], slow_torque_response(arc, window.time, transition, degree)]
    columns.append(propagator(window.time, transition, arc.edges + solution.shift)(basis))
    design = np.concatenate(columns, axis=2)
    # the fitted torque model, projected on the shape, is in the reference motion already
    time = np.linspace(arc.origin, arc.stop, 361)[1:-1]
    unit = np.zeros(3)
    unit[rod] = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    torque = solution.scale_b * np.cross(unit, field_at(window, fit, time))
    torque_line = np.linalg.lstsq(polynomial(time, 1, arc.origin, arc.stop), torque, rcond=None)[0]
    residual = fit.residual + design[:, :, -6:] @ np.linalg.solve(arc.inertia, torque_line.T).T.ravel()
    rows = whitened(noise, np.concatenate([residual[:, :, None], design], axis=2), window.good)
    inverse = stable_inverse(rows[:, 1:].T @ rows[:, 1:])
    unknown = inverse @ rows[:, 1:].T @ rows[:, 0]
    size, vectors = np.linalg.eigh(inverse[-6:, -6:])
    return unknown[-6:].reshape(2, 3), vectors * np.sqrt(np.clip(size, 0, None))
