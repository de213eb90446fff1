"""Measured records less what an extended model says that its effects add to them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_candidates, discovery_drivers
from gravcal.calibrations.com_offset.discovery_scene import offset_of, scenes
from gravcal.calibrations.com_offset.discovery_view import View, turning, view_of
from gravcal.effects import Context, effect
from gravcal.physics import frames

#: Tags that a delay moves.
TAGS = {"acc_delay": "time_acc", "sca_delay": "time_sca", "mag_delay": "time_mag"}


def extend(aligned: xr.Dataset, field: xr.Dataset, smoothed: xr.Dataset, solved: xr.Dataset, **settings) -> xr.Dataset:
    """Aligned records without the effects of a model, so that the baseline describes what is left.

    To first order in the effects: readings less their contribution, attitude less the rotation that an extra torque
    makes, tags less their delay. Nothing outside the manoeuvres changes but the tags.

    Parameters
    ----------
    aligned, field, smoothed, solved : Dataset, products of the baseline, solved with variant mtq
    settings : model (list of {"cause", "form", "parameters": {name: {"value"}}}), inertia, dipole_per_current, mass,
        and those of the scenes

    Returns
    -------
    extended : Dataset, "com_offset.align"
    """
    model = settings["model"]
    offset = offset_of(solved)
    made = scenes(aligned, field, smoothed, settings)
    views = [view_of(s, (aligned, field, smoothed), {}, offset, settings["mass"]) for s in made]
    extended = aligned.copy(deep=True)
    for entry in model:
        if not _delayed(extended, entry):
            for view in views:
                _subtract(extended, view, contribution(view, entry))
    return extended.assign_attrs(model=" ".join(e["cause"] for e in model))


def _delayed(extended, entry):
    """Tags moved where the entry is a delay; whether it was one."""
    if entry["cause"].startswith("unknown:"):
        return False
    known = effect(entry["cause"])
    if known.channel not in TAGS:
        return False
    name = TAGS[known.channel]
    values = known.values(_values(entry))
    if known.slug.endswith("delay"):  # drifts are below the tags' own error within a day
        extended.coords[name] = extended[name] - values[0]
    return True


def _values(entry: Mapping) -> dict[str, float]:
    """Values by parameter, none where not determined."""
    return {n: p["value"] for n, p in entry["parameters"].items() if p["value"] is not None}


def contribution(view: View, entry: Mapping) -> dict[str, np.ndarray]:
    """What an entry of a model adds to the channels of a manoeuvre, {channel: (samples, 3)}.

    Parameters
    ----------
    view : View
    entry : {"cause", "form", "parameters"}
    """
    if entry["cause"].startswith("unknown:"):
        return _empirical(view, entry)
    known = effect(entry["cause"])
    values = known.values(_values(entry))
    if known.channel in ("dipole_b", "torque_b"):
        torque = discovery_candidates.torque_by(known, values)
        return {channel: signal[:, :, 0] for channel, signal in turning(view, torque).items()}
    channel = discovery_candidates.READ.get(known.channel)
    if channel is None or known.slug == "accelerometer.stray_tone":  # phases differ from manoeuvre to manoeuvre
        return {}
    if channel == "magnetometer":
        time = view.magnetometer[0]
        return {channel: known.contribution(view.at(time), values)} if time.size else {}
    context = Context(time=view.scene.sca_time) if channel == "attitude" else view.context
    return {channel: known.contribution(context, values)}


def _empirical(view, entry):
    """A regressor of the measured channels, times its factors."""
    found = [s for s in discovery_drivers.shapes(view) if (s["cause"], s["form"]) == (entry["cause"], entry["form"])]
    if not found:
        return {}
    values = _values(entry)
    weights = np.array([values.get(n, 0.0) for n in found[0]["names"]])
    return {channel: columns @ weights for channel, columns in found[0]["signal"](view).items()}


def _subtract(extended, view, added):
    """Contribution taken out of the records, in place."""
    scene = view.scene
    for channel, name in (("linear", "linear_b"), ("angular", "angular_b")):
        if channel in added:
            extended[name].values[scene.rows] -= added[channel]
    if "attitude" in added:
        rows = np.flatnonzero(np.isin(extended["time_sca"].values, scene.sca_time[scene.sca_good]))
        turn = frames.from_rotation_vector(-added["attitude"][scene.sca_good])
        values = extended["quaternion"].values
        values[rows] = frames.quaternion_product(values[rows], turn)
    if "magnetometer" in added:
        rows = np.searchsorted(extended["time_mag"].values, view.magnetometer[0])
        extended["field_measured_b"].values[rows] -= added["magnetometer"]
