"""Level-1 files in a folder: loose, compressed, or members of the daily archives, read without extracting.

Compressed data are read as a stream and refused once they exceed a limit: ``GRAVCAL_UNPACKED_LIMIT``, of one file
in MB (default 256; ACC1A of a day has 100). An archive may hold 16 times as much in all, and 10,000 members.
"""

import contextlib
import gzip
import hashlib
import io
import os
import re
import tarfile
import time
import zlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath

from gravcal.errors import GravcalError, refuse
from gravcal.store import location, product
from gravcal.store.product import MEASURED, SIMULATED, origins_together

NAME = re.compile(
    r"(?P<product>[A-Z0-9]{5})_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>[A-DXY])_(?P<release>\d{2})"
    r"\.(?P<form>dat|txt|asc)(?P<packed>\.gz)?"
)
FORMS = ("dat", "txt", "asc")
ARCHIVES = (".tgz", ".tar.gz", ".tar")
TOGETHER = {"A": "X", "B": "X", "AB": "X", "C": "Y", "D": "Y", "CD": "Y"}
#: Labels in every file that gravcal simulates.
BY = "gravcal simulation"
LABELS = {"acknowledgement": "simulated data", "software_version": BY}
VERSION, THANKS = r"^\s*software[ _]version\s*:\s*[\"']?", r"^\s*acknowledge?ment\s*:[^:]*?simulated data"
SAYS = re.compile(rf"{VERSION}(sim|{BY})[\"']?\s*$|{THANKS}", re.I | re.M)
OWN = re.compile(rf"{VERSION}{BY}[\"']?\s*$", re.I | re.M)
END = re.compile(r"^(END OF HEADER|# End of YAML header)", re.M)
LEVEL_ONE = re.compile(r"\w{3,5}_\d{4}-\d{2}-\d{2}_[A-Z]_\d{2}\.(dat|txt|asc|nc)(\.gz)?")
DAY = re.compile(r"\d{4}-\d{2}-\d{2}")
DATA = (".dat", ".txt", ".asc", ".gz", ".tgz", ".tar", ".nc")
HEAD = 1 << 20  # bytes within which a header ends
MEGABYTE = 1_000_000
IN_ARCHIVE = 16  # limits that all members of an archive may have together
MEMBERS = 10_000
SETTLED_NS = 2_000_000_000  # a folder that changed just before it was listed may change again unnoticed
FILE_SETTLED_NS = 100_000_000  # the same of a file: ten ticks of the coarsest clock of Linux
#: What is raised where the structure of a file is damaged: of netCDF, of a packed file.
DAMAGED = (OSError, RuntimeError, KeyError, ValueError, TypeError)
PACKED_DAMAGED = (EOFError, OSError, zlib.error, tarfile.TarError)
FETCH_AGAIN = "Fetch the file again from the official archive."
REMEDY = "Fetch the file again from the official archive, or raise GRAVCAL_UNPACKED_LIMIT (MB) if it is genuine."
_listed = {}  # folder -> (files as of `_listing`, {folder or archive: size and time of change} when it was listed)


@dataclass(frozen=True)
class LevelOneFile:
    """One Level-1 file: a path, and its member name where the path is an archive."""

    path: Path
    member: str | None
    product: str  #: such as "KBR1B"
    satellite: str  #: letter
    date: str  #: YYYY-MM-DD
    release: str  #: such as "04"

    @property
    def name(self) -> str:
        """Name of the file itself, without folders."""
        return PurePosixPath(self.member).name if self.member else self.path.name

    @property
    def where(self) -> str:
        """Text for messages: path, or "path:member"."""
        return f"{self.path}:{self.member}" if self.member else str(self.path)


def is_archive(path) -> bool:
    """True if the name is that of a tar archive."""
    return Path(path).name.endswith(ARCHIVES)


def from_name(path, member=None) -> LevelOneFile | None:
    """LevelOneFile from the name of a file or member, None for any other name (reports, AppleDouble members)."""
    path = Path(path)
    parts = NAME.fullmatch(PurePosixPath(member).name if member else path.name)
    if not parts:
        return None
    return LevelOneFile(path, member, parts["product"], parts["satellite"], parts["date"], parts["release"])


