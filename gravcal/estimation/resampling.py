"""Linear operators that low-pass and resample, straight lines and means; data and model columns go through the same."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import i0

from gravcal.errors import refuse


@dataclass(frozen=True)
class Resampler:
    """Banded linear operator from input samples to output epochs."""

    time: np.ndarray  #: (m,) s, output epochs
    start: np.ndarray  #: (m,) int, first input sample used by each output
    weights: np.ndarray  #: (m, k) 1, weights of the k inputs from `start` on, summing to one
    valid: np.ndarray  #: (m,) bool, no missing or flagged input inside the support

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Samples (n, ...) at the input epochs through the operator, (m, ...) in the same unit; NaN where not valid."""
        columns = np.asarray(columns, dtype=float)
        flat = np.ascontiguousarray(columns.reshape(columns.shape[0], -1))
        return _applied(self.start, self.weights, self.valid, flat).reshape(self.time.shape + columns.shape[1:])


def lowpass_resampler(
    time_in: np.ndarray, good: np.ndarray, time_out: np.ndarray, *, lowpass_hz: float, half_width_s: float
) -> Resampler:
    """Windowed-sinc low-pass of inputs (n,) s, increasing, at output epochs (m,) s; half amplitude at `lowpass_hz`.

    Weights follow h(s) = sinc(2 fc s) times a Kaiser window on |s| <= half width, s = t_in - t_out, scaled to unit
    sum, so a constant passes unchanged. Input epochs may jitter; an output whose support holds a gap (a step longer
    than 1.5 median steps), a sample that is not good (n,), or an end of the data is not valid.
    """
    time_in, time_out = np.asarray(time_in, float), np.asarray(time_out, float)
    longest = 1.5 * np.median(np.diff(time_in))
    count = time_in.size
    width = min(int(np.ceil(3 * half_width_s / longest)) + 2, count)
    begin, end = time_out - half_width_s, time_out + half_width_s
    first = np.searchsorted(time_in, begin)
    last = np.minimum(np.searchsorted(time_in, end, side="right"), first + width) - 1
    missing = np.cumsum(np.append(0, ~np.asarray(good, dtype=bool)))
    gaps = np.cumsum(np.diff(time_in, prepend=time_in[0]) > longest)
    start, low, high = np.minimum(first, count - width), np.minimum(first, count - 1), np.maximum(last, 0)
    valid = (last >= first) & (missing[last + 1] == missing[first]) & (gaps[high] == gaps[low])
    valid &= (time_in[low] - begin < longest) & (end - time_in[high] < longest)
    lag = time_in[start[:, None] + np.arange(width)] - time_out[:, None]
    window = i0(5.0 * np.sqrt(np.maximum(1 - (lag / half_width_s) ** 2, 0.0)))
    weights = np.where(np.abs(lag) <= half_width_s, np.sinc(2 * lowpass_hz * lag) * window, 0.0)
    total = weights.sum(axis=1, keepdims=True)
    weights /= np.where(total > 0, total, 1.0)
    return Resampler(time_out, start, weights, valid & (weights != 0).any(axis=1))


def operator_for(time, good, start: float, stop: float, lowpass_hz: float, half_width_s: float, step_s: float):
    """`lowpass_resampler` of samples (n,) of an arc, start to stop, to a grid of step_s, support inside; s and Hz."""
    if lowpass_hz * step_s > 0.5:
        refuse("lowpass_hz", f"{lowpass_hz:g} Hz", f"at most 1/(2 step_s), {0.5 / step_s:g} Hz", "Lower it or step_s.")
    grid = np.arange(np.ceil((start + half_width_s) / step_s) * step_s, stop - half_width_s, step_s)
    return lowpass_resampler(time, good, grid, lowpass_hz=lowpass_hz, half_width_s=half_width_s)


def lines_between(at: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Linear interpolation (k, m) of samples (n, m) at times (n,) to epochs at (k,), column by column."""
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)


def on_even_grid(time: np.ndarray, step: float, values: np.ndarray) -> np.ndarray:
    """Values (n, ...) at times (n,) on an even grid (k, ...) from the first epoch to the last, NaN where missing."""
    index = np.rint((time - time[0]) / step).astype(int)
    grid = np.full((index[-1] + 1, *values.shape[1:]), np.nan)
    grid[index] = values
    return grid


def bin_means(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (b, ...) over bins of values (n, ...), NaN where a bin is empty, and number of samples in each (b,).

    Samples that are NaN are left out; times (n,) s increase, edges are (b + 1,) s.
    """
    inside = (time >= edges[0]) & (time < edges[-1])
    flat = np.asarray(values, dtype=float).reshape(time.size, math.prod(np.shape(values)[1:]))
    use = inside & np.isfinite(flat).all(axis=1)
    index = np.searchsorted(edges, time[use], side="right") - 1
    count = np.bincount(index, minlength=edges.size - 1)
    total = np.stack([np.bincount(index, column, edges.size - 1) for column in flat[use].T], axis=1)
    mean = total / np.where(count > 0, count, np.nan)[:, None]
    return mean.reshape(edges.size - 1, *np.shape(values)[1:]), count


@njit(cache=True)
def _applied(start, weights, valid, columns):
    """Weighted sums (m, q) of rows of columns (n, q), four at once; rows of zero weight at the ends may be NaN."""
    out = np.full((start.size, columns.shape[1]), np.nan)
    for j in range(start.size):
        if not valid[j]:
            continue
        row = out[j]
        row[:] = 0.0
        first, last = 0, weights.shape[1]
        while weights[j, first] == 0.0:
            first += 1
        while weights[j, last - 1] == 0.0:
            last -= 1
        for k in range(first, last - 3, 4):
            w, x, y, z = weights[j, k], weights[j, k + 1], weights[j, k + 2], weights[j, k + 3]
            at = start[j] + k
            one, two, three, four = columns[at], columns[at + 1], columns[at + 2], columns[at + 3]
            for c in range(row.size):
                row[c] += w * one[c] + x * two[c] + y * three[c] + z * four[c]
        for k in range(last - (last - first) % 4, last):
            w, one = weights[j, k], columns[start[j] + k]
            for c in range(row.size):
                row[c] += w * one[c]
    return out
