"""Errors of an extended model in the results that are found without its effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from gravcal.estimation.least_squares import covariance_of_moves


def widened(
    found: xr.Dataset, moved: Sequence[xr.Dataset], covariances: Mapping[str, Sequence[str]]
) -> dict[str, np.ndarray]:
    """Covariances with the errors of a model, {variable: (..., p, p)} for `building.replaced`.

    Parameters
    ----------
    found : Dataset
    moved : Dataset of the same kind, one for each direction of the model's errors
    covariances : {variable (..., p): variables (..., p, p) that hold its covariances}
    """
    new = {}
    for name, held in covariances.items():
        extra = covariance_of_moves(found[name].values, [one[name].values for one in moved])
        new |= {covariance: found[covariance].values + extra for covariance in held}
    return new


def widened_sigmas(
    found: xr.Dataset, moved: Sequence[xr.Dataset], sigmas: Mapping[str, Sequence[str]]
) -> dict[str, np.ndarray]:
    """Standard deviations with the errors of a model, {variable: array}, of values without covariances.

    Parameters
    ----------
    found : Dataset
    moved : Dataset of the same kind, one for each direction of the model's errors
    sigmas : {variable: variables that hold its standard deviations}
    """
    new = {}
    for name, held in sigmas.items():
        each = [one[name].values[..., None] for one in moved]
        square = covariance_of_moves(found[name].values[..., None], each)[..., 0, 0]
        new |= {sigma: np.sqrt(found[sigma].values ** 2 + square) for sigma in held}
    return new
