"""Torques on the satellite and the motion they cause.

The attitude error angle of every sensitivity is a small rotation in the body frame:
``quaternion_product(q, from_rotation_vector(angle_b))`` is the perturbed attitude.
"""

from dataclasses import dataclass

import numpy as np

from gravcal.physics.frames import vex
from gravcal.physics.shapes import check_increasing, check_shape, refuse

SENSITIVITY_PARAMETERS = (
    *(f"angle_{axis}" for axis in "xyz"),  # rad, attitude error at the epoch of the state, in b
    *(f"rate_{axis}" for axis in "xyz"),  # rad s-1, rate at the epoch of the state, in b
    *(f"torque_{axis}" for axis in "xyz"),  # N m, constant torque in b
    *(f"scale_{axis}" for axis in "xyz"),  # 1, factor of the magnetic torque about each body axis
    "edge_shift",  # s, common shift of all dipole edges, positive is later
)


@dataclass(frozen=True)
class State:
    """Attitude and rate at one epoch.

    time : float, GPS s
    quaternion : (4,) scalar first, SCA1B meaning
    rate_b : (3,) rad s-1, body with respect to inertial
    """

    time: float
    quaternion: np.ndarray
    rate_b: np.ndarray


@dataclass(frozen=True)
class Torque:
    """Everything that turns the satellite.

    inertia : (3, 3) kg m2, about the CoM, in b
    edges : (m + 1,) GPS s, strictly increasing; the dipole is constant between them and zero outside
    dipole_b : (m, 3) A m2, between edges[j] and edges[j + 1]
    field_time : (k,) GPS s, k >= 4, covers the integration; about 1 Hz (local cubics in between)
    field_i : (k, 3) T, magnetic field along the orbit
    gradient_i : (k, 3, 3) s-2, gravity gradient along the orbit at field_time; None for no gravity-gradient torque
    constant_b : (3,) N m
    scale_b : (3,) 1, factor of the magnetic torque about each body axis
    extra_time : (j,) GPS s, non-decreasing, or None; an epoch given twice is a jump
    extra_b : (j, 3) N m, linear between extra_time, zero outside
    """

    inertia: np.ndarray
    edges: np.ndarray
    dipole_b: np.ndarray
    field_time: np.ndarray
    field_i: np.ndarray
    gradient_i: np.ndarray | None = None
    constant_b: np.ndarray = (0.0, 0.0, 0.0)
    scale_b: np.ndarray = (1.0, 1.0, 1.0)
    extra_time: np.ndarray | None = None
    extra_b: np.ndarray | None = None


def magnetic_torque(dipole_b, field_b):
    """Torque on a magnetic dipole.

    Parameters
    ----------
    dipole_b : (..., 3) A m2
    field_b : (..., 3) T

    Returns
    -------
    torque_b : (..., 3) N m

    Notes
    -----
    t = m x B; Remote Sens. 2022, 14, 4030, eq. 18, first term.
    """
    return np.cross(dipole_b, field_b)


def gravity_gradient_torque(inertia, gradient_b):
    """Torque of the gravity gradient on a rigid body.

    Parameters
    ----------
    inertia : (..., 3, 3) kg m2, about the CoM, in b
    gradient_b : (..., 3, 3) s-2, dg/dr, symmetric

    Returns
    -------
    torque_b : (..., 3) N m

    Notes
    -----
    t = vex(J G - G J), for a point mass 3 mu/r^3 e x (J e); S-GRS paper eq. 1 (equations.md, M2).
    """
    J, G = np.asarray(inertia, float), np.asarray(gradient_b, float)
    return vex(J @ G - G @ J)


def rate_derivative(inertia, rate_b, torque_b):
    """Angular acceleration of a rigid body.

    Parameters
    ----------
    inertia : (..., 3, 3) kg m2
    rate_b : (..., 3) rad s-1
    torque_b : (..., 3) N m

    Returns
    -------
    rate_dot_b : (..., 3) rad s-2

    Notes
    -----
    w' = J^-1 (t - w x J w); Remote Sens. 2022, 14, 4030, eq. 18.
    """
    J, w = np.asarray(inertia, float), np.asarray(rate_b, float)
    gyroscopic = np.cross(w, np.matvec(J, w))
    return np.linalg.solve(J, (torque_b - gyroscopic)[..., None])[..., 0]


