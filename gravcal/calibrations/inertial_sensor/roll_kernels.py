"""Compiled means over bins: millions of samples in one pass each."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def clipped_means(values, bounds, limit):
    """Means over bins, the sample farthest from the mean taken out until none is farther than the limit.

    Parameters
    ----------
    values : (n, m) any unit, NaN left out
    bounds : (b + 1,) first sample of each bin, and one past the last
    limit : (m,) unit

    Returns
    -------
    mean : (b, m), NaN where nothing is left; count : (b, m) samples used
    """
    bins, width = bounds.size - 1, values.shape[1]
    mean = np.full((bins, width), np.nan)
    number = np.zeros((bins, width))
    for b in range(bins):
        first, last = bounds[b], bounds[b + 1]
        for c in range(width):
            total, count = 0.0, 0
            for t in range(first, last):
                if np.isfinite(values[t, c]):
                    total += values[t, c]
                    count += 1
            if count == 0:
                continue
            middle, count = _without_spikes(values[first:last, c], total, count, limit[c])
            mean[b, c] = middle
            number[b, c] = count
    return mean, number


@numba.njit(cache=True, nogil=True)
def _without_spikes(samples, total, count, limit):
    """Mean and count of the samples within the limit of their mean."""
    whole = count
    middle = total / count
    far = 0.0
    for value in samples:
        if abs(value - middle) > far:
            far = abs(value - middle)
    if far <= limit:
        return middle, count
    middle = np.nanmedian(samples)  # a spike does not move it
    shift, count = 0.0, 0
    for value in samples:
        if abs(value - middle) <= limit:
            shift += value - middle
            count += 1
    if count == 0:
        return middle, whole
    return middle + shift / count, count


@numba.njit(cache=True, nogil=True)
def mean_quaternions(quaternion, bounds):
    """Normalised mean of the attitudes of each bin, signs made equal to that of the first.

    Parameters
    ----------
    quaternion : (n, 4), NaN left out; bounds : (b + 1,) as for clipped_means

    Returns
    -------
    mean : (b, 4), NaN where empty or of no norm; count : (b,)
    """
    bins = bounds.size - 1
    mean = np.full((bins, 4), np.nan)
    number = np.zeros(bins)
    for b in range(bins):
        total = np.zeros(4)
        count = 0
        for t in range(bounds[b], bounds[b + 1]):
            q = quaternion[t]
            if not (np.isfinite(q[0]) and np.isfinite(q[1]) and np.isfinite(q[2]) and np.isfinite(q[3])):
                continue
            same = total[0] * q[0] + total[1] * q[1] + total[2] * q[2] + total[3] * q[3]
            sign = -1.0 if same < 0 else 1.0
            for c in range(4):
                total[c] += sign * q[c]
            count += 1
        size = np.sqrt(np.sum(total**2))
        if size > 0:
            for c in range(4):
                mean[b, c] = total[c] / size
            number[b] = count
    return mean, number
