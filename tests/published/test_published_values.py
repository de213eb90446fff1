"""Printed values of the catalogue against independent readings, and against what the prints say about themselves."""

import csv
import tomllib
from importlib import resources

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.errors import CatalogError
from tasks import common

EVENT = "grace-c-2020-02-01"


def _one(calibration, section, **labels):
    """The one record with these labels."""
    records = catalog.published(calibration)[section]
    (record,) = [r for r in records if all(r.labels[key] == value for key, value in labels.items())]
    return record


OFFSET, ANTENNA, SENSOR = "com_offset", "kbr_phase_centre", "inertial_sensor"
Z_OF_D = {"satellite": "grace-d", "component": "z", "observable": "range_acceleration"}
PRINTED = [
    (OFFSET, "combined", {"variant": "acc_calibrated"}, (113.5, 4.2, 13.2), (0.5, 0.2, 0.06)),
    (OFFSET, "combined", {"variant": "sca"}, (91.6, 2.6, 10.4), (1.7, 0.6, 0.2)),
    (OFFSET, "manoeuvres", {"order": "2", "variant": "mtq"}, (109.5, None, 22.9), (1.8, None, 1.8)),
    (OFFSET, "manoeuvres", {"order": "5", "variant": "sca"}, (None, 2.0, 10.3), (None, 0.6, 0.2)),
    (OFFSET, "history", {"date": "2022-02-20"}, (-22.5, -33.4, 5.9), (2.5, 0.3, 0.1)),
    (OFFSET, "first", {"satellite": "grace-d"}, (-56.7, -272.8, 7.7), (2.5, 2.2, 2.5)),
    (ANTENNA, "robust", Z_OF_D, (1.3931,), (0.0716,)),
    (ANTENNA, "vkb1b", {"solution": "soe", "satellite": "grace-b"}, (1444.4, 576.1, 3304.1), ()),
    (SENSOR, "scale_factors", {"factor": "k_z"}, (1.58e-4, 1.45e-4, 1.14e-4), (2.67e-7,)),
]


@pytest.mark.parametrize(("calibration", "section", "labels", "value", "sigma"), PRINTED)
def test_printed_values_are_in_the_catalogue(calibration, section, labels, value, sigma):
    """Published: 10.3390/rs14164030, Tables 6 to 9; 10.3390/rs14143395, Tables 6 and 8; 10.3390/rs15153817, Table 4."""
    record = _one(calibration, section, **labels)
    assert (record.value, record.sigma) == (value, sigma)
    if calibration == OFFSET:
        assert (record.direction, record.unit) == ("proof_mass_to_com", "um")
        assert record.source.startswith("10.3390/rs14164030")


@pytest.mark.parametrize("variant", ["mtq", "acc_calibrated", "acc", "sca"])
def test_the_combined_offsets_follow_from_the_manoeuvres(variant):
    """Published: weights 1/sigma^2 give Table 6, C-9, to 0.1 um rounding; its row ACC is 2020-02-01 of Table 9."""
    rows = [r for r in catalog.published("com_offset")["manoeuvres"] if r.variant == variant]
    combined = _one("com_offset", "combined", variant=variant)
    assert variant != "acc" or _one("com_offset", "history", date="2020-02-01").value == combined.value
    for axis, kind in ((0, "pitch"), (1, "roll"), (2, "roll")):
        used = [r for r in rows if r.kind == kind and r.latitude_class == "high"]
        assert len(used) == 2
        values = np.array([r.value[axis] for r in used])
        weights = np.array([r.sigma[axis] for r in used]) ** -2.0
        assert_allclose(np.average(values, weights=weights), combined.value[axis], atol=0.1)


def test_only_the_x_trim_shows_in_the_series_whose_days_count_from_the_launch():
    """Published: Table 4 against Table 9, erratum C-13: 30 um off but for that of x; all 20 entries from 2018-05-22."""
    history = catalog.published("com_offset")["history"]
    for trim in catalog.trims("C"):
        axis = "xyz".index(trim.axis)
        before = [r for r in history if r.date < trim.date.isoformat()][-1].value[axis]
        after = next(r for r in history if r.date > trim.date.isoformat()).value[axis]
        assert (abs(before + trim.trim_um - after) < 15) == trim.confirmed, trim
        assert f"{before + trim.trim_um:.1f} um" in trim.note
    assert len(catalog.trims("C")) == 4
    assert catalog.trims("D") == ()
    launched = catalog.satellite("C").launched
    for record in catalog.published("com_offset")["history"]:
        assert (catalog.event(record.events[0]).date - launched).days == int(record.days_since_launch)


def test_an_event_gets_its_own_values_only_and_every_column_has_a_citation():
    """Contract: what was printed for its event; a column is a label, value, sigma, unit or event of one cited table."""
    assert [*common.printed_of("com_offset", "grace-c-2018-07-29")] == ["history"]
    assert common.printed_of("com_offset", "grace-d-2018-06-06")["first"][0]["satellite"] == "grace-d"
    with pytest.raises(CatalogError, match="'com_ofset'.*Nearest: com_offset"):
        catalog.published("com_ofset")
    for calibration in (OFFSET, ANTENNA, SENSOR, "gradient_torque"):
        for record in (one for records in catalog.published(calibration).values() for one in records):
            assert all(catalog.event(name).calibration == calibration for name in record.events)
    folder = resources.files("catalog") / "published"
    tables = tomllib.loads((folder / "tables.toml").read_text(encoding="utf-8"))
    assert {table["file"] for table in tables.values()} == {f.name for f in folder.iterdir() if f.name.endswith(".csv")}
    for table in tables.values():
        header = next(csv.reader((folder / table["file"]).read_text(encoding="utf-8").splitlines()))
        assert set(header) <= {*table["labels"], *table["value"], *table["sigma"], "unit", "events"}
        assert table["doi"]
        assert table["table"]


def test_thruster_forces_give_the_torques_of_their_names():
    """Analytic: position x force points as the control column says."""
    for letter in "AB":
        satellite = catalog.satellite(letter)
        torque = np.cross(satellite.thruster_position.value, satellite.thruster_force.value)
        for control, vector in zip(satellite.thruster_control.value, torque, strict=True):
            if control != "dV":
                axis = ["roll", "pitch", "yaw"].index(control[:-1])
                assert np.sign(vector[axis]) == (1 if control[-1] == "+" else -1), control


def test_erratum_k_3_explains_the_printed_errors_of_the_range_and_not_its_values():
    """Published: 10.3390/rs14143395, Table 4: sigma y over x as K-3 predicts; x above the truth, not 103 mm short."""
    for letter, above in (("C", 13), ("D", 47)):
        truth = 1e3 * catalog.satellite(letter).com_to_antenna_soe.value[0]
        labels = {"satellite": f"grace-{letter.lower()}", "observable": "range"}
        x, y = (_one("kbr_phase_centre", "ls", component=axis, **labels) for axis in "xy")
        assert y.sigma[0] / x.sigma[0] == pytest.approx(0.017, abs=1e-3)
        assert x.value[0] - truth == pytest.approx(above, abs=0.5)
        assert above + 103 > 30 * x.sigma[0]