def integrate(time, state, torque, max_step=2.0):
    """Attitude motion from a state under given torques.

    Parameters
    ----------
    time : (n,) GPS s, non-decreasing, none before state.time
    state : State
    torque : Torque
    max_step : float s, longest step; steps also end at every edge and every epoch of extra_time. At 1e-3 rad/s the
        error is below rounding (6e-14 rad in 180 s) up to 6 s

    Returns
    -------
    quaternion : (n, 4) scalar first
    rate_b : (n, 3) rad s-1
    rate_dot_b : (n, 3) rad s-2; on an edge the value after it

    Raises
    ------
    GravcalError : shapes, order or coverage of the inputs

    Notes
    -----
    dq/dt = 1/2 q (0, w), J w' + w x J w = m x B + vex(J G - G J) + ...; Remote Sens. 2022, 14, 4030, eqs. 16-18
    (scalar last in print) with the gravity gradient of equations.md M2. Dormand-Prince 8(5,3) at fixed step,
    dense output of seventh order.
    """
    motion = _propagate(time, state, torque, max_step, 0)
    return motion[:, :4], motion[:, 4:7], motion[:, 7:10]


def integrate_with_sensitivity(time, state, torque, max_step=2.0):
    """Attitude motion and its derivatives with respect to state and torque.

    Parameters
    ----------
    time, state, torque, max_step : as for integrate

    Returns
    -------
    quaternion : (n, 4) scalar first
    rate_b : (n, 3) rad s-1
    rate_dot_b : (n, 3) rad s-2
    sensitivity : (n, 6, 13) d(angle_b, rate_b) / d(SENSITIVITY_PARAMETERS)

    Notes
    -----
    dPhi/dt = A Phi; Remote Sens. 2022, 14, 4030, eq. 25 with the error angle in place of four quaternion elements, and
    the turning of B and G with the attitude kept in A (printed eq. 26 neglects it). An edge moved by d leaves the
    torque before it on for d longer: an impulse J^-1 (t_before - t_after) d.
    """
    columns = len(SENSITIVITY_PARAMETERS)
    motion = _propagate(time, state, torque, max_step, columns)
    return motion[:, :4], motion[:, 4:7], motion[:, 7:10], motion[:, 10:].reshape(-1, 6, columns)


def _propagate(time, state, torque, max_step, columns):
    """Rows of quaternion, rate, rate derivative and sensitivity at each epoch."""
    from gravcal.physics import attitude_kernel  # its tables are those of scipy.integrate: a third of a second to load

    time = check_increasing("integrate: time", time, strictly=False) - state.time
    out = np.empty((time.size, 10 + 6 * columns))
    if time.size == 0:
        return out
    if time[0] < 0:
        refuse("integrate", f"an epoch {-time[0]:.6f} s before the state", "none before it", "Start earlier.")
    if not max_step > 0:
        refuse("integrate", f"max_step {max_step} s", "a positive step", "Use about 2 s.")
    attitude_kernel.propagate(
        _problem(torque, state.time, time[-1]), time, _start(state, columns), float(max_step), out
    )
    return out


def _start(state, columns):
    """State vector of the kernel: unit quaternion, rate, and ones where the sensitivity to the start begins."""
    quaternion = check_shape("state.quaternion", state.quaternion, (4,))
    norm = np.linalg.norm(quaternion)
    if not abs(norm - 1) < 1e-6:
        refuse("state.quaternion", f"norm {norm:.9f}", "norm 1", "Normalise it.", norm=norm)
    rate = check_shape("state.rate_b", state.rate_b, (3,))
    return np.concatenate([quaternion / norm, rate, np.eye(6, columns).ravel()])


