"""Drivers of slow disturbances along an orbit: sunlight, warmth and the axis of the geomagnetic dipole."""

import erfa
import numpy as np
from scipy.signal import lfilter

from gravcal.physics import earth
from gravcal.physics.constants import EARTH_RADIUS

#: Time constant of the temperature that effects follow, s; assumed, between that of a sensor head and of a panel.
WARMING_S = 600.0
#: Acceleration by sunlight, m s-2; assumed, 3.5 m2 of a 580 kg satellite that absorbs.
PUSH = 3e-8
#: Node spacing, s.
STEP_S = 10.0


def sun_i(time_gps):
    """Direction of the Sun (n, 3) at GPS seconds (n,), celestial frame; good to 0.01 deg, aberration not applied."""
    first, second = earth.gps_to_tt(np.atleast_1d(time_gps))
    heliocentric, _ = erfa.epv00(first, second)
    return -heliocentric["p"] / np.linalg.norm(heliocentric["p"], axis=-1, keepdims=True)


def sunlit(position_i, sun):
    """True (n,) where positions (n, 3) m are outside the cylinder of the Earth's shadow; sun (n, 3) unit vector."""
    along = np.sum(position_i * sun, axis=-1)
    return (along > 0) | (np.linalg.norm(position_i - along[..., None] * sun, axis=-1) > EARTH_RADIUS)


def argument_of_latitude(position_i: np.ndarray, normal_i: np.ndarray) -> np.ndarray:
    """Angle (n,) rad from the ascending node to positions (n, 3) m of an orbit with the given normal (3,)."""
    node = np.cross([0.0, 0.0, 1.0], normal_i)
    return np.arctan2(position_i @ np.cross(normal_i / np.linalg.norm(normal_i), node), position_i @ node)


def warmth(time, time_orbit, position_i, lag_s=WARMING_S):
    """Sunlight through a first-order lag at times (n,) s, 0 after a long night and 1 after a long day.

    The orbit (k,) s, (k, 3) m covers the times; before the first epoch the mean is taken.
    """
    nodes = np.arange(max(time_orbit[0], time[0] - 4 * lag_s), time[-1] + STEP_S, STEP_S)
    position = np.stack([np.interp(nodes, time_orbit, c) for c in np.asarray(position_i).T], axis=1)
    sun = sun_i(nodes[[0, -1]])
    along = ((nodes - nodes[0]) / max(nodes[-1] - nodes[0], 1.0))[:, None]
    light = sunlit(position, sun[0] + along * (sun[1] - sun[0])).astype(float)
    keep = np.exp(-STEP_S / lag_s)
    values, _ = lfilter([0.0, 1 - keep], [1.0, -keep], light, zi=[light.mean()])
    return np.interp(time, nodes, values)


def dipole_axis_i(time_gps):
    """Direction (n, 3) of the geomagnetic dipole moment, IGRF at 2015, in the celestial frame; it points south."""
    colatitude, longitude = np.radians([9.69, -72.63])
    north = np.sin(colatitude) * np.cos(longitude), np.sin(colatitude) * np.sin(longitude), np.cos(colatitude)
    return np.matvec(np.swapaxes(earth.R_ei(np.atleast_1d(time_gps)), -1, -2), -np.array(north))


def extras(time, time_orbit, position_i, R_bi, mass, force_b):
    """Drivers of slow disturbances, `Context.extra` of effects, at times (n,) s along an orbit (k,) s, (k, 3) m.

    mass kg; non_gravitational_b, the mean drag force_b (3,), and radiation_b (n, 3) m s-2; warmth (n,) 1; axis_b (n, 3)
    1. Radiation of `PUSH` m s-2 away from the Sun while it is up; the size is assumed, the shape is what matters.
    """
    nodes = np.array([time[0], time[-1]])
    position = np.stack([np.interp(time, time_orbit, c) for c in np.asarray(position_i).T], axis=1)
    ends = sun_i(nodes), dipole_axis_i(nodes)
    share = ((time - nodes[0]) / max(nodes[1] - nodes[0], 1e-9))[:, None]
    sun, axis = (e[0] + share * (e[1] - e[0]) for e in ends)
    push = -PUSH * sunlit(position, sun)[:, None] * sun
    drag = np.broadcast_to(force_b, (time.size, 3))
    turned = {"radiation_b": np.matvec(R_bi, push), "axis_b": np.matvec(R_bi, axis)}
    return turned | {"mass": mass, "non_gravitational_b": drag, "warmth": warmth(time, time_orbit, position_i)}
