"""Attitude of a simulated satellite: closed loop between manoeuvres, open loop with the effects added."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from gravcal.physics import earth, magnetic
from gravcal.simulation.orbit import nominal_attitude


@dataclass(frozen=True)
class Steps:
    """Timeline of integration steps; nothing jumps inside a step.

    bound : (n + 1,) s, ends of the steps
    control : (n,) bool, the controller acts at the start of the step
    wave : (n,) bool, a manoeuvre runs and the controller rests
    wave_dipole_b : (n, 3) A m2, commanded by the manoeuvre
    """

    bound: np.ndarray
    control: np.ndarray
    wave: np.ndarray
    wave_dipole_b: np.ndarray


@dataclass(frozen=True)
class Environment:
    """What the satellite flies through, at evenly spaced nodes.

    time : (k,) s, nodes
    position_i : (k, 3) m
    field_i : (k, 3) T
    target : (k, 4) attitude that the controller holds, scalar first, continuous in sign
    target_rate_b : (k, 3) rad s-1
    """

    time: np.ndarray
    position_i: np.ndarray
    field_i: np.ndarray
    target: np.ndarray
    target_rate_b: np.ndarray

    def at(self, time: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values (k, m) of the nodes at other times (n, m), linear."""
        return np.stack([np.interp(time, self.time, column) for column in values.T], axis=1)


def environment(time, path, x_along_velocity: float, generation: int) -> Environment:
    """Position, field of an IGRF generation and wanted attitude along an orbit at even epochs (k,) s."""
    state, R_ei = path(time), earth.R_ei(time)
    field_e = magnetic.field_e(time, np.matvec(R_ei, state[:, :3]), generation)
    target, rate = nominal_attitude(state, x_along_velocity)
    return Environment(time, state[:, :3], np.matvec(np.swapaxes(R_ei, 1, 2), field_e), target, rate)


@dataclass(frozen=True)
class Body:
    """Inertia, gains and limits.

    inertia_b : (3, 3) kg m2
    frequency, damping : rad s-1 and 1, of the controlled attitude
    dipole_limit, dipole_step : A m2, saturation and quantum of a rod under control
    gm : m3 s-2
    """

    inertia_b: np.ndarray
    frequency: float
    damping: float
    dipole_limit: float
    dipole_step: float
    gm: float


@numba.njit(cache=True)
def _at(time, nodes, values, out):
    step = nodes[1] - nodes[0]
    k = min(max(int((time - nodes[0]) / step), 0), nodes.size - 2)
    u = (time - nodes[k]) / step
    for c in range(values.shape[1]):
        out[c] = values[k, c] + u * (values[k + 1, c] - values[k, c])


@numba.njit(cache=True)
def _to_body(q, v, out):
    s, x, y, z = q[0], q[1], q[2], q[3]
    a, b, c = v[0], v[1], v[2]
    tx, ty, tz = 2 * (c * y - b * z), 2 * (a * z - c * x), 2 * (b * x - a * y)
    out[0] = a - s * tx + (tz * y - ty * z)
    out[1] = b - s * ty + (tx * z - tz * x)
    out[2] = c - s * tz + (ty * x - tx * y)


@numba.njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _slope(state, dipole, torque, field_i, position_i, inertia, inverse, gm, out, work):
    q, w = state[:4], state[4:]
    field, e, spin, turn, gradient = work[0], work[1], work[2], work[3], work[4]
    _to_body(q, field_i, field)
    _to_body(q, position_i, e)
    radius = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
    for c in range(3):
        e[c] /= radius
    for c in range(3):
        spin[c] = inertia[c, 0] * e[0] + inertia[c, 1] * e[1] + inertia[c, 2] * e[2]
    _cross(e, spin, gradient)
    for c in range(3):
        spin[c] = inertia[c, 0] * w[0] + inertia[c, 1] * w[1] + inertia[c, 2] * w[2]
    _cross(w, spin, turn)
    _cross(dipole, field, spin)
    for c in range(3):
        spin[c] += torque[c] + 3 * gm / radius**3 * gradient[c] - turn[c]
    for c in range(3):
        out[4 + c] = inverse[c, 0] * spin[0] + inverse[c, 1] * spin[1] + inverse[c, 2] * spin[2]
    out[0] = -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2])
    out[1] = 0.5 * (q[0] * w[0] + q[2] * w[2] - q[3] * w[1])
    out[2] = 0.5 * (q[0] * w[1] + q[3] * w[0] - q[1] * w[2])
    out[3] = 0.5 * (q[0] * w[2] + q[1] * w[1] - q[2] * w[0])


