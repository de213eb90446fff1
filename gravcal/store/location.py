"""Where the store is, its readable links for the configuration that is running, and how it is written.

The store is ``GRAVCAL_PRODUCTS``, or ``gravcal/products`` below the user's cache folder.
"""

import contextlib
import contextvars
import errno
import json
import os
import uuid
from pathlib import Path

from gravcal.errors import ProductError

OPERATIONAL = "operational"
NAMES = ("objects", "latest", "tmp", "locks", "quarantine")
FULL, TAKEN = "Free space there (gravcal products prune)", "Move the file away that stands where a folder should be"
REMEDIES = {errno.ENOSPC: FULL, errno.EDQUOT: FULL, errno.ENOTDIR: TAKEN, errno.EEXIST: TAKEN} | {
    errno.EXDEV: "Keep its folders objects, tmp and quarantine on one file system"
}
_running = contextvars.ContextVar("gravcal_configuration", default=OPERATIONAL)


def folder():
    """Root of the store, an absolute path; nothing is created."""
    named = os.environ.get("GRAVCAL_PRODUCTS")
    if named:
        return Path(named).expanduser().absolute()
    cache = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache) if cache else Path.home() / ".cache") / "gravcal" / "products"


def configuration():
    """Name of the configuration that is running: "operational", or that of an experiment."""
    return _running.get()


@contextlib.contextmanager
def configured(name):
    """Context in which readable links are those of a configuration (name)."""
    before = _running.set(name)
    try:
        yield
    finally:
        _running.reset(before)


def links(event, name=None):
    """Folder of the readable links of an event: ``latest/<event>``, of an experiment ``latest/<event>/as/<NAME>``."""
    latest = folder() / "latest" / event
    name = name or configuration()
    return latest if name == OPERATIONAL else latest / "as" / name


def prepare():
    """Create the folders of the store where they are missing."""
    for name in NAMES:
        (folder() / name).mkdir(parents=True, exist_ok=True)


def new_aside():
    """New path below tmp/ for a folder being made or removed; `prune` removes what a killed process left there."""
    return folder() / "tmp" / uuid.uuid4().hex


def write_json(path, value, indent=None):
    """Write a JSON value in one step, so that a reader finds the old file or the new one."""
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    path.parent.mkdir(parents=True, exist_ok=True)
    aside.write_text(json.dumps(value, indent=indent) + "\n")
    aside.replace(path)


def read_json(path):
    """JSON value of a file, None where there is none that can be read."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None


def recall(name):
    """JSON value that `remember` kept under a name, None if there is none."""
    return read_json(folder() / "memo" / f"{name}.json")


def remember(name, value):
    """Keep a JSON value for later processes; losing it costs time, never correctness."""
    with contextlib.suppress(OSError):
        write_json(folder() / "memo" / f"{name}.json", value)


def unwritable(error, what):
    """ProductError (to raise) for an OSError on writing ``what`` to the store, with a remedy by its errno."""
    root = folder()
    remedy = REMEDIES.get(error.errno, "Give yourself the right to write there")
    return ProductError(
        f"product store {root}: {what} cannot be written ({error.strerror or error}). What was there before is "
        f"unharmed. {remedy}, or name another folder in GRAVCAL_PRODUCTS.",
        root=str(root),
        errno=error.errno,
    )
