"""Extended models: what `gravcal discover` writes and `--model` reads."""

import json
from pathlib import Path

import numpy as np

from gravcal import catalog
from gravcal.errors import CatalogError, refuse
from tasks.stage import lazy

effects = lazy("gravcal.effects")


def text_of(path: Path) -> str:
    """Entries of a model file in the form that a stage takes them, the same for the same numbers.

    The TOML file holds a list of [[effect]]: cause, form, parameters.<name> = {value, sigma, unit}; and [result] if it
    says what the search adds to the result of the records that it was made in. An effect of the model of a satellite
    may hold `from` a day on and `to` before another.
    """
    content = catalog.read_file(Path(path), "model")[1]
    if "effect" not in content:  # of a satellite whose events share no cause
        return ""
    made = [_entry(one, path) for one in content["effect"]]
    if "result" in content:
        made[0]["result"] = _result(content["result"], path)
    return json.dumps(made, sort_keys=True, allow_nan=False)


SI = {"um": 1e-6, "mm": 1e-3}


def _result(one, path):
    """Table of what a search adds to a result, in SI."""
    try:
        shift, added = (np.array(one[name], dtype=float) for name in ("correction", "covariance"))
    except ValueError:
        shift, added = np.zeros(0), np.zeros(1)
    if added.shape != (shift.size, shift.size):
        _wrong(path, "[result] whose correction and covariance do not belong together", "p and p x p numbers")
    size = SI[one["unit"]]
    words = {name: one[name] for name in ("calibration", "records")}
    return words | {"correction": (size * shift).tolist(), "covariance": (size**2 * added).tolist()}


def result_of(text: str, calibration: str, records: str | None) -> str:
    """What a search adds to the result of a calibration, JSON of SI numbers; "" where the model is of other records.

    The records are known by their digest; None, in a plan, are taken for those of the search.
    """
    found = json.loads(text)[0].get("result", {}) if text else {}
    same = found.get("calibration") == calibration and records in (None, found["records"])
    return json.dumps({name: found[name] for name in ("correction", "covariance")}, sort_keys=True) if same else ""


def _entry(one, path):
    """Entry with what a stage needs of it."""
    cause, values = one["cause"], {}
    known = None if cause.startswith("unknown:") else [p.name for p in effects.effect(cause).parameters]
    for name, parameter in one["parameters"].items():
        if known is not None and name not in known:
            _wrong(path, f"{cause}.{name}", f"one of {', '.join(known)}")
        values[name] = {n: float(parameter[n]) for n in ("value", "sigma") if n in parameter}
        values[name] |= {"unit": parameter["unit"]} if "unit" in parameter else {}
        if "sigma" in parameter and "correlation" in parameter:
            values[name]["correlation"] = {other: float(r) for other, r in parameter["correlation"].items()}
    lists = {name: one[name] for name in ("waves", "leads") if name in one}
    days = {name: str(one[name]) for name in ("from", "to") if name in one}
    return {"cause": cause, "form": one.get("form", ""), "parameters": values} | lists | days


def of_event(text: str, source) -> str:
    """Entries of a model that hold on the day of a source: some of the model of a satellite are of a span of days."""
    kept = json.loads(text) if text else []
    if not any("from" in one or "to" in one for one in kept):
        return text
    day = getattr(source, "date", None) or ""
    kept = [one for one in kept if one.pop("from", "") <= day < one.pop("to", "~")]
    return json.dumps(kept, sort_keys=True, allow_nan=False) if kept else ""


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
