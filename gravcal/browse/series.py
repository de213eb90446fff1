"""A column at the resolution of the screen.

The first look at a column reads it once, piece by piece, and keeps the lowest and highest value of every 64
samples; from then on a wide view needs no file, and a narrow one reads only what it shows. Every peak of the data is
drawn: a pixel shows the range of all samples it stands for. Gaps stay gaps.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravcal.browse import variables

BLOCK = 64
PIECE = BLOCK * 16384
PART = BLOCK * 1024  # samples that stay in the processor's cache
BINS = 1500  # ranges across the screen; each is drawn as its lowest and highest value
GAP = 4.0  # a step longer than this many typical ones is not drawn as a line
SEGMENT = 65536  # samples of one segment of a spectrum, at most
LONGEST = 4_000_000  # samples of a spectrum or difference, at most


@dataclass(frozen=True)
class Overview:
    """Coarse view of a column, and how to read it finely.

    Attributes
    ----------
    size : samples
    x : (m,) coordinate of the first sample of each block
    end : coordinate of the last sample
    low, high : (m,) lowest and highest value of each block, NaN where it holds none
    finely : function of (start, stop) that returns x and y of these samples
    """

    size: int
    x: np.ndarray
    end: float
    low: np.ndarray
    high: np.ndarray
    finely: Callable

    def filled(self) -> float:
        """Share of the coordinate's span in which samples lie, by the typical length of a block."""
        span = self.end - self.x[0]
        return 1.0 if self.x.size < 4 or span <= 0 else min(1.0, self.size * _typical(self.x) / (BLOCK * span))


@functools.lru_cache(maxsize=64)
def overview(column, coordinate):
    """Overview of a column of a product; products never change, so it is kept.

    Parameters
    ----------
    column : variables.Column
    coordinate : variables.Column or None, then the number of the sample stands for it
    """
    low, high = _of_column(column)
    x, end = _coarse(coordinate) if coordinate else (np.arange(0.0, column.size, BLOCK), column.size - 1.0)

    def finely(start, stop):
        own = variables.read(coordinate, start, stop) if coordinate else np.arange(start, stop, dtype=float)
        return own, variables.read(column, start, stop)

    return Overview(column.size, x, end, low, high, finely)


def of_arrays(x, y):
    """Overview of a series in memory.

    Parameters
    ----------
    x, y : (n,)
    """
    low, high = _extremes(y)
    return Overview(y.size, x[::BLOCK], float(x[-1]), low, high, lambda start, stop: (x[start:stop], y[start:stop]))


def view(whole, start=None, stop=None, bins=BINS):
    """Points to draw between two values of the coordinate, at most four for each bin.

    Parameters
    ----------
    whole : Overview
    start, stop : of the coordinate; by default all
    bins : int

    Returns
    -------
    x, y : (m,) NaN in y where the line breaks
    """
    first, last = _blocks(whole, start, stop)
    if last - first > bins:
        x, low, high = whole.x[first:last], whole.low[first:last], whole.high[first:last]
        return _broken(*_ranges(x, low, high, bins))
    x, y = whole.finely(first * BLOCK, min(last * BLOCK, whole.size))
    inside = slice(*_inside(x, start, stop))
    x, y = x[inside], y[inside]
    return _broken(*_ranges(x, y, y, bins)) if x.size > 2 * bins else _broken(x, y)


def difference(one, other, shift=0.0):
    """First series minus the second, at the first one's samples, the second interpolated linearly between its own.

    Parameters
    ----------
    one, other : Overview
    shift : added to the second one's coordinate

    Returns
    -------
    x, y : (n,) samples that both cover; empty where they do not overlap
    """
    x, y = one.finely(0, min(one.size, LONGEST))
    u, v = other.finely(0, min(other.size, LONGEST))
    u = u + shift
    common = (x >= u[0] - 1e-9 * abs(u[0])) & (x <= u[-1] + 1e-9 * abs(u[-1]))
    x, y = x[common], y[common]
    if x.size == u.size and np.allclose(x, u, rtol=0, atol=1e-7):
        return x, y - v
    near = np.clip(np.searchsorted(u, x), 1, max(u.size - 1, 1))
    bridged = (u[near] - u[near - 1] > GAP * _typical(u)) if u.size > 1 else np.zeros(x.size, bool)
    return x, np.where(bridged, np.nan, y - np.interp(x, u, v))


