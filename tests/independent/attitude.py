"""Rigid body with magnetic, gravity-gradient and given torques: fixed-step RK4 on a grid that holds every break."""

from dataclasses import dataclass

import numpy as np
from numba import njit


@dataclass
class Body:
    """What turns the satellite."""

    inertia: np.ndarray
    dipole: np.ndarray  # (3, 3) A m2 per mA, column = rod
    lag: float = 0.0  # s, of the dipole behind the current

    def parts(self):
        """The tuple that `propagate` takes."""
        return (self.inertia, np.linalg.inv(self.inertia)), self.dipole, self.lag


@njit(cache=True)
def cross(a, b):
    """Cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def add(a, b, factor):
    """A + factor b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@njit(cache=True)
def times(m, v):
    """Matrix times vector."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


@njit(cache=True)
def rotate(q, v, sign):
    """Body -> inertial (sign 1) or inertial -> body (sign -1) by a scalar-first quaternion."""
    axis = (q[1], q[2], q[3])
    t = cross(axis, v)
    return add(add(v, t, 2.0 * sign * q[0]), cross(axis, t), 2.0)


@njit(cache=True)
def gravity_torque(q, inertia, gradient):
    """vex(J G - G J) with G turned into the body, column by column."""
    a = times(inertia, rotate(q, times(gradient, rotate(q, (1.0, 0.0, 0.0), 1.0)), -1.0))
    b = times(inertia, rotate(q, times(gradient, rotate(q, (0.0, 1.0, 0.0), 1.0)), -1.0))
    c = times(inertia, rotate(q, times(gradient, rotate(q, (0.0, 0.0, 1.0), 1.0)), -1.0))
    return b[2] - c[1], c[0] - a[2], a[1] - b[0]


@njit(cache=True)
def wanted_rate_dot(q, w, reference, gains):
    """Angular acceleration that a slow PD controller asks for; gains of angle (s-2) and rate (s-1)."""
    r, v = (reference[1], reference[2], reference[3]), (q[1], q[2], q[3])
    scalar = reference[0] * q[0] + dot(r, v)
    part = add(cross(v, r), (reference[0] * v[0], reference[0] * v[1], reference[0] * v[2]), 1.0)
    angle = add((0.0, 0.0, 0.0), add(part, r, -q[0]), 2.0 * np.sign(scalar))
    rate = add(add(w, reference[4:], -1.0), cross(angle, reference[4:]), 1.0)
    return add((-gains[0] * angle[0], -gains[0] * angle[1], -gains[0] * angle[2]), rate, -gains[1])


@njit(cache=True)
def rate_dot(q, w, moment, env, solid, reference, gains):
    """Angular acceleration; env rows: field (inertial), gradient (3 rows, inertial), smooth torque (body).

    With gains a controller without delay holds the reference.
    """
    inertia, inverse = solid
    torque = add(cross(moment, rotate(q, env[0], -1.0)), gravity_torque(q, inertia, env[1:4]), 1.0)
    torque = add(torque, env[4], 1.0)
    if gains[0] > 0:
        torque = add(torque, times(inertia, wanted_rate_dot(q, w, reference, gains)), 1.0)
    return times(inverse, add(torque, cross(w, times(inertia, w)), -1.0))


@njit(cache=True)
def attitude_rate(q, w):
    """Time derivative of the quaternion, q * (0, w) / 2."""
    v = (q[1], q[2], q[3])
    x = add((q[0] * w[0], q[0] * w[1], q[0] * w[2]), cross(v, w), 1.0)
    return -0.5 * dot(v, w), 0.5 * x[0], 0.5 * x[1], 0.5 * x[2]


@njit(cache=True)
def moved(q, rate, step):
    """Quaternion plus step times its rate."""
    return q[0] + step * rate[0], q[1] + step * rate[1], q[2] + step * rate[2], q[3] + step * rate[3]


@njit(cache=True)
def runge_kutta(q, w, h, moments, envs, solid, control):
    """One classical step; moments, environments and references at start, middle, end; normalised quaternion."""
    ref, gains = control
    a1, b1 = attitude_rate(q, w), rate_dot(q, w, moments[0], envs[0], solid, ref[0], gains)
    q2, w2 = moved(q, a1, h / 2), add(w, b1, h / 2)
    a2, b2 = attitude_rate(q2, w2), rate_dot(q2, w2, moments[1], envs[1], solid, ref[1], gains)
    q3, w3 = moved(q, a2, h / 2), add(w, b2, h / 2)
    a3, b3 = attitude_rate(q3, w3), rate_dot(q3, w3, moments[1], envs[1], solid, ref[1], gains)
    q4, w4 = moved(q, a3, h), add(w, b3, h)
    a4, b4 = attitude_rate(q4, w4), rate_dot(q4, w4, moments[2], envs[2], solid, ref[2], gains)
    q = moved(moved(q, a1, h / 6), a4, h / 6)
    q = moved(moved(q, a2, h / 3), a3, h / 3)
    w = add(add(add(add(w, b1, h / 6), b2, h / 3), b3, h / 3), b4, h / 6)
    size = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size), w


@njit(cache=True)
def lagged(before, target, step, lag):
    """First-order lag after a step with a constant target."""
    return target if lag <= 0.0 else add(target, add(before, target, -1.0), np.exp(-step / lag))


@njit(cache=True)
def steer(q, w, env, reference, dither, inertia, control):
    """Control current (mA, whole steps, dither); torque along the field is given up where it costs least."""
    field_b, (per_current, step_ma) = rotate(q, env[0], -1.0), control
    hold = gravity_torque(q, inertia, env[1:4])
    wanted = add(times(inertia, wanted_rate_dot(q, w, reference, (3.6e-5, 1.0e-2))), hold, -1.0)
    stiff = times(inertia, times(inertia, field_b))
    feasible = add(wanted, stiff, -dot(field_b, wanted) / dot(field_b, stiff))
    ideal = cross(field_b, feasible)
    scale = 1.0 / (dot(field_b, field_b) * per_current * step_ma)
    a, b, c = ideal[0] * scale, ideal[1] * scale, ideal[2] * scale
    top = 20.0 / step_ma
    a, b, c = min(max(a, -top), top), min(max(b, -top), top), min(max(c, -top), top)
    return add(dither, (np.rint(a), np.rint(b), np.rint(c)), step_ma)


@njit(cache=True)
def propagate(t, envs, modes, drive, reference, dither, start, body, control):
    """Go through the grid t; rows of state (7), current and angular acceleration, right limits.

    envs = at the grid times and at the middles of the steps. modes[k]: 0 control currents unchanged, 1 off,
    2 renewed. drive = current (3) held over the step. reference = quaternion and rate (7), valid where renewed.
    start = quaternion, rate, control current, lagged current. body = (inertia, inverse), rods, lag.
    """
    solid, rods, lag = body
    q, w, trim, fast = start
    n, table = len(t), np.empty((len(t), 13))
    for k in range(n):
        h, last = (t[k + 1] - t[k], k + 1) if k < n - 1 else (0.0, k)
        if modes[k] == 1:
            trim = (0.0, 0.0, 0.0)
        elif modes[k] > 1:
            trim = steer(q, w, envs[0][k], reference[k], dither[k], solid[0], control)
        now = add(drive[k], trim, 1.0)
        begun, half, fast = lagged(fast, now, 0.0, lag), lagged(fast, now, h / 2, lag), lagged(fast, now, h, lag)
        m = times(rods, begun), times(rods, half), times(rods, fast)
        table[k] = np.array(q + w + now + rate_dot(q, w, m[0], envs[0][k], solid, reference[k], (0.0, 0.0)))
        if k < n - 1:
            here = envs[0][k], envs[1][k], envs[0][last]
            same = (reference[k], reference[k], reference[k]), (0.0, 0.0)
            q, w = runge_kutta(q, w, h, m, here, solid, same)
    return table


@njit(cache=True)
def first_order(t, values, lag, start):
    """First-order lag of (n, 3) values held from one grid time to the next."""
    out = np.empty_like(values)
    out[0] = start
    for k in range(len(t) - 1):
        out[k + 1] = values[k] + (out[k] - values[k]) * np.exp(-(t[k + 1] - t[k]) / lag)
    return out
