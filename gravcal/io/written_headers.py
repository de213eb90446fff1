"""Headers of written Level-1 files: the real field names, and words that say the file is simulated."""

from dataclasses import dataclass

import numpy as np

from gravcal.io.readers.tables import BITS, Product
from gravcal.store.origin import BY

EPOCH = np.datetime64("2000-01-01T12:00:00", "ns")
LEVELS = {"A": "1A", "B": "1B"}
TOGETHER = {"X": "GRACE A+B", "Y": "GRACE C+D"}
LABELS = 24  # lines of an 80-column header with its end


@dataclass(frozen=True)
class Origin:
    """Whose file it is and where it comes from; no date of creation unless one is given."""

    satellite: str
    name: str
    created: str | None = None
    history: tuple[str, ...] = ()


def header_text(table: Product, origin: Origin, ticks, size) -> bytes:
    """Header of a file.

    Parameters
    ----------
    table : the product's columns
    origin : satellite, file name, date of creation and history
    ticks : (n,) int64 ns, time tags
    size : bytes of the records
    """
    if table.header == "label" or table.mission == "GRACE":
        return _labels(table, origin, ticks, size)
    lines = [
        "header:",
        "  dimensions:",
        f"    num_records: {len(ticks)}",
        "  global_attributes:",
        *_attributes(table, origin, ticks),
        "  non-standard_attributes:",
        "    epoch_time: 2000-01-01T12:00:00.00",
        f"    software_version: {BY}",
        *(f"    {edge}_time_epoch_secs: {_seconds(tick)}" for edge, tick in _edges(ticks)),
        "  variables:",
        *_variables(table),
        "# End of YAML header",
    ]
    return ("\n".join(lines) + "\n").encode()


def _attributes(table, origin, ticks):
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
        **{f"time_coverage_{edge}": _stamp(tick) for edge, tick in _edges(ticks)},
        "title": table.title,
    }
    for name, value in attributes.items():
        if name == "history":
            yield "    history:"
            yield from [f"      - {_quoted(line)}" for line in origin.history] or ["      []"]
        else:
            yield f"    {name}: {_plain(value)}"


def _platform(origin):
    return TOGETHER.get(origin.satellite, f"GRACE {origin.satellite}")


def _edges(ticks):
    return [("start", ticks[0]), ("stop", ticks[-1])] if len(ticks) else []


def _seconds(tick):
    return f"{tick // 10**9}.{tick % 10**9:09d}".rstrip("0").rstrip(".")


def _stamp(tick):
    return str(EPOCH + np.timedelta64(int(tick), "ns"))[:22]


def _variables(table):
    swapped = dict(zip(table.swapped_in_header, reversed(table.swapped_in_header), strict=True))
    for place, column in enumerate(table.columns, 1):
        yield from _variable(table, table.column(swapped.get(column.name, column.name)), f"{_ordinal(place)} column")
    for column in table.optional:
        yield from _variable(table, column, "next column, if prod_flag bit set")
    for name in table.header_only:
        yield from (f"    - {name}:", "        comment: next column, if prod_flag bit set")


def _variable(table, column, comment):
    flags = (table.flags or {}).get(column.name) or {}
    if column.name == "prod_flag":
        flags = {str(c.bit): c.file_name for c in table.optional}
    unit = column.header_unit or column.unit or ("char" if column.kind == "c" else "")
    yield f"    - {_plain(column.file_name)}:"
    yield f"        comment: {comment}"
    yield f"        coverage_content_type: {_content(column)}"
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


def _content(column):
    if column.kind in BITS and column.name != "prod_flag":
        return "qualityInformation"
    return "physicalMeasurement" if column.kind in ("f4", "f8") else "referenceInformation"


def _ordinal(number):
    ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


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
    lines = [f"{label:<30}: {value}"[:80].ljust(80) for label, value in entries] + ["END OF HEADER".ljust(80)]
    return ("\n".join(lines) + "\n").encode()
