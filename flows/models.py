"""Extended models: what `gravcal discover` writes and `--model` reads."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

from gravcal.errors import CatalogError


def text_of(path: Path) -> str:
    """Entries of a model file in the form that a stage takes them, the same for the same numbers.

    Parameters
    ----------
    path : TOML file with a list of [[effect]]: cause, form, parameters.<name> = {value, sigma, unit}
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise _wrong(path, str(error), "a TOML file as gravcal discover writes it") from error
    entries = content.get("effect")
    if not isinstance(entries, list) or not entries:
        raise _wrong(path, f"the keys {', '.join(content) or 'none'}", "at least one [[effect]]")
    return json.dumps([_entry(one, path) for one in entries], sort_keys=True, allow_nan=False)


def _entry(one, path):
    """Checked entry with what a stage needs of it."""
    cause = one.get("cause")
    parameters = one.get("parameters")
    if not isinstance(cause, str) or not isinstance(parameters, dict):
        raise _wrong(path, str(one)[:80], "cause = and parameters.<name> = { value = ... }")
    known = None if cause.startswith("unknown:") else _names(cause)
    values = {}
    for name, parameter in parameters.items():
        if known is not None and name not in known:
            raise _wrong(path, f"{cause}.{name}", f"one of {', '.join(known)}")
        value = parameter.get("value") if isinstance(parameter, dict) else None
        if not isinstance(value, (int, float)) or isinstance(value, bool) or value != value:
            raise _wrong(path, f"{cause}.{name} = {parameter!r}", "{ value = number, sigma = number, unit = text }")
        values[name] = {"value": float(value)}
    return {"cause": cause, "form": str(one.get("form", "")), "parameters": values}


def _names(cause):
    """Parameter names of an effect; an unknown effect names its neighbours."""
    from gravcal.effects import effect

    return [p.name for p in effect(cause).parameters]


def _wrong(path, found, expected):
    return CatalogError(f"{path}: found {found}, expected {expected}. Write it with gravcal discover.", file=str(path))