def content(file: LevelOneFile) -> bytes:
    """Bytes of a Level-1 file, unpacked in memory; refused if it is missing, empty, too large or damaged."""
    try:
        packed = io.BytesIO(_member(file)) if file.member else file.path.open("rb")
        with packed, gzip.GzipFile(fileobj=packed) if file.name.endswith(".gz") else packed as stream:
            plain = stream.read(limit() + 1)
    except (FileNotFoundError, IsADirectoryError) as reason:
        refuse(file.where, "no file", "a Level-1 file", "Check the path.", reason=str(reason))
    except PACKED_DAMAGED as reason:
        refuse(file.where, f"damaged compression ({reason})", "a whole file", FETCH_AGAIN)
    if len(plain) > limit():
        _too_large(file.where, "content")
    if not plain:
        refuse(file.where, "an empty file", "a header and records", FETCH_AGAIN)
    return plain


def _member(file):
    """Bytes, as stored, of the member of an archive that a LevelOneFile names; refused if there is none."""
    packed = None
    with opened(file.path) as tar:
        for item in members(tar, file.path):
            if item.name == file.member:  # the last of that name counts, as for tar
                packed = tar.extractfile(_safe(file.path, item)).read()
    if packed is None:
        refuse(file.where, "no such member", "a member of the archive", "List the archive with inventory().")
    return packed


def _safe(path, item):
    """Member ``item`` (TarInfo) itself, refused if its name leaves the folder or a Level-1 name is no regular file."""
    parts = PurePosixPath(item.name.replace("\\", "/"))
    if parts.is_absolute() or ".." in parts.parts:
        refuse(f"{path}:{item.name}", "a path that leaves the folder", "a path inside the archive", FETCH_AGAIN)
    if not item.isfile() and NAME.fullmatch(parts.name):
        refuse(f"{path}:{item.name}", "a link or device", "a regular file", FETCH_AGAIN)
    return item


@lru_cache(maxsize=64)
def _members(path, size, changed_ns):  # noqa: ARG001 - the last two: key of the cache
    try:
        with opened(path) as tar:
            return tuple(_safe(path, item).name for item in members(tar, path) if not item.isdir())
    except PACKED_DAMAGED as reason:
        return refuse(path, f"a damaged archive ({reason})", "a whole archive", FETCH_AGAIN)


