"""Offset of every manoeuvre as printed in the source paper, for comparison."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.equations import arrays, reading, samples, where
from gravcal.calibrations.com_offset.solve import nothing, product
from gravcal.estimation import least_squares


def solve(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset) -> xr.Dataset:
    """Offsets and formal errors as printed, CoM paper eqs. 3-9; errata C-7 and C-12 say what is wrong with them.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"

    Returns
    -------
    solved : Dataset, "com_offset.solve"
    """
    variant = angular.attrs["variant"]
    aligned, smoothed, angular = (arrays(one) for one in (aligned, smoothed, angular))
    place, count = where(aligned), aligned["start"].size
    offset, information = np.full((count, 3), np.nan), np.zeros((count, 3, 3))
    for i in range(count):
        inside = samples(smoothed, i)
        if inside is None:
            continue
        time = smoothed["time_acc"][inside]
        linear, marked = reading(aligned, time)
        rates = smoothed["rate_b"][inside], angular["rate_dot_b"][inside]
        kept = published.components(int(place["kind"][i]), float(place["latitude"][i]))
        offset[i], formal = published.solve_one(time, ~marked, linear, rates, kept)
        information[i][np.ix_(kept, kept)] = least_squares.stable_inverse(formal[np.ix_(kept, kept)])
    values = nothing(count) | {"offset": offset, "information": information, "normal": information}
    values["right"] = np.matvec(information, np.nan_to_num(offset))
    return product(values, place | {"mode_shared": [], "mode_catalogue": []}, variant, "published")
