"""A second simulator of S-GRS records: an invented planet of degree two, a controlled rigid body, two test masses.

Section 8.5 of the equations, (M1) and (M2): a_rel = -a_drag + (G - M) r, al_rel = -wd of a cube. The field is
mu/r + mu R^2 x^T A x / r^5 with a symmetric, trace-free A, differentiated by hand; its file is written beside the data.
"""

from pathlib import Path

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from . import attitude, earth, noise
from .field import field_earth
from .orbit import flight, make_orbit
from .scene import stream
from .writer import netcdf

DATE, MASS, INERTIA = "2020-02-02", 600.2, np.diag([110.49, 580.67, 649.69])
CONTROL = (2 * np.pi * 1e-3) ** 2, 2 * 0.7 * 2 * np.pi * 1e-3  # 1 mHz, damping 0.7
#: Normalised coefficients; order two is ten times that of the Earth, so that a wrong turn of the planet is seen.
FIELD = {(2, 0): (-4.84e-4, 0.0), (2, 1): (3e-6, -2e-6), (2, 2): (2.4e-5, -1.4e-5)}
ERROR = 1e-10  # of each of them
LINEAR = dict.fromkeys("xyz", ([1e-3, 5e-3, 0.1, 0.3], [1.3e-11, 6.5e-12, 6.5e-12, 9e-12]))  # m s-2 Hz-1/2
ANGULAR = dict.fromkeys("xyz", ([2e-3, 1e-2, 0.5], [9e-10, 4.5e-10, 5.5e-10]))  # rad s-2 Hz-1/2
CAMERA = {"x": ([1e-2, 0.1], [1e-5, 5e-6])} | dict.fromkeys("yz", ([1e-2, 0.1], [8e-6, 5e-6]))  # rad Hz-1/2
TORQUE = dict.fromkeys("xyz", ([2e-4, 2e-3, 8e-3, 4e-2], [4e-5, 2e-5, 8e-7, 1e-10]))  # N m Hz-1/2
EFFECTS = ("misalignment", "residual_dipole", "mounting", "odd_rectified")


def shape(field):
    """Matrix A of normalised coefficients of degree two."""
    (c0, _), (c1, s1), (c2, s2) = (np.array(field[2, m]) * norm for m, norm in enumerate(np.sqrt([5, 5 / 3, 5 / 12])))
    plain = [[-c0 / 2 + 3 * c2, 3 * s2, 1.5 * c1], [3 * s2, -c0 / 2 - 3 * c2, 1.5 * s1], [1.5 * c1, 1.5 * s1, c0]]
    return np.array(plain)


def tensor(position, matrix):
    """Second derivatives (n, 3, 3) of the potential at Earth-fixed positions (n, 3), s-2."""
    r = np.linalg.norm(position, axis=1)[:, None, None]
    outer, bent = position[:, :, None] * position[:, None, :], position @ matrix
    mixed = bent[:, :, None] * position[:, None, :]
    level = np.einsum("ni,ni->n", bent, position)[:, None, None]
    round_part = 3 * outer / r**5 - np.eye(3) / r**3
    cross = mixed + mixed.transpose(0, 2, 1)
    flat = 2 * matrix / r**5 - (10 * cross + 5 * np.eye(3) * level) / r**7 + 35 * outer * level / r**9
    return earth.MU * (round_part + earth.EQUATOR**2 * flat)


def write_field(path):
    """The field as its user knows it (ICGEM)."""
    head = ["product_type gravity_field", "modelname second", f"earth_gravity_constant {earth.MU!r}"]
    head += [f"radius {earth.EQUATOR!r}", "max_degree 24", "errors formal", "norm fully_normalized"]
    rows = ["gfc 0 0 1.0 0.0 0.0 0.0", "gfc 1 0 0.0 0.0 0.0 0.0", "gfc 1 1 0.0 0.0 0.0 0.0"]
    rows += [f"gfc {n} {m} {c!r} {s!r} {ERROR} {ERROR if m else 0.0}" for (n, m), (c, s) in FIELD.items()]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text("\n".join([*head, "tide_system tide_free", "end_of_head", *rows]) + "\n")


