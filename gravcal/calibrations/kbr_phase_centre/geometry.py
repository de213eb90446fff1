"""Line of sight in both satellites: observation columns, pointing angles, the part square in the offsets."""

from __future__ import annotations

import numpy as np

from gravcal.physics import frames, kinematics


def lines_of_sight(position_i: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Unit vector from each satellite to the other in its own body frame.

    The range of the phase centres is |u| - l_A . c_A - l_B . c_B to first order, so the observation columns are minus
    these vectors for both satellites.

    Parameters
    ----------
    position_i : (2, n, 3) m
    quaternion : (2, n, 4) scalar first

    Returns
    -------
    line_of_sight_b : (2, n, 3)

    Notes
    -----
    rho_KBR - rho_COM = [-e^T R_ib,A, +e^T R_ib,B] (c_A; c_B); Remote Sens. 2022, 14, 3395, eq. 13 (erratum K-1: printed
    with the opposite sign). l_A = R_bi,A e, l_B = -R_bi,B e.
    """
    u = position_i[1] - position_i[0]
    e = u / np.linalg.norm(u, axis=1, keepdims=True)
    result = np.full((2, *e.shape), np.nan)
    for k, line in enumerate((e, -e)):
        known = np.isfinite(quaternion[k]).all(axis=1)
        result[k, known] = np.matvec(frames.R_bi_from_quaternion(quaternion[k, known]), line[known])
    return result


def angles(line_of_sight_b: np.ndarray) -> np.ndarray:
    """Pitch and yaw of the line of sight in the body.

    A positive offset has the columns (-cos, +sin) for pitch (x, z) and (-cos, -sin) for yaw (x, y).

    Parameters
    ----------
    line_of_sight_b : (..., 3)

    Returns
    -------
    angle : (..., 2) rad
    """
    x, y, z = np.moveaxis(line_of_sight_b, -1, 0)
    return np.stack([np.arctan2(-z, x), np.arctan2(y, x)], axis=-1)


def distance(position_i: np.ndarray) -> np.ndarray:
    """Range of the centres of mass (n,) m from positions (2, n, 3) m."""
    return kinematics.range_between(position_i[1] - position_i[0])


def second_order(position_i: np.ndarray, quaternion: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """What the linear columns leave out of the range, for phase centres near their nominal place.

    Parameters
    ----------
    position_i : (2, n, 3) m
    quaternion : (2, n, 4) scalar first
    nominal : (2, 3) m, centre of mass to phase centre, b

    Returns
    -------
    remainder : (n,) m

    Notes
    -----
    |u + v| - |u| - e.v = |v_perp|^2 / (2 |u|), 13 nm at 3 deg and 220 km; equations.md M3.
    """
    u = position_i[1] - position_i[0]
    rho = np.linalg.norm(u, axis=1)
    v = np.full_like(u, np.nan)
    known = np.isfinite(quaternion).all(axis=(0, 2))
    R = [frames.R_bi_from_quaternion(q[known]) for q in quaternion]
    v[known] = np.einsum("nji,j->ni", R[1], nominal[1]) - np.einsum("nji,j->ni", R[0], nominal[0])
    across = v - u * (np.einsum("ni,ni->n", u, v) / rho**2)[:, None]
    return np.einsum("ni,ni->n", across, across) / (2 * rho)
