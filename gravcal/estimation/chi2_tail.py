"""Probabilities of large values by chance, as natural logarithms, without the checks of `scipy.stats` at every call."""

import numpy as np
from scipy import special


def log_tail(chi2, dof, freedom: float = np.inf) -> np.ndarray:
    """Natural log of the probability of a larger chi-square of `dof` degrees of freedom; -inf below 1e-308.

    With a variance that was itself estimated, with `freedom` degrees of freedom, chi2 / dof has an F distribution.
    """
    chi2, dof = np.maximum(chi2, 0.0), np.asarray(dof)
    with np.errstate(divide="ignore"):
        if np.isfinite(freedom):
            return np.log(special.fdtrc(dof, freedom, chi2 / dof))
        return np.log(special.chdtrc(dof, chi2))


def log_tail_of_level(chi2: float, dof: int, freedom: float, error: float) -> float:
    """`log_tail` averaged over a normal error, sigma `error`, of the log of the variance that chi2 is divided by."""
    deviate = np.linspace(-12.0, 12.0, 481)
    log_p = log_tail(chi2 * np.exp(-error * deviate), dof, freedom) - deviate**2 / 2
    return float(special.logsumexp(log_p) + np.log((deviate[1] - deviate[0]) / np.sqrt(2 * np.pi)))


def least_log_tail(chi2: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Least `log_tail` (d,) of each column of many chi-squares (k, d) with degrees of freedom (k,)."""
    kinds = np.unique(dof)
    return log_tail(np.stack([chi2[dof == kind].max(axis=0) for kind in kinds]), kinds[:, None]).min(axis=0)


def log_gamma_tail(value, shape: float, mean: float, *, smaller: bool = False) -> np.ndarray:
    """Natural log of the probability of a larger, or smaller, value of a gamma distribution of shape and mean."""
    tail = special.gammainc if smaller else special.gammaincc
    with np.errstate(divide="ignore"):
        return np.log(tail(shape, np.maximum(value, 0.0) * shape / mean))
