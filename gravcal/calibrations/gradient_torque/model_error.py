"""Errors of an extended model in the drag."""

from __future__ import annotations

import xarray as xr

from gravcal.calibrations.building import replaced
from gravcal.methods.estimation import covariance_of_moves


def of_drag(found: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Drag with covariances that hold the errors of the effects that were taken out of the readings before.

    Parameters
    ----------
    found : Dataset, "gradient_torque.drag"
    moved : Dataset, "gradient_torque.drag", one for each direction of the model's errors

    Returns
    -------
    widened : Dataset, "gradient_torque.drag"
    """
    extra = covariance_of_moves(found["drag_b"].values, [one["drag_b"].values for one in moved])
    widened = {name: found[name].values + extra for name in ("covariance", "covariance_total")}
    if "pressure" in found:
        shift = covariance_of_moves(found["pressure"].values, [one["pressure"].values for one in moved])
        widened["pressure_covariance"] = found["pressure_covariance"].values + shift
    return replaced(found, widened)
