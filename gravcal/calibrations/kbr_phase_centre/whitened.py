"""Observation equations of every manoeuvre, whitened, with orbit errors, biases and breaks projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import covariance
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares

LONGEST = 4000  # observations of one stretch, whose covariance is held as a matrix; a wiggle of 1000 s at 5 s has 200


@dataclass(frozen=True)
class Arc:
    """One manoeuvre after whitening and projection.

    Attributes
    ----------
    index : (n,) places in the observations
    observed : (n,) whitened, nuisance projected out
    column : (n, 6) the same
    basis : (n, k) orthonormal, whitened nuisance
    """

    index: np.ndarray
    observed: np.ndarray
    column: np.ndarray
    basis: np.ndarray


def arcs(
    equations: xr.Dataset, measured: xr.Dataset, indices: list[np.ndarray], derivative: int, degree: int
) -> list[Arc]:
    """All stretches of observations whose epochs outnumber the unknowns.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable"
    measured : Dataset, "kbr_phase_centre.noise"
    indices : places of the observations of each stretch
    derivative : 0, 1 or 2
    degree : of the polynomial that takes up slow orbit errors of the range; lower by one for each derivative

    Raises
    ------
    EstimationError : a stretch of more than `LONGEST` observations
    """
    largest = max((index.size for index in indices), default=0)
    if largest > LONGEST:
        raise EstimationError(
            f"kbr_phase_centre: found {largest} observations in one stretch, expected at most {LONGEST}: the pointing "
            f"is off its mean for hours. Check that orbits and attitudes are those of their satellites."
        )
    step = float(measured.attrs["step_s"])
    time, segment, lever = (equations[name].values for name in ("time_kbr", "segment", "lever"))
    longest = max((float(time[index[-1]] - time[index[0]]) for index in indices if index.size), default=0.0)
    lags = covariance.lags(measured, derivative, int(longest / step) + 3)
    found = []
    for index in indices:
        nuisance = slow_columns(time[index], segment[index], degree - derivative, derivative)
        if index.size <= nuisance.shape[1] + 10:
            continue
        data = np.column_stack([equations["observed"].values[index], equations["column"].values[index], nuisance])
        place = np.rint((time[index] - time[index[0]]) / step).astype(int)
        white = _whiten(data, covariance.matrix(lags, place, lever[index]))
        basis = least_squares.orthonormal(white[:, 7:])
        clean = white[:, :7] - basis @ (basis.T @ white[:, :7])
        found.append(Arc(index, clean[:, 0], clean[:, 1:], basis))
    return found


def of_manoeuvres(equations: xr.Dataset) -> list[np.ndarray]:
    """Places of the observations of each manoeuvre."""
    number = equations["arc"].values
    return [np.flatnonzero(number == k) for k in range(equations.sizes["manoeuvre"])]


def of_quiet(equations: xr.Dataset, length_s: float) -> list[np.ndarray]:
    """Places of the observations of quiet stretches of about the given length, gaps of a minute at most.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable"
    length_s : s
    """
    quiet, time = np.flatnonzero(equations["arc"].values == -1), equations["time_kbr"].values
    new = (np.diff(time[quiet]) > 60) | (np.diff(equations["segment"].values[quiet]) != 0)
    found = []
    for whole in np.split(quiet, np.flatnonzero(new) + 1):
        span = time[whole[-1]] - time[whole[0]] if whole.size else 0.0
        if span > length_s / 2:
            found += np.array_split(whole, max(int(round(span / length_s)), 1))
    return found


def slow_columns(time: np.ndarray, segment: np.ndarray, degree: int, derivative: int) -> np.ndarray:
    """Legendre polynomials of time and, for the range, a bias for every further segment.

    Parameters
    ----------
    time : (n,) s
    segment : (n,) number of the stretch without a phase break
    degree : of the polynomial
    derivative : 0, 1 or 2
    """
    if time.size < 2:
        return np.zeros((time.size, degree + 1))
    slow = least_squares.polynomial(time, degree, time[0], time[-1])
    if derivative:
        return slow
    steps = [segment == s for s in np.unique(segment)[1:]]
    return np.column_stack([slow, *steps]).astype(float)


def _whiten(columns, matrix):
    """Columns divided by the Cholesky factor of their covariance."""
    from scipy.linalg import cholesky, solve_triangular

    factor = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
    return solve_triangular(factor, columns, lower=True, check_finite=False)


def band_variance(parts: list[Arc], residual: list[np.ndarray], band_hz, step_s: float) -> float:
    """Variance of whitened residuals within a band of frequencies, one where the noise is as measured.

    Parameters
    ----------
    parts : list of Arc
    residual : whitened residual of each
    band_hz : Hz and Hz
    step_s : s
    """
    power = expected = 0.0
    for part, left in zip(parts, residual, strict=True):
        frequency = np.fft.rfftfreq(left.size, step_s)
        inside = (frequency >= band_hz[0]) & (frequency <= band_hz[1])
        taken = np.column_stack([part.basis, least_squares.orthonormal(part.column)])
        power += np.sum(np.abs(np.fft.rfft(left)[inside]) ** 2) / left.size
        expected += inside.sum() - np.sum(np.abs(np.fft.rfft(taken, axis=0)[inside]) ** 2) / left.size
    return power / max(expected, 1.0)
