"""Quaternions and rotations between frames.

A quaternion is scalar first, of unit norm, with the meaning of SCA1B: q = (cos(phi/2), n sin(phi/2)) turns the inertial
frame by phi about n into the body frame. ``R_bi`` takes inertial components to body components: v_b = R_bi @ v_i.
"""

import numpy as np
import scipy

from gravcal.physics import check_increasing, check_shape, refuse


def cross_matrix(vector):
    """Matrix (..., 3, 3) of the cross product with vectors (..., 3): matrix @ u = vector x u."""
    v = check_shape("cross_matrix", vector, (..., 3))
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return matrix


def vex(matrix):
    """Vector (..., 3) of an antisymmetric matrix (..., 3, 3), elements 32, 13, 21: the inverse of cross_matrix."""
    S = check_shape("vex", matrix, (..., 3, 3))
    return np.stack([S[..., 2, 1], S[..., 0, 2], S[..., 1, 0]], axis=-1)


def R_bi_from_quaternion(quaternion):
    """Rotation (..., 3, 3) from inertial to body components, from quaternions (..., 4), scalar first.

    Notes
    -----
    R_bi = (s^2 - v.v) 1 + 2 v v^T - 2 s [v x]; Remote Sens. 2022, 14, 4030, eq. 11.
    """
    return np.swapaxes(_unflatten(scipy.spatial.transform.Rotation.as_matrix, quaternion, (4,)), -1, -2)


def quaternion_from_R_bi(R_bi):
    """Quaternion (..., 4), scalar first and not negative, of rotations (..., 3, 3) from inertial to body components."""
    R = check_shape("quaternion_from_R_bi", R_bi, (..., 3, 3))
    rotation = scipy.spatial.transform.Rotation.from_matrix(np.swapaxes(R, -1, -2).reshape(-1, 3, 3))
    return rotation.as_quat(canonical=True, scalar_first=True).reshape(*R.shape[:-2], 4)


def quaternion_product(left, right):
    """Hamilton product (..., 4) = (a0 b0 - a.b, a0 b + b0 a + a x b) of quaternions (..., 4), scalar first."""
    a, b = check_shape("quaternion_product", left, (..., 4)), check_shape("quaternion_product", right, (..., 4))
    a0, a1, a2, a3 = np.moveaxis(a, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(b, -1, 0)
    scalar, x = a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3, a0 * b1 + b0 * a1 + a2 * b3 - a3 * b2
    y, z = a0 * b2 + b0 * a2 + a3 * b1 - a1 * b3, a0 * b3 + b0 * a3 + a1 * b2 - a2 * b1
    return np.stack([scalar, x, y, z], axis=-1)


def conjugate(quaternion):
    """The opposite rotation: quaternions (..., 4), scalar first, with the other sign of the vector part."""
    return check_shape("conjugate", quaternion, (..., 4)) * np.array([1.0, -1.0, -1.0, -1.0])


def flight_frame(state_i):
    """R_oi (n, 3, 3) of x radially outward, z along the flight, y = z x x, from states (n, 6) m and m s-1."""
    position, velocity = state_i[:, :3], state_i[:, 3:]
    x = position / np.linalg.norm(position, axis=1, keepdims=True)
    y = np.cross(velocity, position)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def continuous(quaternion):
    """The same attitudes (n, 4), scalar first, with signs such that neighbours are close: q and -q are one attitude."""
    q = check_shape("continuous", quaternion, (None, 4))
    sign = np.where(np.cumsum(np.einsum("ij,ij->i", q[1:], q[:-1]) < 0) % 2, -1.0, 1.0)
    return np.concatenate([q[:1], q[1:] * sign[:, None]])


def from_rotation_vector(angle_b):
    """Quaternion (..., 4) = (cos(phi/2), n sin(phi/2)) of rotation vectors (..., 3) rad; scalar not negative to pi."""
    angle = check_shape("from_rotation_vector", angle_b, (..., 3))
    q = scipy.spatial.transform.Rotation.from_rotvec(angle.reshape(-1, 3)).as_quat(scalar_first=True)
    return q.reshape(*angle.shape[:-1], 4)


def rotation_vector(quaternion):
    """Angle times axis (..., 3) rad of quaternions (..., 4), scalar first; angle from 0 to pi, same for q and -q."""
    return _unflatten(scipy.spatial.transform.Rotation.as_rotvec, quaternion, (4,))


def attitude_error(quaternion, reference):
    """Small rotation angle_b (..., 3) rad: quaternion = reference * from_rotation_vector(angle_b), both (..., 4)."""
    return rotation_vector(quaternion_product(conjugate(reference), quaternion))


def interpolate(time, quaternion, at):
    """Attitude (m, 4), signs continuous, at epochs `at` (m,) s: constant rate from each known epoch to the next.

    Times (n,) s increase; quaternions (n, 4), scalar first, have any signs; an epoch (m,) outside is refused.
    """
    time, at = check_increasing("interpolate: time", time), np.asarray(at, float)
    if at.size and not (time[0] <= at.min() and at.max() <= time[-1]):
        span, expected = f"epochs {at.min():.6f} to {at.max():.6f} s", f"{time[0]:.6f} to {time[-1]:.6f} s"
        refuse("interpolate: at", span, expected, "Attitude is not extrapolated; cut the epochs.")
    known = check_shape("interpolate", quaternion, (time.size, 4))
    first, last = np.searchsorted(time, (at.min(), at.max())) if at.size else (0, 0)
    near = slice(max(first - 1, 0), max(last + 1, 2))  # of a day, a few minutes may be asked for
    rotation, origin = scipy.spatial.transform.Rotation.from_quat(known[near], scalar_first=True), time[0]
    slerp = scipy.spatial.transform.Slerp(time[near] - origin, rotation)
    return continuous(slerp(at - origin).as_quat(scalar_first=True))


def _unflatten(method, quaternion, core):  # method of Rotation applied to unit quaternions (..., 4), axes kept
    q = check_shape(method.__name__, quaternion, (..., *core))
    if not np.all(np.abs(np.einsum("...i,...i->...", q, q) - 1) < 1e-6):
        worst = np.linalg.norm(q, axis=-1).ravel()
        worst = worst[np.nanargmax(np.abs(worst - 1))] if np.any(np.isfinite(worst)) else np.nan
        refuse(method.__name__, f"a quaternion of norm {worst:.9f}", "norm 1 within 5e-7", "Flag it or normalise it.")
    values = method(scipy.spatial.transform.Rotation.from_quat(q.reshape(-1, 4), scalar_first=True))
    return values.reshape(*q.shape[:-1], *values.shape[1:])
