"""Variables of a product file, and series of them reduced to the resolution of the screen; files are only read.

A column is read once and kept as long as it is looked at. Every peak of the data is drawn: a pixel shows the range of
all samples it stands for. Gaps stay gaps.
"""

import functools
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import welch

from gravcal.report.figures import HANN, opened
from gravcal.report.plain import gps_text
from gravcal.store import product

BINS = 1500  # ranges across the screen; each is drawn as its lowest and highest value
GAP = 4.0  # a step longer than this many typical ones is not drawn as a line
SEGMENT = 65536  # samples of one segment of a spectrum, at most
LONGEST = 4_000_000  # samples of a spectrum or difference, at most
TIME_UNITS = "seconds since 2000-01-01 12:00:00"
FIRST_EPOCH_S = 3e7  # a value in seconds above this, one year, is no length but GPS time: no record is from before 2001
UNIX_OF_EPOCH_S = 946728000.0  # 2000-01-01 12:00:00 in seconds past 1970-01-01, both without leap seconds
SHOWN = 400  # values of a small variable that a table shows, and series of a large one that can be chosen


class Missing(LookupError):
    """Raised for what cannot be shown: an unknown product or variable, or more samples than a table holds."""


@dataclass(frozen=True)
class Variable:
    """One variable of a product."""

    name: str
    dims: tuple[str, ...]  #: names of its dimensions
    shape: tuple[int, ...]  #: lengths
    dtype: str  #: name of its type; "text" for names
    attributes: dict
    axis: int | None  #: number of the dimension that a plot runs along, None for one without dimensions
    columns: tuple[str, ...]  #: label of each series that a plot can draw: ``x``, ``y``, ``z`` or ``0``, ``1``, ...

    @property
    def size(self) -> int:
        """Number of values."""
        return int(np.prod(self.shape))

    @property
    def plottable(self) -> bool:
        """True if it has more than one number along an axis."""
        return self.axis is not None and self.dtype != "text" and self.shape[self.axis] > 1

    @property
    def units(self) -> str:
        """Unit, empty where the file says none."""
        return str(self.attributes.get("units", ""))


@functools.lru_cache(maxsize=256)
def listed(path: Path) -> dict[str, Variable]:
    """{name: Variable} of a product file, coordinates first; it never changes, so they are read once."""
    with product.opened(path) as file:
        names = sorted(file.variables, key=lambda name: (name not in file.dimensions, name))
        return {name: _variable(file, name) for name in names}


@functools.lru_cache(maxsize=1024)
def is_time(path: Path, name: str) -> bool:
    """True if a variable holds GPS seconds: by its unit, or in s with values over FIRST_EPOCH_S."""
    variable = listed(path)[name]
    if variable.units != "s" or not (variable.dtype.startswith("float") or name == "gps_time"):
        return variable.units == TIME_UNITS
    with product.opened(path) as file:
        some = np.asarray(file.variables[name][tuple(slice(SHOWN) for _ in variable.dims)])
    return bool(np.isfinite(some).any() and np.nanmin(some) > FIRST_EPOCH_S)


def coordinate(path, variable):
    """(name, kind, label) of the coordinate that a variable is plotted against; name "" for the sample number.

    Kind: "time" (GPS s), "value", or "index" (number of the sample).
    """
    name = variable.dims[variable.axis]
    axis = listed(path).get(name)
    if axis is None or axis.dtype == "text" or axis.shape != (variable.shape[variable.axis],):
        return "", "index", f"{name} (number)"
    if is_time(path, name):
        return name, "time", "GPS time"
    return name, "value", f"{axis.attributes.get('long_name', name)} ({axis.units or '1'})"


@functools.lru_cache(maxsize=8)
def read(path: Path, name: str, number: int = 0) -> np.ndarray:
    """Samples (n,) of a series of a variable, by its number, as floats; products never change, so the last stay."""
    variable = listed(path)[name]
    index = list(np.unravel_index(number, np.delete(variable.shape, variable.axis)))
    index.insert(variable.axis, slice(None))
    with product.opened(path) as file:
        return np.asarray(file[name][tuple(index)], dtype=float)


def table(path, variable):
    """[(labels of the indices, value as text, calendar form if GPS seconds else "")] of the first SHOWN values."""
    with product.opened(path) as file:
        values = np.asarray(file.variables[variable.name][...])
        labels = [_labels(file, name, size) for name, size in zip(variable.dims, variable.shape, strict=True)]
    timed, shown = is_time(path, variable.name), values.ravel()[:SHOWN]
    texts = [(f"{t:.3f}", gps_text(t, 3)) if timed and np.isfinite(t) else (_text(t), "") for t in shown]
    return [(" ".join(where), *text) for where, text in zip(itertools.product(*labels), texts, strict=False)]


def _variable(file, name):
    """Variable of that name in an open netCDF4 file."""
    node = file.variables[name]
    dims, shape = tuple(node.dimensions), tuple(int(size) for size in node.shape)
    times = [number for number, one in enumerate(dims) if one == "time" or one.startswith("time_")]
    axis = times[0] if times else int(np.argmax(shape)) if dims else None  # of time, else the longest
    columns = ()
    if axis is not None and getattr(node.dtype, "kind", "O") in "iuf":
        others = (values[:axis] + values[axis + 1 :] for values in (dims, shape))
        across = [_labels(file, *one) for one in zip(*others, strict=True)]
        columns = tuple(" ".join(part) for part in itertools.islice(itertools.product(*across), SHOWN))
    attributes = {key: _plain(value) for key, value in product.attributes(node).items() if not key.startswith("_")}
    return Variable(name, dims, shape, _type(node.dtype), attributes, axis, columns)


