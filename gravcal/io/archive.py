"""Level-1 files in a folder: loose, compressed, or members of the daily archives, read without extracting."""

import gzip
import io
import os
import re
import tarfile
import time
import zlib
from collections import OrderedDict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath

from gravcal.errors import refuse
from gravcal.io import unpacked

NAME = re.compile(
    r"(?P<product>[A-Z0-9]{5})_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>[A-DXY])_(?P<release>\d{2})"
    r"\.(?P<form>dat|txt|asc)(?P<packed>\.gz)?"
)
FORMS = ("dat", "txt", "asc")
ARCHIVES = (".tgz", ".tar.gz", ".tar")
TOGETHER = {"A": "X", "B": "X", "AB": "X", "C": "Y", "D": "Y", "CD": "Y"}
FETCH_AGAIN = "Fetch the file again from the official archive."
SETTLED_NS = 2_000_000_000  # a folder that changed just before it was listed may change again unnoticed
LISTINGS = 256  # folders whose listing is kept
_listed = OrderedDict()


@dataclass(frozen=True)
class LevelOneFile:
    """One Level-1 file: a path, and its member name where the path is an archive."""

    path: Path
    member: str | None
    product: str
    satellite: str
    date: str
    release: str

    @property
    def name(self) -> str:
        """Name of the file itself, without folders."""
        return PurePosixPath(self.member).name if self.member else self.path.name

    @property
    def where(self) -> str:
        """How messages call this file."""
        return f"{self.path}:{self.member}" if self.member else str(self.path)


def is_archive(path) -> bool:
    """Whether the name is that of a tar archive."""
    return Path(path).name.endswith(ARCHIVES)


def from_name(path, member=None) -> LevelOneFile | None:
    """The Level-1 file a name stands for, None where it is none (reports, AppleDouble members, others)."""
    path = Path(path)
    found = NAME.fullmatch(PurePosixPath(member).name if member else path.name)
    if not found:
        return None
    return LevelOneFile(path, member, found["product"], found["satellite"], found["date"], found["release"])


def content(file: LevelOneFile) -> bytes:
    """Bytes of a Level-1 file, unpacked in memory.

    Raises
    ------
    ProductError : the file is missing, empty, too large, or its compression is damaged
    """
    try:
        packed = io.BytesIO(_member(file)) if file.member else file.path.open("rb")
        with packed, gzip.GzipFile(fileobj=packed) if file.name.endswith(".gz") else packed as stream:
            plain = unpacked.content(stream, file.where)
    except (FileNotFoundError, IsADirectoryError) as reason:
        refuse(file.where, "no file", "a Level-1 file", "Check the path.", reason=str(reason))
    except (EOFError, OSError, zlib.error, tarfile.TarError) as reason:
        refuse(file.where, f"damaged compression ({reason})", "a whole file", FETCH_AGAIN)
    if not plain:
        refuse(file.where, "an empty file", "a header and records", FETCH_AGAIN)
    return plain


def _member(file):
    with unpacked.archive(file.path) as archive:
        for item in unpacked.members(archive, file.path):
            if item.name == file.member:
                return archive.extractfile(_safe(file.path, item)).read()
    return refuse(file.where, "no such member", "a member of the archive", "List the archive with inventory().")


