"""Gravity field and truth as products."""

from __future__ import annotations

import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque.schemas import FIELD, TRUTH


def field(read) -> xr.Dataset:
    """Product of a gravity field.

    Parameters
    ----------
    read : gravity_field.Field
    """
    names = ("cosine", "sine", "cosine_sigma", "sine_sigma", "gm", "radius")
    return build(FIELD, {name: getattr(read, name) for name in names}, title="Gravity field", field=read.name)


def truth(read: xr.Dataset) -> xr.Dataset:
    """Product of the true drag.

    Parameters
    ----------
    read : Dataset, "ingest" of a file of truth
    """
    values = {"time": read["time"].values, "drag_b": read["drag"].values}
    return build(TRUTH, values, title="Drag of a simulated day")
