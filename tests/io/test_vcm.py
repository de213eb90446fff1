"""Vectors as lines of the sequence-of-events file and as VCM1B files."""

import json

import numpy as np
import pytest
from commands import MEASURED, gravcal
from numpy.testing import assert_allclose, assert_array_equal

from gravcal import catalog
from gravcal.errors import ProductError
from gravcal.io import readers, vcm

OFFSET = [107.2e-6, 3.7e-6, -12.4e-6]


def test_lines_written_and_lines_of_the_handbook_are_read_to_the_last_digit():
    """Published: sequence of events of GRACE, Level 1B handbook v1.3, section 4.8; round trip of random numbers."""
    line = vcm.vector_line(633830400.0, "C", OFFSET, comment="grace-c-2020-02-01,\n mtq")
    assert line.split()[:4] == ["633830400.0", "GRACEC", "VCM", "3"]
    assert line.endswith("grace-c-2020-02-01, mtq")
    rng = np.random.default_rng(1)
    for satellite in "ABCD":
        vector, time = rng.normal(size=3) * 1e-4, rng.uniform(0, 1e9)
        record = vcm.read_line(vcm.vector_line(time, satellite, vector, comment="a b"))
        assert (record.time, record.satellite, record.name, record.comment) == (time, satellite, "VCM", "a b")
        assert_array_equal(record.values, vector)
    record = vcm.read_line("73346640.0  GRACEA VCM  3  -0.2350e-3  0.12561e-3  -0.11442e-3\n")
    assert_array_equal(record.values, [-0.2350e-3, 0.12561e-3, -0.11442e-3])
    assert record.comment == ""
    antenna = vcm.read_line("1.0  GRACEB VKB  3  1.472580  -0.000088  0.003319")
    assert (antenna.satellite, antenna.name, antenna.values[0]) == ("B", "VKB", 1.47258)
    assert vcm.read_line("x 1.0 GRACEB VKB 3 1.472580 -0.000088 0.003319") is None


@pytest.mark.parametrize("line", ["", "1.0 GRACEC VCM 3 1 2", "1.0 GRACEE VCM 3 1 2 3", "1.0 GRACEC VCM 3 1 b 3"])
def test_a_broken_line_is_refused(line):
    """Contract: found, expected, remedy."""
    with pytest.raises(ProductError, match=r"found .*; expected .*Correct the line"):
        vcm.read_line(line)


@pytest.mark.parametrize("vector", [[1.0, np.nan, 2.0], [1.0, None, 2.0], [1.0, 2.0]])
def test_an_undetermined_component_is_not_written(vector):
    """Contract: never a wrong number in a file."""
    with pytest.raises(ProductError, match="Write determined vectors only"):
        vcm.vector_line(0.0, "C", vector)
    with pytest.raises(ProductError, match="Write determined vectors only"):
        vcm.vector_file("VCM1B_2020-02-01_C_04.txt", 0, "C", vector)


def vectors(path):
    """Times and vectors of a file: length times direction cosines."""
    observed = readers.read(path)
    return observed.time_tag.values, observed.mag.values[:, None] * observed[["cosx", "cosy", "cosz"]].to_array().T


def test_a_file_written_and_read_is_the_same(tmp_path):
    """Analytic: round trip through length and cosines, rounding 1e-16; 80 columns, its lines and bytes are counted."""
    time, vector_b = np.array([633830400.0, 634435200.0]), np.array([OFFSET, [0.0, 0.0, 0.0]])
    path = tmp_path / "VCM1B_2020-02-01_C_04.txt"
    path.write_text(vcm.vector_file(path.name, time, "C", vector_b, source="com_offset, mtq"))
    found_time, found = vectors(path)
    assert_array_equal(found_time, time)
    assert_allclose(found, vector_b, rtol=1e-15, atol=0)
    lines = path.read_text().splitlines()
    header = lines[: lines.index("END OF HEADER".ljust(80)) + 1]
    assert ({len(line) for line in header}, len(header)) == ({80}, 24)
    size = next(line for line in header if line.startswith("FILESIZE")).partition(":")[2]
    assert int(size) == path.stat().st_size
    with pytest.raises(ProductError, match="whole GPS seconds"):
        vcm.vector_file(path.name, 0.5, "C", OFFSET)


