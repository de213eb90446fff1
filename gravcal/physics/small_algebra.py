"""Three-dimensional algebra on tuples for compiled kernels: vectors of 3, matrices of 9 by rows, symmetric ones of 6.

A symmetric matrix is (xx, xy, xz, yy, yz, zz). Tuples live in registers, so nothing is allocated in an inner loop.
"""

from numba import njit


@njit(cache=True)
def as_tuple(matrix):
    """(3, 3) array to nine numbers by rows."""
    return (
        *(matrix[0, 0], matrix[0, 1], matrix[0, 2]),
        *(matrix[1, 0], matrix[1, 1], matrix[1, 2]),
        *(matrix[2, 0], matrix[2, 1], matrix[2, 2]),
    )


@njit(cache=True)
def cross(a, b):
    """A x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def matvec(M, v):
    """M v."""
    return (
        M[0] * v[0] + M[1] * v[1] + M[2] * v[2],
        M[3] * v[0] + M[4] * v[1] + M[5] * v[2],
        M[6] * v[0] + M[7] * v[1] + M[8] * v[2],
    )


@njit(cache=True)
def matmul(M, N):
    """M N."""
    return (
        *(M[0] * N[0] + M[1] * N[3] + M[2] * N[6], M[0] * N[1] + M[1] * N[4] + M[2] * N[7]),
        *(M[0] * N[2] + M[1] * N[5] + M[2] * N[8], M[3] * N[0] + M[4] * N[3] + M[5] * N[6]),
        *(M[3] * N[1] + M[4] * N[4] + M[5] * N[7], M[3] * N[2] + M[4] * N[5] + M[5] * N[8]),
        *(M[6] * N[0] + M[7] * N[3] + M[8] * N[6], M[6] * N[1] + M[7] * N[4] + M[8] * N[7]),
        M[6] * N[2] + M[7] * N[5] + M[8] * N[8],
    )


@njit(cache=True)
def rotation(q):
    """R_bi of a scalar-first quaternion; Remote Sens. 2022, 14, 4030, eq. 11."""
    s, x, y, z = q[0], q[1], q[2], q[3]
    return (
        *(s * s + x * x - y * y - z * z, 2 * (x * y + s * z), 2 * (x * z - s * y)),
        *(2 * (x * y - s * z), s * s - x * x + y * y - z * z, 2 * (y * z + s * x)),
        *(2 * (x * z + s * y), 2 * (y * z - s * x), s * s - x * x - y * y + z * z),
    )


@njit(cache=True)
def similarity(R, S):
    """R S R^T of a symmetric S."""
    a = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[0], R[1], R[2]))
    b = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[3], R[4], R[5]))
    c = matvec((S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5]), (R[6], R[7], R[8]))
    xx, xy, xz = matvec(R, a)
    _, yy, yz = matvec(R, b)
    return (xx, xy, xz, yy, yz, R[6] * c[0] + R[7] * c[1] + R[8] * c[2])


@njit(cache=True)
def gradient_torque(J, S):
    """vex(J G - G J) of a symmetric gradient."""
    return (
        (J[6] * S[1] + J[7] * S[3] + J[8] * S[4]) - (J[3] * S[2] + J[4] * S[4] + J[5] * S[5]),
        (J[0] * S[2] + J[1] * S[4] + J[2] * S[5]) - (J[6] * S[0] + J[7] * S[1] + J[8] * S[2]),
        (J[3] * S[0] + J[4] * S[1] + J[5] * S[2]) - (J[0] * S[1] + J[1] * S[3] + J[2] * S[4]),
    )


@njit(cache=True)
def gradient_torque_by_angle(J, S):
    """Derivative of gradient_torque for a small turn of the body: G changes by G [a x] - [a x] G; nine by rows."""
    xx, xy, xz, yy, yz, zz = S
    a = gradient_torque(J, (0.0, xz, -xy, 2 * yz, zz - yy, -2 * yz))
    b = gradient_torque(J, (-2 * xz, -yz, xx - zz, 0.0, xy, 2 * xz))
    c = gradient_torque(J, (2 * xy, yy - xx, yz, -2 * xy, -xz, 0.0))
    return (a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2])