def file_digest(path, member=None) -> str:
    """SHA-256 of a file, or of one member of a tar archive, remembered by path, size and times of change.

    The time at which the file system noted a change cannot be set back as that of the content can. A file that changed
    a moment ago may change again within one tick of that clock: it is not remembered yet.
    """
    status = path.stat()
    absolute = os.path.abspath(path)  # noqa: PTH100 - resolve() would follow links
    stamp = [absolute, status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
    name = "file-" + hashlib.sha256(absolute.encode()).hexdigest()[:32]
    cached = location.recall(name)
    is_cached = isinstance(cached, dict) and cached.get("seen") == stamp and isinstance(cached.get("digests"), dict)
    digests = cached["digests"] if is_cached else {}
    if (member or "") not in digests:
        if member:
            with opened(path) as tar:
                files = (one for one in members(tar, path) if one.isfile())
                digests |= {f.name: hashlib.file_digest(tar.extractfile(f), "sha256").hexdigest() for f in files}
        else:
            with path.open("rb") as stream:
                digests[""] = hashlib.file_digest(stream, "sha256").hexdigest()
        if time.time_ns() - status.st_ctime_ns > FILE_SETTLED_NS:
            location.remember(name, {"seen": stamp, "digests": digests})
    return digests[member or ""]


def inventory(folder) -> list[LevelOneFile]:
    """All Level-1 files of a folder, its subfolders and the archives in them, or of one archive or file.

    Newest release first, loose before archived, binary before text.
    """
    return [file for own in _listing(folder).values() for file in own]


def state_of(folder) -> str | None:
    """Digest of names, sizes and times of change of the Level-1 files and archives below a folder; None without any."""
    stamps = []
    for path in sorted(Path(folder).rglob("*")):
        if not path.name.startswith(".") and (is_archive(path) or from_name(path) or path.suffix in (".nc", ".cdf")):
            with contextlib.suppress(OSError):  # it went while we looked
                status = path.stat()
                stamps.append(f"{path.relative_to(folder)} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(stamps).encode()).hexdigest() if stamps else None


def _listing(folder):
    """{(product, satellite, date): [LevelOneFile] by preference} below a folder; cached until that changes."""
    folder = Path(folder)
    known, stamps = _listed.pop(folder, ({}, {}))
    if stamps and stamps == {path: _stamp(path) for path in stamps}:
        _listed[folder] = known, stamps
        return known
    if not folder.exists():
        refuse(folder, "nothing there", "a folder of Level-1 files", "Check the path.")
    folders, paths = [], [] if folder.is_dir() else [folder]
    for root, _, names in os.walk(folder):
        folders.append(Path(root))
        wanted = (Path(root) / name for name in names if is_archive(name) or NAME.fullmatch(name))
        paths += [path for path in wanted if not path.name.startswith("._") and path.is_file()]
    stamps = {path: _stamp(path) for path in [*folders, *filter(is_archive, paths)] or paths}
    files, index = [], {}
    for path in sorted(paths):
        names = _members(path, *stamps[path]) if is_archive(path) else (None,)
        files += [file for name in names if (file := from_name(path, name))]
    for file in sorted(files, key=_preference):
        index.setdefault((file.product, file.satellite, file.date), []).append(file)
    if max(changed for _, changed in stamps.values()) < time.time_ns() - SETTLED_NS:
        _listed[folder] = index, stamps
    return index


def _stamp(path):
    """Size and time of change of a folder or archive, (-1, 0) when it is gone."""
    try:
        status = path.stat()
    except OSError:
        return -1, 0
    return status.st_size, status.st_ctime_ns


def _preference(file):
    """Sort key of a LevelOneFile: product, date, satellite, then newest release, loose, binary first."""
    form = FORMS.index(NAME.fullmatch(file.name)["form"])
    kind = (file.product, file.date, file.satellite)
    return (*kind, -int(file.release), bool(file.member), form, file.name.endswith(".gz"), file.where)


def find(folder, product, satellite, date) -> LevelOneFile | None:
    """LevelOneFile of exactly this product, satellite letter and day: newest release, loose first; or None."""
    return next(iter(_listing(folder).get((product, satellite, str(date)), ())), None)


def limit() -> int:
    """Most bytes to which one file may be unpacked: GRAVCAL_UNPACKED_LIMIT."""
    setting = os.environ.get("GRAVCAL_UNPACKED_LIMIT", "256")
    try:
        most = int(float(setting) * MEGABYTE)
    except (ValueError, OverflowError):
        most = 0
    if most <= 0:
        refuse("GRAVCAL_UNPACKED_LIMIT", repr(setting), "a positive number of MB", "Correct or unset it.")
    return most


def _too_large(where, what):  # raises: ``what`` of a file has more bytes than `limit`
    refuse(where, f"more than {limit() / MEGABYTE:g} MB of {what}", "less", REMEDY)


class _Bounded:
    """Readable stream of an archive that refuses to pass the limits of one file and of the whole archive."""

    def __init__(self, stream, where):  # binary stream; path for messages
        self._stream, self._where = stream, where
        self._most, self._end = limit(), IN_ARCHIVE * limit()
        self.tell = stream.tell

    def read(self, size=-1):
        """Bytes; refuses sizes over the limit of a file or unlimited, as tarfile reads member names whole."""
        if size is None or size < 0 or size > self._most:
            _too_large(self._where, "one member")
        self._check(self.tell() + size)
        return self._stream.read(size)

    def seek(self, offset, whence=0):
        """Set the position, bytes from the start; refused beyond the limit of an archive."""
        self._check(offset)
        return self._stream.seek(offset, whence)

    def _check(self, place):  # raises if a position in bytes is beyond the limit of an archive
        if place > self._end + tarfile.RECORDSIZE:
            refuse(self._where, f"more than {self._end / MEGABYTE:g} MB in an archive", "less", REMEDY)


@contextlib.contextmanager
def opened(path):
    """Tar archive, plain or gzipped, read as a stream within the limits; iterate with `members`."""
    with open(path, "rb") as file:  # noqa: PTH123 - path may be a str
        packed = file.read(2) == b"\x1f\x8b"
        file.seek(0)
        stream = gzip.GzipFile(fileobj=file) if packed else file
        with tarfile.open(fileobj=_Bounded(stream, path), mode="r:") as tar:
            yield tar


def members(tar, path):
    """Members of an archive one by one, refused where one, their sum or their number exceeds the limits."""
    total = 0
    for number, item in enumerate(tar, 1):
        total += item.size
        if number > MEMBERS:
            refuse(path, f"more than {MEMBERS} members", "a daily archive", REMEDY)
        if item.size > limit():
            _too_large(f"{path}:{item.name}", "content")
        if total > IN_ARCHIVE * limit():
            refuse(path, f"more than {IN_ARCHIVE * limit() / MEGABYTE:g} MB in an archive", "less", REMEDY)
        yield item
    while tar.fileobj.read(tarfile.RECORDSIZE):  # to the checksum of the compression
        pass


def check_netcdf(path) -> None:
    """Refuse a netCDF-4 file whose variables declare more than the limit, or lie in another file; OSError: no HDF5."""
    import h5py

    total = 0
    with product.LOCK, h5py.File(path, "r") as file:
        for name in file:
            variable = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
            if not isinstance(variable, h5py.Dataset) or variable.is_virtual or variable.external:
                refuse(path, f"{name}, which is no variable of this file", "variables", REMEDY)
            total += int(variable.size or 0) * max(variable.dtype.itemsize, 1)
            if total > limit():
                _too_large(path, "declared variables")


def origin_of_header(text: str) -> str:
    """Origin, SIMULATED or MEASURED, by the text of a header: YAML, 80 columns, or "name: value" lines."""
    return SIMULATED if SAYS.search(text) else MEASURED


def origin_of(file: LevelOneFile) -> str:
    """Origin, SIMULATED or MEASURED, of a Level-1 file; "" of a file without records, such as a gravity field."""
    if file.member:
        return origin_of_header(_cut(content(file)))
    return origin_of_header(_header(file.path)) if file.name.endswith(".nc") or LEVEL_ONE.fullmatch(file.name) else ""


def origin_below(folder, date: str | None) -> str:
    """Origin (also "mixed") of the Level-1 files below a folder, loose and in archives, of one day or (None) of all."""
    origins, is_wanted = [], lambda name: LEVEL_ONE.fullmatch(PurePosixPath(name).name) and (date or "") in name
    for path in Path(folder).rglob("*"):
        if is_wanted(path.name):
            origins.append(origin_of_header(_header(path)))
        elif is_archive(path) and (date in (days := DAY.findall(path.name)) or not (date and days)):
            with contextlib.suppress(GravcalError, *PACKED_DAMAGED), opened(path) as tar:
                files = (item for item in members(tar, path) if item.isfile() and is_wanted(item.name))
                origins.extend(origin_of_header(_head(tar.extractfile(item), item.name)) for item in files)
    return origins_together(origins) or MEASURED


def check_own(folder) -> None:
    """Raise if a folder holds data that gravcal did not simulate: simulated files are never written next to them."""
    folder = Path(folder)
    for path in sorted(folder.rglob("*")):
        is_data = LEVEL_ONE.fullmatch(path.name) or is_archive(path)
        is_data = is_data or (path.parent == folder and path.suffix in DATA)
        if is_data and path.is_file() and (is_archive(path) or not OWN.search(_header(path))):
            remedy = "Give an empty folder, or one with files of gravcal simulate only."
            refuse(path, "a file that gravcal did not simulate", "a folder without such files", remedy)


def _header(path):
    """Header text of a loose file, attributes of netCDF as lines; "" if unreadable, which its reader reports."""
    try:
        if path.suffix == ".nc":
            with product.opened(path) as file:
                return "\n".join(f"{name}: {value}" for name, value in product.attributes(file).items())
        with path.open("rb") as stream:
            return _head(stream, path.name)
    except (*DAMAGED, EOFError, zlib.error):
        return ""


def _head(stream, name):
    """Header text of an open file; name: ends with ".gz" if it is compressed."""
    return _cut((gzip.GzipFile(fileobj=stream) if name.endswith(".gz") else stream).read(HEAD))


def _cut(data):  # header text at the start of bytes, "" if its end is not within `HEAD`
    text = data[:HEAD].decode("latin-1")
    end = END.search(text)
    return text[: end.start()] if end else ""
