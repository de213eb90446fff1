"""IS1, ATT and ORB files of an inertial sensor: netCDF, one day each, read whole or in part.

Own definition of the project, for no Taiji-1 data are public; times are GPS seconds past 2000-01-01 12:00:00.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from gravcal.errors import NoDataError, refuse
from gravcal.io import epochs, unpacked
from gravcal.io.archive import LevelOneFile
from gravcal.store import netcdf, origin

NAME = re.compile(r"(?P<product>IS1|ATT|ORB)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>T)_(?P<release>\d{2})\.nc")
ORIGIN = datetime(2000, 1, 1, 12)
VOLTAGES = ("V_x1", "V_x2", "V_x3", "V_y", "V_z1", "V_z2")

#: Variables of each product: name in the file, unit, number of components.
VARIABLES = {
    "IS1": {name: ("V", 1) for name in VOLTAGES},
    "ATT": {"q": ("1", 4)},
    "ORB": {"position": ("m", 3), "velocity": ("m s-1", 3)},
}
LONG_NAMES = {
    "q": "attitude of the sensor frame, scalar first, rotation from inertial to sensor",
    "position": "position of the centre of mass",
    "velocity": "velocity of the centre of mass",
} | {name: "actuation voltage" for name in VOLTAGES}


def inventory(folder) -> list[LevelOneFile]:
    """Files of an inertial sensor in a folder and its subfolders, by product and day; newest release only.

    Parameters
    ----------
    folder : path
    """
    folder = Path(folder)
    if not folder.is_dir():
        refuse(folder, "no folder", "a folder of IS1, ATT and ORB files", "Check --data.")
    found = {}
    for path in sorted(folder.rglob("*.nc")):
        match = NAME.fullmatch(path.name)
        if match:
            key = (match["product"], match["date"])
            one = LevelOneFile(path, None, match["product"], match["satellite"], match["date"], match["release"])
            if key not in found or one.release > found[key].release:
                found[key] = one
    return [found[key] for key in sorted(found)]


def days(folder, date: str | None = None) -> dict[str, dict[str, LevelOneFile]]:
    """Files by day, {date: {"IS1", "ATT", "ORB"}}; a day lacking one of the three is an error.

    Parameters
    ----------
    folder : path
    date : YYYY-MM-DD of the only day wanted, or None for all
    """
    found: dict = {}
    for one in inventory(folder):
        if date in (None, one.date):
            found.setdefault(one.date, {})[one.product] = one
    if not found:
        refuse(
            folder,
            f"no file{f' of {date}' if date else ''}",
            "IS1, ATT and ORB files of satellite T",
            "Check --data.",
            NoDataError,
        )
    for day, files in found.items():
        missing = sorted(set(VARIABLES) - set(files))
        if missing:
            refuse(folder, f"no {', '.join(missing)} of {day}", "IS1, ATT and ORB of each day", "Add the missing file.")
    return found


def read(file: LevelOneFile, start: float | None = None, stop: float | None = None) -> dict[str, np.ndarray]:
    """Epochs and values of one file, or of a part of it.

    Parameters
    ----------
    file : LevelOneFile
    start, stop : s, bounds of the part wanted

    Returns
    -------
    record : {"time" (n,) s; IS1: "volts" (n, 6) V; ATT: "quaternion" (n, 4); ORB: "position" m, "velocity" m s-1}

    Raises
    ------
    ProductError : not a netCDF file, a variable or unit is missing or wrong, another day
    """
    try:
        unpacked.check_netcdf(file.path)
        with netcdf.opened(file.path) as opened:
            content = opened.variables
            _check(content, file)
            time = content["time"][:].astype(float)
            names = VARIABLES[file.product]
            if epochs.increasing(time):
                part = _part(time, start, stop)
                values = {name: content[name][part].astype(float) for name in names}
            else:
                time, values = epochs.in_order(time, {name: content[name][:] for name in names})
                part = _part(time, start, stop)
                values = {name: column[part] for name, column in values.items()}
    except unpacked.DAMAGED as reason:
        refuse(file.path, f"no readable netCDF file ({reason})", f"an {file.product} file", "Fetch the file again.")
    epochs.check_day(time, file.path, file.date)
    return {"time": time[part]} | _joined(file.product, values)


def _part(time, start, stop):
    """Slice between two epochs."""
    first = 0 if start is None else int(np.searchsorted(time, start))
    return slice(first, time.size if stop is None else int(np.searchsorted(time, stop)))


def _joined(product, values):
    """Columns under the names that the calibration uses."""
    if product == "IS1":
        return {"volts": np.stack([values[name] for name in VOLTAGES], axis=1)}
    return {"quaternion": values["q"]} if product == "ATT" else values


def _check(content, file):
    """Variables, shapes and units."""
    if "time" not in content:
        refuse(file.path, "no variable time", "time in GPS seconds", "Write the file by formats.md, section 6.")
    count = content["time"].shape[0]
    for name, (unit, width) in VARIABLES[file.product].items():
        if name not in content:
            refuse(file.path, f"no variable {name}", f"{name} in {unit}", "Write the file by formats.md, section 6.")
        found = str(netcdf.attributes(content[name]).get("units", "none"))
        if found != unit:
            refuse(file.path, f"{name} in {found}", f"{name} in {unit}", "Convert it, or correct its units.")
        shape = (count,) if width == 1 else (count, width)
        if content[name].shape != shape:
            refuse(file.path, f"{name} of shape {content[name].shape}", f"{shape}", "Write it along time.")


def loader(file: LevelOneFile) -> Callable[[], dict[str, np.ndarray]]:
    """Function that reads a file when called; nothing is held in memory until then.

    Parameters
    ----------
    file : LevelOneFile
    """
    return lambda: read(file)


def loaders(files: Sequence[LevelOneFile]) -> list[tuple[Callable, ...]]:
    """Functions that read sensor, tracker and orbit of each day, without arguments.

    Parameters
    ----------
    files : IS1, ATT and ORB of every day, in any order
    """
    by_day: dict = {}
    for one in files:
        by_day.setdefault(one.date, {})[one.product] = loader(one)
    return [tuple(day[product] for product in VARIABLES) for _, day in sorted(by_day.items())]


def between(files: Sequence[LevelOneFile]) -> list[Callable]:
    """Functions (start, stop) that read sensor, tracker and orbit between two epochs, across midnight.

    Parameters
    ----------
    files : IS1, ATT and ORB of one day or more, in any order
    """
    return [_between([one for one in files if one.product == product]) for product in VARIABLES]


def _between(files):
    def read_part(start, stop):
        parts = [read(one, start, stop) for one in sorted(files, key=lambda one: one.date)]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    return read_part


def write(folder, product: str, record: Mapping[str, np.ndarray]) -> list[Path]:
    """Files of a record that say they are simulated, one a day (UTC of the GPS time scale).

    Parameters
    ----------
    folder : path, made if missing
    product : "IS1", "ATT" or "ORB"
    record : {"time" (n,) s, ...} as read returns it
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    time = np.asarray(record["time"], dtype=float)
    day = np.floor((time + 43200.0 + 1e-6) / 86400.0)
    paths = []
    for one in np.unique(day):
        inside = day == one
        date = (ORIGIN + timedelta(seconds=float(one) * 86400.0 - 43200.0)).date()
        path = folder / f"{product}_{date}_T_01.nc"
        _write(path, product, {name: np.asarray(values)[inside] for name, values in record.items()})
        paths.append(path)
    return paths


def _write(path, product, record):
    """One file."""
    import xarray as xr

    values = _columns(product, record)
    variables = {}
    for name, (unit, width) in VARIABLES[product].items():
        dims = ("time",) if width == 1 else ("time", f"component_{width}")
        variables[name] = dims, np.asarray(values[name]), {"units": unit, "long_name": LONG_NAMES[name]}
    time = ("time", np.asarray(record["time"], dtype=float), {"units": "seconds since 2000-01-01 12:00:00"})
    attributes = {"satellite": "Taiji-1", "product": product, "time_scale": "GPS"} | origin.LABELS
    netcdf.write(xr.Dataset(variables, {"time": time}, attributes), path)


def _columns(product, record):
    if product == "IS1":
        return dict(zip(VOLTAGES, np.asarray(record["volts"]).T, strict=True))
    return {"q": record["quaternion"]} if product == "ATT" else record
