"""Level-1 files as xarray Datasets: one table per product, native values and tags, accelerometer axes moved to SRF.

Headers are the YAML one of GRACE-FO RL04 and the 80-column one of GRACE and the constants. Binary records are numpy
structures, big endian and packed. ASCII records are read by polars at once if all are alike, else layout by layout.
Doubtful records keep their values and get a bit in ``flag``.
"""

import re
import tomllib
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import polars
import xarray as xr
import yaml

from gravcal.errors import refuse
from gravcal.io import archive

PRODUCTS = Path(__file__).with_name("products")
SI_UNITS = tomllib.loads(Path(__file__).with_name("units.toml").read_text(encoding="utf-8"))
BITS = {"b8": "u1", "b16": "u2", "b32": "u4"}
INTEGERS = ("i1", "i4", "u1", "u2", "u4")
FLOATS = ("f4", "f8")
GRACE_ID = {"name": "GRACE_id", "meaning": "GRACE satellite identifier", "range": ["A", "B"]}


@dataclass(frozen=True)
class Column:
    """One column: ``kind`` is a number (i1 i4 u1 u2 u4 f4 f8), c(haracter), b8 b16 b32 (bits) or text (to the end)."""

    name: str
    kind: str
    unit: str = ""
    frame: str = ""
    meaning: str = ""
    range: tuple = ()
    bit: int | None = None
    gap: int = 1
    file: str = ""
    header_unit: str = ""
    default: float | str | None = None

    @property
    def file_name(self) -> str:
        """Name of the column in the header of a file."""
        return self.file or self.name

    @property
    def units(self) -> str:
        """Unit in SI spelling."""
        return SI_UNITS.get(self.unit, self.unit)


@dataclass(frozen=True)
class Product:
    """The table of one product for one mission (``"GRACE"`` or ``"GRACE-FO"``)."""

    name: str
    mission: str
    title: str
    columns: tuple[Column, ...]
    time: tuple[str, ...]
    time_scale: str
    summary: str = ""
    source: str = ""
    instrument: str = ""
    header: str = "yaml"
    file_type: str = ""
    sampled: bool = True
    constant: bool = False
    keys: tuple[str, ...] = ()
    quaternion: tuple[str, ...] = ()
    to_srf: tuple[tuple[str, ...], ...] = ()
    optional: tuple[Column, ...] = ()
    repeated: tuple[Column, ...] = ()
    header_only: tuple[str, ...] = ()
    swapped_in_header: tuple[str, ...] = ()
    swapped_in_binary: tuple[str, ...] = ()
    current_b_sign: int = 0
    receiver_time: tuple[str, ...] = ()
    flags: dict | None = None
    values: dict | None = None

    @property
    def id_name(self) -> str:
        """Column that names the satellite, empty for combined products."""
        return next((c.name for c in self.columns if c.name in ("GRACEFO_id", "GRACE_id")), "")

    @property
    def layout_key(self) -> str:
        """Column that determines which columns follow the fixed ones, empty where all records are alike."""
        return "prod_flag" if self.optional else "n_prns" if self.repeated else ""

    @property
    def is_text(self) -> bool:
        """True if the last column runs to the end of the record."""
        return self.columns[-1].kind == "text"

    def column(self, name: str) -> Column:
        """Column of that name: fixed, optional or repeated."""
        return next(c for c in (*self.columns, *self.optional, *self.repeated) if c.name == name)

    def following(self, key: int) -> tuple[Column, ...]:
        """Columns after the fixed ones in records whose column `layout_key` has this value."""
        if self.repeated:
            return self.repeated * key
        return tuple(c for c in self.optional if key >> c.bit & 1)

    def undefined_bits(self, key: int) -> list[int]:
        """Bits of a product flag that stand for no column of this table."""
        known = {c.bit for c in self.optional}
        return [bit for bit in range(32) if self.optional and key >> bit & 1 and bit not in known]


@cache
def names() -> tuple[str, ...]:
    """Names of all products that have a table, sorted."""
    return tuple(sorted(path.stem for path in PRODUCTS.glob("*.toml")))


@cache
def table_of(name: str, mission: str = "GRACE-FO") -> Product:
    """Table of a product ("ACC1A") for a mission: "GRACE" (satellites A, B, X) or "GRACE-FO" (C, D, Y)."""
    if name not in names():
        refuse(name, "no table for this product", f"one of {', '.join(names())}", "Check the product name.")
    table = _loaded(name)
    grace = table.pop("grace", {})
    if mission == "GRACE":
        table = _for_grace(table, grace)
    known = {f.name for f in fields(Product)}
    kinds = ("columns", "optional", "repeated")
    columns = {k: tuple(Column(**c | {"range": tuple(c.get("range", ()))}) for c in table.get(k, ())) for k in kinds}
    rest = {k: _frozen(v) for k, v in table.items() if k in known and k not in columns}
    return Product(name=name, mission=mission, **rest, **columns)


