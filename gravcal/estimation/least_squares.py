"""Least squares on whitened observations: nuisance projected out, instruments, equations that add up; recursive too."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Score:
    """Estimating equation Z'(y - A x) = 0 of one observation block, nuisance projected out.

    With Z = A this is least squares. With a noisy design A and instruments Z that share its signal but not its noise
    the estimate is not attenuated.
    """

    right: np.ndarray  #: (p,) Z'y
    normal: np.ndarray  #: (p, p) Z'A
    information: np.ndarray  #: (p, p) Z'Z, covariance of Z'y for unit-variance noise

    @property
    def value(self) -> np.ndarray:
        """(p,) solution of the estimating equation of this block alone."""
        return stable_inverse(self.normal) @ self.right

    def determined(self, about: np.ndarray, limit: float) -> np.ndarray:
        """(p,) solution in the directions known better than the limit (a standard deviation), the others as `about`."""
        size, vectors = np.linalg.eigh(self.information)
        used = vectors[:, size > limit**-2]
        inner = used.T @ self.normal @ used
        return about + used @ stable_inverse(inner) @ used.T @ (self.right - self.normal @ about)


def project_out(nuisance: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (n,) or (n, m) with their part along the nuisance columns (n, k) removed."""
    basis = orthonormal(nuisance)
    return columns - basis @ (basis.T @ columns)


def orthonormal(columns: np.ndarray, tolerance: float = 1e-10) -> np.ndarray:
    """Orthonormal basis (n, r) of the column space of (n, k), dependent columns left out.

    A direction of columns of unit length depends below the tolerance, a share of the largest singular value.
    """
    scale = np.linalg.norm(columns, axis=0)
    used = columns[:, scale > 0] / scale[scale > 0]
    if used.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    vectors, size, _ = np.linalg.svd(used, full_matrices=False)
    return vectors[:, size > tolerance * size[0]]


def score(
    observed: np.ndarray, design: np.ndarray, nuisance: np.ndarray, instruments: np.ndarray | None = None
) -> Score:
    """Estimating equation of whitened rows (n,), (n, p), nuisance (n, k); instruments (n, p) by default the design."""
    clean = project_out(nuisance, design if instruments is None else instruments)
    return Score(clean.T @ observed, clean.T @ design, clean.T @ clean)


def stable_inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a matrix (p, p) after scaling to unit diagonal; pseudo-inverse where that is singular."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-13) / np.outer(scale, scale)


def covariance(information: np.ndarray) -> np.ndarray:
    """Covariance of a symmetric information matrix (p, p); infinite variance for parameters in its null space."""
    scale = np.sqrt(np.abs(np.diag(information)))
    blank = scale <= 0
    scale = np.where(blank, 1.0, scale)
    size, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    null = size <= 1e-12 * max(size.max(initial=0.0), 1e-300)
    result = (vectors[:, ~null] / size[~null]) @ vectors[:, ~null].T / np.outer(scale, scale)
    lost = blank | (np.abs(vectors[:, null]).max(axis=1, initial=0.0) > 1e-6)
    result[lost, lost] = np.inf
    return result


def covariance_of_moves(value: np.ndarray, moved: list[np.ndarray]) -> np.ndarray:
    """Covariance (..., p, p) of values (..., p) by errors of quantities held fixed: sum d d' of the shifts d.

    With S the covariance where what is held is known, S + sum d d' is that where it is estimated: exactly so for least
    squares of both together. `moved` are the values with what is held shifted by one standard deviation along each
    direction of its errors; what is not determined in one or in both does not move.
    """
    moves = np.stack([one - value for one in moved])
    moves[~np.isfinite(moves)] = 0.0
    return np.einsum("k...i,k...j->...ij", moves, moves)


@dataclass(frozen=True)
class Combination:
    """Joint solution of several observation blocks."""

    value: np.ndarray  #: (p,)
    covariance: np.ndarray  #: (p, p) of noise and of the errors of single blocks
    shift: np.ndarray  #: (m, p) change of the value by one standard deviation of each shared error
    chi2: float  #: disagreement of the blocks with the joint value, shared errors free within their prior
    dof: int  #: degrees of freedom
    noise: np.ndarray  #: (p, p), part of the covariance by the noise
    own: np.ndarray  #: (p, p), by the errors of single blocks


def combine(scores: list[Score], own: list[np.ndarray], shared: list[np.ndarray], prior: np.ndarray) -> Combination:
    """Combination of blocks by the sum of their estimating equations.

    scores : one of each block
    own : (k, p) changes of each block's estimate by one standard deviation of errors of that block alone
    shared : (m, p) the same for errors that act in all blocks together
    prior : (p, p) information about zero, loose, so that what is not determined does not disturb the rest
    """
    weight = [weakening(s.information, m) for s, m in zip(scores, own, strict=True)]
    normal = prior + sum(w @ s.normal for w, s in zip(weight, scores, strict=True))
    right = sum(w @ s.right for w, s in zip(weight, scores, strict=True))
    weighted = [w @ s.information for w, s in zip(weight, scores, strict=True)]
    information = [(one + one.T) / 2 for one in weighted]
    total = prior + sum(information)
    size, vectors = np.linalg.eigh(sum(information))
    used = vectors[:, size > 10 * np.abs(np.diag(prior)).max()]  # a noisy normal matrix may cancel the prior elsewhere
    value = used @ stable_inverse(used.T @ normal @ used) @ used.T @ right
    inverse = stable_inverse(total)
    response = inverse @ sum(i @ m.T for i, m in zip(information, shared, strict=True))
    residuals = [w @ (s.right - s.normal @ value) for w, s in zip(weight, scores, strict=True)]
    modes = [i @ m.T for i, m in zip(information, shared, strict=True)]
    chi2, dof = disagreement(residuals, information, modes)
    # with P = W I the parts of T^-1, T = sum P, are T^-1 (sum P I^-1 P) T^-1 and T^-1 (sum P M M' P) T^-1
    noise = sum(w @ s.information @ w.T for w, s in zip(weight, scores, strict=True))
    moved = [one @ m.T for one, m in zip(weighted, own, strict=True)]
    parts = (inverse @ part @ inverse.T for part in (noise, sum(m @ m.T for m in moved)))
    return Combination(value, covariance(total), response.T, chi2, dof, *parts)


