"""What the sensors of S-GRS feel: corrected equations (equations.md, section 8.5) and the printed ones (13-16).

Sign: the files hold the motion of a test mass relative to the satellite, minus what an accelerometer reads.
"""

import numpy as np

from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.frames import cross_matrix, quaternion_product


def relative_acceleration(drag_b, tensor_b, com_to_test_mass_b):
    """Acceleration of a test mass relative to the satellite.

    Parameters
    ----------
    drag_b : (..., 3) m s-2, non-gravitational acceleration of the CoM
    tensor_b : (..., 3, 3) s-2, T = M - G of the offset (sensing.offset_tensor)
    com_to_test_mass_b : (3,) m

    Returns
    -------
    linear_b : (..., 3) m s-2

    Notes
    -----
    a_TM/B = (G - M) r - a_drag; S-GRS paper, eqs. 4-6 with the rate terms where they belong (erratum S-2).
    """
    return -np.matvec(tensor_b, com_to_test_mass_b) - drag_b


def drag_from_one(linear_b, tensor_b, com_to_test_mass_b):
    """Drag from one sensor whose gravity gradient is modelled.

    Parameters
    ----------
    linear_b : (..., 3) m s-2, relative acceleration
    tensor_b : (..., 3, 3) s-2, T = M - G
    com_to_test_mass_b : (3,) m

    Returns
    -------
    drag_b : (..., 3) m s-2

    Notes
    -----
    a_drag = -a_TM/B + (G - M) r; equations.md, section 8.5.
    """
    return -linear_b - np.matvec(tensor_b, com_to_test_mass_b)


def drag_from_two(linear_b, tensor_b, com_to_test_mass_b):
    """Drag from two sensors, with the term of their mounting.

    Parameters
    ----------
    linear_b : (..., 2, 3) m s-2, relative accelerations
    tensor_b : (..., 3, 3) s-2, T = M - G
    com_to_test_mass_b : (2, 3) m

    Returns
    -------
    drag_b : (..., 3) m s-2

    Notes
    -----
    a_drag = -1/2 sum_k a_k + 1/2 (G - M)(r_1 + r_2); S-GRS paper, eq. 10, which lacks the second term (erratum S-3).
    """
    middle = np.mean(com_to_test_mass_b, axis=0)
    return -np.mean(linear_b, axis=-2) - np.matvec(tensor_b, middle)


def free_mass_angular_acceleration(inertia, gradient_b, rate_b):
    """Angular acceleration of a free test mass that turns with the satellite; zero for a cube (erratum S-5).

    Parameters
    ----------
    inertia : (3, 3) kg m2, of the test mass
    gradient_b : (..., 3, 3) s-2
    rate_b : (..., 3) rad s-1

    Returns
    -------
    angular_b : (..., 3) rad s-2

    Notes
    -----
    I^-1 [vex(I G - G I) - w x I w]; S-GRS paper, eqs. 1 and 7, with the inertia of the test mass (erratum S-4).
    """
    J = np.asarray(inertia, float)
    gyroscopic = np.cross(rate_b, np.matvec(J, rate_b))
    return np.matvec(np.linalg.inv(J), gravity_gradient_torque(J, gradient_b) - gyroscopic)


def gradient_angular_acceleration(test_mass_inertia, inertia, gradient_b):
    """Relative angular acceleration of test mass and satellite from the gravity gradient alone.

    Parameters
    ----------
    test_mass_inertia, inertia : (3, 3) kg m2
    gradient_b : (..., 3, 3) s-2

    Returns
    -------
    angular_b : (..., 3) rad s-2

    Notes
    -----
    I_TM^-1 vex(I_TM G - G I_TM) - I_B^-1 vex(I_B G - G I_B); S-GRS paper, eqs. 7-9.
    """
    parts = (np.asarray(J, float) for J in (test_mass_inertia, inertia))
    test_mass, body = (np.matvec(np.linalg.inv(J), gravity_gradient_torque(J, gradient_b)) for J in parts)
    return test_mass - body


def box_inertia(mass, side, elongation):
    """Inertia of a homogeneous box of the volume of a cube, longer along x.

    Parameters
    ----------
    mass : kg
    side : m, of the cube
    elongation : 1, length along x over the other two; 1 is the cube

    Returns
    -------
    inertia : (3, 3) kg m2
    """
    across = side * elongation ** (-1 / 3)
    x, y, z = np.array([elongation * across, across, across]) ** 2
    return mass / 12 * np.diag([y + z, x + z, x + y])


def offset_tensor_error(rate_b, gradient_b, offset_b):
    """Derivative of the product T p by attitude, rate and angular acceleration.

    Parameters
    ----------
    rate_b : (..., 3) rad s-1
    gradient_b : (..., 3, 3) s-2
    offset_b : (3,) m

    Returns
    -------
    by_angle, by_rate, by_rate_dot : (..., 3, 3), small rotation in b, rad s-1, rad s-2
    """
    w, p = np.asarray(rate_b, float), np.asarray(offset_b, float)
    by_rate = -cross_matrix(np.cross(w, p)) - cross_matrix(w) @ cross_matrix(p)
    by_angle = -(cross_matrix(np.matvec(gradient_b, p)) - gradient_b @ cross_matrix(p))
    return by_angle, by_rate, np.broadcast_to(-cross_matrix(p), by_rate.shape)


def printed_vectors(inertia, test_mass_inertia, mass, com_to_pressure_b, separation_b):
    """Vector parts of the printed quaternions q_H and q_drag.

    Parameters
    ----------
    inertia, test_mass_inertia : (3, 3) kg m2
    mass : kg
    com_to_pressure_b : (3,) m
    separation_b : (3,) m, Dx, no component zero

    Returns
    -------
    h, q_d : (3,) m-1

    Notes
    -----
    H = -I_B (1/Dx, 1/Dy, 1/Dz), h = (I_TM^-1 - I_B^-1) H, q_d = m_B I_B^-1 x_cp; printed eqs. 3, 13, 15.
    """
    H = -np.asarray(inertia) @ (1 / np.asarray(separation_b, float))
    h = (np.linalg.inv(test_mass_inertia) - np.linalg.inv(inertia)) @ H
    return h, mass * np.linalg.solve(inertia, com_to_pressure_b)


def printed_drag(linear_b, angular_b, h, q_d):
    """Drag by the printed one-sensor algorithm, through quaternion products.

    Parameters
    ----------
    linear_b : (n, 3) m s-2
    angular_b : (n, 3) rad s-2
    h, q_d : (3,) m-1, printed_vectors

    Returns
    -------
    drag_b : (n, 3) m s-2, vector part
    scalar : (n,) m s-2, scalar part; zero, so it gives no warning

    Notes
    -----
    a = (q_H^-1 q_drag - 1)^-1 [a_TM/B - q_H^-1 al_TM/B]; S-GRS paper, eq. 16 with the other terms zero. A quaternion
    product is not a cross product (erratum S-6).
    """
    n = len(linear_b)
    inverse = _inverse(_pure(h))
    left = quaternion_product(inverse, _pure(q_d)) - np.array([1.0, 0, 0, 0])
    right = _pure(linear_b) - quaternion_product(np.broadcast_to(inverse, (n, 4)), _pure(angular_b))
    result = quaternion_product(np.broadcast_to(_inverse(left), (n, 4)), right)
    return result[:, 1:], result[:, 0]


def _pure(vector):
    v = np.asarray(vector, float)
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)


def _inverse(quaternion):
    return quaternion * np.array([1.0, -1, -1, -1]) / np.sum(quaternion**2)
