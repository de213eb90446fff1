"""Orbit of a simulated satellite and the attitude that points it along its track."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS, GM, J2


def initial_state(altitude: float, inclination: float, eccentricity: float, node: float, argument: float) -> np.ndarray:
    """Position and velocity at perigee-referenced argument of latitude zero offset.

    Parameters
    ----------
    altitude : m above the equatorial radius, of the semi-major axis
    inclination, node, argument : rad; `argument` is both argument of perigee and place of the start
    eccentricity : 1

    Returns
    -------
    state_i : (6,) m and m s-1
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


def fly_orbit(state_i: np.ndarray, start: float, stop: float) -> Callable[[np.ndarray], np.ndarray]:
    """Orbit in the field of the point mass and the flattening.

    Parameters
    ----------
    state_i : (6,) m and m s-1 at `start`
    start, stop : s

    Returns
    -------
    at : (n,) s -> (n, 6) m and m s-1
    """
    from scipy.interpolate import CubicHermiteSpline

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
    """Attitude with z to nadir, x along or against the flight direction, y completing.

    Parameters
    ----------
    state_i : (n, 6) m and m s-1
    x_along_velocity : +1 or -1

    Returns
    -------
    quaternion : (n, 4) scalar first, continuous in sign
    rate_b : (n, 3) rad s-1, of the rotation with the orbit
    """
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
    """Start times at which a manoeuvre has its middle in an area.

    Parameters
    ----------
    time : (n,) s
    latitude, longitude : (n,) rad, longitude in (-pi, pi]
    area : lat_min, lat_max and optionally lon_min, lon_max in degrees
    duration : s
    """
    inside = (np.degrees(latitude) >= area["lat_min"]) & (np.degrees(latitude) <= area["lat_max"])
    if "lon_min" in area:
        inside &= (np.degrees(longitude) >= area["lon_min"]) & (np.degrees(longitude) <= area["lon_max"])
    return time[inside] - duration / 2


def schedule(starts_by_kind: list[np.ndarray], spacing: float, earliest: float, latest: float) -> np.ndarray | None:
    """Earliest start of each manoeuvre in turn, at least `spacing` apart; None if one finds no place.

    Parameters
    ----------
    starts_by_kind : possible starts of each manoeuvre, s
    spacing, earliest, latest : s
    """
    taken: list[float] = []
    for starts in starts_by_kind:
        free = (starts >= earliest) & (starts <= latest)
        for other in taken:
            free &= np.abs(starts - other) >= spacing
        if not free.any():
            return None
        taken.append(float(starts[free][0]))
    return np.array(taken)