@njit(cache=True)
def fly(step, envs, references, dipole, solid, gains, start):
    """Quaternion, rate and angular acceleration (n, 10) on even times; what acts is given at every half step."""
    q, w = start
    out, same = np.empty(((len(envs) + 1) // 2, 10)), (dipole, dipole, dipole)
    for k in range(len(out)):
        m, e = 2 * k + (k < len(out) - 1), 2 * k + 2 * (k < len(out) - 1)
        known = (references[2 * k], references[m], references[e]), gains
        rate_dot = attitude.rate_dot(q, w, dipole, envs[2 * k], solid, known[0][0], gains)
        out[k] = np.array(q + w + rate_dot)
        q, w = attitude.runge_kutta(q, w, step, same, (envs[2 * k], envs[m], envs[e]), solid, known)
    return out


def orbit_frame(orbit, t):
    """Rotation from x along the flight, z to nadir to GCRS."""
    return flight(orbit, t) * Rotation.from_matrix([[0, 0, -1], [0, 1, 0], [1, 0, 0]])


def motion(orbit, t, step, rng, known):
    """Attitude, rates, angular accelerations, gradient (body) and drag at times t."""
    fine = np.arange(2 * len(t) - 1) * step / 2 + t[0]
    turn = earth.gcrs_to_earth(DATE, fine)
    there = np.einsum("nij,nj->ni", turn, orbit.position(fine))
    errors = {nm: ERROR * rng("field", nm).normal(size=2) * [1, nm[1] > 0] for nm in FIELD}
    felt = shape({nm: np.array(cs) + errors[nm] for nm, cs in FIELD.items()})
    gradient = turn.transpose(0, 2, 1) @ tensor(there, felt) @ turn
    magnetic = np.einsum("nji,nj->ni", turn, field_earth(DATE, fine, there, generation=14))
    drag = noise.Smooth(rng("drag"), [-1.1e-7, 1.2e-8, -6e-9], [2e-8, 8e-9, 4e-9], [3e-9, 2e-9, 2e-9])(fine)
    torque = noise.coloured(rng("torque"), len(fine), TORQUE, 2 / step)
    torque = torque + MASS * np.cross(known["centre_of_pressure_m"], drag)
    frame = orbit_frame(orbit, fine)
    rate = (orbit_frame(orbit, fine - 0.5).inv() * orbit_frame(orbit, fine + 0.5)).as_rotvec()
    start = frame[0] * Rotation.from_rotvec(rng("start").normal(0, 2e-4, 3))
    start = tuple(start.as_quat(scalar_first=True).tolist()), tuple(rate[0].tolist())
    envs = np.concatenate([magnetic[:, None], gradient, torque[:, None]], axis=1)
    references = np.hstack([frame.as_quat(scalar_first=True), rate])
    solid = INERTIA, np.linalg.inv(INERTIA)
    table = fly(step, envs, references, tuple(known["dipole"]), solid, CONTROL, start)
    turned = Rotation.from_quat(table[:, :4], scalar_first=True)
    body = turned.as_matrix().transpose(0, 2, 1) @ gradient[::2] @ turned.as_matrix()
    return turned, table[:, 4:7], table[:, 7:], body, drag[::2]


def make_day(folder, seed, effects=None, duration_s=8000.0, step=1.0):
    """Write the record of some hours and, beside its folder, the field as field.gfc; return the truth.

    Effects are {name: value} of `EFFECTS`: misalignment (3) rad, residual_dipole (3) A m2, mounting (2, 3) m (true
    less stated place), odd_rectified (3): share of the size of the linear x reading that is added; duration_s, step s.
    """
    effects = effects or {}
    if unknown := effects.keys() - set(EFFECTS):
        raise ValueError(f"not known: {unknown}")
    rng = lambda *names: stream(seed, "gradient", *names)  # noqa: E731
    place = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]) + rng("place").normal(0, 4e-4, (2, 3))
    pressure = np.array([0.1, 0.0, 0.0]) + rng("pressure").normal(0, [0.1, 0.05, 0.05])
    known = {"centre_of_pressure_m": pressure, "dipole": np.asarray(effects.get("residual_dipole", np.zeros(3)), float)}
    day, t = earth.day_start(DATE), 30000.0 + step * np.arange(int(duration_s / step))
    elements = {"height_m": 480e3, "inclination_deg": 88.7, "eccentricity": 0.001, "spacing_s": 30.0}
    orbit = make_orbit(rng("orbit"), day + 43200, **elements)
    turned, w, wd, body, drag = motion(orbit, t, step, rng, known)
    linear, angular = [], []
    for k, r in enumerate(place + np.asarray(effects.get("mounting", np.zeros((2, 3))), float)):
        moved = np.einsum("nij,j->ni", body, r) - np.cross(w, np.cross(w, r)) - np.cross(wd, r) - drag
        moved = Rotation.from_rotvec(effects.get("misalignment", np.zeros(3))).inv().apply(moved)
        moved += np.outer(np.abs(moved[:, 0]), effects.get("odd_rectified", np.zeros(3)))
        linear.append(moved + noise.coloured(rng("linear", k), len(t), LINEAR, 1 / step))
        angular.append(-wd + noise.coloured(rng("angular", k), len(t), ANGULAR, 1 / step))
    seen = turned * Rotation.from_rotvec(noise.coloured(rng("camera"), len(t), CAMERA, 1 / step))
    series, vector = ("time", "sensor", "axis"), ("time", "axis")
    variables = {
        "linear": (series, np.stack(linear, 1), "m s-2"),
        "angular": (series, np.stack(angular, 1), "rad s-2"),
        "q": (("time", "element"), seen.as_quat(scalar_first=True), "1"),
        "position": (vector, orbit.position(t), "m"),
        "velocity": (vector, orbit.velocity(t), "m s-1"),
        "sensor_position": (("sensor", "axis"), place, "m"),
    }
    netcdf(Path(folder) / f"SGRS_{DATE}_S_01.nc", "S-GRS", day + t, variables)
    write_field(Path(folder).parent / "field.gfc")
    truth = {"centre_of_pressure_m": pressure.tolist(), "effects": effects, "seed": seed}
    return truth | {"drag": drag, "time": day + t}
