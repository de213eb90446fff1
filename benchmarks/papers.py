"""Source papers again from an archive on loopback: all their days, simulated with what is printed as truth, fetched."""

import datetime
import functools
import http.server
import os
import tarfile
import tempfile
import time
from pathlib import Path

from benchmarks.tables import Figure, of_tests, say, show, title
from flows import reproduce
from gravcal.io import archive, fetch

NAMES = ("com_offset", "kbr_phase_centre")
SERVER = "http://server/"


def papers(options) -> list[Figure]:
    """Simulate, serve, fetch and reproduce; what was made."""
    figures = []
    for name in [options.calibration] if options.calibration else NAMES:
        title(f"{name}: days simulated, served and fetched")
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            served = packed(invented(name, Path(folder)), Path(folder) / "served")
            os.environ["NO_PROXY"] = "127.0.0.1"
            with of_tests("commands").serving(functools.partial(Quiet, directory=served)) as address:
                out = Path(options.out) / name if options.out else Path(folder) / "out"
                document = reproduce.reproduce(name, out, place=address, tell=say)
            fetched = len(list((out / "data").glob("*.tgz")))
            seconds = time.perf_counter() - begin
        figures.append(Figure(f"{name}: archives fetched", f"{fetched}", f"{seconds / 60:.0f} min"))
        made = [row["corrected"][0] is not None for item in document["items"] for row in item["rows"]]
        figures.append(Figure("  rows, of them corrected", f"{len(made)}, {sum(made)}"))
    return show(figures)


def invented(name: str, folder: Path) -> Path:
    """Folder with the files of all days of a paper."""
    reproduce.invent(name, folder / "raw", folder / "raw" / "dates", folder)
    return folder / "raw"


def packed(raw: Path, root: Path) -> Path:
    """Folder with archives of the Level-1 files below another one, each where the official servers have it."""
    days = {}
    for file in archive.inventory(raw):
        for one in fetch.of_day(file.satellite, datetime.date.fromisoformat(file.date)):
            days.setdefault(one, [])
            days[one] += [file.path] if one.level == file.product[3:] else []
    for one, paths in days.items():
        path = root / fetch.addresses(one, SERVER)[0].removeprefix(SERVER)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tarfile.open(path, "w:gz", compresslevel=1) as tar:
            for own in paths:
                tar.add(own, own.name)
    return root


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Logs nothing."""

    def log_message(self, *_):
        """Leave it out."""
