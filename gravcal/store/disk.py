"""The disk below the store: folders, files written down to the disk, what dead processes left, and clear errors."""

import errno
import os
import platform
import shutil
import uuid
from concurrent.futures import ThreadPoolExecutor

from gravcal.errors import ProductError
from gravcal.store import location

NAMES = ("objects", "latest", "tmp", "locks", "quarantine")
REMEDIES = {
    errno.ENOSPC: "Free space there (gravcal products prune)",
    errno.EDQUOT: "Free space there (gravcal products prune)",
    errno.EXDEV: "Keep its folders objects, tmp and quarantine on one file system",
    errno.ENOTDIR: "Move the file away that stands where a folder should be",
    errno.EEXIST: "Move the file away that stands where a folder should be",
}
_swept = set()


def prepare():
    """Create the folders of the store and, once per process, remove what dead processes left half-written."""
    root = location.folder()
    if root in _swept and all((root / name).is_dir() for name in NAMES):
        return
    for name in NAMES:
        (root / name).mkdir(parents=True, exist_ok=True)
    for path in (root / "tmp").iterdir():
        if _is_left(path):
            shutil.rmtree(path, ignore_errors=True)
    _swept.add(root)


def new_aside():
    """Path for a folder that is being made or removed; swept when this process dies before it is done."""
    return location.folder() / "tmp" / f"{platform.node()}-{os.getpid()}-{uuid.uuid4().hex[:12]}"


def flush(folder):
    """Bring the files of a folder and their names down to the disk; side by side, for a disk takes all at once.

    The name under which the folder is published need not follow: should it be lost, the product is made again.
    """
    paths = [*folder.iterdir(), folder]
    with ThreadPoolExecutor(len(paths)) as threads:
        rest = threads.map(_flush, paths[1:])
        _flush(paths[0])  # starting a thread takes as long as this
        list(rest)


def _flush(path):
    """Bring one file or folder down to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def unwritable(error, what):
    """ProductError for a store that cannot take a product."""
    root = location.folder()
    remedy = REMEDIES.get(error.errno, "Give yourself the right to write there")
    return ProductError(
        f"product store {root}: {what} cannot be written ({error.strerror or error}). What was there before is "
        f"unharmed. {remedy}, or name another folder in GRAVCAL_PRODUCTS.",
        root=str(root),
        errno=error.errno,
    )


def _is_left(path):
    """Whether a dead process of this machine left this half-written; anything else is not ours to remove."""
    host, _, rest = path.name.rpartition("-")[0].rpartition("-")
    return host == platform.node() and rest.isdecimal() and not _is_alive(int(rest))


def _is_alive(pid):
    """Whether a process of this machine exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's
        return True
    return True