def spectrum(whole):
    """Amplitude spectral density of the longest even stretch without gaps (Welch, Hann, mean and slope removed).

    Parameters
    ----------
    whole : Overview

    Returns
    -------
    frequency : (m,) Hz where the coordinate is in seconds
    density : (m,) unit per square root of Hz
    said : str, what was used
    """
    from scipy.signal import welch

    x, y = whole.finely(0, min(whole.size, LONGEST))
    first, last = _longest_even(x, y)
    count = last - first
    if count < 16:
        return np.empty(0), np.empty(0), "no even stretch of 16 samples"
    step = (x[last - 1] - x[first]) / (count - 1)
    length = min(SEGMENT, max(16, count // 4 if count > 1024 else count))
    frequency, power = welch(y[first:last], 1 / step, "hann", length, detrend="linear")
    said = f"Welch, Hann, {2 * (count // length) - 1} segments of {length} samples, step {step:.6g} s"
    return frequency[1:], np.sqrt(power[1:]), said


def _of_column(column):
    """Lowest and highest of every block of a column."""
    parts = [_extremes(piece) for piece in variables.pieces(column, PIECE)]
    return tuple(np.concatenate([part[side] for part in parts]) for side in (0, 1))


def _extremes(values):
    """Lowest and highest of every block, NaN where all are."""
    low, high = (np.empty(-(-values.size // BLOCK)) for _ in range(2))
    for start in range(0, values.size, PART):
        part = values[start : start + PART]
        block, whole = start // BLOCK, part.size // BLOCK
        across = np.ascontiguousarray(part[: whole * BLOCK].reshape(-1, BLOCK).T)
        np.fmin.reduce(across, axis=0, out=low[block : block + whole])
        np.fmax.reduce(across, axis=0, out=high[block : block + whole])
    if values.size % BLOCK:
        rest = values[values.size // BLOCK * BLOCK :]
        low[-1], high[-1] = np.fmin.reduce(rest), np.fmax.reduce(rest)
    return low, high


@functools.lru_cache(maxsize=32)
def _coarse(coordinate):
    """Every 64th value of a coordinate, and the last one."""
    kept, last = [], np.nan
    for piece in variables.pieces(coordinate, PIECE):
        kept.append(piece[::BLOCK].copy())
        last = piece[-1]
    return np.concatenate(kept), float(last)


def _blocks(whole, start, stop):
    """Blocks that a view touches."""
    first = 0 if start is None else int(np.searchsorted(whole.x, start, side="right")) - 1
    last = whole.x.size if stop is None else int(np.searchsorted(whole.x, stop, side="left")) + 1
    first = min(max(first, 0), whole.x.size - 1)
    return first, min(max(last, first + 1), whole.x.size)


def _inside(x, start, stop):
    """Samples of a view, with one more at each side so that lines run out of the picture."""
    first = 0 if start is None else max(int(np.searchsorted(x, start)) - 1, 0)
    last = x.size if stop is None else min(int(np.searchsorted(x, stop, side="right")) + 1, x.size)
    return first, max(last, first)


def _ranges(x, low, high, bins):
    """Lowest and highest value of each bin, at its first coordinate, lowest first; no bin reaches over a gap."""
    starts = np.linspace(0, x.size, bins, endpoint=False).astype(int)
    gaps = np.flatnonzero(np.diff(x) > GAP * _typical(x)) + 1
    starts = np.unique(np.concatenate([starts, gaps[:bins]]))
    pairs = np.column_stack([np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)])
    return np.repeat(x[starts], 2), pairs.ravel()


def _broken(x, y):
    """Series with NaN put in where the coordinate jumps, so that no line bridges a gap."""
    if x.size < 3:
        return x, y
    steps = np.diff(x)
    at = np.flatnonzero(steps > GAP * _typical(x)) + 1
    return np.insert(x, at, x[at - 1]), np.insert(y, at, np.nan)


def _typical(x):
    """Typical step of a coordinate; those of zero length do not count."""
    steps = np.diff(x)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else np.inf


def _longest_even(x, y):
    """Longest stretch of finite samples with equal steps."""
    if x.size < 2:
        return 0, 0
    steps = np.diff(x)
    typical = _typical(x)
    cuts = np.flatnonzero((np.abs(steps - typical) > 0.01 * typical) | ~np.isfinite(y[1:]) | ~np.isfinite(y[:-1])) + 1
    edges = np.concatenate([[0], cuts, [x.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])
