"""Level-1 ASCII files of simulations: ``readers.read`` returns exactly what was written.

Their headers have the real field names, and labels that mark the file as simulated.
"""

import gzip
import io
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars
import yaml

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.archive import BY
from gravcal.io.readers import BITS, FLOATS, INTEGERS, KNOWN_TIMES, TICKS, Product, mission_of, srf_names, table_of

EPOCH = np.datetime64("2000-01-01T12:00:00", "ns")
LEVELS = {"A": "1A", "B": "1B"}
TOGETHER = {"X": "GRACE A+B", "Y": "GRACE C+D"}
HEADERS = tomllib.loads(Path(__file__).with_name("headers.toml").read_text(encoding="utf-8"))
LINES = len(HEADERS["label"])  # of an 80-column header before its end


def write(observed, path) -> Path:
    """Write one Level-1 file in the layout of RL04 ASCII; its bytes depend on the arguments alone.

    Parameters
    ----------
    observed : Dataset as ``read`` returns it, or a mapping of arrays (n,) in its names; accelerations in SRF.
        Left out: ids, flags and whatever has a default in the table
    path : where to; by its name ``PRDID_YYYY-MM-DD_S_RR.txt`` product and satellite are known; ``.gz`` compresses

    Raises
    ------
    ProductError : a column without values, or records of different layouts
    """
    path = Path(path)
    named = archive.from_name(path)
    if not named:
        refuse(path, "no product or satellite in the name", "PRDID_YYYY-MM-DD_S_RR.txt", "Name the file so.")
    product, satellite = named.product, named.satellite
    table = table_of(product, mission_of(satellite))
    if table.repeated:
        refuse(path, f"product {product}", "one whose records are alike", "This product cannot be written.")
    values = _columns(observed, table, satellite, path)
    body = _records(values, table)
    ticks = values[table.time[0]].astype(int) * TICKS["s"]
    if len(table.time) > 1:
        ticks = ticks + values[table.time[1]].astype(int) * TICKS[table.column(table.time[1]).units]
    words = {"table": table, "path": path, "platform": TOGETHER.get(satellite, f"GRACE {satellite}")}
    words["level"] = LEVELS.get(table.name[-1], "1B")
    if table.header == "label" or table.mission == "GRACE":
        kind, about = table.file_type or f"ip{table.name}F            : 0", header_lines("simulated", **words)
        header = label_header(kind, ticks, len(body), about)
    else:
        header = _yaml(table, ticks, header_lines("attributes", **words))
    text = header.encode() + body
    path.write_bytes(gzip.compress(text, 1, mtime=0) if path.name.endswith(".gz") else text)
    return path


def file_name(product: str, date: str, satellite: str, release: str = "04") -> str:
    """Conventional name of a Level-1 file, date as YYYY-MM-DD."""
    return f"{product}_{date}_{satellite}_{release}.txt"


def _columns(observed, table: Product, satellite, where):
    """{column: (n,)} of every column of the records, in order, with names and axes of the file; defaults filled in."""
    arrays = {str(name): np.asarray(observed[name]) for name in observed}
    values = dict(arrays)
    for af, srf in srf_names(table).items():
        values.pop(af, None)
        if srf in arrays:
            values[af] = arrays[srf]
    n = len(values[table.time[0]])
    columns = list(table.columns)
    if table.optional:
        bits = sum(1 << c.bit for c in table.optional if c.name in values)
        flags = np.unique(values["prod_flag"]) if "prod_flag" in values else np.array([bits])
        if len(flags) > 1:
            refuse(where, f"{len(flags)} values of prod_flag", "records of one layout", "Write each layout by itself.")
        flag = int(flags[0]) if len(flags) else 0
        values["prod_flag"] = np.full(n, flag)
        columns += table.following(flag)
    missing = {c.name: _default(c, table, satellite) for c in columns if c.name not in values}
    for name in (name for name, default in missing.items() if default is None):
        refuse(where, f"no values for {name}", f"{n} values", "Give it, or choose another product.", column=name)
    return {c.name: values[c.name] if c.name in values else np.full(n, missing[c.name]) for c in columns}


def _default(column, table, satellite):
    """Default value of a column that is not supplied, None where there is none."""
    default = column.default
    if column.name == table.id_name:
        default = satellite
    elif column.name == "time_ref":
        default = KNOWN_TIMES[table.time_scale][:1].decode()
    elif default is None and column.kind in BITS:
        default = 0
    return default.encode() if isinstance(default, str) else default


