"""Torques on the satellite and the motion they cause.

The attitude error angle of every sensitivity is a small rotation in the body frame:
``quaternion_product(q, from_rotation_vector(angle_b))`` is the perturbed attitude.

The integration is compiled: Dormand-Prince 8(5,3) with dense output, fixed steps. State vector y: quaternion (4), rate
(3), then the (6, columns) sensitivity row by row; times relative to the epoch of the state, so that nothing is lost to
the size of GPS seconds. Its algebra is on tuples, which live in registers: vectors of 3, matrices of 9 by rows,
symmetric ones of 6 (xx, xy, xz, yy, yz, zz).
"""

from collections import namedtuple
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.integrate import DOP853
from scipy.interpolate import CubicSpline

from gravcal.physics import check_increasing, check_shape, refuse
from gravcal.physics.frames import vex

SENSITIVITY_PARAMETERS = (
    *(f"angle_{axis}" for axis in "xyz"),  # rad, attitude error at the epoch of the state, in b
    *(f"rate_{axis}" for axis in "xyz"),  # rad s-1, rate at the epoch of the state, in b
    *(f"scale_{axis}" for axis in "xyz"),  # 1, factor of the magnetic torque about each body axis
    "edge_shift",  # s, common shift of all dipole edges, positive is later
)


@dataclass(frozen=True)
class State:
    """Attitude and rate at one epoch."""

    time: float  #: GPS s
    quaternion: np.ndarray  #: (4,) scalar first, SCA1B meaning
    rate_b: np.ndarray  #: (3,) rad s-1, body with respect to inertial


@dataclass(frozen=True)
class Torque:
    """Torques on the satellite, and its inertia."""

    inertia: np.ndarray  #: (3, 3) kg m2, about the CoM, in b
    edges: np.ndarray  #: (m + 1,) GPS s, strictly increasing; the dipole is constant between them and zero outside
    dipole_b: np.ndarray  #: (m, 3) A m2, between edges[j] and edges[j + 1]
    field_time: np.ndarray  #: (k,) GPS s, k >= 4, covers the integration; about 1 Hz (a cubic spline in between)
    field_i: np.ndarray  #: (k, 3) T, magnetic field along the orbit
    #: (k, 3, 3) s-2, gravity gradient along the orbit at field_time; None for no gravity-gradient torque
    gradient_i: np.ndarray | None = None
    scale_b: np.ndarray = (1.0, 1.0, 1.0)  #: (3,) 1, factor of the magnetic torque about each body axis
    extra_time: np.ndarray | None = None  #: (j,) GPS s, non-decreasing, or None; an epoch given twice is a jump
    extra_b: np.ndarray | None = None  #: (j, 3) N m, linear between extra_time, zero outside


def gravity_gradient_torque(inertia, gradient_b):
    """Torque (..., 3) N m of the gravity gradient (..., 3, 3) s-2 on a rigid body of inertia (..., 3, 3) kg m2, in b.

    Notes
    -----
    t = vex(J G - G J), for a point mass 3 mu/r^3 e x (J e); S-GRS paper eq. 1 (equations.md, M2).
    """
    J, G = np.asarray(inertia, float), np.asarray(gradient_b, float)
    return vex(J @ G - G @ J)


