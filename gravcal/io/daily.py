"""Daily netCDF files in layouts of our own (formats.md, section 6), for missions without public data.

Times are GPS seconds past 2000-01-01 12:00:00. A layout is {variable: (dimensions, unit, meaning)}.
"""

from collections.abc import Mapping
from datetime import date, datetime, timedelta
from pathlib import Path

import numpy as np

from gravcal.errors import refuse
from gravcal.io import archive
from gravcal.io.archive import LevelOneFile
from gravcal.store import origin, product

EPOCH = datetime(2000, 1, 1, 12)
MARGIN = 120.0  # s that a file may begin before its day
WIDTHS = {"axis": 3, "element": 4}
SENSORS = (1, 2)
REPAIR = "Write the file by formats.md, section 6."


def inventory(folder, name) -> list[LevelOneFile]:
    """Files of a folder and its subfolders whose names fit a pattern with the groups of a LevelOneFile."""
    folder = Path(folder)
    if not folder.is_dir():
        refuse(folder, "no folder", "a folder with daily netCDF files", "Check --data.")
    matches = [(path, name.fullmatch(path.name)) for path in sorted(folder.rglob("*.nc"))]
    return [LevelOneFile(path, None, **match.groupdict()) for path, match in matches if match]


def read(file: LevelOneFile, layout, start: float | None = None, stop: float | None = None):
    """Epochs (n,) s, increasing, and {name: array} of a file between two epochs, in order and checked by its layout.

    ProductError where it is no netCDF file, a variable or unit is missing or wrong, or the day is another one.
    """
    try:
        archive.check_netcdf(file.path)
        with product.opened(file.path) as opened:
            content = opened.variables
            _check(content, layout, file)
            time = content["time"][:].astype(float)
            along = [name for name, (dims, _, _) in layout.items() if "time" in dims]
            values = {name: content[name][...].astype(float) for name in layout if name not in along}
            if np.isfinite(time).all() and np.all(np.diff(time) > 0):
                part = _part(time, start, stop)
                values |= {name: content[name][part].astype(float) for name in along}
            else:
                time, columns = in_order(time, {name: content[name][:] for name in along})
                part = _part(time, start, stop)
                values |= {name: column[part] for name, column in columns.items()}
    except archive.DAMAGED as reason:
        refuse(file.path, f"no readable netCDF file ({reason})", f"an {file.product} file", "Fetch the file again.")
    if time.size < 2:
        refuse(file.path, f"{time.size} epochs", "at least two with a finite time", "Fetch the file again.")
    begin = (datetime.combine(date.fromisoformat(file.date), datetime.min.time()) - EPOCH).total_seconds()
    if not begin - MARGIN <= time[0] < begin + 86400:
        first = EPOCH + timedelta(seconds=float(time[0]))
        remedy = "Check the day in the file's name, or fetch the file of that day."
        refuse(file.path, f"a first epoch of {first:%Y-%m-%d %H:%M:%S} GPS", f"one on the day {file.date}", remedy)
    return time[part], values


def _part(time, start, stop):
    """Slice between two epochs."""
    first = 0 if start is None else int(np.searchsorted(time, start))
    return slice(first, time.size if stop is None else int(np.searchsorted(time, stop)))


def _check(content, layout, file):
    """Refuse variables that are missing, or of another unit or shape than the layout says."""
    if "time" not in content:
        refuse(file.path, "no variable time", "time in GPS seconds", REPAIR)
    sizes = WIDTHS | {"time": content["time"].shape[0]}
    if "sensor_position" in layout:
        sizes["sensor"] = content["sensor_position"].shape[0] if "sensor_position" in content else 0
        if sizes["sensor"] not in SENSORS:
            refuse(file.path, f"{sizes['sensor']} sensors", "sensor_position of one or two", REPAIR)
    for name, (dims, unit, _) in layout.items():
        if name not in content:
            refuse(file.path, f"no variable {name}", f"{name} in {unit}", REPAIR)
        written = str(product.attributes(content[name]).get("units", "none"))
        if written != unit:
            refuse(file.path, f"{name} in {written}", f"{name} in {unit}", "Convert it, or correct its units.")
        shape = tuple(sizes[dim] for dim in dims)
        if content[name].shape != shape:
            refuse(file.path, f"{name} of shape {content[name].shape}", str(shape), REPAIR)


def in_order(time: np.ndarray, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Epochs (m,) s, strictly increasing, and {name: (m, ...)} of records in any order.

    Those without a time are left out; of a repeated one the first is kept, NaN where the others contradict it.
    """
    known = np.flatnonzero(np.isfinite(time))
    order = known[np.argsort(time[known], kind="stable")]
    new = np.append(True, np.diff(time[order]) > 0)[: order.size]
    place = np.cumsum(new) - 1
    ordered = {}
    for name, column in values.items():
        every = np.array(column, dtype=float)[order]
        kept = every[new]
        differs = ~np.isclose(every, kept[place], rtol=0, atol=0, equal_nan=True)
        kept[place[differs.any(axis=tuple(range(1, differs.ndim)))]] = np.nan
        ordered[name] = kept
    return time[order][new], ordered


def dataset(time, values, layout, attributes):
    """Dataset of epochs (n,) s and values by name, with units and meanings."""
    import xarray as xr

    data = {
        name: (dims, np.asarray(values[name], dtype=float), {"units": unit, "long_name": meaning})
        for name, (dims, unit, meaning) in layout.items()
    }
    attributes = {"time_scale": "GPS"} | attributes
    return xr.Dataset(data, {"time": ("time", np.asarray(time, dtype=float), product.TIME)}, attributes)


def write(path, time, values, layout, attributes):
    """Write a file that says that it is simulated; reading gives the same numbers."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    product.write(product.settled(dataset(time, values, layout, attributes | origin.LABELS)), Path(path))
    return Path(path)
