"""Level-1 files as xarray Datasets: one table per product, native values and tags, accelerometer axes moved to SRF.

What is doubtful keeps its value and gets a bit in ``flag``.
"""

import re
from pathlib import Path

import numpy as np
import xarray as xr

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.archive import LevelOneFile, find, inventory
from gravcal.io.readers import records
from gravcal.io.readers.records import BITS, FLOATS, INTEGERS, Product, mission_of, reordered
from gravcal.io.readers.records import product as product_table

__all__ = ["LevelOneFile", "find", "inventory", "read"]
TICKS = {"s": 1_000_000_000, "us": 1_000, "ns": 1}
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
    NOT_UNIT: "the norm of the quaternion differs from 1 by ten times the rounding of the file, 1e-9 to 1e-6",
    OUT_OF_ORDER: "the time tag is before an earlier record's",
    REPEATED: "the time tag repeats an earlier record's, values equal",
    CONFLICTING: "the time tag repeats an earlier record's, values differ",
    OTHER_SATELLITE: "the record names another satellite than the file",
    OUT_OF_RANGE: "a value is outside the range the product defines, or the tag is of another time scale",
    UNDEFINED: "a quality bit that is not defined is set, or text that is not UTF-8",
}
#: Largest difference of a norm from one, in medians of the file (its digits) and absolutely; measured: 4e-16 to 9e-11.
NORM_ROUNDINGS, NORM_LIMITS = 10, (1e-9, 1e-6)
NORM_SHARE = 0.5  # of a file's quaternions, from which on it is damaged as a whole
KNOWN_TIMES = {"GPS": b"G", "OBC": b"R", "receiver": b"R", "LRI": b"SB"}
DAY_S = 86400
MARGIN_S = 4 * 3600  # files by an on-board or receiver clock overlap their day by up to three hours
GPS_MARGIN_S = 600  # files in GPS time hold their day; USO1B begins five minutes before
MOVED = "columns moved from the accelerometer frame: SRF (x, y, z) = AF (z, x, y)"


def read(source, product=None, *, expect_satellite=None, expect_date=None) -> xr.Dataset:
    """One Level-1 file, values and time tags as they are.

    Parameters
    ----------
    source : path of a file (.txt .asc .dat, also .gz), path of a .tgz holding one file of the product,
        or a LevelOneFile
    product : five characters, such as "ACC1A"; by default from the name or the header
    expect_satellite : letter the file has to be of
    expect_date : "YYYY-MM-DD" the file has to be of

    Returns
    -------
    observed : Dataset over ``record``; one variable per column of the product, named as in the file,
        optional ones (``prod_flag``) where at least one record holds them, NaN where absent;
        ``time_tag`` s, ``time_second`` s and ``time_fraction`` s (the exact tag is their sum);
        ``flag`` bits of doubt; for MAG ``current_b`` (record, axis) mA; for TIM1B ``receiver_second``
        and ``receiver_fraction`` s; attrs with the header

    Raises
    ------
    ProductError : the file cannot be understood, or is not the expected one
    """
    file = source
    if not isinstance(source, archive.LevelOneFile):
        path = Path(source)
        if archive.is_archive(path):
            if not product:
                refuse(path, "an archive", "a product to read from it", "Give the product, or use find().")
            file = archive.find(path, product, expect_satellite, expect_date)
        else:
            file = archive.from_name(path) or archive.LevelOneFile(path, None, "", "", "", "")
    data = archive.content(file)
    header = records.parse_header(data, file.where)
    satellite = file.satellite or header.satellite
    product = product or file.product or header.product
    if not product:
        refuse(file.where, "no product in the name or header", "one", "Give the product.")
    table = product_table(product, mission_of(satellite))
    _check_columns(header, table, file.where)
    if header.binary:
        arrays = records.parse_binary(data, header.size, table, file.where)
    else:
        arrays = records.parse_text(data, header.size, header.lines, table, file.where)
    seconds, ticks = _tags(arrays, table, file.where)
    _check_identity(file, header, table, arrays, (expect_satellite, expect_date))
    flag = flags(arrays, ticks, table, satellite)
    observed = _assembled(arrays, seconds, ticks, flag, table)
    attrs = {"product": table.name, "mission": table.mission, "satellite": satellite, "date": file.date}
    attrs |= {"release": file.release, "file": file.name, "time_scale": table.time_scale, "records": len(flag)}
    if header.declared is not None:
        attrs["records_declared"] = header.declared
    if header.satellite and header.satellite != satellite:
        attrs["header_satellite"] = header.satellite
    attrs |= {"table_tested": str(table.sampled).lower()}
    observed.attrs = attrs | {f"header_{k}": v for k, v in header.notes.items()}
    observed.attrs["origin"] = archive.origin_of_header(data[: header.size].decode("latin-1"))
    return observed