def _loaded(name):  # dict of a product's TOML table, on top of that of the product it is "like"
    table = tomllib.loads((PRODUCTS / f"{name}.toml").read_text(encoding="utf-8"))
    if "like" in table:
        table = {**_loaded(table["like"]), **table}
    return table


def _for_grace(table, grace):  # dict of a table with the changes for GRACE
    changed = {**table, **{k: v for k, v in grace.items() if k not in ("flags", "change")}}
    changed["flags"] = {**table.get("flags", {}), **grace.get("flags", {})}
    change = grace.get("change", {}) | {"GRACEFO_id": GRACE_ID}
    for key in ("columns", "optional", "repeated"):
        changed[key] = [column | change.get(column["name"], {}) for column in changed.get(key, [])]
    if "optional_of" in grace:
        other = _loaded(grace["optional_of"])
        changed["optional"] = other["optional"] + other["grace"]["extra_optional"]
    changed["optional"] = sorted(changed["optional"] + grace.get("extra_optional", []), key=lambda c: c["bit"])
    changed["title"] = table["title"].replace("GRACE-FO", "GRACE")
    return changed


def _frozen(value):  # lists as tuples, nested
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


def mission_of(satellite: str) -> str:
    """Mission of a satellite letter: "GRACE" for A, B, X, else "GRACE-FO"."""
    return "GRACE" if satellite in tuple("ABX") else "GRACE-FO"


def reordered(table: Product, swapped: tuple[str, ...]) -> Product:
    """Copy of a table with two columns exchanged; swapped: their names, or ()."""
    if not swapped:
        return table
    other = dict(zip(swapped, reversed(swapped), strict=True))
    return replace(table, columns=tuple(table.column(other.get(c.name, c.name)) for c in table.columns))


YAML_END = b"# End of YAML header\n"
LABEL_END = re.compile(rb"END OF HEADER *\r?\n")
HEADER_LIMIT = 8_000_000  # bytes in which the end of a header has to come
DEEPEST = 20  # levels; headers have five
STOP = "stop_time_epoch_secs"
KEPT = ("title", "summary", "source", "institution", "processing_level", "product_version", "software_version", STOP)
CUT_S = 60.0  # s before the stop that its header states, from which on a file with less records ends too early
NOT_A_NUMBER = re.compile(r"[+-]?nan(\(.*\))?", re.IGNORECASE)
TRUNCATED = "The file is cut: fetch it again."
DAMAGED = "The file is damaged or of another layout: fetch it again, or correct the line."


@dataclass(frozen=True)
class Header:
    """Content of a file's header; ``names`` are its columns in order, () where it lists none."""

    binary: bool
    size: int  #: bytes of the header
    lines: int  #: lines of the header
    satellite: str = ""
    declared: int | None = None  #: number of records
    names: tuple[str, ...] = ()
    product: str = ""
    notes: dict = field(default_factory=dict)  #: {label: text} kept as attributes


def parse_header(data: bytes, where) -> Header:
    """Header at the start of a Level-1 file; ProductError where it has no end or cannot be understood."""
    if not data.startswith(b"header:"):
        return _label_header(data, where)
    end = data.find(YAML_END, 0, HEADER_LIMIT)
    if end < 0:
        refuse(where, "no end of the YAML header", repr(YAML_END.decode().strip()), "The file is cut or foreign.")
    size = end + len(YAML_END)
    tree = _yaml(data[:end], where)
    try:
        loose = {**(tree.get("global_attributes") or {}), **(tree.get("non-standard_attributes") or {})}
        names = tuple(v if isinstance(v, str) else str(next(iter(v))) for v in tree.get("variables") or ())
        declared = (tree.get("dimensions") or {}).get("num_records")
        declared = None if declared is None else int(declared)
    except (KeyError, TypeError, ValueError, AttributeError) as reason:
        refuse(where, f"a header without {reason}", "attributes and variables as YAML", "The file is damaged.")
    notes = {k: str(loose[k]) for k in KEPT if k in loose and not isinstance(loose[k], (dict, list))}
    satellite = _letter(str(loose.get("platform", "")))
    return Header(False, size, data.count(b"\n", 0, size), satellite, declared, names, "", notes)


