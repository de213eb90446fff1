"""Small things worth remembering between processes, below the store: losing them costs time, never correctness."""

import contextlib
import hashlib
import json
import os
import uuid

from gravcal.data import location

CHUNK = 1 << 20  # bytes read at a time while hashing


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
    """SHA-256 of a file's bytes, or of one member of an archive, remembered by path, size and time of change.

    Parameters
    ----------
    path : Path
    member : str or None, name inside a tar archive

    Returns
    -------
    digest : str, 64 hexadecimal digits
    """
    status = path.stat()
    seen = [os.path.abspath(path), status.st_size, status.st_mtime_ns]  # noqa: PTH100 - resolve() would follow links
    name = "file-" + hashlib.sha256(seen[0].encode()).hexdigest()[:32]
    known = recall(name)
    if not known or known["seen"] != seen:
        known = {"seen": seen, "digests": _archive_digests(path) if member else {"": _stream_digest(path)}}
        remember(name, known)
    elif (member or "") not in known["digests"]:
        known["digests"] |= _archive_digests(path) if member else {"": _stream_digest(path)}
        remember(name, known)
    return known["digests"][member or ""]


def _stream_digest(path):
    """SHA-256 of the bytes of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _archive_digests(path):
    """SHA-256 of every member of a tar archive, in one pass."""
    import tarfile

    digests = {}
    with tarfile.open(path) as archive:
        for entry in archive:
            if entry.isfile():
                total, stream = hashlib.sha256(), archive.extractfile(entry)
                while chunk := stream.read(CHUNK):
                    total.update(chunk)
                digests[entry.name] = total.hexdigest()
    return digests


def _path(name):
    """File that holds what is remembered under a name."""
    return location.folder() / "memo" / f"{name}.json"