def rate_derivative(inertia, rate_b, torque_b):
    """Angular acceleration (..., 3) rad s-2 of a rigid body from inertia kg m2, rate rad s-1 and torque N m, in b.

    Notes
    -----
    w' = J^-1 (t - w x J w); Remote Sens. 2022, 14, 4030, eq. 18.
    """
    J, w = np.asarray(inertia, float), np.asarray(rate_b, float)
    return np.linalg.solve(J, (torque_b - np.cross(w, np.matvec(J, w)))[..., None])[..., 0]


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
    sensitivity : (n, 6, 10) d(angle_b, rate_b) / d(SENSITIVITY_PARAMETERS)

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
    """Rows (n, 10 + 6 columns) of quaternion, rate, rate derivative and sensitivity at epochs (n,) GPS s."""
    time = check_increasing("integrate: time", time, strictly=False) - state.time
    out = np.empty((time.size, 10 + 6 * columns))
    if time.size == 0:
        return out
    if time[0] < 0:
        refuse("integrate", f"an epoch {-time[0]:.6f} s before the state", "none before it", "Start earlier.")
    if not max_step > 0:
        refuse("integrate", f"max_step {max_step} s", "a positive step", "Use about 2 s.")
    quaternion = check_shape("state.quaternion", state.quaternion, (4,))
    norm = np.linalg.norm(quaternion)
    if not abs(norm - 1) < 1e-6:
        refuse("state.quaternion", f"norm {norm:.9f}", "norm 1", "Normalise it.", norm=norm)
    rate = check_shape("state.rate_b", state.rate_b, (3,))
    start = np.concatenate([quaternion / norm, rate, np.eye(6, columns).ravel()])  # ones: sensitivity to the start
    propagate(_problem(torque, state.time, time[-1]), time, start, float(max_step), out)
    return out


def _problem(torque, origin, duration):
    """`Problem` of a Torque (A m2, N m) over `duration` s from an epoch, `origin` GPS s, which its times count from."""
    inertia = check_shape("torque.inertia", torque.inertia, (3, 3))
    edges = check_increasing("torque.edges", torque.edges) - origin
    dipole = check_shape("torque.dipole_b", torque.dipole_b, (max(edges.size - 1, 0), 3))
    extra_time, extra = np.empty(0), np.empty((0, 3))
    if torque.extra_time is not None:
        extra_time = check_increasing("torque.extra_time", torque.extra_time, strictly=False) - origin
        extra = check_shape("torque.extra_b", torque.extra_b, (extra_time.size, 3))
    inner = np.concatenate([edges, extra_time])
    breaks = np.unique(np.concatenate([[0.0, duration, duration + 1.0], inner[(inner > 0) & (inner < duration)]]))
    middle = (breaks[1:] + breaks[:-1]) / 2
    middle[-1] = duration  # what holds from the last epoch on
    padded = np.concatenate([np.zeros((1, 3)), dipole, np.zeros((1, 3))])
    value, slope = np.zeros((2, middle.size, 3))
    if extra_time.size > 1:  # value at the start and slope of the line that holds in the middle, zero outside
        left = np.clip(np.searchsorted(extra_time, middle, side="right") - 1, 0, extra_time.size - 2)
        span = extra_time[left + 1] - extra_time[left]
        inside = ((middle >= extra_time[0]) & (middle < extra_time[-1]) & (span > 0))[:, None]
        slope = np.where(inside, (extra[left + 1] - extra[left]) / np.where(span > 0, span, 1.0)[:, None], 0.0)
        value = np.where(inside, extra[left] + slope * (breaks[:-1] - extra_time[left])[:, None], 0.0)
    knots, spline = _polynomials(torque, origin, duration)
    segment = np.searchsorted(edges, middle, side="right") if edges.size > 1 else np.zeros(middle.size, int)
    scale = check_shape("torque.scale_b", torque.scale_b, (3,))
    known = inertia, np.linalg.inv(inertia), scale, torque.gradient_i is not None
    return Problem(breaks, padded[segment], value, slope, knots, spline, *known)