def _safe(path, item):
    parts = PurePosixPath(item.name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts:
        refuse(f"{path}:{item.name}", "a path that leaves the folder", "a path inside the archive", FETCH_AGAIN)
    if not item.isfile() and NAME.fullmatch(parts.name):
        refuse(f"{path}:{item.name}", "a link or device", "a regular file", FETCH_AGAIN)
    return item


@lru_cache(maxsize=64)
def _members(path, size, changed_ns):  # noqa: ARG001 - the last two make the cache honest
    try:
        with unpacked.archive(path) as archive:
            return tuple(_safe(path, item).name for item in unpacked.members(archive, path) if not item.isdir())
    except (EOFError, OSError, zlib.error, tarfile.TarError) as reason:
        return refuse(path, f"a damaged archive ({reason})", "a whole archive", FETCH_AGAIN)


def inventory(folder) -> list[LevelOneFile]:
    """All Level-1 files of a folder, its subfolders and the archives in them, or of one archive.

    Parameters
    ----------
    folder : path of a folder, an archive or a single file

    Returns
    -------
    files : list of LevelOneFile; newest release first, loose before archived, binary before text

    Raises
    ------
    ProductError : no such folder, a damaged archive, or a member whose path leaves the folder
    """
    return list(_listing(folder).files)


def holds(folder, product, satellite, date) -> bool:
    """Whether a folder has a Level-1 file of exactly this product, satellite letter and day."""
    return (product, satellite, str(date)) in _listing(folder).index


@dataclass(frozen=True)
class _Listing:
    """Files of a folder, by preference and by (product, satellite, date), and what tells that it changed."""

    files: tuple
    index: dict
    seen: dict


def _listing(folder):
    """Files of a folder; listed again when one of its folders or archives changed."""
    folder = Path(folder)
    known = _listed.get(folder)
    if known is not None and known.seen == {path: _stamp(path) for path in known.seen}:
        return known
    made = _list(folder)
    newest = max(stamp[1] for stamp in made.seen.values())
    _listed.pop(folder, None)
    if newest < time.time_ns() - SETTLED_NS:
        _listed[folder] = made
    while len(_listed) > LISTINGS:
        _listed.popitem(last=False)
    return made


def _list(folder):
    """Look into a folder, its subfolders and archives."""
    if not folder.exists():
        refuse(folder, "nothing there", "a folder of Level-1 files", "Check the path.")
    folders, paths = _walk(folder) if folder.is_dir() else ([], [folder])
    seen = {path: _stamp(path) for path in [*folders, *filter(is_archive, paths)] or paths}
    files = []
    for path in paths:
        if is_archive(path):
            files += [from_name(path, name) for name in _members(path, *seen[path])]
        else:
            files.append(from_name(path))
    files = sorted((f for f in files if f), key=_preference)
    index = {}
    for file in files:
        index.setdefault((file.product, file.satellite, file.date), []).append(file)
    return _Listing(tuple(files), index, seen)


def _walk(folder):
    """Folders below a folder, itself among them, and the files that may hold Level-1 data."""
    folders, paths = [], []
    for root, _, names in os.walk(folder):
        folders.append(Path(root))
        paths += [Path(root) / name for name in names if is_archive(name) or NAME.fullmatch(name)]
    return folders, sorted(path for path in paths if not path.name.startswith("._") and path.is_file())


def _stamp(path):
    """Size and time of change of a folder or archive, (-1, 0) when it is gone."""
    try:
        status = path.stat()
    except OSError:
        return -1, 0
    return status.st_size, status.st_ctime_ns


def _preference(file):
    form = FORMS.index(NAME.fullmatch(file.name)["form"])
    kind = (file.product, file.date, file.satellite)
    return (*kind, -int(file.release), bool(file.member), form, file.name.endswith(".gz"), file.where)


def find(folder, product, satellite=None, date=None) -> LevelOneFile:
    """The Level-1 file of a product, satellite and day: newest release, loose before archived.

    Parameters
    ----------
    folder : path of a folder or archive
    product : five characters, such as "ACC1A"
    satellite : letter; "C" or "CD" also finds the combined product "Y", "A" or "AB" the product "X"; None for any
    date : "YYYY-MM-DD", or None where the folder holds one day only

    Raises
    ------
    ProductError : nothing fits, or several days or satellites fit
    """
    listing = _listing(folder)
    wanted = (satellite, TOGETHER.get(satellite))
    if satellite and date:
        fitting = [f for letter in wanted for f in listing.index.get((product, letter, str(date)), ())]
    else:
        fitting = [f for f in listing.files if f.product == product]
        fitting = [f for f in fitting if satellite is None or f.satellite in wanted]
        fitting = [f for f in fitting if date is None or f.date == str(date)]
    what = " ".join(str(x) for x in (product, satellite, date) if x)
    if not fitting:
        files = [f for f in listing.files if f.product == product]
        there = sorted({f"{f.product} {f.satellite} {f.date}" for f in files}) or "no file of this product"
        refuse(
            folder, there, what, "Add the missing file, or choose another folder, satellite or day.", product=product
        )
    for field, remedy in (("date", "Give the date."), ("satellite", "Give the satellite.")):
        several = sorted({getattr(f, field) for f in fitting})
        if len(several) > 1:
            refuse(folder, f"{what} for {', '.join(several)}", f"one {field}", remedy, product=product)
    return fitting[0]
