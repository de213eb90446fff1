"""Where a product comes from: its inputs, theirs, down to the raw files; and making it again from there."""

import importlib
from pathlib import Path

from gravcal.data import housekeeping, store
from gravcal.errors import ProductError


def tree(entry):
    """A product with all it was made of.

    Parameters
    ----------
    entry : housekeeping.Entry

    Returns
    -------
    node : dict, "name", "record" (None for a raw file or a product that is gone), "inputs": list of the same
    """
    return _node(entry.ref.key, {})


def raw_files(key, known=None):
    """Raw files below a product.

    Returns
    -------
    files : list of dict: path, member, product, satellite, date, digest; each once
    """
    known = {} if known is None else known
    record = store.read_record(store.folder_of(key))
    if record is None or key in known:
        return []
    known[key] = True
    found = []
    for part, label in zip(record["from"], record["recipe"]["inputs"], strict=True):
        found += [part | label] if "path" in part else raw_files(part["key"], known)
    return list({(one["path"], one["member"]): one for one in found}.values())


def level_one_folders(calibration):
    """Folders, satellites and dates from which the events of the store were made.

    Returns
    -------
    sources : list of (Path, str, str)
    """
    sources = {}
    for entry in housekeeping.entries():
        if not entry.ref.kind.startswith(f"{calibration}."):
            continue
        for file in raw_files(entry.ref.key):
            path = Path(file["path"])
            if len(file["satellite"]) == 1 and file["satellite"] not in "XY":
                sources[entry.ref.event, path.parent, file["date"]] = file["satellite"]
    return [(folder, satellite, date) for (_, folder, date), satellite in sources.items()]


def stage_of(record):
    """The stage that made a product, as it is now."""
    module, _, name = record["stage"].partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ProductError(
            f"{record['recipe']['kind']}: its stage {record['stage']} is not part of this version of gravcal "
            f"({error}). "
            f"Install gravcal {record['versions']['gravcal']} to make it again.",
            stage=record["stage"],
        ) from error


def _node(key, known):
    """Node of one product; one that was met before is not opened again."""
    record = store.read_record(store.folder_of(key))
    if record is None:
        return {"name": key[:12], "record": None, "inputs": [], "gone": True}
    if key not in known:
        known[key] = {"name": store.reference(record, store.folder_of(key)).name, "record": record, "inputs": []}
        for part, label in zip(record["from"], record["recipe"]["inputs"], strict=True):
            known[key]["inputs"].append(_file_node(part, label) if "path" in part else _node(part["key"], known))
    return known[key]


def _file_node(part, label):
    """Node of a raw file."""
    where = f"{part['path']}:{part['member']}" if part["member"] else part["path"]
    return {"name": where, "record": None, "inputs": [], "digest": label["digest"]}
