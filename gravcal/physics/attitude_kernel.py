"""Compiled integration of attitude, rate and sensitivities: Dormand-Prince 8(5,3) with dense output, fixed steps.

State vector y: quaternion (4), rate (3), then the (6, columns) sensitivity row by row. Times are relative to the epoch
of the state, so that nothing is lost to the size of GPS seconds.
"""

from collections import namedtuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from gravcal.physics.small_algebra import (
    as_tuple,
    cross,
    gradient_torque,
    gradient_torque_by_angle,
    matmul,
    matvec,
    rotation,
    similarity,
)

# breaks (p + 1,): steps end here; dipole, extra, slope (p, 3): torque data from one break to the next
# knots (k,), spline (k - 1, 4, 9): cubic in time of field_i and of six elements of gradient_i; gradient: use it or not
# inertia and its inverse (3, 3), constant and scale (3,)
Problem = namedtuple("Problem", "breaks dipole extra slope knots spline inertia inverse constant scale gradient")

STAGES = 16  # twelve of the step, the derivative at its end, three more for the dense output
A = np.zeros((STAGES, STAGES))
A[:12, :12], A[12, :12], A[13:] = DOP853.A, DOP853.B, DOP853.A_EXTRA
C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
D = np.ascontiguousarray(DOP853.D)


@njit(cache=True)
def propagate(problem, time, y, max_step, out):
    """Fill out (n, 10 + 6 columns): quaternion, rate, rate derivative, sensitivity at each time; y is used up."""
    scratch = np.zeros((STAGES, y.size)), np.empty((7, y.size)), np.empty(y.size)
    K, _, end = scratch
    done = 0
    for piece in range(problem.breaks.size - 1):
        start, stop = problem.breaks[piece], problem.breaks[piece + 1]
        if piece > 0:
            _shift_edge(problem, piece, start, y)
        steps = max(1, int(np.ceil((stop - start) / max_step - 1e-9)))
        h = (stop - start) / steps
        _derivative(problem, piece, start, y, K[0])
        for step in range(steps):
            at = (piece, start + step * h, h)
            while done < time.size and time[done] <= at[1]:
                _record(problem, at, y, end, out[done])
                done += 1
            if done == time.size:
                return
            _step(problem, at, y, scratch)
            t_next = stop if step == steps - 1 else start + (step + 1) * h
            if time[done] < t_next:
                done = _outputs(problem, at, y, scratch, (time, done, t_next, out))
            else:
                y[:] = end
            _normalise(y)
            K[0] = K[12]


@njit(cache=True)
def _outputs(problem, at, y, scratch, wanted):
    """Write the epochs inside a step, move y to its end and return how many epochs are done."""
    K, F, work = scratch
    time, done, t_next, out = wanted
    _dense(problem, at, y, scratch)
    while done < time.size and time[done] < t_next:
        _interpolate((time[done] - at[1]) / at[2], y, F, work)
        _record(problem, (at[0], time[done], at[2]), work, K[13], out[done])
        done += 1
    y += F[0]
    return done


@njit(cache=True)
def _step(problem, at, y, scratch):
    """Twelve stages and the derivative at the end, K[0] given; work becomes the new state."""
    K, _, work = scratch
    piece, t, h = at
    for s in range(1, 13):
        _combine(A[s, :s], h, y, K, work)
        _derivative(problem, piece, t + C[s] * h, work, K[s])


@njit(cache=True)
def _dense(problem, at, y, scratch):
    """Coefficients F of the seventh-order polynomial inside the step whose end is in work."""
    K, F, work = scratch
    piece, t, h = at
    for i in range(y.size):
        F[0, i] = work[i] - y[i]
        F[1, i] = h * K[0, i] - F[0, i]
        F[2, i] = 2 * F[0, i] - h * (K[12, i] + K[0, i])
    for s in range(13, STAGES):
        _combine(A[s, :s], h, y, K, work)
        _derivative(problem, piece, t + C[s] * h, work, K[s])
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
def _interpolate(x, y, F, work):
    for i in range(y.size):
        value = ((F[6, i] * x + F[5, i]) * (1 - x) + F[4, i]) * x + F[3, i]
        work[i] = (((value * (1 - x) + F[2, i]) * x + F[1, i]) * (1 - x) + F[0, i]) * x + y[i]


@njit(cache=True)
def _normalise(y):
    norm = np.sqrt(y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2)
    for i in range(4):
        y[i] /= norm


@njit(cache=True)
def _record(problem, at, y, work, row):
    """One line of output; work is scratch."""
    _derivative(problem, at[0], at[1], y, work)
    row[:7] = y[:7]
    _normalise(row)
    row[7:10] = work[4:7]
    row[10:] = y[7:]


