"""Small things worth remembering between processes, below the store: losing them costs time, never correctness."""

import contextlib
import hashlib
import json
import os
import time
import uuid

from gravcal.store import location

CHUNK = 1 << 20  # bytes read at a time while hashing
SETTLED_NS = 100_000_000  # ten ticks of the coarsest clock of Linux


def recall(name):
    """What was remembered under a name, or None."""
    try:
        return json.loads(_path(name).read_text())
    except (OSError, ValueError):
        return None


def remember(name, value):
    """Keep a JSON value under a name; a store that cannot be written forgets it."""
    path = _path(name)
    aside = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.write_text(json.dumps(value))
        aside.replace(path)


def file_digest(path, member=None):
    """SHA-256 of a file's bytes, or of one member of an archive, remembered by path, size and times of change.

    The time at which the file system noted a change cannot be set back as that of the content can. A file that changed
    a moment ago may change again within one tick of that clock: it is not remembered yet.

    Parameters
    ----------
    path : Path
    member : str or None, name inside a tar archive

    Returns
    -------
    digest : str, 64 hexadecimal digits
    """
    status = path.stat()
    times = [status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
    seen = [os.path.abspath(path), status.st_size, *times]  # noqa: PTH100 - resolve() would follow links
    keep = remember if time.time_ns() - status.st_ctime_ns > SETTLED_NS else _nothing
    name = "file-" + hashlib.sha256(seen[0].encode()).hexdigest()[:32]
    known = recall(name)
    is_known = isinstance(known, dict) and known.get("seen") == seen and isinstance(known.get("digests"), dict)
    digests = known["digests"] if is_known else {}
    if (member or "") not in digests:
        digests |= _archive_digests(path) if member else {"": _stream_digest(path)}
        keep(name, {"seen": seen, "digests": digests})
    return digests[member or ""]


def _nothing(*_):
    """Do not remember."""


def _stream_digest(path):
    """SHA-256 of the bytes of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _archive_digests(path):
    """SHA-256 of every member of a tar archive, in one pass."""
    from gravcal.io import unpacked

    digests = {}
    with unpacked.archive(path) as archive:
        for entry in unpacked.members(archive, path):
            if entry.isfile():
                total, stream = hashlib.sha256(), archive.extractfile(entry)
                while chunk := stream.read(CHUNK):
                    total.update(chunk)
                digests[entry.name] = total.hexdigest()
    return digests


def _path(name):
    """File that holds what is remembered under a name."""
    return location.folder() / "memo" / f"{name}.json"
