"""Observation equations of every manoeuvre, whitened, with orbit errors, biases and breaks projected out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import covariance
from gravcal.methods import estimation


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


def arcs(equations: xr.Dataset, measured: xr.Dataset, derivative: int, degree: int) -> list[Arc]:
    """All manoeuvres whose epochs outnumber the unknowns.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable"
    measured : Dataset, "kbr_phase_centre.noise"
    derivative : 0, 1 or 2
    degree : of the polynomial that takes up slow orbit errors of the range; lower by one for each derivative
    """
    step = float(measured.attrs["step_s"])
    time, number = equations["time_kbr"].values, equations["arc"].values
    longest = float((equations["stop"] - equations["start"]).max()) if equations.sizes["manoeuvre"] else 0.0
    lags = covariance.lags(measured, derivative, int(longest / step) + 3)
    lever = equations["lever"].values
    found = []
    for k in range(equations.sizes["manoeuvre"]):
        index = np.flatnonzero(number == k)
        nuisance = slow_columns(time[index], equations["segment"].values[index], degree - derivative, derivative)
        if index.size <= nuisance.shape[1] + 10:
            continue
        data = np.column_stack([equations["observed"].values[index], equations["column"].values[index], nuisance])
        place = np.rint((time[index] - time[index[0]]) / step).astype(int)
        white = _whiten(data, covariance.matrix(lags, place, lever[index]))
        basis = estimation.orthonormal(white[:, 7:])
        clean = white[:, :7] - basis @ (basis.T @ white[:, :7])
        found.append(Arc(index, clean[:, 0], clean[:, 1:], basis))
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
    slow = estimation.polynomial(time, degree, time[0], time[-1])
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
        taken = np.column_stack([part.basis, estimation.orthonormal(part.column)])
        power += np.sum(np.abs(np.fft.rfft(left)[inside]) ** 2) / left.size
        expected += inside.sum() - np.sum(np.abs(np.fft.rfft(taken, axis=0)[inside]) ** 2) / left.size
    return power / max(expected, 1.0)
