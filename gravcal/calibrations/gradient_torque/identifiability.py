"""What one sensor can tell: rank, combinations it does not see, and what each piece of prior knowledge adds."""

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.gradient_torque import laws
from gravcal.physics.frames import cross_matrix
from gravcal.physics.sensing import offset_tensor

#: Independent elements of a symmetric tensor without trace; zz is -xx - yy.
ELEMENTS = np.array(
    [
        [[1, 0, 0], [0, 0, 0], [0, 0, -1]],
        [[0, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
    ],
    dtype=float,
)
UNKNOWNS = ("G_xx", "G_yy", "G_xy", "G_xz", "G_yz", "drag_x", "drag_y", "drag_z")
GRADIENT_SCALE, DRAG_SCALE = 1e-6, 1e-7  # s-2, m s-2; unknowns of one size, so that a rank means something
TOLERANCE = 1e-9  # singular values below this share of the largest count as zero


@dataclass(frozen=True)
class Sensor:
    """One sensor on a satellite.

    inertia, test_mass_inertia : (3, 3) kg m2
    mass : kg
    place, pressure : (3,) m, test mass and centre of pressure from the CoM
    """

    inertia: np.ndarray
    test_mass_inertia: np.ndarray
    mass: float
    place: np.ndarray
    pressure: np.ndarray


def single_epoch(sensor):
    """Rank and null space of six readings for five elements of the tensor and three of the drag.

    Parameters
    ----------
    sensor : Sensor

    Returns
    -------
    rank : int
    null_space : (k, 8) combinations of UNKNOWNS in units of 1e-6 s-2 and 1e-7 m s-2 that change no reading

    Notes
    -----
    equations.md, erratum S-8: eight unknowns, rank six; the diagonal of the tensor enters no torque.
    """
    linear = np.concatenate([ELEMENTS @ sensor.place, -np.eye(3)]).T
    angular = np.concatenate([_turning(sensor), -_arm(sensor)]).T
    scale = np.array([GRADIENT_SCALE] * 5 + [DRAG_SCALE] * 3)
    return _rank_and_null(np.concatenate([linear, angular]) * scale)


def printed_pair(h, q_d):
    """Rank and null vector of the printed pair a = Dg - a_drag, al = h x Dg - q_d x a_drag.

    Parameters
    ----------
    h, q_d : (3,) m-1, laws.printed_vectors

    Returns
    -------
    rank : int
    null : (6,) unit vector of (Dg, drag); along q_d - h in both halves (erratum S-6)
    """
    size = np.linalg.norm(h)
    top = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
    below = np.concatenate([cross_matrix(h), -cross_matrix(q_d)], axis=1) / size
    rank, null = _rank_and_null(np.concatenate([top, below]))
    return rank, null[0]


def joint(sensor, motion, sigmas):
    """Rank and errors of several epochs together, with one piece of knowledge after the other.

    Parameters
    ----------
    sensor : Sensor
    motion : gradient_b (n, 3, 3), rate_b, rate_dot_b, drag_b (n, 3)
    sigmas : dict of standard deviations: linear (3,) m s-2, angular (3,) rad s-2, place (3,) m, gradient s-2,
        pressure (3,) m, torque N m (from epoch to epoch), motion (3,) rad s-2

    Returns
    -------
    steps : list of (what is known, rank, unknowns, sigma of the drag in the middle (3,), NaN if not determined)

    Notes
    -----
    Unknowns of each epoch: drag, five elements of G, angular acceleration, torque beside gradient and drag; of all
    epochs: centre of pressure and place of the test mass. Equations: reading, angular reading, torque balance.
    """
    count = len(motion["drag_b"])
    rows = [_readings(sensor, motion, sigmas, count)]
    knowledge = [
        ("readings and torque balance", None),
        ("place of the test mass", _prior(count, slice(3, 6), 1 / np.asarray(sigmas["place"]), shared=True)),
        ("gravity field", _prior(count, slice(3, 8), 1 / (sigmas["gradient"] * np.ones(5)))),
        ("smooth rotation, star camera", _prior(count, slice(8, 11), 1 / np.asarray(sigmas["motion"]))),
        ("centre of pressure", _prior(count, slice(0, 3), 1 / np.asarray(sigmas["pressure"]), shared=True)),
        ("slow torque", _steady(count, slice(11, 14), 1 / sigmas["torque"])),
        ("place of the test mass to 1 um", _prior(count, slice(3, 6), np.full(3, 1e6), shared=True)),
    ]
    steps = []
    for name, added in knowledge:
        rows += [] if added is None else [added]
        rank, sigma = _summary(np.concatenate(rows), count)
        steps.append((name, rank, 14 * count + 6, sigma))
    return steps


def _turning(sensor):
    """Relative angular acceleration for each element of the tensor, (5, 3)."""
    return laws.gradient_angular_acceleration(sensor.test_mass_inertia, sensor.inertia, ELEMENTS)


def _arm(sensor):
    """Angular acceleration of the satellite for each component of the drag, (3, 3), as rows."""
    return sensor.mass * (np.linalg.inv(sensor.inertia) @ cross_matrix(sensor.pressure)).T


def _readings(sensor, motion, sigmas, count):
    """Rows of the three equations of all epochs, whitened; 9 rows an epoch."""
    out = np.zeros((count, 9, 14 * count + 6))
    J = sensor.inertia
    free = laws.free_mass_angular_acceleration(sensor.test_mass_inertia, ELEMENTS, np.zeros(3)).T
    balance = np.stack([_vex(J @ E - E @ J) for E in ELEMENTS], axis=1)
    for k in range(count):
        tensor = offset_tensor(motion["rate_b"][k], motion["rate_dot_b"][k], motion["gradient_b"][k])
        block = np.zeros((9, 14))
        block[:3, :3], block[:3, 3:8], block[:3, 8:11] = (
            -np.eye(3),
            (ELEMENTS @ sensor.place).T,
            cross_matrix(sensor.place),
        )
        block[3:6, 3:8], block[3:6, 8:11] = free, -np.eye(3)
        block[6:, :3], block[6:, 3:8] = -sensor.mass * cross_matrix(sensor.pressure), -balance
        block[6:, 8:11], block[6:, 11:14] = J, -np.eye(3)
        out[k, :, 14 * k : 14 * k + 14] = block
        out[k, 6:, -6:-3] = sensor.mass * cross_matrix(motion["drag_b"][k])
        out[k, :3, -3:] = -tensor
    exact = 1e-3 * np.asarray(sigmas["angular"]) * np.diag(J)  # the balance is an identity
    weight = 1 / np.concatenate([sigmas["linear"], sigmas["angular"], exact])
    return (out * weight[:, None]).reshape(9 * count, -1)


def _prior(count, part, weight, shared=False):
    """Rows that hold a part of the unknowns, of every epoch or the shared ones."""
    size = part.stop - part.start
    starts = [14 * count + part.start] if shared else [14 * k + part.start for k in range(count)]
    out = np.zeros((len(starts) * size, 14 * count + 6))
    for row, start in enumerate(starts):
        for i in range(size):
            out[row * size + i, start + i] = weight[i]
    return out


def _steady(count, part, weight):
    """Rows that hold the change from epoch to epoch."""
    rows = _prior(count, part, np.full(3, weight))
    return rows[3:] - rows[:-3]


def _summary(rows, count):
    """Rank, and the sigma of the drag in the middle where it is determined."""
    scale = np.concatenate([np.tile([1e-7] * 3 + [1e-6] * 5 + [1e-8] * 3 + [1e-5] * 3, count), [0.1] * 3 + [1e-3] * 3])
    scaled = rows * scale
    scaled = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    rank, null = _rank_and_null(scaled)
    weighted = rows * scale
    _, size, right = np.linalg.svd(weighted, full_matrices=False)
    kept = size > 1e-13 * size[0]
    inverse = (right[kept].T / size[kept] ** 2) @ right[kept]
    at = slice(14 * (count // 2), 14 * (count // 2) + 3)
    sigma = np.sqrt(np.diag(inverse)[at]) * scale[at]
    lost = np.abs(null[:, at]).max(axis=0, initial=0.0) > 1e-6
    return rank, np.where(lost, np.nan, sigma)


def _rank_and_null(matrix):
    """Numerical rank and an orthonormal basis of the null space, as rows; rows of the matrix of one size."""
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300)
    _, size, right = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(size > TOLERANCE * size[0]))
    return rank, right[rank:]


def _vex(S):
    return np.array([S[2, 1], S[0, 2], S[1, 0]])
