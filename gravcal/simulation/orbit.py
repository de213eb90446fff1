"""Orbit of a simulated satellite and the attitude that points it along its track."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS, GM, J2


def initial_state(altitude: float, inclination: float, eccentricity: float, node: float, argument: float) -> np.ndarray:
    """State (6,) m, m s-1 at perigee, of a semi-major axis so many m above the equatorial radius; angles in rad.

    The argument is both that of perigee and the place of the start.
    """
    axis = EARTH_RADIUS + altitude
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
    """Velocity and acceleration of point mass and flattening, pole along z."""
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
    """Fourth-order Runge-Kutta; (count, 6) states `step` seconds apart."""
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
    position, velocity = state_i[:, :3], state_i[:, 3:]
    z = -position / np.linalg.norm(position, axis=1, keepdims=True)
    normal = np.cross(position, velocity)
    momentum = np.linalg.norm(normal, axis=1)
    y = -x_along_velocity * normal / momentum[:, None]
    R_bi = np.stack([np.cross(y, z), y, z], axis=1)
    rate = np.zeros_like(position)
    rate[:, 1] = -x_along_velocity * momentum / np.sum(position**2, axis=1)
    return frames.continuous(frames.quaternion_from_R_bi(R_bi)), rate


def passes(time: np.ndarray, latitude: np.ndarray, longitude: np.ndarray, area: dict, duration: float) -> np.ndarray:
    """Times s at which a manoeuvre starts that has its middle in an area, whose bounds are in degrees."""
    inside = (np.degrees(latitude) >= area["lat_min"]) & (np.degrees(latitude) <= area["lat_max"])
    if "lon_min" in area:
        inside &= (np.degrees(longitude) >= area["lon_min"]) & (np.degrees(longitude) <= area["lon_max"])
    return time[inside] - duration / 2


def schedule(starts_by_kind: list[np.ndarray], spacing: float, earliest: float, latest: float) -> np.ndarray | None:
    """Earliest start s of each manoeuvre in turn, at least `spacing` apart; None if one finds no place."""
    taken: list[float] = []
    for starts in starts_by_kind:
        free = (starts >= earliest) & (starts <= latest)
        for other in taken:
            free &= np.abs(starts - other) >= spacing
        if not free.any():
            return None
        taken.append(float(starts[free][0]))
    return np.array(taken)