def _labels(file, dimension, size):
    """Labels (at most SHOWN, or of a text coordinate all) along a dimension: its texts, x y z, or numbers."""
    node = file.variables.get(dimension)
    if node is not None and _type(node.dtype) == "text":
        return [_text(value) for value in np.asarray(node[...])]
    if size == 3 and dimension.split("_")[0] in ("axis", "xyz", "component"):
        return ["x", "y", "z"]
    return [str(number) for number in range(min(size, SHOWN))]


def _type(dtype):
    """Name of a type, "float64"; "text" for strings."""
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


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of a series against its coordinate."""

    #: x, y: (n,) coordinate, in order, and value
    x: np.ndarray
    y: np.ndarray

    @functools.cached_property
    def step(self) -> float:
        """Median step of the coordinate."""
        return _typical(self.x)

    def filled(self) -> float:
        """Share (0 to 1) of the coordinate's span covered by samples: their number times the typical step over it."""
        span = self.x[-1] - self.x[0]
        return 1.0 if self.x.size < 4 or span <= 0 else min(1.0, self.x.size * self.step / span)


@functools.lru_cache(maxsize=8)
def series(path: Path, name: str, number: int, along: str) -> Series:
    """A series of a variable, by its number, against a coordinate, or the number of the sample where that is ""."""
    values = read(path, name, number)
    return Series(read(path, along) if along else np.arange(float(values.size)), values)


def view(whole, start=None, stop=None, bins=BINS):
    """Points x, y (m,) to draw of a Series between two values of the coordinate, by default all: `bins` with extremes.

    There are at most four for each bin; y is NaN where the line breaks.
    """
    part = _inside(whole.x, start, stop)
    x, y = whole.x[part], whole.y[part]
    if x.size > 2 * bins:  # lowest and highest value of each bin, at its first coordinate; none reaches over a gap
        gaps = np.flatnonzero(np.diff(x) > GAP * whole.step) + 1
        starts = np.linspace(0, x.size, bins, endpoint=False).astype(int)
        starts = np.unique(np.concatenate([starts, gaps[:bins]]))
        y = np.column_stack([np.fmin.reduceat(y, starts), np.fmax.reduceat(y, starts)]).ravel()
        x = np.repeat(x[starts], 2)
    return opened(x, y, GAP * _typical(x)) if x.size > 2 else (x, y)


def samples(whole, start=None, stop=None, most=LONGEST):
    """Samples x, y (n,) of a Series between two values of the coordinate; `Missing` if more than `most`."""
    inside = _inside(whole.x, start, stop, 0)
    if inside.stop - inside.start > most:
        raise Missing(f"{inside.stop - inside.start:,} samples: zoom in to {most:,} at most, or take product.nc")
    return whole.x[inside], whole.y[inside]


def difference(one, other, shift=0.0):
    """First Series minus the second at the samples x, y (n,) of the first that both cover, none without overlap.

    The second is interpolated linearly; the shift is added to its coordinate.
    """
    x, y = one.x[:LONGEST], one.y[:LONGEST]
    u, v = other.x[:LONGEST] + shift, other.y[:LONGEST]
    common = (x >= u[0] - 1e-9 * abs(u[0])) & (x <= u[-1] + 1e-9 * abs(u[-1]))
    x, y = x[common], y[common]
    if x.size == u.size and np.allclose(x, u, rtol=0, atol=1e-7):
        return x, y - v
    right = np.clip(np.searchsorted(u, x), 1, max(u.size - 1, 1))
    bridged = (u[right] - u[right - 1] > GAP * _typical(u)) if u.size > 1 else np.zeros(x.size, bool)
    return x, np.where(bridged, np.nan, y - np.interp(x, u, v))


def spectrum(whole):
    """Amplitude spectral density of the longest even stretch without gaps (Welch, Hann window, mean and slope removed).

    Returns frequency (m,), Hz where the coordinate is in seconds; density (m,), unit Hz-1/2; text on the method.
    """
    x, y = whole.x[:LONGEST], whole.y[:LONGEST]
    uneven, known = np.abs(np.diff(x) / _typical(x) - 1) > 0.01, np.isfinite(y)
    cuts = np.flatnonzero(uneven | ~known[1:] | ~known[:-1]) + 1
    edges = np.concatenate([[0], cuts, [x.size]])
    first, last = max(itertools.pairwise(edges.tolist()), key=lambda ends: ends[1] - ends[0])
    count = last - first
    if count < 16:
        return np.empty(0), np.empty(0), "no even stretch of 16 samples"
    step = (x[last - 1] - x[first]) / (count - 1)
    length = min(SEGMENT, max(16, count // 4 if count > 1024 else count))
    frequency, power = welch(y[first:last], 1 / step, "hann", length, detrend="linear")
    number = (count - length // 2) // (length - length // 2)
    said = f"{HANN} of {length} samples, mean power of {number} that overlap by half (Welch), mean"
    said += f" and slope removed, step {step:.6g} s"
    return frequency[1:], np.sqrt(power[1:]), said


def _inside(x, start, stop, more=1):
    """Slice of start <= x <= stop in increasing x (n,), with ``more`` samples at each end: lines leave the view."""
    first = 0 if start is None else max(int(np.searchsorted(x, start)) - more, 0)
    last = x.size if stop is None else min(int(np.searchsorted(x, stop, side="right")) + more, x.size)
    return slice(first, max(last, first))


def _typical(x):
    """Median of the positive steps of a coordinate (n,), from about 100,000 of them at most; inf without."""
    some = np.arange(0, x.size - 1, max(1, x.size // 100_000))
    steps = x[some + 1] - x[some]
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else np.inf
