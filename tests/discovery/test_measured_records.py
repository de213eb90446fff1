"""Discovery in measured Level-1 records: what is named, what is tied, and what is not named."""

from pathlib import Path

import numpy as np
import pytest

from flows import discover_measured, measured_attitude
from gravcal import catalog
from gravcal.calibrations.attitude_thrusters import view
from gravcal.store.schemas import validate
from tasks import common

MEASURED = Path(__file__).parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.measured,
    pytest.mark.skipif(not MEASURED.is_dir(), reason=f"no measured data at {MEASURED}"),
]


def by_letter(document):
    """Findings of each satellite, {letter: {cause: finding}}."""
    found = {}
    for one in document["findings"]:
        found.setdefault(one["in"], {})[one["cause"]] = one
    return found


def test_thruster_firings_are_named_in_a_third_of_the_day():
    """Recovery: GRACE-B 2014-01-15, eight hours: firings first, their held-out gain as large as in sample."""
    chosen = catalog.parameters("discover_measured")
    source = common.source_of("com_offset", ("THR1B",), data=MEASURED / "grace-2014-01-15", satellite="B")
    camera, firings, twin, _, inertia = measured_attitude._inputs(source, "B")[0]
    part = camera.part(camera.time < camera.time[0] + 8 * 3600)
    blocks, candidates, facts = view.view(part, firings, twin, None, inertia, **chosen.for_stage("attitude"))
    found = {f.cause: f for f in discover_measured.searched(blocks, candidates, chosen).findings}
    named = found["torque.thruster_firings"]
    assert named.heldout > 0.8 * named.gain > 200
    assert 1.2 < named.value[0] < 2.0  # roll, in units of nominal impulse and assumed moment of inertia
    assert "unknown:twin_firings" not in found
    assert 1 <= facts["inflation"] < 4
    if "timing.thruster_delay" in found:
        assert found["timing.thruster_delay"].tied == ["timing.star_camera_delay"]


def test_minutes_of_magnetometer_name_bias_and_leak_and_no_more():
    """Recovery: 2003-09-14: both satellites have a bias and the same leak of the x torquer into y, 0.15 uT per A m2."""
    document = discover_measured.discover("magnetometer", MEASURED / "grace-2003-09-14" / "binary")
    validate(document)
    found = by_letter(document)
    assert set(found) == {"A", "B"}
    leaks = [one["magnetometer.current_leak"]["parameters"]["y_from_x"]["value"] for one in found.values()]
    assert np.allclose(leaks, -1.5e-7, rtol=0.2)
    for one in found.values():
        assert "magnetometer.bias" in one
        for cause in set(one) - {"magnetometer.bias", "magnetometer.current_leak"}:
            assert one[cause]["tied_with"]


def test_fifty_seconds_of_magnetometer_leave_all_but_the_bias_tied():
    """Recovery: 2023-06-01: a bias of each axis; whatever grows in 50 s has more than one name."""
    document = discover_measured.discover("magnetometer", MEASURED / "gracefo-2023-06-01")
    for one in by_letter(document).values():
        assert "magnetometer.bias" in one
        assert all(one[cause]["tied_with"] for cause in set(one) - {"magnetometer.bias"})


def test_the_published_table_asks_for_a_leak_not_for_a_lag_or_a_scale():
    """Published: Table 7: one offset leaves chi-square above 700; a leak or an angular leak explains every variant."""
    document = discover_measured.discover("published_table")
    validate(document)
    assert not document["adequate_before"]
    assert document["adequate_after"]
    for facts in document["facts"].values():
        assert facts["error_factor_for_one_offset"] > 4 * facts["error_factor_by_repeats"]
    for rows in document["tried"].values():
        gain = {}
        for row in rows:
            gain[row["cause"]] = max(gain.get(row["cause"], 0.0), row["gain"])
        assert gain["timing.accelerometer_delay"] < 1
        assert gain["accelerometer.scale"] < 0.6 * gain["accelerometer.current_leak"]
    named = [{f["cause"], *f["tied_with"]} for f in document["findings"]]
    assert all("accelerometer.current_leak" in one for one in named)
