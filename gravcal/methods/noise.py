"""Coloured noise as measured: autoregressive models from quiet data, whitening, spectra."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numba
import numpy as np


@dataclass(frozen=True)
class NoiseModel:
    """Autoregressive noise of evenly spaced samples.

    Attributes
    ----------
    reflection : (p,) 1, reflection coefficients, each of magnitude below one
    variance : (p + 1,) squared unit, prediction-error variance of the orders 0..p
    step_s : s, spacing of the samples
    """

    reflection: np.ndarray
    variance: np.ndarray
    step_s: float

    @functools.cached_property
    def coefficients(self) -> np.ndarray:
        """(p + 1, p) prediction coefficients: row k predicts from k previous samples, most recent first."""
        return _levinson_rows(np.array(self.reflection, dtype=float))  # numba compiles once more for what is read-only

    def density(self, frequency_hz: np.ndarray) -> np.ndarray:
        """One-sided power spectral density.

        Parameters
        ----------
        frequency_hz : (m,) Hz

        Returns
        -------
        density : (m,) squared unit per Hz
        """
        last = self.coefficients[-1]
        lags = np.arange(1, last.size + 1)
        transfer = 1 - np.exp(-2j * np.pi * np.outer(frequency_hz, lags) * self.step_s) @ last
        return 2 * self.step_s * self.variance[-1] / np.abs(transfer) ** 2


@numba.njit(cache=True, nogil=True)
def _levinson_rows(reflection):
    order = reflection.size
    rows = np.zeros((order + 1, order))
    for k in range(1, order + 1):
        rows[k, k - 1] = reflection[k - 1]
        for j in range(k - 1):
            rows[k, j] = rows[k - 1, j] - reflection[k - 1] * rows[k - 1, k - 2 - j]
    return rows


@numba.njit(cache=True, nogil=True)
def _burg(values, begin, end, order):
    forward = values.copy()
    backward = values.copy()
    reflection = np.zeros(order)
    variance = np.zeros(order + 1)
    count = 0
    for s in range(begin.size):
        for t in range(begin[s], end[s]):
            variance[0] += values[t] ** 2
            count += 1
    variance[0] /= count
    for k in range(order):
        numerator = 0.0
        denominator = 0.0
        for s in range(begin.size):
            for t in range(begin[s] + k + 1, end[s]):
                numerator += 2 * forward[t] * backward[t - 1]
                denominator += forward[t] ** 2 + backward[t - 1] ** 2
        reflection[k] = numerator / denominator if denominator > 0 else 0.0
        for s in range(begin.size):
            for t in range(end[s] - 1, begin[s] + k, -1):
                ahead = forward[t]
                behind = backward[t - 1]
                forward[t] = ahead - reflection[k] * behind
                backward[t] = behind - reflection[k] * ahead
        variance[k + 1] = variance[k] * (1 - reflection[k] ** 2)
    return reflection, variance


def runs(valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First index and one past the last index of every run of valid samples.

    Parameters
    ----------
    valid : (n,) bool
    """
    padded = np.concatenate([[False], np.asarray(valid, dtype=bool), [False]]).astype(np.int8)
    change = np.diff(padded)
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def fit_noise(segments: list[np.ndarray], order: int, step_s: float, removed: int = 0) -> NoiseModel:
    """Autoregressive model of quiet segments by Burg's recursion over all of them together.

    Parameters
    ----------
    segments : list of (n_i,) any unit, evenly spaced, NaN where missing, slow part already removed
    order : highest order; lowered to a tenth of the samples
    step_s : s
    removed : parameters that detrending took from the samples; the variance is scaled by n/(n - removed)
    """
    values = np.concatenate([np.append(segment, np.nan) for segment in segments]).astype(float)
    begin, end = runs(np.isfinite(values))
    count = int(np.sum(end - begin))
    order = max(min(order, count // 10), 0)
    reflection, variance = _burg(np.nan_to_num(values), begin, end, order)
    return NoiseModel(reflection, variance * count / max(count - removed, 1), step_s)


@numba.njit(cache=True, nogil=True)
def _whiten(columns, valid, rows, sigma):
    n, m = columns.shape
    order = rows.shape[0] - 1
    out = np.zeros((n, m))
    known = 0
    for t in range(n):
        if not valid[t]:
            known = 0
            continue
        use = min(known, order)
        row = out[t]
        row[:] = columns[t]
        for j in range(use):
            share, before = rows[use, j], columns[t - 1 - j]
            for c in range(m):
                row[c] -= share * before[c]
        row /= sigma[use]
        known += 1
    return out


def whiten(noise: NoiseModel, columns: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Columns turned so that noise of the model has unit variance and no correlation.

    Exact for a stationary autoregressive process: the first samples of every run are predicted by the lower orders.
    Rows that are not valid come back as zero, so they carry no weight.

    Parameters
    ----------
    noise : NoiseModel
    columns : (n,) or (n, m) unit of the noise
    valid : (n,) bool
    """
    columns = np.asarray(columns, dtype=float)
    flat = columns.reshape(columns.shape[0], -1)
    flat = np.where(np.isnan(flat), 0.0, flat)
    sigma = np.sqrt(noise.variance)
    out = _whiten(np.ascontiguousarray(flat), np.ascontiguousarray(valid), noise.coefficients, sigma)
    return out.reshape(columns.shape)


@numba.njit(cache=True, nogil=True)
def _unwhiten(rows_white, valid, rows, sigma):
    n, m = rows_white.shape
    order = rows.shape[0] - 1
    out = np.full((n, m), np.nan)
    known = 0
    for t in range(n):
        if not valid[t]:
            known = 0
            continue
        use = min(known, order)
        out[t] = rows_white[t] * sigma[use]
        for j in range(use):
            for c in range(m):
                out[t, c] += rows[use, j] * out[t - 1 - j, c]
        known += 1
    return out


def unwhiten(noise: NoiseModel, rows: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Columns whose whitened rows are given: the inverse of `whiten`.

    Parameters
    ----------
    noise : NoiseModel
    rows : (n,) or (n, m) 1, of `whiten`
    valid : (n,) bool, as given there

    Returns
    -------
    columns : (n,) or (n, m) unit of the noise, NaN where not valid
    """
    rows = np.asarray(rows, dtype=float)
    flat = np.ascontiguousarray(rows.reshape(rows.shape[0], -1))
    return _unwhiten(flat, np.ascontiguousarray(valid), noise.coefficients, np.sqrt(noise.variance)).reshape(rows.shape)


def coloured(density, count: int, step_s: float, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise of a given one-sided density, evenly spaced.

    Parameters
    ----------
    density : callable, (m,) Hz -> (m,) squared unit per Hz
    count : number of samples
    step_s : s
    rng : source of randomness

    Returns
    -------
    noise : (count,) unit
    """
    from scipy import fft

    length = fft.next_fast_len(count + int(200 / step_s), real=True)  # the wrap of the circle is cut off
    frequency = fft.rfftfreq(length, step_s)
    amplitude = np.zeros(frequency.size)
    amplitude[1:] = np.sqrt(density(frequency[1:]) * length / (2 * step_s) / 2)
    spectrum = amplitude * (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size))
    return fft.irfft(spectrum, length)[:count]
