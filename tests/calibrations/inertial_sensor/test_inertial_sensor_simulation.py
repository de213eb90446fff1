"""Effects hidden in a simulated inertial sensor."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.effects import inertial_sensor as electrodes
from gravcal.physics import frames
from gravcal.simulation import by_slug
from gravcal.simulation import inertial_sensor as simulation

SETTINGS = {"manoeuvre": "swing", "quiet_s": 60.0, "swing_s": 60.0}
START = 706104000.0


def record(effects=None):
    """Record of a swing with effects, and its truth."""
    chosen = catalog.parameters("simulate_inertial_sensor").with_settings(SETTINGS)
    spans, truth = simulation.simulate(catalog.satellite("T").settings(), chosen, START, 3, by_slug(effects or {}))
    return next(spans), truth


@pytest.fixture(scope="module")
def plain():
    """The same swing without effects."""
    return record()[0]


@pytest.mark.parametrize(("name", "size"), [("bias_drift.x", 1e-12), ("quadratic.x", 2e-4)])
def test_linear_effects_stand_in_the_voltages(plain, name, size):
    """Analytic: with the same noise drift times time over k; q V^2 of four electrodes, with V of bias over four k."""
    found, truth = record({f"inertial_sensor.{name}": size})
    before, after = (electrodes.readouts(one["IS1"]["volts"])[:, 0] for one in (plain, found))
    moved = (after - before) * truth["k"][0]
    if name == "bias_drift.x":
        assert_allclose(moved, size * (found["IS1"]["time"] - START), atol=1e-18)  # rounding of 0.5 V
        assert truth["effects"] == {"inertial_sensor.bias_drift": {"x": size}}
    else:
        assert_allclose(moved, size * truth["bias"][0] ** 2 / truth["k"][0] / 4, rtol=1e-2)  # modulation


def test_a_turned_tracker_shows_a_turned_attitude(plain):
    """Analytic: constant small rotation from one attitude to the other."""
    found, _ = record({"inertial_sensor.tracker_misalignment.angle_z": 1e-3})
    turn = frames.attitude_error(found["ATT"]["quaternion"], plain["ATT"]["quaternion"])
    assert_allclose(turn, np.broadcast_to([0, 0, 1e-3], turn.shape), atol=1e-7)  # second order in the noise


@pytest.mark.parametrize("name", ["cross_coupling.y_from_x", "stiffness.y", "loop_delay.delay"])
def test_the_other_effects_move_the_readings(plain, name):
    """Contract: something changes, and only in the voltages."""
    found, _ = record({f"inertial_sensor.{name}": 1e-2})
    assert np.any(found["IS1"]["volts"] != plain["IS1"]["volts"])
    assert np.all(found["ATT"]["quaternion"] == plain["ATT"]["quaternion"])