def _problem(torque, origin, duration):
    """Inputs of the kernel, in seconds since the epoch of the state."""
    from gravcal.physics import attitude_kernel

    inertia = check_shape("torque.inertia", torque.inertia, (3, 3))
    edges = check_increasing("torque.edges", torque.edges) - origin
    dipole = check_shape("torque.dipole_b", torque.dipole_b, (max(edges.size - 1, 0), 3))
    extra_time, extra = _extra(torque, origin)
    inner = np.concatenate([edges, extra_time])
    breaks = np.unique(np.concatenate([[0.0, duration, duration + 1.0], inner[(inner > 0) & (inner < duration)]]))
    middle = (breaks[1:] + breaks[:-1]) / 2
    middle[-1] = duration  # what holds from the last epoch on
    padded = np.concatenate([np.zeros((1, 3)), dipole, np.zeros((1, 3))])
    value, slope = _piecewise_linear(extra_time, extra, breaks[:-1], middle)
    knots, spline = _polynomials(torque, origin, duration)
    return attitude_kernel.Problem(
        *(breaks, padded[_after(edges, middle)], value, slope, knots, spline, inertia, np.linalg.inv(inertia)),
        *(
            check_shape("torque.constant_b", torque.constant_b, (3,)),
            check_shape("torque.scale_b", torque.scale_b, (3,)),
        ),
        torque.gradient_i is not None,
    )


def _after(edges, at):
    """Index into a padded list of segments: 0 before the first edge, the last one from the last edge on."""
    return np.searchsorted(edges, at, side="right") if edges.size > 1 else np.zeros(at.size, int)


def _extra(torque, origin):
    if torque.extra_time is None:
        return np.empty(0), np.empty((0, 3))
    time = check_increasing("torque.extra_time", torque.extra_time, strictly=False) - origin
    return time, check_shape("torque.extra_b", torque.extra_b, (time.size, 3))


def _piecewise_linear(time, values, start, middle):
    """Value at start and slope of the line that holds at middle; zero outside time."""
    if time.size < 2:
        return np.zeros((start.size, 3)), np.zeros((start.size, 3))
    left = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, time.size - 2)
    span = time[left + 1] - time[left]
    inside = (middle >= time[0]) & (middle < time[-1]) & (span > 0)
    slope = (values[left + 1] - values[left]) / np.where(span > 0, span, 1.0)[:, None]
    value = values[left] + slope * (start - time[left])[:, None]
    return np.where(inside[:, None], value, 0.0), np.where(inside[:, None], slope, 0.0)


def _polynomials(torque, origin, duration):
    """Cubics in time of field and gradient: knots (k,), coefficients (k - 1, 4, 9)."""
    knots = check_increasing("torque.field_time", torque.field_time) - origin
    if knots.size < 4 or knots[0] > 1e-6 or knots[-1] < duration - 1e-6:
        found = f"{knots.size} samples from {knots[:1]} to {knots[-1:]} s after the state"
        refuse(
            "torque.field_time", found, f"at least 4 that cover 0 to {duration:.3f} s", "Evaluate the field further."
        )
    values = np.zeros((knots.size, 9))
    values[:, :3] = check_shape("torque.field_i", torque.field_i, (knots.size, 3))
    if torque.gradient_i is not None:
        gradient = check_shape("torque.gradient_i", torque.gradient_i, (knots.size, 3, 3))
        values[:, 3:] = gradient[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    if not np.all(np.isfinite(values)):
        refuse("torque.field_i, gradient_i", "values that are not finite", "finite values", "Fill or cut the gap.")
    return knots, _cubics(knots, values)


def _cubics(t, values):
    """Cubic (k - 1, 4, columns) through the four samples round each interval, in powers of the time since its start."""
    first = np.diff(values, axis=0) / np.diff(t)[:, None]
    second = np.diff(first, axis=0) / (t[2:] - t[:-2])[:, None]
    third = np.diff(second, axis=0) / (t[3:] - t[:-3])[:, None]
    a = np.clip(np.arange(t.size - 1) - 1, 0, t.size - 4)
    d0, d1, d2 = (t[:-1, None] - t[a + lag, None] for lag in range(3))
    linear = first[a] + second[a] * (d0 + d1) + third[a] * (d0 * d1 + d0 * d2 + d1 * d2)
    return np.stack([third[a], second[a] + third[a] * (d0 + d1 + d2), linear, values[:-1]], axis=1)
