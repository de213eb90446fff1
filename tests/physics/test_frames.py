"""Quaternions and rotations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import frames


def random_quaternions(n, seed=0):
    """Uniform attitudes."""
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_the_rotation_has_the_printed_elements():
    """Published: Remote Sens. 2022, 14, 4030, eq. 11, q0 scalar; turned by +90 deg about z b sees x of i along -y."""
    q = random_quaternions(5)
    q0, q1, q2, q3 = q.T
    rows = [
        [2 * (q0**2 + q1**2) - 1, 2 * (q1 * q2 + q0 * q3), 2 * (q1 * q3 - q0 * q2)],
        [2 * (q1 * q2 - q0 * q3), 2 * (q0**2 + q2**2) - 1, 2 * (q2 * q3 + q0 * q1)],
        [2 * (q1 * q3 + q0 * q2), 2 * (q2 * q3 - q0 * q1), 2 * (q0**2 + q3**2) - 1],
    ]
    assert_allclose(frames.R_bi_from_quaternion(q), np.moveaxis(np.array(rows), -1, 0), atol=1e-15)  # rounding
    assert_allclose(frames.R_bi_from_quaternion([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]) @ [1, 0, 0], [0, -1, 0], atol=1e-16)


def test_products_compose_attitudes_and_matrices_and_vectors_return():
    """Analytic: R_bi(p q) = R_bi(q) R_bi(p), u_i = q u_b q*; round trips up to the common sign; [v x] u = v x u."""
    p, q = random_quaternions(4, 1), random_quaternions(4, 2)
    product = frames.R_bi_from_quaternion(frames.quaternion_product(p, q))
    assert_allclose(product, frames.R_bi_from_quaternion(q) @ frames.R_bi_from_quaternion(p), atol=1e-15)  # rounding
    u_b = np.array([0, 1.0, -2.0, 0.5])
    u_i = frames.quaternion_product(frames.quaternion_product(q, np.tile(u_b, (4, 1))), frames.conjugate(q))
    assert_allclose(np.matvec(frames.R_bi_from_quaternion(q), u_i[:, 1:]), np.tile(u_b[1:], (4, 1)), atol=1e-15)
    q = random_quaternions(100)
    for back in (
        frames.quaternion_from_R_bi(frames.R_bi_from_quaternion(q)),
        frames.from_rotation_vector(frames.rotation_vector(q)),
    ):
        assert_allclose(np.abs(np.einsum("ij,ij->i", back, q)), 1, atol=1e-14)  # rounding
    v, u = np.random.default_rng(4).normal(size=(2, 7, 3))
    assert_allclose(np.matvec(frames.cross_matrix(v), u), np.cross(v, u), atol=1e-15)  # rounding
    assert_allclose(frames.vex(frames.cross_matrix(v)), v, atol=0)


def test_the_attitude_error_is_resolved_in_the_body():
    """Analytic: R_bi of the perturbed attitude is (1 - [angle x]) R_bi to first order."""
    q, angle = random_quaternions(3), np.array([1e-6, -2e-6, 3e-6])
    turned = frames.quaternion_product(q, np.tile(frames.from_rotation_vector(angle), (3, 1)))
    assert_allclose(frames.attitude_error(turned, q), np.tile(angle, (3, 1)), atol=1e-15)
    expected = (np.eye(3) - frames.cross_matrix(angle)) @ frames.R_bi_from_quaternion(q)
    assert_allclose(frames.R_bi_from_quaternion(turned), expected, atol=1e-11)  # second order


def test_sign_flips_are_removed_and_interpolation_is_blind_to_them():
    """Analytic: a smooth motion with random signs comes back; 1 mrad/s about a fixed axis, GPS seconds of today."""
    angle = np.linspace(0, 20, 200)
    smooth = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=-1)
    sign = np.random.default_rng(3).choice([-1.0, 1.0], 200)
    sign[0] = 1
    assert_allclose(frames.continuous(smooth * sign[:, None]), smooth, atol=0)
    time = 738849600.0 + np.arange(11.0)
    angle = 1e-3 * (time - time[0])
    q = frames.from_rotation_vector(angle[:, None] * [0.6, 0, 0.8]) * (-1.0) ** np.arange(11)[:, None]
    at = time[0] + np.array([0.0, 0.25, 5.5, 10.0])
    expected = frames.from_rotation_vector((1e-3 * (at - time[0]))[:, None] * [0.6, 0, 0.8])
    assert_allclose(frames.interpolate(time, q, at), expected, atol=1e-15)  # rounding


@pytest.mark.parametrize("bad", [[2.0, 0, 0, 0], [np.nan, 0, 0, 0], [1.0, 0, 0]])
def test_what_is_no_attitude_is_refused(bad):
    """Contract: norm, NaN and shape raise an error instead of being normalised away; so do epochs outside the data."""
    with pytest.raises(GravcalError):
        frames.R_bi_from_quaternion(bad)
    with pytest.raises(GravcalError, match="extrapolated"):
        frames.interpolate([0.0, 1.0], [[1.0, 0, 0, 0]] * 2, [1.5])