def _yaml(text, where):  # mapping "header" of YAML (bytes), refused if too deep, with aliases, or no YAML
    loader, depth = getattr(yaml, "CSafeLoader", yaml.SafeLoader), 0
    try:
        for event in yaml.parse(text, loader):  # the loader below recurses, and crashes where it goes too deep
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
                refuse(where, "a header nested too deep, or with aliases", "attributes as YAML", "The file is damaged.")
        return yaml.load(text.decode("utf-8"), loader)["header"]  # noqa: S506 - both loaders are safe ones
    except UnicodeDecodeError as reason:
        line = text.count(b"\n", 0, reason.start) + 1
        return refuse(f"{where}, line {line}", "bytes that are not UTF-8", "a text header", "The file is damaged.")
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as reason:
        return refuse(where, f"a header that is not YAML ({reason})", "a YAML header", "The file is damaged.")


def _label_header(data, where):  # Header of 80-column lines "label : value"
    end = LABEL_END.search(data, 0, HEADER_LIMIT)
    if not end:
        expected, remedy = "a YAML or an 80-column header", "This is no Level-1 file, or a cut one."
        refuse(where, f"a start of {data[:20]!r}", expected, remedy)
    labels = {}
    for line in data[: end.start()].decode("latin-1").splitlines():
        label, _, value = line.partition(":")
        labels.setdefault(label.strip(), value.strip())
    declared = labels.get("NUMBER OF DATA RECORDS", "")
    binary = labels.get("FILE FORMAT 0=BINARY 1=ASCII") == "0"
    institution = "/".join(filter(None, (labels.get(f"PRODUCER {part}") for part in ("AGENCY", "INSTITUTION"))))
    notes = {"software_version": labels.get("SOFTWARE VERSION", ""), "institution": institution}
    notes[STOP] = labels.get("TIME LAST OBS(SEC PAST EPOCH)", "")
    lines, satellite = data.count(b"\n", 0, end.end()), _letter(labels.get("SATELLITE NAME", ""))
    declared = int(declared) if re.fullmatch("[0-9]{1,18}", declared) else None
    product, notes = labels.get("FILENAME", "").rpartition("/")[2][:5], {k: v for k, v in notes.items() if v}
    return Header(binary, end.end(), lines, satellite, declared, product=product, notes=notes)


def _letter(platform):  # "C" of "GRACE C", "Y" of "GRACE C+D", "" of any other text
    match = re.fullmatch(r"GRACE ([A-D])(\+[A-D])?", platform.strip())
    if not match:
        return ""
    return {"A": "X", "C": "Y"}.get(match[1], "") if match[2] else match[1]


class Malformed(Exception):
    """A token that is not of its column's kind: row (from 0), Column, token and expected form (text)."""

    def __init__(self, row, column, token, expected):
        super().__init__(f"row {row}, column {column.name}: {token!r} is not {expected}")
        self.row, self.column, self.found, self.expected = row, column, token, expected


def decode(series, column: Column) -> np.ndarray:
    """Array (n,) of a column: int64, float64, S1 characters, unsigned bits, or text; its polars series has no nulls."""
    if column.kind in BITS or column.kind == "c":
        return _by_distinct(series, column)
    if column.kind == "text":
        return np.array(series.to_list(), dtype=str)
    wanted = polars.Float64 if column.kind in FLOATS else polars.Int64
    numbers = series if series.dtype == wanted else series.cast(wanted, strict=False)
    for row in numbers.is_null().arg_true():
        token = str(series[row])
        if column.kind not in FLOATS or not NOT_A_NUMBER.fullmatch(token):
            raise Malformed(row, column, token, "a number" if column.kind in FLOATS else "a whole number")
    return numbers.fill_null(float("nan")).to_numpy() if column.kind in FLOATS else numbers.to_numpy()


def _empty(table, n):
    """{column: (n,)} of fixed (zeros) and optional columns (NaN, empty characters), to be filled with n records."""
    arrays = {c.name: np.zeros(n, dtype_of(c)) for c in table.columns}
    return arrays | {c.name: np.zeros(n, "S1") if c.kind == "c" else np.full(n, np.nan) for c in table.optional}


def dtype_of(column: Column) -> np.dtype:
    """Type of the array of a column that every record has."""
    if column.kind in INTEGERS:
        return np.dtype("i8")
    if column.kind in FLOATS:
        return np.dtype("f8")
    return np.dtype({"c": "S1", "text": "U1"}.get(column.kind) or BITS[column.kind])


def bits_value(token: str, column: Column, row: int = 0) -> int:
    """Number that a string of 0 and 1 stands for, bit 0 rightmost."""
    width = int(column.kind[1:])
    if len(token) != width or set(token) - {"0", "1"}:
        raise Malformed(row, column, token, f"{width} characters 0 or 1")
    return int(token, 2)


