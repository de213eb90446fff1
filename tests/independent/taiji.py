"""A second simulator of Taiji-1: a swing on one day, a roll about y on the next, from the corrected equations.

(M1) for the linear readout, Euler's equation of the held test mass for the angular one (eq. 11), voltages by Table 3,
scale factors by M l/J (T-4). Body rates are prescribed and integrated by half steps; frame of the sensor: z along the
flight, x outward. Voltages obey f = b + k V, f = a_ng + (M - G) p.
"""

from datetime import date, timedelta
from pathlib import Path

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation, Slerp

from . import attitude, earth, noise
from .orbit import flight, make_orbit
from .scene import stream
from .writer import netcdf

DATE, MASS, ARM = "2022-05-20", 0.072, 10.45e-3  # kg, m: Table 1, arm about x as the printed k_z asks (T-5)
INERTIA = np.diag([1.9440e-5, 1.0328e-5, 1.0328e-5])
BETA, K_Y = np.array([4.42e-3, 4.08e-2]), 2.7e-4  # about x, and about y and z: Table 4
OFFSET_UM, BIAS = np.array([-140.0, 628.0, -896.0]), np.array([-2.6e-4, 1.95e-5, 3.0e-6])
SWING = {"period_s": np.array([26.0, 29.0, 1.0]), "rate": np.array([1e-4, 1e-4, 0.0]), "rise_s": 0.6}
ROLL_S = 724.0
VOLTS = dict.fromkeys("xyz", ([2e-3, 2e-2, 1.0, 5.0], [4e-5, 2e-5, 1.8e-5, 2.6e-5]))  # V Hz-1/2
FORCE = dict.fromkeys("xyz", ([1e-3, 1e-2, 5.0], [4e-9, 2.5e-9, 2.5e-9]))  # m s-2 Hz-1/2
CAMERA = dict.fromkeys("xyz", ([2e-2, 0.2, 2.0], [1.2e-5, 7e-6, 7e-6]))  # rad Hz-1/2
STEP = 0.05  # s, of the motion
EFFECTS = ("quadratic", "cross", "tracker_misalignment", "odd_telegraph")


@njit(cache=True)
def turned(start, angles):
    """Quaternions after successive small body rotations (n, 3)."""
    out = np.empty((len(angles) + 1, 4))
    q = start
    for k in range(len(angles)):
        out[k] = np.array(q)
        step = attitude.attitude_rate(q, (2 * angles[k, 0], 2 * angles[k, 1], 2 * angles[k, 2]))  # q * (0, angle)
        half = np.sqrt(angles[k, 0] ** 2 + angles[k, 1] ** 2 + angles[k, 2] ** 2) / 2
        c, s = np.cos(half), (0.5 * np.sin(half) / half if half > 0 else 0.5)
        q = (c * q[0] + s * step[0], c * q[1] + s * step[1], c * q[2] + s * step[2], c * q[3] + s * step[3])
    out[-1] = np.array(q)
    return out


