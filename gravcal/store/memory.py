"""What is remembered: small values between processes, below the store, and contents that this process read or made.

Losing any of it costs time, never correctness.
"""

import contextlib
import hashlib
import os
import threading
import time
from collections import OrderedDict

from gravcal.io import archive
from gravcal.store import location

SETTLED_NS = 100_000_000  # ten ticks of the coarsest clock of Linux
LIMIT = 256e6  # bytes of contents, the least recently used go first
verified = {}  # folder of a product -> size and time of change of its file when its bytes were verified
_held = OrderedDict()  # path -> (size and time of change of the file), content
_lock = threading.Lock()


def recall(name):
    """What was remembered under a name, or None."""
    return location.read_json(location.folder() / "memo" / f"{name}.json")


def remember(name, value):
    """Keep a JSON value under a name; a store that cannot be written forgets it."""
    with contextlib.suppress(OSError):
        location.write_json(location.folder() / "memo" / f"{name}.json", value)


def file_digest(path, member=None):
    """SHA-256 of a file, or of one member of a tar archive, remembered by path, size and times of change.

    The time at which the file system noted a change cannot be set back as that of the content can. A file that changed
    a moment ago may change again within one tick of that clock: it is not remembered yet.
    """
    status = path.stat()
    place = os.path.abspath(path)  # noqa: PTH100 - resolve() would follow links
    seen = [place, status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
    name = "file-" + hashlib.sha256(place.encode()).hexdigest()[:32]
    known = recall(name)
    is_known = isinstance(known, dict) and known.get("seen") == seen and isinstance(known.get("digests"), dict)
    digests = known["digests"] if is_known else {}
    if (member or "") not in digests:
        if member:
            digests |= _archive_digests(path)
        else:
            with path.open("rb") as stream:
                digests[""] = hashlib.file_digest(stream, "sha256").hexdigest()
        if time.time_ns() - status.st_ctime_ns > SETTLED_NS:
            remember(name, {"seen": seen, "digests": digests})
    return digests[member or ""]


def _archive_digests(path):
    """SHA-256 of every member of a tar archive, in one pass."""
    with archive.opened(path) as tar:
        files = (entry for entry in archive.members(tar, path) if entry.isfile())
        return {one.name: hashlib.file_digest(tar.extractfile(one), "sha256").hexdigest() for one in files}


def keep(path, dataset):
    """Keep a content, whose arrays nobody can change from now on, as long as its file does not change."""
    status = path.stat()
    for variable in dataset.variables.values():
        variable.values.flags.writeable = False
    with _lock:
        _held[path] = (status.st_size, status.st_mtime_ns), dataset
        _held.move_to_end(path)
        while sum(one.nbytes for _, one in _held.values()) > LIMIT:
            _held.popitem(last=False)


def held(path):
    """A content kept, its labels the caller's own, its arrays shared; None if there is none or the file changed."""
    try:
        status = path.stat()
    except OSError:
        return None
    with _lock:
        seen, dataset = _held.get(path, (None, None))
        if seen != (status.st_size, status.st_mtime_ns):
            return None
        _held.move_to_end(path)
    return dataset.copy()


def drop(path):
    """Forget a content."""
    with _lock:
        _held.pop(path, None)


def clear():
    """Forget contents and what was verified, as a new process would."""
    with _lock:
        _held.clear()
    verified.clear()