def _records(values, table):
    """Bytes of the record lines from {column: (n,)}; a wider gap between columns is written as empty fields."""
    fields = {}
    for name, array in values.items():
        column = table.column(name)
        for extra in range(1, column.gap if fields else 1):
            fields[f"{name} {extra}"] = polars.Series(["" for _ in array[:1]] * len(array), dtype=polars.String)
        fields[name] = _printable(array, column)
    out = io.BytesIO()
    polars.DataFrame(fields).write_csv(out, separator=" ", include_header=False, quote_style="never")
    return out.getvalue()


def _printable(array, column):  # polars Series that prints an array (n,) as the kind of its column
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


def header_lines(part, **words):
    """{label: text} of a header: the table ``part`` of headers.toml with the words filled in."""
    lines = HEADERS[part].items()
    return {n.format(**words): v.format(by=BY, **words) if isinstance(v, str) else v for n, v in lines}


def _yaml(table, ticks, attributes):  # text of the YAML header; ticks (n,) ns past `EPOCH`
    edges = [("start", ticks[0]), ("stop", ticks[-1])] if len(ticks) else []
    attributes |= {f"time_coverage_{edge}": _date(tick).item() for edge, tick in edges} | {"title": table.title}
    others = {"epoch_time": _date(0).item(), "software_version": BY}
    others |= {f"{edge}_time_epoch_secs": float(tick / 1e9) for edge, tick in edges}
    swapped = dict(zip(table.swapped_in_header, reversed(table.swapped_in_header), strict=True))
    columns = [table.column(swapped.get(column.name, column.name)) for column in table.columns]
    variables = [_variable(table, column, f"column {number}") for number, column in enumerate(columns, 1)]
    following = {"comment": "next column, if prod_flag bit set"}
    variables += [_variable(table, column, following["comment"]) for column in table.optional]
    variables += [{name: following} for name in table.header_only]
    header = {"dimensions": {"num_records": len(ticks)}, "global_attributes": attributes}
    header |= {"non-standard_attributes": others, "variables": variables}
    return yaml.safe_dump({"header": header}, sort_keys=False, width=1000) + "# End of YAML header\n"


def _date(tick):  # datetime64 of ns past `EPOCH`
    return (EPOCH + np.timedelta64(int(tick), "ns")).astype("datetime64[us]")


def _variable(table, column, comment):  # {column: attributes} of the YAML header
    flags = (table.flags or {}).get(column.name) or {}
    if column.name == "prod_flag":
        flags = {str(c.bit): c.file_name for c in table.optional}
    is_quality = column.kind in BITS and column.name != "prod_flag"
    content = "physicalMeasurement" if column.kind in FLOATS else "referenceInformation"
    about = {
        "comment": comment,
        "coverage_content_type": "qualityInformation" if is_quality else content,
        "flag_masks": ", ".join(f"{1 << int(bit)}b" for bit in flags),
        "flag_meanings": [f"bit {bit} = {text}" for bit, text in flags.items()],
        "long_name": column.meaning,
        "units": column.header_unit or column.unit or ("char" if column.kind == "c" else ""),
        "valid_range": ",".join(map(str, column.range)),
        "value_meanings": [f"{k} = {v}" for k, v in (table.values or {}).get(column.name, {}).items()],
    }
    return {column.file_name: {name: value for name, value in about.items() if value}}


def label_header(kind: str, ticks: np.ndarray, size: int, about: Mapping[str, str]) -> str:
    """Text of an 80-column header in the form of VKB1B.

    Parameters
    ----------
    kind : type of the file with its number, divided by a colon
    ticks : (n,) ns, times of the records
    size : bytes of the records
    about : {label: value} that replace or add to those of every file
    """
    label, _, number = (part.strip() for part in kind.partition(":"))
    edges = [f"{t / 1e9:.6f} ({str(_date(t))[:22].replace('T', ' ')})" for t in (ticks[[0, -1]] if len(ticks) else ())]
    words = {"label": label, "number": number, "lines": LINES, "records": len(ticks), "size": 81 * (LINES + 1) + size}
    entries = header_lines("label", **words, **dict(zip(("first", "last"), edges or ("", ""), strict=True))) | about
    lines = [f"{label:<30}: {value}"[:80].ljust(80) for label, value in entries.items()]
    return "\n".join([*lines, "END OF HEADER".ljust(80)]) + "\n"
