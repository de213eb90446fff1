"""Least squares on whitened observations: nuisance projected out, instruments, normal equations that add up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """Solution of one observation block.

    Attributes
    ----------
    value : (p,)
    information : (p, p) inverse covariance for unit-variance noise; singular where nothing is determined
    gain : (p, n) derivative of the value by the whitened observations
    residual : (n,) whitened
    dof : observations minus all unknowns
    """

    value: np.ndarray
    information: np.ndarray
    gain: np.ndarray
    residual: np.ndarray
    dof: int


def without(nuisance: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns with their part along the nuisance columns removed.

    Parameters
    ----------
    nuisance : (n, k)
    columns : (n,) or (n, m)
    """
    basis = orthonormal(nuisance)
    return columns - basis @ (basis.T @ columns)


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the column space (n, r), dependent columns left out."""
    scale = np.linalg.norm(columns, axis=0)
    used = columns[:, scale > 0] / scale[scale > 0]
    if used.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    left, size, _ = np.linalg.svd(used, full_matrices=False)
    return left[:, size > 1e-10 * size[0]]


def solve(observed: np.ndarray, design: np.ndarray, nuisance: np.ndarray, instruments: np.ndarray | None = None):
    """Least squares, or instrumental variables if the design is noisy, with nuisance projected out.

    With instruments Z free of the noise of the design A the estimate (Z'A)^-1 Z'y has no attenuation; its covariance
    is (Z'A)^-1 Z'Z (A'Z)^-1. Without, Z = A and this is least squares.

    Parameters
    ----------
    observed : (n,) whitened
    design : (n, p) whitened
    nuisance : (n, k) whitened
    instruments : (n, p) whitened, or None

    Returns
    -------
    estimate : Estimate
    """
    design = without(nuisance, design)
    used = design if instruments is None else without(nuisance, instruments)
    observed = without(nuisance, observed)
    cross = used.T @ design
    inverse = stable_inverse(cross)
    gain = inverse @ used.T
    value = gain @ observed
    information = cross.T @ stable_inverse(used.T @ used) @ cross
    count = int(np.count_nonzero(np.any(used != 0, axis=1)))
    dof = count - design.shape[1] - orthonormal(nuisance).shape[1]
    return Estimate(value, (information + information.T) / 2, gain, observed - design @ value, dof)


def stable_inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse after scaling to unit diagonal; pseudo-inverse where that is singular.

    Parameters
    ----------
    matrix : (p, p)
    """
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-13) / np.outer(scale, scale)


def covariance(information: np.ndarray) -> np.ndarray:
    """Covariance of an information matrix; infinite variance for parameters in its null space.

    Parameters
    ----------
    information : (p, p) symmetric
    """
    scale = np.sqrt(np.abs(np.diag(information)))
    blank = scale <= 0
    scale = np.where(blank, 1.0, scale)
    size, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    null = size <= 1e-12 * max(size.max(initial=0.0), 1e-300)
    inverse = (vectors[:, ~null] / size[~null]) @ vectors[:, ~null].T
    result = inverse / np.outer(scale, scale)
    lost = blank | (np.abs(vectors[:, null]).max(axis=1, initial=0.0) > 1e-6)
    result[lost, lost] = np.inf
    return result


@dataclass(frozen=True)
class Combination:
    """Joint solution of several blocks.

    Attributes
    ----------
    value : (p,)
    information : (p, p)
    share : (b, p, p) weight of each block's estimate in the value
    chi2, dof : disagreement of the blocks with the joint value
    """

    value: np.ndarray
    information: np.ndarray
    share: np.ndarray
    chi2: float
    dof: int


def combine(values: np.ndarray, informations: np.ndarray) -> Combination:
    """Estimates joined by their full normal equations.

    Parameters
    ----------
    values : (b, p)
    informations : (b, p, p)
    """
    total = informations.sum(axis=0)
    share = stable_inverse(total) @ informations
    value = np.einsum("bij,bj->i", share, values)
    difference = values - value
    chi2 = float(np.einsum("bi,bij,bj->", difference, informations, difference))
    rank = sum(_rank(information) for information in informations)
    return Combination(value, total, share, chi2, rank - _rank(total))


def _rank(information):
    scale = np.sqrt(np.abs(np.diag(information)))
    used = scale > 0
    if not used.any():
        return 0
    scaled = information[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    return int(np.linalg.matrix_rank(scaled, tol=1e-10, hermitian=True))


def polynomial(time: np.ndarray, degree: int, start: float, stop: float) -> np.ndarray:
    """Legendre polynomials of time over an interval, (n, degree + 1).

    Parameters
    ----------
    time : (n,) s
    degree : highest degree; -1 gives no column
    start, stop : s
    """
    u = (2 * time - start - stop) / (stop - start)
    return np.polynomial.legendre.legvander(u, degree) if degree >= 0 else np.zeros((time.size, 0))


def chi2_probability(chi2: float, dof: int) -> float | None:
    """Probability of a larger chi-square; None without degrees of freedom."""
    from scipy.stats import chi2 as distribution

    return float(distribution.sf(chi2, dof)) if dof > 0 else None
