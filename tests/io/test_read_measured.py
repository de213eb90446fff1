"""Every measured file reads; text and binary, loose and archived files agree."""

import numpy as np
import pytest
from commands import MEASURED
from numpy.testing import assert_array_equal

from gravcal.io.archive import find, inventory
from gravcal.io.readers import read
from gravcal.io.writers import write

pytestmark = pytest.mark.measured
DAY = MEASURED / "gracefo-2023-06-01"
TIGHT = 1e-14  # relative: the text prints 16 digits
WRITTEN = ("ACC1A", "ACT1A", "ACT1B", "SCA1A", "SCA1B", "MAG1A", "MAG1B", "GNV1B", "GNI1B", "CLK1B", "TIM1B", "KBR1B")
SINGLE = 1e-6  # relative: 16 digits of a number that is a float32


def _same(one, other, names=None):
    for name in names or one.data_vars:
        assert_array_equal(one[name].values, other[name].values, err_msg=name)


def test_every_measured_file_reads_with_all_its_records():
    """Contract: no product is left out; 100 lines after the header, 100 records, whatever prod_flag says."""
    files, counted = inventory(MEASURED), 0
    assert len({file.product for file in files}) >= 50
    for file in files:
        observed = read(file)
        assert observed.attrs["product"] == file.product
        wrong_header = file.name == "QSA1B_2018-05-22_D_04.txt"  # three records, one declared
        assert wrong_header or observed.sizes["record"] <= observed.attrs["records_declared"]
        assert "cut" not in observed.attrs or file.path.parent.name == "gracefo-2023-06-01"
        if file.member is None and file.path.parent.name == "gracefo-2023-06-01":
            body = file.path.read_bytes().partition(b"# End of YAML header\n")[2]
            body = body or file.path.read_bytes().partition(b"END OF HEADER")[2].partition(b"\n")[2]
            assert observed.sizes["record"] == body.count(b"\n"), file.name
            counted += 1
    assert counted > 50


#: SRF (x, y, z) are the columns z, x, y of the file, linear and angular, without a change of sign.
SRF = {"lin_accl_x": 8, "lin_accl_y": 6, "lin_accl_z": 7, "ang_accl_x": 11, "ang_accl_y": 9, "ang_accl_z": 10}


@pytest.mark.parametrize(
    ("product", "columns"),
    [
        ("ACC1A", SRF),
        ("ACT1A", SRF),
        ("ACT1B", {"lin_accl_x": 2, "acl_z_res": 10}),
        ("GNI1B", {"xpos": 3, "zvel": 11}),
        ("MAG1A", {"MfvX_RAW": 4, "torque3B": 12, "time_frac": 1}),
        ("CLK1B", {"eps_time": 3, "eps_drift": 5}),
        ("THR1B", {"thrust_count_att_ctrl_1_1": 4, "accum_dur_orb_ctrl": 44}),
        ("SCA1B", {"quatangle": 3, "qual_rss": 7}),
    ],
)
def test_numbers_are_those_of_the_text(product, columns):
    """Contract: bit for bit what Python's float makes of the token."""
    file = find(DAY, product, "C", "2023-06-01")
    observed = read(file)
    lines = file.path.read_text().partition("# End of YAML header\n")[2].splitlines()
    for name, place in columns.items():
        assert_array_equal(observed[name].values, [float(line.split()[place]) for line in lines])
        assert columns is not SRF or observed[name].attrs["frame"] == "b"


def test_values_that_a_record_lacks_are_nan():
    """Contract: TNK1A has two kinds of records; each holds what its prod_flag says."""
    observed = read(find(DAY, "TNK1A", "C", "2023-06-01"))
    for name, bit in (("tank_pres", 0), ("reg_pres", 1), ("skin_temp", 2), ("boss_sliding", 6)):
        assert_array_equal(np.isfinite(observed[name].values), observed.prod_flag.values >> bit & 1 == 1)
    assert "skin_temp_r" not in observed  # no record holds it
    rows = observed.prod_flag.values == 0b01110100
    assert_array_equal(observed.boss_sliding.values[rows][0], 4.772736072540283)


def test_binary_equals_text_record_by_record():
    """Contract: 2003-09-14, every product of A, B and X; float32 columns to their own precision."""
    pairs = 0
    for file in inventory(MEASURED / "grace-2003-09-14" / "binary"):
        text = read(find(MEASURED / "grace-2003-09-14" / "ascii", file.product, file.satellite, file.date))
        binary = read(file)
        assert set(text) == set(binary)
        for name in text:
            one, other = text[name].values, binary[name].values
            if one.dtype.kind == "f":
                np.testing.assert_allclose(one, other, rtol=SINGLE, err_msg=f"{file.name} {name}")
                exact = np.isclose(one, other, rtol=TIGHT, atol=0, equal_nan=True)
                assert (exact | (np.float32(one) == other)).all(), f"{file.name} {name}"
            else:
                assert_array_equal(one, other, err_msg=f"{file.name} {name}")
        pairs += 1
    assert pairs == 41


def test_daily_archives_hold_what_the_loose_files_hold():
    """Contract: members are read without extraction; AppleDouble members are no files."""
    files = inventory(DAY)
    members = [f for f in files if f.member]
    loose = {f.name: f for f in files if not f.member}
    assert len(members) > 70
    assert not any("._" in f.member for f in members)
    for member in members:
        if member.name != "AHK1A_2023-06-01_C_04.txt":  # its loose copy has no records
            _same(read(member), read(loose[member.name]))


def test_headers_signs_of_missions_and_clean_records_are_understood():
    """Published: GRACE-FO nA + nB, GRACE nA - nB (formats.md, 2.4); only a clock record that comes twice is flagged."""
    observed = read(DAY / "ACT1B_2024-04-01_D_04.txt")
    assert observed.sizes["record"] == 0
    assert observed.lin_accl_x.dtype == float
    observed = read(MEASURED / "gracefo-2018-05-22" / "VGN1B_2018-05-22_D_04.txt")
    assert (observed.attrs["satellite"], observed.attrs["header_satellite"]) == ("D", "C")
    new = read(find(DAY, "MAG1B", "C", "2023-06-01"))
    old = read(find(MEASURED / "grace-2003-09-14" / "binary", "MAG1B", "A", "2003-09-14"))
    assert_array_equal(new.current_b[0], [4.621397018432617, -2.094727039337158, 1.34342896938324])
    assert_array_equal(old.current_b[0], [0 - 12.83203125, 0.3515625 - 3.427734375, 0 - 6.15234375])
    for product in ("ACC1A", "SCA1A", "SCA1B", "MAG1A", "MAG1B", "GNV1B", "GNI1B", "IMU1A", "KBR1B", "THR1B", "TIM1B"):
        for file in (f for f in inventory(DAY) if f.product == product):
            assert not read(file).flag.any(), file.name
    assert_array_equal(np.flatnonzero(read(find(DAY, "CLK1B", "C", "2023-06-01")).flag), [1])


def test_measured_files_written_and_read_again_are_equal(tmp_path):
    """Analytic: read after write is the identity, for every product the simulator writes."""
    for product in WRITTEN:
        file = next(f for f in inventory(DAY) if f.product == product)
        observed = read(file)
        _same(observed, read(write(observed, tmp_path / file.name)))
