"""Results as named parameters of different units: solution, agreement of the parts of a record, product."""

import numpy as np
import xarray as xr

from gravcal.calibrations.checks import Check, at_least
from gravcal.calibrations.schemas import replaced, widened
from gravcal.estimation import least_squares
from gravcal.estimation.chi2_tail import log_tail


def estimated(names, units, limit, information, right, starts, size=1.0) -> dict[str, object]:
    """{variable of a product of named parameters: value}, from normal equations (k, p, p), (k, p) of parts of a record.

    Parts begin at the starts (k,) GPS s; a parameter with a standard deviation above its limit (p,) is not determined.
    Equations and limit are for parameters in units of `size` (p,), which the values are multiplied by.
    """
    value, covariance = least_squares.solution(information.sum(axis=0), right.sum(axis=0), limit)
    parts = [least_squares.solution(*part, limit) for part in zip(information, right, strict=True)]
    chi2, dof = least_squares.disagreement(right, information)
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


def with_model_error(solved: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Product with covariance and sigma widened by a model error: one moved product per direction, by one sigma."""
    new = widened(solved, moved, {"value": ("covariance",)})
    return replaced(solved, new | {"sigma": np.sqrt(np.diag(new["covariance"]))})


def checks(solved: xr.Dataset, agreement_p: float) -> list[Check]:
    """Checks that a result determines a parameter, and that its parts agree with at least a probability agreement_p."""
    known = np.isfinite(solved["value"].values)
    outcomes = [at_least("parameters determined", known.sum(), 1, "1")]
    dof = int(solved["agreement_dof"])
    if known.any() and dof > 0:
        p = np.exp(float(log_tail(float(solved["agreement_chi2"]), dof)))
        outcomes.append(at_least("probability that the parts of the record agree so badly", p, agreement_p, "1"))
    return outcomes
