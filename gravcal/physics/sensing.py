"""Acceleration at a sensor: a proof mass off the centre of mass reads f = a_ng + T p (equations.md, M1).

Every offset p points from the satellite's centre of mass (CoM) to the sensor. The CoM paper's d is -p.
"""

from gravcal.physics import check_shape
from gravcal.physics.frames import cross_matrix


def offset_tensor(rate_b, rate_dot_b, gradient_b):
    """Tensor T of the acceleration T p that a sensor at an offset p from the CoM reads in addition.

    Parameters
    ----------
    rate_b : (..., 3) rad s-1, body with respect to inertial
    rate_dot_b : (..., 3) rad s-2, its time derivative
    gradient_b : (..., 3, 3) s-2, dg/dr, symmetric

    Returns
    -------
    tensor_b : (..., 3, 3) s-2

    Notes
    -----
    T = [w' x] + [w x][w x] - G; Remote Sens. 2022, 14, 4030, eq. 1 with d = -p (equations.md, M1).
    """
    return rotation_tensor(rate_b, rate_dot_b) - check_shape("gradient_b", gradient_b, (..., 3, 3))


def rotation_tensor(rate_b, rate_dot_b):
    """The part (..., 3, 3) s-2 of the offset tensor that comes from the rotation; arguments as of offset_tensor.

    Notes
    -----
    M = [w x]^2 + [w' x]; equations.md M1, Remote Sens. 2023, 15, 3817, eq. 13 (element 31 corrected, erratum T-1).
    """
    return cross_matrix(rate_b) @ cross_matrix(rate_b) + cross_matrix(rate_dot_b)
