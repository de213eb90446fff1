"""How much a file may unpack to: packed files are read as streams, and refused once they exceed the limit.

``GRAVCAL_UNPACKED_LIMIT`` is the limit for one file in MB (default 256; ACC1A of a day has 100). An archive may hold 16
times as much in all, and 10,000 members.
"""

import contextlib
import gzip
import os
import tarfile

from gravcal.errors import refuse
from gravcal.store import netcdf

MEGABYTE = 1_000_000
IN_ARCHIVE = 16  # limits that all members of an archive may have together
MEMBERS = 10_000
#: What h5py raises where the structure of a file is damaged.
DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError)
REMEDY = "Fetch the file again from the official archive, or raise GRAVCAL_UNPACKED_LIMIT (MB) if it is genuine."


def limit() -> int:
    """Bytes that one file may unpack to."""
    given = os.environ.get("GRAVCAL_UNPACKED_LIMIT", "256")
    try:
        found = int(float(given) * MEGABYTE)
    except (ValueError, OverflowError):
        found = 0
    if found <= 0:
        refuse("GRAVCAL_UNPACKED_LIMIT", repr(given), "a positive number of MB", "Correct or unset it.")
    return found


def too_large(where, what="bytes"):
    """Refuse a file that exceeds the limit."""
    refuse(where, f"more than {limit() / MEGABYTE:g} MB of {what}", "less", REMEDY)


def content(stream, where) -> bytes:
    """All bytes of a stream, refused beyond the limit.

    Parameters
    ----------
    stream : binary file, plain or unpacking
    where : name of the file, for messages
    """
    found = stream.read(limit() + 1)
    if len(found) > limit():
        too_large(where, "content")
    return found


class _Bounded:
    """Readable stream that refuses to go beyond what an archive may unpack to."""

    def __init__(self, stream, where):
        self._stream, self._where = stream, where
        self._most, self._end = limit(), IN_ARCHIVE * limit()
        self.tell = stream.tell

    def read(self, size=-1):
        """Bytes, not more at once than one file may have: names and comments of members are read whole."""
        if size is None or size < 0 or size > self._most:
            too_large(self._where, "one member")
        self._check(self.tell() + size)
        return self._stream.read(size)

    def seek(self, offset, whence=0):
        """Go on to a place given from the start."""
        self._check(offset)
        return self._stream.seek(offset, whence)

    def _check(self, place):
        if place > self._end + tarfile.RECORDSIZE:
            refuse(self._where, f"more than {self._end / MEGABYTE:g} MB in an archive", "less", REMEDY)


@contextlib.contextmanager
def archive(path):
    """Tar archive, plain or gzipped, read as a stream within the limits.

    Parameters
    ----------
    path : Path

    Yields
    ------
    archive : TarFile; iterate with `members`
    """
    with open(path, "rb") as file:  # noqa: PTH123 - path may be a str
        packed = file.read(2) == b"\x1f\x8b"
        file.seek(0)
        stream = gzip.GzipFile(fileobj=file) if packed else file
        with tarfile.open(fileobj=_Bounded(stream, path), mode="r:") as opened:
            yield opened


def members(opened, path):
    """Members of an archive one by one, refused where one, their sum or their number exceeds the limits.

    Parameters
    ----------
    opened : TarFile of `archive`
    path : Path, for messages
    """
    total = 0
    for number, item in enumerate(opened, 1):
        total += item.size
        if number > MEMBERS:
            refuse(path, f"more than {MEMBERS} members", "a daily archive", REMEDY)
        if item.size > limit():
            too_large(f"{path}:{item.name}", "content")
        if total > IN_ARCHIVE * limit():
            refuse(path, f"more than {IN_ARCHIVE * limit() / MEGABYTE:g} MB in an archive", "less", REMEDY)
        yield item


def check_netcdf(path) -> None:
    """Refuse a netCDF-4 file whose variables declare more than the limit, or lie in another file.

    Parameters
    ----------
    path : of the file

    Raises
    ------
    OSError : no netCDF-4 file
    """
    import h5py

    total = 0
    with netcdf.LOCK, h5py.File(path, "r") as file:
        for name in file:
            variable = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
            if not isinstance(variable, h5py.Dataset) or variable.is_virtual or variable.external:
                refuse(path, f"{name}, which is no variable of this file", "variables", REMEDY)
            total += int(variable.size or 0) * max(variable.dtype.itemsize, 1)
            if total > limit():
                too_large(path, "declared variables")