def _by_distinct(series, column):
    """Array (n,) of bits or characters from a series; each distinct token is converted once, as there are few."""

    def convert(token, row):  # int of bits, or bytes of a character; Malformed if it is neither
        if column.kind in BITS:
            return bits_value(token, column, row)
        if len(token) != 1 or not token.isascii():
            raise Malformed(row, column, token, "one character")
        return token.encode()

    if not len(series):
        return np.empty(0, dtype_of(column))
    if (series == series[0]).all():
        return np.full(len(series), np.array(convert(series[0], 0), dtype_of(column)))
    tokens = series.unique(maintain_order=True)
    first = [series.index_of(token) for token in tokens]
    values = np.array([convert(t, row) for t, row in zip(tokens, first, strict=True)], dtype_of(column))
    places = series.replace_strict(tokens, list(range(len(tokens))), return_dtype=polars.Int64)
    return values[places.to_numpy()]


def parse_binary(data: bytes, start: int, table: Product, where) -> dict[str, np.ndarray]:
    """Arrays (n,) of all columns of a binary file by name, from byte ``start`` on; absent values NaN."""
    table = reordered(table, table.swapped_in_binary)
    body = memoryview(data)[start:]
    if table.is_text:
        return _with_text(body, table, where)
    if table.layout_key:
        return _by_flag(body, table, where)
    record = structure(table.columns)
    whole, rest = divmod(len(body), record.itemsize)
    if rest:
        _refuse_cut(where, whole, rest, record.itemsize)
    records = np.frombuffer(body, record, whole)
    return {c.name: _native(records[c.name], c) for c in table.columns}


def structure(columns) -> np.dtype:
    """Structured type of a packed big-endian record of these columns."""
    codes = {"c": "S1", "text": "S0", **BITS}
    return np.dtype([(c.name, ">" + codes.get(c.kind, c.kind)) for c in columns])


def _by_flag(body, table, where):
    """{column: (n,)} of binary records of several lengths, read together for each value of prod_flag."""
    starts, flags = _starts(body, table, where)
    arrays, raw = _empty(table, len(starts)), np.frombuffer(body, np.uint8)
    for flag in np.unique(flags):
        columns = (*table.columns, *table.following(int(flag)))
        record = structure(columns)
        rows = np.flatnonzero(flags == flag)
        packed = raw[starts[rows][:, None] + np.arange(record.itemsize)]
        records = np.ascontiguousarray(packed).view(record)[:, 0]
        for column in columns:
            arrays[column.name][rows] = _native(records[column.name], column)
    return arrays


def _starts(body, table, where):  # (first byte, value of the column layout_key) (n,) of each binary record
    fixed = structure(table.columns)
    offset = fixed.fields[table.layout_key][1]
    width = fixed.fields[table.layout_key][0].itemsize
    position, starts, flags, sizes = 0, [], [], {}
    while position < len(body):
        flag = int.from_bytes(body[position + offset : position + offset + width], "big")
        if flag not in sizes:
            if unknown := table.undefined_bits(flag):
                here = f"{where}, record {len(starts) + 1}"
                refuse(here, f"bits {unknown} of prod_flag set", "bits the product table defines", TRUNCATED)
            sizes[flag] = structure((*table.columns, *table.following(flag))).itemsize
        if position + sizes[flag] > len(body):
            _refuse_cut(where, len(starts), len(body) - position, sizes[flag])
        starts.append(position)
        flags.append(flag)
        position += sizes[flag]
    return np.array(starts, int), np.array(flags, int)


def _with_text(body, table, where):
    """{column: (n,)} of binary records that end in a text closed by a zero byte."""
    fixed = structure(table.columns[:-1])
    data = bytes(body)
    position, heads, texts = 0, [], []
    while position < len(data):
        end = data.find(b"\0", position + fixed.itemsize)
        if end < 0:
            _refuse_cut(where, len(heads), len(data) - position, fixed.itemsize + 1)
        heads.append(data[position : position + fixed.itemsize])
        texts.append(data[position + fixed.itemsize : end].decode(errors="backslashreplace"))
        position = end + 1
    records = np.frombuffer(b"".join(heads), fixed)
    arrays = {c.name: _native(records[c.name], c) for c in table.columns[:-1]}
    return arrays | {table.columns[-1].name: np.array(texts, dtype=str)}


def _native(values, column):  # binary values (n,) in the type of `dtype_of`
    if column.name == "tank_id":  # written as a digit
        values = values - ord("0")
    return values.astype(dtype_of(column))


