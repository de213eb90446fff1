"""Extended models: what `gravcal discover` writes and `--model` reads."""

from __future__ import annotations

import json
import math
import sys
import tomllib
from pathlib import Path

import numpy as np

from gravcal.errors import CatalogError, refuse
from tasks.stage import lazy

effects = lazy("gravcal.effects")


def text_of(path: Path) -> str:
    """Entries of a model file in the form that a stage takes them, the same for the same numbers.

    The TOML file holds a list of [[effect]]: cause, form, parameters.<name> = {value, sigma, unit}; and [result] if it
    says what the search adds to the result of the records that it was made in. An effect of the model of a satellite
    may hold `from` a day on and `to` before another.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:  # tomllib's own errors are ValueErrors
        return _wrong(path, str(error), "a TOML file as gravcal discover writes it")
    entries = content.get("effect")
    if entries is None and "predicted" in content:  # of a satellite whose events share no cause
        return ""
    if not isinstance(entries, list) or not entries:
        _wrong(path, f"the keys {', '.join(content) or 'none'}", "at least one [[effect]]")
    made = [_entry(one, path) for one in entries]
    if "result" in content:
        made[0]["result"] = _result(content["result"], path)
    return json.dumps(made, sort_keys=True, allow_nan=False)


SI = {"um": 1e-6, "mm": 1e-3}


def _result(one, path):
    """Checked table of what a search adds to a result."""
    try:
        shift, added = (np.array(one[name], dtype=float) for name in ("correction", "covariance"))
        good = np.isfinite(added).all() and added.shape == (shift.size, shift.size) and np.isfinite(shift).all()
        words = {name: str(one[name]) for name in ("calibration", "records")}
        size = SI[one["unit"]]
    except (KeyError, TypeError, ValueError) as error:
        return _wrong(path, f"[result] with {error}", "calibration, records, unit, correction and covariance")
    if not good:
        _wrong(path, "[result] whose correction and covariance do not belong together", "p and p x p numbers")
    return words | {"correction": (size * shift).tolist(), "covariance": (size**2 * added).tolist()}


def result_of(text: str, calibration: str, records: str | None) -> str:
    """What a search adds to the result of a calibration, JSON of SI numbers; "" where the model is of other records.

    The records are known by their digest; None, in a plan, are taken for those of the search.
    """
    found = json.loads(text)[0].get("result", {}) if text else {}
    same = found.get("calibration") == calibration and records in (None, found["records"])
    return json.dumps({name: found[name] for name in ("correction", "covariance")}, sort_keys=True) if same else ""


def _entry(one, path):
    """Checked entry with what a stage needs of it."""
    one = one if isinstance(one, dict) else {"effect": one}
    cause, parameters = one.get("cause"), one.get("parameters")
    if not isinstance(cause, str) or not isinstance(parameters, dict):
        _wrong(path, str(one)[:80], "cause = and parameters.<name> = { value = ... }")
    known = None if cause.startswith("unknown:") else [p.name for p in effects.effect(cause).parameters]
    values = {}
    for name, parameter in parameters.items():
        if known is not None and name not in known:
            _wrong(path, f"{cause}.{name}", f"one of {', '.join(known)}")
        value = parameter.get("value") if isinstance(parameter, dict) else None
        if not _is_number(value):
            _wrong(path, f"{cause}.{name} = {parameter!r}", "{ value = number, sigma = number, unit = text }")
        unit = {"unit": parameter["unit"]} if isinstance(parameter.get("unit"), str) else {}
        values[name] = {"value": float(value)} | unit | _error(parameter, f"{cause}.{name}", path)
    lists = {name: one[name] for name in ("waves", "leads") if name in one}
    if not all(isinstance(rows, list) and all(map(_is_row, rows)) for rows in lists.values()):
        _wrong(path, str(lists)[:80], "waves and leads with a start each, and with channel and x, y, z, or lead")
    days = {name: str(one[name]) for name in ("from", "to") if name in one}
    return {"cause": cause, "form": str(one.get("form", "")), "parameters": values} | lists | days


def of_event(text: str, source) -> str:
    """Entries of a model that hold on the day of a source: some of the model of a satellite are of a span of days."""
    kept = json.loads(text) if text else []
    if not any("from" in one or "to" in one for one in kept):
        return text
    day = getattr(source, "date", None) or ""
    kept = [one for one in kept if one.pop("from", "") <= day < one.pop("to", "~")]
    return json.dumps(kept, sort_keys=True, allow_nan=False) if kept else ""


def _error(parameter, name, path):
    """Standard deviation of a parameter and its correlation with the others, where it has them."""
    sigma, row = parameter.get("sigma"), parameter.get("correlation")
    if sigma is None:
        return {}
    if not _is_number(sigma) or not 0 <= sigma < math.inf:
        _wrong(path, f"{name}: sigma = {sigma!r}", "sigma = a number that is not negative, or none")
    if row is None:
        return {"sigma": float(sigma)}
    if not isinstance(row, dict) or not all(_is_number(one) and abs(one) <= 1 for one in row.values()):
        _wrong(path, f"{name}: correlation = {row!r}", "correlation = { name = number from -1 to 1 }, or none")
    return {"sigma": float(sigma), "correlation": {other: float(one) for other, one in row.items()}}


def _is_row(one):
    """Whether it is a wave or a lead of one manoeuvre."""
    if not isinstance(one, dict) or not _is_number(one.get("start")):
        return False
    axes = [one[axis] for axis in "xyz" if axis in one]
    pairs = all(isinstance(pair, list) and len(pair) == 2 and all(map(_is_number, pair)) for pair in axes)
    return pairs and (isinstance(one.get("channel"), str) or _is_number(one.get("lead")))


def _is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def moved(text: str) -> list[str]:
    """Models moved by their error: by one sigma along each principal direction of an effect's parameters."""
    entries, found = json.loads(text), []
    for number, entry in enumerate(entries):
        for move in _directions(entry["parameters"]):
            values = {n: p | {"value": p["value"] + move.get(n, 0.0)} for n, p in entry["parameters"].items()}
            others = [*entries[:number], entry | {"parameters": values}, *entries[number + 1 :]]
            found.append(json.dumps(others, sort_keys=True, allow_nan=False))
    return found


def _directions(parameters):
    """Moves {name: size} whose squares add up to the covariance of an effect's parameters."""
    names = [name for name, parameter in parameters.items() if parameter.get("sigma")]
    if not names:
        return []
    sigma = np.array([parameters[name]["sigma"] for name in names])
    row = lambda n: parameters[n].get("correlation", {})  # noqa: E731
    related = np.array([[1.0 if n == m else row(n).get(m, row(m).get(n, 0.0)) for m in names] for n in names])
    size, vectors = np.linalg.eigh(related)
    columns = sigma[:, None] * vectors * np.sqrt(np.clip(size, 0.0, None))
    return [dict(zip(names, column.tolist(), strict=True)) for column in columns.T if column.any()]


def _wrong(path, found, expected):
    refuse(path, found, expected, "Write it with gravcal discover.", CatalogError)
