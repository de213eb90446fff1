"""The record beside a product, meta.json: written with a checksum of its own, believed only where it is whole.

A record counts when its bytes are those that were written, every part has its type, its key is that of its recipe and
the name of its folder, and nothing of the folder is a link. Whether the product file fits it, `store` says.
"""

import functools
import hashlib
import json
import re

from gravcal.store import keys

KEY = re.compile(r"[0-9a-f]{64}")
SEAL = b', "sha256_of_record": "'
NAME = re.compile(r"(?!\.{1,2}$)[^/\x00]+")
NUMBER = (int, float)
RECIPE = {"event": NAME, "kind": NAME, "variant": str, "version": int, "settings": dict, "inputs": [dict], "code": str}
FORM = {
    "key": KEY,
    "recipe": RECIPE,
    "digest": KEY,
    "sha256": KEY,
    "bytes": int,
    "mtime_ns": int,
    "labels_at": [int],
    "files": {NAME: KEY},
    "made": str,
    "machine": str,
    "stage": str,
    "seconds": NUMBER,
    "modules": {str: str},
    "versions": {str: str},
    "from": [dict],
}


def sealed(record):
    """Text of a record with its checksum.

    Parameters
    ----------
    record : dict of plain values

    Returns
    -------
    text : bytes
    """
    text = json.dumps(record, allow_nan=False).encode()
    return text[:-1] + SEAL + hashlib.sha256(text).hexdigest().encode() + b'"}'


def read(folder):
    """Record of a product folder.

    Parameters
    ----------
    folder : Path, of the store; its name is the key

    Returns
    -------
    record : dict, shared and not to be changed, or None
    reason : why there is none that can be believed, or None
    """
    parts = (folder.parent, folder, folder / "meta.json", folder / "product.nc")
    link = next((path for path in parts if path.is_symlink()), None)
    if link:
        return None, f"{link.name} is a link, which is not followed"
    try:
        image = (folder / "meta.json").read_bytes()
    except OSError:
        return None, "no readable record"
    return _believed(image, folder.name)


@functools.lru_cache(maxsize=64)  # found, then asked how it was made
def _believed(image, key):
    """Record of the bytes of a file and None, or None and why not."""
    head, seal, tail = image.rpartition(SEAL)
    if not seal:
        return None, "the record has no checksum: written by an earlier gravcal, or by others"
    if tail != hashlib.sha256(head + b"}").hexdigest().encode() + b'"}':
        return None, "the record is not as it was written (its checksum differs)"
    try:
        record = json.loads(head + b"}")
        reason = _wrong(record, key)
    except (ValueError, RecursionError) as error:
        return None, f"the record cannot be read ({type(error).__name__})"
    return (None, reason) if reason else (record, None)


def _wrong(record, key):
    """What is wrong with a record, or None."""
    where = _misfit(record, FORM, "record")
    if where:
        return where
    recipe, origins = record["recipe"], record["from"]
    if len(recipe["inputs"]) != len(origins):
        return f"the record names {len(recipe['inputs'])} inputs and where {len(origins)} of them were"
    for label, origin in zip(recipe["inputs"], origins, strict=True):
        is_file = "file" in label
        parts = {"file": str, "digest": KEY} if is_file else {"kind": NAME, "variant": str, "digest": KEY}
        places = {"path": str, "member": (str, type(None))} if is_file else {"key": KEY}
        where = _misfit(label, parts, "recipe.inputs") or _misfit(origin, places, "from")
        if where:
            return where
    if keys.key(recipe) != record["key"]:
        return "the key in the record is not that of its recipe (settings, inputs, code, event)"
    if record["key"] != key:
        return f"the record names another key, {record['key']}"
    return None


def _misfit(value, form, where):
    """Where a value is not of its form: a type or several, a pattern, a list or mapping of such, or parts."""
    if not isinstance(form, (list, dict)):
        expected = f"text like {form.pattern}" if isinstance(form, re.Pattern) else form
        return None if _fits(value, form) else f"{where} in the record is {_short(value)}, expected {expected}"
    if not isinstance(value, type(form)):
        return f"{where} in the record is {_short(value)}, expected a {type(form).__name__}"
    if isinstance(form, list):
        wrong = [number for number, item in enumerate(value) if not _fits(item, form[0])]
        return _misfit(value[wrong[0]], form[0], f"{where}[{wrong[0]}]") if wrong else None
    if all(isinstance(name, str) for name in form):
        missing = [name for name in form if name not in value]
        if missing:
            return f"{where} has no {', '.join(missing)}"
        return next(
            (said for name, own in form.items() if (said := _misfit(value[name], own, f"{where}.{name}"))), None
        )
    ((names, items),) = form.items()
    if names is items is str and {*map(type, value), *map(type, value.values())} <= {str}:
        return None
    wrong = [name for name, item in value.items() if not (_fits(name, names) and _fits(item, items))]
    return f"{where} in the record has {_short(wrong[0])}: {_short(value[wrong[0]])}" if wrong else None


def _fits(value, form):
    """Whether a value is of a type or like a pattern."""
    if isinstance(form, re.Pattern):
        return isinstance(value, str) and form.fullmatch(value) is not None
    return type(value) in form if isinstance(form, tuple) else type(value) is form


def _short(value):
    """A value on one line."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
