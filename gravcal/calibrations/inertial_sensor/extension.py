"""Voltages and attitudes of a swing less what an extended model says that its effects add to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import discovery_candidates as listed
from gravcal.calibrations.inertial_sensor.discovery_view import View, context, view
from gravcal.effects import effect
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.base import Context
from gravcal.effects.entries import determined
from gravcal.physics import frames

CHANNELS = {"linear": 0, "angular": 3}  # first of three combinations of voltages
LOOP = "inertial_sensor.loop_delay"


def extend(aligned: xr.Dataset, scaled: xr.Dataset, moved: xr.Dataset, *, model, **scene) -> xr.Dataset:
    """Record of a swing without the effects of a model, so that the baseline describes what is left.

    Contributions are taken out of the combinations of voltages that read them, tags lose their delay, the attitude is
    turned back. A line is left where it is: the model does not hold its phase.

    Parameters
    ----------
    aligned, scaled, moved : Dataset, "inertial_sensor.align", "inertial_sensor.scale", "inertial_sensor.offset"
    model : list of {"cause", "form", "parameters": {name: {"value"}}}
    scene : of `discovery_view.view`

    Returns
    -------
    extended : Dataset, "inertial_sensor.align"
    """
    seen = view(aligned, scaled, moved, **scene)
    extended = aligned.copy(deep=True)
    about = _on(context(seen, fine=False), aligned["time"].values)
    extended["volts"].values[:] -= electrodes.volts(_per_factor(seen, sum(_added(about, seen, e) for e in model)))
    for entry in model:  # last: what is added was read at the tags as they are
        _correct(extended, entry)
    return extended.assign_attrs(model=" ".join(e["cause"] for e in model))


def _on(coarse: Context, time: np.ndarray) -> Context:
    """Context on other epochs by straight lines; before and after it as at its ends."""
    place = np.clip(np.interp(time, coarse.time, np.arange(coarse.time.size)), 0, coarse.time.size - 1)
    before = np.minimum(place.astype(int), coarse.time.size - 2)
    share = place - before

    def moved(values):
        values = np.nan_to_num(values)
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return (1 - weight) * values[before] + weight * values[before + 1]

    known = {f.name: getattr(coarse, f.name) for f in fields(coarse)}
    series = {n: moved(v) for n, v in known.items() if isinstance(v, np.ndarray) and len(v) == coarse.time.size}
    extra = {name: moved(values) for name, values in coarse.extra.items()}
    return replace(coarse, **series | {"time": time, "extra": extra})


def _added(about: Context, seen: View, entry: Mapping) -> np.ndarray:
    """What an entry adds to linear and angular readings, (n, 6) m s-2 and rad s-2."""
    added, values = np.zeros((about.time.size, 6)), determined(entry)
    if entry["cause"].startswith("unknown:"):
        channel = entry["form"].partition(" ")[0]
        size = np.array([values.get(f"{channel}_{axis}", 0.0) for axis in "xyz"])
        for shape in _shapes(seen, entry, channel, about.time):
            added[:, _columns(channel)] += shape[:, None] * size
        return added
    known = effect(entry["cause"])
    channel = known.channel.removesuffix("_b")
    if channel in CHANNELS and known.slug not in (listed.TONE, LOOP):
        added[:, _columns(channel)] = known.contribution(about, known.values(values))
    return added


def _columns(channel):
    """Combinations of voltages that read a channel."""
    return slice(CHANNELS[channel], CHANNELS[channel] + 3)


def _shapes(seen, entry, channel, time):
    """Regressors (n,) 1 of an unknown cause, made where its candidates are made, at other epochs."""
    own = context(seen, fine=channel == "angular")
    for driver, form, shape in listed._series(own, seen) if channel in CHANNELS else ():
        if (entry["cause"], entry["form"]) == (f"unknown:{driver}", f"{channel} reading, {form}"):
            yield np.interp(time, own.time, shape)


def _per_factor(seen, added):
    """Combinations of voltages (n, 6) that read linear and angular accelerations."""
    beta = seen.unknowns.factors[list(seen.swing.owner)]
    return added / np.concatenate([seen.k, beta])


def _correct(extended, entry):
    """Readings without a delay, the tracker without a turn, in place."""
    known = None if entry["cause"].startswith("unknown:") else effect(entry["cause"])
    if known is None or known.channel not in ("acc_delay", "sca_delay", "pointing_b", "angular_b"):
        return
    values, time, volts = known.values(determined(entry)), extended["time"].values, extended["volts"].values
    if known.channel == "acc_delay":
        volts[:] = _later(time, volts, values[0])
    elif known.slug == LOOP:
        both = electrodes.readouts(volts)
        both[:, _columns("angular")] = _later(time, both[:, _columns("angular")], values[0])
        volts[:] = electrodes.volts(both)
    elif known.channel == "sca_delay":
        extended.coords["time_att"] = extended["time_att"] - values[0]
    elif known.channel == "pointing_b":
        attitude = extended["quaternion"].values
        back = frames.from_rotation_vector(np.tile(-values, (len(attitude), 1)))
        attitude[:] = frames.quaternion_product(attitude, back)


def _later(time, series, delay):
    """What a series (n, m) reads a delay later."""
    return np.stack([np.interp(time + delay, time, column) for column in series.T], axis=1)
