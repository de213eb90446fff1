"""Two satellites that look at each other: orbits, orbit errors, and pointing with the wiggles of the calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravcal.estimation.noise import coloured
from gravcal.physics import constants, frames
from gravcal.simulation import orbit

EDGE = 70.0  # s flown before and after the day, for the filters


@dataclass(frozen=True)
class Wiggle:
    """One sub-manoeuvre: the satellite (0 or 1), the axis (0 pitch, 1 yaw), the sign of its offset and its start."""

    satellite: int
    axis: int
    sign: int
    start: float
    stop: float


@dataclass(frozen=True)
class Pair:
    """Both satellites of a day.

    Attributes
    ----------
    day : s, GPS
    path : callables, (n,) s -> (n, 6) m, m s-1, of both
    pointing : callables, (n,) s -> (n, 3) rad, roll, pitch, yaw of both
    wiggles : sub-manoeuvres in order of time
    """

    day: float
    path: tuple[Callable, Callable]
    pointing: tuple[Callable, Callable]
    wiggles: tuple[Wiggle, ...]


def draw_pair(chosen, day: float, rng) -> Pair:
    """Orbits and pointing.

    Parameters
    ----------
    chosen : parameters of the simulation
    day : GPS s of midnight
    rng : source of randomness
    """
    wiggles = schedule(chosen, day)
    path = _paths(chosen, day, rng)
    pointing = tuple(_pointing(chosen, day, [w for w in wiggles if w.satellite == k], rng) for k in (0, 1))
    return Pair(day, path, pointing, wiggles)


def schedule(chosen, day: float) -> tuple[Wiggle, ...]:
    """Sub-manoeuvres one after the other, names such as "+pitch_b"."""
    length = chosen.cycles * chosen.period_s + 2 * chosen.slew_s
    start = day + chosen.first_start_s
    found = []
    for name in chosen.manoeuvres:
        if name:
            axis, letter = name[1:].split("_")
            found.append(
                Wiggle(
                    "ab".index(letter), ("pitch", "yaw").index(axis), 1 - 2 * (name[0] == "-"), start, start + length
                )
            )
        start += length + chosen.quiet_s
    return tuple(found)


def _paths(chosen, day, rng):
    """Two bodies on one orbit, the second some seconds behind or ahead: both obey the same field exactly."""
    from scipy.interpolate import make_interp_spline

    angles = rng.uniform(0, 2 * np.pi, 2)
    inclination = np.radians(chosen.inclination_deg)
    state = orbit.initial_state(chosen.altitude_km * 1e3, inclination, chosen.eccentricity, *angles)
    lag = chosen.separation_km * 1e3 / np.linalg.norm(state[3:])
    begin, nodes = day - 2 * EDGE - lag, None
    nodes = begin + 10.0 * np.arange(int((constants.DAY + 4 * EDGE + 2 * lag) / 10) + 2)
    states = orbit.fly_orbit(state, begin, nodes[-1])(nodes)
    spline = make_interp_spline(nodes - begin, states[:, :3], k=9)
    speed = spline.derivative()

    def follow(delay):
        return lambda t: np.concatenate([spline(t - begin - delay), speed(t - begin - delay)], axis=1)

    return follow(0.0), follow(lag)


def _pointing(chosen, day, wiggles, rng):
    """Roll, pitch and yaw: slow motion of the control loop and the wiggles."""
    from scipy.interpolate import make_interp_spline

    step = 20.0
    nodes = day - 4 * EDGE + step * np.arange(int((constants.DAY + 8 * EDGE) / step) + 1)
    corner = 1 / (2 * np.pi * chosen.pointing_memory_s)
    shape = lambda f: 4 * chosen.pointing_memory_s / (1 + (f / corner) ** 2) ** 2 * 2  # noqa: E731
    wander = chosen.pointing_rad * np.stack([coloured(shape, nodes.size, step, rng) for _ in range(3)], axis=1)
    mean = chosen.pointing_mean_rad * rng.standard_normal(3)
    spline = make_interp_spline(nodes - day, wander + mean, k=5)

    def at(time):
        angle = spline(time - day)
        for wiggle in wiggles:
            angle[:, 1 + wiggle.axis] += wiggle.sign * profile(chosen, time - wiggle.start)
        return angle

    return at


def profile(chosen, time: np.ndarray) -> np.ndarray:
    """Angle of a sub-manoeuvre with positive offset.

    Parameters
    ----------
    chosen : parameters of the simulation
    time : (n,) s since its start

    Returns
    -------
    angle : (n,) rad

    Notes
    -----
    theta = theta0 + A sin(2 pi f t) between two slews; Remote Sens. 2022, 14, 3395, eqs. 1-4.
    """
    length = chosen.cycles * chosen.period_s
    inside = np.clip(time - chosen.slew_s, 0, length)
    ramp = np.clip(np.minimum(time, length + 2 * chosen.slew_s - time) / chosen.slew_s, 0, 1)
    smooth = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    wave = np.sin(2 * np.pi * inside / chosen.period_s)
    return np.radians(chosen.offset_deg) * smooth + np.radians(chosen.amplitude_deg) * wave


def nominal(state_a: np.ndarray, state_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations R_bi (n, 3, 3) of both satellites with x on the line of sight and z down."""
    line = state_b[:, :3] - state_a[:, :3]
    line = line / np.linalg.norm(line, axis=1, keepdims=True)
    return tuple(_facing(x, state[:, :3]) for x, state in ((line, state_a), (-line, state_b)))


def _facing(x, position):
    down = -position / np.linalg.norm(position, axis=1, keepdims=True)
    y = np.cross(down, x)
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def turned(angle: np.ndarray) -> np.ndarray:
    """Quaternion from nominal to body for roll, pitch and yaw (n, 3) rad, pitch and yaw towards the line of sight.

    A body turned by the rotation vector (roll, -pitch, -yaw) sees the line of sight at +pitch and +yaw.
    """
    return frames.from_rotation_vector(angle * np.array([1.0, -1.0, -1.0]))


def orbit_error(chosen, pair: Pair, time: np.ndarray, state: np.ndarray, rng) -> np.ndarray:
    """Error of a reduced-dynamic orbit: 1 and 2 cycles per revolution, and a red part.

    Parameters
    ----------
    chosen : parameters of the simulation
    pair : Pair
    time : (n,) s, evenly spaced
    state : (n, 6) m, m s-1, true
    rng : source of randomness

    Returns
    -------
    error_i : (n, 6) m, m s-1
    """
    revolution = np.linalg.norm(np.cross(state[0, :3], state[0, 3:])) / np.sum(state[0, :3] ** 2)
    phase = revolution * (time - pair.day)[:, None]
    local = np.zeros((time.size, 3))
    for cycles in (0, 1, 2):
        for wave in (np.cos, np.sin):
            local += wave(cycles * phase) * chosen.orbit_error_m / np.sqrt(2) * rng.standard_normal(3)
    if chosen.orbit_red_m > 0:
        step = time[1] - time[0]
        shape = lambda f: (chosen.orbit_red_m / np.maximum(f / 1e-3, 0.3) ** chosen.orbit_red_slope) ** 2  # noqa: E731
        local[:, 1] += coloured(shape, time.size, step, rng)
    radial = state[:, :3] / np.linalg.norm(state[:, :3], axis=1, keepdims=True)
    along = state[:, 3:] / np.linalg.norm(state[:, 3:], axis=1, keepdims=True)
    error = np.stack([radial, along, np.cross(radial, along)], axis=2) @ local[:, :, None]
    return np.concatenate([error[:, :, 0], np.gradient(error[:, :, 0], time, axis=0)], axis=1)