def _refuse_cut(where, whole, rest, size):  # raises: ``rest`` of ``size`` bytes after ``whole`` records
    remainder = f"{rest} bytes after record {whole}"
    refuse(f"{where}, record {whole + 1}", remainder, f"{size} bytes", TRUNCATED, record=whole + 1, bytes=rest)


def parse_text(data: bytes, start: int, header_lines: int, table: Product, where) -> dict[str, np.ndarray]:
    """Arrays of all columns of an ASCII file by name: (n,), repeated columns (n, slots), absent values NaN.

    "undecodable" (n,) bool says where bytes of a text column are not UTF-8. The header has ``start`` bytes.
    """
    if start == len(data):
        return _empty(table, 0) | {c.name: np.empty((0, 0)) for c in table.repeated}
    if not data.endswith(b"\n"):
        line = data.count(b"\n") + 1
        refuse(f"{where}, line {line}", "a last line cut short", "a line end", "Fetch the file again.", line=line)
    try:
        if table.is_text:
            return _sorted_by_layout(data[start:], table, where, header_lines)
        arrays = _at_once(data, start, header_lines, table)
        if arrays is None:  # with blanks between columns made single
            body = re.sub(rb"[ \t\r]+", b" ", data[start:].rstrip(b" \t\r\n") + b"\n")
            body = body.replace(b" \n", b"\n").replace(b"\n ", b"\n").lstrip(b" ")
            arrays = _at_once(body, 0, 0, table) or _sorted_by_layout(body, table, where, header_lines)
        return arrays
    except Malformed as bad:
        line = header_lines + bad.row + 1
        place = f"{where}, line {line}, column {bad.column.file_name}"
        return refuse(place, repr(bad.found), bad.expected, DAMAGED, line=line, column=bad.column.file_name)


def _at_once(data, start, header_lines, table):
    """{column: (n,)} by one read_csv where all records have the layout and blanks of the first; else None."""
    pieces = data[start : data.index(b"\n", start)].decode("utf-8", "replace").split(" ")
    columns = _layout(table, [piece for piece in pieces if piece])
    if columns is None or table.repeated:
        return None
    types = dict.fromkeys(INTEGERS, polars.Int64) | dict.fromkeys(FLOATS, polars.Float64)
    kinds = (types.get(column.kind, polars.String) for column in columns)
    schema = {f"{i}": next(kinds) if piece else polars.Boolean for i, piece in enumerate(pieces)}
    try:
        frame = polars.read_csv(
            data, separator=" ", has_header=False, skip_lines=header_lines, schema=schema, quote_char=None
        )
    except polars.exceptions.PolarsError:
        return None
    filled = {f"{i}": bool(piece) for i, piece in enumerate(pieces)}
    if any(frame[i].null_count() != (0 if there else len(frame)) for i, there in filled.items()):
        return None
    series = dict(zip((c.name for c in columns), (frame[i] for i, there in filled.items() if there), strict=True))
    if table.optional and not (series["prod_flag"] == series["prod_flag"][0]).all():
        return None
    arrays = {c.name: decode(series[c.name], c) for c in columns}
    floats = {c.name: arrays[c.name].astype(float) for c in table.optional if c.name in arrays and c.kind != "c"}
    return arrays | floats  # which know NaN; characters stay


def _layout(table, tokens):
    """Columns of the table that match the tokens (texts) of one record; None if they match no layout."""
    key, names = 0, [c.name for c in table.columns]
    if table.layout_key:
        place = names.index(table.layout_key)
        try:
            key = _key_value(table, tokens[place])
        except (IndexError, Malformed):
            return None
    if table.undefined_bits(key):
        return None
    columns = (*table.columns, *table.following(key))
    return columns if len(columns) == len(tokens) else None


def _key_value(table, token, row=0):  # whole number of a token of the column `layout_key`; Malformed if none
    column = table.column(table.layout_key)
    if column.kind.startswith("b"):
        return bits_value(token, column, row)
    if not re.fullmatch("[0-9]{1,3}", token):
        raise Malformed(row, column, token, "a whole number")
    return int(token)