def _check_columns(header, table: Product, where):
    """The columns a YAML header lists have to be those of the table, in its order; optional ones may be left out."""
    if not header.names:
        return
    found = [n for n in map(_plain, header.names) if n not in map(_plain, table.header_only)]
    for known in (table, reordered(table, table.swapped_in_header)):
        fixed = [_plain(c.file_name) for c in known.columns]
        expected = fixed + [_plain(c.file_name) for c in (*known.optional, *known.repeated)]
        if [n for n in expected if n in found] == found and set(fixed) <= set(found):
            return
    differing = sorted((set(found) - set(expected)) | (set(fixed) - set(found))) or "the same ones in another order"
    found = f"columns in the header that differ from the table of {table.name}: {differing}"
    refuse(where, found, "the columns of RL04", "Another product or release: give the right product, or add its table.")


def _plain(name):
    return re.sub(r"[^A-Za-z0-9+-]", "_", str(name).strip())


def _tags(arrays, table, where):
    """Whole seconds, and ns since the epoch."""
    ticks = arrays[table.time[0]] * TICKS["s"]
    if len(table.time) > 1:
        column, values = table.column(table.time[1]), arrays[table.time[1]]
        tick = TICKS[column.units]
        beyond = np.count_nonzero((values < 0) | (values >= TICKS["s"] // tick))
        if beyond > len(values) / 2:
            found = f"{column.name} up to {values.max()} {column.unit}"
            refuse(where, found, "less than one second", "The unit differs from the table's: correct the table.")
        ticks = ticks + values * tick
    return ticks // TICKS["s"], ticks


def _assembled(arrays, seconds, ticks, flag, table):
    fractions = (ticks - seconds * TICKS["s"]) / TICKS["s"]
    common = {"time_scale": table.time_scale, "units": "s"}
    note = "seconds past 2000-01-01 12:00:00 GPS"
    variables = {
        "time_tag": ("record", seconds + fractions, {**common, "long_name": f"time tag, {note}"}),
        "time_second": ("record", seconds, {**common, "long_name": f"whole part of the time tag, {note}"}),
        "time_fraction": ("record", fractions, {**common, "long_name": "fractional part of the time tag"}),
        "flag": ("record", flag, {"units": "1", "long_name": "doubts about the record", **_bits(MEANING)}),
    }
    names = srf_names(table)
    bits = int(np.bitwise_or.reduce(arrays["prod_flag"], initial=0)) if table.optional else 0
    held = [column for column in table.optional if bits >> column.bit & 1]  # by at least one record
    for column in (*table.columns, *held, *table.repeated):
        dims = ("record", "slot") if column in table.repeated else "record"
        name = names.get(column.name, column.name)
        attrs = _column_attributes(table.column(name), table)
        if name != column.name:
            attrs |= {"source_column": column.name, "comment": MOVED}
        variables[name] = (dims, arrays[column.name], attrs)
    if sign := table.current_b_sign:
        values = np.stack([arrays[f"torque{n}A"] + sign * arrays[f"torque{n}B"] for n in (1, 2, 3)], axis=-1)
        comment = f"torque nA {'+' if sign > 0 else '-'} torque nB, as {table.mission} writes nB"
        attrs = {"units": "mA", "long_name": "torquer current along x, y, z", "frame": "b", "comment": comment}
        variables["current_b"] = (("record", "axis"), values, attrs)
    if table.receiver_time:  # missions write the fraction in different units
        whole, fraction = table.receiver_time
        values = TICKS[table.column(fraction).units] * arrays[fraction] / TICKS["s"]
        for name, column, part in (("second", arrays[whole], "whole part"), ("fraction", values, "fraction")):
            attrs = {"units": "s", "time_scale": "receiver", "long_name": f"{part} of receiver time"}
            variables[f"receiver_{name}"] = ("record", column, attrs)
    return xr.Dataset({name: xr.Variable(*one, fastpath=True) for name, one in variables.items()})


def srf_names(table):
    """Name in SRF of each column of the accelerometer frame: x is column z, y is column x, z is column y."""
    return {af[(i + 2) % 3]: af[i] for af in table.to_srf for i in range(3)}


def _column_attributes(column, table):
    attrs = {"units": column.units, "long_name": column.meaning or column.file_name}
    if column.frame:
        attrs["frame"] = column.frame
    if column.file:
        attrs["file_name"] = column.file
    attrs |= _bits({1 << int(k): v for k, v in ((table.flags or {}).get(column.name) or {}).items()})
    if column.name in (table.values or {}):
        attrs["value_meanings"] = "; ".join(f"{k} = {v}" for k, v in table.values[column.name].items())
    return attrs


def _bits(meanings):
    if not meanings:
        return {}
    words = [re.sub(r"[^A-Za-z0-9.+-]+", "_", text).strip("_") for text in meanings.values()]
    described = "; ".join(f"{mask} = {text}" for mask, text in meanings.items())
    return {"flag_masks": list(meanings), "flag_meanings": " ".join(words), "flag_description": described}


def flags(arrays: dict, ticks: np.ndarray, table: Product, satellite: str) -> np.ndarray:
    """Bits of what is doubtful in each record, (n,) uint8 as in ``MEANING``; ``ticks`` (n,) int64 ns are time tags."""
    flag = np.zeros(len(ticks), np.uint8)
    _mark(flag, arrays.get("undecodable"), UNDEFINED)
    _mark(flag, _other_time(arrays, table), OUT_OF_RANGE)
    for column in (*table.columns, *table.optional):
        if column.name in arrays:
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
    if table.id_name and satellite:
        _mark(flag, arrays[table.id_name] != satellite.encode(), OTHER_SATELLITE)
    _mark(flag, _off_length(arrays, table), NOT_UNIT)
    _check_order(flag, ticks, arrays, table)
    return flag


def _mark(flag, where, bit):
    if where is not None and where.any():
        flag[where] |= bit


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
    equal = np.ones(len(order) - 1, bool)
    for column in (*table.columns, *table.optional, *table.repeated):
        if column.name in arrays and column.name != "qualflg":
            values = arrays[column.name][order]
            alike = (values[1:] == values[:-1]) | ((values[1:] != values[1:]) & (values[:-1] != values[:-1]))
            equal &= alike.reshape(len(alike), -1).all(axis=1)
    flag[order[1:][same & equal]] |= REPEATED
    flag[order[1:][same & ~equal]] |= CONFLICTING


def _check_identity(file, header, table, arrays, expected):
    """Refuse a file of another satellite, day or time scale than its name, header or the caller (letter, date) says."""
    where, (satellite, day) = file.where, expected
    if not table.id_name:  # a combined product is the file of either satellite
        satellite = archive.TOGETHER.get(satellite, satellite)
    said = {"name": file.satellite, "request": satellite or ""}
    if table.id_name and len(arrays[table.id_name]):
        said["records"] = chr(np.bincount(arrays[table.id_name].view(np.uint8)).argmax())
    else:  # headers are known to name the other satellite: records overrule them
        said["header"] = header.satellite
    letters = {k: v for k, v in said.items() if v}
    if len(set(letters.values())) > 1:
        found = ", ".join(f"{v} by its {k}" for k, v in letters.items())
        refuse(where, f"satellite {found}", "one satellite", "Take the file of the right satellite.", **letters)
    if day and file.date and file.date != day:
        refuse(where, f"a file of {file.date}", day, "Take the file of the right day.", date=file.date)
    seconds, day = arrays[table.time[0]], day or file.date
    if day and len(seconds) and not table.constant:
        exact = table.time_scale == "GPS" and table.name.endswith("1B")
        margin, noon_2000 = GPS_MARGIN_S if exact else MARGIN_S, np.datetime64("2000-01-01T12:00:00")
        if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", day):
            refuse(where, f"the date {day}", "YYYY-MM-DD", "Correct the date.")
        start = int((np.datetime64(day) - noon_2000) / np.timedelta64(1, "s"))
        if not ((seconds >= start - margin) & (seconds < start + DAY_S + margin)).any():
            first = np.datetime_as_string(noon_2000 + np.timedelta64(int(seconds[0]), "s"))
            found = f"no record of {day}, the first at {first} GPS"
            refuse(where, found, f"records of {day}", "Take the right day's file.")
    wrong = _other_time(arrays, table)
    if wrong is not None and 2 * np.count_nonzero(wrong) > wrong.size:  # fewer are flagged
        written = ", ".join(sorted({one.decode("latin-1") for one in np.unique(arrays["time_ref"][wrong])}))
        expected = f"{', '.join(KNOWN_TIMES[table.time_scale].decode())} for {table.time_scale} time"
        remedy = "The tags are of another time scale: take the product of the right level."
        refuse(where, f"time_ref {written}", expected, remedy)
    lengths = _off_length(arrays, table)
    if lengths is not None and np.count_nonzero(lengths) > NORM_SHARE * lengths.size:  # fewer are flagged
        found = f"{np.count_nonzero(lengths)} of {lengths.size} quaternions whose norm is not one"
        refuse(where, found, "unit quaternions", "The file is damaged: fetch it again, or write it with more digits.")


def _off_length(arrays, table):
    """Records whose quaternion is no rotation; None where the product has none."""
    if not table.quaternion:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        excess = np.abs(np.sqrt(sum(arrays[name] * arrays[name] for name in table.quaternion)) - 1)
    limit = np.clip(NORM_ROUNDINGS * np.nanmedian(excess), *NORM_LIMITS) if np.isfinite(excess).any() else 0.0
    return ~(excess <= limit)


def _other_time(arrays, table):
    """Records whose tag is of another time scale than the product's; None where no record says."""
    if "time_ref" not in arrays:
        return None
    known = np.frombuffer(KNOWN_TIMES[table.time_scale], np.uint8)
    return ~np.isin(arrays["time_ref"].view(np.uint8), known)