def _polynomials(torque, origin, duration):
    """Cubics in time of field and gradient: knots (k,), coefficients (k - 1, 4, 9)."""
    knots = check_increasing("torque.field_time", torque.field_time) - origin
    if knots.size < 4 or knots[0] > 1e-6 or knots[-1] < duration - 1e-6:
        coverage = f"{knots.size} samples from {knots[:1]} to {knots[-1:]} s after the state"
        expected = f"at least 4 that cover 0 to {duration:.3f} s"
        refuse("torque.field_time", coverage, expected, "Evaluate the field further.")
    values = np.zeros((knots.size, 9))
    values[:, :3] = check_shape("torque.field_i", torque.field_i, (knots.size, 3))
    if torque.gradient_i is not None:
        gradient = check_shape("torque.gradient_i", torque.gradient_i, (knots.size, 3, 3))
        values[:, 3:] = gradient[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    if not np.all(np.isfinite(values)):
        refuse("torque.field_i, gradient_i", "values that are not finite", "finite values", "Fill or cut the gap.")
    return knots, np.moveaxis(CubicSpline(knots, values).c, 1, 0).copy()


@njit(cache=True)
def as_tuple(matrix):
    """Nine numbers by rows of a matrix (3, 3)."""
    return (
        *(matrix[0, 0], matrix[0, 1], matrix[0, 2]),
        *(matrix[1, 0], matrix[1, 1], matrix[1, 2]),
        *(matrix[2, 0], matrix[2, 1], matrix[2, 2]),
    )


@njit(cache=True)
def cross(a, b):
    """Vector product a x b of vectors of 3."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def matvec(M, v):
    """M v, of nine numbers by rows and a vector of 3."""
    return (
        M[0] * v[0] + M[1] * v[1] + M[2] * v[2],
        M[3] * v[0] + M[4] * v[1] + M[5] * v[2],
        M[6] * v[0] + M[7] * v[1] + M[8] * v[2],
    )


@njit(cache=True)
def matmul(M, N):
    """M N, of nine numbers by rows each."""
    return (
        *(M[0] * N[0] + M[1] * N[3] + M[2] * N[6], M[0] * N[1] + M[1] * N[4] + M[2] * N[7]),
        *(M[0] * N[2] + M[1] * N[5] + M[2] * N[8], M[3] * N[0] + M[4] * N[3] + M[5] * N[6]),
        *(M[3] * N[1] + M[4] * N[4] + M[5] * N[7], M[3] * N[2] + M[4] * N[5] + M[5] * N[8]),
        *(M[6] * N[0] + M[7] * N[3] + M[8] * N[6], M[6] * N[1] + M[7] * N[4] + M[8] * N[7]),
        M[6] * N[2] + M[7] * N[5] + M[8] * N[8],
    )


@njit(cache=True)
def rotation(q):
    """R_bi by rows of a scalar-first quaternion; Remote Sens. 2022, 14, 4030, eq. 11."""
    s, x, y, z = q[0], q[1], q[2], q[3]
    return (
        *(s * s + x * x - y * y - z * z, 2 * (x * y + s * z), 2 * (x * z - s * y)),
        *(2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)),
        *(2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z),
    )


@njit(cache=True)
def similarity(R, S):
    """R S R^T of a symmetric S, six numbers."""
    a = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[0], R[1], R[2]))
    b = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[3], R[4], R[5]))
    c = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[6], R[7], R[8]))
    xx, xy, xz = matvec(R, a)
    _, yy, yz = matvec(R, b)
    return (xx, xy, xz, yy, yz, R[6] * c[0] + R[7] * c[1] + R[8] * c[2])


@njit(cache=True)
def gradient_torque(J, S):
    """Torque vex(J S - S J) of inertia J, nine by rows, in a symmetric gravity gradient S of six."""
    return (
        (J[6] * S[1] + J[7] * S[3] + J[8] * S[4]) - (J[3] * S[2] + J[4] * S[4] + J[5] * S[5]),
        (J[0] * S[2] + J[1] * S[4] + J[2] * S[5]) - (J[6] * S[0] + J[7] * S[1] + J[8] * S[2]),
        (J[3] * S[0] + J[4] * S[1] + J[5] * S[2]) - (J[0] * S[1] + J[1] * S[3] + J[2] * S[4]),
    )


@njit(cache=True)
def gradient_torque_by_angle(J, S):
    """Derivative of gradient_torque for a small turn of the body: G changes by G [a x] - [a x] G; nine by rows."""
    xx, xy, xz, yy, yz, zz = S
    a = gradient_torque(J, (0.0, xz, -xy, 2 * yz, zz - yy, -2 * yz))
    b = gradient_torque(J, (-2 * xz, -yz, xx - zz, 0.0, xy, 2 * xz))
    c = gradient_torque(J, (2 * xy, yy - xx, yz, -2 * xy, -xz, 0.0))
    return (a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2])


# breaks (p + 1,): steps end here; dipole, extra, slope (p, 3): torque data from one break to the next
# knots (k,), spline (k - 1, 4, 9): cubic in time of field_i and of six elements of gradient_i; gradient: use it or not
# inertia and its inverse (3, 3), scale (3,)
Problem = namedtuple("Problem", "breaks dipole extra slope knots spline inertia inverse scale gradient")

STAGES = 16  # twelve of the step, the derivative at its end, three more for the dense output
A = np.zeros((STAGES, STAGES))
A[:12, :12], A[12, :12], A[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA
C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
D = np.ascontiguousarray(DOP853.D)


@njit(cache=True)
def propagate(problem, time, y, max_step, out):
    """Fill out (n, 10 + 6 columns): quaternion, rate, rate derivative, sensitivity at each time; y is used up."""
    scratch = np.zeros((STAGES, y.size)), np.empty((7, y.size)), np.empty(y.size)
    K, F, end = scratch
    done = 0
    for piece in range(problem.breaks.size - 1):
        start, stop = problem.breaks[piece], problem.breaks[piece + 1]
        if piece > 0:
            _shift_edge(problem, piece, start, y)
        steps = max(1, int(np.ceil((stop - start) / max_step - 1e-9)))
        h = (stop - start) / steps
        _derivative(problem, piece, start, y, K[0])
        for step in range(steps):
            at = (piece, start + step * h, h)  # interval between breaks, time s, step s
            while done < time.size and time[done] <= at[1]:
                _record(problem, at, y, end, out[done])
                done += 1
            if done == time.size:
                return
            _step(problem, at, y, scratch, 1, 13)
            t_next = stop if step == steps - 1 else start + (step + 1) * h
            if time[done] < t_next:
                _dense(problem, at, y, scratch)
                while done < time.size and time[done] < t_next:
                    _interpolate((time[done] - at[1]) / h, y, F, end)
                    _record(problem, (piece, time[done], h), end, K[13], out[done])
                    done += 1
                y += F[0]
            else:
                y[:] = end
            normalise(y)
            K[0] = K[12]


@njit(cache=True)
def _step(problem, at, y, scratch, first, last):
    """Fill derivatives K of stages `first` to `last` - 1 of a step; work becomes the state at the last of these."""
    K, _, work = scratch
    piece, t, h = at
    for s in range(first, last):
        _combine(A[s, :s], h, y, K, work)
        _derivative(problem, piece, t + C[s] * h, work, K[s])


@njit(cache=True)
def _dense(problem, at, y, scratch):
    """Fill coefficients F of the seventh-order polynomial inside the step whose end is in work."""
    K, F, work = scratch
    piece, t, h = at
    for i in range(y.size):
        F[0, i] = work[i] - y[i]
        F[1, i] = h * K[0, i] - F[0, i]
        F[2, i] = 2 * F[0, i] - h * (K[12, i] + K[0, i])
    _step(problem, at, y, scratch, 13, STAGES)
    nothing = np.zeros(y.size)
    for row in range(4):
        _combine(D[row], h, nothing, K, F[3 + row])


@njit(cache=True, fastmath={"contract"})
def _combine(weights, h, y, K, out):
    """Sum out = y + h sum weights K, rows of weight zero left out."""
    for i in range(y.size):
        out[i] = y[i]
    for s in range(weights.size):
        if weights[s] != 0.0:
            factor = h * weights[s]
            for i in range(y.size):
                out[i] += factor * K[s, i]


@njit(cache=True, fastmath={"contract"})
def _interpolate(x, y, F, work):  # fills work with the state at the share x of a step from y
    for i in range(y.size):
        value = ((F[6, i] * x + F[5, i]) * (1 - x) + F[4, i]) * x + F[3, i]
        work[i] = (((value * (1 - x) + F[2, i]) * x + F[1, i]) * (1 - x) + F[0, i]) * x + y[i]


@njit(cache=True)
def normalise(y):
    """Make the quaternion that a state (7,) begins with one of unit length."""
    norm = np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
    for i in range(4):
        y[i] /= norm


@njit(cache=True)
def _record(problem, at, y, work, row):
    """Write a row of output from a state y at `at` (interval, time s, step s); work is scratch."""
    _derivative(problem, at[0], at[1], y, work)
    row[:7] = y[:7]
    normalise(row)
    row[7:10] = work[4:7]
    row[10:] = y[7:]


@njit(cache=True)
def _shift_edge(problem, piece, t, y):
    """Add to the last sensitivity: J^-1 (torque before - torque after) for each second the edge comes later."""
    columns = (y.size - 7) // 6
    if columns == 0:
        return
    at, x = _locate(problem.knots, t)
    B = matvec(rotation(y), _field(problem.spline[at], x))
    before, after = problem.dipole[piece - 1], problem.dipole[piece]
    torque = cross((before[0] - after[0], before[1] - after[1], before[2] - after[2]), B)
    scaled = (problem.scale[0] * torque[0], problem.scale[1] * torque[1], problem.scale[2] * torque[2])
    impulse = matvec(as_tuple(problem.inverse), scaled)
    for i in range(3):
        y[7 + (3 + i) * columns + columns - 1] += impulse[i]


@njit(cache=True)
def _derivative(problem, piece, t, y, dy):
    """Write the derivative dy of a state y at t s: kinematics, Euler's equation, variational equations."""
    J, R, w = as_tuple(problem.inertia), rotation(y), (y[4], y[5], y[6])
    at, x = _locate(problem.knots, t)
    B = matvec(R, _field(problem.spline[at], x))
    G = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if problem.gradient:
        G = similarity(R, _gradient(problem.spline[at], x))
    magnetic, momentum = cross(problem.dipole[piece], B), matvec(J, w)
    gravity, gyroscopic = gradient_torque(J, G), cross(w, momentum)
    other = (gravity[0] - gyroscopic[0], gravity[1] - gyroscopic[1], gravity[2] - gyroscopic[2])
    s, e, d, dt = problem.scale, problem.extra[piece], problem.slope[piece], t - problem.breaks[piece]
    torque = (
        s[0] * magnetic[0] + other[0] + e[0] + dt * d[0],
        s[1] * magnetic[1] + other[1] + e[1] + dt * d[1],
        s[2] * magnetic[2] + other[2] + e[2] + dt * d[2],
    )
    dy[0] = -0.5 * (y[1] * w[0] + y[2] * w[1] + y[3] * w[2])
    dy[1] = 0.5 * (y[0] * w[0] + y[2] * w[2] - y[3] * w[1])
    dy[2] = 0.5 * (y[0] * w[1] + y[3] * w[0] - y[1] * w[2])
    dy[3] = 0.5 * (y[0] * w[2] + y[1] * w[1] - y[2] * w[0])
    dy[4], dy[5], dy[6] = matvec(as_tuple(problem.inverse), torque)
    if y.size > 7:
        by_angle = _torque_by_angle(problem.dipole[piece], problem.scale, B, gradient_torque_by_angle(J, G))
        _variation(as_tuple(problem.inverse), by_angle, _torque_by_rate(J, w, momentum), y, dy)
        for row in range(3):  # columns 6 to 8: scale of the magnetic torque
            for axis in range(3):
                dy[13 + (3 + row) * ((y.size - 7) // 6) + axis] += problem.inverse[row, axis] * magnetic[axis]


@njit(cache=True)
def _torque_by_angle(m, s, B, gravity):
    """Torque by error angle, nine by rows: scale [m x][B x] = scale (B m^T - m.B 1), and that of gravity."""
    dot = m[0] * B[0] + m[1] * B[1] + m[2] * B[2]
    return (
        *(s[0] * (B[0] * m[0] - dot) + gravity[0], s[0] * B[0] * m[1] + gravity[1], s[0] * B[0] * m[2] + gravity[2]),
        *(s[1] * B[1] * m[0] + gravity[3], s[1] * (B[1] * m[1] - dot) + gravity[4], s[1] * B[1] * m[2] + gravity[5]),
        *(s[2] * B[2] * m[0] + gravity[6], s[2] * B[2] * m[1] + gravity[7], s[2] * (B[2] * m[2] - dot) + gravity[8]),
    )


@njit(cache=True)
def _torque_by_rate(J, w, H):
    """Torque by rate, nine by rows: [J w x] - [w x] J; Remote Sens. 2022, 14, 4030, eq. 27 with opposite sign."""
    wJ = matmul((0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0), J)
    return (
        *(-wJ[0], -H[2] - wJ[1], H[1] - wJ[2]),
        *(H[2] - wJ[3], -wJ[4], -H[0] - wJ[5]),
        *(-H[1] - wJ[6], H[0] - wJ[7], -wJ[8]),
    )


@njit(cache=True, fastmath={"contract"})
def _variation(inverse, by_angle, by_rate, y, dy):
    """Write the homogeneous part of dy: angle' = rate - w x angle, rate' = J^-1 (by_angle angle + by_rate rate)."""
    n = (y.size - 7) // 6
    wx, wy, wz = y[4], y[5], y[6]
    N, Q = matmul(inverse, by_angle), matmul(inverse, by_rate)
    for c in range(7, 7 + n):
        a, b, d, e, f, g = y[c], y[c + n], y[c + 2 * n], y[c + 3 * n], y[c + 4 * n], y[c + 5 * n]
        dy[c] = e + wz * b - wy * d
        dy[c + n] = f + wx * d - wz * a
        dy[c + 2 * n] = g + wy * a - wx * b
        dy[c + 3 * n] = N[0] * a + N[1] * b + N[2] * d + Q[0] * e + Q[1] * f + Q[2] * g
        dy[c + 4 * n] = N[3] * a + N[4] * b + N[5] * d + Q[3] * e + Q[4] * f + Q[5] * g
        dy[c + 5 * n] = N[6] * a + N[7] * b + N[8] * d + Q[6] * e + Q[7] * f + Q[8] * g


@njit(cache=True)
def _locate(knots, t):
    """Interval of the spline that holds t (the first or last one beyond the ends), and the time since its start."""
    last = knots.size - 2
    at = int((t - knots[0]) / (knots[last + 1] - knots[0]) * (last + 1))
    at = min(max(at, 0), last)
    while at > 0 and t < knots[at]:
        at -= 1
    while at < last and t >= knots[at + 1]:
        at += 1
    return at, t - knots[at]


@njit(cache=True)
def _field(c, x):  # T, by coefficients (4, 9) of an interval at x s from its start
    return (_cubic(c, 0, x), _cubic(c, 1, x), _cubic(c, 2, x))


@njit(cache=True)
def _gradient(c, x):  # s-2, six elements, likewise
    return (_cubic(c, 3, x), _cubic(c, 4, x), _cubic(c, 5, x), _cubic(c, 6, x), _cubic(c, 7, x), _cubic(c, 8, x))


@njit(cache=True)
def _cubic(c, column, x):  # value of one column at x
    return ((c[0, column] * x + c[1, column]) * x + c[2, column]) * x + c[3, column]
