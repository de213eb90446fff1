"""The simulated S-GRS day keeps the laws it is made of."""

import functools

import numpy as np
import pytest
from gradient_torque_days import SATELLITE, fly
from numpy.testing import assert_allclose, assert_array_equal

from gravcal.calibrations.gradient_torque.attitude import orbit_frame
from gravcal.errors import CatalogError
from gravcal.physics import frames, kinematics
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.simulation import by_slug
from gravcal.simulation import gradient_torque as simulation

HALF_HOUR = {"duration_s": 1800, "step_s": 2}


@functools.cache
def plain():
    """Columns and truth of half an hour."""
    return fly(1, **HALF_HOUR)


def with_effect(name, value):
    """The same with an effect."""
    return fly(1, {name: value}, **HALF_HOUR)


def test_the_same_seed_gives_the_same_day_and_another_another():
    """Contract: everything random comes from the seed."""
    first, second, other = plain()[0], fly(1, **HALF_HOUR)[0], fly(2, **HALF_HOUR)[0]
    for name, values in first.items():
        assert_array_equal(values, second[name])
    assert not np.array_equal(first["linear"], other["linear"])


def test_torques_motion_attitude_and_rates_agree():
    """Analytic: what the motion takes is drag torque, gradient and control; rates are those of the written attitude."""
    columns, truth = fly(1, **HALF_HOUR, tracker_noise=0, torque_n_m=0)
    J, w = np.array(SATELLITE["inertia"]), truth["rate"]
    taken = np.matvec(J, truth["rate_dot"]) + np.cross(w, np.matvec(J, w))
    left = taken - gravity_gradient_torque(J, truth["gradient"])
    drag = SATELLITE["mass"] * np.cross(truth["centre_of_pressure_m"], truth["drag"])
    R_oi = orbit_frame(columns["position"], columns["velocity"])
    R_bo = frames.R_bi_from_quaternion(columns["q"]) @ np.swapaxes(R_oi, 1, 2)
    angle = frames.rotation_vector(frames.quaternion_from_R_bi(R_bo))
    W = 2 * np.pi * 0.001
    control = -np.matvec(J, W**2 * angle + 1.4 * W * np.gradient(angle, 2.0, axis=0))
    assert_allclose((left - control)[20:-20], drag[20:-20], rtol=0, atol=2e-3 * np.abs(control).max())
    rates = kinematics.rates_from_attitude(columns["time"], columns["q"], half_width=3, degree=6)
    for name, expected in zip(("rate", "rate_dot"), rates, strict=True):
        assert_allclose(truth[name][5:-5], expected[5:-5], atol=1e-12)


def test_noise_has_the_catalogued_density():
    """Recovery: 900 samples a channel at 2 s: density over two, to 7 %; coloured noise has unit size."""
    columns, truth = plain()
    for name in ("linear", "angular"):
        noise = columns[name] - truth["clean"][name]
        expected = np.array(SATELLITE[f"{name}_noise_density"]) * np.sqrt(0.25)
        assert_allclose(noise.std(axis=(0, 1)), expected, rtol=0.07)
    assert_allclose(simulation.coloured(np.arange(0.0, 2e5, 5.0), 0.002, np.random.default_rng(0)).std(), 1, rtol=0.1)


def test_effects_are_added_and_unknown_ones_named():
    """Contract: angular bias as an accelerometer reads it, so with a minus here; a moved centre of pressure turns."""
    biased = with_effect("gradient.angular_bias.y", 1e-9)[0]
    assert_allclose((biased["angular"] - plain()[0]["angular"])[:, :, 1], -1e-9, rtol=1e-6)
    scaled, truth = with_effect("gradient.field_scale.scale", 1e-3)
    change = scaled["linear"] - plain()[0]["linear"]
    assert_allclose(change[:, 0], 1e-3 * truth["gradient"] @ scaled["sensor_position"][0], rtol=0, atol=1e-15)
    moved = with_effect("torque.aerodynamic.arm_z", 0.05)[0]
    assert np.abs(moved["angular"] - plain()[0]["angular"]).max() > 1e-10
    with pytest.raises(CatalogError, match=r"gradient\.mounting"):
        by_slug({"gradient.mount.x": 1})


def test_a_tesseral_term_is_felt_as_the_field_with_it():
    """Analytic: C_22 off by 1e-6 against the gradient at the sensor's place, 12 GM/r^3 times 1e-6 at most."""
    change = with_effect("gradient.tesseral.cosine", 1e-6)[0]["linear"] - plain()[0]["linear"]
    assert 1e-13 < np.abs(change[:, 0]).max() < 12 * 1.25e-6 * 2.65 * 1e-6 * 0.11  # 2.65: of full normalisation
    assert_allclose(change[:, 0] / 0.1, -change[:, 1] / 0.1, atol=0.05 * np.abs(change).max() / 0.1)  # +-0.1 m, mm off


def test_another_drag_can_be_given():
    """Contract: a function of time in place of the invented drag."""
    _, truth = fly(1, nongravitational=lambda time: np.ones((time.size, 3)), duration_s=600)
    assert np.all(truth["drag"] == 1)
