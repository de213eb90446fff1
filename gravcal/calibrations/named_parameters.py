"""Results as named parameters of different units: solution, agreement of the parts of a record, product."""

import numpy as np
import xarray as xr

from gravcal.calibrations.checks import Check, at_least
from gravcal.calibrations.schemas import replaced, widened
from gravcal.estimation import least_squares
from gravcal.estimation.chi2_tail import log_tail


def solution(information: np.ndarray, right: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (p,) and covariance (p, p) of normal equations A'A (p, p) and A'y (p,) of whitened rows.

    NaN where the standard deviation of a parameter is beyond its limit (p,): the data do not determine it.
    """
    covariance = least_squares.covariance(information)
    variance = np.diag(covariance)
    lost = ~((variance > 0) & (variance <= limit**2))
    value = np.where(lost, np.nan, least_squares.stable_inverse(information) @ right)
    covariance[lost] = covariance[:, lost] = np.nan
    return value, covariance


def estimated(names, units, limit, information, right, starts, size=1.0) -> dict[str, object]:
    """Variables of PARAMETERS from the normal equations (k, p, p) and (k, p) of every part of the record.

    Parts begin at the starts (k,) GPS s; limit (p,) is the largest standard deviation of what is determined. Equations
    and limit count the parameters in units of some size (p,).
    """
    value, covariance = solution(information.sum(axis=0), right.sum(axis=0), limit)
    parts = [solution(*part, limit) for part in zip(information, right, strict=True)]
    chi2, dof = agreement(information, right)
    return {
        "parameter": list(names),
        "unit": list(units),
        "value": value * size,
        "sigma": np.sqrt(np.diag(covariance)) * size,
        "covariance": covariance * np.outer(size, size),
        "part_start": starts,
        "part_value": [part[0] * size for part in parts],
        "part_sigma": [np.sqrt(np.diag(part[1])) * size for part in parts],
        "agreement_chi2": chi2,
        "agreement_dof": dof,
    }


def agreement(information: np.ndarray, right: np.ndarray) -> tuple[float, int]:
    """Chi-square by which parts (k, p, p), (k, p) disagree with the joint solution, and its degrees of freedom."""
    return least_squares.disagreement(right, information, [np.zeros((right.shape[1], 0))] * len(right))


def with_model_error(solved: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Estimate with the errors of an extended model, from one Dataset moved along each direction of these errors."""
    new = widened(solved, moved, {"value": ("covariance",)})
    return replaced(solved, new | {"sigma": np.sqrt(np.diag(new["covariance"]))})


def checks(solved: xr.Dataset, agreement_p: float) -> list[Check]:
    """Checks of a result: that something is determined, and that the parts agree with at least this probability."""
    known = np.isfinite(solved["value"].values)
    made = [at_least("parameters determined", known.sum(), 1, "1")]
    dof = int(solved["agreement_dof"])
    if known.any() and dof > 0:
        p = np.exp(float(log_tail(float(solved["agreement_chi2"]), dof)))
        made.append(at_least("probability that the parts of the record agree so badly", p, agreement_p, "1"))
    return made
