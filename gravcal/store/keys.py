"""Keys: the canonical text of everything a product depends on, and its SHA-256."""

import dataclasses
import hashlib
import json
import math

from gravcal.errors import CatalogError


def key(recipe):
    """SHA-256 of a recipe: event, kind, variant, version, settings, digests of the inputs, fingerprint of the code.

    Parameters
    ----------
    recipe : dict of plain values, as ``canonical`` returns them

    Returns
    -------
    key : str, 64 hexadecimal digits
    """
    return hashlib.sha256(text(recipe).encode()).hexdigest()


def text(plain):
    """JSON with sorted names and no blanks: one text for one meaning."""
    return json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def canonical(value, where):
    """Plain value of a setting: None, bool, int, float, str, or lists and mappings of them.

    Parameters
    ----------
    value : any of these, a tuple, a NumPy number or array, or a frozen dataclass
    where : str, for the message, such as "com_offset.solve, setting lowpass_hz"

    Returns
    -------
    plain : the same meaning, always in the same form; -0.0 becomes 0.0

    Raises
    ------
    CatalogError : NaN, infinity, or a type with no such form
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(name): canonical(item, f"{where}.{name}") for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [canonical(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if hasattr(value, "tolist"):
        return canonical(value.tolist(), where)
    if hasattr(value, "isoformat"):
        return value.isoformat()
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float) and math.isfinite(value):
        return float(value) + 0.0
    raise CatalogError(
        f"{where}: found {value!r} ({type(value).__name__}), expected a finite number, text, or lists and mappings "
        f"of them. "
        f"Files enter a stage as inputs, not as settings.",
        where=where,
    )


def typed(value, annotation, where):
    """Setting in the type its stage states: an int where a float is expected becomes one, so 1 and 1.0 share a key.

    Parameters
    ----------
    value : plain value
    annotation : str or type; only float, int, str and bool are enforced
    where : str

    Returns
    -------
    value : plain value
    """
    name = getattr(annotation, "__name__", annotation)
    if name == "float" and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    expected = {"float": float, "int": int, "str": str, "bool": bool}.get(name)
    if expected is not None and type(value) is not expected:
        raise CatalogError(f"{where}: found {value!r} ({type(value).__name__}), expected {name}.", where=where)
    return value
