"""Discovery in measured Level-1 records: what is named, what is tied, and what is not named."""

from pathlib import Path

import numpy as np
import pytest

from flows import discover, engine
from flows.calibration import load
from gravcal import catalog
from gravcal.store.schemas import validate

MEASURED = Path(__file__).parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.measured,
    pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured data at {MEASURED}"),
]


def searched(name, folder, satellite):
    """Document of a discovery, and {cause: finding}."""
    source = load(name).source(data=MEASURED / folder, satellite=satellite)
    document = discover.document(engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline"))
    validate(document)
    return document, {one["cause"]: one for one in document["findings"]}


def test_thruster_firings_are_named_in_a_day():
    """Recovery: GRACE-B 2014-01-15: firings first, held-out gain as large as in sample; the delay has two names."""
    _, found = searched("thrusters", "grace-2014-01-15", "B")
    named = found["torque.thruster_firings"]
    assert next(iter(found)) == "torque.thruster_firings"
    assert named["heldout_gain"]["chi2"] > 0.8 * named["heldout_gain"]["in_sample_chi2"] > 200
    assert 1.2 < named["parameters"]["share_x"]["value"] < 2.0  # in units of nominal impulse and assumed inertia
    assert "unknown:twin_firings" not in found
    assert found["timing.thruster_delay"]["tied_with"] == ["timing.star_camera_delay"]


@pytest.mark.parametrize("satellite", ["A", "B"])
def test_minutes_of_magnetometer_name_bias_and_leak_and_no_more(satellite):
    """Recovery: 2003-09-14: both satellites have a bias and the same leak of the x torquer into y, 0.15 uT per A m2."""
    _, found = searched("magnetometer", "grace-2003-09-14/binary", satellite)
    leak = found["magnetometer.current_leak"]["parameters"]["y_from_x"]["value"]
    assert np.isclose(leak, -1.5e-7, rtol=0.2)
    assert "magnetometer.bias" in found
    assert all(found[cause]["tied_with"] for cause in set(found) - {"magnetometer.bias", "magnetometer.current_leak"})


@pytest.mark.parametrize("satellite", ["C", "D"])
def test_fifty_seconds_of_magnetometer_leave_all_but_the_bias_tied(satellite):
    """Recovery: 2023-06-01: a bias of each axis; whatever grows in 50 s has more than one name."""
    _, found = searched("magnetometer", "gracefo-2023-06-01", satellite)
    assert "magnetometer.bias" in found
    assert all(found[cause]["tied_with"] for cause in set(found) - {"magnetometer.bias"})
