"""What lies in the store: list it, find one, verify all, remove what nothing refers to."""

import contextlib
import hashlib
import re
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

from gravcal.data import disk, location, store
from gravcal.errors import ProductError

KEY = re.compile(r"[0-9a-f]{64}")
YOUNG_S = 3600.0  # a product younger than this may belong to a run that has not yet linked it


@dataclass(frozen=True)
class Entry:
    """One product of the store with its record; ``newest`` says whether a readable link leads to it."""

    ref: object
    record: dict
    newest: bool


def entries(event=None, kind=None, newest_only=True):
    """Products of the store, sorted by name.

    Parameters
    ----------
    event, kind : str or None, only these
    newest_only : bool, only those that a readable link leads to

    Returns
    -------
    entries : list of Entry
    """
    newest = linked_keys()
    found = []
    for folder in folders():
        if newest_only and folder.name not in newest:
            continue
        record = store.read_record(folder)
        if record is None:
            continue
        ref = store.reference(record, folder)
        if event in (None, ref.event) and kind in (None, ref.kind, ref.stage):
            found.append(Entry(ref, record, folder.name in newest))
    return sorted(found, key=lambda entry: (entry.ref.event, entry.record.get("made", ""), entry.ref.stage))


def folders():
    """Folders of all products, whole or not."""
    return sorted(path for path in (location.folder() / "objects").glob("*/*") if KEY.fullmatch(path.name))


def linked_keys():
    """Keys that the readable links lead to."""
    return {link.readlink().name for link in (location.folder() / "latest").glob("*/*") if link.is_symlink()}


def resolve(text):
    """Product by key, beginning of a key or of its content's digest (as reports print it), ``event/stage``, or path.

    Of products with the same content the one that a readable link leads to is meant.

    Returns
    -------
    entry : Entry

    Raises
    ------
    ProductError : none, or more than one
    """
    everything = entries(newest_only=False)
    path = Path(text).resolve()  # of the folder, of a readable link to it, or of a file in it
    objects = (location.folder() / "objects").resolve()
    named = {one.name for one in (path, path.parent) if one.parent.parent == objects}
    found = [entry for entry in everything if entry.ref.folder.name in named]
    found = found or [entry for entry in everything if entry.newest and entry.ref.name == text]
    if not found and re.fullmatch(r"[0-9a-f]{4,64}", text):
        found = [entry for entry in everything if entry.ref.key.startswith(text)]
        equal = [entry for entry in everything if entry.ref.digest.startswith(text)]
        found = found or [entry for entry in equal if entry.newest] or equal
    if len(found) == 1:
        return found[0]
    raise ProductError(
        f"product {text!r} in {location.folder()}: found {len(found)}, expected one. "
        f"Give EVENT/STAGE, more digits of the key, or a path, as gravcal products list shows them.",
        found=len(found),
    )


def content(entry):
    """Content of a product, verified."""
    dataset = store.load(entry.ref)
    if dataset is None:
        raise ProductError(f"{entry.ref.name} ({entry.ref.path}): damaged, and set aside. Run its event again.")
    return dataset


def verify():
    """Compare every product with its record, its bytes and its content; nothing is moved.

    Returns
    -------
    problems : list of (folder, str), empty when all is well
    """
    return [(folder, problem) for folder in folders() for problem in _problems(folder)]


def prune(keep_s=YOUNG_S, remove=False):
    """What nothing refers to: products no link leads to, directly or as input, and what was set aside or left behind.

    Parameters
    ----------
    keep_s : float, s, younger ones stay
    remove : bool, otherwise they are only named

    Returns
    -------
    unused : list of (Path, int), folder and bytes
    """
    needed, waiting = set(), list(linked_keys())
    while waiting:
        key = waiting.pop()
        record = store.read_record(store.folder_of(key)) if key not in needed else None
        needed.add(key)
        waiting += [part["key"] for part in (record or {}).get("from", []) if part.get("key")]
    unused = [folder for folder in folders() if folder.name not in needed]
    unused += sorted((location.folder() / "quarantine").glob("*")) + _unlocked()
    sized = [(path, _size(path)) for path in unused if _age_s(path) > keep_s]
    for path, _ in sized if remove else []:
        _remove(path)
    return sized


def _problems(folder):
    """What is wrong with one product."""
    from gravcal.data import netcdf_reading, product

    record = store.read_record(folder)
    if record is None or record["key"] != folder.name:
        return ["no record of this key"]
    try:
        image = (folder / "product.nc").read_bytes()
    except OSError as error:
        return [f"product.nc cannot be read ({error})"]
    if hashlib.sha256(image).hexdigest() != record["sha256"]:
        return ["bytes of product.nc differ from the record"]
    if product.digest(netcdf_reading.from_bytes(image)) != record["digest"]:
        return ["content differs from its digest"]
    return [name for name, digest in record.get("files", {}).items() if not _has_digest(folder / name, digest)]


def _has_digest(path, digest):
    """Whether a file is there with these bytes."""
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest


def _unlocked():
    """Lock files that were left when a process was killed."""
    return sorted((location.folder() / "locks").glob("*"))


def _age_s(path):
    """Seconds since a change; what went meanwhile is as young as can be, and what is from the future too."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return -1.0


def _size(path):
    """Bytes below a folder, or of a file; what went meanwhile has none."""
    total = 0
    for one in path.rglob("*") if path.is_dir() else [path]:
        with contextlib.suppress(OSError):
            total += one.stat().st_size if one.is_file() else 0
    return total


def _remove(path):
    """Remove a product so that it is gone at once: renamed first, then emptied."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    aside = disk.new_aside()
    try:
        disk.prepare()
        path.rename(aside)
    except FileNotFoundError:
        return
    except OSError as error:
        raise disk.unwritable(error, path.name[:12]) from error
    shutil.rmtree(aside, ignore_errors=True)
