"""Gravity of the Earth along an orbit: acceleration and gradient of point mass and flattening.

A field of full degree can stand beside these functions: same arguments, same shapes.
"""

import numpy as np

from gravcal.physics import check_shape, refuse
from gravcal.physics.constants import EARTH_RADIUS, GM, J2

NORTH = (0.0, 0.0, 1.0)  # the z axis of i; the pole of date differs by 20 arcseconds a year, 1e-7 of the J2 term


def acceleration_i(position_i, j2=J2, pole_i=NORTH):
    """Gravitational acceleration of point mass and J2.

    Parameters
    ----------
    position_i : (..., 3) m, from the Earth's centre
    j2 : float, 0 for a point mass
    pole_i : (3,) unit vector of the figure axis

    Returns
    -------
    acceleration_i : (..., 3) m s-2

    Notes
    -----
    g = -mu r/r^3 - 3/2 J2 mu R^2/r^5 [(1 - 5 z^2/r^2) r + 2 z k], z = r.k; Montenbruck and Gill 2000, eq. 3.29 ff.
    """
    r, k = check_shape("position_i", position_i, (..., 3)), check_shape("pole_i", pole_i, (3,))
    distance = _distance(r)[..., None]
    z = (r @ k)[..., None]
    factor = -1.5 * j2 * GM * EARTH_RADIUS**2 / distance**5
    return -GM * r / distance**3 + factor * ((1 - 5 * z**2 / distance**2) * r + 2 * z * k)


def gradient_i(position_i, j2=J2, pole_i=NORTH):
    """Gravity-gradient tensor dg/dr (..., 3, 3) s-2 of point mass and J2, symmetric, without trace.

    All elements are computed from their own terms; arguments as of acceleration_i.

    Notes
    -----
    G = mu/r^3 (3 e e^T - 1) (equations.md section 1) plus the derivative of the J2 term of acceleration_i.
    """
    r, k = check_shape("position_i", position_i, (..., 3)), check_shape("pole_i", pole_i, (3,))
    d = _distance(r)[..., None, None]
    z = (r @ k)[..., None, None]
    one, rr = np.eye(3), r[..., :, None] * r[..., None, :]
    rk = r[..., :, None] * k
    point_mass = GM / d**3 * (3 * rr / d**2 - one)
    u = z / d
    even = (1 - 5 * u**2) * one - (5 - 35 * u**2) * rr / d**2 + 2 * k[:, None] * k
    mixed = 10 * u / d * (rk + rk.swapaxes(-1, -2))
    return point_mass - 1.5 * j2 * GM * EARTH_RADIUS**2 / d**5 * (even - mixed)


def rotate_tensor(R_ab, tensor_b):
    """Second-order tensor (..., 3, 3) in another frame: R T R^T, R = R_ab takes it from b to a."""
    R = check_shape("rotate_tensor", R_ab, (..., 3, 3))
    return R @ tensor_b @ np.swapaxes(R, -1, -2)


def _distance(r):
    distance = np.linalg.norm(r, axis=-1)
    if np.any(distance < 1e6):
        found = f"{distance.min():.3f} m from the Earth's centre"
        refuse("position_i", found, "an orbit", "Give metres, not kilometres.")
    return distance
