"""GRACE binary records to arrays: numpy structures, big endian and packed, made from the product table."""

import numpy as np

from gravcal.errors import refuse
from gravcal.io.readers.decoding import dtype_of
from gravcal.io.readers.tables import BITS, Product, reordered

TRUNCATED = "The file is cut: fetch it again."


def parse(data: bytes, start: int, table: Product, where) -> dict[str, np.ndarray]:
    """Arrays of all columns of a binary file.

    Parameters
    ----------
    data : the whole file
    start : length of its header in bytes
    table : the product's columns
    where : name of the file, for messages

    Returns
    -------
    arrays : by column name, (n,) each; absent values NaN

    Raises
    ------
    ProductError : a cut record, or bits in prod_flag that stand for nothing
    """
    table = reordered(table, table.swapped_in_binary)
    body = memoryview(data)[start:]
    if table.is_text:
        return _with_text(body, table, where)
    if not table.layout_key:
        return _alike(body, table, where)
    return _by_flag(body, table, where)


def structure(columns) -> np.dtype:
    """Packed big-endian record of these columns."""
    codes = {"c": "S1", "text": "S0", **BITS}
    return np.dtype([(c.name, ">" + codes.get(c.kind, c.kind)) for c in columns])


def _alike(body, table, where):
    record = structure(table.columns)
    whole, rest = divmod(len(body), record.itemsize)
    if rest:
        _refuse_cut(where, whole, rest, record.itemsize)
    records = np.frombuffer(body, record, whole)
    return {c.name: _native(records[c.name], c) for c in table.columns}


def _by_flag(body, table, where):
    """Records of several lengths: find where each starts, then read those alike together."""
    starts, flags = _starts(body, table, where)
    n = len(starts)
    arrays = {c.name: np.zeros(n, dtype_of(c)) for c in table.columns}
    arrays |= {c.name: np.zeros(n, "S1") if c.kind == "c" else np.full(n, np.nan) for c in table.optional}
    raw = np.frombuffer(body, np.uint8)
    for flag in np.unique(flags):
        columns = (*table.columns, *table.following(int(flag)))
        record = structure(columns)
        rows = np.flatnonzero(flags == flag)
        packed = raw[starts[rows][:, None] + np.arange(record.itemsize)]
        records = np.ascontiguousarray(packed).view(record)[:, 0]
        for column in columns:
            arrays[column.name][rows] = _native(records[column.name], column)
    return arrays


def _starts(body, table, where):
    fixed = structure(table.columns)
    offset = fixed.fields["prod_flag"][1]
    width = fixed.fields["prod_flag"][0].itemsize
    position, starts, flags, sizes = 0, [], [], {}
    while position < len(body):
        flag = int.from_bytes(body[position + offset : position + offset + width], "big")
        if flag not in sizes:
            sizes[flag] = _size(table, flag, f"{where}, record {len(starts) + 1}")
        if position + sizes[flag] > len(body):
            _refuse_cut(where, len(starts), len(body) - position, sizes[flag])
        starts.append(position)
        flags.append(flag)
        position += sizes[flag]
    return np.array(starts, int), np.array(flags, int)


def _size(table, flag, where):
    if unknown := table.undefined_bits(flag):
        refuse(where, f"bits {unknown} of prod_flag set", "bits the product table defines", TRUNCATED)
    return structure((*table.columns, *table.following(flag))).itemsize


def _with_text(body, table, where):
    """Records that end in a text closed by a zero byte."""
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


def _native(values, column):
    if column.name == "tank_id":  # written as a digit
        values = values - ord("0")
    return values.astype(dtype_of(column))


def _refuse_cut(where, whole, rest, size):
    found = f"{rest} bytes after record {whole}"
    refuse(f"{where}, record {whole + 1}", found, f"{size} bytes", TRUNCATED, record=whole + 1, bytes=rest)
