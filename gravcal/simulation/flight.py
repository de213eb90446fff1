"""Orbit and attitude of a simulated satellite: closed loop between manoeuvres, open loop with the effects added."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

import numba
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from gravcal.errors import CatalogError, refuse
from gravcal.physics import earth, frames, magnetic
from gravcal.physics.constants import DAY, EARTH_RADIUS, GM, J2
from gravcal.physics.dynamics import as_tuple, cross, matvec, normalise, rotation


def initial_state(altitude: float, inclination: float, eccentricity: float, node: float, argument: float) -> np.ndarray:
    """State (6,) m, m s-1 at perigee, its start; altitude m of the semi-major axis, argument of perigee; angles rad."""
    axis = EARTH_RADIUS + altitude  # m, semi-major
    radius = axis * (1 - eccentricity)
    speed = np.sqrt(GM * (2 / radius - 1 / axis))
    along = np.array([np.cos(argument), np.sin(argument)])
    across = np.array([-np.sin(argument), np.cos(argument)])
    ascending = np.array([np.cos(node), np.sin(node), 0.0])
    quarter = np.array([-np.sin(node) * np.cos(inclination), np.cos(node) * np.cos(inclination), np.sin(inclination)])
    plane = np.stack([ascending, quarter])
    return np.concatenate([radius * along @ plane, speed * across @ plane])


def drawn(chosen, eccentricity: float, start: float, stop: float, rng) -> Callable[[np.ndarray], np.ndarray]:
    """Orbit of the settings from a random node and place, as `fly_orbit` gives it, a minute wider than the bounds."""
    angles = rng.uniform(0, 2 * np.pi, 2)
    state = initial_state(chosen.altitude_km * 1e3, np.radians(chosen.inclination_deg), eccentricity, *angles)
    return fly_orbit(state, start - 60, stop + 60)


def fly_orbit(state_i: np.ndarray, start: float, stop: float) -> Callable[[np.ndarray], np.ndarray]:
    """Orbit (n,) s -> (n, 6) m, m s-1 in the field of point mass and flattening, from its state (6,) at `start`."""
    step = 10.0
    nodes = start + step * np.arange(int(np.ceil((stop - start) / step)) + 1)
    states = _march(np.asarray(state_i, dtype=float), nodes.size, step, GM, EARTH_RADIUS, J2)
    path = CubicHermiteSpline(nodes, states[:, :3], states[:, 3:])
    speed = path.derivative()
    return lambda time: np.concatenate([path(time), speed(time)], axis=1)


@numba.njit(cache=True)
def _pull(state, gm, radius, j2, out):
    """Write velocity and acceleration (6,) of a state (6,) into `out`: point mass and flattening, pole along z."""
    x, y, z = state[0], state[1], state[2]
    square = x * x + y * y + z * z
    central = -gm / (square * np.sqrt(square))
    bulge = 1.5 * j2 * radius * radius / square
    share = 5 * z * z / square
    out[0], out[1], out[2] = state[3], state[4], state[5]
    out[3] = central * x * (1 + bulge * (1 - share))
    out[4] = central * y * (1 + bulge * (1 - share))
    out[5] = central * z * (1 + bulge * (3 - share))


@numba.njit(cache=True)
def _march(state, count, step, gm, radius, j2):
    """States (count, 6) m, m s-1, `step` s apart, from a first one by Runge-Kutta of fourth order."""
    states, slope = np.empty((count, 6)), np.empty((4, 6))
    states[0] = state
    for k in range(1, count):
        now = states[k - 1]
        _pull(now, gm, radius, j2, slope[0])
        _pull(now + step / 2 * slope[0], gm, radius, j2, slope[1])
        _pull(now + step / 2 * slope[1], gm, radius, j2, slope[2])
        _pull(now + step * slope[2], gm, radius, j2, slope[3])
        states[k] = now + step / 6 * (slope[0] + 2 * slope[1] + 2 * slope[2] + slope[3])
    return states


def nominal_attitude(state_i: np.ndarray, x_along_velocity: float) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion (n, 4) and rate (n, 3) rad s-1 with z to nadir, x along (+1) or against (-1) the flight."""
    R_bi = frames.flight_frame(state_i)[:, ::-1] * [[x_along_velocity], [x_along_velocity], [-1.0]]
    momentum = np.linalg.norm(np.cross(state_i[:, :3], state_i[:, 3:]), axis=1)
    rate = np.zeros((len(state_i), 3))
    rate[:, 1] = -x_along_velocity * momentum / np.sum(state_i[:, :3] ** 2, axis=1)
    return frames.continuous(frames.quaternion_from_R_bi(R_bi)), rate


