"""Which cause explains the residual: likelihood ratios with all baseline parameters free, tied sets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.stats import chi2 as chi2_distribution

#: Share of its size that a column keeps when it counts as seen beside the baseline.
SEEN = 1e-4


@dataclass(frozen=True)
class Ratio:
    """Generalised likelihood ratio of one candidate.

    Attributes
    ----------
    gain : reduction of chi-square; dof : independent parameters
    log_p : natural logarithm of the probability of a larger gain by chance
    value, covariance : (q,), (q, q) of its parameters
    """

    gain: float
    dof: int
    log_p: float
    value: np.ndarray
    covariance: np.ndarray


def projected(gram: np.ndarray, baseline: np.ndarray) -> np.ndarray:
    """Gram matrix with the baseline columns projected out.

    Parameters
    ----------
    gram : (m, m)
    baseline : (p,) indices
    """
    inner = gram[np.ix_(baseline, baseline)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inverse = np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    cross = gram[:, baseline]
    return gram - cross @ inverse @ cross.T


def ratio(gram: np.ndarray, place: slice, size: np.ndarray) -> Ratio:
    """Gain of adding the columns of a candidate to a projected Gram matrix.

    Parameters
    ----------
    gram : (m, m), baseline projected out, observed first
    place : columns of the candidate
    size : (m,) norm of the columns before any projection
    """
    scale = np.where(size[place] > 0, size[place], 1.0)
    values, vectors = np.linalg.eigh(gram[place, place] / np.outer(scale, scale))
    seen = values > SEEN**2
    right = vectors[:, seen].T @ (gram[place, 0] / scale)
    gain = float(np.sum(right**2 / values[seen])) if seen.any() else 0.0
    step = vectors[:, seen] / values[seen]
    value = step @ right / scale
    covariance = step @ vectors[:, seen].T / np.outer(scale, scale)
    dof = int(seen.sum())
    log_p = float(chi2_distribution.logsf(gain, dof)) if dof else 0.0
    return Ratio(gain, dof, log_p, value, covariance)


def misfit(gram: np.ndarray, true: slice, value: np.ndarray, other: slice, size: np.ndarray) -> float:
    """Expected chi-square that remains when one cause is true and another is fitted.

    Parameters
    ----------
    gram : (m, m), baseline projected out
    true : columns of the true cause, with its value (q,)
    other : columns of the fitted cause
    size : (m,) norm of the columns before any projection
    """
    whole = float(value @ gram[true, true] @ value)
    scale = np.where(size[other] > 0, size[other], 1.0)
    values, vectors = np.linalg.eigh(gram[other, other] / np.outer(scale, scale))
    seen = values > SEEN**2
    right = vectors[:, seen].T @ (gram[other, true] @ value / scale)
    return whole - float(np.sum(right**2 / values[seen]))


def held_out(grams: np.ndarray, baseline: np.ndarray, place: slice) -> float:
    """Gain in chi-square of each block predicted from all others, summed over blocks.

    Parameters
    ----------
    grams : (b, m, m), own columns projected out
    baseline : (p,) indices of shared columns
    place : columns of the candidate
    """
    total = grams.sum(axis=0)
    index = np.arange(place.start, place.stop)
    gain = 0.0
    for one in grams:
        others = total - one
        before, after = _solved(others, baseline), _solved(others, np.concatenate([baseline, index]))
        gain += _cost(one, baseline, before) - _cost(one, np.concatenate([baseline, index]), after)
    return float(gain)


def _solved(gram, index):
    inner = gram[np.ix_(index, index)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    scaled = linalg.pinvh(inner / np.outer(scale, scale), rtol=1e-9)
    return scaled @ (gram[index, 0] / scale) / scale


def _cost(gram, index, value):
    return gram[0, 0] - 2 * value @ gram[index, 0] + value @ gram[np.ix_(index, index)] @ value
