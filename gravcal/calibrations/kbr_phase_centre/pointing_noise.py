"""Noise of the star cameras as the ranging feels it: a pointing error times the lever arm of the tilted antenna.

In routine flight the line of sight lies along x and the lever arm is nil; at 2 deg it is 50 mm, so that 20 urad become
1 um. Quiet data cannot show this part; it is measured as the excess of the residual's density in the manoeuvres.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
import xarray as xr

from gravcal.estimation import crn, least_squares
from gravcal.estimation import noise as noises

CORNERS = np.array([3e-3, 1e-2, 3e-2, 1e3])  # Hz; the last one is white
BINS = 4096  # frequencies between zero and Nyquist
FITTED_HZ = (2.5e-3, 6e-2)  # where neither the polynomial nor the edge of the filter shapes the residual


def images(step_s: float) -> np.ndarray:
    """BINS + 1 frequencies up to Nyquist and those beyond it that sampling folds onto them, (2, m) Hz.

    Parameters
    ----------
    step_s : s, spacing of the ranging epochs
    """
    frequency = np.linspace(0, 0.5 / step_s, BINS + 1)
    return np.stack([frequency, 1 / step_s - frequency])


@lru_cache(maxsize=4)
def passed(step_s: float) -> np.ndarray:
    """Power gain of the CRN filter at the frequencies of `images`, (2, m).

    Parameters
    ----------
    step_s : s
    """
    return np.stack([crn.gain(crn.Crn(), 0.5, 0, f) ** 2 for f in images(step_s)])


def shapes(step_s: float) -> np.ndarray:
    """Densities of unit height below each corner, through the CRN filter, at `images`, (corner, 2, m).

    Parameters
    ----------
    step_s : s
    """
    return passed(step_s) / (1 + (images(step_s) / CORNERS[:, None, None]) ** 2)


def none() -> np.ndarray:
    """No noise of the star cameras, (corner,)."""
    return np.zeros(CORNERS.size)


def residuals(equations: xr.Dataset, degree: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Range residual of every manoeuvre on its even grid after ordinary least squares, and its lever arms.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable" of the range
    degree : of the polynomial removed

    Returns
    -------
    pieces : list of (n,) m, NaN where missing, and (n, 4) m
    """
    time, number, segment = (equations[n].values for n in ("time_kbr", "arc", "segment"))
    step = float(np.median(np.diff(time)))
    indices = [np.flatnonzero(number == k) for k in range(equations.sizes["manoeuvre"])]
    indices = [index for index in indices if index.size > 4 * degree + 20]
    detrended = [_detrended(equations, index, time, segment, degree) for index in indices]
    if not detrended:
        return []
    y, A = np.concatenate([d[:, 0] for d in detrended]), np.concatenate([d[:, 1:] for d in detrended])
    centre = least_squares.stable_inverse(A.T @ A) @ (A.T @ y)
    pieces = []
    for index, both in zip(indices, detrended, strict=True):
        place = np.rint((time[index] - time[index[0]]) / step).astype(int)
        piece = np.full(place[-1] + 1, np.nan)
        lever = np.zeros((place[-1] + 1, 4))
        piece[place], lever[place] = both[:, 0] - both[:, 1:] @ centre, equations["lever"].values[index, 0]
        pieces.append((piece, lever))
    return pieces


def _detrended(equations, index, time, segment, degree):
    slow = least_squares.polynomial(time[index], degree, time[index[0]], time[index[-1]])
    steps = [segment[index] == s for s in np.unique(segment[index])[1:]]
    both = np.column_stack([equations["observed"].values[index], equations["column"].values[index]])
    return least_squares.without(np.column_stack([slow, *steps]).astype(float), both)


def fit(pieces: list[tuple[np.ndarray, np.ndarray]], quiet: noises.NoiseModel) -> np.ndarray:
    """Densities of the star camera noise below each corner (corner,) rad^2 Hz^-1, none negative.

    Parameters
    ----------
    pieces : of `residuals`
    quiet : NoiseModel of the range

    Notes
    -----
    The covariance of g(t) phi(t) is on average mean(g(t) g(t + tau)) C(tau); its density is fitted to the excess of the
    periodograms with weights 1/density.
    """
    if not pieces:
        return none()
    step = quiet.step_s
    length = max(piece.size for piece, _ in pieces)
    frequency = np.fft.rfftfreq(2 * length, step)
    power, model = np.zeros(frequency.size), np.zeros((frequency.size, CORNERS.size))
    lags = [np.fft.irfft(shape.sum(axis=0), 2 * BINS)[:length] * 0.5 / step for shape in shapes(step)]
    lags = [np.pad(lag, (0, length - lag.size)) for lag in lags]  # beyond, the noise is not correlated
    for piece, lever in pieces:
        window = np.zeros(2 * length)
        window[: piece.size] = np.hanning(piece.size + 2)[1:-1] * np.isfinite(piece)
        energy = np.sum(window**2)
        padded = np.zeros(2 * length)
        padded[: piece.size] = np.nan_to_num(piece)
        power += np.abs(np.fft.rfft(padded * window)) ** 2 * 2 * step / energy
        arm = np.zeros((2 * length, 4))
        arm[: piece.size] = lever * window[: piece.size, None]
        overlap = np.fft.irfft((np.abs(np.fft.rfft(arm, axis=0)) ** 2).sum(axis=1), 2 * length)[:length] / energy
        model += np.stack([_density(overlap * lag, length) for lag in lags], axis=1) * 2 * step
    used = (frequency >= FITTED_HZ[0]) & (frequency <= FITTED_HZ[1])
    power, model = power[used] / len(pieces), model[used] / len(pieces)
    known = quiet.density(frequency[used])
    found = np.zeros(CORNERS.size)
    for _ in range(5):
        weight = 1 / (known + model @ found)
        size = np.linalg.norm(model * weight[:, None], axis=0)
        found = _not_negative(model * weight[:, None] / size, (power - known) * weight) / size
    return found


def _not_negative(design, observed):
    """Least squares without negative unknowns: the best of all sub-sets of the few columns."""
    best, least = np.zeros(design.shape[1]), observed @ observed
    for used in product((False, True), repeat=design.shape[1]):
        part = design[:, np.array(used)]
        if not any(used):
            continue
        value = np.linalg.lstsq(part, observed, rcond=None)[0]
        misfit = np.sum((observed - part @ value) ** 2)
        if np.all(value >= 0) and misfit < least:
            best, least = np.zeros(design.shape[1]), misfit
            best[np.array(used)] = value
    return best


def _density(lagged, length):
    """Fourier sum of a symmetric covariance given at lags 0 .. length - 1."""
    full = np.zeros(2 * length)
    full[:length] = lagged
    full[length + 1 :] = lagged[:0:-1]
    return np.fft.rfft(full).real
