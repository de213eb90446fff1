"""Numbers of a result as a table of quantities, which a product holds as variables: no text in an attribute to parse.

A quantity is named by its place in the result, a JSON pointer (RFC 6901) such as "/findings/0/parameters/delay/value".
A record is a frozen dataclass; a field that has its default is left out.
"""

import functools
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

#: Variables of the table, as schemas of products have them.
SCHEMA = {
    "quantity": {"dims": "quantity", "dtype": "str", "long_name": "place in the result, a JSON pointer"},
    "quantity_kind": {"dims": "quantity", "dtype": "str", "long_name": "number, integer, truth, text, list or table"},
    "quantity_value": {"dims": "quantity", "units": "1", "long_name": "number, in the unit that the result states"},
    "quantity_text": {"dims": "quantity", "dtype": "str", "long_name": "text"},
}
AS_TABLES = {"exclude_defaults": True, "warnings": False}  # options of the dump of records by pydantic


def tabled(dataset: Any, result: Any) -> Any:
    """Dataset (xarray) with the table of a result, a record or numbers, texts, lists and tables; NaN is None."""
    columns = zip(*_rows("", _adapter(type(result)).dump_python(result, **AS_TABLES)), strict=True)
    variables = {}
    for (name, spec), values in zip(SCHEMA.items(), columns, strict=True):
        labels = {label: spec[label] for label in ("units", "long_name") if label in spec}
        variables[name] = "quantity", np.array(values, dtype=object if "dtype" in spec else float), labels
    return dataset.drop_dims("quantity", errors="ignore").assign(variables)


@functools.cache
def _adapter(kind):
    """Pydantic TypeAdapter of a kind, which validates and dumps its records."""
    from pydantic import TypeAdapter  # 30 ms that a run which finds everything need not wait

    return TypeAdapter(kind)


def plain(record: Any) -> dict:
    """Tables {name: value} of a record, of JSON types, in the order of their names."""
    return json.loads(json.dumps(_adapter(type(record)).dump_python(record, **AS_TABLES), sort_keys=True))


def record_of(kind: Any, tables: Any) -> Any:
    """Record of a kind, or several, validated from tables as of `result_of`."""
    return _adapter(kind).validate_python(tables)


def _rows(place: str, value) -> Iterator[tuple[str, str, float, str]]:
    """Yield JSON pointer, kind, number, text of a value and of all that it holds, tables in order of names."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, (Mapping, list, tuple)):
        mapped = isinstance(value, Mapping)
        yield place, "table" if mapped else "list", np.nan, ""
        for name, member in sorted(value.items()) if mapped else enumerate(value):
            yield from _rows(f"{place}/{str(name).replace('~', '~0').replace('/', '~1')}", member)
    elif isinstance(value, str):
        yield place, "text", np.nan, value
    else:
        kind = {bool: "truth", int: "integer"}.get(type(value), "number")
        yield place, kind, float(value) if value is not None and math.isfinite(value) else np.nan, ""


def result_of(dataset: Any) -> dict:
    """Result in the table of a dataset, nested tables and lists, {} if it has none; a NaN number is None."""
    places = {"": {}}
    for place, kind, number, text in zip(*(dataset[name].values for name in SCHEMA if name in dataset), strict=True):
        value = {"table": {}, "list": [], "text": text, "truth": bool(number)}.get(kind)
        if value is None and math.isfinite(number):
            value = int(number) if kind == "integer" else float(number)
        parent, _, name = place.rpartition("/")
        if place and isinstance(places[parent], list):
            places[parent].append(value)
        elif place:
            places[parent][name.replace("~1", "/").replace("~0", "~")] = value
        places |= {place: value} if kind in ("table", "list") else {}
    return places[""]
