"""Sharp lines in quiet data: found over a smooth background and taken out, so that a noise model holds none."""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.stats import chi2

BACKGROUND = 31  # frequencies over which the background is the median
LOWEST_HZ = 0.015
LIMIT = 12  # lines at most


def without_lines(
    segments: list[np.ndarray], step_s: float, level: float = 1e-4
) -> tuple[list[np.ndarray], list[tuple[int, float]]]:
    """Segments with sines of any phase and size in each taken out, where all of them together show a line.

    Parameters
    ----------
    segments : list of (n_i, axes) any unit, evenly spaced, NaN where missing
    step_s : s
    level : chance of taking a line out of noise without one, each axis

    Returns
    -------
    cleaned : list of (n_i, axes)
    found : (axis, frequency in Hz) of every line
    """
    cleaned, found = [s.copy() for s in segments], []
    length = int(np.median([np.isfinite(s[:, 0]).sum() for s in segments]))
    parts = next_fast_len(2 * length, real=True)
    lowest = int(np.ceil(LOWEST_HZ * parts * step_s))
    grid = np.arange(lowest, int(0.48 * parts)) / (parts * step_s)
    for axis in range(segments[0].shape[1]):
        for _ in range(LIMIT):
            power = _spectrum(cleaned, axis, parts)[lowest : int(0.48 * parts)]
            ratio = power / median_filter(power, BACKGROUND, mode="nearest")
            best = int(np.argmax(ratio))
            if chi2.sf(2 * len(cleaned) * ratio[best], 2 * len(cleaned)) * grid.size > level:
                break
            near = grid[best] + np.linspace(-1, 1, 41) * (grid[1] - grid[0])
            frequency = float(near[np.argmax(_power(cleaned, axis, near, step_s))])
            _take_out(cleaned, axis, frequency, step_s)
            found.append((axis, frequency))
    return cleaned, found


def _spectrum(segments, axis, parts):
    """Mean windowed power of the segments at whole multiples of the sampling frequency over ``parts``."""
    total = np.zeros(parts // 2 + 1)
    for segment in segments:
        index, values, norm = _windowed(segment[:, axis])
        folded = np.bincount(index % parts, weights=values, minlength=parts)  # longer segments come round again
        total += np.abs(np.fft.rfft(folded)) ** 2 / norm
    return total / len(segments)


def _power(segments, axis, frequency, step_s):
    """Mean windowed power of the segments at any frequencies (f,)."""
    total = np.zeros(frequency.size)
    for segment in segments:
        index, values, norm = _windowed(segment[:, axis])
        wave = np.exp(-2j * np.pi * np.outer(frequency, index * step_s))
        total += np.abs(wave @ values) ** 2 / norm
    return total / len(segments)


def _windowed(values):
    """Places of the samples that are there, these less a parabola under a Hann window, and its sum of squares."""
    index = np.flatnonzero(np.isfinite(values))
    window = np.hanning(index.size + 2)[1:-1]
    line = np.polynomial.Polynomial.fit(index, values[index], 2)(index)
    return index, window * (values[index] - line), np.sum(window**2)


def _take_out(segments, axis, frequency, step_s):
    """Best sine and cosine beside a parabola subtracted, in place."""
    for segment in segments:
        index = np.flatnonzero(np.isfinite(segment[:, axis]))
        phase = 2 * np.pi * frequency * index * step_s
        u = 2 * (index - index[0]) / max(index[-1] - index[0], 1) - 1
        columns = np.stack([np.cos(phase), np.sin(phase), np.ones(u.size), u, u**2], axis=1)
        value = np.linalg.lstsq(columns, segment[index, axis], rcond=None)[0]
        segment[index, axis] -= columns[:, :2] @ value[:2]
