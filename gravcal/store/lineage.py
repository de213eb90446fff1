"""Where a product comes from: its inputs, theirs, down to the raw files; and making it again from there."""

import importlib
import os
from pathlib import Path

from gravcal.errors import ProductError
from gravcal.store import location, store

AUXILIARY = ("GFC", "TRUTH")  # files that are read beside the Level-1 files of an event


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


def seconds(entry):
    """Time that a product and all it was made of took when they were made.

    Parameters
    ----------
    entry : housekeeping.Entry

    Returns
    -------
    seconds : float, s
    """
    waiting, taken = [tree(entry)], {}
    while waiting:
        node = waiting.pop()
        key = node["record"] and node["record"]["key"]
        if key and key not in taken:
            taken[key] = node["record"]["seconds"]
            waiting += node["inputs"]
    return sum(taken.values())


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
    """Where the files were from which the events of the store were made.

    Parameters
    ----------
    calibration : str

    Returns
    -------
    sources : list of (event, Path, satellite, date); date is None for an event of several days
    """
    made, latest = {}, location.folder() / "latest"
    for link, folder in (*store.links(f"*/{calibration}.*"), *store.links(f"*/as/*/{calibration}.*")):
        made.setdefault(link.relative_to(latest).parts[0], []).append((link.name, folder.name))
    found = [(event, _event_files(keys)) for event, keys in made.items()]
    return [(event, *_whereabouts(files)) for event, files in found if files]


def _event_files(made):
    """Level-1 files of an event by stages and keys: those below its reports, or below all it has."""
    reports = [key for stage, key in made if stage.endswith(".report")]
    files = [file for key in reports or [key for _, key in made] for file in raw_files(key)]
    return [file for file in files if file["product"] not in AUXILIARY]


def _whereabouts(files):
    """Folder, satellite and date of the Level-1 files of an event."""
    folder = Path(os.path.commonpath([Path(file["path"]).parent for file in files]))
    dates = sorted({file["date"] for file in files})
    letters = sorted({file["satellite"] for file in files} - set("XY")) or [files[0]["satellite"]]
    return folder, letters[0], dates[0] if len(dates) == 1 else None


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
