"""Kalman filter for constants: recursive least squares, one observation after the other."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Filtered:
    """Estimates as they develop."""

    value: np.ndarray  #: (n, p) after each observation
    sigma: np.ndarray  #: (n, p) square root of the diagonal of the covariance
    covariance: np.ndarray  #: (p, p) at the end


def filter_constants(
    observed: np.ndarray, design: np.ndarray, value: np.ndarray, covariance: np.ndarray, noise_variance: np.ndarray
) -> Filtered:
    """Estimate constants from independent scalar observations y = H x + e (n,), H (n, p), in their order.

    Value (p,) and covariance (p, p) hold before the first observation, large for a free start; e has variance (n,). K =
    P H' / (H P H' + R), x + K (y - H x), P (1 - K H)' from both sides plus K R K'; Remote Sens. 2023, 15, 3817, eqs. 21
    to 23 with transition 1 and no process noise. The end equals least squares with the start as an observation (erratum
    T-7).
    """
    x, P, one = np.array(value, dtype=float), np.array(covariance, dtype=float), np.eye(len(value))
    values, sigmas = np.empty((2, len(observed), x.size))
    for t, (y, h, r) in enumerate(zip(observed, design, np.broadcast_to(noise_variance, len(observed)), strict=True)):
        K = P @ h / (r + h @ P @ h)
        x = x + K * (y - h @ x)
        left = one - np.outer(K, h)
        P = left @ P @ left.T + r * np.outer(K, K)
        P = (P + P.T) / 2
        values[t], sigmas[t] = x, np.sqrt(np.diag(P))
    return Filtered(values, sigmas, P)


def free_start(design: np.ndarray, noise_variance: np.ndarray, width: float = 1e5) -> np.ndarray:
    """Covariance (p, p) of a start that says nothing: `width` squared times what all (n, p) observations will know."""
    information = np.sum(design**2 / np.broadcast_to(noise_variance, design.shape[:1])[:, None], axis=0)
    return np.diag(width**2 / np.where(information > 0, information, 1.0))
