"""SGRS files: readings of one or two test masses with attitude and orbit, netCDF, one day each.

A file of truth is the same without noise, with the drag beside it.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gravcal.errors import NoDataError, refuse
from gravcal.io import archive, daily
from gravcal.io.archive import LevelOneFile
from gravcal.store import origin, product

NAME = re.compile(r"(?P<product>SGRS)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>S)_(?P<release>\d{2})\.nc")
ABOUT = {"satellite": "S-GRS", "product": "SGRS"}
#: Layout: dimensions, unit, meaning.
VARIABLES = {
    "linear": (("time", "sensor", "axis"), "m s-2", "test mass relative to the spacecraft, in b"),
    "angular": (("time", "sensor", "axis"), "rad s-2", "test mass relative to the spacecraft, in b"),
    "q": (("time", "element"), "1", "attitude, scalar first, rotation from inertial to b"),
    "position": (("time", "axis"), "m", "centre of mass, inertial"),
    "velocity": (("time", "axis"), "m s-1", "centre of mass, inertial"),
    "sensor_position": (("sensor", "axis"), "m", "centre of mass to test mass, in b"),
}
DRAG = {"drag": (("time", "axis"), "m s-2", "non-gravitational acceleration of the centre of mass, true, in b")}
#: Rows with more are missing: no orbit round the Earth.
BEYOND = {"position": 1e9, "velocity": 1e5}  # m, m s-1


def file_name(date: str) -> str:
    """Name of the file of a day."""
    return f"SGRS_{date}_S_01.nc"


def inventory(folder) -> list[LevelOneFile]:
    """All SGRS files of a folder and its subfolders."""
    return daily.inventory(folder, NAME)


def find(folder, date: str | None = None) -> LevelOneFile:
    """The SGRS file of a folder and its subfolders, newest release; of several days the one wanted, YYYY-MM-DD."""
    files = {(file.date, file.release): file for file in inventory(folder) if date in (None, file.date)}
    days = sorted({day for day, _ in files})
    if not files:
        absent = f"no SGRS file{f' of {date}' if date else ''}"
        refuse(folder, absent, "SGRS_YYYY-MM-DD_S_01.nc", "Check --data.", NoDataError)
    if len(days) > 1:
        refuse(folder, f"SGRS files of {', '.join(days)}", "one day", "Give --date.")
    return files[max(files)]


def other_file(path, kind: str, date: str) -> LevelOneFile:
    """A gravity field ("GFC") or a truth ("TRUTH") as a file that a stage can read, used for a day YYYY-MM-DD."""
    return LevelOneFile(Path(path), None, kind, "S", date, "01")


def read(file: LevelOneFile, truth: bool = False):
    """Content of a file, checked, as a Dataset "ingest"; of a file of truth with the drag."""
    layout = VARIABLES | (DRAG if truth else {})
    time, values = daily.read(file, layout)
    for name, limit in BEYOND.items():
        values[name] = np.where((np.abs(values[name]) < limit).all(axis=1, keepdims=True), values[name], np.nan)
    return daily.dataset(time, values, layout, ABOUT | {"origin": origin.of_file(file)})


def sensor_positions(file: LevelOneFile) -> np.ndarray:
    """Places of the test masses, (1 or 2, 3) m, without reading the rest."""
    try:
        with product.opened(file.path) as content:
            return np.asarray(content["sensor_position"][...], dtype=float)
    except (*archive.DAMAGED, IndexError) as reason:
        return refuse(file.path, f"no sensor_position ({reason})", "an SGRS file", daily.REPAIR)


def write(path, columns: Mapping) -> Path:
    """Write a file that says it is simulated: {"time" (n,) s, and VARIABLES}; with "drag" it is a file of truth."""
    layout = VARIABLES | (DRAG if "drag" in columns else {})
    return daily.write(path, columns["time"], columns, layout, ABOUT)
