"""From tokens to numbers: one series of texts or numbers to one array of the kind the table asks for."""

import re

import numpy as np

from gravcal.io.readers.tables import BITS, FLOATS, INTEGERS, Column

NOT_A_NUMBER = re.compile(r"[+-]?nan(\(.*\))?", re.IGNORECASE)


class Malformed(Exception):
    """A token that is not of its column's kind: row (from 0), column, token and what was expected."""

    def __init__(self, row, column, found, expected):
        super().__init__(f"row {row}, column {column.name}: {found!r} is not {expected}")
        self.row, self.column, self.found, self.expected = row, column, found, expected


def decode(series, column: Column) -> np.ndarray:
    """Array of one column.

    Parameters
    ----------
    series : polars Series, numbers already or the texts of the column; no nulls
    column : its record in the product table

    Returns
    -------
    values : (n,) int64, float64, S1 characters, unsigned bits, or text
    """
    if column.kind in BITS:
        return _by_distinct(series, column, _bits)
    if column.kind == "c":
        return _by_distinct(series, column, _character)
    if column.kind == "text":
        return np.array(series.to_list(), dtype=str)
    return _numbers(series, column)


def dtype_of(column: Column) -> np.dtype:
    """Type of the array that stands for a column that every record has."""
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


def _bits(token, column, row):
    return np.array(bits_value(token, column, row), dtype=dtype_of(column))


def _character(token, column, row):
    if len(token) != 1 or not token.isascii():
        raise Malformed(row, column, token, "one character")
    return np.array(token.encode(), dtype="S1")


def _by_distinct(series, column, convert):
    """Convert each distinct token once: such columns hold a few values in a million rows."""
    if not len(series):
        return np.empty(0, dtype_of(column))
    if (series == series[0]).all():
        return np.full(len(series), convert(series[0], column, 0))
    tokens = series.unique(maintain_order=True)
    first = [series.index_of(token) for token in tokens]
    values = np.array([convert(t, column, row) for t, row in zip(tokens, first, strict=True)], dtype_of(column))
    places = series.replace_strict(tokens, list(range(len(tokens))), return_dtype=_polars().Int64)
    return values[places.to_numpy()]


def _numbers(series, column):
    polars = _polars()
    wanted = polars.Float64 if column.kind in FLOATS else polars.Int64
    numbers = series if series.dtype == wanted else series.cast(wanted, strict=False)
    for row in numbers.is_null().arg_true():
        token = str(series[row])
        if column.kind not in FLOATS or not NOT_A_NUMBER.fullmatch(token):
            raise Malformed(row, column, token, "a number" if column.kind in FLOATS else "a whole number")
    return numbers.fill_null(float("nan")).to_numpy() if column.kind in FLOATS else numbers.to_numpy()


def _polars():
    import polars

    return polars