def windows(text: str) -> np.ndarray:
    """Begin and end (k, 2) s of the day of windows such as "02:10-04:00, 05:40-07:15"; an empty text is all of it."""
    if not text:
        return np.array([[0.0, DAY]])
    try:
        ends = [[datetime.strptime(end.strip(), "%H:%M") for end in one.split("-")] for one in text.split(",")]
        bounds = np.array([[3600.0 * end.hour + 60 * end.minute for end in (begin, stop)] for begin, stop in ends])
    except ValueError:
        refuse(
            "windows", repr(text), "times of the day such as '02:10-04:00, 05:40-07:15'", "Correct them.", CatalogError
        )
    if np.any(bounds[:, 1] <= bounds[:, 0]):
        refuse("windows", repr(text), "an end after each begin, on one day", "Correct them.", CatalogError)
    return bounds


def within_windows(since: np.ndarray, duration: float, allowed: np.ndarray) -> np.ndarray:
    """True where what begins at (...,) s of the day and lasts `duration` s is inside one of the windows (k, 2) s."""
    since = np.asarray(since)[..., None]
    return np.any((since >= allowed[:, 0]) & (since + duration <= allowed[:, 1]), axis=-1)


def schedule(starts_by_kind: list[np.ndarray], spacing: float) -> np.ndarray | None:
    """Earliest allowed start s of each manoeuvre in turn, at least `spacing` s apart; None if one finds no place."""
    taken: list[float] = []
    for starts in starts_by_kind:
        free = np.ones(starts.size, dtype=bool)
        for other in taken:
            free &= np.abs(starts - other) >= spacing
        if not free.any():
            return None
        taken.append(float(starts[free][0]))
    return np.array(taken)


@dataclass(frozen=True)
class Steps:
    """Timeline of integration steps; nothing jumps inside a step."""

    bound: np.ndarray  #: (n + 1,) s, ends of the steps
    control: np.ndarray  #: (n,) bool, the controller acts at the start of the step
    wave: np.ndarray  #: (n,) bool, a manoeuvre runs and the controller rests
    wave_dipole_b: np.ndarray  #: (n, 3) A m2, commanded by the manoeuvre


@dataclass(frozen=True)
class Environment:
    """Position, field and target attitude at evenly spaced nodes."""

    time: np.ndarray  #: (k,) s, nodes
    position_i: np.ndarray  #: (k, 3) m
    field_i: np.ndarray  #: (k, 3) T
    target: np.ndarray  #: (k, 4) attitude that the controller holds, scalar first, continuous in sign
    target_rate_b: np.ndarray  #: (k, 3) rad s-1


def environment(time, path, x_along_velocity: float, generation: int) -> Environment:
    """Position, field of an IGRF generation and target attitude along an orbit at even epochs (k,) s."""
    state, R_ei = path(time), earth.R_ei(time)
    field_e = magnetic.field_e(time, np.matvec(R_ei, state[:, :3]), generation)
    target, rate = nominal_attitude(state, x_along_velocity)
    return Environment(time, state[:, :3], np.matvec(np.swapaxes(R_ei, 1, 2), field_e), target, rate)


@dataclass(frozen=True)
class Body:
    """Inertia of the satellite, gains and limits of its attitude control."""

    inertia_b: np.ndarray  #: (3, 3) kg m2
    frequency: float  #: rad s-1, of the controlled attitude
    damping: float  #: 1
    dipole_limit: float  #: A m2, saturation of a rod under control
    dipole_step: float  #: A m2, resolution of its dipole


@numba.njit(cache=True)
def _at(time, nodes, values, c):
    """Three elements from column c on of values (k, m) at even nodes (k,) s, linear in time."""
    step = nodes[1] - nodes[0]
    k = min(max(int((time - nodes[0]) / step), 0), nodes.size - 2)
    u, a, b = (time - nodes[k]) / step, values[k], values[k + 1]
    return (a[c] + u * (b[c] - a[c]), a[c + 1] + u * (b[c + 1] - a[c + 1]), a[c + 2] + u * (b[c + 2] - a[c + 2]))


@numba.njit(cache=True)
def _slope(state, dipole, torque, field_i, position_i, body, out):
    """Write the derivative of a state (7,) into `out`: kinematics; Euler's equation, all torques."""
    R, J, w = rotation(state), as_tuple(body[0]), (state[4], state[5], state[6])
    r, magnetic = matvec(R, position_i), cross(dipole, matvec(R, field_i))
    pull = 3 * GM / (r[0] ** 2 + r[1] ** 2 + r[2] ** 2) ** 2.5
    tide, turn = cross(r, matvec(J, r)), cross(w, matvec(J, w))
    x = magnetic[0] + torque[0] + pull * tide[0] - turn[0]
    y = magnetic[1] + torque[1] + pull * tide[1] - turn[1]
    z = magnetic[2] + torque[2] + pull * tide[2] - turn[2]
    out[4], out[5], out[6] = matvec(as_tuple(body[1]), (x, y, z))
    out[0] = -0.5 * (state[1] * w[0] + state[2] * w[1] + state[3] * w[2])
    out[1] = 0.5 * (state[0] * w[0] + state[2] * w[2] - state[3] * w[1])
    out[2] = 0.5 * (state[0] * w[1] + state[3] * w[0] - state[1] * w[2])
    out[3] = 0.5 * (state[0] * w[2] + state[1] * w[1] - state[2] * w[0])


