"""What a stage is given: products and Level-1 files, how they are named, labelled and traced."""

import fnmatch

from gravcal.errors import CatalogError, ProductError
from gravcal.store import memory
from gravcal.store.records import ProductRef

FILE = "file"
MISSIONS = {
    "A": "grace",
    "B": "grace",
    "X": "grace",
    "C": "grace",
    "D": "grace",
    "Y": "grace",
    "T": "taiji",
    "S": "demo",
}


def is_file(item):
    """Whether an input is a Level-1 file: it has a path, a product and a satellite."""
    return not isinstance(item, ProductRef) and all(hasattr(item, name) for name in ("path", "product", "satellite"))


def check(stage, inputs, kinds):
    """Raise unless products and Level-1 files are of the kinds a stage reads; the last kind holds for all that follow.

    Kinds: "a|b" for either, "*.solve" for any calibration's, "file" for a Level-1 file.
    """
    for number, item in enumerate(inputs):
        wanted = kinds[min(number, len(kinds) - 1)] if kinds else "no input"
        if not (is_file(item) or isinstance(item, ProductRef)):
            raise TypeError(
                f"{stage}: input {number + 1} is a {type(item).__name__}, expected a product or Level-1 file"
            )
        found = FILE if is_file(item) else item.kind
        if not any(fnmatch.fnmatchcase(found, one) for one in wanted.split("|")):
            raise ProductError(
                f"{stage}: input {number + 1} is {found}, expected {wanted}. Pass the product of that stage."
            )


def event(stage, inputs):
    """Event of the inputs; of a Level-1 file mission, satellite and date."""
    events = sorted({_file_event(item) if is_file(item) else item.event for item in inputs})
    if len(events) != 1:
        raise CatalogError(
            f"{stage}: inputs belong to the events {', '.join(events) or 'none'}, expected one. Give event=..."
        )
    return events[0]


def variant(inputs):
    """Variant of a stage that reads one file: product and satellite; otherwise none."""
    return f"{inputs[0].product}_{inputs[0].satellite}" if len(inputs) == 1 and is_file(inputs[0]) else ""


def labelled(item):
    """Part of the recipe for one input: its name and the digest of its content; None is not known yet."""
    if not is_file(item):
        return {"event": item.event, "kind": item.kind, "variant": item.variant, "digest": item.digest}
    return {
        "file": item.name,
        "product": item.product,
        "satellite": item.satellite,
        "date": str(item.date),
        "release": str(item.release),
        "digest": _file_digest(item),
    }


def traced(item):
    """Where one input was found, for the record: key of the product, or path of the file."""
    if is_file(item):
        return {"path": str(item.path.absolute()), "member": item.member}
    return {"key": item.key}


def check_unchanged(items, labels):
    """Raise if a Level-1 file is no longer the one that its label describes: it changed while it was read."""
    for item, label in zip(items, labels, strict=True):
        if is_file(item) and _file_digest(item) != label["digest"]:
            raise ProductError(
                f"{item.path}: changed while it was read, expected a file that stays as it is. Run again.",
                path=str(item.path),
            )


def _file_event(item):
    """Event of a file that belongs to none in the catalogue."""
    return f"{MISSIONS.get(item.satellite, 'unknown')}-{item.satellite.lower()}-{item.date}"


def _file_digest(item):
    """SHA-256 of a Level-1 file."""
    try:
        return memory.file_digest(item.path, item.member)
    except (OSError, KeyError, EOFError) as error:
        where = f"{item.path}:{item.member}" if item.member else str(item.path)
        raise ProductError(f"{where}: cannot be read ({error}). Fetch the file again.", path=where) from error
