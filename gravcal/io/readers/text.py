"""ASCII records to arrays: polars reads a fixed layout at once; what varies is sorted by layout first."""

import numpy as np

from gravcal.errors import refuse
from gravcal.io.readers.decoding import Malformed, bits_value, decode, dtype_of
from gravcal.io.readers.tables import FLOATS, INTEGERS, Product

DAMAGED = "The file is damaged or of another layout: fetch it again, or correct the line."


def parse(data: bytes, start: int, header_lines: int, table: Product, where) -> dict[str, np.ndarray]:
    """Arrays of all columns of an ASCII file.

    Parameters
    ----------
    data : the whole file
    start, header_lines : length of its header in bytes and lines
    table : the product's columns
    where : name of the file, for messages

    Returns
    -------
    arrays : by column name, (n,) each; repeated columns (n, slots); absent values NaN;
        "undecodable" (n,) bool where bytes of a text column are not UTF-8

    Raises
    ------
    ProductError : cut line, wrong number of columns, a token that is not of its column's kind
    """
    if start == len(data):
        return _empty(table)
    if not data.endswith(b"\n"):
        line = data.count(b"\n") + 1
        refuse(f"{where}, line {line}", "a last line cut short", "a line end", "Fetch the file again.", line=line)
    try:
        if table.is_text:
            return _sorted_by_layout(data[start:], table, where, header_lines)
        return _at_once(data, start, header_lines, table) or _evened(data[start:], table, where, header_lines)
    except Malformed as bad:
        line = header_lines + bad.row + 1
        place = f"{where}, line {line}, column {bad.column.file_name}"
        return refuse(place, repr(bad.found), bad.expected, DAMAGED, line=line, column=bad.column.file_name)


def _empty(table):
    fixed = {c.name: np.empty(0, dtype_of(c)) for c in table.columns}
    optional = {c.name: np.empty(0) for c in table.optional}
    return fixed | optional | {c.name: np.empty((0, 0)) for c in table.repeated}


def _at_once(data, start, header_lines, table):
    """All columns in one go where every record is laid out as the first one is; None where one is not."""
    import polars

    pieces = data[start : data.index(b"\n", start)].decode("utf-8", "replace").split(" ")
    columns = _layout(table, [piece for piece in pieces if piece])
    if columns is None or table.repeated:
        return None
    names = iter(columns)
    schema = {f"{i}": _polars_type(next(names)) if piece else polars.Boolean for i, piece in enumerate(pieces)}
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
    return _optional_as_floats({c.name: decode(series[c.name], c) for c in columns}, table)


def _polars_type(column):
    import polars

    return polars.Int64 if column.kind in INTEGERS else polars.Float64 if column.kind in FLOATS else polars.String


def _layout(table, tokens):
    """Columns of a record with these tokens, None where their number does not fit."""
    key = _key(table, tokens)
    if key is None or table.undefined_bits(key):
        return None
    columns = (*table.columns, *table.following(key))
    return columns if len(columns) == len(tokens) else None


def _key(table, tokens):
    if not table.layout_key:
        return 0
    place = [c.name for c in table.columns].index(table.layout_key)
    if place >= len(tokens):
        return None
    try:
        return _key_value(table, tokens[place])
    except Malformed:
        return None


def _key_value(table, token, row=0):
    column = table.column(table.layout_key)
    if column.kind.startswith("b"):
        return bits_value(token, column, row)
    if not token.isdigit():
        raise Malformed(row, column, token, "a whole number")
    return int(token)


def _optional_as_floats(arrays, table):
    """Optional columns as float64, which knows NaN; characters stay."""
    for column in table.optional:
        if column.name in arrays and column.kind != "c":
            arrays[column.name] = arrays[column.name].astype(float)
    return arrays


def _evened(body, table, where, header_lines):
    """The same with blanks between columns made single; what still is not alike goes layout by layout."""
    body = _single_blanks(body.rstrip(b" \t\r\n") + b"\n")
    return _at_once(body, 0, 0, table) or _sorted_by_layout(body, table, where, header_lines)


def _sorted_by_layout(body, table, where, header_lines):
    """Records of several layouts, with any blanks between columns: each layout is read by itself."""
    import polars

    lines, undecodable = _lines(body, table, where, header_lines)
    text = polars.Series("line", lines, dtype=polars.String)
    counts = text.str.count_matches(" ", literal=True).to_numpy() + 1
    arrays = _blank(table, len(lines), int(counts.max()))
    for key, rows in _groups(text, table):
        columns = (*table.columns, *table.following(key))
        _check_bits(table, key, rows, where, header_lines)
        if not table.is_text:
            _check_counts(counts[rows], rows, len(columns), where, header_lines)
        series = _text_columns(text, table) if table.is_text else _columns(text, rows, columns)
        for place, column in enumerate(columns):
            try:
                values = decode(series[place], column)
            except Malformed as bad:
                raise Malformed(int(rows[bad.row]), column, bad.found, bad.expected) from None
            _place(arrays, table, column, rows, (place, values))
    arrays["undecodable"] = undecodable
    return arrays


