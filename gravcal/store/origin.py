"""Origin of records, measured or simulated, as the headers of their files say; saying nothing counts as measured."""

import contextlib
import gzip
import re
import zlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from gravcal.errors import GravcalError, refuse
from gravcal.io import archive
from gravcal.store import product

MEASURED, SIMULATED, MIXED = ORIGINS = ("measured", "simulated", "mixed")
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


def of_header(text: str) -> str:
    """Origin by the text of a header, YAML or 80 columns, or by attributes as "name: value" lines."""
    return SIMULATED if SAYS.search(text) else MEASURED


def of_file(file: archive.LevelOneFile) -> str:
    """Origin of a Level-1 file; "" of what holds no records, such as a gravity field."""
    if file.member:
        return of_header(_cut(archive.content(file)))
    return of_header(_header(file.path)) if file.name.endswith(".nc") or LEVEL_ONE.fullmatch(file.name) else ""


def together(origins: Iterable[str]) -> str:
    """Origin of what is made of several; "" says nothing and changes nothing."""
    distinct = {one for one in origins if one}
    return distinct.pop() if len(distinct) == 1 else MIXED if distinct else ""


def raised(origin: str, own: str) -> str:
    """Origin by the inputs and what a stage says itself, which may make measured simulated and never the reverse."""
    return max(origin, own, key=("", *ORIGINS).index)


def below(folder, date: str | None) -> str:
    """Origin of the Level-1 files below a folder, loose and in archives, of one day or of all."""
    found, wanted = [], lambda name: LEVEL_ONE.fullmatch(PurePosixPath(name).name) and (date or "") in name
    for path in Path(folder).rglob("*"):
        if wanted(path.name):
            found.append(of_header(_header(path)))
        elif archive.is_archive(path) and (date in (days := DAY.findall(path.name)) or not (date and days)):
            with contextlib.suppress(GravcalError, *archive.PACKED_DAMAGED), archive.opened(path) as tar:
                files = (item for item in archive.members(tar, path) if item.isfile() and wanted(item.name))
                found.extend(of_header(_head(tar.extractfile(item), item.name)) for item in files)
    return together(found) or MEASURED


def check_own(folder) -> None:
    """Raise if a folder holds data that gravcal did not simulate: nothing invented is written beside them."""
    folder = Path(folder)
    for path in sorted(folder.rglob("*")):
        is_data = LEVEL_ONE.fullmatch(path.name) or archive.is_archive(path)
        is_data = is_data or (path.parent == folder and path.suffix in DATA)
        if is_data and path.is_file() and (archive.is_archive(path) or not OWN.search(_header(path))):
            remedy = "Give an empty folder, or one with files of gravcal simulate only."
            refuse(path, "a file that gravcal did not simulate", "a folder without such files", remedy)


def _header(path):
    """Text of the header of a file, "" where it cannot be read; its own reader refuses it."""
    try:
        if path.suffix == ".nc":
            with product.opened(path) as file:
                return "\n".join(f"{name}: {value}" for name, value in product.attributes(file).items())
        with path.open("rb") as stream:
            return _head(stream, path.name)
    except (*archive.DAMAGED, EOFError, zlib.error):
        return ""


def _head(stream, name):
    """Text of the header of an open file, which may be packed."""
    return _cut((gzip.GzipFile(fileobj=stream) if name.endswith(".gz") else stream).read(HEAD))


def _cut(data):
    """Text before the records."""
    text = data[:HEAD].decode("latin-1")
    end = END.search(text)
    return text[: end.start()] if end else ""