def torque_wave(t, period):
    """Square wave of t with rounded edges (-1 to 1), whole periods from the middle of a half on, and its integral."""
    x = np.arange(-5.0, t[-1] + 5.0, STEP / 2)
    square = np.where((x >= 0) & (x < 200.0 // period * period), np.sign(np.cos(2 * np.pi * x / period)), 0.0)
    kernel = np.ones(int(SWING["rise_s"] / STEP * 2))
    smooth = np.convolve(np.convolve(square, kernel / kernel.sum(), "same"), kernel / kernel.sum(), "same")
    return np.interp(t, x, smooth), np.interp(t, x, np.cumsum((smooth + np.roll(smooth, 1)) / 2) * STEP / 2)


def rates(kind, t, rng, mean):
    """Body rates and their derivatives at t."""
    slow = noise.Smooth(rng("rate", kind), np.zeros(3), 0.0, [2e-7, 4e-7, 2e-7])
    w, h = slow(t), 1.0
    wd = (slow(t + h) - slow(t - h)) / (2 * h)
    if kind == "roll":
        return w + np.array([0.0, -2 * np.pi / ROLL_S, 0.0]), wd
    w += mean
    for axis in (0, 1):
        wave, area = torque_wave(t - t[0] - 400.0, SWING["period_s"][axis])
        size = 4 * SWING["rate"][axis] / SWING["period_s"][axis]
        w[:, axis] += size * area
        wd[:, axis] += size * wave
    return w, wd


def voltages(linear, angular, k, beta):
    """The six voltages of Table 3 that hold the test mass."""
    both, torque = linear / k, angular / beta  # 2 V1 + V2 + V3, Vy, V4 + V5; V4 - V5, V2 - V3, 2 V1 - V2 - V3
    pair = (both[:, 0] - torque[:, 2]) / 4
    x = [(both[:, 0] + torque[:, 2]) / 4, pair + torque[:, 1] / 2, pair - torque[:, 1] / 2]
    z = [(both[:, 2] + torque[:, 0]) / 2, (both[:, 2] - torque[:, 0]) / 2]
    return np.stack([*x, both[:, 1], *z], -1)


class Sensor:
    """What does not change between both days."""

    def __init__(self, seed, effects):
        self.seed, self.effects = seed, effects
        beta = BETA * (1 + self.rng("beta").normal(0, 0.04, 2))
        self.beta, inertia = beta[[0, 1, 1]], np.diag(INERTIA)
        self.k = np.array([inertia[1] * beta[1], np.nan, inertia[0] * beta[0]]) / (MASS * ARM)
        self.k[1] = K_Y
        self.offset = 1e-6 * (OFFSET_UM + self.rng("offset").normal(0, 60, 3))
        self.bias = BIAS * (1 + self.rng("bias").normal(0, 0.02, 3))
        self.delay = float(self.rng("delay").normal(0, 0.08))
        self.angular_bias = self.rng("angular").normal(0, 1e-6, 3)

    def rng(self, *names):
        """Generator of a purpose."""
        return stream(self.seed, "taiji", *names)

    def write(self, folder, kind, begin, duration):
        """Files of one day with a swing or a roll."""
        name = (date.fromisoformat(DATE) + timedelta(days=kind == "roll")).isoformat()
        day, elements = earth.day_start(name), {"height_m": 604e3, "inclination_deg": 97.67, "eccentricity": 8e-4}
        orbit = make_orbit(self.rng("orbit", kind), day + 43200, spacing_s=30.0, **elements)
        fine = begin - 1.0 + STEP * np.arange(int((duration + 2) / STEP) + 1)
        mean = (flight(orbit, fine[:1]).inv() * flight(orbit, fine[-1:])).as_rotvec()[0] / (fine[-1] - fine[0])
        w, wd = rates(kind, fine, self.rng, mean)
        middle = (w[1:] + w[:-1]) / 2 - STEP**2 / 12 * (wd[1:] - wd[:-1]) / STEP
        start = flight(orbit, fine[:1])[0] * Rotation.from_rotvec(self.rng("start", kind).normal(0, 3e-4, 3))
        begun = tuple(start.as_quat(scalar_first=True).tolist())
        q = Rotation.from_quat(turned(begun, middle * STEP), scalar_first=True)
        inside = (fine > begin - STEP / 4) & (fine < begin + duration - STEP / 4)
        at = np.flatnonzero(inside)[::2]  # 10 Hz
        recorded = self.readings(kind, orbit, fine[at], q[at], w[at], wd[at])
        tags = begin + 0.25 * np.arange(int(duration * 4))
        late = Rotation.from_rotvec(self.effects.get("tracker_misalignment", np.zeros(3)))
        seen = Slerp(fine, q)(tags - self.delay) * late
        seen = seen * Rotation.from_rotvec(noise.coloured(self.rng("camera", kind), len(tags), CAMERA, 4.0))
        names = ("V_x1", "V_x2", "V_x3", "V_y", "V_z1", "V_z2")
        columns = {name: (("time",), recorded[:, n], "V") for n, name in enumerate(names)}
        quaternion = {"q": (("time", "element"), seen.as_quat(scalar_first=True), "1")}
        whole, vector = begin + np.arange(int(duration) + 1), ("time", "axis")
        states = {
            "position": (vector, orbit.position(whole), "m"),
            "velocity": (vector, orbit.velocity(whole), "m s-1"),
        }
        for product, time, content in (("IS1", begin + 0.1 * np.arange(len(at)), columns), ("ATT", tags, quaternion)):
            netcdf(Path(folder) / f"{product}_{name}_T_01.nc", "Taiji-1", day + time, content)
        netcdf(Path(folder) / f"ORB_{name}_T_01.nc", "Taiji-1", day + whole, states)

    def readings(self, kind, orbit, t, q, w, wd):
        """Recorded voltages."""
        matrix = q.as_matrix()
        gradient = matrix.transpose(0, 2, 1) @ orbit.gradient(t) @ matrix
        u = 2 * np.pi * t / 5810.0
        push = np.stack([0 * t, np.full_like(t, -3e-8), -5e-8 * (1 + 0.25 * np.sin(u) + 0.1 * np.cos(2 * u))], -1)
        p = self.offset
        linear = (q.inv() * flight(orbit, t)).apply(push) - self.bias - np.einsum("nij,j->ni", gradient, p)
        linear += np.cross(w, np.cross(w, p)) + np.cross(wd, p)
        linear += noise.coloured(self.rng("force", kind), len(t), FORCE)
        twist = INERTIA @ gradient - gradient @ INERTIA
        pull = np.stack([twist[:, 2, 1], twist[:, 0, 2], twist[:, 1, 0]], -1)
        angular = wd + (np.cross(w, w @ INERTIA) - pull) / np.diag(INERTIA) + self.angular_bias
        linear = linear @ (np.eye(3) + np.asarray(self.effects.get("cross", np.zeros((3, 3))))).T
        if "odd_telegraph" in self.effects:  # in no list: m s-2 along x, y, z, changes per second
            e = self.effects["odd_telegraph"]
            flips = np.cumsum(self.rng("telegraph", kind).exponential(1 / e["rate_hz"], int(1.5 * len(t))))
            linear += np.outer(1.0 - 2.0 * (np.searchsorted(flips, t - t[0]) % 2), e["value"])
        volts = voltages(linear, angular, self.k, self.beta)
        bent = np.repeat(np.asarray(self.effects.get("quadratic", np.zeros(3)), float), [3, 1, 2])  # 1/V: V + bent V^2
        volts = volts - bent * volts**2
        both = [noise.coloured(self.rng("volts", kind, n), len(t), VOLTS) for n in range(2)]
        return volts + np.hstack(both)


def make_event(folder, seed, effects=None, roll_s=10500.0):
    """Write the files of a swing and, unless `roll_s` is zero, of a roll on the next day; return the truth.

    Effects are {name: value} of `EFFECTS`: quadratic (3) of x, y, z electrodes in 1/V, cross (3, 3) of the linear
    readouts, tracker_misalignment (3) rad, odd_telegraph {"value": (3) m s-2, "rate_hz"}; roll_s: length of the roll.
    """
    effects = effects or {}
    if unknown := effects.keys() - set(EFFECTS):
        raise ValueError(f"not known: {unknown}")
    sensor = Sensor(seed, effects)
    sensor.write(folder, "swing", 7000.0, 1000.0)
    if roll_s:
        sensor.write(folder, "roll", 1000.0, roll_s)
    names = {"k": sensor.k, "beta": sensor.beta, "com_to_test_mass_um": 1e6 * sensor.offset, "bias": sensor.bias}
    return {n: v.tolist() for n, v in names.items()} | {"delay_s": sensor.delay, "effects": effects, "seed": seed}
