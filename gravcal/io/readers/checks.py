"""Checks of read records: what is doubtful keeps its value and gets a bit in ``flag``."""

import re

import numpy as np

from gravcal.errors import refuse
from gravcal.io.archive import TOGETHER
from gravcal.io.readers.tables import BITS, FLOATS, INTEGERS, Product

NOT_FINITE = 1
NOT_UNIT = 2
OUT_OF_ORDER = 4
REPEATED = 8
CONFLICTING = 16
OTHER_SATELLITE = 32
OUT_OF_RANGE = 64
UNDEFINED = 128
MEANING = {
    NOT_FINITE: "a value is NaN or infinite",
    NOT_UNIT: "the norm of the quaternion differs from 1 by more than 1e-6",
    OUT_OF_ORDER: "the time tag is before an earlier record's",
    REPEATED: "the time tag repeats an earlier record's, values equal",
    CONFLICTING: "the time tag repeats an earlier record's, values differ",
    OTHER_SATELLITE: "the record names another satellite than the file",
    OUT_OF_RANGE: "a value is outside the range the product defines, or the tag is of another time scale",
    UNDEFINED: "a quality bit that is not defined is set, or text that is not UTF-8",
}
NORM_LIMIT = 1e-6
KNOWN_TIMES = {"GPS": b"G", "OBC": b"R", "receiver": b"R", "LRI": b"SB"}
DAY_S = 86400
MARGIN_S = 4 * 3600  # files by an on-board or receiver clock overlap their day by up to three hours
GPS_MARGIN_S = 600  # files in GPS time hold their day; USO1B begins five minutes before


def flags(arrays: dict, ticks: np.ndarray, table: Product, satellite: str) -> np.ndarray:
    """Bits of what is doubtful in each record.

    Parameters
    ----------
    arrays : columns of the file
    ticks : (n,) int64 ns, time tags
    table : the product's columns
    satellite : letter of the file

    Returns
    -------
    flag : (n,) uint8, bits as in ``MEANING``
    """
    flag = np.zeros(len(ticks), np.uint8)
    _mark(flag, arrays.get("undecodable"), UNDEFINED)
    _mark(flag, _other_time(arrays, table), OUT_OF_RANGE)
    for column in (*table.columns, *table.optional):
        if column.name in arrays:
            _check_column(flag, arrays, column, table)
    if table.id_name and satellite:
        _mark(flag, arrays[table.id_name] != satellite.encode(), OTHER_SATELLITE)
    if table.quaternion:
        _mark(flag, _not_unit([arrays[name] for name in table.quaternion]), NOT_UNIT)
    _check_order(flag, ticks, arrays, table)
    return flag


def _mark(flag, where, bit):
    if where is not None and where.any():
        flag[where] |= bit


def _check_column(flag, arrays, column, table):
    values = arrays[column.name]
    if column.kind in FLOATS:
        present = arrays["prod_flag"] >> column.bit & 1 if column.bit is not None else 1
        if not np.isfinite(values).all():
            _mark(flag, ~np.isfinite(values) & (present == 1), NOT_FINITE)
    if column.kind in (*INTEGERS, *FLOATS) and len(column.range) == 2 and values.size:
        low, high = column.range
        if not (np.nanmin(values, initial=low) >= low and np.nanmax(values, initial=high) <= high):
            _mark(flag, (values < low) | (values > high), OUT_OF_RANGE)
    if column.kind in BITS and column.bit is None and (table.flags or {}).get(column.name):
        defined = sum(1 << int(bit) for bit in table.flags[column.name])
        _mark(flag, (values & ~values.dtype.type(defined)) != 0, UNDEFINED)


def _not_unit(components):
    with np.errstate(over="ignore", invalid="ignore"):
        norm = np.sqrt(sum(c * c for c in components))
    return ~(np.abs(norm - 1) <= NORM_LIMIT)


def _check_order(flag, ticks, arrays, table):
    steps = np.diff(ticks)
    if (steps > 0).all():
        return
    latest = np.maximum.accumulate(ticks)
    _mark(flag, np.concatenate([[False], ticks[1:] < latest[:-1]]), OUT_OF_ORDER)
    keys = [np.unique(arrays[k], return_inverse=True)[1] for k in table.keys if k in arrays]
    order = np.lexsort([np.arange(len(ticks)), *keys, ticks])
    same = np.ones(len(ticks) - 1, bool)
    for key in (ticks, *keys):
        same &= key[order][1:] == key[order][:-1]
    if not same.any():
        return
    equal = _equal_neighbours(arrays, table, order)
    _mark(flag, _scatter(order[1:], same & equal), REPEATED)
    _mark(flag, _scatter(order[1:], same & ~equal), CONFLICTING)


