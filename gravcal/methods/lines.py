"""Sharp lines in quiet data: found over a smooth background and taken out, so that a noise model holds none."""

from __future__ import annotations

import numpy as np
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
    grid = np.arange(LOWEST_HZ, 0.48 / step_s, 1 / (2 * length * step_s))
    for axis in range(segments[0].shape[1]):
        for _ in range(LIMIT):
            power = _power(cleaned, axis, grid, step_s)
            ratio = power / median_filter(power, BACKGROUND, mode="nearest")
            best = int(np.argmax(ratio))
            if chi2.sf(2 * len(cleaned) * ratio[best], 2 * len(cleaned)) * grid.size > level:
                break
            near = grid[best] + np.linspace(-1, 1, 41) * (grid[1] - grid[0])
            frequency = float(near[np.argmax(_power(cleaned, axis, near, step_s))])
            _take_out(cleaned, axis, frequency, step_s)
            found.append((axis, frequency))
    return cleaned, found


def _power(segments, axis, frequency, step_s):
    """Mean windowed power of the segments at frequencies (f,)."""
    total = np.zeros(frequency.size)
    for segment in segments:
        index = np.flatnonzero(np.isfinite(segment[:, axis]))
        window = np.hanning(index.size + 2)[1:-1]
        values = segment[index, axis]
        line = np.polynomial.Polynomial.fit(index, values, 2)(index)
        wave = np.exp(-2j * np.pi * np.outer(frequency, index * step_s))
        total += np.abs(wave @ (window * (values - line))) ** 2 / np.sum(window**2)
    return total / len(segments)


def _take_out(segments, axis, frequency, step_s):
    """Best sine and cosine beside a parabola subtracted, in place."""
    for segment in segments:
        index = np.flatnonzero(np.isfinite(segment[:, axis]))
        phase = 2 * np.pi * frequency * index * step_s
        u = 2 * (index - index[0]) / max(index[-1] - index[0], 1) - 1
        columns = np.stack([np.cos(phase), np.sin(phase), np.ones(u.size), u, u**2], axis=1)
        value = np.linalg.lstsq(columns, segment[index, axis], rcond=None)[0]
        segment[index, axis] -= columns[:, :2] @ value[:2]
