"""Bad input: a file that cannot be understood is refused with its line, a doubtful record is kept and flagged."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gravcal.calibrations.align import UNUSABLE
from gravcal.errors import ProductError
from gravcal.io import readers
from gravcal.io.readers import read
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


COEFFICIENT = repr(float(np.sin(np.linspace(0.1, 0.2, 20))[3])).encode()
FIELDS = b"00000100000000000000000000111111"
REFUSED = {  # in a record of SCA1B: record, what stands there, what instead, words of the message beside the line
    "a column too many": (7, b" 23 ", b" 23 1.0 ", ("columns", "9")),
    "a column too few": (7, b" 23 ", b" ", ("columns", "9")),
    "two points": (3, COEFFICIENT, b"0.1.2", ("quaticoeff", "0.1.2")),
    "underline": (3, COEFFICIENT, b"1_0", ("quaticoeff", "1_0")),
    "exponent of Fortran": (3, COEFFICIENT, b"1d5", ("quaticoeff", "1d5")),
    "flag of 2": (5, b" 00000000", b" 00000002", ("qualflg",)),
    "short flag": (5, b" 00000000", b" 0000000", ("qualflg",)),
    "no UTF-8": (2, b" C ", b" \xff ", ("UTF-8",)),
    "blank line": (4, b"", b"\n", ()),
}
FLAGGED = {  # in a record of SCA1B: record, what stands there, what instead, the only bit of the flag
    "signed NaN": (3, COEFFICIENT, b"-nan", readers.NOT_FINITE | readers.NOT_UNIT),
    "another satellite": (6, b" C ", b" D ", readers.OTHER_SATELLITE),
    "out of range": (6, b" 23 ", b" 24 ", readers.OUT_OF_RANGE),
    "undefined quality bit": (6, b" 00000000", b" 10000000", readers.UNDEFINED),
}
EVIL = b"  evil: !!python/object/apply:os.getcwd []\n"
FOREIGN = {  # bytes of the whole file, from those of a right one; word of the message
    "empty": (lambda _: b"", "empty"),
    "cut in the header": (lambda data: data[:500], "header"),
    "cut in a line": (lambda data: data[:-3], "cut"),
    "code in the header": (lambda data: data.replace(b"  dimensions:", EVIL + b"  dimensions:"), "YAML"),
}


@pytest.mark.parametrize("damage", REFUSED)
def test_a_record_that_cannot_be_understood_is_refused_with_its_line(attitude_file, damage):
    """Contract: nothing is guessed; line and column are named."""
    record, old, new, words = REFUSED[damage]
    _damaged(attitude_file, _replaced(record, old, new))
    _refused(attitude_file, f"line {_line(attitude_file, record)}", *words)


@pytest.mark.parametrize("doubt", FLAGGED)
def test_a_doubtful_record_is_kept_and_flagged(attitude_file, doubt):
    """Contract: one bit in the one record, all records stay."""
    record, old, new, bit = FLAGGED[doubt]
    observed = read(_damaged(attitude_file, _replaced(record, old, new)))
    assert_array_equal(np.flatnonzero(observed.flag), [record])
    assert observed.flag[record] == bit
    assert observed.sizes["record"] == 20


@pytest.mark.parametrize("file", FOREIGN)
def test_a_file_that_is_none_is_refused(attitude_file, file):
    """Contract: a name alone makes no Level-1 file, half a number is a wrong number, a header is never run."""
    change, word = FOREIGN[file]
    attitude_file.write_bytes(change(attitude_file.read_bytes()))
    _refused(attitude_file, attitude_file, word)


def test_a_file_of_another_product_satellite_or_day_is_refused(tmp_path, attitude, acceleration, attitude_file):
    """Contract: against the request, and header and records against the name; nothing there is named, too.

    A Level-1B file in GPS time holds its day alone; on-board tags may lie hours beyond it.
    """
    _refused(tmp_path / "SCA1B_2023-06-02_C_04.txt", "no file")
    _refused(attitude_file, "XYZ1B", "SCA1B", product="XYZ1B")
    _refused(attitude_file, "satellite", "D", expect_satellite="D")
    _refused(attitude_file, "2023-06-01", "2023-06-02", expect_date="2023-06-02")
    renamed = [attitude_file.with_name(f"{one}_04.txt") for one in ("MAG1B_2023-06-01_C", "SCA1B_2023-06-01_D")]
    for path in renamed:
        path.write_bytes(attitude_file.read_bytes())
    _refused(renamed[0], "columns in the header", "MAG1B")
    _refused(renamed[1], "satellite", "C by its records")
    _refused(write(attitude, tmp_path / "SCA1B_2023-06-04_C_04.txt"), "not of 2023-06-04")
    late = attitude | {"gps_time": attitude["gps_time"] + 3600}
    _refused(write(late, tmp_path / "SCA1B_2023-05-31_C_04.txt"), "not of 2023-05-31")
    read(write(acceleration, tmp_path / "ACC1A_2023-05-31_C_04.txt"))
    whole = attitude["gps_time"][0] + np.linspace(0, 86399, attitude["gps_time"].size).astype(int)
    for day in ("2023-05-31", "2023-06-02"):  # of the day beside, which begins where this ends
        _refused(write(attitude | {"gps_time": whole}, tmp_path / f"SCA1B_{day}_C_04.txt"), f"not of {day}")


def test_flags_that_do_not_fit_and_tags_of_another_time_scale_are_refused_and_one_is_flagged(acceleration_file):
    """Contract: a bit more with a column missing, one that stands for nothing; of tags G for R one costs no day."""
    clean = acceleration_file.read_bytes()
    _damaged(acceleration_file, _replaced(4, FIELDS, b"00000100000000000000000001111111"))
    _refused(acceleration_file, f"line {_line(acceleration_file, 4)}", "columns")
    acceleration_file.write_bytes(clean)
    undefined = b"01" + FIELDS[2:]
    change = lambda lines: [line.replace(FIELDS, undefined).rstrip() + b" 1.0\n" for line in lines]  # noqa: E731
    _refused(_damaged(acceleration_file, change), "30", "prod_flag")
    acceleration_file.write_bytes(clean)
    whole = read(acceleration_file)
    _damaged(acceleration_file, lambda lines: [line.replace(b"  R  ", b"  G  ") for line in lines])
    _refused(acceleration_file, "time_ref", "G")
    acceleration_file.write_bytes(clean)
    _damaged(acceleration_file, lambda lines: [*lines[:-2], lines[-2].replace(b"  R  ", b"  G  "), lines[-1]])
    damaged = read(acceleration_file)
    assert (damaged["flag"].values & UNUSABLE != 0).sum() == (whole["flag"].values & UNUSABLE != 0).sum() + 1
    assert damaged["flag"].values[-2] & readers.OUT_OF_RANGE
    assert np.array_equal(damaged["lin_accl_x"], whole["lin_accl_x"])


def test_fractions_in_another_unit_are_refused(tmp_path, acceleration):
    """Contract: nanoseconds where the table says microseconds would move every tag by minutes."""
    path = write(acceleration, tmp_path / "ACC1A_2023-06-01_C_04.txt")
    observed = read(path)
    observed["rcvtime_frac"] = observed.rcvtime_frac * 1000
    _refused(write(observed, path), "rcvtime_frac", "second")


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


def test_quaternion_that_is_no_rotation_is_flagged(tmp_path, attitude):
    """Contract: what exceeds the rounding of the file by far: 1e-7 among 16 digits, not 1e-10, nor among eight digits.

    One coefficient scaled in every record leaves none: the file is refused.
    """
    path, names = tmp_path / "SCA1B_2023-06-01_C_04.txt", ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
    assert not read(write(attitude | {n: np.round(attitude[n], 8) for n in names}, path)).flag.any()
    with pytest.raises(ProductError, match="quaternions whose norm is not one"):
        read(write(attitude | {"quatangle": attitude["quatangle"] * 1.01}, path))
    attitude["quatangle"][4] *= 1 + 1e-4
    attitude["quatangle"][5] *= 1 + 1e-10
    for name in names:
        attitude[name][7] *= 1 + 1e-7
    attitude["quatangle"][6] = attitude["quaticoeff"][6] = 0.0
    assert_array_equal(np.flatnonzero(read(write(attitude, path)).flag == readers.NOT_UNIT), [4, 6, 7])


def test_repeated_and_late_records_are_flagged_and_kept(attitude_file, attitude):
    """Contract: the record that comes too late carries the bit; repeated with equal values one bit, others another."""
    clean = attitude_file.read_bytes()
    observed = read(_damaged(attitude_file, lambda x: [*x[:8], *x[9:12], x[8], *x[12:]]))
    assert_array_equal(np.flatnonzero(observed.flag == readers.OUT_OF_ORDER), [11])
    assert observed.sizes["record"] == 20
    attitude_file.write_bytes(clean)
    old = f"{attitude['quaticoeff'][12]}".encode()
    change = lambda x: [*x[:5], x[4], *x[5:13], x[12].replace(old, b"0.11"), *x[13:]]  # noqa: E731
    observed = read(_damaged(attitude_file, change))
    assert observed.flag[5] == readers.REPEATED
    assert observed.flag[14] & readers.CONFLICTING
    assert np.count_nonzero(observed.flag) == 2


def _binary(tmp_path, records, size_of_last=47):
    labels = ["FILE FORMAT 0=BINARY 1=ASCII  : 0", f"NUMBER OF DATA RECORDS        : {records}", "END OF HEADER"]
    body = np.zeros(records, np.dtype([("t", ">i4"), ("id", "S1"), ("sca", "u1"), ("q", ">f8", 5), ("flag", "u1")]))
    body["t"], body["id"], body["sca"], body["q"][:, 0] = 443016000 + 5 * np.arange(records), b"A", 4, 1.0
    path = tmp_path / "SCA1B_2014-01-15_A_02.dat"
    head = "".join(f"{line:<80}\n" for line in labels).encode()
    path.write_bytes(head + body.tobytes()[: 47 * (records - 1) + size_of_last])
    return path


def test_binary_records_read_and_a_cut_one_is_refused(tmp_path):
    """Analytic: 47 bytes a record, big endian; the message counts the records."""
    observed = read(_binary(tmp_path, 5))
    assert_array_equal(observed.gps_time, 443016000 + 5 * np.arange(5))
    assert_array_equal(observed.quatangle, 1.0)
    assert not observed.flag.any()
    assert _refused(_binary(tmp_path, 5, size_of_last=20), "record 5", "20 bytes", "47")["record"] == 5
