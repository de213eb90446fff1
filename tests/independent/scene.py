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
    linear: np.ndarray | None = None  # filled by the accelerometer

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
    s = world.settings
    out = np.where(np.isin(t, ticks), 2, 0)
    near = np.zeros(len(t), bool)
    for m in world.manoeuvres:
        near |= (t >= m.start - s.window_s[0]) & (t < m.stop + s.window_s[1])
    out[(out == 2) & ~near] = 3 if s.whole_day else 2
    for m in world.manoeuvres:
        inside = (t >= m.start) & (t < m.stop)
        if s.control != "on":
            out[inside] = {"off": 1, "hold": 0}[s.control]
    return out


def start_state(world, start):
    """State near the reference attitude with small errors."""
    rng, s = stream(world.seed, "attitude", round(start)), world.settings
    error = Rotation.from_rotvec(rng.normal(0, s.pointing_error_rad, 3))
    rate = error.inv().apply(world.orbit.reference_rate([start])[0]) + rng.normal(0, s.rate_error_rad_s, 3)
    q = (world.orbit.reference([start]) * error).as_quat(scalar_first=True)[0]
    return (tuple(q.tolist()), tuple(rate.tolist()), *[(0.0, 0.0, 0.0)] * 3)


def simulate(world, window, samples, ticks, state):
    """Scene over a window whose grid holds the samples; and the state at its end."""
    s, (start, stop) = world.settings, window
    t = np.unique(np.concatenate([*samples, ticks, *(m.edges for m in world.manoeuvres), np.array([start, stop])]))
    t = t[(t >= start) & (t <= stop)]
    mode = modes(world, t, ticks)
    renew, reference = mode >= 2, np.zeros((len(t), 7))
    reference[renew, :4] = world.orbit.reference(t[renew]).as_quat(scalar_first=True)
    reference[renew, 4:] = world.orbit.reference_rate(t[renew])
    dither = stream(world.seed, "dither", round(start)).normal(0, s.control_dither_ma / world.step_ma, (len(t), 3))
    dither = np.rint(dither) * world.step_ma
    both = environment(world, np.concatenate([t, (t[:-1] + t[1:]) / 2]))
    envs = both[: len(t)], both[len(t) :]
    state = start_state(world, start) if state is None else state
    control, parts = (s.dipole_per_current, world.step_ma), world.body.parts()
    table, state = attitude.propagate(t, envs, mode, held(world, t), reference, dither, state, parts, control)
    quaternion, rate, current, _, rate_dot = np.split(table, [4, 7, 10, 13], axis=1)
    field = Rotation.from_quat(quaternion, scalar_first=True).inv().apply(envs[0][:, 0])
    return Scene(world, t, quaternion, rate, rate_dot, current, field), state
