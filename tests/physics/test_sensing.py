"""What the sensors feel."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.physics import frames, gravity, sensing


def test_the_tensor_has_the_printed_elements():
    """Published: equations.md M1 and CoM paper eq. 5, A = -M element by element."""
    (wx, wy, wz), (dx, dy, dz) = w, wd = np.random.default_rng(0).normal(size=(2, 3))
    M = [
        [-(wy**2) - wz**2, wx * wy - dz, wx * wz + dy],
        [wx * wy + dz, -(wx**2) - wz**2, wy * wz - dx],
        [wx * wz - dy, wy * wz + dx, -(wx**2) - wy**2],
    ]
    A = [
        [wy**2 + wz**2, dz - wx * wy, -(wx * wz + dy)],
        [-(wx * wy + dz), wx**2 + wz**2, dx - wy * wz],
        [dy - wx * wz, -(wz * wy + dx), wx**2 + wy**2],
    ]
    assert_allclose(sensing.rotation_tensor(w, wd), M, atol=1e-15)  # rounding
    assert_allclose(-sensing.rotation_tensor(w, wd), A, atol=1e-15)


def reading_from_trajectories(offset, t):
    """Force per mass that keeps a proof mass on its path: second difference of r_p minus gravity, turned into b.

    The CoM runs on an arbitrary path with non-gravitational acceleration (2, -1, 3) e-6 m s-2 in i.
    """
    h = 0.5

    def attitude(s):
        return np.swapaxes(frames.R_bi_from_quaternion(frames.from_rotation_vector(turn(s))), -1, -2)

    tidal = gravity.gradient_i(POSITION) @ attitude(t) @ offset
    arm = [attitude(t + k * h) @ offset for k in (-2, -1, 0, 1, 2)]
    second = (-arm[0] + 16 * arm[1] - 30 * arm[2] + 16 * arm[3] - arm[4]) / (12 * h**2)
    return attitude(t).T @ (np.array([2e-6, -1e-6, 3e-6]) + second - tidal), attitude(t)


POSITION = np.array([3e6, -4e6, 4.7e6])


def turn(s):
    """A rotation vector that wobbles about all axes."""
    return np.array([0.3 * np.sin(0.03 * s), 0.2 * np.cos(0.02 * s), 0.01 * s])


def test_the_reading_is_the_force_along_the_path_of_the_proof_mass():
    """C-1 and T-2: path differentiated in the inertial frame, p from CoM to mass; 1 m, so that gravity counts."""
    offset, t, h = np.array([0.6, -0.5, 0.8]), 11.0, 1e-2
    expected, R_ib = reading_from_trajectories(offset, t)
    q = frames.from_rotation_vector(np.stack([turn(t + k * h) for k in (-2, -1, 0, 1, 2)]))
    angle = frames.attitude_error(q, np.tile(q[2], (5, 1)))
    w = (angle[0] - 8 * angle[1] + 8 * angle[3] - angle[4]) / (12 * h)
    wd = (-angle[0] + 16 * angle[1] - 30 * angle[2] + 16 * angle[3] - angle[4]) / (12 * h**2)
    tensor = sensing.offset_tensor(w, wd, gravity.rotate_tensor(R_ib.T, gravity.gradient_i(POSITION)))
    reading = R_ib.T @ [2e-6, -1e-6, 3e-6] + tensor @ offset
    assert_allclose(reading, expected, atol=1e-9)  # second differences of w'; the tidal term alone is 2e-6
