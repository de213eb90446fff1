"""Daily netCDF files in layouts of our own (`daily.toml`), for missions without public data.

IS1, ATT and ORB are voltages, attitude and orbit of an inertial sensor. SGRS holds readings of one or two test masses
with attitude and orbit; its file of truth holds these without noise, and the drag. Times are GPS seconds
past 2000-01-01 12:00:00.
"""

import functools
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from datetime import date, datetime, timedelta
from pathlib import Path

import numpy as np

from gravcal.errors import NoDataError, refuse
from gravcal.io import archive
from gravcal.io.archive import LevelOneFile
from gravcal.store import product

EPOCH = datetime(2000, 1, 1, 12)
MARGIN = 120.0  # s by which a file may begin before its day
WIDTHS = {"axis": 3, "element": 4}
SENSORS = (1, 2)
BEYOND = {"position": 1e9, "velocity": 1e5}  # m, m s-1: larger values in SGRS become NaN, as no orbit of the Earth
REPAIR = "Write the file as gravcal simulate does (gravcal/io/daily.toml)."
NAME = re.compile(
    r"(?P<product>IS1|ATT|ORB|SGRS)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>[ST])_(?P<release>\d{2})\.nc"
)
VOLTAGES = ("V_x1", "V_x2", "V_x3", "V_y", "V_z1", "V_z2")
TABLES = tomllib.loads(Path(__file__).with_name("daily.toml").read_text(encoding="utf-8"))
#: Layout of each product: dimensions, unit, meaning of its variables; that of "DRAG" is added to a file of truth.
LAYOUTS = {n: {part: (tuple(dims.split()), *rest) for part, (dims, *rest) in t.items()} for n, t in TABLES.items()}
INERTIAL = ("IS1", "ATT", "ORB")


def inventory(folder) -> list[LevelOneFile]:
    """[LevelOneFile] of a folder and its subfolders, sorted by product and day; newest release only."""
    folder = Path(folder)
    if not folder.is_dir():
        refuse(folder, "no folder", "a folder with daily netCDF files", "Check --data.")
    matches = [(path, NAME.fullmatch(path.name)) for path in sorted(folder.rglob("*.nc"))]
    files = [LevelOneFile(path, None, **match.groupdict()) for path, match in matches if match]
    newest = {(one.product, one.date): one for one in sorted(files, key=lambda one: one.release)}
    return [newest[key] for key in sorted(newest)]


def days(folder, wanted: str | None = None) -> dict[str, dict[str, LevelOneFile]]:
    """{date: {"IS1", "ATT", "ORB": LevelOneFile}} of an inertial sensor, one day or all; refused if one is missing."""
    by_day: dict = {}
    for one in inventory(folder):
        if wanted in (None, one.date) and one.product in INERTIAL:
            by_day.setdefault(one.date, {})[one.product] = one
    if not by_day:
        absent, expected = f"no file{f' of {wanted}' if wanted else ''}", "IS1, ATT and ORB files of satellite T"
        refuse(folder, absent, expected, "Check --data.", NoDataError)
    for day, files in by_day.items():
        if missing := sorted(set(INERTIAL) - set(files)):
            refuse(folder, f"no {', '.join(missing)} of {day}", "IS1, ATT and ORB of each day", "Add the missing file.")
    return by_day


def sgrs_file(folder, wanted: str | None = None) -> LevelOneFile:
    """The SGRS file of a folder and its subfolders; of several days the one wanted, YYYY-MM-DD."""
    files = [one for one in inventory(folder) if one.product == "SGRS" and wanted in (None, one.date)]
    if not files:
        absent = f"no SGRS file{f' of {wanted}' if wanted else ''}"
        refuse(folder, absent, "SGRS_YYYY-MM-DD_S_01.nc", "Check --data.", NoDataError)
    if len(files) > 1:
        refuse(folder, f"SGRS files of {', '.join(one.date for one in files)}", "one day", "Give --date.")
    return files[0]


def other_file(path, kind: str, day: str) -> LevelOneFile:
    """LevelOneFile of a gravity field (kind "GFC") or truth ("TRUTH"), as input of a stage for a day YYYY-MM-DD."""
    return LevelOneFile(Path(path), None, kind, "S", day, "01")


def read(file: LevelOneFile, start: float | None = None, stop: float | None = None) -> dict[str, np.ndarray]:
    """Epochs and values of one file of an inertial sensor, or of start <= time < stop (GPS s) in it.

    {"time" (n,) s; IS1: "volts" (n, 6) V; ATT: "quaternion" (n, 4); ORB: "position" m, "velocity" m s-1}
    """
    time, values = _records(file, LAYOUTS[file.product], start, stop)
    if file.product == "IS1":
        values = {"volts": np.stack([values[name] for name in VOLTAGES], axis=1)}
    elif file.product == "ATT":
        values = {"quaternion": values["q"]}
    return {"time": time} | values


def loaders(files: Sequence[LevelOneFile]) -> list[tuple[Callable, ...]]:
    """[(read IS1, read ATT, read ORB)] of each day, functions without arguments that return the dict of `read`."""
    by_day: dict = {}
    for one in files:
        by_day.setdefault(one.date, {})[one.product] = functools.partial(read, one)
    return [tuple(day[name] for name in INERTIAL) for _, day in sorted(by_day.items())]


def between(files: Sequence[LevelOneFile]) -> list[Callable]:
    """[IS1, ATT, ORB]: functions (start, stop in GPS s) -> dict of `read` between two epochs, also across midnight."""

    def read_part(name, start, stop):  # dict of `read` of a product ("IS1" ...), all days joined
        own = sorted((one for one in files if one.product == name), key=lambda one: one.date)
        parts = [read(one, start, stop) for one in own]
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    return [functools.partial(read_part, name) for name in INERTIAL]