def solution(information: np.ndarray, right: np.ndarray, limit=np.inf) -> tuple[np.ndarray, np.ndarray]:
    """Solution (p,) and covariance (p, p) of the normal equations A'A (p, p), A'y (p,) of whitened rows.

    NaN where the standard deviation of a parameter is not below its limit (p,): the data do not determine it.
    """
    spread = covariance(information)
    determined = (np.diag(spread) > 0) & (np.diag(spread) < np.square(limit))
    spread = np.where(determined[:, None] & determined, spread, np.nan)
    return np.where(determined, stable_inverse(information) @ right, np.nan), spread


def weakening(information: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """Factor W with W I = (I^-1 + M M')^-1 without inverting the information I (p, p); modes (k, p) are M'."""
    if not len(modes):
        return np.eye(information.shape[0])
    M = modes.T
    inner = np.linalg.inv(np.eye(len(modes)) + M.T @ information @ M)
    return np.eye(information.shape[0]) - information @ M @ inner @ M.T


def disagreement(residuals: Sequence, informations: Sequence, modes: Sequence = ()) -> tuple[float, int]:
    """Chi-square and degrees of freedom of score residuals (p,) about a common value, by their information (p, p).

    sum r' N^+ r less what a common value explains; shared errors, modes (p, m) of each, are free within unit priors.
    """
    modes = modes or [np.zeros((informations[0].shape[0], 0))] * len(residuals)
    count, size = modes[0].shape[1], informations[0].shape[0]
    normal, right, total = np.zeros((size + count,) * 2), np.zeros(size + count), 0.0
    normal[size:, size:] = np.eye(count)
    directions = 0
    for residual, information, mode in zip(residuals, informations, modes, strict=True):
        inverse = stable_inverse(information)
        columns = np.concatenate([information, mode], axis=1)
        normal += columns.T @ inverse @ columns
        right += columns.T @ inverse @ residual
        total += residual @ inverse @ residual
        directions += rank(information)
    return float(max(total - right @ stable_inverse(normal) @ right, 0.0)), directions - rank(sum(informations))


def rank(information):
    """Number of independent directions of an information matrix (p, p), scaled to unit diagonal."""
    scale = np.sqrt(np.abs(np.diag(information)))
    used = scale > 0
    if not used.any():
        return 0
    scaled = information[np.ix_(used, used)] / np.outer(scale[used], scale[used])
    return int(np.linalg.matrix_rank(scaled, tol=1e-10, hermitian=True))


def polynomial(time: np.ndarray, degree: int, start: float, stop: float) -> np.ndarray:
    """Legendre polynomials of times (n,) s over an interval, (n, degree + 1); no column for degree -1."""
    u = (2 * time - start - stop) / (stop - start)
    return np.polynomial.legendre.legvander(u, degree) if degree >= 0 else np.zeros((time.size, 0))


@dataclass(frozen=True)
class Filtered:
    """Estimates of a Kalman filter after each observation."""

    value: np.ndarray  #: (n, p) after each observation
    sigma: np.ndarray  #: (n, p) square root of the diagonal of the covariance
    covariance: np.ndarray  #: (p, p) at the end


def filter_constants(
    observed: np.ndarray, design: np.ndarray, value: np.ndarray, covariance: np.ndarray, noise_variance: np.ndarray
) -> Filtered:
    """Constants by a Kalman filter from independent scalar observations y = H x + e (n,), H (n, p), in their order.

    Value (p,) and covariance (p, p): prior, large for a free start; e has variance (n,). K = P H' / (H P H' + R),
    x + K (y - H x), P (1 - K H)' from both sides plus K R K'; Remote Sens. 2023, 15, 3817, eqs. 21 to 23, transition 1,
    no process noise. The end equals least squares with the prior as an observation (erratum T-7).
    """
    x, P, identity = np.array(value, dtype=float), np.array(covariance, dtype=float), np.eye(len(value))
    values, sigmas = np.empty((2, len(observed), x.size))
    for t, (y, h, r) in enumerate(zip(observed, design, np.broadcast_to(noise_variance, len(observed)), strict=True)):
        K = P @ h / (r + h @ P @ h)
        x = x + K * (y - h @ x)
        kept = identity - np.outer(K, h)
        P = kept @ P @ kept.T + r * np.outer(K, K)
        P = (P + P.T) / 2
        values[t], sigmas[t] = x, np.sqrt(np.diag(P))
    return Filtered(values, sigmas, P)


def free_start(design: np.ndarray, noise_variance: np.ndarray, width: float = 1e5) -> np.ndarray:
    """Diagonal prior covariance (p, p) without information: width^2 over that of all observations (n, p)."""
    information = np.sum(design**2 / np.broadcast_to(noise_variance, design.shape[:1])[:, None], axis=0)
    return np.diag(width**2 / np.where(information > 0, information, 1.0))
