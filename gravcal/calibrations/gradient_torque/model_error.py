"""Errors of an extended model in the drag."""

from __future__ import annotations

import xarray as xr

from gravcal.calibrations.building import replaced
from gravcal.calibrations.model_error import widened

#: Results, and the covariances that hold every error of theirs.
HELD = {"drag_b": ("covariance", "covariance_total"), "pressure": ("pressure_covariance",)}


def of_drag(found: xr.Dataset, *moved: xr.Dataset) -> xr.Dataset:
    """Drag with covariances that hold the errors of the effects that were taken out of the readings before.

    Parameters
    ----------
    found : Dataset, "gradient_torque.drag"
    moved : Dataset, "gradient_torque.drag", one for each direction of the model's errors

    Returns
    -------
    found : Dataset, "gradient_torque.drag"
    """
    held = HELD if "pressure" in found else {"drag_b": HELD["drag_b"]}
    return replaced(found, widened(found, moved, held))
