"""The catalogue's printed values and constants, all of them, against the tables and files beside the project."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog

SHARED = Path(__file__).parents[3] / "shared"
pytestmark = pytest.mark.measured("reference")
OFFSET = ("dx_um", "dy_um", "dz_um"), ("dx_sigma_um", "dy_sigma_um", "dz_sigma_um")
PER_MILLIMETRE = ["value_mm"], ["formal_error_mm"]
VOLTAGES = ["coef_V_x1", "coef_V_x2", "coef_V_x3", "coef_V_y", "coef_V_z1", "coef_V_z2"]
FACTORS = ["nominal", "ground_calibrated", "orbit_calibrated"]
BY_ORDER = {"order": "row_order", "kind": "axis", "latitude_class": "latitude_class"}
BY_NAME = {"satellite": "satellite", "component": "parameter", "observable": "observable"}
#: Calibration, section, reference table, columns of value and sigma, columns of labels.
TABLES = [
    ("com_offset", "combined", "com_2020-02-01_combined.csv", *OFFSET, {"variant": "angular_acceleration"}),
    ("com_offset", "manoeuvres", "com_2020-02-01_per_maneuver.csv", *OFFSET, BY_ORDER),
    ("com_offset", "history", "com_history_grace_c.csv", *OFFSET, {"date": "date"}),
    ("com_offset", "first", "com_history_grace_c.csv", *OFFSET, {}),
    ("kbr_phase_centre", "ls", "kbr_ls.csv", *PER_MILLIMETRE, BY_NAME),
    ("kbr_phase_centre", "subsets", "kbr_ls_subsets.csv", *PER_MILLIMETRE, BY_NAME),
    ("kbr_phase_centre", "robust", "kbr_m_estimation.csv", *PER_MILLIMETRE, BY_NAME),
    ("kbr_phase_centre", "vkb1b", "kbr_vkb1b.csv", ["x_apc_mm", "y_apc_um", "z_apc_um"], (), {}),
    ("inertial_sensor", "actuation", "taiji_actuation.csv", VOLTAGES, (), {}),
    ("inertial_sensor", "scale_factors", "taiji_scale_factors.csv", FACTORS, ["orbit_error"], {}),
    ("inertial_sensor", "com_offset", "taiji_com_offset.csv", ["value_um"], ["error_um"], {}),
    ("inertial_sensor", "bias", "taiji_bias.csv", ["value_m_per_s2"], ["error_m_per_s2"], {}),
    ("com_offset", "scalars", "com_scalars.csv", ["value"], (), {"name": "name"}),
    ("kbr_phase_centre", "scalars", "kbr_scalars.csv", ["value"], (), {"name": "name"}),
    ("inertial_sensor", "scalars", "taiji_scalars.csv", ["value"], (), {"name": "name"}),
    ("gradient_torque", "scalars", "sgrs_scalars.csv", ["value"], (), {"name": "name"}),
]


def _rows(name):
    """Rows of a reference table."""
    return list(csv.DictReader((SHARED / "reference" / name).read_text(encoding="utf-8").splitlines()))


def _number(text):
    """Number, None for a blank, the words of running text."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


@pytest.mark.parametrize(("calibration", "section", "name", "value", "sigma", "labels"), TABLES)
def test_all_numbers_are_as_in_the_reference_tables(calibration, section, name, value, sigma, labels):
    """Published: 10.3390/rs14164030, Tables 6 to 9; 10.3390/rs14143395, 4 to 8; 10.3390/rs15153817, 3 to 6; texts."""
    part = {"history": "9", "first": "8"}.get(section)
    rows = [row for row in _rows(name) if part is None or row["table"] == part]
    for record, row in zip(catalog.published(calibration)[section], rows, strict=True):
        printed = [tuple(_number(row[key]) for key in columns) for columns in (value, sigma)]
        assert [record.value, record.sigma] == printed
        assert record.unit == row.get("unit", record.unit)
        for label, column in labels.items():
            assert record.labels[label].lower() == row[column].lower()
        if section == "history":
            assert record.events == (f"grace-c-{row['date']}",)


def test_geometry_trims_and_dates_are_as_in_the_reference_tables():
    """Published: 10.3390/rs15153817, Table 1; 10.3390/rs14164030, Table 4; 10.3390/rs14143395, Tables 1 and 2."""
    taiji, rows = catalog.satellite("T"), _rows("taiji_geometry.csv")
    columns = {"electrode_arm": "l_m", "test_mass_inertia": "J_kg_m2", "electrode_gap": "D_m", "electrode_area": "S_m2"}
    for quantity, column in columns.items():
        assert getattr(taiji, quantity).value.tolist() == [float(row[column]) for row in rows]
    found = [(str(t.date), t.axis.upper(), t.trim_um) for t in catalog.trims()]
    assert found == [(row["date"], row["axis"], float(row["trim_um"])) for row in _rows("com_trim_events.csv")]
    printed = {row["date_as_printed"] for row in _rows("kbr_events_gracefo.csv")}
    printed |= {row["start_date_as_printed"] for row in _rows("kbr_events_grace.csv")}
    events = catalog.events(calibration="kbr_phase_centre")
    assert {str(e.date_as_printed or e.date) for e in events} == printed
    assert len(events) == 10


def _vectors(path):
    """Records of an 80-column vector or quaternion file, split at blanks."""
    body = path.read_text(encoding="ascii").split("END OF HEADER")[1]
    return [line.split() for line in body.splitlines() if line.strip()]


@pytest.mark.parametrize("letter", ["C", "D"])
def test_geometry_is_that_of_the_measured_files(letter):
    """Published: VKB1B, QSA1B, QCP1B, VGN1B, VSL1B of 2018-05-22; rounding to nine digits, 1e-9 m."""
    satellite, folder = catalog.satellite(letter), SHARED / "data" / "gracefo-2018-05-22"
    for product, names in (
        ("VKB1B", ["com_to_antenna"]),
        ("VSL1B", ["com_to_reflector"]),
        ("VGN1B", ["com_to_gps_antenna_l1", "com_to_gps_antenna_l2"]),
    ):
        for name, row in zip(names, _vectors(folder / f"{product}_2018-05-22_{letter}_04.txt"), strict=True):
            vector = float(row[2]) * np.array([float(item) for item in row[3:6]])
            assert_allclose(getattr(satellite, name).value, vector, atol=1e-9)
    heads = [[float(item) for item in row[3:7]] for row in _vectors(folder / f"QSA1B_2018-05-22_{letter}_04.txt")]
    assert satellite.star_camera_mounting.value.tolist() == heads
    (row,) = _vectors(folder / f"QCP1B_2018-05-22_{letter}_04.txt")
    assert satellite.antenna_alignment.value.tolist() == [float(item) for item in row[3:7]]


@pytest.mark.parametrize("letter", ["A", "B"])
def test_grace_mountings_are_those_in_force_on_the_measured_day(letter):
    """Published: QSA1B and VKB1B of 2003-09-14, last records; 1e-8 m for nine digits."""
    satellite, folder = catalog.satellite(letter), SHARED / "data" / "grace-2003-09-14" / "ascii"
    rows = _vectors(folder / f"QSA1B_2003-09-14_{letter}_00.asc")[-2:]
    assert satellite.star_camera_mounting.value.tolist() == [[float(item) for item in row[3:7]] for row in rows]
    row = _vectors(folder / f"VKB1B_2003-09-14_{letter}_00.asc")[-1]
    vector = float(row[2]) * np.array([float(item) for item in row[3:6]])
    assert_allclose(satellite.com_to_antenna_release_00.value, vector, atol=1e-8)