def _equal_neighbours(arrays, table, order):
    equal = np.ones(len(order) - 1, bool)
    for column in (*table.columns, *table.optional, *table.repeated):
        if column.name in arrays and column.name != "qualflg":
            values = arrays[column.name][order]
            alike = (values[1:] == values[:-1]) | ((values[1:] != values[1:]) & (values[:-1] != values[:-1]))
            equal &= alike.reshape(len(alike), -1).all(axis=1)
    return equal


def _scatter(places, chosen):
    found = np.zeros(len(places) + 1, bool)
    found[places[chosen]] = True
    return found


def check_identity(file, header, table, arrays, expected):
    """Refuse a file of another satellite, day or time scale than its name, header or the caller says.

    Parameters
    ----------
    file : LevelOneFile, what the name says
    header : what the header says
    table, arrays : the product's columns, and the records
    expected : satellite letter and date the caller expects, None where anything will do

    Raises
    ------
    ProductError : naming what contradicts what
    """
    where, (satellite, day) = file.where, expected
    if not table.id_name:  # a combined product is the file of either satellite
        satellite = TOGETHER.get(satellite, satellite)
    said = {"name": file.satellite, "request": satellite or ""}
    said["records"] = _letter_of_records(arrays, table)
    if not said["records"]:  # headers are known to name the other satellite: records overrule them
        said["header"] = header.satellite
    letters = {k: v for k, v in said.items() if v}
    if len(set(letters.values())) > 1:
        found = ", ".join(f"{v} by its {k}" for k, v in letters.items())
        refuse(where, f"satellite {found}", "one satellite", "Take the file of the right satellite.", **letters)
    if day and file.date and file.date != day:
        refuse(where, f"a file of {file.date}", day, "Take the file of the right day.", date=file.date)
    seconds = arrays[table.time[0]]
    if (day or file.date) and len(seconds) and not table.constant:
        exact = table.time_scale == "GPS" and table.name.endswith("1B")
        _check_day(where, day or file.date, seconds, GPS_MARGIN_S if exact else MARGIN_S)
    _check_time_ref(where, table, arrays)


def _letter_of_records(arrays, table):
    """Satellite most records name, empty for combined products and files without records."""
    if not table.id_name or not len(arrays[table.id_name]):
        return ""
    return chr(np.bincount(arrays[table.id_name].view(np.uint8)).argmax())


def _check_day(where, date, seconds, margin):
    if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", date):
        refuse(where, f"the date {date}", "YYYY-MM-DD", "Correct the date.")
    noon_2000 = np.datetime64("2000-01-01T12:00:00")
    start = int((np.datetime64(date) - noon_2000) / np.timedelta64(1, "s"))
    inside = (seconds >= start - margin) & (seconds < start + DAY_S + margin)
    if not inside.any():
        first = np.datetime_as_string(noon_2000 + np.timedelta64(int(seconds[0]), "s"))
        refuse(
            where, f"no record of {date}, the first at {first} GPS", f"records of {date}", "Take the right day's file."
        )


def _other_time(arrays, table):
    """Records whose tag is of another time scale than the product's; None where no record says."""
    if "time_ref" not in arrays:
        return None
    known = np.frombuffer(KNOWN_TIMES[table.time_scale], np.uint8)
    return ~np.isin(arrays["time_ref"].view(np.uint8), known)


def _check_time_ref(where, table, arrays):
    """Refuse a file most of whose tags are of another time scale; fewer are flagged."""
    wrong = _other_time(arrays, table)
    if wrong is None or 2 * np.count_nonzero(wrong) <= wrong.size:
        return
    refuse(
        where,
        f"time_ref {', '.join(sorted({one.decode('latin-1') for one in np.unique(arrays['time_ref'][wrong])}))}",
        f"{', '.join(KNOWN_TIMES[table.time_scale].decode())} for {table.time_scale} time",
        "The tags are of another time scale: take the product of the right level.",
    )
