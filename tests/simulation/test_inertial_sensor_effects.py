"""Effects hidden in a simulated inertial sensor."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import CatalogError
from gravcal.physics import frames
from gravcal.simulation import inertial_sensor as simulation
from gravcal.simulation.injection import by_slug

CHOSEN = catalog.parameters("simulate_inertial_sensor").with_settings(
    {"manoeuvre": "swing", "quiet_s": 60.0, "swing_s": 60.0}
)
SATELLITE = catalog.satellite("T").settings()


def records(**effects):
    """Record of a swing with effects, and its truth; names with two underscores for the dot."""
    given = by_slug({name.replace("__", "."): value for name, value in effects.items()})
    spans, truth = simulation.simulate(SATELLITE, CHOSEN, 706104000.0, 3, given)
    return next(spans), truth


def linear(record):
    """Linear readouts (n, 3) V."""
    return electrodes.readouts(record["IS1"]["volts"])[:, :3]


@pytest.fixture(scope="module")
def plain():
    """The same swing without effects."""
    return records()[0]


def test_a_drifting_bias_drifts_in_the_voltages(plain):
    """Analytic: the same noise, and drift times time over k."""
    found, truth = records(inertial_sensor__bias_drift__x=1e-12)
    elapsed = found["IS1"]["time"] - 706104000.0
    moved = (linear(found) - linear(plain))[:, 0] * truth["k"][0]
    assert_allclose(moved, 1e-12 * elapsed, atol=1e-18)  # rounding of 0.5 V
    assert truth["effects"] == {"inertial_sensor.bias_drift": {"x": 1e-12}}


def test_a_squared_response_follows_the_volts(plain):
    """Analytic: -k2 V^2 with V near the bias over k, 0.45 V: constant to the modulation."""
    found, truth = records(inertial_sensor__quadratic__x=1e-7)
    moved = (linear(found) - linear(plain))[:, 0] * truth["k"][0]
    assert_allclose(moved, -1e-7 * (truth["bias"][0] / truth["k"][0]) ** 2, rtol=1e-3)


def test_a_turned_tracker_shows_a_turned_attitude(plain):
    """Analytic: constant small rotation from one attitude to the other."""
    found, _ = records(inertial_sensor__tracker_misalignment__angle_z=1e-3)
    turn = frames.attitude_error(found["ATT"]["quaternion"], plain["ATT"]["quaternion"])
    assert_allclose(turn, np.broadcast_to([0, 0, 1e-3], turn.shape), atol=1e-7)  # second order in the noise


@pytest.mark.parametrize("name", ["cross_coupling__y_from_x", "stiffness__y", "loop_delay__delay"])
def test_the_other_effects_move_the_readings(plain, name):
    """Contract: something changes, and only in the voltages."""
    found, _ = records(**{f"inertial_sensor__{name}": 1e-2})
    assert np.any(found["IS1"]["volts"] != plain["IS1"]["volts"])
    assert np.all(found["ATT"]["quaternion"] == plain["ATT"]["quaternion"])


def test_an_effect_of_another_instrument_is_refused():
    """Contract: nothing is silently left out."""
    with pytest.raises(CatalogError, match="no channel for it"):
        records(ranging__multipath__pitch_a=1e-6)
