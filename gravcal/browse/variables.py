"""What a product file holds: its variables, and one column of one of them in pieces. Files are opened to read only."""

import functools
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gravcal.store import netcdf

TIME_UNITS = "seconds since 2000-01-01 12:00:00"
UNIX_OF_EPOCH_S = 946728000.0  # 2000-01-01 12:00:00 in seconds past 1970-01-01, both without leap seconds
SHOWN = 400  # values of a small variable that a table shows, and series of a large one that can be chosen


@dataclass(frozen=True)
class Variable:
    """One variable of a product.

    Attributes
    ----------
    name : str
    dims : names of its dimensions
    shape : lengths
    dtype : name of its type; "text" for names
    attributes : dict
    axis : number of the dimension that a plot runs along, None for one without dimensions
    columns : label of each series that a plot can draw: ``x``, ``y``, ``z`` or ``0``, ``1``, ...
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: str
    attributes: dict
    axis: int | None
    columns: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of values."""
        return int(np.prod(self.shape))

    @property
    def plottable(self) -> bool:
        """Whether it has numbers along an axis."""
        return self.axis is not None and self.dtype != "text" and self.shape[self.axis] > 1

    @property
    def units(self) -> str:
        """Unit, empty where the file says none."""
        return str(self.attributes.get("units", ""))


@dataclass(frozen=True)
class Column:
    """One series of a variable: where it is in the file."""

    path: Path
    variable: str
    index: tuple
    axis: int
    size: int


@functools.lru_cache(maxsize=256)
def listed(path):
    """Variables of a product; it never changes, so they are read once.

    Parameters
    ----------
    path : Path of the netCDF file

    Returns
    -------
    variables : tuple of Variable, coordinates first
    """
    with netcdf.opened(path) as file:
        names = sorted(file.variables, key=lambda name: (name not in file.dimensions, name))
        return tuple(_variable(file, name) for name in names)


def find(path, name):
    """One variable of a product by name, or None."""
    return next((one for one in listed(path) if one.name == name), None)


def column(path, variable, number):
    """One series of a variable.

    Parameters
    ----------
    path : Path
    variable : Variable, plottable
    number : int, of its columns
    """
    others = [size for axis, size in enumerate(variable.shape) if axis != variable.axis]
    index = tuple(int(i) for i in np.unravel_index(number, others)) if others else ()
    return Column(path, variable.name, index, variable.axis, variable.shape[variable.axis])


def coordinate(path, variable):
    """Column with the coordinate that a plot of this variable runs along, and its kind.

    Returns
    -------
    column : Column or None where only the number of the sample is known
    kind : "time", "value" or "index"
    label : str
    """
    name = variable.dims[variable.axis]
    found = find(path, name)
    if found is None or found.dtype == "text" or found.shape != (variable.shape[variable.axis],):
        return None, "index", f"{name} (number)"
    where = Column(path, name, (), 0, found.shape[0])
    if found.units == TIME_UNITS:
        return where, "time", "GPS time"
    return where, "value", f"{found.attributes.get('long_name', name)} ({found.units or '1'})"


def read(column, start=0, stop=None):
    """Values of a column as floats.

    Parameters
    ----------
    column : Column
    start, stop : int, samples

    Returns
    -------
    values : (n,)
    """
    with netcdf.opened(column.path) as file:
        index = list(column.index)
        index.insert(column.axis, slice(start, column.size if stop is None else stop))
        return np.asarray(file[column.variable][tuple(index)], dtype=float)


def pieces(column, length):
    """Values of a column, piece by piece.

    Parameters
    ----------
    column : Column
    length : int, samples of a piece

    Yields
    ------
    values : (length,), the last one shorter
    """
    for start in range(0, column.size, length):
        yield read(column, start, min(start + length, column.size))


def table(path, variable):
    """First values of a small variable as rows of text, each with the names of its indices."""
    with netcdf.opened(path) as file:
        values = np.asarray(file.variables[variable.name][...])
        labels = [_labels(file, name, size) for name, size in zip(variable.dims, variable.shape, strict=True)]
    texts = [_text(value) for value in values.ravel()[:SHOWN]]
    return [(" ".join(where), text) for where, text in zip(itertools.product(*labels), texts, strict=False)]


def _variable(file, name):
    """Record of one variable of an open file."""
    node = file.variables[name]
    numeric = getattr(node.dtype, "kind", "O") in "iuf"
    shape = tuple(int(size) for size in node.shape)
    axis = _long_axis(node.dimensions, shape)
    across = [
        (dim, size) for number, (dim, size) in enumerate(zip(node.dimensions, shape, strict=True)) if number != axis
    ]
    labels = itertools.product(*(_labels(file, *one) for one in across)) if numeric and axis is not None else ()
    columns = tuple(" ".join(part) for part in itertools.islice(labels, SHOWN))
    attributes = {key: _plain(value) for key, value in netcdf.attributes(node).items() if not key.startswith("_")}
    return Variable(name, tuple(node.dimensions), shape, _type(node.dtype), attributes, axis, columns)


def _long_axis(dims, shape):
    """Dimension that a plot runs along: one of time, else the longest."""
    if not dims:
        return None
    times = [axis for axis, name in enumerate(dims) if name == "time" or name.startswith("time_")]
    return times[0] if times else int(np.argmax(shape))


def _labels(file, dimension, size):
    """First names along a dimension: those of a coordinate of text, xyz, or numbers."""
    node = file.variables.get(dimension)
    if node is not None and _type(node.dtype) == "text":
        return [_text(value) for value in np.asarray(node[...])]
    if size == 3 and dimension.split("_")[0] in ("axis", "xyz", "component"):
        return ["x", "y", "z"]
    return [str(number) for number in range(min(size, SHOWN))]


def _type(dtype):
    """Name of a type for people."""
    kind = getattr(dtype, "kind", "O")
    return "text" if kind in "OSU" or dtype is str else str(dtype)


def _plain(value):
    """Attribute as text or number."""
    if isinstance(value, np.ndarray):
        return ", ".join(_text(item) for item in value.ravel())
    return _text(value) if isinstance(value, (bytes, str, np.generic)) else value


def _text(value):
    """One value as text; numbers with as many digits as they need."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.9g}"
    return str(value)
