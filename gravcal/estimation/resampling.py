"""One linear operator that low-passes and resamples; data and every model column go through the same one."""

import functools
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.special import i0

#: Intervals of the kernel's table; a cubic through four values is then exact to 3e-15 of its peak.
INTERVALS = 16384


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
        out = _applied(self.start, self.weights, self.valid, flat)
        return out.reshape(self.time.shape + columns.shape[1:])


def lowpass_resampler(
    time_in: np.ndarray, good: np.ndarray, time_out: np.ndarray, *, lowpass_hz: float, half_width_s: float
) -> Resampler:
    """Windowed-sinc low-pass of inputs (n,) s, increasing, at output epochs (m,) s; half amplitude at `lowpass_hz`.

    Weights follow h(s) = sinc(2 fc s) times a Kaiser window on |s| <= half width, s = t_in - t_out, scaled to unit
    sum, so a constant passes unchanged. Input epochs may jitter; an output whose support holds a gap (a step longer
    than 1.5 median steps), a sample that is not good (n,), or an end of the data is not valid.
    """
    time_in, time_out = (np.array(time, dtype=float, order="C") for time in (time_in, time_out))
    good = np.array(good, order="C")  # copies: numba compiles once more for each array that is read-only
    step = float(np.median(np.diff(time_in)))
    width = int(np.ceil(2 * half_width_s / step)) + 2
    width = min(width, time_in.size)
    start, _, valid = _band(time_in, good, time_out, half_width_s, 1.5 * step, width)
    cubics = _cubics(float(lowpass_hz), float(half_width_s))
    weights = _weights(time_in, time_out, start, width, float(half_width_s), cubics)
    return Resampler(time_out, start, weights, valid & (weights != 0).any(axis=1))


def operator_for(time, good, start: float, stop: float, lowpass_hz: float, half_width_s: float, step_s: float):
    """Low-pass and resampling of samples (n,) s of an arc, its support never beyond the ends; Hz and s."""
    begin = np.ceil((start + half_width_s) / step_s) * step_s
    grid = np.arange(begin, stop - half_width_s, step_s)
    return lowpass_resampler(time, good, grid, lowpass_hz=lowpass_hz, half_width_s=half_width_s)


@functools.lru_cache(maxsize=4)
def _cubics(lowpass_hz, half_width_s):
    """Kernel h(s) on 0 <= s <= half width, as one cubic for each interval, (INTERVALS, 4)."""
    share = np.arange(INTERVALS + 1) / INTERVALS
    inner = np.sinc(2 * lowpass_hz * half_width_s * share) * i0(5.0 * np.sqrt(1 - share**2))
    beyond = inner[-4:] @ [-1.0, 4.0, -6.0, 4.0]  # so that the last cubic goes through the last four values
    values = np.concatenate([inner[1:2], inner, [beyond]])  # h is even
    before, here, after, far = values[:-3], values[1:-2], values[2:-1], values[3:]
    first = after - before / 3 - here / 2 - far / 6
    second = (before + after) / 2 - here
    third = (far - before) / 6 + (here - after) / 2
    return np.stack([here, first, second, third], axis=1)


@njit(cache=True)
def _applied(start, weights, valid, columns):
    """Weighted sums (m, q) of rows, four rows at once; what lies beyond the weights may be missing."""
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


@njit(cache=True)
def _weights(time_in, time_out, start, width, half_width, cubics):
    """Weights (m, width) of unit sum from the cubics of the kernel."""
    found = np.zeros((time_out.size, width))
    scale = cubics.shape[0] / half_width
    for j in range(time_out.size):
        total = 0.0
        for k in range(width):
            lag = abs(time_in[start[j] + k] - time_out[j])
            if lag > half_width:
                continue
            at = lag * scale
            i = min(int(at), cubics.shape[0] - 1)
            at -= i
            found[j, k] = cubics[i, 0] + at * (cubics[i, 1] + at * (cubics[i, 2] + at * cubics[i, 3]))
            total += found[j, k]
        if total > 0:
            found[j] /= total
    return found


@njit(cache=True)
def _band(time_in, good, time_out, half_width, longest_step, width):
    """First input of each output, how many it has (m,), and whether none is missing or bad."""
    start = np.zeros(time_out.size, dtype=np.int64)
    count = np.zeros(time_out.size, dtype=np.int64)
    valid = np.zeros(time_out.size, dtype=np.bool_)
    first = 0
    for j in range(time_out.size):
        while first < time_in.size and time_in[first] < time_out[j] - half_width:
            first += 1
        last = first
        ok = True
        while last < time_in.size and time_in[last] <= time_out[j] + half_width and last - first < width:
            ok = ok and good[last]
            if last > first and time_in[last] - time_in[last - 1] > longest_step:
                ok = False
            last += 1
        start[j] = min(first, max(time_in.size - width, 0))
        count[j] = last - first
        reaches = (
            first < time_in.size
            and last > first
            and time_in[first] - (time_out[j] - half_width) < longest_step
            and (time_out[j] + half_width) - time_in[last - 1] < longest_step
        )
        valid[j] = ok and reaches
    return start, count, valid
