"""What routine pointing, without wiggles, can say of the phase centres."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.kbr_phase_centre import correction, whitened
from gravcal.calibrations.kbr_phase_centre.schemas import ROUTINE
from gravcal.estimation import least_squares


def routine(
    aligned: xr.Dataset,
    pointed: xr.Dataset,
    equations: xr.Dataset,
    measured: xr.Dataset,
    *,
    orbit_degree: int,
    quiet_length_s: float,
    robust_k0: float,
    robust_k1: float,
    nominal_m,
    determined_limit_mm: float,
    routine_limit: float,
) -> xr.Dataset:
    """Phase centres from ranging against orbits in quiet data, and from the antenna correction of the file.

    In routine pointing the columns of x are constant to 1e-6: their sum is a level that the range bias takes, their
    difference is nothing. y and z follow from the slow motion of the control loop as far as it is faster than the
    orbit errors. x is known from the catalogue better than from anything here, so an x further from it than its error
    allows shows that the errors do not hold what moves with pointing and orbit: then nothing is determined.

    Parameters
    ----------
    aligned, pointed : Dataset, "kbr_phase_centre.align" and "kbr_phase_centre.pointing"
    equations : Dataset, "kbr_phase_centre.observable" of the range
    measured : Dataset, "kbr_phase_centre.noise"
    orbit_degree : of the polynomial per stretch that takes up slow orbit errors
    quiet_length_s : s, length of a stretch
    robust_k0, robust_k1 : constants of IGG-III for the antenna correction
    nominal_m : (2, 3) m, phase centres of the catalogue
    determined_limit_mm : mm, a component with a larger sigma is not determined
    routine_limit : sigma, distance of x from the catalogue beyond which the errors are not trusted

    Returns
    -------
    described : Dataset, "kbr_phase_centre.routine"
    """
    indices = whitened.of_quiet(equations, quiet_length_s)
    parts = whitened.arcs(equations, measured, indices, 0, orbit_degree)
    value, sigma = np.full(6, np.nan), np.full(6, np.nan)
    if parts:
        value, sigma = _estimate(parts)
    x, catalogue = [0, 3], np.asarray(nominal_m, dtype=float).ravel()
    with np.errstate(invalid="ignore"):
        misfit = float(np.max(np.abs(value - catalogue)[x] / sigma[x]))
        known = (sigma <= 1e-3 * determined_limit_mm) & (misfit <= routine_limit)
    value, sigma = np.where(known, value, np.nan), np.where(known, sigma, np.nan)
    singular = np.full(6, np.nan)
    column = equations["column"].values[equations["arc"].values == -1]
    if len(column) > 6:
        singular = np.linalg.svd(column - column.mean(axis=0), compute_uv=False) / np.sqrt(len(column))
    values = {"centre": value, "sigma": sigma, "singular": singular, "x_misfit": misfit}
    values |= _from_correction(aligned, pointed, (robust_k0, robust_k1))
    return build(ROUTINE, values, title="What routine pointing says of the phase centres", stretches=len(parts))


def _estimate(parts):
    """Generalised least squares over the quiet stretches, errors scaled by the residual."""
    A, y = np.concatenate([p.column for p in parts]), np.concatenate([p.observed for p in parts])
    normal = A.T @ A
    value = least_squares.stable_inverse(normal) @ (A.T @ y)
    left = y - A @ value
    freedom = max(y.size - 6 - sum(p.basis.shape[1] for p in parts), 1)
    return value, np.sqrt(np.diag(least_squares.covariance(normal * freedom / (left @ left))))


def _from_correction(aligned, pointed, constants):
    """Phase centres behind the antenna correction of the file, where it has one."""
    empty = {"correction_centre": np.full((2, 3), np.nan), "correction_sigma": np.full((2, 3), np.nan)}
    empty |= {"correction_rms": np.nan, "correction_kept": np.nan}
    if not np.nanmax(np.abs(aligned["antenna_correction"].values), initial=0.0) > 0.1:
        return empty
    found = correction.recover(aligned, pointed, constants)
    return {
        "correction_centre": found.centre,
        "correction_sigma": found.sigma,
        "correction_rms": found.rms,
        "correction_kept": found.kept,
    }
