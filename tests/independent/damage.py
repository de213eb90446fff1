"""Faults for written files: each function takes a path (and where), and changes the file in place."""

import re
from pathlib import Path

import h5py
import numpy as np

MARK = b"# End of YAML header\n"


def _read(path):
    head, mark, body = re.split(b"(" + MARK + b"|END OF HEADER[^\n]*\n)", Path(path).read_bytes())
    return head + mark, body.splitlines(keepends=True)


def _write(path, head, rows):
    Path(path).write_bytes(head + b"".join(rows))


def _field(path, row, column, change):
    """Replace one field (zero-based) of one row by change(text)."""
    head, rows = _read(path)
    fields = rows[row].split()
    fields[column] = change(fields[column])
    rows[row] = b" ".join(fields) + b"\n"
    _write(path, head, rows)


def drop_seconds(path, start, stop):
    """Remove the records whose first column lies in [start, stop): a gap."""
    head, rows = _read(path)
    _write(path, head, [r for r in rows if not start <= int(r.split(maxsplit=1)[0]) < stop])


def duplicate_rows(path, first=100, count=20):
    """Write some records twice."""
    head, rows = _read(path)
    _write(path, head, rows[: first + count] + rows[first:])


def conflicting_rows(path, row=100, column=-2):
    """Write one record twice, the second time with another number in a column."""
    head, rows = _read(path)
    fields = rows[row].split()
    fields[column] = repr(float(fields[column]) * 1.5 + 1.0).encode()
    _write(path, head, rows[: row + 1] + [b" ".join(fields) + b"\n"] + rows[row + 1 :])


def shuffle_rows(path, seed=0):
    """Write the records in random order."""
    head, rows = _read(path)
    _write(path, head, [rows[k] for k in np.random.default_rng(seed).permutation(len(rows))])


def put_nan(path, row=100, column=7):
    """Write NaN in one field."""
    _field(path, row, column, lambda _: b"NaN")


def stretch_quaternion(path, row=100, factor=1.01):
    """Make one SCA1B quaternion longer than one."""
    for column in (3, 4, 5, 6):
        _field(path, row, column, lambda text: repr(float(text) * factor).encode())


def flip_quaternions(path, seed=0):
    """Change the sign of about half of the SCA1B quaternions, at random: the attitude stays the same."""
    head, rows = _read(path)
    rng = np.random.default_rng(seed)
    for k in np.flatnonzero(rng.random(len(rows)) < 0.5):
        fields = rows[k].split()
        fields[3:7] = [repr(-float(text)).encode() for text in fields[3:7]]
        rows[k] = b" ".join(fields) + b"\n"
    _write(path, head, rows)


def wrong_satellite(path, letter="D", rows=None):
    """Change the satellite letter of records (all by default)."""
    head, lines = _read(path)
    for k in range(len(lines)) if rows is None else rows:
        fields = lines[k].split()
        old = b"C" if letter == "D" else b"D"
        lines[k] = b" ".join(letter.encode() if f == old else f for f in fields) + b"\n"
    _write(path, head, lines)


def unknown_flag(path, row=100, flag=b"01110010"):
    """Set undefined bits of the quality flag in one record of ACC1A."""
    _field(path, row, 4, lambda _: flag)


def netcdf(path, names, change):
    """Change variables of a netCDF file together: by a function of them that alters them in place or returns others."""
    with h5py.File(path, "r+") as file:
        values = [file[name][...] for name in names]
        for name, value in zip(names, change(*values) or values, strict=True):
            file[name][...] = value


def _of_each(change):
    return lambda *values: [change(one) for one in values] and None


def times(factor, *place, first=0.0, count=None):
    """Other unit, sign or nothing of what stands at a place behind time; from a share of the record on, so many."""

    def change(values):
        start = int(first * len(values))
        values[start : None if count is None else start + count, *place] *= factor

    return _of_each(change)


def exchanged(first, second):
    """Two components exchanged."""

    def change(values):
        values[..., [first, second]] = values[..., [second, first]]

    return _of_each(change)


def held(*place):
    """A tenth of the record frozen."""

    def change(values):
        start, stop = int(0.45 * len(values)), int(0.55 * len(values))
        values[start:stop, *place] = values[start, *place]

    return _of_each(change)


def late(seconds):
    """Times of the whole file moved."""
    return lambda time: (time + seconds,)
