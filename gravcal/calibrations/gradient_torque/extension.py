"""Readings and attitudes of a day of S-GRS less what an extended model says that its effects add to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.calibrations.gradient_torque.discovery_candidates import shapes
from gravcal.calibrations.gradient_torque.discovery_effects import POINTING, reading
from gravcal.calibrations.gradient_torque.discovery_view import View, view
from gravcal.effects import effect
from gravcal.effects.entries import determined
from gravcal.physics import frames


def extend(observed: xr.Dataset, modelled: xr.Dataset, found: xr.Dataset, *, model, **scene) -> xr.Dataset:
    """Record without the effects of a model, so that the baseline describes what is left.

    A torque turns the satellite itself and stays in the record: it changes the torque balance alone, whose part it is.

    Parameters
    ----------
    observed, modelled, found : Dataset, "ingest", "gradient_torque.gradient", "gradient_torque.drag" by one sensor
    model : list of {"cause", "form", "parameters": {name: {"value"}}}
    scene : of `discovery_view.view`

    Returns
    -------
    extended : Dataset, "ingest"
    """
    if not model:
        return observed
    seen = view(observed, modelled, found, **scene)
    extended = observed.copy(deep=True)
    for entry in model:
        linear, angular = _added(seen, entry)
        extended["linear"].values[:] += linear  # minus a reading is what the files hold
        extended["angular"].values[:] += angular
        if entry["cause"] == POINTING:
            known = effect(entry["cause"])
            back = frames.from_rotation_vector(np.tile(-known.values(determined(entry)), (seen.fine.time.size, 1)))
            extended["q"].values[:] = frames.quaternion_product(extended["q"].values, back)
    return extended.assign_attrs(model=" ".join(e["cause"] for e in model))


def _added(seen: View, entry: Mapping) -> tuple[np.ndarray, np.ndarray]:
    """What an entry adds to the readings of each sensor, (n, sensors, 3) m s-2 and rad s-2."""
    values, sensors = determined(entry), len(seen.fine.extra["positions"])
    linear, angular = np.zeros((2, seen.fine.time.size, sensors, 3))
    if entry["cause"].startswith("unknown:"):
        _add_unknown(seen, entry, values, linear, angular)
        return linear, angular
    known = effect(entry["cause"])
    if known.channel == "linear_each_b":
        linear += known.contribution(seen.fine, known.values(values))
    elif known.channel == "angular_each_b":
        angular += known.contribution(seen.fine, known.values(values))
    elif known.channel == "angular_b":
        turning = replace(seen.fine, angular_b=seen.fine.rate_dot_b)
        angular += known.contribution(turning, known.values(values))[:, None]
    elif known.channel == "linear_b":
        for sensor in range(sensors):
            own = {n.removesuffix(f"_{sensor + 1}"): v for n, v in values.items() if n.endswith(f"_{sensor + 1}")}
            about = replace(seen.fine, linear_b=reading(seen.fine, sensor))
            linear[:, sensor] += known.contribution(about, known.values(own)) if own else 0.0
    return linear, angular


def _add_unknown(seen, entry, values, linear, angular):
    """A driver in the difference of the sensors, half in each, or in all angular readings; in place."""
    channel, _, form = entry["form"].partition(", ")
    size = np.array([values.get(f"{channel}_{axis}", 0.0) for axis in "xyz"])
    for driver, name, shape in shapes(seen):
        if (f"unknown:{driver}", name) != (entry["cause"], form):
            continue
        if channel == "linear" and linear.shape[1] == 2:
            linear += shape[:, None, None] * size * np.array([-0.5, 0.5])[:, None]
        elif channel == "attitude":
            angular -= shape[:, None, None] * size
