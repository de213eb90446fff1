"""TOML as gravcal writes it: entries of the catalogue, plans of designs and extended models."""

import json
import re


def text(content: dict, comment: str = "") -> str:
    """File of values, tables and lists of tables below comments; what is None or empty is left out of a line."""
    tables = {n: one for n, one in content.items() if isinstance(one, dict) or one and _are_tables(one)}
    lines = [f"# {line}" for line in comment.splitlines()]
    lines += _lines({name: one for name, one in content.items() if name not in tables})
    for name, one in tables.items():
        for table in one if isinstance(one, list) else [one]:
            lines += ["", f"[[{name}]]" if isinstance(one, list) else f"[{name}]", *_lines(table)]
    return "\n".join(lines) + "\n"


def _are_tables(value):
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _lines(table):
    """Lines of a table; tables of tables in it by dotted names."""
    found = []
    for name, item in table.items():
        if isinstance(item, dict) and item and all(isinstance(value, dict) for value in item.values()):
            found += [f"{_key(name)}.{_key(part)} = {_value(value)}" for part, value in item.items()]
        elif item is not None and item != {}:
            found.append(f"{_key(name)} = {_value(item)}")
    return found


def _key(name):
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else json.dumps(name, ensure_ascii=False)


def _value(item):
    """A value on one line, numbers with all their digits."""
    if isinstance(item, dict):
        return f"{{ {', '.join(f'{n} = {_value(v)}' for n, v in item.items() if v is not None and v != {})} }}"
    if isinstance(item, (list, tuple)):
        return f"[{', '.join(map(_value, item))}]"
    if hasattr(item, "isoformat"):
        return item.isoformat()
    return json.dumps(item, ensure_ascii=False) if isinstance(item, (str, bool)) else repr(item)