def _columns(text, rows, columns):
    """Columns of lines that all have as many tokens: numbers if they are, else their texts."""
    import polars

    lines = text if len(rows) == len(text) else text.gather(rows)
    data = "\n".join(lines.to_list()).encode() + b"\n"
    for types in (map(_polars_type, columns), (polars.String for _ in columns)):
        schema = {str(i): kind for i, kind in enumerate(types)}
        try:
            frame = polars.read_csv(data, separator=" ", has_header=False, schema=schema, quote_char=None)
        except polars.exceptions.PolarsError:
            continue
        if not any(frame.null_count().row(0)):
            break
    return frame.get_columns()


def _lines(body, table, where, header_lines):
    """Lines of the file, and which of them are not UTF-8."""
    body = body.rstrip(b" \t\r\n")
    try:
        lines = body.decode().split("\n")
        return lines, np.zeros(len(lines), bool)
    except UnicodeDecodeError:
        raw = body.split(b"\n")
        undecodable = np.array([not _is_utf8(line) for line in raw])
    if not table.is_text:
        line = header_lines + int(np.argmax(undecodable)) + 1
        refuse(f"{where}, line {line}", "bytes that are not UTF-8", "numbers and flags", DAMAGED, line=line)
    return [line.decode(errors="backslashreplace") for line in raw], undecodable


def _single_blanks(body):
    body = body.replace(b"\t", b" ").replace(b"\r", b" ")
    while b"  " in body:
        body = body.replace(b"  ", b" ")
    return body.replace(b" \n", b"\n").replace(b"\n ", b"\n").lstrip(b" ")


def _is_utf8(line):
    try:
        line.decode()
    except UnicodeDecodeError:
        return False
    return True


def _text_columns(text, table):
    """Leading columns, then the rest of the record as it stands."""
    leading = len(table.columns) - 1
    pattern = r"^\s*" + r"\s+".join([r"(\S+)"] * leading) + r"(?:\s(.*?))?\r?$"
    found = text.str.extract_groups(pattern).struct.unnest()
    missing = found[:, 0].is_null().arg_true()
    if len(missing):
        raise Malformed(int(missing[0]), table.columns[0], text[int(missing[0])], f"{leading} columns and a text")
    return found.fill_null("").get_columns()


def _groups(text, table):
    """Rows of each layout, by the value of the layout key."""
    if not table.layout_key:
        return [(0, np.arange(len(text)))]
    place = [c.name for c in table.columns].index(table.layout_key)
    keys = text.str.extract(rf"^(?:\S+ ){{{place}}}(\S+)").fill_null("")
    found = []
    for token in keys.unique(maintain_order=True):
        rows = (keys == token).arg_true().to_numpy()
        found.append((_key_value(table, token, int(rows[0])) if token else 0, rows))
    return found


def _check_counts(counts, rows, expected, where, header_lines):
    wrong = np.flatnonzero(counts != expected)
    if len(wrong):
        line = header_lines + int(rows[wrong[0]]) + 1
        found = int(counts[wrong[0]])
        refuse(f"{where}, line {line}", f"{found} columns", f"{expected}", DAMAGED, line=line, columns=found)


def _check_bits(table, key, rows, where, header_lines):
    unknown = table.undefined_bits(key)
    if unknown:
        line = header_lines + int(rows[0]) + 1
        found = f"bits {unknown} of prod_flag set"
        refuse(f"{where}, line {line}", found, "bits the product table defines", DAMAGED, line=line)


def _blank(table, n, most):
    arrays = {c.name: np.zeros(n, dtype_of(c)) for c in table.columns if c.kind != "text"}
    arrays |= {c.name: np.zeros(n, "S1") if c.kind == "c" else np.full(n, np.nan) for c in table.optional}
    if table.repeated:
        slots = (most - len(table.columns)) // len(table.repeated)
        arrays |= {c.name: np.full((n, max(slots, 0)), np.nan) for c in table.repeated}
    return arrays


def _place(arrays, table, column, rows, found):
    place, values = found
    if column.kind == "text":
        arrays[column.name] = values
    elif column in table.repeated:
        slot = (place - len(table.columns)) // len(table.repeated)
        arrays[column.name][rows, slot] = values
    else:
        arrays[column.name][rows] = values