def _sorted_by_layout(body, table, where, header_lines):
    """{column: (n,)} and "undecodable" of records of several layouts, each layout read by itself."""
    lines, undecodable = _lines(body, table, where, header_lines)
    text = polars.Series("line", lines, dtype=polars.String)
    counts = text.str.count_matches(" ", literal=True).to_numpy() + 1
    arrays = _empty(table, len(lines))
    if table.repeated:
        slots = max((int(counts.max()) - len(table.columns)) // len(table.repeated), 0)
        arrays |= {c.name: np.full((len(lines), slots), np.nan) for c in table.repeated}
    for key, rows in _groups(text, table):
        columns = (*table.columns, *table.following(key))
        if unknown := table.undefined_bits(key):
            line = header_lines + int(rows[0]) + 1
            wrong = f"bits {unknown} of prod_flag set"
            refuse(f"{where}, line {line}", wrong, "bits the product table defines", DAMAGED, line=line)
        if not table.is_text and (counts[rows] != len(columns)).any():
            row = rows[np.argmax(counts[rows] != len(columns))]
            line, count = header_lines + int(row) + 1, int(counts[row])
            refuse(f"{where}, line {line}", f"{count} columns", f"{len(columns)}", DAMAGED, line=line, columns=count)
        split = text.gather(rows).str.split_exact(" ", len(columns) - 1)
        series = _text_columns(text, table) if table.is_text else split.struct.unnest().get_columns()
        for place, column in enumerate(columns):
            try:
                values = decode(series[place], column)
            except Malformed as bad:
                raise Malformed(int(rows[bad.row]), column, bad.found, bad.expected) from None
            if column.kind == "text":
                arrays[column.name] = values
            elif column in table.repeated:
                arrays[column.name][rows, (place - len(table.columns)) // len(table.repeated)] = values
            else:
                arrays[column.name][rows] = values
    arrays["undecodable"] = undecodable
    return arrays


def _lines(body, table, where, header_lines):
    """([line], (n,) bool: not UTF-8) of the records; refused if such a line is of a table without text."""
    body = body.rstrip(b" \t\r\n")
    try:
        lines = body.decode().split("\n")
        return lines, np.zeros(len(lines), bool)
    except UnicodeDecodeError:
        lines = [line.decode(errors="backslashreplace") for line in body.split(b"\n")]
        undecodable = np.array([text.encode() != line for text, line in zip(lines, body.split(b"\n"), strict=True)])
    if not table.is_text:
        line = header_lines + int(np.argmax(undecodable)) + 1
        refuse(f"{where}, line {line}", "bytes that are not UTF-8", "numbers and flags", DAMAGED, line=line)
    return lines, undecodable


def _text_columns(text, table):
    """[Series of text] of the leading columns, and of the rest of each line as it is."""
    leading = len(table.columns) - 1
    pattern = r"^\s*" + r"\s+".join([r"(\S+)"] * leading) + r"(?:\s(.*?))?\r?$"
    columns = text.str.extract_groups(pattern).struct.unnest()
    missing = columns[:, 0].is_null().arg_true()
    if len(missing):
        raise Malformed(int(missing[0]), table.columns[0], text[int(missing[0])], f"{leading} columns and a text")
    return columns.fill_null("").get_columns()


def _groups(text, table):  # [(value of the column `layout_key`, rows (m,))], one a layout
    if not table.layout_key:
        return [(0, np.arange(len(text)))]
    place = [c.name for c in table.columns].index(table.layout_key)
    keys = text.str.extract(rf"^(?:\S+ ){{{place}}}(\S+)").fill_null("")
    groups = [(token, (keys == token).arg_true().to_numpy()) for token in keys.unique(maintain_order=True)]
    return [(_key_value(table, token, int(rows[0])) if token else 0, rows) for token, rows in groups]


TICKS = {"s": 1_000_000_000, "us": 1_000, "ns": 1}
FLAGS = tomllib.loads(Path(__file__).with_name("flags.toml").read_text(encoding="utf-8"))
NOT_FINITE, NOT_UNIT, OUT_OF_ORDER, REPEATED, CONFLICTING, OTHER_SATELLITE, OUT_OF_RANGE, UNDEFINED = (
    1 << bit for bit in range(len(FLAGS))
)
MEANING = {1 << bit: text for bit, text in enumerate(FLAGS.values())}
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
    source : path of a file (.txt .asc .dat, also .gz), or a LevelOneFile, such as a member of an archive
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
        file = archive.from_name(path) or archive.LevelOneFile(path, None, "", "", "", "")
    data = archive.content(file)
    header = parse_header(data, file.where)
    satellite = file.satellite or header.satellite
    product = product or file.product or header.product
    if not product:
        refuse(file.where, "no product in the name or header", "one", "Give the product.")
    table = table_of(product, mission_of(satellite))
    _check_columns(header, table, file.where)
    if header.binary:
        arrays = parse_binary(data, header.size, table, file.where)
    else:
        arrays = parse_text(data, header.size, header.lines, table, file.where)
    seconds, ticks = _tags(arrays, table, file.where)
    _check_identity(file, header, table, arrays, (expect_satellite, expect_date))
    flag = flags(arrays, ticks, table, satellite)
    observed = _assembled(arrays, seconds, ticks, flag, table)
    attrs = {"product": table.name, "mission": table.mission, "satellite": satellite, "date": file.date}
    attrs |= {"release": file.release, "file": file.name, "time_scale": table.time_scale, "records": len(flag)}
    if header.declared is not None:
        attrs["records_declared"] = header.declared
    stop = re.match(r"[0-9]+[.]?[0-9]*", header.notes.get(STOP, ""))
    if stop and len(flag) < (header.declared or 0) and seconds.max(initial=0) < float(stop[0]) - CUT_S:
        attrs["cut"] = f"{file.name} {len(flag)} {header.declared}"
    if header.satellite and header.satellite != satellite:
        attrs["header_satellite"] = header.satellite
    attrs |= {"table_tested": str(table.sampled).lower()}
    observed.attrs = attrs | {f"header_{k}": v for k, v in header.notes.items()}
    observed.attrs["origin"] = archive.origin_of_header(data[: header.size].decode("latin-1"))
    return observed


def _check_columns(header, table: Product, where):
    """Refuse a YAML header unless its columns are those of the table, in its order; optional ones may be left out."""
    if not header.names:
        return
    names = [n for n in map(_plain, header.names) if n not in map(_plain, table.header_only)]
    for known in (table, reordered(table, table.swapped_in_header)):
        fixed = [_plain(c.file_name) for c in known.columns]
        expected = fixed + [_plain(c.file_name) for c in (*known.optional, *known.repeated)]
        if [n for n in expected if n in names] == names and set(fixed) <= set(names):
            return
    differing = sorted((set(names) - set(expected)) | (set(fixed) - set(names))) or "the same ones in another order"
    clash = f"columns in the header that differ from the table of {table.name}: {differing}"
    refuse(where, clash, "the columns of RL04", "Another product or release: give the right product, or add its table.")


def _plain(name):  # name of a column with "_" for odd characters
    return re.sub(r"[^A-Za-z0-9+-]", "_", str(name).strip())


def _tags(arrays, table, where):
    """(whole seconds (n,), ns (n,)) of the time tags, int64, past 2000-01-01 12:00:00."""
    ticks = arrays[table.time[0]] * TICKS["s"]
    if len(table.time) > 1:
        column, values = table.column(table.time[1]), arrays[table.time[1]]
        tick = TICKS[column.units]
        too_large = np.count_nonzero((values < 0) | (values >= TICKS["s"] // tick))
        if too_large > len(values) / 2:
            largest = f"{column.name} up to {values.max()} {column.unit}"
            refuse(where, largest, "less than one second", "The unit differs from the table's: correct the table.")
        ticks = ticks + values * tick
    return ticks // TICKS["s"], ticks


def _assembled(arrays, seconds, ticks, flag, table):  # Dataset over "record" with units, frames, meanings
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
    present = [column for column in table.optional if bits >> column.bit & 1]  # by at least one record
    for column in (*table.columns, *present, *table.repeated):
        dims = ("record", "slot") if column in table.repeated else "record"
        name = names.get(column.name, column.name)
        about = table.column(name)
        attrs = {"units": about.units, "long_name": about.meaning or about.file_name}
        attrs |= {"frame": about.frame} if about.frame else {}
        attrs |= {"file_name": about.file} if about.file else {}
        attrs |= _bits({1 << int(k): v for k, v in ((table.flags or {}).get(name) or {}).items()})
        if name in (table.values or {}):
            attrs["value_meanings"] = "; ".join(f"{k} = {v}" for k, v in table.values[name].items())
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
    """{column in AF: name in SRF}: SRF x is column z, y is column x, z is column y of the accelerometer frame."""
    return {af[(i + 2) % 3]: af[i] for af in table.to_srf for i in range(3)}


def _bits(meanings):  # CF attributes flag_masks and flag_meanings of {mask: text}, {} without
    if not meanings:
        return {}
    words = [re.sub(r"[^A-Za-z0-9.+-]+", "_", text).strip("_") for text in meanings.values()]
    described = "; ".join(f"{mask} = {text}" for mask, text in meanings.items())
    return {"flag_masks": list(meanings), "flag_meanings": " ".join(words), "flag_description": described}


def flags(arrays: dict, ticks: np.ndarray, table: Product, satellite: str) -> np.ndarray:
    """Bits (n,) uint8 of the doubts about each record, as in ``MEANING``; ``ticks`` (n,) int64 ns are time tags."""
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


def _mark(flag, where, bit):  # set a bit in flag (n,) where (n,) bool; None: nowhere
    if where is not None and where.any():
        flag[where] |= bit


def _check_order(flag, ticks, arrays, table):  # marks records out of order, repeated or conflicting in flag
    steps = np.diff(ticks)
    if (steps > 0).all():
        return
    _mark(flag, np.concatenate([[False], ticks[1:] < np.maximum.accumulate(ticks)[:-1]]), OUT_OF_ORDER)
    keys = [np.unique(arrays[k], return_inverse=True)[1] for k in table.keys if k in arrays]
    order = np.lexsort([np.arange(len(ticks)), *keys, ticks])
    same_key = np.ones(len(ticks) - 1, bool)
    for key in (ticks, *keys):
        same_key &= key[order][1:] == key[order][:-1]
    if not same_key.any():
        return
    same_values = np.ones(len(order) - 1, bool)
    for column in (*table.columns, *table.optional, *table.repeated):
        if column.name in arrays and column.name != "qualflg":
            values = arrays[column.name][order]
            alike = (values[1:] == values[:-1]) | ((values[1:] != values[1:]) & (values[:-1] != values[:-1]))
            same_values &= alike.reshape(len(alike), -1).all(axis=1)
    flag[order[1:][same_key & same_values]] |= REPEATED
    flag[order[1:][same_key & ~same_values]] |= CONFLICTING


def _check_identity(file, header, table, arrays, expected):
    """Refuse a file of another satellite, day or time scale than its name, header or the caller (letter, date) says."""
    where, (satellite, day) = file.where, expected
    if not table.id_name:  # a combined product is the file of either satellite
        satellite = archive.TOGETHER.get(satellite, satellite)
    claimed = {"name": file.satellite, "request": satellite or ""}
    if table.id_name and len(arrays[table.id_name]):
        claimed["records"] = chr(np.bincount(arrays[table.id_name].view(np.uint8)).argmax())
    else:  # headers are known to name the other satellite: records overrule them
        claimed["header"] = header.satellite
    letters = {k: v for k, v in claimed.items() if v}
    if len(set(letters.values())) > 1:
        claims = ", ".join(f"{v} by its {k}" for k, v in letters.items())
        refuse(where, f"satellite {claims}", "one satellite", "Take the file of the right satellite.", **letters)
    if day and file.date and file.date != day:
        refuse(where, f"a file of {file.date}", day, "Take the file of the right day.", date=file.date)
    seconds, day = arrays[table.time[0]], day or file.date
    if day and len(seconds) and not table.constant:
        exact = table.time_scale == "GPS" and table.name.endswith("1B")
        margin, noon_2000 = GPS_MARGIN_S if exact else MARGIN_S, np.datetime64("2000-01-01T12:00:00")
        if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", day):
            refuse(where, f"the date {day}", "YYYY-MM-DD", "Correct the date.")
        start = int((np.datetime64(day) - noon_2000) / np.timedelta64(1, "s"))
        middle = int(np.median(seconds))  # the ends of a file may lie in the days beside its own
        if not start - margin <= middle < start + DAY_S + margin:
            coverage = f"records not of {day}, their middle at {noon_2000 + np.timedelta64(middle, 's')} GPS"
            refuse(where, coverage, f"records of {day}", "Take the right day's file.")
    other_scale = _other_time(arrays, table)
    if other_scale is not None and 2 * np.count_nonzero(other_scale) > other_scale.size:  # fewer are flagged
        written = ", ".join(sorted({one.decode("latin-1") for one in np.unique(arrays["time_ref"][other_scale])}))
        expected = f"{', '.join(KNOWN_TIMES[table.time_scale].decode())} for {table.time_scale} time"
        remedy = "The tags are of another time scale: take the product of the right level."
        refuse(where, f"time_ref {written}", expected, remedy)
    off_norm = _off_length(arrays, table)
    if off_norm is not None and np.count_nonzero(off_norm) > NORM_SHARE * off_norm.size:  # fewer are flagged
        norms = f"{np.count_nonzero(off_norm)} of {off_norm.size} quaternions whose norm is not one"
        refuse(where, norms, "unit quaternions", "The file is damaged: fetch it again, or write it with more digits.")


def _off_length(arrays, table):
    """True (n,) where the norm of the quaternion differs from one; None where the product has none."""
    if not table.quaternion:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(np.sqrt(sum(arrays[name] * arrays[name] for name in table.quaternion)) - 1)
    limit = np.clip(NORM_ROUNDINGS * np.nanmedian(deviation), *NORM_LIMITS) if np.isfinite(deviation).any() else 0.0
    return ~(deviation <= limit)


def _other_time(arrays, table):
    """True (n,) where time_ref is not that of the product's time scale; None without such a column."""
    if "time_ref" not in arrays:
        return None
    known = np.frombuffer(KNOWN_TIMES[table.time_scale], np.uint8)
    return ~np.isin(arrays["time_ref"].view(np.uint8), known)
