"""Robust least squares with IGG-III weights, and the covariance that its scatter supports."""

from dataclasses import dataclass

import numpy as np

from gravcal.estimation.least_squares import stable_inverse


@dataclass(frozen=True)
class RobustEstimate:
    """Solution with down-weighted outliers."""

    value: np.ndarray  #: (p,)
    information: np.ndarray  #: (p, p) inverse covariance
    weight: np.ndarray  #: (n,) IGG-III factor of every observation, 0 to 1
    scale: float  #: robust standard deviation of the residuals
    formal_factor: float  #: formal sigma of the weighted normal equations over that of `information`


def igg3_weights(normalised: np.ndarray, k0: float, k1: float) -> np.ndarray:
    """Weight factors (n,) of the IGG-III scheme for residuals (n,) over robust sigma: full up to k0, none beyond k1.

    1 for |v| <= k0; (k0/|v|) ((k1 - |v|)/(k1 - k0))^2 up to k1; 0 above. Remote Sens. 2022, 14, 3395 names the scheme
    without its form and constants.
    """
    size = np.maximum(np.abs(normalised), 1e-300)
    middle = (k0 / size) * ((k1 - size) / (k1 - k0)) ** 2
    return np.where(size <= k0, 1.0, np.where(size <= k1, middle, 0.0))


def solve(observed: np.ndarray, design: np.ndarray, constants: tuple[float, float], unknowns: int) -> RobustEstimate:
    """IGG-III estimate of whitened observations (n,), (n, p), nuisance projected out, by reweighting with k0 and k1.

    The covariance is that of an M-estimate, s^2 mean(psi^2)/mean(psi')^2 (A'A)^-1 with psi = w v, not the residual
    variance of the weighted normal equations: cutting tails makes that smaller whether or not the estimate is better.
    The unknowns, nuisance and parameters, count for the degrees of freedom.
    """
    normal = design.T @ design
    value = stable_inverse(normal) @ (design.T @ observed)
    for _ in range(50):
        residual = observed - design @ value
        scale = float(np.median(np.abs(residual)) / 0.6744897501960817) if residual.size else 0.0
        weight = igg3_weights(residual / scale, *constants) if scale > 0 else np.ones_like(residual)
        weighted = design.T * weight
        change = stable_inverse(weighted @ design) @ (weighted @ residual)
        value = value + change
        if change @ normal @ change <= 1e-12 * max(scale, 1e-300) ** 2:
            break
    if scale == 0:
        return RobustEstimate(value, normal * np.inf, weight, scale, 1.0)
    v, step = residual / scale, 1e-4
    psi = weight * v
    ahead, behind = (w * igg3_weights(w, *constants) for w in (v + step, v - step))
    slope = np.mean(ahead - behind) / (2 * step)
    variance = scale**2 * np.mean(psi**2) / slope**2 * (residual.size / max(residual.size - unknowns, 1))
    formal = np.sum(weight * residual**2) / max(residual.size - unknowns, 1)
    ratio = np.sqrt(formal / variance * np.trace(normal) / max(np.trace(weighted @ design), 1e-300))
    return RobustEstimate(value, normal / variance, weight, scale, float(ratio))
