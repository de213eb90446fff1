"""Result documents: their JSON Schema files, and the rules a schema cannot say."""

import functools
import json
import math
from importlib import resources

import jsonschema_rs

from gravcal.errors import refuse

VERSION = "1.0"
TRIPLES = (
    ("offset_um", "sigma_um", "covariance_um2"),
    ("phase_centre_mm", "sigma_mm", "covariance_mm2"),
    ("value", "sigma", "covariance"),
)
_added = {}  # name: path of the schema of a calibration of another package


def names():
    """Names of all documents that have a schema."""
    shipped = (path.name.removesuffix(".schema.json") for path in resources.files(__name__).iterdir())
    return sorted({name for name in shipped if "." not in name and not name.startswith("_")} - {"common"} | set(_added))


def add(name, path):
    """Make the schema of a calibration of another package known."""
    _added[name] = path


def schema(name):
    """JSON Schema (2020-12) of a result document, or of what all share ("common")."""
    path = _added.get(name) or resources.files(__name__) / f"{name}.schema.json"
    return json.loads(path.read_text(encoding="utf-8"))


def validate(document, name=None):
    """Check a document against the schema of its calibration, or a named one, and its undetermined components."""
    kinds = {"discovery": "adequate_before", "joint": "predicted"}
    name = name or next((kind for kind, part in kinds.items() if part in document), document.get("calibration"))
    if name not in names():
        _refuse("calibration", name, f"one of {', '.join(names())}")
    parts = list(_walk(document, ()))
    for path, item in parts:
        if isinstance(item, float) and not math.isfinite(item):
            _refuse(_text(path), item, "a finite number, or null for what is not determined")
    if not validator(name).is_valid(document):
        error = min(validator(name).iter_errors(document), key=lambda e: list(map(str, e.instance_path)))
        _refuse(_text(error.instance_path), error.instance, f"what the schema says: {error.message[:200]}")
    for path, block in parts:
        for value, sigma, covariance in TRIPLES if isinstance(block, dict) else ():
            if isinstance(block.get(value), list) and isinstance(block.get(sigma), list):
                missing = [item is None for item in block[value]]
                if missing != [item is None for item in block[sigma]]:
                    _refuse(_text((*path, sigma)), block[sigma], f"null exactly where {value} is null")
                if covariance in block:
                    _check_covariance(block[covariance], block[sigma], missing, (*path, covariance))


@functools.cache
def validator(name):
    """Compiled validator of a document; definitions that all share are those of "common"."""
    return jsonschema_rs.Draft202012Validator(schema(name), retriever=lambda _: schema("common"))


def _walk(item, path):
    yield path, item
    parts = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, (list, tuple)) else ()
    for key, part in parts:
        yield from _walk(part, (*path, key))


def _check_covariance(matrix, sigma, missing, path):
    """Rows and columns of undetermined components are null; the rest is symmetric with sigma^2 on the diagonal."""
    for i, row in enumerate(matrix):
        for j, (item, other) in enumerate(zip(row, (one[i] for one in matrix), strict=True)):
            where = _text((*path, i, j))
            if (item is None) != (missing[i] or missing[j]):
                _refuse(where, item, "null exactly in the rows and columns of undetermined components")
            if item is not None and (other is None or not math.isclose(item, other, rel_tol=1e-9, abs_tol=1e-300)):
                _refuse(where, item, f"a symmetric matrix, {other!r}")
        if not missing[i] and not math.isclose(row[i], sigma[i] ** 2, rel_tol=1e-6):
            _refuse(_text((*path, i, i)), row[i], f"the square of sigma, {sigma[i] ** 2!r}")


def _text(path):
    """Path in a document as text: variants.mtq.sigma_um[0]."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).lstrip(".") or "document"


def _refuse(where, value, expected):
    shown = repr(value) if len(repr(value)) < 80 else f"{repr(value)[:77]}..."
    refuse(f"result document: {where}", shown, expected, "Correct what writes the document.")
