"""Level-1 ASCII files as the simulator writes them: what ``read`` reads comes back exactly."""

import gzip
import io
from pathlib import Path

import numpy as np

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.readers.dataset import KNOWN_TIMES, TICKS, srf_names
from gravcal.io.readers.tables import BITS, FLOATS, INTEGERS, Product, mission_of
from gravcal.io.readers.tables import product as product_table
from gravcal.io.written_headers import Origin, header_text

GIVE = "Give it, or choose another product."


def write(observed, path, product=None, satellite=None, *, created=None, history=()) -> Path:
    """Write one Level-1 file in the layout of RL04 ASCII; its bytes depend on the arguments alone.

    Parameters
    ----------
    observed : Dataset as ``read`` returns it, or a mapping of arrays (n,) in its names; accelerations in SRF.
        Time as the file's own columns, or ``time_second`` and ``time_fraction``, or ``time_tag``; torquer currents
        as the six coils, or ``current_b`` (n, 3) mA; left out: ids, flags and whatever has a default in the table
    path : where to; by its name ``PRDID_YYYY-MM-DD_S_RR.txt`` product and satellite are known; ``.gz`` compresses
    product, satellite : where the name does not say
    created : date of creation for the header, by default left out
    history : lines for the header

    Returns
    -------
    path : where the file is

    Raises
    ------
    ProductError : a column without values, or records of different layouts
    """
    path = Path(path)
    named = archive.from_name(path)
    product, satellite = product or getattr(named, "product", None), satellite or getattr(named, "satellite", None)
    if not product or not satellite:
        refuse(path, "no product or satellite in the name", "PRDID_YYYY-MM-DD_S_RR.txt", "Give product and satellite.")
    table = product_table(product, mission_of(satellite))
    if table.repeated:
        refuse(path, f"product {product}", "one whose records are alike", "This product cannot be written.")
    values = _columns(observed, table, satellite, path)
    body = _records(values, table)
    ticks = _ticks(values, table)
    origin = Origin(satellite, path.name, created, tuple(history))
    text = header_text(table, origin, ticks, len(body)) + body
    path.write_bytes(gzip.compress(text, 1, mtime=0) if path.name.endswith(".gz") else text)
    return path


def file_name(product: str, date: str, satellite: str, release: str = "04") -> str:
    """Conventional name of a Level-1 file, date as YYYY-MM-DD."""
    return f"{product}_{date}_{satellite}_{release}.txt"


def _columns(observed, table: Product, satellite, where):
    """Array of every column the records hold, under the names and axes of the file."""
    given = {str(name): np.asarray(observed[name]) for name in observed}
    given |= _times(given, table)
    if "current_b" in given and "torque1A" not in given:
        given |= _coils(given["current_b"], table)
    held = dict(given)
    for af, srf in srf_names(table).items():
        held.pop(af, None)
        if srf in given:
            held[af] = given[srf]
    n = len(held[table.time[0]])
    columns = list(table.columns)
    if table.optional:
        flag, present = _product_flag(held, table, where)
        held["prod_flag"] = np.full(n, flag)
        columns += present
    missing = {c.name: _default(c, table, satellite) for c in columns if c.name not in held}
    for name in (name for name, default in missing.items() if default is None):
        refuse(where, f"no values for {name}", f"{n} values", GIVE, column=name)
    return {c.name: held[c.name] if c.name in held else np.full(n, missing[c.name]) for c in columns}


def _times(given, table):
    seconds, *fraction = table.time
    if seconds in given:
        return {}
    scale = TICKS["s"] // TICKS[table.column(fraction[0]).units] if fraction else 1
    if "time_second" in given:
        whole, part = given["time_second"], np.rint(given["time_fraction"] * scale).astype(int)
    else:
        whole = np.floor(given["time_tag"]).astype(int)
        part = np.rint((given["time_tag"] - whole) * scale).astype(int)
    whole, part = whole + part // scale, part % scale
    return {seconds: whole, fraction[0]: part} if fraction else {seconds: whole}


def _coils(current, table):
    """Positive currents in the coils A, negative ones in the coils B, with the sign the mission writes them."""
    coils = {f"torque{i + 1}A": np.maximum(current[:, i], 0.0) for i in range(3)}
    b = {f"torque{i + 1}B": table.current_b_sign * np.minimum(current[:, i], 0.0) for i in range(3)}
    return coils | b


def _product_flag(given, table, where):
    if "prod_flag" in given:
        flags = np.unique(given["prod_flag"])
    else:
        flags = np.array([sum(1 << c.bit for c in table.optional if c.name in given)])
    if not len(flags):
        return 0, ()
    if len(flags) > 1:
        refuse(where, f"{len(flags)} values of prod_flag", "records of one layout", "Write each layout by itself.")
    return int(flags[0]), table.following(int(flags[0]))


def _default(column, table, satellite):
    """What a column left out holds, None where that cannot be known."""
    default = column.default
    if column.name == table.id_name:
        default = satellite
    elif column.name == "time_ref":
        default = KNOWN_TIMES[table.time_scale][:1].decode()
    elif default is None and column.kind in BITS:
        default = 0
    return default.encode() if isinstance(default, str) else default


def _ticks(values, table):
    ticks = values[table.time[0]].astype(int) * TICKS["s"]
    if len(table.time) > 1:
        ticks = ticks + values[table.time[1]].astype(int) * TICKS[table.column(table.time[1]).units]
    return ticks


def _records(values, table):
    """Lines with the blanks of the real files: a wider gap is an empty field."""
    import polars

    fields = {}
    for name, array in values.items():
        column = table.column(name)
        for extra in range(1, column.gap if fields else 1):
            fields[f"{name} {extra}"] = polars.Series(["" for _ in array[:1]] * len(array), dtype=polars.String)
        fields[name] = _printable(array, column)
    out = io.BytesIO()
    polars.DataFrame(fields).write_csv(out, separator=" ", include_header=False, quote_style="never")
    return out.getvalue()


def _printable(array, column):
    import polars

    if column.kind in FLOATS:
        return polars.Series(array.astype(float))
    if column.kind in INTEGERS:
        return polars.Series(array.astype(np.int64))
    if column.kind == "text":
        return polars.Series(array.astype(str).tolist())
    distinct, places = np.unique(array, return_inverse=True)
    width = column.kind[1:]
    texts = [f"{int(v):0{width}b}" if column.kind in BITS else v.decode() for v in distinct.tolist()]
    return polars.Series(texts).gather(places)