@numba.njit(cache=True)
def _command(state, target, target_rate, field, inertia, frequency, damping, limit, quantum, out, gas):
    """Proportional-derivative torque; the rods make the part across the field, m = B x t / B^2, the gas the rest."""
    q = state[:4]
    error = np.empty(3)
    s = target[0] * q[0] + target[1] * q[1] + target[2] * q[2] + target[3] * q[3]
    sign = 1.0 if s >= 0 else -1.0
    error[0] = 2 * sign * (target[0] * q[1] - target[1] * q[0] - target[2] * q[3] + target[3] * q[2])
    error[1] = 2 * sign * (target[0] * q[2] + target[1] * q[3] - target[2] * q[0] - target[3] * q[1])
    error[2] = 2 * sign * (target[0] * q[3] - target[1] * q[2] + target[2] * q[1] - target[3] * q[0])
    torque = np.empty(3)
    for c in range(3):
        rate = state[4 + c] - target_rate[c]
        torque[c] = -inertia[c, c] * (frequency**2 * error[c] + 2 * damping * frequency * rate)
    _cross(field, torque, out)
    square = field[0] ** 2 + field[1] ** 2 + field[2] ** 2
    for c in range(3):
        value = min(max(out[c] / square, -limit), limit)
        out[c] = np.round(value / quantum) * quantum
    _cross(out, field, gas)
    for c in range(3):
        gas[c] = torque[c] - gas[c]


@numba.njit(cache=True)
def _advance(state, h, start, rods, gas, added_dipole, added_torque, nodes, around, body, gm, slope, work):
    """One Runge-Kutta step of fourth order, in place."""
    position, field_i, mid = np.empty(3), np.empty(3), np.empty(7)
    dipole, torque = np.empty(3), np.empty(3)
    for stage in range(4):
        u = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        _at(start + u * h, nodes, around[:, :3], position)
        _at(start + u * h, nodes, around[:, 3:6], field_i)
        for c in range(3):
            dipole[c] = rods[c] + (1 - u) * added_dipole[0, c] + u * added_dipole[1, c]
            torque[c] = gas[c] + (1 - u) * added_torque[0, c] + u * added_torque[1, c]
        for c in range(7):
            mid[c] = state[c] + (u * h * slope[stage - 1, c] if stage > 0 else 0.0)
        _slope(mid, dipole, torque, field_i, position, body[0], body[1], gm, slope[stage], work)
    for c in range(7):
        state[c] += h / 6 * (slope[0, c] + 2 * slope[1, c] + 2 * slope[2, c] + slope[3, c])
    norm = np.sqrt(state[0] ** 2 + state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
    for c in range(4):
        state[c] /= norm


@numba.njit(cache=True)
def _decide(time, state, nodes, around, body, rods, gas):
    """What the controller asks of rods and gas at an epoch, in place."""
    field_i, target, rate, field = np.empty(3), np.empty(4), np.empty(3), np.empty(3)
    _at(time, nodes, around[:, 3:6], field_i)
    _at(time, nodes, around[:, 6:10], target)
    _at(time, nodes, around[:, 10:13], rate)
    _to_body(state[:4], field_i, field)
    numbers = body[2]
    _command(state, target, rate, field, body[0], numbers[0, 0], numbers[0, 1], numbers[0, 2], numbers[1, 0], rods, gas)


@numba.njit(cache=True)
def _fly(bound, control, wave, wave_dipole, closed, rods, gas, added_dipole, added_torque, nodes, around, body, start):
    n = bound.size - 1
    states = np.empty((n + 1, 7))
    states[0] = start
    state, held, push = start.copy(), np.zeros(3), np.zeros(3)
    slope, work, gm = np.empty((4, 7)), np.empty((5, 3)), body[2][1, 1]
    for k in range(n):
        if closed:
            if wave[k]:
                held[:] = wave_dipole[k]
                push[:] = 0.0
            elif control[k] or (k > 0 and wave[k - 1]):
                _decide(bound[k], state, nodes, around, body, held, push)
            rods[k] = held
            gas[k] = push
        h = bound[k + 1] - bound[k]
        added = (added_dipole[k], added_torque[k])
        _advance(state, h, bound[k], rods[k], gas[k], added[0], added[1], nodes, around, body, gm, slope, work)
        states[k + 1] = state
    return states


def fly(
    steps: Steps,
    around: Environment,
    body: Body,
    start: np.ndarray,
    added: tuple[np.ndarray, np.ndarray],
    control: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Integrate the attitude by fourth-order Runge-Kutta over steps of at most 0.1 s.

    Parameters
    ----------
    steps, around, body : see their classes
    start : (7,) quaternion and body rate at the first bound
    added : (n, 2, 3) A m2 and (n, 2, 3) N m, dipole and torque of effects at both ends of each step
    control : (n, 3) A m2 and (n, 3) N m, rods and gas, flown open loop; computed by the controller when not given

    Returns
    -------
    states : (n + 1, 7) quaternion and body rate at the bounds
    control : (n, 3) A m2 and (n, 3) N m, what rods and gas did
    """
    count = steps.bound.size - 1
    closed = control is None
    rods, gas = (np.zeros((count, 3)), np.zeros((count, 3))) if closed else map(np.ascontiguousarray, control)
    table = np.concatenate(
        [around.position_i, around.field_i, around.target, around.target_rate_b], axis=1, dtype=float
    )
    numbers = np.array([[body.frequency, body.damping, body.dipole_limit], [body.dipole_step, body.gm, 0], [0, 0, 0]])
    packed = np.stack([body.inertia_b, np.linalg.inv(body.inertia_b), numbers])
    wave = np.ascontiguousarray(steps.wave_dipole_b)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in added]
    states = _fly(
        steps.bound, steps.control, steps.wave, wave, closed, rods, gas, *arrays, around.time, table, packed, start
    )
    return states, (rods, gas)
