"""Mean of many segments that a few bad ones do not move, with an error that the scatter shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LIMIT = 3.0  # standard deviations from the neighbours beyond which a value is drawn in
NEIGHBOURS = 5  # values of the running median


@dataclass(frozen=True)
class RobustMean:
    """Mean, its sigma, scatter of neighbours and standard deviation of the slow wander."""

    value: float
    sigma: float
    scatter: float
    wander: float
    weight: np.ndarray


def robust_mean(values: np.ndarray, sigma: np.ndarray, missing: Sequence[int] = ()) -> RobustMean:
    """Mean over the time covered, of values that stand out from their neighbours no more than a limit.

    Its error comes from the error of every value; what the values scatter beyond it is a slow wander, which a mean over
    the time covered rightly contains. So a value is judged by its neighbours: judged by the mean of all, wander would
    count as outlying, and the result be no mean of it. Where values are missing the wander is not seen, and its error
    is added.

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
    Runs of r values left out of N add wander^2 sum r^2 / N^2, neighbours being alike.
    """
    from scipy.ndimage import median_filter

    values, sigma = np.asarray(values, dtype=float), np.asarray(sigma, dtype=float)
    if values.size < 3:
        empty = np.mean(values) if values.size else np.nan
        return RobustMean(float(empty), np.nan, np.nan, np.nan, np.ones(values.size))
    noise = np.sqrt(np.mean(sigma**2))
    local = median_filter(values, size=min(NEIGHBOURS, values.size), mode="mirror")
    left = values - local
    limit = LIMIT * max(1.4826 * np.median(np.abs(left)), noise, 1e-300)
    weight = np.minimum(1.0, limit / np.maximum(np.abs(left), 1e-300))
    drawn = local + weight * left
    wander = np.sqrt(max(np.var(drawn, ddof=1) - noise**2, 0.0))
    unseen = wander * np.linalg.norm(missing) / (values.size + sum(missing))
    error = np.hypot(noise / np.sqrt(values.size), unseen)
    scatter = np.sqrt(np.mean(np.diff(drawn) ** 2) / 2)
    return RobustMean(float(drawn.mean()), float(error), float(scatter), float(wander), weight)
