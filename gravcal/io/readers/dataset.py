"""One Level-1 file as an xarray Dataset: native values and tags, accelerometer axes moved to SRF."""

import re
from pathlib import Path

import numpy as np
import xarray as xr

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.readers import binary, checks, text
from gravcal.io.readers import header as headers
from gravcal.io.readers.tables import Product, mission_of, reordered
from gravcal.io.readers.tables import product as product_table
from gravcal.store import origin

TICKS = {"s": 1_000_000_000, "us": 1_000, "ns": 1}
MOVED = "columns moved from the accelerometer frame: SRF (x, y, z) = AF (z, x, y)"


def read(source, product=None, columns=None, *, expect_satellite=None, expect_date=None) -> xr.Dataset:
    """One Level-1 file, values and time tags as they are.

    Parameters
    ----------
    source : path of a file (.txt .asc .dat, also .gz), path of a .tgz holding one file of the product,
        or a LevelOneFile
    product : five characters, such as "ACC1A"; by default from the name or the header
    columns : names of the variables wanted, by default all; time tags and ``flag`` always come along
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
    file = _located(source, product, expect_satellite, expect_date)
    data = archive.content(file)
    header = headers.parse(data, file.where)
    satellite = file.satellite or header.satellite
    table = product_table(product or file.product or _named_in(header, file), mission_of(satellite))
    _check_columns(header, table, file.where)
    if header.binary:
        arrays = binary.parse(data, header.size, table, file.where)
    else:
        arrays = text.parse(data, header.size, header.lines, table, file.where)
    seconds, ticks = _tags(arrays, table, file.where)
    checks.check_identity(file, header, table, arrays, (expect_satellite, expect_date))
    flag = checks.flags(arrays, ticks, table, satellite)
    observed = _assembled(arrays, seconds, ticks, flag, table)
    observed.attrs = _attributes(header, table, file, satellite, len(flag))
    observed.attrs["origin"] = origin.of_header(data[: header.size].decode("latin-1"))
    return observed if columns is None else _chosen(observed, columns, file.where)


def _located(source, product, satellite, date):
    if isinstance(source, archive.LevelOneFile):
        return source
    path = Path(source)
    if archive.is_archive(path):
        if not product:
            refuse(path, "an archive", "a product to read from it", "Give the product, or use find().")
        return archive.find(path, product, satellite, date)
    return archive.from_name(path) or archive.LevelOneFile(path, None, "", "", "", "")


def _named_in(header, file):
    return header.product or refuse(file.where, "no product in the name or header", "one", "Give the product.")


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
    refuse(
        where,
        f"columns in the header that differ from the table of {table.name}: {differing}",
        "the columns of RL04",
        "Another product or release: give the right product, or add its table.",
    )


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
        "flag": ("record", flag, {"units": "1", "long_name": "doubts about the record", **_bits(checks.MEANING)}),
    }
    names = srf_names(table)
    for column in (*table.columns, *_held(arrays, table), *table.repeated):
        dims = ("record", "slot") if column in table.repeated else "record"
        name = names.get(column.name, column.name)
        attrs = _column_attributes(table.column(name), table)
        if name != column.name:
            attrs |= {"source_column": column.name, "comment": MOVED}
        variables[name] = (dims, arrays[column.name], attrs)
    if table.current_b_sign:
        variables["current_b"] = _current(arrays, table)
    if table.receiver_time:
        variables |= _receiver_time(arrays, table)
    return xr.Dataset({name: xr.Variable(*one, fastpath=True) for name, one in variables.items()})


def _held(arrays, table):
    """Optional columns that at least one record holds."""
    bits = int(np.bitwise_or.reduce(arrays["prod_flag"], initial=0)) if table.optional else 0
    return [c for c in table.optional if bits >> c.bit & 1]


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


def _current(arrays, table):
    sign = table.current_b_sign
    values = np.stack([arrays[f"torque{n}A"] + sign * arrays[f"torque{n}B"] for n in (1, 2, 3)], axis=-1)
    comment = f"torque nA {'+' if sign > 0 else '-'} torque nB, as {table.mission} writes nB"
    return (
        ("record", "axis"),
        values,
        {"units": "mA", "long_name": "torquer current along x, y, z", "frame": "b", "comment": comment},
    )


def _receiver_time(arrays, table):
    """Receiver time of a clock mapping in seconds: missions write the fraction in different units."""
    whole, fraction = table.receiver_time
    ticks = TICKS[table.column(fraction).units] * arrays[fraction]
    attrs = {"units": "s", "time_scale": "receiver"}
    return {
        "receiver_second": ("record", arrays[whole], {**attrs, "long_name": "whole part of receiver time"}),
        "receiver_fraction": ("record", ticks / TICKS["s"], {**attrs, "long_name": "fraction of receiver time"}),
    }


def _attributes(header, table, file, satellite, present):
    attrs = {
        "product": table.name,
        "mission": table.mission,
        "satellite": satellite,
        "date": file.date,
        "release": file.release,
        "file": file.name,
        "time_scale": table.time_scale,
        "records": present,
    }
    if header.declared is not None:
        attrs["records_declared"] = header.declared
    if header.satellite and header.satellite != satellite:
        attrs["header_satellite"] = header.satellite
    attrs |= {"table_tested": str(table.sampled).lower()}
    return attrs | {f"header_{k}": v for k, v in header.notes.items()}


def _chosen(observed, columns, where):
    missing = [c for c in columns if c not in observed]
    if missing:
        refuse(where, f"no column {', '.join(missing)}", f"some of {', '.join(observed)}", "Correct the column names.")
    return observed[["time_tag", "time_second", "time_fraction", "flag", *columns]]
