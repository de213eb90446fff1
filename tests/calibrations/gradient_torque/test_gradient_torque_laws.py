"""Laws of S-GRS, corrected and as printed; errata S-1 to S-9."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.calibrations.gradient_torque import attitude, model
from gravcal.physics import frames, kinematics
from gravcal.physics.constants import GM
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.sensing import offset_tensor

BODY, CUBE = np.diag([110.0, 580.0, 650.0]), 7.5e-5 * np.eye(3)
MEAN_MOTION = 1.11e-3


def test_the_printed_algorithm_returns_its_closed_form():
    """Published: erratum S-6, a_16 = a_drag + p (h.Dg - q_d.a_drag)/|p|^2 with eq. 13 as truth, to 1e-15."""
    rng = np.random.default_rng(0)
    h, q_d = rng.standard_normal((2, 3))
    difference, drag = rng.standard_normal((2, 20, 3))
    linear, angular = difference - drag, np.cross(h, difference) - np.cross(q_d, drag)
    found, scalar = model.printed_drag(linear, angular, h, q_d)
    p = q_d - h
    wrong = (difference @ h - drag @ q_d)[:, None] * p / (p @ p)
    assert_allclose(found, drag + wrong, rtol=0, atol=2e-14)  # rounding of numbers of size one
    assert_allclose(scalar, 0, atol=2e-14)
    assert np.median(np.linalg.norm(wrong, axis=1) / np.linalg.norm(drag, axis=1)) > 0.1


def test_the_printed_algorithm_is_the_bare_reading():
    """Published: erratum S-8, cube, 1 mm, drag 2e-7: |a_16 + a_rel| 5e-18 m s-2, error |G r| 3e-9."""
    place, drag = np.full(3, 1e-3), np.array([[-2e-7, 1e-8, 5e-9]])
    tensor = MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0])
    linear = tensor @ place - drag
    angular = model.gradient_angular_acceleration(CUBE, BODY, tensor)[None]
    pressure = np.array([0.1, 0.0, 0.0])
    h, q_d = model.printed_vectors(BODY, CUBE, 600.0, pressure, place)
    found, _ = model.printed_drag(linear, angular, h, q_d)
    assert np.abs(found + linear).max() < 1e-17
    assert_allclose(np.linalg.norm(found - drag), np.linalg.norm(tensor @ place), rtol=1e-6)
    assert_allclose(np.linalg.norm(found - drag), 3.0e-9, rtol=0.05)
    assert_allclose(model.drag_from(linear[:, None], -tensor, [place]), drag, atol=1e-22)


def test_the_bracket_of_the_drag_torque_matters():
    """Published: erratum S-4: (I^-1 x) x a is not I^-1 (x x a) unless the inertia is isotropic."""
    x, a = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -1.0])
    assert not np.allclose(np.linalg.solve(BODY, np.cross(x, a)), np.cross(np.linalg.solve(BODY, x), a))
    _, q_d = model.printed_vectors(BODY, CUBE, 600.0, x, np.ones(3))
    assert_allclose(q_d, 600 * x / np.diag(BODY))


def test_a_cube_feels_no_gravity_gradient_torque_and_a_long_mass_does():
    """Analytic: erratum S-5; a rod's torque is 3 mu/r^3 e x (J e)."""
    e = np.array([0.6, 0.0, 0.8])
    tensor = GM / 6.87e6**3 * (3 * np.outer(e, e) - np.eye(3))
    satellite = {"test_mass": 0.54, "test_mass_inertia": 0.54 * 0.03**2 / 6 * np.eye(3)}
    cube, long = (model.box_inertia(satellite, k) for k in (1.0, 2.0))
    assert_allclose(model.free_mass_angular_acceleration(cube, tensor, np.zeros(3)), 0, atol=1e-22)
    expected = np.linalg.solve(long, 3 * GM / 6.87e6**3 * np.cross(e, long @ e))
    assert_allclose(model.free_mass_angular_acceleration(long, tensor, np.zeros(3)), expected, rtol=1e-12)
    assert_allclose(np.diag(cube), 0.54 * 0.03**2 / 6)
    assert long[0, 0] < long[1, 1]


def test_a_satellite_along_the_orbit_axes_feels_no_torque():
    """Published: erratum S-1, diagonal inertia and tensor: the true torque is zero."""
    assert_allclose(gravity_gradient_torque(BODY, MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0])), 0)


