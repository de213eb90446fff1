"""Probabilities of large values by chance, as natural logarithms, without the checks of `scipy.stats` at every call."""

import numpy as np
from scipy import special


def log_tail(chi2, dof, freedom: float = np.inf) -> np.ndarray:
    """Logarithm of the probability that a chi-square of so many degrees of freedom is larger; -inf below 1e-308.

    Where the variance that it is counted in was itself measured, with some freedom, chi2 / dof has an F distribution.
    """
    chi2, dof = np.maximum(chi2, 0.0), np.asarray(dof)
    with np.errstate(divide="ignore"):
        if np.isfinite(freedom):
            return np.log(special.fdtrc(dof, freedom, chi2 / dof))
        return np.log(special.chdtrc(dof, chi2))


def log_tail_of_level(chi2: float, dof: int, freedom: float, error: float) -> float:
    """`log_tail` where the logarithm of the variance that it is counted in has a normal error of its own."""
    off = np.linspace(-12.0, 12.0, 481)
    rows = log_tail(chi2 * np.exp(-error * off), dof, freedom) - off**2 / 2
    return float(special.logsumexp(rows) + np.log((off[1] - off[0]) / np.sqrt(2 * np.pi)))


def least_log_tail(chi2: np.ndarray, dof: np.ndarray) -> np.ndarray:
    """Smallest `log_tail` over many (k, d), for each column: that of the largest of each of the numbers `dof` (k,)."""
    kinds = np.unique(dof)
    return log_tail(np.stack([chi2[dof == kind].max(axis=0) for kind in kinds]), kinds[:, None]).min(axis=0)


def log_gamma_tail(value, shape: float, mean: float, *, smaller: bool = False) -> np.ndarray:
    """Logarithm of the probability of a larger (or smaller) value of the gamma distribution of this shape and mean."""
    share = special.gammainc if smaller else special.gammaincc
    with np.errstate(divide="ignore"):
        return np.log(share(shape, np.maximum(value, 0.0) * shape / mean))