@numba.njit(cache=True)
def _decide(time, state, nodes, around, body, rods, gas):
    """Set dipole of rods (3,) A m2 and torque of gas (3,) N m at an epoch, in place: proportional-derivative control.

    The rods make the part across the field, m = B x t / B^2, within their limit and in whole steps, the gas the rest.
    """
    frequency, damping, limit, quantum = body[2, 0, 0], body[2, 0, 1], body[2, 0, 2], body[2, 1, 0]  # packed by `fly`
    field = matvec(rotation(state), _at(time, nodes, around, 3))
    (s, x, y), (_, _, z), rate = _at(time, nodes, around, 6), _at(time, nodes, around, 7), _at(time, nodes, around, 10)
    sign = 1.0 if s * state[0] + x * state[1] + y * state[2] + z * state[3] >= 0 else -1.0
    error, torque = np.empty(3), np.empty(3)
    error[0] = 2 * sign * (s * state[1] - x * state[0] - y * state[3] + z * state[2])
    error[1] = 2 * sign * (s * state[2] + x * state[3] - y * state[0] - z * state[1])
    error[2] = 2 * sign * (s * state[3] - x * state[2] + y * state[1] - z * state[0])
    for c in range(3):
        acceleration = frequency**2 * error[c] + 2 * damping * frequency * (state[4 + c] - rate[c])
        torque[c] = -body[0, c, c] * acceleration
    square = field[0] ** 2 + field[1] ** 2 + field[2] ** 2
    rods[0], rods[1], rods[2] = cross(field, torque)
    for c in range(3):
        rods[c] = np.round(min(max(rods[c] / square, -limit), limit) / quantum) * quantum
    by_rods = cross(rods, field)
    for c in range(3):
        gas[c] = torque[c] - by_rods[c]


@numba.njit(cache=True)
def _advance(state, h, start, rods, gas, added_dipole, added_torque, nodes, around, body, slope):
    """Advance a state (7,) by h s, in place: one Runge-Kutta step of fourth order; slope (4, 7) is scratch."""
    mid, dipole, torque = np.empty(7), np.empty(3), np.empty(3)
    for stage in range(4):
        u = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        position, field_i = _at(start + u * h, nodes, around, 0), _at(start + u * h, nodes, around, 3)
        for c in range(3):
            dipole[c] = rods[c] + (1 - u) * added_dipole[0, c] + u * added_dipole[1, c]
            torque[c] = gas[c] + (1 - u) * added_torque[0, c] + u * added_torque[1, c]
        for c in range(7):
            mid[c] = state[c] + (u * h * slope[stage - 1, c] if stage > 0 else 0.0)
        _slope(mid, dipole, torque, field_i, position, body, slope[stage])
    for c in range(7):
        state[c] += h / 6 * (slope[0, c] + 2 * slope[1, c] + 2 * slope[2, c] + slope[3, c])
    normalise(state)


@numba.njit(cache=True)
def _fly(bound, control, wave, wave_dipole, closed, rods, gas, added_dipole, added_torque, nodes, around, body, start):
    """States (n + 1, 7) at the bounds; rods and gas (n, 3) are filled by the control if closed, else applied."""
    n = bound.size - 1
    states = np.empty((n + 1, 7))
    states[0] = start
    state, dipole, torque = start.copy(), np.zeros(3), np.zeros(3)
    slope = np.empty((4, 7))
    for k in range(n):
        if closed:
            if wave[k]:
                dipole[:] = wave_dipole[k]
                torque[:] = 0.0
            elif control[k] or (k > 0 and wave[k - 1]):
                _decide(bound[k], state, nodes, around, body, dipole, torque)
            rods[k] = dipole
            gas[k] = torque
        h = bound[k + 1] - bound[k]
        added = (added_dipole[k], added_torque[k])
        _advance(state, h, bound[k], rods[k], gas[k], added[0], added[1], nodes, around, body, slope)
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
    """Integrate the attitude by fourth-order Runge-Kutta over steps of at most 0.1 s, from quaternion and rate (7,).

    Effects add dipole and torque (n, 2, 3) A m2, N m at both ends of each step. Returned are states (n + 1, 7) at the
    bounds, and rods (n, 3) A m2 and gas (n, 3) N m of the controller, or those of `control`, flown open loop.
    """
    count = steps.bound.size - 1
    closed = control is None
    rods, gas = (np.zeros((count, 3)), np.zeros((count, 3))) if closed else map(np.ascontiguousarray, control)
    table = np.concatenate([around.position_i, around.field_i, around.target, around.target_rate_b], 1, dtype=float)
    numbers = np.array([[body.frequency, body.damping, body.dipole_limit], [body.dipole_step, 0, 0], [0, 0, 0]])
    packed = np.stack([body.inertia_b, np.linalg.inv(body.inertia_b), numbers])
    wave = np.ascontiguousarray(steps.wave_dipole_b)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in added]
    states = _fly(
        steps.bound, steps.control, steps.wave, wave, closed, rods, gas, *arrays, around.time, table, packed, start
    )
    return states, (rods, gas)