@njit(cache=True)
def _shift_edge(problem, piece, t, y):
    """Last column of the sensitivity: J^-1 (torque before - torque after) for each second the edge comes later."""
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
    """Right-hand side: kinematics, Euler's equation, variational equations."""
    J, R, w = as_tuple(problem.inertia), rotation(y), (y[4], y[5], y[6])
    at, x = _locate(problem.knots, t)
    B = matvec(R, _field(problem.spline[at], x))
    G = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if problem.gradient:
        G = similarity(R, _gradient(problem.spline[at], x))
    magnetic, momentum = cross(problem.dipole[piece], B), matvec(J, w)
    gravity, gyroscopic = gradient_torque(J, G), cross(w, momentum)
    other = (gravity[0] - gyroscopic[0], gravity[1] - gyroscopic[1], gravity[2] - gyroscopic[2])
    torque = _total(problem, piece, t, magnetic, other)
    dy[0] = -0.5 * (y[1] * w[0] + y[2] * w[1] + y[3] * w[2])
    dy[1] = 0.5 * (y[0] * w[0] + y[2] * w[2] - y[3] * w[1])
    dy[2] = 0.5 * (y[0] * w[1] + y[3] * w[0] - y[1] * w[2])
    dy[3] = 0.5 * (y[0] * w[2] + y[1] * w[1] - y[2] * w[0])
    dy[4], dy[5], dy[6] = matvec(as_tuple(problem.inverse), torque)
    if y.size > 7:
        by_angle = _torque_by_angle(problem.dipole[piece], problem.scale, B, gradient_torque_by_angle(J, G))
        _variation(as_tuple(problem.inverse), by_angle, _torque_by_rate(J, w, momentum), y, dy)
        _forcing(as_tuple(problem.inverse), magnetic, (y.size - 7) // 6, dy)


@njit(cache=True)
def _total(problem, piece, t, magnetic, other):
    """Scaled magnetic torque, constant, extra torque and the rest."""
    dt = t - problem.breaks[piece]
    k, s, e, d = problem.constant, problem.scale, problem.extra[piece], problem.slope[piece]
    return (
        s[0] * magnetic[0] + other[0] + k[0] + e[0] + dt * d[0],
        s[1] * magnetic[1] + other[1] + k[1] + e[1] + dt * d[1],
        s[2] * magnetic[2] + other[2] + k[2] + e[2] + dt * d[2],
    )


@njit(cache=True)
def _torque_by_angle(m, s, B, gravity):
    """Torque change: scale [m x][B x] = scale (B m^T - m.B 1), and the gravity-gradient part."""
    dot = m[0] * B[0] + m[1] * B[1] + m[2] * B[2]
    return (
        *(s[0] * (B[0] * m[0] - dot) + gravity[0], s[0] * B[0] * m[1] + gravity[1], s[0] * B[0] * m[2] + gravity[2]),
        *(s[1] * B[1] * m[0] + gravity[3], s[1] * (B[1] * m[1] - dot) + gravity[4], s[1] * B[1] * m[2] + gravity[5]),
        *(s[2] * B[2] * m[0] + gravity[6], s[2] * B[2] * m[1] + gravity[7], s[2] * (B[2] * m[2] - dot) + gravity[8]),
    )


@njit(cache=True)
def _torque_by_rate(J, w, H):
    """[J w x] - [w x] J; Remote Sens. 2022, 14, 4030, eq. 27 with the opposite sign."""
    wJ = matmul((0.0, -w[2], w[1], w[2], 0.0, -w[0], -w[1], w[0], 0.0), J)
    return (
        -wJ[0],
        -H[2] - wJ[1],
        H[1] - wJ[2],
        H[2] - wJ[3],
        -wJ[4],
        -H[0] - wJ[5],
        -H[1] - wJ[6],
        H[0] - wJ[7],
        -wJ[8],
    )


@njit(cache=True, fastmath={"contract"})
def _variation(inverse, by_angle, by_rate, y, dy):
    """Homogeneous part: angle' = rate - w x angle, rate' = J^-1 (by_angle angle + by_rate rate)."""
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
def _forcing(inverse, magnetic, n, dy):
    """Columns 6 to 8: constant torque; columns 9 to 11: scale of the magnetic torque."""
    for row in range(3):
        for axis in range(3):
            dy[7 + (3 + row) * n + 6 + axis] += inverse[3 * row + axis]
            dy[7 + (3 + row) * n + 9 + axis] += inverse[3 * row + axis] * magnetic[axis]


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
def _field(c, x):
    return (_cubic(c, 0, x), _cubic(c, 1, x), _cubic(c, 2, x))


@njit(cache=True)
def _gradient(c, x):
    return (_cubic(c, 3, x), _cubic(c, 4, x), _cubic(c, 5, x), _cubic(c, 6, x), _cubic(c, 7, x), _cubic(c, 8, x))


@njit(cache=True)
def _cubic(c, column, x):
    return ((c[0, column] * x + c[1, column]) * x + c[2, column]) * x + c[3, column]
