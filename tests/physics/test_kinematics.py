"""Rates from attitude, ranges from orbits."""

import numpy as np
import physics_references
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from gravcal.errors import GravcalError
from gravcal.physics import dynamics, frames, kinematics


def spinning(rate, time):
    """Attitude of a body that turns at a constant body rate, with sign flips."""
    start = frames.from_rotation_vector([0.3, -0.2, 0.9])
    turn = frames.from_rotation_vector(np.asarray(rate) * time[:, None])
    return frames.quaternion_product(np.tile(start, (time.size, 1)), turn) * (-1.0) ** np.arange(time.size)[:, None]


def test_a_constant_rate_comes_back_in_the_body_frame():
    """Analytic: erratum C-4's numbers (0.02, -0.05, 0.03) rad/s, uneven epochs; the inertial rate would be -R_ib w."""
    time = np.array([0.0, 0.9, 2.1, 3.0, 4.2, 5.0, 6.1])
    rate, rate_dot = kinematics.rates_from_attitude(time, spinning([0.02, -0.05, 0.03], time))
    assert_allclose(rate, np.tile([0.02, -0.05, 0.03], (7, 1)), atol=1e-14)  # rounding
    assert_allclose(rate_dot, 0, atol=2e-12)  # rounding, enlarged by one-sided windows


def test_the_published_rate_is_the_body_rate_with_the_gain_of_erratum_c10():
    """Analytic: eq. 15 read with R_ib returns w sin(2 a)/(2 a) for a constant rate, a = |w| h; the ends are NaN.

    Published: erratum C-10, a 12 s wave at 1 Hz: 0.955 for w, 0.912 for w' (in the small-angle limit).
    """
    time = np.arange(6.0)
    w = np.array([0.02, -0.05, 0.03])
    a = np.linalg.norm(w)
    rate, rate_dot = kinematics.published_rates_from_attitude(time, spinning(w, time))
    assert_allclose(rate[1:-1], np.tile(w * np.sin(2 * a) / (2 * a), (4, 1)), atol=1e-15)  # rounding
    assert_allclose(rate_dot[2:-2], 0, atol=1e-15)
    assert np.all(np.isnan(rate[[0, -1]]))
    assert np.all(np.isnan(rate_dot[[0, 1, -2, -1]]))
    time = np.arange(240.0)
    wave = 2 * np.pi / 12
    q = frames.from_rotation_vector((1e-6 * np.sin(wave * time))[:, None] * [0, 1.0, 0])
    rate, rate_dot = kinematics.published_rates_from_attitude(time, q)
    cosine, sine = np.cos(wave * time[2:-2]), np.sin(wave * time[2:-2])
    gain = rate[2:-2, 1] @ cosine / (1e-6 * wave) / np.sum(cosine**2)
    gain_dot = -rate_dot[2:-2, 1] @ sine / (1e-6 * wave**2) / np.sum(sine**2)
    assert_allclose([gain, gain_dot], [0.955, 0.912], atol=5e-4)  # printed digits


def test_rates_follow_an_integrated_motion():
    """Analytic: smooth torque-free tumbling at 10 Hz; order h^4 of the window."""
    none = np.array([0.0, 1]), np.zeros((1, 3)), np.arange(0, 101, 10.0), np.zeros((11, 3))
    torque, time = dynamics.Torque(np.diag([110.0, 580, 650]), *none), np.arange(0, 60, 0.1)
    state = dynamics.State(0.0, np.array([1.0, 0, 0, 0]), np.array([0.02, 0.01, -0.03]))
    q, w, wd = dynamics.integrate(time, state, torque)
    rate, rate_dot = kinematics.rates_from_attitude(time, q)
    assert_allclose(rate[2:-2], w[2:-2], atol=1e-12)
    assert_allclose(rate_dot[2:-2], wd[2:-2], atol=1e-11)


def test_a_rate_that_changes_its_direction_turns_as_its_differential_equation_says():
    """Analytic: q' = q w / 2 with w = a + b t by DOP853; a step leaves out order h^5, without its w0 x w1 1e-5 rad."""
    a, b, time = np.array([0.02, -0.01, 0.03]), np.array([-2e-3, 3e-3, 1e-3]), np.arange(0, 10.5, 0.5)

    def slope(t, q):
        s, v, w = q[0], q[1:], a + b * t
        return np.concatenate([[-v @ w], s * w + np.cross(v, w)]) / 2

    q = solve_ivp(slope, (0, 10), [1.0, 0, 0, 0], "DOP853", time, rtol=1e-12, atol=1e-14).y.T
    reached = kinematics.attitude_from_rates(time, a + b * time[:, None], q[0])
    assert_allclose(frames.attitude_error(q, reached), 0, atol=1e-8)


def test_the_window_of_the_rates_has_to_fit():
    """Contract: too few epochs and impossible degrees raise an error."""
    with pytest.raises(GravcalError, match="4 epochs"):
        kinematics.rates_from_attitude(np.arange(4.0), np.tile([1.0, 0, 0, 0], (4, 1)))
    state, _, at = physics_references.manoeuvre()
    with pytest.raises(GravcalError, match="degree 1"):
        kinematics.rates_from_attitude(at, np.tile(state.quaternion, (at.size, 1)), half_width=1, degree=1)
