"""Level-1 ASCII files as the simulator writes them: what ``read`` reads comes back exactly.

Their headers have the real field names, and words that say that the file is simulated.
"""

import gzip
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.readers.dataset import KNOWN_TIMES, TICKS, srf_names
from gravcal.io.readers.tables import BITS, FLOATS, INTEGERS, Product, mission_of
from gravcal.io.readers.tables import product as product_table
from gravcal.store.origin import BY

EPOCH = np.datetime64("2000-01-01T12:00:00", "ns")
LEVELS = {"A": "1A", "B": "1B"}
TOGETHER = {"X": "GRACE A+B", "Y": "GRACE C+D"}
LABELS = 24  # lines of an 80-column header with its end
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
    is_label = table.header == "label" or table.mission == "GRACE"
    header = _labels(table, origin, ticks, len(body)) if is_label else _yaml(table, origin, ticks)
    text = ("\n".join(header) + "\n").encode() + body
    path.write_bytes(gzip.compress(text, 1, mtime=0) if path.name.endswith(".gz") else text)
    return path


def file_name(product: str, date: str, satellite: str, release: str = "04") -> str:
    """Conventional name of a Level-1 file, date as YYYY-MM-DD."""
    return f"{product}_{date}_{satellite}_{release}.txt"


def _columns(observed, table: Product, satellite, where):
    """Array of every column the records hold, under the names and axes of the file."""
    given = {str(name): np.asarray(observed[name]) for name in observed}
    given |= _times(given, table)
    if "current_b" in given and "torque1A" not in given:  # positive currents in the coils A, negative ones in B
        for i in range(3):
            given[f"torque{i + 1}A"] = np.maximum(given["current_b"][:, i], 0.0)
            given[f"torque{i + 1}B"] = table.current_b_sign * np.minimum(given["current_b"][:, i], 0.0)
    held = dict(given)
    for af, srf in srf_names(table).items():
        held.pop(af, None)
        if srf in given:
            held[af] = given[srf]
    n = len(held[table.time[0]])
    columns = list(table.columns)
    if table.optional:
        bits = sum(1 << c.bit for c in table.optional if c.name in held)
        flags = np.unique(held["prod_flag"]) if "prod_flag" in held else np.array([bits])
        if len(flags) > 1:
            refuse(where, f"{len(flags)} values of prod_flag", "records of one layout", "Write each layout by itself.")
        flag = int(flags[0]) if len(flags) else 0
        held["prod_flag"] = np.full(n, flag)
        columns += table.following(flag)
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


@dataclass(frozen=True)
class Origin:
    """Whose file it is and where it comes from; no date of creation unless one is given."""

    satellite: str
    name: str
    created: str | None = None
    history: tuple[str, ...] = ()


def _yaml(table, origin, ticks):
    """Lines of a YAML header, as of RL04."""
    edges = [("start", ticks[0]), ("stop", ticks[-1])] if len(ticks) else []
    platform = _platform(origin)
    attributes = {
        "conventions": "CF-1.6, ACDD-1.3, ISO 8601",
        "creator_institution": "gravcal",
        "creator_name": BY,
        **({"date_created": origin.created} if origin.created else {}),
        "history": "",
        "institution": "gravcal",
        "instrument": table.instrument,
        "keywords": f"GRACE-FO, {table.instrument}, simulation",
        "platform": platform,
        "processing_level": LEVELS.get(table.name[-1], "1B"),
        "product_version": "04",
        "program": "none, simulated data",
        "project": "none, simulated data",
        "source": f"{BY}, {table.source} of {platform}",
        "summary": table.summary,
        **{f"time_coverage_{edge}": _stamp(tick) for edge, tick in edges},
        "title": table.title,
    }
    lines = ["header:", "  dimensions:", f"    num_records: {len(ticks)}", "  global_attributes:"]
    for name, value in attributes.items():
        lines.append("    history:" if name == "history" else f"    {name}: {_plain(value)}")
        if name == "history":
            lines += [f"      - {_quoted(line)}" for line in origin.history] or ["      []"]
    lines += ["  non-standard_attributes:", "    epoch_time: 2000-01-01T12:00:00.00", f"    software_version: {BY}"]
    for edge, tick in edges:
        seconds = f"{tick // 10**9}.{tick % 10**9:09d}".rstrip("0").rstrip(".")
        lines.append(f"    {edge}_time_epoch_secs: {seconds}")
    lines.append("  variables:")
    swapped = dict(zip(table.swapped_in_header, reversed(table.swapped_in_header), strict=True))
    for number, column in enumerate(table.columns, 1):
        ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
        lines += _variable(table, table.column(swapped.get(column.name, column.name)), f"{number}{ending} column")
    for column in table.optional:
        lines += _variable(table, column, "next column, if prod_flag bit set")
    for name in table.header_only:
        lines += [f"    - {name}:", "        comment: next column, if prod_flag bit set"]
    return [*lines, "# End of YAML header"]


