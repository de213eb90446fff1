"""Coloured noise as measured: autoregressive models from quiet data, whitening, spectra."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

PIECE = 32  # rows that are whitened by one product of matrices, which needs no compiler; wide columns take least so


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
        reflection, order = self.reflection, len(self.reflection)
        rows = np.zeros((order + 1, order))
        for k in range(1, order + 1):
            rows[k, : k - 1] = rows[k - 1, : k - 1] - reflection[k - 1] * rows[k - 1, : k - 1][::-1]
            rows[k, k - 1] = reflection[k - 1]
        return rows

    @functools.cached_property
    def whitening(self) -> tuple[np.ndarray, np.ndarray]:
        """(p, p) 1 over the unit, whitens the first rows of a run; (PIECE, p + PIECE), so many others from p before."""
        rows, sigma = self.coefficients, np.sqrt(self.variance)
        order = rows.shape[1]
        start, later = np.eye(order), np.zeros((PIECE, order + PIECE))
        for k in range(order):
            start[k, :k] = -rows[k, :k][::-1]
        for k in range(PIECE):
            later[k, k : k + order + 1] = np.append(-rows[order][::-1], 1.0)
        return start / sigma[:order, None], later / sigma[order]

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


def _burg(values, begin, end, order):
    """Reflection coefficients and variances of runs that lie one behind the other.

    Pairs (t, t - 1) that no run holds are zero: the first k + 1 of a run at order k.
    """
    ahead, behind = values.copy(), np.concatenate([values[:1], values[:-1]])
    reflection, variance = np.zeros(order), np.full(order + 1, ahead @ ahead / values.size if values.size else np.nan)
    for k in range(order):
        ahead[(begin + k)[begin + k < end]] = behind[begin] = 0.0
        power = ahead @ ahead + behind @ behind
        reflection[k] = 2 * (ahead @ behind) / power if power > 0 else 0.0
        back = behind - reflection[k] * ahead
        ahead -= reflection[k] * behind
        behind[1:] = back[:-1]
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
    valid = np.isfinite(values)
    begin, end = runs(valid)
    last = np.cumsum(end - begin)
    count = int(last[-1]) if last.size else 0
    order = max(min(order, count // 10), 0)
    reflection, variance = _burg(values[valid], last - (end - begin), last, order)
    return NoiseModel(reflection, variance * count / max(count - removed, 1), step_s)


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
    out = np.zeros(flat.shape)
    for matrix, first, begin, end in _pieces(noise, valid):
        out[begin:end] = matrix[: end - begin, : end - first] @ flat[first:end]
    return out.reshape(columns.shape)


def _pieces(noise, valid):
    """Matrix that whitens the rows begin..end from the rows first..end, piece by piece of every run of valid rows."""
    start, later = noise.whitening
    order = len(start)
    for begin, end in zip(*runs(valid), strict=True):
        yield start, begin, begin, min(begin + order, end)
        for at in range(begin + order, end, PIECE):
            yield later, at - order, at, min(at + PIECE, end)


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
    flat = rows.reshape(rows.shape[0], -1)
    out = np.full(flat.shape, np.nan)
    for matrix, first, begin, end in _pieces(noise, valid):
        count, known = end - begin, begin - first
        rest = flat[begin:end] - matrix[:count, :known] @ out[first:begin]
        out[begin:end] = np.linalg.solve(matrix[:count, known : known + count], rest)
    return out.reshape(rows.shape)


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
