"""Readings, attitude and orbit that contradict each other: an error or questionable, never delivered."""

import shutil

import numpy as np
import pytest
from commands import questionable, run, simulated
from independent.damage import exchanged, held, late, netcdf, times

from gravcal import catalog
from gravcal.calibrations.gradient_torque import model, page
from gravcal.io import daily, icgem

STEP = 2.0
SHORT = {"duration_s": 4000.0, "step_s": STEP, "field_degree": 12}
QUICK = {"field_degree": 12, "highest_degree": 4}


@pytest.fixture(scope="module")
def days(tmp_path_factory):
    """Folders with a record of two sensors and of one."""
    folders = {}
    for sensors in (1, 2):
        folders[sensors] = tmp_path_factory.mktemp(f"day{sensors}")
        simulated("gradient_torque", folders[sensors], 3, **(SHORT | {"sensors": sensors}))
    return folders


@pytest.fixture
def copied(days, tmp_path, monkeypatch):
    """Function from the number of sensors to a copy of its folder; a store of its own, the page left out."""
    monkeypatch.setattr(page.pages, "page", lambda *_, **__: "")
    return lambda sensors: shutil.copytree(days[sensors], tmp_path / "files")


#: Name: number of sensors, variable, change. What one sensor shows, two show as well.
CONTRADICTIONS = {
    "position zero": (1, "position", times(0, 2, first=0.35, count=36)),
    "velocity in km/s": (1, "velocity", times(1e-3)),
    "attitude components": (1, "q", exchanged(1, 2)),
    "attitude frozen": (1, "q", held()),
    "linear x and y": (1, "linear", exchanged(0, 1)),
    "linear frozen": (1, "linear", held(0, 2)),
    "linear in mm": (1, "linear", times(1e3)),
    "sign of linear x": (1, "linear", times(-1, slice(None), 0)),
    "place x and y": (1, "sensor_position", exchanged(0, 1)),
    "sign of angular z": (1, "angular", times(-1, slice(None), 2)),
    "sign of linear z of one": (2, "linear", times(-1, 0, 2)),
    "sign of a stretch of linear z of one": (2, "linear", times(-1, 1, 2, first=0.2545, count=53)),
    "angular of one in krad": (2, "angular", times(1e-3, 1)),
    "sensors exchanged": (2, "sensor_position", times(-1)),
}
#: The cases that the page of the calibration lists by name.
NOTHING_CONTRADICTS = {
    "times of the whole file": (2, "time", late(120)),
    "scale of the angular readings": (2, "angular", times(1.02)),
    "scale of the linear readings": (2, "linear", times(1.02)),
    "sign of linear z": (1, "linear", times(-1, 0, 2)),
    "linear y and z": (1, "linear", exchanged(1, 2)),
}


@pytest.mark.parametrize("name", [*CONTRADICTIONS, *NOTHING_CONTRADICTS])
def test_what_contradicts_itself_is_an_error_or_questionable(copied, name):
    """Contract: a drag that rests on such a file is never delivered without a word; what nothing contradicts is."""
    sensors, variable, change = (CONTRADICTIONS | NOTHING_CONTRADICTS)[name]
    folder = copied(sensors)
    netcdf(next(folder.glob("SGRS*")), [variable], change)
    assert questionable("gradient_torque", folder, **QUICK) == (name in CONTRADICTIONS)


@pytest.mark.parametrize(("sensors", "checks"), [(1, 12), (2, 16)])
def test_a_clean_day_keeps_to_every_check(copied, sensors, checks):
    """Recovery: delivered, every check there and none failed, of an attitude in six digits too."""
    folder = copied(sensors)
    netcdf(next(folder.glob("SGRS*")), ["q"], lambda values: [np.round(values, 6)])
    document, _ = run("gradient_torque", folder, **QUICK)
    assert document["status"] == "delivered"
    assert [one["passed"] for one in document["checks"]] == [True] * checks


def test_attitudes_of_no_norm_are_bridged_as_missing_ones(days):
    """Contract: rows of zeros are no attitude; the angular readings carry it on."""
    observed = daily.read_sgrs(daily.sgrs_file(days[2]))
    stored = model.field(icgem.read_field(icgem.shipped(), 12))
    chosen = catalog.parameters("gradient_torque").with_settings(QUICK).for_stage("gradient")
    lost = [observed.copy(deep=True) for _ in range(2)]
    for one, nothing in zip(lost, (0.0, np.nan), strict=True):
        one["q"].values[700:736] = nothing
    found = [model.gradient(one, stored, satellite=catalog.satellite("S").settings(), **chosen) for one in lost]
    assert np.array_equal(found[0]["rate_b"], found[1]["rate_b"])
