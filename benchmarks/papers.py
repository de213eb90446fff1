"""Source papers again from an archive on loopback: all their days, simulated with what is printed as truth, fetched."""

import datetime
import functools
import http.server
import os
import re
import tarfile
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.tables import Figure, numbers, of_tests, rms, say, show, title
from flows import reproduce
from gravcal.io import archive, fetch

NAMES = ("com_offset", "kbr_phase_centre")
SERVER = "http://server/"


def papers(options) -> list[Figure]:
    """Simulate, serve, fetch and reproduce; what was made, and how well the truth comes back."""
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
        figures += [Figure(f"{name}: archives fetched", f"{fetched}", f"{seconds / 60:.0f} min"), *_made(document)]
    return show(figures)


def _made(document):
    """Items with numbers of both runs, and by component the errors over sigma of simulated values."""
    for item in (item for item in document["items"] if item["rows"]):
        rows = [row for row in item["rows"] if row["corrected"][0] is not None]
        yield Figure(f"  {item['name']}: rows, of them corrected", f"{len(item['rows'])}, {len(rows)}")
        if "truth" in item:
            dates = {re.search(r"\d{4}-\d\d-\d\d", row["row"])[0] for row in rows}
            yield Figure("    dates", f"{len(dates)}")
            for run in reproduce.RUNS:
                off = [
                    rms([(row[run][0] - row["printed"][0]) / row[run][1] for row in rows if row["row"].endswith(axis)])
                    for axis in "xyz"
                ]
                yield Figure(f"    {run}, error/sigma of x, y, z, rms", numbers(np.array(off), ".1f"))


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
