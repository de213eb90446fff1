"""Spikes, means over bins, and noise levels of evenly sampled records."""

from __future__ import annotations

import numpy as np


def spikes(values: np.ndarray, half_width: int, limit: float) -> np.ndarray:
    """Samples far from the running median of their neighbours.

    Parameters
    ----------
    values : (n, m) any unit, evenly spaced
    half_width : neighbours on each side
    limit : standard deviations (median absolute deviation times 1.4826)

    Returns
    -------
    spike : (n, m) bool
    """
    from scipy.ndimage import median_filter

    away = np.abs(values - median_filter(values, size=(2 * half_width + 1, 1), mode="nearest"))
    return away > limit * 1.4826 * np.maximum(np.median(away, axis=0), 1e-300)


def repaired(time: np.ndarray, values: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Values with bad samples replaced by the straight line between their good neighbours.

    Parameters
    ----------
    time : (n,) s
    values : (n, m); bad : (n, m) bool
    """
    out = np.array(values, dtype=float)
    for column in range(out.shape[1]):
        wrong = bad[:, column] | ~np.isfinite(out[:, column])
        if wrong.any() and not wrong.all():
            out[wrong, column] = np.interp(time[wrong], time[~wrong], out[~wrong, column])
    return out


def bin_means(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over bins, NaN samples left out.

    Parameters
    ----------
    time : (n,) s, increasing
    values : (n, ...) any unit
    edges : (b + 1,) s

    Returns
    -------
    mean : (b, ...) unit, NaN where a bin is empty
    count : (b,) samples in each bin
    """
    inside = (time >= edges[0]) & (time < edges[-1])
    flat = np.asarray(values, dtype=float).reshape(time.size, -1)
    use = inside & np.isfinite(flat).all(axis=1)
    index = np.searchsorted(edges, time[use], side="right") - 1
    count = np.bincount(index, minlength=edges.size - 1)
    total = np.stack([np.bincount(index, column, edges.size - 1) for column in flat[use].T], axis=1)
    with np.errstate(invalid="ignore"):
        mean = total / np.where(count > 0, count, np.nan)[:, None]
    return mean.reshape(edges.size - 1, *np.shape(values)[1:]), count


def scatter_about_polynomial(blocks: list[np.ndarray], degree: int) -> np.ndarray:
    """Variance of samples about a polynomial fitted to each block, over all blocks together.

    Parameters
    ----------
    blocks : list of (n_i, m), evenly spaced, NaN rows left out
    degree : of the polynomial

    Returns
    -------
    variance : (m,) squared unit; NaN without enough samples
    """
    square, dof = 0.0, 0
    for block in blocks:
        good = np.isfinite(block).all(axis=1)
        if np.count_nonzero(good) <= degree + 10:
            continue
        u = np.linspace(-1, 1, good.size)[good]
        basis = np.linalg.qr(np.polynomial.legendre.legvander(u, degree))[0]
        rest = block[good] - basis @ (basis.T @ block[good])
        square, dof = square + np.sum(rest**2, axis=0), dof + u.size - degree - 1
    return square / dof if dof else np.full(blocks[0].shape[1] if blocks else 3, np.nan)


def scatter_of_third_differences(values: np.ndarray) -> np.ndarray:
    """Variance of white noise on a smooth motion, from its third differences (sum of squared weights 20).

    Parameters
    ----------
    values : (n, m), evenly spaced

    Returns
    -------
    variance : (m,) squared unit, robust against jumps
    """
    third = np.diff(values, 3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    return (1.4826 * np.median(np.abs(third), axis=0)) ** 2 / 20