def test_two_sensors_cancel_only_in_the_middle():
    """Published: erratum S-3: 1 mm of middle leaves 3 n^2 x 1 mm, 3.7e-9 m s-2, without the mounting term."""
    tensor = offset_tensor(np.array([0, -MEAN_MOTION, 0]), np.zeros(3), MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0]))
    places, drag = np.array([[0.1, 0, 1e-3], [-0.1, 0, 1e-3]]), np.array([-1e-7, 0, 0])
    linear = np.stack([-tensor @ p - drag for p in places])
    assert_allclose(model.drag_from(linear, tensor, places), drag, atol=1e-22)
    assert_allclose(np.linalg.norm(-linear.mean(axis=0) - drag), 3.7e-9, rtol=0.01)


def test_errors_of_motion_reach_the_drag_as_differences_say():
    """Analytic: derivatives of T r by attitude, rate and angular acceleration against central differences."""
    rng = np.random.default_rng(1)
    w, wd, place = 1e-3 * rng.standard_normal(3), 1e-6 * rng.standard_normal(3), 0.1 * rng.standard_normal(3)
    tensor = 1e-6 * rng.standard_normal((3, 3))
    tensor = tensor + tensor.T
    parts = model.offset_tensor_error(w, tensor, place)

    def felt(angle, rate, rate_dot):
        R = frames.R_bi_from_quaternion(frames.from_rotation_vector(angle))
        return offset_tensor(w + rate, wd + rate_dot, R @ tensor @ R.T) @ place

    for k, size in enumerate((1e-4, 1e-5, 1e-8)):
        for axis in range(3):
            moves = np.zeros((3, 3))
            moves[k, axis] = size
            assert_allclose(parts[k][:, axis], (felt(*moves) - felt(*-moves)) / (2 * size), rtol=1e-6, atol=1e-14)


def test_rates_from_angles_agree_with_the_attitude():
    """Analytic: angles of 0.1 rad on a turning frame; rates of the composed attitude by seven-point differences."""
    time = np.arange(-10.0, 11.0)
    w = 2 * np.pi / 300
    size, phase = np.array([0.1, -0.05, 0.08]), np.array([0.0, 1.0, 2.0])
    u = w * time[:, None] + phase
    angle, first, second = size * np.sin(u), size * w * np.cos(u), -size * w**2 * np.sin(u)
    rate_o = np.tile([2e-4, -1.1e-3, 3e-4], (time.size, 1))
    R_oi = frames.R_bi_from_quaternion(frames.from_rotation_vector(time[:, None] * rate_o))
    R_bi = attitude.R_bo(angle) @ R_oi
    found = attitude.body_rates(angle, first, second, rate_o, np.zeros_like(rate_o))
    q = frames.continuous(frames.quaternion_from_R_bi(R_bi))
    expected = kinematics.rates_from_attitude(time, q, half_width=3, degree=6)
    assert_allclose(found[0][5:-5], expected[0][5:-5], rtol=0, atol=1e-11)
    assert_allclose(found[1][5:-5], expected[1][5:-5], rtol=0, atol=1e-11)
    assert_allclose(attitude.angles(q, R_oi), angle, atol=1e-14)


def sensor(place):
    """Assumed satellite with a cube at a place."""
    return model.Sensor(BODY, 8e-5 * np.eye(3), 600.0, np.array(place), np.array([0.1, 0.02, 0.03]))


def test_one_epoch_has_rank_six_of_eight():
    """Published: erratum S-8; at the centre of mass the drag is seen by translation alone."""
    rank, null = model.single_epoch(sensor([1e-3, 2e-3, -1e-3]))
    assert (rank, len(null)) == (6, 2)
    assert np.abs(null[:, 5:]).max() > 1e-3
    assert np.abs(null[:, 2:5]).max() < 0.01 * np.abs(null[:, :2]).max()
    rank, null = model.single_epoch(sensor([0.0, 0.0, 0.0]))
    assert rank == 6
    assert np.abs(null[:, 5:]).max() < 1e-12


def test_the_printed_pair_has_rank_five():
    """Published: erratum S-6, null vector along p = q_d - h in both halves."""
    place = np.array([1e-3, 2e-3, 1e-3])
    h, q_d = model.printed_vectors(BODY, 8e-5 * np.eye(3), 600.0, np.array([0.1, 0, 0]), place)
    rank, null = model.printed_pair(h, q_d)
    p = (q_d - h) / np.linalg.norm(q_d - h) / np.sqrt(2)
    assert rank == 5
    assert_allclose(np.abs(null @ np.concatenate([p, p])), 1, rtol=1e-9)
