"""Torques and attitude integration."""

from dataclasses import replace

import numpy as np
import physics_references
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import dynamics, frames, gravity
from gravcal.physics.constants import GM

QUIET = {"edges": np.array([0.0, 1.0]), "dipole_b": np.zeros((1, 3)), "field_time": np.arange(0.0, 1001.0, 100.0)}
REST = dynamics.State(0.0, np.array([1.0, 0, 0, 0]), np.zeros(3))


def quiet(inertia, **changes):
    """No torque at all unless changes bring one."""
    return dynamics.Torque(**{"inertia": inertia, "field_i": np.zeros((11, 3)), **QUIET, **changes})


def test_gradient_torque_equals_the_sum_over_mass_points():
    """Analytic: 200 points of a body 1 m wide in the field of a point mass; remainder (1 m / 6900 km) of the torque."""
    rng = np.random.default_rng(1)
    mass, point = rng.uniform(1, 5, 200), rng.normal(size=(200, 3)) * [1.5, 0.5, 0.3]
    point -= mass @ point / mass.sum()
    centre = np.array([3.0e6, -4.0e6, 4.7e6])
    parts = (point**2).sum(1)[:, None, None] * np.eye(3) - point[:, :, None] * point[:, None]
    inertia = np.einsum("k,kij->ij", mass, parts)
    far = centre + point
    tidal = -GM * (far / np.linalg.norm(far, axis=1)[:, None] ** 3 - centre / np.linalg.norm(centre) ** 3)
    brute = (mass[:, None] * np.cross(point, tidal)).sum(axis=0)
    field = gravity.Field(GM, np.linalg.norm(centre), np.ones((1, 1)), np.zeros((1, 1)))
    torque = dynamics.gravity_gradient_torque(inertia, gravity.gradient_e(field, centre))
    assert_allclose(torque, brute, rtol=1e-5, atol=np.abs(brute).max() * 1e-6)  # next order of the expansion


def test_a_free_symmetric_top_precesses_at_the_known_rate():
    """Analytic: w_x + i w_y turns at (Jz - Jx)/Jx w_z; angular momentum and energy stay.

    J = diag(1, 2, 4), w = (1, 1, 0): w x J w = (0, 0, 1), so w' = (0, 0, -1/4) without torque.
    """
    J, w0 = np.diag([100.0, 100, 150]), np.array([0.01, 0, 0.05])
    at = np.linspace(0, 600, 61)
    quaternion, rate, _ = dynamics.integrate(at, dynamics.State(0.0, np.array([1.0, 0, 0, 0]), w0), quiet(J))
    phase = 0.5 * 0.05 * at
    expected = np.stack([0.01 * np.cos(phase), 0.01 * np.sin(phase), 0.05 + 0 * at], axis=-1)
    assert_allclose(rate, expected, atol=1e-14)  # rounding of 600 steps
    momentum_i = np.matvec(np.swapaxes(frames.R_bi_from_quaternion(quaternion), -1, -2), rate @ J)
    assert_allclose(momentum_i, np.tile(J @ w0, (61, 1)), atol=1e-12)  # rounding
    rate_dot = dynamics.rate_derivative(np.diag([1.0, 2, 4]), [1.0, 1, 0], np.zeros(3))
    assert_allclose(rate_dot, [0, 0, -0.25], atol=1e-16)  # rounding


def test_the_kernel_agrees_with_scipy_stopped_at_the_edges():
    """Analytic: same torque by numpy, scipy's DOP853 and splines; 1e-12 rad and 1e-14 rad/s are scipy's tolerance."""
    state, torque, at = physics_references.manoeuvre()
    quaternion, rate, _, sensitivity = dynamics.integrate_with_sensitivity(at, state, torque)
    reference, transition = physics_references.attitude_by_scipy(at, state, torque)
    assert_allclose(frames.attitude_error(quaternion, reference[:, :4]), 0, atol=2e-12)
    assert_allclose(rate, reference[:, 4:], atol=2e-14)
    assert_allclose(sensitivity[..., :6], transition, atol=1e-9)  # of 180 s


