"""The simulated S-GRS day keeps the laws it is made of."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gravcal import catalog
from gravcal.errors import CatalogError
from gravcal.io import icgem
from gravcal.physics import frames, kinematics
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.simulation import gradient_torque as simulation
from gravcal.simulation.injection import by_slug

SATELLITE = catalog.satellite("S").settings()
FIELD = icgem.read_field(icgem.shipped(), 12)


def fly(seed=1, effects=None, **settings):
    """Columns and truth of half an hour."""
    given = {"duration_s": 1800, "step_s": 2, "field_degree": 12} | settings
    chosen = catalog.parameters("simulate_gradient_torque").with_settings(given)
    return simulation.simulate(SATELLITE, chosen, FIELD, 633830400.0, seed, by_slug(effects or {}))


def test_the_same_seed_gives_the_same_day_and_another_another():
    """Contract: everything random comes from the seed."""
    first, second, other = fly(1)[0], fly(1)[0], fly(2)[0]
    for name, values in first.items():
        assert_array_equal(values, second[name])
    assert not np.array_equal(first["linear"], other["linear"])


def test_torques_and_motion_agree():
    """Analytic: what the motion takes is drag torque, gradient, control and a disturbance of the stated size."""
    columns, truth = fly(tracker_noise=0, torque_n_m=0)
    J, w = np.array(SATELLITE["inertia"]), truth["rate"]
    taken = np.matvec(J, truth["rate_dot"]) + np.cross(w, np.matvec(J, w))
    left = taken - gravity_gradient_torque(J, truth["gradient"])
    drag = SATELLITE["mass"] * np.cross(truth["centre_of_pressure_m"], truth["drag"])
    z = -columns["position"] / np.linalg.norm(columns["position"], axis=1)[:, None]
    y = np.cross(columns["velocity"], columns["position"])
    y /= np.linalg.norm(y, axis=1)[:, None]
    R_oi = np.stack([np.cross(y, z), y, z], axis=1)
    R_bo = frames.R_bi_from_quaternion(columns["q"]) @ np.swapaxes(R_oi, 1, 2)
    angle = frames.rotation_vector(frames.quaternion_from_R_bi(R_bo))
    W = 2 * np.pi * 0.001
    control = -np.matvec(J, W**2 * angle + 1.4 * W * np.gradient(angle, 2.0, axis=0))
    assert_allclose((left - control)[20:-20], drag[20:-20], rtol=0, atol=2e-3 * np.abs(control).max())


def test_attitude_and_rates_belong_together():
    """Analytic: rates from the written attitude without noise."""
    columns, truth = fly(tracker_noise=0)
    rate, rate_dot = kinematics.rates_from_attitude(columns["time"], columns["q"], half_width=3, degree=6)
    assert_allclose(rate[5:-5], truth["rate"][5:-5], atol=1e-12)
    assert_allclose(rate_dot[5:-5], truth["rate_dot"][5:-5], atol=1e-12)


def test_noise_has_the_catalogued_density():
    """Recovery: 900 samples a channel at 2 s: density times the root of a quarter hertz, to 5 %."""
    columns, truth = fly()
    for name in ("linear", "angular"):
        noise = columns[name] - truth["clean"][name]
        expected = np.array(SATELLITE[f"{name}_noise_density"]) * np.sqrt(0.25)
        assert_allclose(noise.std(axis=(0, 1)), expected, rtol=0.07)


def test_unit_noise_has_unit_variance():
    """Recovery: four poles, 2e5 s, scatter to 10 %."""
    time = np.arange(0.0, 2e5, 5.0)
    assert_allclose(simulation._coloured(time, 0.002, np.random.default_rng(0)).std(), 1, rtol=0.1)


def test_effects_are_added_and_unknown_ones_named():
    """Contract: angular bias as an accelerometer reads it, so with a minus here."""
    plain, biased = fly()[0], fly(effects={"gradient.angular_bias.y": 1e-9})[0]
    assert_allclose((biased["angular"] - plain["angular"])[:, :, 1], -1e-9, rtol=1e-6)
    scaled = fly(effects={"gradient.field_scale.scale": 1e-3})
    change = scaled[0]["linear"] - plain["linear"]
    felt = 1e-3 * scaled[1]["gradient"] @ plain["sensor_position"][0]
    assert_allclose(change[:, 0], felt, rtol=0, atol=1e-15)
    with pytest.raises(CatalogError, match=r"gradient\.mounting"):
        by_slug({"gradient.mount.x": 1})
    with pytest.raises(CatalogError, match="no channel for it"):
        fly(effects={"ranging.delay.delay": 1e-3})


def test_a_tesseral_term_is_felt_as_the_field_with_it():
    """Analytic: C_22 off by 1e-6 against the gradient at the sensor's place, 12 GM/r^3 times 1e-6 at most."""
    plain, moved = fly(), fly(effects={"gradient.tesseral.cosine": 1e-6})
    change = moved[0]["linear"] - plain[0]["linear"]
    assert 1e-13 < np.abs(change[:, 0]).max() < 12 * 1.25e-6 * 2.65 * 1e-6 * 0.11  # 2.65: of full normalisation
    assert_allclose(change[:, 0] / 0.1, -change[:, 1] / 0.1, atol=0.05 * np.abs(change).max() / 0.1)  # +-0.1 m, mm off


def test_a_moved_centre_of_pressure_turns_the_satellite():
    """Analytic: the torque is that of a satellite whose centre of pressure is there."""
    plain, moved = fly(), fly(effects={"torque.aerodynamic.arm_z": 0.05})
    turned = moved[0]["angular"] - plain[0]["angular"]
    assert np.abs(turned).max() > 1e-10


def test_another_drag_can_be_given():
    """Contract: a function of time in place of the invented drag."""
    chosen = catalog.parameters("simulate_gradient_torque").with_settings({"duration_s": 600, "field_degree": 4})
    _, truth = simulation.simulate(SATELLITE, chosen, FIELD, 0.0 + 633830400, 1, None, lambda t: np.ones((t.size, 3)))
    assert np.all(truth["drag"] == 1)
