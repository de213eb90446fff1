"""The true motion and surroundings over one window, on a grid that holds every sample and every break."""

from dataclasses import dataclass
from functools import cached_property
from zlib import crc32

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from . import attitude, earth
from .field import field_earth


def stream(seed, *names):
    """Generator of its own for a purpose, so that one draw does not move another."""
    return np.random.default_rng([seed, *(crc32(str(name).encode()) for name in names)])


@dataclass
class Scene:
    """States at grid times t (s of day); all (n, 3) arrays in SRF."""

    world: object
    t: np.ndarray
    quaternion: np.ndarray
    rate: np.ndarray
    rate_dot: np.ndarray
    current: np.ndarray
    field: np.ndarray

    @property
    def manoeuvres(self):
        """All manoeuvres of the day."""
        return self.world.manoeuvres

    def rng(self, name):
        """Generator of an effect."""
        return stream(self.world.seed, "effect", name)

    @property
    def rotation(self):
        """SRF to GCRS."""
        return Rotation.from_quat(self.quaternion, scalar_first=True)

    @property
    def total(self):
        """Sum of the three currents, mA."""
        return self.current.sum(axis=1)

    @property
    def strength(self):
        """Magnitude of the field, T."""
        return np.linalg.norm(self.field, axis=1)

    @cached_property
    def latitude(self):
        """Geocentric latitude, rad."""
        x, y, z = self.world.orbit.solution(self.t)[:3]
        return np.arctan2(z, np.hypot(x, y))

    @cached_property
    def pointing(self):
        """Small rotation from the reference attitude to the satellite."""
        return (self.world.orbit.reference(self.t).inv() * self.rotation).as_rotvec()

    @cached_property
    def rate_off(self):
        """Rate minus that of the reference."""
        reference = Rotation.from_rotvec(self.pointing).inv().apply(self.world.orbit.reference_rate(self.t))
        return self.rate - reference

    def at(self, seconds):
        """Indices of times that are on the grid."""
        return np.searchsorted(self.t, seconds)


def environment(world, t):
    """Field, gradient (3 rows, GCRS) and smooth torque (SRF) at times: (n, 5, 3)."""
    s = world.settings
    knots = np.arange(t.min() - 10.0, t.max() + 15.0, 5.0)
    turn = earth.gcrs_to_earth(s.date, knots)
    position_e = np.einsum("nij,nj->ni", turn, world.orbit.position(knots))
    field_e = field_earth(s.date, knots, position_e, s.field_generation)
    field_i = CubicSpline(knots, np.einsum("nji,nj->ni", turn, field_e))(t)
    return np.concatenate([field_i[:, None], world.orbit.gradient(t), world.torque(t)[:, None]], axis=1)


def held(world, t):
    """Square-wave currents (n, 3) held from each grid time to the next."""
    out = np.zeros((len(t), 3))
    for m in world.manoeuvres:
        out[:, m.rod] += m.current(t)
    return out


def modes(world, t, ticks):
    """Control mode at each grid time (see `attitude.propagate`)."""
    out = np.where(np.isin(t, ticks), 2, 0)
    for m in world.manoeuvres if world.settings.control == "off" else ():
        out[(t >= m.start) & (t < m.stop)] = 1
    return out


def start_state(world, start):
    """State near the reference attitude with errors of 1 mrad and 1e-6 rad/s."""
    rng = stream(world.seed, "attitude", round(start))
    error = Rotation.from_rotvec(rng.normal(0, 1e-3, 3))
    rate = error.inv().apply(world.orbit.reference_rate([start])[0]) + rng.normal(0, 1e-6, 3)
    q = (world.orbit.reference([start]) * error).as_quat(scalar_first=True)[0]
    return (tuple(q.tolist()), tuple(rate.tolist()), *[(0.0, 0.0, 0.0)] * 2)


def simulate(world, window, samples, ticks):
    """Scene over a window whose grid holds the samples."""
    start, stop = window
    t = np.unique(np.concatenate([*samples, ticks, *(m.edges for m in world.manoeuvres), np.array([start, stop])]))
    t = t[(t >= start) & (t <= stop)]
    mode = modes(world, t, ticks)
    renew, reference = mode >= 2, np.zeros((len(t), 7))
    reference[renew, :4] = world.orbit.reference(t[renew]).as_quat(scalar_first=True)
    reference[renew, 4:] = world.orbit.reference_rate(t[renew])
    dither = stream(world.seed, "dither", round(start)).normal(0, 0.1 / world.step_ma, (len(t), 3))  # mA
    dither = np.rint(dither) * world.step_ma
    both = environment(world, np.concatenate([t, (t[:-1] + t[1:]) / 2]))
    envs = both[: len(t)], both[len(t) :]
    control, state = (world.per_current, world.step_ma), start_state(world, start)
    table = attitude.propagate(t, envs, mode, held(world, t), reference, dither, state, world.body.parts(), control)
    quaternion, rate, current, rate_dot = np.split(table, [4, 7, 10], axis=1)
    field = Rotation.from_quat(quaternion, scalar_first=True).inv().apply(envs[0][:, 0])
    return Scene(world, t, quaternion, rate, rate_dot, current, field)