def _platform(origin):
    return TOGETHER.get(origin.satellite, f"GRACE {origin.satellite}")


def _stamp(tick):
    return str(EPOCH + np.timedelta64(int(tick), "ns"))[:22]


def _variable(table, column, comment):
    flags = (table.flags or {}).get(column.name) or {}
    if column.name == "prod_flag":
        flags = {str(c.bit): c.file_name for c in table.optional}
    unit = column.header_unit or column.unit or ("char" if column.kind == "c" else "")
    yield f"    - {_plain(column.file_name)}:"
    yield f"        comment: {comment}"
    is_quality = column.kind in BITS and column.name != "prod_flag"
    content = "physicalMeasurement" if column.kind in FLOATS else "referenceInformation"
    yield f"        coverage_content_type: {'qualityInformation' if is_quality else content}"
    if flags:
        yield f"        flag_masks: {', '.join(f'{1 << int(bit)}b' for bit in flags)}"
        yield "        flag_meanings:"
        yield from (f"          - {_plain(f'bit {bit} = {text}')}" for bit, text in flags.items())
    if column.meaning:
        yield f"        long_name: {_plain(column.meaning)}"
    if unit:
        yield f"        units: {unit}"
    if column.range:
        yield f"        valid_range: {','.join(map(str, column.range))}"
    if column.name in (table.values or {}):
        yield "        value_meanings:"
        yield from (f"          - {_plain(f'{k} = {v}')}" for k, v in table.values[column.name].items())


def _plain(text):
    """Text as YAML takes it without quotes, quoted where it would not."""
    text = str(text)
    risky = ": " in text or " #" in text or text[:1] in "'\"-[]{}#&*!|>%@`+?" or text.endswith(":")
    return _quoted(text) if risky else text


def _quoted(text):
    return '"' + str(text).replace("\\", "\\\\").replace('"', '\\"') + '"'


def _labels(table, origin, ticks, size):
    first, last = (ticks[0], ticks[-1]) if len(ticks) else (0, 0)
    kind = table.file_type or f"ip{table.name}F            : 0"
    entries = [
        ("PRODUCER AGENCY", "gravcal"),
        ("PRODUCER INSTITUTION", BY),
        tuple(part.strip() for part in f"FILE TYPE {kind}".split(":")),
        ("FILE FORMAT 0=BINARY 1=ASCII", "1"),
        ("NUMBER OF HEADER RECORDS", str(LABELS - 1)),
        ("SOFTWARE VERSION", BY),
        ("SOFTWARE BUILD TIME", ""),
        ("REFERENCE DOCUMENTATION", "none, simulated data"),
        ("SATELLITE NAME", _platform(origin)),
        ("SENSOR NAME", table.instrument),
        ("TIME EPOCH (GPS TIME)", "2000-01-01 12:00:00"),
        ("TIME FIRST OBS(SEC PAST EPOCH)", f"{first / 1e9:.6f} ({_stamp(first).replace('T', ' ')})"),
        ("TIME LAST OBS(SEC PAST EPOCH)", f"{last / 1e9:.6f} ({_stamp(last).replace('T', ' ')})"),
        ("NUMBER OF DATA RECORDS", str(len(ticks))),
        ("PRODUCT CREATE START TIME(UTC)", origin.created or ""),
        ("PRODUCT CREATE END TIME(UTC)", origin.created or ""),
        ("FILESIZE (BYTES)", str(81 * LABELS + size)),
        ("FILENAME", origin.name),
        ("PROCESS LEVEL (1A OR 1B)", LEVELS.get(table.name[-1], "1B")),
    ]
    entries += [("INPUT FILE NAME", "none")] * (LABELS - 1 - len(entries))
    return [f"{label:<30}: {value}"[:80].ljust(80) for label, value in entries] + ["END OF HEADER".ljust(80)]
