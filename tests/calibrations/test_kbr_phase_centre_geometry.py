"""Line of sight, pointing angles and the antenna correction."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.calibrations.kbr_phase_centre import model
from gravcal.physics import frames
from gravcal.simulation import kbr_phase_centre as simulation

RHO, X = 220e3, 1.444  # m
POSITION = np.array([[[7e6, 0, 0]], [[7e6, RHO, 0]]], dtype=float)


def facing(angle_a, angle_b=(0.0, 0.0, 0.0)):
    """Attitudes (2, 1, 4) of a pair with roll, pitch and yaw (rad) against the line of sight."""
    states = [np.concatenate([p, np.zeros((1, 3))], axis=1) for p in POSITION]
    return np.stack(
        [
            frames.quaternion_product(frames.quaternion_from_R_bi(R), simulation.turned(np.array([angle])))
            for R, angle in zip(simulation.nominal(*states), (angle_a, angle_b), strict=True)
        ]
    )


def exact(quaternion, centre):
    """Range of the phase centres minus that of the centres of mass, m."""
    u = POSITION[1] - POSITION[0]
    R = frames.R_bi_from_quaternion(quaternion)
    v = np.einsum("nji,j->ni", R[1], centre[1]) - np.einsum("nji,j->ni", R[0], centre[0])
    return np.linalg.norm(u + v, axis=1) - np.linalg.norm(u, axis=1)


def test_the_columns_have_the_sign_of_the_exact_range():
    """Analytic: at 3 deg the range of 220 km is 2.886 m shorter; eq. 13 as printed makes it longer (K-1)."""
    quaternion = facing([0, np.radians(3), 0])
    centre = np.array([[X, 0, 0], [X, 0, 0]])
    line = model.lines_of_sight(POSITION, quaternion)
    first_order = -model.antenna_correction(line, centre)
    assert_allclose(first_order, -2.88602, atol=1e-5)  # -X (1 + cos 3 deg), to the last digit given
    remainder = model.second_order(POSITION, quaternion, centre)
    assert_allclose(first_order + remainder, exact(quaternion, centre), atol=3e-11)  # rounding of 2e5 m


def test_the_remainder_is_thirteen_nanometres_at_three_degrees():
    """Published: equations.md M3, |v_perp|^2 / (2 rho) = 13 nm at 3 deg, 1.44 m, 220 km."""
    centre = np.array([[1.44, 0, 0], [1.44, 0, 0]])
    found = model.second_order(POSITION, facing([0, np.radians(3), 0]), centre)
    assert_allclose(found, 13e-9, atol=0.5e-9)


def test_pitch_and_yaw_come_back_with_their_signs():
    """Analytic: a body turned by (roll, -pitch, -yaw) sees the line of sight at +pitch and +yaw."""
    for angle in ([0.0, 0.03, 0.0], [0.0, 0.0, 0.03], [0.0, -0.03, 0.0]):
        line = model.lines_of_sight(POSITION, facing(angle, angle))
        assert_allclose(model.angles(line)[:, 0], [angle[1:], angle[1:]], atol=1e-14)


def test_a_positive_offset_has_the_columns_of_the_tan_law():
    """Analytic: columns -cos, +sin for pitch (x, z) and -cos, -sin for yaw (x, y); erratum K-2."""
    t = np.radians(2)
    pitch = -model.lines_of_sight(POSITION, facing([0, t, 0]))[0, 0]
    yaw = -model.lines_of_sight(POSITION, facing([0, 0, t]))[0, 0]
    assert_allclose(pitch, [-np.cos(t), 0, np.sin(t)], atol=1e-14)
    assert_allclose(yaw, [-np.cos(t), -np.sin(t), 0], atol=1e-14)


def test_unknown_attitude_gives_no_line_of_sight():
    """Contract: NaN in, NaN out, without a warning."""
    quaternion = facing([0, 0, 0])
    quaternion[1] = np.nan
    line = model.lines_of_sight(POSITION, quaternion)
    assert np.isfinite(line[0]).all()
    assert np.isnan(line[1]).all()
    assert np.isnan(model.second_order(POSITION, quaternion, np.ones((2, 3)))).all()
