"""Bad input: a file that cannot be understood is refused with its line, a doubtful record is kept and flagged."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gravcal.calibrations.align import UNUSABLE
from gravcal.errors import ProductError
from gravcal.io.readers import dataset, read
from gravcal.io.writers import write

END = b"# End of YAML header\n"


def _damaged(path, change):
    """Apply a change to the list of record lines."""
    head, _, body = path.read_bytes().partition(END)
    path.write_bytes(head + END + b"".join(change(body.splitlines(keepends=True))))
    return path


def _line(path, record):
    return path.read_bytes().partition(END)[0].count(b"\n") + 1 + record + 1


def _refused(path, *words, **arguments):
    with pytest.raises(ProductError) as caught:
        read(path, **arguments)
    message = str(caught.value)
    for word in words:
        assert str(word) in message
    assert caught.value.facts["expected"]
    assert caught.value.facts["remedy"]
    return caught.value.facts


def _replaced(record, old, new):
    def change(lines):
        assert old in lines[record]
        lines[record] = lines[record].replace(old, new, 1)
        return lines

    return change


def test_empty_file_is_refused(tmp_path):
    """Contract: nothing in it, nothing made of it."""
    path = tmp_path / "SCA1B_2023-06-01_C_04.txt"
    path.write_bytes(b"")
    _refused(path, path, "empty")


def test_missing_file_is_refused(tmp_path):
    """Contract: the message names the path."""
    _refused(tmp_path / "SCA1B_2023-06-01_C_04.txt", "no file")


def test_file_cut_in_a_line_is_refused(acceleration_file):
    """Contract: half a number is a wrong number."""
    acceleration_file.write_bytes(acceleration_file.read_bytes()[:-3])
    facts = _refused(acceleration_file, "cut", f"line {_line(acceleration_file, 29)}")
    assert facts["line"] == _line(acceleration_file, 29)


def test_file_cut_in_the_header_is_refused(attitude_file):
    """Contract: no end of header, no records."""
    attitude_file.write_bytes(attitude_file.read_bytes()[:500])
    _refused(attitude_file, "header")


def test_other_files_are_refused(tmp_path):
    """Contract: a name alone makes no Level-1 file."""
    path = tmp_path / "SCA1B_2023-06-01_C_04.txt"
    path.write_bytes(b"PK\x03\x04 something else")
    _refused(path, "header")


@pytest.mark.parametrize("instead", [b" 23 1.0 ", b" "])
def test_wrong_number_of_columns_is_refused_with_the_line(attitude_file, instead):
    """Contract: one column too many or too few in record 7."""
    _damaged(attitude_file, _replaced(7, b" 23 ", instead))
    _refused(attitude_file, f"line {_line(attitude_file, 7)}", "columns", "9")


@pytest.mark.parametrize("token", [b"0.1.2", b"1_0", b"0x1", b"*****", b"1d5"])
def test_text_in_a_number_is_refused_with_line_and_column(attitude_file, attitude, token):
    """Contract: what is no number is not guessed."""
    old = f"{attitude['quaticoeff'][3]}".encode()
    _damaged(attitude_file, _replaced(3, old, token))
    _refused(attitude_file, f"line {_line(attitude_file, 3)}", "quaticoeff", token.decode())


@pytest.mark.parametrize("flag", [b"00000002", b"0000000", b"000000000", b"0000000x"])
def test_unknown_flag_characters_are_refused(attitude_file, flag):
    """Contract: a quality flag is eight characters 0 or 1."""
    _damaged(attitude_file, _replaced(5, b" 00000000", b" " + flag))
    _refused(attitude_file, f"line {_line(attitude_file, 5)}", "qualflg")


def test_product_flag_that_promises_more_than_the_record_holds_is_refused(acceleration_file):
    """Contract: one more bit, one column missing."""
    _damaged(acceleration_file, _replaced(4, b"00000100000000000000000000111111", b"00000100000000000000000001111111"))
    _refused(acceleration_file, f"line {_line(acceleration_file, 4)}", "columns")


def test_undefined_bit_of_the_product_flag_is_refused(acceleration_file):
    """Contract: bit 30 of ACC1A stands for nothing, so the columns have no names."""

    def change(lines):
        old, new = b"00000100000000000000000000111111", b"01000100000000000000000000111111"
        return [line.replace(old, new).rstrip() + b" 1.0\n" for line in lines]

    _refused(_damaged(acceleration_file, change), "30", "prod_flag")


def test_bytes_that_are_no_text_are_refused_with_the_line(attitude_file):
    """Contract: not UTF-8 in record 2."""
    _damaged(attitude_file, _replaced(2, b" C ", b" \xff "))
    _refused(attitude_file, f"line {_line(attitude_file, 2)}", "UTF-8")


def test_header_of_another_product_is_refused(tmp_path, attitude):
    """Contract: the columns the header lists are not those of the product of the name."""
    path = write(attitude, tmp_path / "MAG1B_2023-06-01_C_04.txt", "SCA1B")
    _refused(path, "columns in the header", "MAG1B")


def test_wrong_satellite_is_refused(tmp_path, attitude, attitude_file):
    """Contract: against the request, and records against the name."""
    _refused(attitude_file, "satellite", "D", expect_satellite="D")
    path = write(attitude, tmp_path / "SCA1B_2023-06-01_D_04.txt", satellite="C")
    _refused(path, "satellite", "C by its records")


def test_wrong_day_is_refused(tmp_path, attitude, attitude_file):
    """Contract: against the request, and records against the name."""
    _refused(attitude_file, "2023-06-01", "2023-06-02", expect_date="2023-06-02")
    _refused(write(attitude, tmp_path / "SCA1B_2023-06-04_C_04.txt"), "no record of 2023-06-04")


def test_gps_times_of_the_next_morning_are_the_wrong_day(tmp_path, attitude, acceleration):
    """Contract: a Level-1B file in GPS time holds its day alone; on-board tags may lie hours beyond it."""
    late = attitude | {"gps_time": attitude["gps_time"] + 3600}
    _refused(write(late, tmp_path / "SCA1B_2023-05-31_C_04.txt"), "no record of 2023-05-31")
    read(write(acceleration, tmp_path / "ACC1A_2023-05-31_C_04.txt"))


def test_tags_of_another_time_scale_are_refused(acceleration_file):
    """Contract: ACC1A holds receiver tags, R; a G says something else happened to it."""
    _damaged(acceleration_file, lambda lines: [line.replace(b"  R  ", b"  G  ") for line in lines])
    _refused(acceleration_file, "time_ref", "G")


def test_one_tag_of_another_time_scale_is_flagged(acceleration_file):
    """Contract: a day is not lost for one record; it keeps its values and is not used."""
    whole = read(acceleration_file)
    _damaged(acceleration_file, lambda lines: [*lines[:-2], lines[-2].replace(b"  R  ", b"  G  "), lines[-1]])
    damaged = read(acceleration_file)
    assert (damaged["flag"].values & UNUSABLE != 0).sum() == (whole["flag"].values & UNUSABLE != 0).sum() + 1
    assert damaged["flag"].values[-2] & dataset.OUT_OF_RANGE
    assert np.array_equal(damaged["lin_accl_x"], whole["lin_accl_x"])


def test_fractions_in_another_unit_are_refused(tmp_path, acceleration):
    """Contract: nanoseconds where the table says microseconds would move every tag by minutes."""
    path = write(acceleration, tmp_path / "ACC1A_2023-06-01_C_04.txt")
    observed = read(path).drop_vars(["time_second", "time_fraction"])
    observed["rcvtime_frac"] = observed.rcvtime_frac * 1000
    _refused(write(observed, path), "rcvtime_frac", "second")


def test_blank_line_inside_is_refused(attitude_file):
    """Contract: a lost record is not passed over in silence."""
    _damaged(attitude_file, lambda lines: [*lines[:4], b"\n", *lines[4:]])
    _refused(attitude_file, f"line {_line(attitude_file, 4)}")


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [line.replace(b" ", b"   ") for line in lines],
        lambda lines: [line.replace(b" ", b"\t") for line in lines[:5]] + lines[5:],
        lambda lines: [line.replace(b"\n", b"\r\n") for line in lines],
        lambda lines: [b"  " + line.replace(b"\n", b"  \n") for line in lines],
        lambda lines: [*lines, b"\n", b"  \n"],
    ],
)
def test_blanks_are_only_blanks(attitude_file, change):
    """Contract: wider gaps, tabs, line ends of other systems and trailing blanks change nothing."""
    before = read(attitude_file)
    after = read(_damaged(attitude_file, change))
    for name in before:
        assert_array_equal(before[name].values, after[name].values)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_kept_and_flagged(tmp_path, acceleration, value):
    """Contract: bit 1 in the one record, its tag and its other values stay."""
    acceleration["lin_accl_x"][11] = value
    observed = read(write(acceleration, tmp_path / "ACC1A_2023-06-01_C_04.txt"))
    assert_array_equal(np.flatnonzero(observed.flag), [11])
    assert observed.flag[11] == dataset.NOT_FINITE
    assert_array_equal(observed.lin_accl_x.values, acceleration["lin_accl_x"])
    assert_array_equal(observed.lin_accl_y.values, acceleration["lin_accl_y"])


def test_signed_nan_is_nan(attitude_file, attitude):
    """Contract: -nan, as C prints it."""
    old = f"{attitude['quaticoeff'][3]}".encode()
    observed = read(_damaged(attitude_file, _replaced(3, old, b"-nan")))
    assert observed.flag[3] & dataset.NOT_FINITE
    assert observed.sizes["record"] == 20


def test_quaternion_that_is_no_rotation_is_flagged(tmp_path, attitude):
    """Contract: 2e-6 off is flagged, 1e-9 is not."""
    attitude["quatangle"][4] *= 1 + 1e-4
    attitude["quatangle"][5] *= 1 + 1e-9
    attitude["quatangle"][6] = attitude["quaticoeff"][6] = 0.0
    observed = read(write(attitude, tmp_path / "SCA1B_2023-06-01_C_04.txt"))
    assert_array_equal(np.flatnonzero(observed.flag == dataset.NOT_UNIT), [4, 6])


def test_records_out_of_order_are_flagged(attitude_file):
    """Contract: the record that comes too late carries the bit, all are kept."""
    observed = read(_damaged(attitude_file, lambda x: [*x[:8], *x[9:12], x[8], *x[12:]]))
    assert_array_equal(np.flatnonzero(observed.flag == dataset.OUT_OF_ORDER), [11])
    assert observed.sizes["record"] == 20


def test_repeated_records_are_flagged_by_their_values(attitude_file, attitude):
    """Contract: equal values one bit, other values another."""
    old = f"{attitude['quaticoeff'][12]}".encode()

    def change(lines):
        return [*lines[:5], lines[4], *lines[5:13], lines[12].replace(old, b"0.11"), *lines[13:]]

    observed = read(_damaged(attitude_file, change))
    assert observed.flag[5] == dataset.REPEATED
    assert observed.flag[14] & dataset.CONFLICTING
    assert np.count_nonzero(observed.flag) == 2


def test_records_of_another_satellite_are_flagged(attitude_file):
    """Contract: one D among the C."""
    observed = read(_damaged(attitude_file, _replaced(6, b" C ", b" D ")))
    assert_array_equal(np.flatnonzero(observed.flag == dataset.OTHER_SATELLITE), [6])


def test_values_outside_their_range_are_flagged(attitude_file):
    """Contract: sca_id goes to 23."""
    observed = read(_damaged(attitude_file, _replaced(6, b" 23 ", b" 24 ")))
    assert_array_equal(np.flatnonzero(observed.flag == dataset.OUT_OF_RANGE), [6])


def test_undefined_quality_bits_are_flagged(attitude_file):
    """Contract: bit 7 of SCA1B is not defined."""
    observed = read(_damaged(attitude_file, _replaced(6, b" 00000000", b" 10000000")))
    assert_array_equal(np.flatnonzero(observed.flag == dataset.UNDEFINED), [6])
    assert observed.qualflg[6] == 128


def test_header_is_data_and_never_run(attitude_file):
    """Contract: YAML that would build an object is refused."""
    data = attitude_file.read_bytes().replace(
        b"  dimensions:", b"  evil: !!python/object/apply:os.getcwd []\n  dimensions:"
    )
    attitude_file.write_bytes(data)
    _refused(attitude_file, "YAML")


def test_unknown_product_is_refused(attitude_file):
    """Contract: the message lists the products there are."""
    _refused(attitude_file, "XYZ1B", "SCA1B", product="XYZ1B")


def test_unknown_column_is_refused(attitude_file):
    """Contract: the message names the wrong one."""
    _refused(attitude_file, "quatx", columns=["quatx"])


def _binary(tmp_path, records, size_of_last=47):
    labels = ["FILE FORMAT 0=BINARY 1=ASCII  : 0", f"NUMBER OF DATA RECORDS        : {records}", "END OF HEADER"]
    body = np.zeros(records, np.dtype([("t", ">i4"), ("id", "S1"), ("sca", "u1"), ("q", ">f8", 5), ("flag", "u1")]))
    body["t"], body["id"], body["sca"], body["q"][:, 0] = 443016000 + 5 * np.arange(records), b"A", 4, 1.0
    path = tmp_path / "SCA1B_2014-01-15_A_02.dat"
    head = "".join(f"{line:<80}\n" for line in labels).encode()
    path.write_bytes(head + body.tobytes()[: 47 * (records - 1) + size_of_last])
    return path


def test_binary_records_read(tmp_path):
    """Analytic: 47 bytes a record, big endian."""
    observed = read(_binary(tmp_path, 5))
    assert_array_equal(observed.gps_time, 443016000 + 5 * np.arange(5))
    assert_array_equal(observed.quatangle, 1.0)
    assert not observed.flag.any()


def test_cut_binary_record_is_refused(tmp_path):
    """Contract: the message counts the records."""
    facts = _refused(_binary(tmp_path, 5, size_of_last=20), "record 5", "20 bytes", "47")
    assert facts["record"] == 5
