"""Results as named parameters of different units: solution, agreement of the parts of a record, product."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import replaced, widened
from gravcal.calibrations.checks import Check, at_least
from gravcal.estimation import least_squares
from gravcal.estimation.chi2_tail import log_tail


def solution(information: np.ndarray, right: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solution of normal equations, NaN where the data do not determine a parameter to its limit.

    Parameters
    ----------
    information : (p, p) A'A; right : (p,) A'y, of whitened rows
    limit : (p,) largest standard deviation of a parameter that is determined

    Returns
    -------
    value : (p,)
    covariance : (p, p)
    """
    covariance = least_squares.covariance(information)
    variance = np.diag(covariance)
    lost = ~((variance > 0) & (variance <= limit**2))
    value = np.where(lost, np.nan, least_squares.stable_inverse(information) @ right)
    covariance[lost] = covariance[:, lost] = np.nan
    return value, covariance


def estimated(names, units, limit, information, right, starts) -> dict[str, object]:
    """Variables of PARAMETERS from the normal equations of every part of the record.

    Parameters
    ----------
    names, units : (p,)
    limit : (p,) largest standard deviation of a parameter that is determined
    information : (k, p, p); right : (k, p), of each part
    starts : (k,) s, GPS time at which each begins
    """
    value, covariance = solution(information.sum(axis=0), right.sum(axis=0), limit)
    parts = [solution(*part, limit) for part in zip(information, right, strict=True)]
    chi2, dof = agreement(information, right)
    return {
        "parameter": list(names),
        "unit": list(units),
        "value": value,
        "sigma": np.sqrt(np.diag(covariance)),
        "covariance": covariance,
        "part_start": starts,
        "part_value": [part[0] for part in parts],
        "part_sigma": [np.sqrt(np.diag(part[1])) for part in parts],
        "agreement_chi2": chi2,
        "agreement_dof": dof,
    }


def agreement(information: np.ndarray, right: np.ndarray) -> tuple[float, int]:
    """Chi-square by which the parts disagree with the joint solution, and its degrees of freedom.

    Parameters
    ----------
    information : (k, p, p); right : (k, p), normal equations of each part

    Notes
    -----
    chi2 = sum b_k' N_k^+ b_k - b' N^+ b with N = sum N_k, b = sum b_k; dof = sum rank N_k - rank N.
    """
    scale = np.sqrt(np.diag(information.sum(axis=0)))
    scale = np.where(scale > 0, scale, 1.0)
    chi2, dof = 0.0, 0
    for sign, matrix, side in [(1, *p) for p in zip(information, right, strict=True)] + [
        (-1, information.sum(axis=0), right.sum(axis=0))
    ]:
        size, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        used = size > 1e-10 * max(size[-1], 1e-300)
        chi2 += sign * np.sum((vectors[:, used].T @ (side / scale)) ** 2 / size[used])
        dof += sign * int(used.sum())
    return max(float(chi2), 0.0), dof


def with_model_error(found: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Estimate with the errors of an extended model.

    Parameters
    ----------
    found : Dataset with PARAMETERS
    moved : the same for each direction of the errors of the model
    """
    new = widened(found, moved, {"value": ("covariance",)})
    return replaced(found, new | {"sigma": np.sqrt(np.diag(new["covariance"]))})


def checks(found: xr.Dataset, agreement_p: float) -> list[Check]:
    """Checks of a result: that something is determined, and that the parts of the record agree.

    Parameters
    ----------
    found : Dataset with PARAMETERS
    agreement_p : smallest probability of the disagreement of the parts
    """
    known = np.isfinite(found["value"].values)
    made = [at_least("parameters determined", known.sum(), 1, "1")]
    dof = int(found["agreement_dof"])
    if known.any() and dof > 0:
        p = np.exp(float(log_tail(float(found["agreement_chi2"]), dof)))
        made.append(at_least("probability that the parts of the record agree so badly", p, agreement_p, "1"))
    return made
