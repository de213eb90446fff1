"""One manoeuvre: its observations, the torques that act, and the rotation of the satellite that follows from them."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations.align import SURVEY_S
from gravcal.estimation.least_squares import polynomial
from gravcal.physics import dynamics, frames, gravity


@dataclass(frozen=True)
class Arc:
    """What turns the satellite during one manoeuvre."""

    #: origin, stop: s, epoch of the state and end of the arc
    origin: float
    stop: float
    edges: np.ndarray  #: (m + 1,) s
    dipole_b: np.ndarray  #: (m, 3) A m2, constant between them
    field_time: np.ndarray  #: (k,) s
    field_i: np.ndarray  #: (k, 3) T
    gradient_i: np.ndarray | None  #: (k, 3, 3) s-2 or None
    inertia: np.ndarray  #: (3, 3) kg m2


@dataclass(frozen=True)
class Solution:
    """Motion of an arc."""

    state: dynamics.State  #: dynamics.State at the origin
    torque_coefficients: np.ndarray  #: (d + 1, 3) N m, Legendre polynomials over the arc
    scale_b: np.ndarray  #: (3,) factor of the magnetic torque
    shift: float  #: s, all edges later by


def dipole_history(edges, level, rod, time, current, per_current):
    """Piecewise-constant dipole: the excited rod between its edges, the others held round each sample.

    Parameters
    ----------
    edges : (m + 1,) s, of the square wave; None without one
    level : (m,) mA
    rod : 0, 1, 2, or -1 without a wave
    time : (n,) s; current : (n, 3) mA, samples that cover the arc
    per_current : (3,) A m2 mA-1

    Returns
    -------
    breaks : (s + 1,) s
    dipole_b : (s, 3) A m2
    """
    others = [axis for axis in range(3) if axis != rod]
    middle = (time[1:] + time[:-1]) / 2
    changes = middle[np.any(np.diff(current[:, others], axis=0) != 0, axis=1)]
    low, high = (edges[0], edges[-1]) if edges is not None else (time[0], time[-1])
    inner = changes[(changes > low) & (changes < high)]
    breaks = np.unique(np.concatenate([[low, high], inner, edges if edges is not None else []]))
    centre = (breaks[1:] + breaks[:-1]) / 2
    held = current[np.searchsorted(middle, centre)].copy()
    if rod >= 0:
        held[:, rod] = level[np.clip(np.searchsorted(edges, centre) - 1, 0, level.size - 1)]
    return breaks, held * per_current


def torque_of(arc: Arc, solution: Solution) -> dynamics.Torque:
    """Torque record of the integrator for an arc and a solution."""
    nodes = np.linspace(arc.origin, arc.stop + 1.0, 60)
    degree = solution.torque_coefficients.shape[0] - 1
    extra = polynomial(nodes, degree, arc.origin, arc.stop) @ solution.torque_coefficients
    return dynamics.Torque(
        inertia=arc.inertia,
        edges=arc.edges + solution.shift,
        dipole_b=arc.dipole_b,
        field_time=arc.field_time,
        field_i=arc.field_i,
        gradient_i=arc.gradient_i,
        scale_b=solution.scale_b,
        extra_time=nodes if degree >= 0 else None,
        extra_b=extra if degree >= 0 else None,
    )


def mean_dipole(arc: Arc, time: np.ndarray, shift: float, width: float) -> np.ndarray:
    """Dipole averaged over a sampling interval centred on each epoch, (n, 3) A m2.

    Parameters
    ----------
    arc : Arc
    time : (n,) s
    shift : s, all edges later by
    width : s, sampling interval; an edge between two samples is spread over it, so the mean moves smoothly with it; 0
        for momentary readings
    """
    if not width:
        return dipole_at(arc, time, shift)
    steps = np.diff(arc.edges)[:, None] * arc.dipole_b
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    edges = arc.edges + shift
    ends = [np.stack([np.interp(time + d, edges, c) for c in total.T], axis=1) for d in (-width / 2, width / 2)]
    return (ends[1] - ends[0]) / width


def dipole_at(arc: Arc, time: np.ndarray, shift: float) -> np.ndarray:
    """Dipole at epochs, (n, 3) A m2; on an edge the value after it, zero outside the edges."""
    index = np.searchsorted(arc.edges + shift, time, side="right") - 1
    inside = (index >= 0) & (index < len(arc.dipole_b))
    return np.where(inside[:, None], arc.dipole_b[np.clip(index, 0, len(arc.dipole_b) - 1)], 0.0)


def large_edges(arc: Arc) -> np.ndarray:
    """Edges (k,) s of the square wave, without changes of the control currents."""
    change = np.abs(np.diff(arc.dipole_b.sum(axis=1), prepend=0.0, append=0.0))
    return arc.edges[change > 0.25 * change.max()]


def shifts_between_samples(arc: Arc, time: np.ndarray, near: float, width: float) -> np.ndarray:
    """Shifts (q,) s about one, of which each leaves the edges between other samples: midway where they do not differ.

    Parameters
    ----------
    arc : Arc
    time : (n,) s, increasing
    near : s, later than the edges of the arc
    width : s, reach on either side
    """
    edges = large_edges(arc) + near
    met = [time[slice(*np.searchsorted(time, [e - width, e + width]))] - e for e in edges]
    met = np.unique(np.round(np.concatenate(met), 4))
    return near + (met[1:] + met[:-1]) / 2 if met.size else met


@dataclass(frozen=True)
class Propagator:
    """Attitude after small angular accelerations, by variation of constants, with its quadrature made once.

    x(t) = Phi(t) int Phi(s)^-1 (0; b(s)) ds; CoM paper eqs. 21-25 with a source.
    """

    transition: np.ndarray  #: (n, 6, 6) of angle and rate from the origin
    at: np.ndarray  #: (4 s,) s, nodes of the quadrature, four in each of s intervals without a jump
    weights: np.ndarray  #: (4 s, 6, 3) s, inverse of the transition at the nodes, times the weight of each
    index: np.ndarray  #: (n,) intervals before each epoch

    def __call__(self, basis) -> np.ndarray:
        """Response (n, 3, p) rad to `basis`, (m,) s -> (m, p, 3) rad s-2, smooth between the breaks."""
        integrand = self.weights @ basis(self.at).transpose(0, 2, 1)
        pieces = integrand.reshape(-1, 4, *integrand.shape[1:]).sum(axis=1)
        total = np.concatenate([np.zeros((1, *pieces.shape[1:])), np.cumsum(pieces, axis=0)])
        return self.transition[:, :3] @ total[self.index]


def propagator(time: np.ndarray, transition: np.ndarray, breaks: np.ndarray) -> Propagator:
    """Propagator to the epochs of a transition.

    Parameters
    ----------
    time : (n,) s, from the origin on
    transition : (n, 6, 6) of angle and rate from the origin
    breaks : (b,) s, where accelerations jump
    """
    ends = np.unique(np.concatenate([[time[0]], breaks[(breaks > time[0]) & (breaks < time[-1])], time]))
    node, weight = np.polynomial.legendre.leggauss(4)
    span = np.diff(ends)
    at = ((ends[:-1, None] + ends[1:, None]) / 2 + span[:, None] / 2 * node).ravel()
    inverse = CubicSpline(time, np.linalg.inv(transition)[:, :, 3:])(at)
    share = (span[:, None] / 2 * weight).reshape(-1, 1, 1)
    return Propagator(transition, at, share * inverse, np.searchsorted(ends, time))


def magnetic_acceleration(arc: Arc, shift: float, time: np.ndarray, field_b: np.ndarray, width: float) -> np.ndarray:
    """Angular acceleration (n, 3) rad s-2 by the torquers alone, catalogue scale: J^-1 (m x B), CoM paper eq. 18.

    The dipole is the mean over the sampling interval `width` (s); all edges later by `shift` (s).
    """
    torque = np.cross(mean_dipole(arc, time, shift, width), field_b)
    return np.linalg.solve(arc.inertia, torque.T).T


def evaluate(arc: Arc, solution: Solution, time: np.ndarray, step: float):
    """Quaternion (n, 4), rate (n, 3) rad s-1 and its derivative at epochs after the origin, fitted torque scale."""
    return dynamics.integrate(time, solution.state, torque_of(arc, solution), max_step=step)


def updated(solution: Solution, step: dict[str, np.ndarray]) -> Solution:
    """Solution with a Gauss-Newton step added: angle, rate, slow, torque, shift; what is missing is held."""
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
    """Observations of one manoeuvre."""

    arc: Arc  #: Arc
    rod: int  #: excited torquer, -1 if none
    time: np.ndarray  #: (n,) s, star-camera grid with the origin in front
    quaternion: np.ndarray  #: (n, 4)
    good: np.ndarray  #: (n,) bool
    acc: slice  #: slice of the accelerometer samples inside the arc
    #: lower, upper: s, interval of the first edge
    lower: float
    upper: float


def windows(aligned: xr.Dataset, field: xr.Dataset, inertia, per_current, full: bool) -> list[Window]:
    """Observations and torques of every manoeuvre, without a manoeuvre one arc at the beginning of the record.

    A gap that forbids to use a manoeuvre leaves it without star camera.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    inertia : (3, 3) kg m2
    per_current : (3,) A m2 mA-1
    full : bool, with gravity-gradient torque
    """
    found = []
    for i in range(aligned.sizes["manoeuvre"]):
        count = int(np.isfinite(aligned["edge_lower"].values[i]).sum())
        lower, upper = aligned["edge_lower"].values[i, :count], aligned["edge_upper"].values[i, :count]
        edges = _regular_edges(lower, upper) if aligned["regular"][i] else _single_edges(lower, upper, aligned)
        wave = int(aligned["rod"][i]), edges, aligned["level"].values[i, : count - 1]
        ends = float(lower[0] - edges[0]), float(upper[0] - edges[0])
        found.append((float(lower[0]), float(upper[-1]), wave, ends))
    if not found:
        start = float(aligned["window_start"][0])
        stop = min(start + SURVEY_S, float(aligned["time_sca"].values[-1]), float(aligned["time_orbit"].values[-1]))
        found = [(start, stop, (-1, None, np.zeros(0)), (0.0, 0.0))]
    mag_time, acc_time = aligned["time_mag"].values, aligned["time_acc"].values
    orbit_time = field["time_orbit"].values
    made = []
    for (origin, stop, (rod, edges, level), ends), gap in zip(found, aligned["gap"].values, strict=True):
        near = (mag_time > origin - 2) & (mag_time < stop + 2)
        current = np.nan_to_num(aligned["current_b"].values[near])
        breaks, dipole_b = dipole_history(edges, level, rod, mag_time[near], current, per_current)
        nodes = (orbit_time > origin - 6) & (orbit_time < stop + 6)
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
        made.append(Window(arc, rod, time, quaternion, good & (gap == 0), acc, *ends))
    return made


def _regular_edges(lower, upper):
    """Edges in the middle of their common interval, whole half periods apart."""
    half = np.round(np.median(np.diff(lower)) * 2) / 2
    shift = half * np.arange(lower.size)
    return (np.max(lower - shift) + np.min(upper - shift)) / 2 + shift


def _single_edges(lower, upper, aligned):
    """Each edge of an irregular wave where the angular accelerometer sees it; mid interval where it sees nothing.

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
    """Star-camera samples on their 1 Hz grid, wherever in the second it lies, the origin in front, gaps marked."""
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
    return (
        np.concatenate([[origin], grid]),
        np.concatenate([values[:1], values]),
        np.concatenate([[False], present]),
    )


def field_at(window: Window, fit, time: np.ndarray) -> np.ndarray:
    """Field in the body (n, 3) T along the fitted attitude."""
    at = np.clip(time, window.arc.origin, None)
    quaternion, _, _ = evaluate(window.arc, fit.solution, at, 1.0)
    field_i = CubicSpline(window.arc.field_time, window.arc.field_i)(at)
    return np.matvec(frames.R_bi_from_quaternion(quaternion), field_i)
