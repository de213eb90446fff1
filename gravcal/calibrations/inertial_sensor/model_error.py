"""Errors of an extended model in the results of a swing and of a roll."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import replaced
from gravcal.calibrations.model_error import widened
from gravcal.estimation.least_squares import covariance_of_moves

#: Values, and the standard deviations that hold every error of theirs: of a swing, of a roll.
SWING = {"beta": ("beta_sigma",), "delay": ("delay_sigma",), "k": ("k_sigma", "k_sigma_total")}
ROLL = {"bias": ("bias_sigma", "bias_sigma_total")}


def of_scale(scaled: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Scale factors with errors that hold those of the effects that were taken out of the record before.

    Parameters
    ----------
    scaled : Dataset, "inertial_sensor.scale"
    moved : Dataset, "inertial_sensor.scale", one for each direction of the model's errors

    Returns
    -------
    scaled : Dataset, "inertial_sensor.scale"
    """
    new = widened(scaled, moved, {"batch_value": ("covariance",)})
    return replaced(scaled, new | _each_alone(scaled, moved, SWING))


def _each_alone(found, moved, held):
    """Standard deviations with the errors of a model, {variable: array}, of values without covariances."""
    new = {}
    for name, sigmas in held.items():
        each = (one[name].values[..., None] for one in moved)
        square = covariance_of_moves(found[name].values[..., None], list(each))[..., 0, 0]
        new |= {sigma: np.sqrt(found[sigma].values ** 2 + square) for sigma in sigmas}
    return new


def of_offset(found: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Offset with covariances that hold the errors of the effects that were taken out of the record before.

    Parameters
    ----------
    found : Dataset, "inertial_sensor.offset"
    moved : Dataset, "inertial_sensor.offset", one for each direction of the model's errors

    Returns
    -------
    found : Dataset, "inertial_sensor.offset"
    """
    return replaced(found, widened(found, moved, {"offset": ("covariance", "covariance_total")}))


def of_bias(found: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Bias with errors that hold those of the effects that were taken out of the bins before.

    Parameters
    ----------
    found : Dataset, "inertial_sensor.bias"
    moved : Dataset, "inertial_sensor.bias", one for each direction of the model's errors

    Returns
    -------
    found : Dataset, "inertial_sensor.bias"
    """
    return replaced(found, _each_alone(found, moved, ROLL))