@pytest.mark.measured
@pytest.mark.parametrize("letter", ["C", "D"])
def test_a_measured_antenna_file_is_read_and_written_back(letter, tmp_path):
    """Published: VKB1B 2018-05-22; labels of the header are the measured file's, numbers agree to 1e-15."""
    measured = MEASURED / "gracefo-2018-05-22" / f"VKB1B_2018-05-22_{letter}_04.txt"
    time, vector_b = vectors(measured)
    assert_allclose(vector_b[0, 0], 1.4444, atol=1e-4)
    (again := tmp_path / measured.name).write_text(vcm.vector_file(measured.name, time, letter, vector_b))
    assert_allclose(vectors(again)[1], vector_b, rtol=1e-15, atol=0)
    labels = [[line[:30] for line in p.read_text().splitlines()[:24]] for p in (measured, again)]
    assert labels[0] == labels[1]


SEQUENCE = """\
0.0    GRACEC VKB 3  1.4443985 -0.00017  0.000448  from ground
x 0.0  GRACED VKB 3  1.4444575 -0.000054 0.000230  deleted
634020000.0 GRACEC CMCAL 1 1 seven manoeuvres
634060000.5 GRACEC CMCAL 1 0

634060001 GRACEC VCM 3 90e-6 -87e-6 -3e-6
653600000 GRACED KBRCAL 1 1 campaign
653500000 GRACED AOCS 1 5 SM
653700000 GRACED KBRCAL 1 0
660000000 GRACEC CMCAL 1 1 not ended
670000000 GRACEC CMCAL 1 1
670000100 GRACEC CMCAL 1 0
680000000 GRACEA CMCAL 1 0
"""


def test_a_sequence_of_events_gives_calibrations_and_vectors_in_force(tmp_path):
    """Contract: CMCAL and KBRCAL from 1 to 0, what is not bounded is said; deleted lines are gone; GPS order."""
    path = tmp_path / "TN-01_SOE.txt"
    path.write_text(SEQUENCE)
    entries = vcm.read_sequence(path)
    assert len(entries) == 11
    assert [one.time for one in entries] == sorted(one.time for one in entries)
    assert [(one.calibration, one.satellite, one.start, one.stop) for one in vcm.sessions(entries)] == [
        ("com_offset", "C", 634020000.0, 634060000.5),
        ("kbr_phase_centre", "D", 653600000.0, 653700000.0),
        ("com_offset", "C", 660000000.0, None),
        ("com_offset", "C", 670000000.0, 670000100.0),
        ("com_offset", "A", None, 680000000.0),
    ]
    assert vcm.in_force(entries, "VKB", "C", 1e9).values == (1.4443985, -0.00017, 0.000448)
    assert vcm.in_force(entries, "VKB", "D", 1e9) is None
    assert vcm.in_force(entries, "VCM", "C", 634060000.9) is None
    assert vcm.in_force(entries, "VCM", "C", 634060001.0).values == (90e-6, -87e-6, -3e-6)
    for wrong, message in (("6 GRACEC CMCAL 2 1\n", "1 values"), ("-7e10 GRACEC CMCAL 1 1\n", "a time of -7e")):
        path.write_text(SEQUENCE + wrong)
        with pytest.raises(ProductError, match=rf"line 14: .*found {message}"):
            vcm.read_sequence(path)


def test_events_are_made_of_a_sequence_and_saved(tmp_path, monkeypatch):
    """Contract: a day of a satellite is one event of the catalogue, what is known stays; gravcal events --from."""
    path = tmp_path / "TN-01_SOE.txt"
    known = 633787200 + 18000  # 2020-02-01 05:00, which the catalogue has
    path.write_text(SEQUENCE + f"{known} GRACEC CMCAL 1 1\n{known + 9} GRACEC CMCAL 1 0\n")
    (tmp_path / "own" / "events").mkdir(parents=True)
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path / "own"))
    assert gravcal("events", "--from", path, "--save", "--json", tmp_path / "e.json") == 0
    rows = json.loads((tmp_path / "e.json").read_text())["events"]
    assert [row["state"] for row in rows].count("saved") == 3
    assert {row["state"] for row in rows} == {"saved", "no end", "no begin", "in the catalogue"}
    event = catalog.event("grace-d-2020-09-17")
    assert (event.calibration, str(event.date), str(event.end_date)) == ("kbr_phase_centre", "2020-09-17", "2020-09-18")
    assert "GPS seconds 653600000 to 653700000" in event.source
    assert event.raw_files
