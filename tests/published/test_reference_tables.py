"""The catalogue's printed values and constants, all of them, against the tables and files beside the project."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog

SHARED = Path(__file__).parents[3] / "shared"
pytestmark = [
    pytest.mark.measured,
    pytest.mark.skipif(not (SHARED / "reference").is_dir(), reason="no ../shared/reference beside the project"),
]
VARIANTS = {"MTQ": "mtq", "ACC_calibrated": "acc_calibrated", "ACC": "acc", "SCA": "sca"}
OFFSET = ("dx_um", "dy_um", "dz_um")
SIGMA = ("dx_sigma_um", "dy_sigma_um", "dz_sigma_um")


def _rows(name):
    """Rows of a reference table."""
    return list(csv.DictReader((SHARED / "reference" / name).read_text(encoding="utf-8").splitlines()))


def _floats(row, columns):
    """Numbers of a row, None for a blank."""
    return tuple(float(row[key]) if row[key] else None for key in columns)


def _check(records, rows, value, sigma=()):
    """All numbers agree, in order."""
    for record, row in zip(records, rows, strict=True):
        assert record.value == _floats(row, value)
        assert record.sigma == _floats(row, sigma)


def test_all_offsets_are_as_in_the_reference_tables():
    """Published: 10.3390/rs14164030, Tables 6 to 9, every number."""
    sections = catalog.published("com_offset")
    combined, manoeuvres = _rows("com_2020-02-01_combined.csv"), _rows("com_2020-02-01_per_maneuver.csv")
    _check(sections["combined"], combined, OFFSET, SIGMA)
    assert [r.variant for r in sections["combined"]] == [VARIANTS[row["angular_acceleration"]] for row in combined]
    _check(sections["manoeuvres"], manoeuvres, OFFSET, SIGMA)
    for record, row in zip(sections["manoeuvres"], manoeuvres, strict=True):
        assert (record.order, record.kind, record.latitude_class) == tuple(
            row[key] for key in ("row_order", "axis", "latitude_class")
        )
    history = _rows("com_history_grace_c.csv")
    _check(sections["history"], [row for row in history if row["table"] == "9"], OFFSET, SIGMA)
    _check(sections["first"], [row for row in history if row["table"] == "8"], OFFSET, SIGMA)
    for record, row in zip(sections["history"], history, strict=False):
        assert record.events == (f"grace-c-{row['date']}",)


def test_all_trims_are_as_in_the_reference_table():
    """Published: 10.3390/rs14164030, Table 4."""
    found = [(str(t.date), t.axis.upper(), t.trim_um) for t in catalog.trims()]
    assert found == [(row["date"], row["axis"], float(row["trim_um"])) for row in _rows("com_trim_events.csv")]


@pytest.mark.parametrize(
    ("section", "name"), [("ls", "kbr_ls.csv"), ("subsets", "kbr_ls_subsets.csv"), ("robust", "kbr_m_estimation.csv")]
)
def test_all_antenna_solutions_are_as_in_the_reference_tables(section, name):
    """Published: 10.3390/rs14143395, Tables 4, 5, 6, every number."""
    records, rows = catalog.published("kbr_phase_centre")[section], _rows(name)
    _check(records, rows, ["value_mm"], ["formal_error_mm"])
    for record, row in zip(records, rows, strict=True):
        assert record.satellite == row["satellite"].lower()
        assert record.component == row["parameter"].lower()
        assert record.observable == row["observable"]


def test_all_antenna_files_are_as_in_the_reference_tables():
    """Published: 10.3390/rs14143395, Tables 7 and 8."""
    records = catalog.published("kbr_phase_centre")["vkb1b"]
    _check(records, _rows("kbr_vkb1b.csv"), ["x_apc_mm", "y_apc_um", "z_apc_um"])


def test_all_sensor_tables_are_as_in_the_reference_tables():
    """Published: 10.3390/rs15153817, Tables 3 to 6 and 1."""
    sections = catalog.published("inertial_sensor")
    voltages = ["coef_V_x1", "coef_V_x2", "coef_V_x3", "coef_V_y", "coef_V_z1", "coef_V_z2"]
    _check(sections["actuation"], _rows("taiji_actuation.csv"), voltages)
    factors = ["nominal", "ground_calibrated", "orbit_calibrated"]
    _check(sections["scale_factors"], _rows("taiji_scale_factors.csv"), factors, ["orbit_error"])
    _check(sections["com_offset"], _rows("taiji_com_offset.csv"), ["value_um"], ["error_um"])
    _check(sections["bias"], _rows("taiji_bias.csv"), ["value_m_per_s2"], ["error_m_per_s2"])
    taiji, rows = catalog.satellite("T"), _rows("taiji_geometry.csv")
    for quantity, column in (
        (taiji.electrode_arm, "l_m"),
        (taiji.test_mass_inertia, "J_kg_m2"),
        (taiji.electrode_gap, "D_m"),
        (taiji.electrode_area, "S_m2"),
    ):
        assert quantity.value.tolist() == [float(row[column]) for row in rows]


@pytest.mark.parametrize(
    ("calibration", "name"),
    [
        ("com_offset", "com_scalars.csv"),
        ("kbr_phase_centre", "kbr_scalars.csv"),
        ("inertial_sensor", "taiji_scalars.csv"),
        ("gradient_torque", "sgrs_scalars.csv"),
    ],
)
def test_all_numbers_of_running_text_are_as_in_the_reference_tables(calibration, name):
    """Published: running text of the four papers."""
    for record, row in zip(catalog.published(calibration)["scalars"], _rows(name), strict=True):
        assert (record.labels["name"], record.unit) == (row["name"], row["unit"])
        try:
            assert record.value == (float(row["value"]),)
        except ValueError:
            assert record.value == (row["value"],)


def test_all_dates_are_as_in_the_reference_tables():
    """Published: 10.3390/rs14143395, Tables 1 and 2: each printed date is the date of an event, or beside it."""
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