@pytest.mark.parametrize("column", range(10))
def test_every_sensitivity_equals_a_finite_difference(column):
    """Analytic: central differences of complete integrations; their own error is 1e-6 of each row's largest value."""
    state, torque, at = physics_references.manoeuvre()
    step = [1e-4, 1e-6, 1e-2, 1e-3][column // 3]
    sensitivity = dynamics.integrate_with_sensitivity(at, state, torque)[3][..., column]
    ends = (dynamics.integrate(at, *moved(state, torque, column, sign * step)) for sign in (1, -1))
    (q_plus, w_plus, _), (q_minus, w_minus, _) = ends
    angle = frames.attitude_error(q_plus, q_minus)
    half_turn = frames.from_rotation_vector(-angle / 2)  # the difference is wanted at the middle attitude
    middle = np.matvec(frames.R_bi_from_quaternion(half_turn), angle)
    numerical = np.concatenate([middle, w_plus - w_minus], axis=-1) / (2 * step)
    scale = np.abs(numerical).max(axis=0) + 1e-9
    assert_allclose(sensitivity / scale, numerical / scale, atol=2e-6)


def moved(state, torque, column, step):
    """State and torque with one parameter of SENSITIVITY_PARAMETERS changed."""
    change = np.eye(3)[column % 3] * step
    if column < 3:
        turned = frames.quaternion_product(state.quaternion, frames.from_rotation_vector(change))
        return replace(state, quaternion=turned), torque
    if column < 6:
        return replace(state, rate_b=state.rate_b + change), torque
    if column < 9:
        return state, replace(torque, scale_b=torque.scale_b + change)
    return state, replace(torque, edges=torque.edges + step)


def test_on_an_edge_the_acceleration_is_the_one_after_it():
    """Analytic: dipole y switched from +10 to -10 A m2 at 5 s in 30 uT along x: z acceleration changes sign there."""
    square = {"edges": np.array([0.0, 5.0, 10.0]), "dipole_b": np.array([[0, 10.0, 0], [0, -10.0, 0]])}
    torque = quiet(np.eye(3) * 100, **square, field_i=np.tile([30e-6, 0, 0], (11, 1)))
    at = np.array([0.0, 4.999, 5.0, 9.999, 10.0])
    for end in (3, 5):  # the edge as last epoch and in the middle
        _, rate, rate_dot = dynamics.integrate(at[:end], REST, torque)
        assert_allclose(rate_dot[:, 2], [-3e-6, -3e-6, 3e-6, 3e-6, 0][:end], rtol=1e-6, atol=1e-12)  # turned 4e-5
    assert_allclose(rate[-1, 2], 0, atol=1e-12)  # five seconds each way


def test_neither_other_epochs_nor_large_time_tags_cost_accuracy():
    """Analytic: an epoch alone and among many, 1e-13 rad; the same manoeuvre at 0 and at 2^29 s (1e-7 s a double)."""
    state, torque, _ = physics_references.manoeuvre()
    many = np.arange(0, 60, 0.1) + 0.0371
    among, _, _ = dynamics.integrate(many, state, torque)
    for i in (0, 333, 599):
        alone, _, _ = dynamics.integrate(many[i : i + 1], state, torque, max_step=0.1)
        assert_allclose(frames.attitude_error(alone, among[i : i + 1]), 0, atol=1e-13)
    near, far = (physics_references.manoeuvre(start, phase=1.25) for start in (0.0, 2.0**29))
    results = [dynamics.integrate(at, state, torque) for state, torque, at in (near, far)]
    assert_allclose(frames.attitude_error(results[0][0], results[1][0]), 0, atol=1e-14)


def test_an_extra_torque_may_ramp_and_jump():
    """Analytic: ramp 0 to 1 N m in 2 s, jump to 3, constant to 4 s, nothing after: J w = 1, 1 + 6 = 7 N m s."""
    extra = {"extra_time": np.array([0.0, 2.0, 2.0, 4.0]), "extra_b": np.outer([0, 1.0, 3, 3], [0, 0, 1])}
    torque = quiet(np.eye(3) * 1e4, **extra)
    _, rate, rate_dot = dynamics.integrate(np.array([1.0, 2.0, 3.0, 4.0, 9.0]), REST, torque, max_step=10.0)
    assert_allclose(rate[:, 2] * 1e4, [0.25, 1, 4, 7, 7], rtol=1e-13)  # rounding
    assert_allclose(rate_dot[:, 2] * 1e4, [0.5, 3, 3, 0, 0], rtol=1e-13, atol=1e-16)  # rounding


@pytest.mark.parametrize(
    ("torque", "state", "at", "message"),
    [
        ({"edges": np.array([0.0, 0.0])}, {}, [50.0], "strictly increasing"),
        ({"dipole_b": np.zeros((3, 3))}, {}, [50.0], "dipole_b"),
        ({"field_i": np.full((11, 3), np.nan)}, {}, [50.0], "not finite"),
        ({"field_time": np.arange(11.0)}, {}, [50.0], "cover"),
        ({"extra_time": np.array([1.0, 0.0]), "extra_b": np.zeros((2, 3))}, {}, [50.0], "sorted"),
        ({}, {"quaternion": np.array([1.0, 1, 0, 0])}, [1.0], "norm"),
        ({}, {"time": 5.0}, [1.0], "before the state"),
        ({}, {}, [2.0, 1.0], "sorted"),
    ],
)
def test_wrong_torques_states_and_epochs_are_refused(torque, state, at, message):
    """Contract: shape, order, coverage and NaN raise an error that names the array; so does what is no attitude."""
    with pytest.raises(GravcalError, match=message):
        dynamics.integrate(np.array(at), replace(REST, **state), replace(quiet(np.eye(3)), **torque))