def read_sgrs(file: LevelOneFile, truth: bool = False):
    """Dataset "ingest" of an SGRS file, checked; with the variable of the drag if it is a file of truth."""
    layout = LAYOUTS["SGRS"] | (LAYOUTS["DRAG"] if truth else {})
    time, values = _records(file, layout)
    for name, limit in BEYOND.items():
        values[name] = np.where((np.abs(values[name]) < limit).all(axis=1, keepdims=True), values[name], np.nan)
    return _dataset(time, values, layout, {"satellite": "S-GRS", "product": "SGRS", "origin": archive.origin_of(file)})


def sensor_positions(file: LevelOneFile) -> np.ndarray:
    """Positions of the test masses in an SGRS file, (1 or 2, 3) m, without reading the rest."""
    try:
        archive.check_netcdf(file.path)
        with product.opened(file.path) as content:
            return np.asarray(content["sensor_position"][...], dtype=float)
    except (*archive.DAMAGED, IndexError) as reason:
        return refuse(file.path, f"no sensor_position ({reason})", "an SGRS file", REPAIR)


def _records(file, layout, start=None, stop=None):
    """(epochs (n,) GPS s, increasing; {name: array}) of a file between two epochs, checked by its layout.

    ProductError if it is no netCDF file, a variable or unit is missing or wrong, or the day is not that of its name.
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
    except (*archive.DAMAGED, IndexError) as reason:
        refuse(file.path, f"no readable netCDF file ({reason})", f"an {file.product} file", "Fetch the file again.")
    if time.size < 2:
        refuse(file.path, f"{time.size} epochs", "at least two with a finite time", "Fetch the file again.")
    begin = (datetime.combine(date.fromisoformat(file.date), datetime.min.time()) - EPOCH).total_seconds()
    if not begin - MARGIN <= time[0] < begin + 86400:
        first = EPOCH + timedelta(seconds=float(time[0]))
        remedy = "Check the day in the file's name, or fetch the file of that day."
        refuse(file.path, f"a first epoch of {first:%Y-%m-%d %H:%M:%S} GPS", f"one on the day {file.date}", remedy)
    return time[part], values


def _part(time, start, stop):  # slice of increasing epochs with start <= time < stop, None: without bound
    first = 0 if start is None else int(np.searchsorted(time, start))
    return slice(first, time.size if stop is None else int(np.searchsorted(time, stop)))


def _check(content, layout, file):
    """Refuse netCDF variables (content) that are missing, or of another unit or shape than the layout states."""
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
    """(epochs (m,) s, strictly increasing; {name: (m, ...)}) of records (n,) in any order.

    Those without a time are left out; of a repeated one the first is kept, NaN where the others contradict it.
    """
    finite = np.flatnonzero(np.isfinite(time))
    order = finite[np.argsort(time[finite], kind="stable")]
    is_first = np.append(True, np.diff(time[order]) > 0)[: order.size]
    epoch_index = np.cumsum(is_first) - 1
    ordered = {}
    for name, column in values.items():
        in_time = np.array(column, dtype=float)[order]
        kept = in_time[is_first]
        differs = ~np.isclose(in_time, kept[epoch_index], rtol=0, atol=0, equal_nan=True)
        kept[epoch_index[differs.any(axis=tuple(range(1, differs.ndim)))]] = np.nan
        ordered[name] = kept
    return time[order][is_first], ordered


def _dataset(time, values, layout, attributes):
    """Dataset of epochs (n,) GPS s and values {name: array}, with the units and meanings of a layout."""
    import xarray as xr

    data = {
        name: (dims, np.asarray(values[name], dtype=float), {"units": unit, "long_name": meaning})
        for name, (dims, unit, meaning) in layout.items()
    }
    times = ("time", np.asarray(time, dtype=float), product.TIME)
    return xr.Dataset(data, {"time": times}, {"time_scale": "GPS"} | attributes)


def _write(path, time, values, layout, attributes):
    """Write a netCDF file labelled as simulated; returns its Path; reading gives the same numbers."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    product.write(product.settled(_dataset(time, values, layout, attributes | archive.LABELS)), Path(path))
    return Path(path)


def write(folder, name: str, record: Mapping[str, np.ndarray]) -> list[Path]:
    """Write a record, a dict as of `read`, into one file for each day of the GPS time scale; returns their Paths."""
    time = np.asarray(record["time"], dtype=float)
    columns = record
    if name == "IS1":
        columns = dict(zip(VOLTAGES, np.asarray(record["volts"]).T, strict=True))
    elif name == "ATT":
        columns = {"q": record["quaternion"]}
    day, paths = np.floor((time + 43200.0 + 1e-6) / 86400.0), []
    for one in np.unique(day):
        inside, begins = day == one, (EPOCH + timedelta(seconds=float(one) * 86400.0 - 43200.0)).date()
        values = {part: np.asarray(columns[part])[inside] for part in LAYOUTS[name]}
        about = {"satellite": "Taiji-1", "product": name}
        paths.append(_write(Path(folder) / f"{name}_{begins}_T_01.nc", time[inside], values, LAYOUTS[name], about))
    return paths


def write_sgrs(path, columns: Mapping) -> Path:
    """Write an SGRS file: {"time" (n,) s, and the values of its layout}; with "drag" it is a file of truth."""
    layout = LAYOUTS["SGRS"] | (LAYOUTS["DRAG"] if "drag" in columns else {})
    return _write(path, columns["time"], columns, layout, {"satellite": "S-GRS", "product": "SGRS"})
