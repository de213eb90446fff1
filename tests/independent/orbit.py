"""Near-polar orbit with J2: own integration, gravity gradient, reference attitude."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from . import earth


@dataclass(frozen=True)
class Orbit:
    """One day of orbit; seconds of the day in, GCRS out."""

    solution: object
    to_gcrs: np.ndarray
    spacing_s: float  # time the other satellite is ahead (negative: behind)

    def position(self, seconds):
        """Position (n, 3) in m."""
        return self.solution(np.asarray(seconds, float))[:3].T @ self.to_gcrs.T

    def velocity(self, seconds):
        """Velocity (n, 3) in m/s."""
        return self.solution(np.asarray(seconds, float))[3:].T @ self.to_gcrs.T

    def gradient(self, seconds):
        """Gravity gradient (n, 3, 3) in s-2 of the oblate Earth, GCRS axes."""
        return self.to_gcrs @ oblate_gradient(self.solution(np.asarray(seconds, float))[:3].T) @ self.to_gcrs.T

    def reference(self, seconds):
        """Rotation SRF to GCRS with x along the line of sight and z to nadir."""
        seconds = np.asarray(seconds, float)
        here, there = self.position(seconds), self.position(seconds + self.spacing_s)
        x = _unit(there - here)
        y = _unit(np.cross(-here, x))
        return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], -1))

    def reference_rate(self, seconds, step=0.5):
        """Angular velocity (n, 3) of the reference attitude in its own axes, rad/s."""
        seconds = np.asarray(seconds, float)
        before, after = self.reference(seconds - step), self.reference(seconds + step)
        return (before.inv() * after).as_rotvec() / (2 * step)


def flight(orbit, seconds):
    """Rotation from x outward, z along the flight to GCRS."""
    r, v = orbit.position(seconds), orbit.velocity(seconds)
    x, y = _unit(r), _unit(-np.cross(r, v))
    return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], -1))


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def oblate_gravity(position):
    """Acceleration (3,) of point mass and J2, axis along z."""
    x, y, z = position
    r2 = x * x + y * y + z * z
    r = np.sqrt(r2)
    k = 1.5 * earth.J2 * earth.EQUATOR**2 / r2
    s = 5 * z * z / r2
    return -earth.MU / (r2 * r) * np.array([x * (1 + k * (1 - s)), y * (1 + k * (1 - s)), z * (1 + k * (3 - s))])


def oblate_gradient(position):
    """Hessian (n, 3, 3) of mu/r - mu J2 R^2 (3 z^2 - r^2)/(2 r^5)."""
    r = np.linalg.norm(position, axis=-1)[:, None, None]
    z = position[:, 2][:, None, None]
    outer = position[:, :, None] * position[:, None, :]
    one, zz = np.eye(3), np.zeros((3, 3))
    zz[2, 2] = 1.0
    mixed = np.zeros_like(outer)
    mixed[:, 2, :] += position
    mixed[:, :, 2] += position
    q = 0.5 * earth.MU * earth.J2 * earth.EQUATOR**2
    point = earth.MU / r**3 * (3 * outer / r**2 - one)
    a = one * (3 / r**5 - 15 * z**2 / r**7) + 6 * zz / r**5
    b = outer * (105 * z**2 / r**9 - 15 / r**7) - 30 * z * mixed / r**7
    return point - q * (a + b)


def make_orbit(rng, gps_noon, *, height_m, inclination_deg, eccentricity, spacing_s):
    """Orbit of a day, ascending node at zero longitude of the intermediate frame (see `turn`)."""
    axis = earth.EQUATOR + height_m
    inclination, perigee, latitude = np.radians(inclination_deg), *rng.uniform(0, 2 * np.pi, 2)
    anomaly = latitude - perigee
    semi_latus = axis * (1 - eccentricity**2)
    r = semi_latus / (1 + eccentricity * np.cos(anomaly))
    rate = np.sqrt(earth.MU / semi_latus)
    radial, along = rate * eccentricity * np.sin(anomaly), rate * (1 + eccentricity * np.cos(anomaly))
    c, s = np.cos(latitude), np.sin(latitude)
    plane = np.array([[1, 0, 0], [0, np.cos(inclination), np.sin(inclination)]])
    out, forward = np.array([c, s]) @ plane, np.array([-s, c]) @ plane
    start = np.concatenate([r * out, radial * out + along * forward])
    return Orbit(_integrate(tuple(start.tolist())), earth.intermediate_to_gcrs(gps_noon), spacing_s)


@lru_cache(maxsize=8)
def _integrate(start):
    """Dense solution over the day with margins; kept, since events of one seed share it."""
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-6, "max_step": 40.0, "dense_output": True}
    flow = lambda _, state: np.concatenate([state[3:], oblate_gravity(state[:3])])  # noqa: E731
    return solve_ivp(flow, (-200.0, 86600.0), start, **options).sol


def turn(orbit, node_rad):
    """The same orbit with its ascending node moved eastward."""
    spin = Rotation.from_euler("z", node_rad).as_matrix()
    return Orbit(orbit.solution, orbit.to_gcrs @ spin, orbit.spacing_s)
