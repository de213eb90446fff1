"""IS1, ATT and ORB files of an inertial sensor: netCDF, one day each, read whole or in part."""

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path

import numpy as np

from gravcal.errors import NoDataError, refuse
from gravcal.io import daily
from gravcal.io.archive import LevelOneFile

NAME = re.compile(r"(?P<product>IS1|ATT|ORB)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>T)_(?P<release>\d{2})\.nc")
VOLTAGES = ("V_x1", "V_x2", "V_x3", "V_y", "V_z1", "V_z2")
#: Layout of each product: dimensions, unit, meaning.
VARIABLES = {
    "IS1": {name: (("time",), "V", "actuation voltage") for name in VOLTAGES},
    "ATT": {
        "q": (("time", "element"), "1", "attitude of the sensor frame, scalar first, rotation from inertial to sensor")
    },
    "ORB": {
        "position": (("time", "axis"), "m", "position of the centre of mass"),
        "velocity": (("time", "axis"), "m s-1", "velocity of the centre of mass"),
    },
}


def inventory(folder) -> list[LevelOneFile]:
    """Files of an inertial sensor in a folder and its subfolders, by product and day; newest release only."""
    files = sorted(daily.inventory(folder, NAME), key=lambda one: one.release)
    newest = {(one.product, one.date): one for one in files}
    return [newest[key] for key in sorted(newest)]


def days(folder, date: str | None = None) -> dict[str, dict[str, LevelOneFile]]:
    """Files by day, {date: {"IS1", "ATT", "ORB"}}, of one day or all; a day lacking one of the three is an error."""
    by_day: dict = {}
    for one in inventory(folder):
        if date in (None, one.date):
            by_day.setdefault(one.date, {})[one.product] = one
    if not by_day:
        absent, expected = f"no file{f' of {date}' if date else ''}", "IS1, ATT and ORB files of satellite T"
        refuse(folder, absent, expected, "Check --data.", NoDataError)
    for day, files in by_day.items():
        if missing := sorted(set(VARIABLES) - set(files)):
            refuse(folder, f"no {', '.join(missing)} of {day}", "IS1, ATT and ORB of each day", "Add the missing file.")
    return by_day


def read(file: LevelOneFile, start: float | None = None, stop: float | None = None) -> dict[str, np.ndarray]:
    """Epochs and values of one file, or of a part of it between two epochs in s.

    {"time" (n,) s; IS1: "volts" (n, 6) V; ATT: "quaternion" (n, 4); ORB: "position" m, "velocity" m s-1}
    """
    time, values = daily.read(file, VARIABLES[file.product], start, stop)
    if file.product == "IS1":
        values = {"volts": np.stack([values[name] for name in VOLTAGES], axis=1)}
    elif file.product == "ATT":
        values = {"quaternion": values["q"]}
    return {"time": time} | values


def loader(file: LevelOneFile) -> Callable[[], dict[str, np.ndarray]]:
    """Function that reads a file when called; nothing is held in memory until then."""
    return functools.partial(read, file)


def loaders(files: Sequence[LevelOneFile]) -> list[tuple[Callable, ...]]:
    """Functions that read sensor, tracker and orbit of each day, without arguments; files in any order."""
    by_day: dict = {}
    for one in files:
        by_day.setdefault(one.date, {})[one.product] = loader(one)
    return [tuple(day[product] for product in VARIABLES) for _, day in sorted(by_day.items())]


def between(files: Sequence[LevelOneFile]) -> list[Callable]:
    """Functions (start, stop) that read sensor, tracker and orbit between two epochs, across midnight."""

    def read_part(product, start, stop):
        own = sorted((one for one in files if one.product == product), key=lambda one: one.date)
        parts = [read(one, start, stop) for one in own]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    return [functools.partial(read_part, product) for product in VARIABLES]


def write(folder, product: str, record: Mapping[str, np.ndarray]) -> list[Path]:
    """Files of a record as `read` returns it that say they are simulated, one a day (UTC of the GPS time scale)."""
    time = np.asarray(record["time"], dtype=float)
    columns = record
    if product == "IS1":
        columns = dict(zip(VOLTAGES, np.asarray(record["volts"]).T, strict=True))
    elif product == "ATT":
        columns = {"q": record["quaternion"]}
    day, paths = np.floor((time + 43200.0 + 1e-6) / 86400.0), []
    for one in np.unique(day):
        inside, date = day == one, (daily.EPOCH + timedelta(seconds=float(one) * 86400.0 - 43200.0)).date()
        values = {name: np.asarray(columns[name])[inside] for name in VARIABLES[product]}
        about = {"satellite": "Taiji-1", "product": product}
        path = Path(folder) / f"{product}_{date}_T_01.nc"
        paths.append(daily.write(path, time[inside], values, VARIABLES[product], about))
    return paths
