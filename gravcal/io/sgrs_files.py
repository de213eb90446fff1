"""SGRS files: readings of one or two test masses with attitude and orbit, netCDF, one day each.

Own definition of the project (formats.md, section 6), for no S-GRS data are public; times are GPS seconds past
2000-01-01 12:00:00. A file of truth is the same without noise, with the drag beside it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gravcal.errors import NoDataError, refuse
from gravcal.io import epochs, unpacked
from gravcal.io.archive import LevelOneFile
from gravcal.store import netcdf, origin, product

NAME = re.compile(r"(?P<product>SGRS)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>S)_(?P<release>\d{2})\.nc")
REPAIR = "Write the file by formats.md, section 6."
#: Variables: dimensions after time, unit, meaning.
VARIABLES = {
    "linear": (("time", "sensor", "axis"), "m s-2", "test mass relative to the spacecraft, in b"),
    "angular": (("time", "sensor", "axis"), "rad s-2", "test mass relative to the spacecraft, in b"),
    "q": (("time", "element"), "1", "attitude, scalar first, rotation from inertial to b"),
    "position": (("time", "axis"), "m", "centre of mass, inertial"),
    "velocity": (("time", "axis"), "m s-1", "centre of mass, inertial"),
    "sensor_position": (("sensor", "axis"), "m", "centre of mass to test mass, in b"),
}
DRAG = {"drag": (("time", "axis"), "m s-2", "non-gravitational acceleration of the centre of mass, true, in b")}
WIDTHS = {"axis": 3, "element": 4}
#: Rows with more are missing: no orbit round the Earth.
BEYOND = {"position": 1e9, "velocity": 1e5}  # m, m s-1


def file_name(date: str) -> str:
    """Name of the file of a day."""
    return f"SGRS_{date}_S_01.nc"


def find(folder, date: str | None = None) -> LevelOneFile:
    """The SGRS file of a folder and its subfolders; of several days the one wanted.

    Parameters
    ----------
    folder : path
    date : YYYY-MM-DD, or None where there is only one
    """
    found = {(file.date, file.release): file for file in inventory(folder) if date in (None, file.date)}
    if not found:
        refuse(
            folder,
            f"no SGRS file{f' of {date}' if date else ''}",
            "SGRS_YYYY-MM-DD_S_01.nc",
            "Check --data.",
            NoDataError,
        )
    if len({day for day, _ in found}) > 1:
        refuse(folder, f"SGRS files of {', '.join(sorted({d for d, _ in found}))}", "one day", "Give --date.")
    return found[max(found)]


def inventory(folder) -> list[LevelOneFile]:
    """All SGRS files of a folder and its subfolders."""
    folder = Path(folder)
    if not folder.is_dir():
        refuse(folder, "no folder", "a folder with an SGRS file", "Check --data.")
    matches = [(path, NAME.fullmatch(path.name)) for path in sorted(folder.rglob("*.nc"))]
    return [LevelOneFile(path, None, **match.groupdict()) for path, match in matches if match]


def other_file(path, kind: str, date: str) -> LevelOneFile:
    """A gravity field or a truth as a file that a stage can read.

    Parameters
    ----------
    path : path; kind : "GFC" or "TRUTH"; date : YYYY-MM-DD of the day it is used for
    """
    return LevelOneFile(Path(path), None, kind, "S", date, "01")


def read(file: LevelOneFile, truth: bool = False):
    """Content of a file, checked.

    Parameters
    ----------
    file : LevelOneFile
    truth : the drag has to be there too

    Returns
    -------
    observed : Dataset, "ingest"

    Raises
    ------
    ProductError : not a netCDF file, a variable or unit is missing or wrong, another day
    """
    try:
        unpacked.check_netcdf(file.path)
        content = netcdf.from_bytes(Path(file.path).read_bytes())
    except unpacked.DAMAGED as reason:
        refuse(file.path, f"no readable netCDF file ({reason})", "an SGRS file", "Fetch the file again.")
    wanted = VARIABLES | (DRAG if truth else {})
    if "time" not in content:
        refuse(file.path, "no variable time", "time in GPS seconds", REPAIR)
    sizes = WIDTHS | {"time": content["time"].size, "sensor": _sensors(content, file)}
    for name, (dims, unit, _) in wanted.items():
        _check(content, file, name, (unit, tuple(sizes[dim] for dim in dims)))
    alone = {name: content[name].values.astype(float) for name, (dims, _, _) in wanted.items() if "time" not in dims}
    along = {name: content[name].values.astype(float) for name in wanted if name not in alone}
    for name, limit in BEYOND.items():
        along[name] = np.where((np.abs(along[name]) < limit).all(axis=1, keepdims=True), along[name], np.nan)
    time, along = epochs.in_order(content["time"].values.astype(float), along)
    epochs.check_day(time, file.path, file.date)
    values = {name: (dims, (along | alone)[name]) for name, (dims, _, _) in wanted.items()}
    return _labelled(values, time, wanted, {"origin": origin.of_file(file)})


def sensor_positions(file: LevelOneFile) -> np.ndarray:
    """Places of the test masses, (1 or 2, 3) m, without reading the rest."""
    try:
        with netcdf.opened(file.path) as content:
            return np.asarray(content["sensor_position"][...], dtype=float)
    except (*unpacked.DAMAGED, IndexError) as reason:
        return refuse(file.path, f"no sensor_position ({reason})", "an SGRS file", REPAIR)


def write(path, columns: Mapping) -> Path:
    """Write a file that says it is simulated; reading gives the same numbers.

    Parameters
    ----------
    path : file
    columns : {"time" (n,) s, and VARIABLES}; with "drag" it is a file of truth
    """
    wanted = VARIABLES | (DRAG if "drag" in columns else {})
    values = {name: (dims, np.asarray(columns[name], dtype=float)) for name, (dims, _, _) in wanted.items()}
    made = _labelled(values, np.asarray(columns["time"], dtype=float), wanted, origin.LABELS)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    netcdf.write(product.settled(made), Path(path))
    return Path(path)


def _labelled(values, time, wanted, said):
    """Dataset with units and meanings."""
    import xarray as xr

    data = {n: (*entry, {"units": wanted[n][1], "long_name": wanted[n][2]}) for n, entry in values.items()}
    attrs = {"satellite": "S-GRS", "product": "SGRS", "time_scale": "GPS"} | said
    return xr.Dataset(data, {"time": ("time", time, product.TIME)}, attrs)


def _sensors(content, file):
    """Number of sensors, one or two."""
    shape = content["sensor_position"].shape if "sensor_position" in content else (0,)
    if shape[0] not in (1, 2):
        refuse(file.path, f"{shape[0]} sensors", "sensor_position of one or two", REPAIR)
    return shape[0]


def _check(content, file, name, expected):
    """A variable, its unit and shape."""
    unit, shape = expected
    if name not in content:
        refuse(file.path, f"no variable {name}", f"{name} in {unit}", REPAIR)
    found = str(content[name].attrs.get("units", "none"))
    if found != unit:
        refuse(file.path, f"{name} in {found}", f"{name} in {unit}", "Convert it, or correct its units.")
    if content[name].shape != shape:
        refuse(file.path, f"{name} of shape {content[name].shape}", str(shape), REPAIR)
