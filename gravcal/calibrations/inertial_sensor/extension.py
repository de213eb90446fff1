"""Voltages and attitudes of a swing, and bins of a roll, less what an extended model says that its effects add."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import discovery_candidates as listed
from gravcal.calibrations.inertial_sensor import discovery_roll as rolls
from gravcal.calibrations.inertial_sensor.discovery_view import View, context, view
from gravcal.calibrations.inertial_sensor.swing import OWNER
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


def extend_roll(segmented: xr.Dataset, biased: xr.Dataset, *swing: xr.Dataset, model, **settings) -> xr.Dataset:
    """Bins of a roll without the effects of a model on the linear readings; drifts count from its middle.

    Parameters
    ----------
    segmented, biased : Dataset, "inertial_sensor.segment" and "inertial_sensor.bias"
    swing : Dataset, "inertial_sensor.scale" and "inertial_sensor.offset", or none
    model : as for `extend`
    settings : as for `discovery_roll.roll`

    Returns
    -------
    extended : Dataset, "inertial_sensor.segment"
    """
    extended = segmented.copy(deep=True).assign_attrs(model=" ".join(e["cause"] for e in model))
    _, parts = rolls.spans(segmented, settings["segment_s"])
    known = ("linear_volt", "R_bo", "rate_b", "gradient_b")
    whole = [k for k, part in enumerate(parts) if all(np.isfinite(segmented[n].values[part]).all() for n in known)]
    if not whole or not np.isfinite(biased["bias"].values).all():
        return extended
    seen = rolls.fitted(segmented, biased, *swing, used=whole, **settings)
    about = rolls.context(seen)
    added = sum(_added_in_roll(about, seen, one) for one in model)
    for k, part in zip(whole, added.reshape(*seen.time.shape, 3) / seen.k, strict=True):
        extended["linear_volt"].values[parts[k]] -= part
    return extended


def _added_in_roll(about, seen, entry):
    """What an entry adds to the linear readings of a roll, (n, 3) m s-2."""
    values, added = determined(entry), np.zeros((about.time.size, 3))
    if entry["cause"].startswith("unknown:"):
        size = np.array([values.get(f"linear_{axis}", 0.0) for axis in "xyz"])
        for driver, form, shape in rolls.series(seen):
            if (entry["cause"], entry["form"]) == (f"unknown:{driver}", f"{rolls.CHANNEL} reading, {form}"):
                added += shape.ravel()[:, None] * size
        return added
    known = effect(entry["cause"])
    before = "time" in values and values["time"] < about.time[0]  # a step that the bias of the roll contains
    if known.channel != "linear_b" or known.slug == listed.TONE or before:
        return added
    return known.contribution(about, known.values(values))


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
    beta = seen.unknowns.factors[OWNER]
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
