"""Mean of many segments that a few bad ones do not move, with an error that the scatter shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

TUNING = 1.5  # Huber, in standard deviations: 96 % efficient for Gaussian scatter
EFFICIENCY = 1.02  # so much wider is the error for it


@dataclass(frozen=True)
class RobustMean:
    """Mean, its sigma, scatter of neighbours and standard deviation of the slow wander."""

    value: float
    sigma: float
    scatter: float
    wander: float
    weight: np.ndarray


def robust_mean(values: np.ndarray, sigma: np.ndarray, missing: Sequence[int] = ()) -> RobustMean:
    """Huber mean over the time covered.

    Its error comes from the error of every value; what the values scatter beyond it is a slow wander, which a mean over
    the time covered rightly contains. Where values are missing the wander is not seen, and its error is added.

    Parameters
    ----------
    values : (n,) any unit, in order of time
    sigma : (n,) standard deviation of each, same unit
    missing : lengths of the runs of values left out between them

    Returns
    -------
    mean : RobustMean; sigma is NaN for fewer than three values

    Notes
    -----
    sum psi((x - m)/s) = 0; var m = sum psi^2 / (sum psi')^2; Huber 1981, ch. 6; runs of r values left out of N add
    wander^2 sum r^2 / N^2, neighbours being alike.
    """
    values, sigma = np.asarray(values, dtype=float), np.asarray(sigma, dtype=float)
    if values.size < 3:
        empty = np.mean(values) if values.size else np.nan
        return RobustMean(float(empty), np.nan, np.nan, np.nan, np.ones(values.size))
    middle = np.median(values)
    size = max(1.4826 * np.median(np.abs(values - middle)), 1e-300)
    for _ in range(100):
        weight = np.minimum(1.0, TUNING * size / np.maximum(np.abs(values - middle), 1e-300))
        moved = np.sum(weight * values) / np.sum(weight)
        if abs(moved - middle) < 1e-9 * size:
            break
        middle = moved
    noise = np.sqrt(np.mean(sigma**2))
    wander = np.sqrt(max(size**2 - noise**2, 0.0))
    unseen = wander * np.linalg.norm(missing) / (values.size + sum(missing))
    error = np.hypot(EFFICIENCY * noise / np.sqrt(values.size), unseen)
    return RobustMean(float(middle), float(error), _neighbour_scatter(values), float(wander), weight)


def _neighbour_scatter(values):
    """Standard deviation of one value from winsorised differences of neighbours."""
    difference = np.diff(values) / np.sqrt(2)
    size = max(1.4826 * np.median(np.abs(difference)), 1e-300)
    clipped = np.clip(difference, -TUNING * 2 * size, TUNING * 2 * size)
    return float(np.sqrt(np.mean(clipped**2)))
