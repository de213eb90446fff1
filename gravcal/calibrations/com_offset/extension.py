"""Measured records less what an extended model says that its effects add to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_candidates, discovery_drivers, discovery_lag, discovery_tones
from gravcal.calibrations.com_offset.discovery_view import View, turning
from gravcal.effects import Context, effect
from gravcal.estimation.records import Entry
from gravcal.physics import frames

BEYOND_S = 10.0
EDGES = ("edge_lower", "edge_upper", "start", "stop")
#: Tags that a delay moves.
TAGS = {"acc_delay": "time_acc", "sca_delay": "time_sca", "mag_delay": "time_mag"}


def without(aligned: xr.Dataset, views: list[View], model: Sequence[Entry]) -> xr.Dataset:
    """Aligned records without the effects of a model, so that the baseline describes what is left.

    To first order in the effects: readings less their contribution, attitude less the rotation that an extra torque
    makes, tags less their delay. Nothing outside the manoeuvres changes but the tags.

    Parameters
    ----------
    aligned : Dataset, "com_offset.align"
    views : one a manoeuvre
    model : list of Entry

    Returns
    -------
    extended : Dataset, "com_offset.align"
    """
    extended = aligned.copy(deep=True)
    for entry in sorted(model, key=lambda e: e.cause == discovery_lag.CAUSE):  # what is left says where edges fall
        for view in views:
            placed = discovery_lag.placed(view, entry, extended) if entry.cause == discovery_lag.CAUSE else entry
            _subtract(extended, view, contribution(view, placed), _turns(entry))
    for entry in model:  # last: the samples are found by their tags
        _delay(extended, entry)
    return extended.assign_attrs(model=" ".join(e.cause for e in model))


def _delay(extended, entry):
    """Tags moved where the entry is a delay; drifts are below the tags' own error within a day."""
    known = effect(entry.cause) if entry.listed else None
    if known is not None and known.channel in TAGS and known.slug.endswith("delay"):
        name, delay = TAGS[known.channel], known.values(entry.values)[0]
        extended.coords[name] = extended[name] - delay
        for other in EDGES if name == "time_mag" else ():  # seen in the currents, which have the same tags
            extended[other] = extended[other] - delay


def _turns(entry):
    """Whether an entry is a torque, which turns the body itself."""
    return entry.listed and effect(entry.cause).channel in ("dipole_b", "torque_b")


def contribution(view: View, entry: Entry) -> dict[str, np.ndarray]:
    """What an entry of a model adds to the channels of a manoeuvre, {channel: (samples, 3)}.

    Parameters
    ----------
    view : View
    entry : of a model
    """
    if "frequency" in entry.parameters and entry.cause in ("accelerometer.stray_tone", "unknown:time"):
        return discovery_tones.reading(view, entry)
    if not entry.listed:
        return _empirical(view, entry)
    known = effect(entry.cause)
    values = known.values(entry.values)
    if known.slug == discovery_lag.CAUSE:
        return discovery_lag.reading(view, entry)
    if known.channel in ("dipole_b", "torque_b"):
        torque = discovery_candidates.torque_by(known, values)
        return {channel: signal[:, :, 0] for channel, signal in turning(view, torque).items()}
    channel = discovery_candidates.READ.get(known.channel)
    if channel is None:
        return {}
    if channel == "magnetometer":
        time = view.magnetometer[0]
        return {channel: known.contribution(view.at(time), values)} if time.size else {}
    context = Context(time=view.scene.sca_time) if channel == "attitude" else view.context
    return {channel: known.contribution(context, values)}


def _empirical(view, entry):
    """A regressor of the measured channels, times its factors."""
    found = [s for s in discovery_drivers.shapes(view) if (s["cause"], s["form"]) == (entry.cause, entry.form)]
    if not found:
        return {}
    values = entry.values
    weights = np.array([values.get(n, 0.0) for n in found[0]["names"]])
    return {channel: columns @ weights for channel, columns in found[0]["signal"](view).items()}


def _subtract(extended, view, added, turned):
    """Contribution taken out of the records, in place; where the body itself turned, the field turns with it."""
    scene = view.scene
    for channel, name in (("linear", "linear_b"), ("angular", "angular_b")):
        if channel in added:
            extended[name].values[scene.rows] -= added[channel]
    if "attitude" in added:
        rows, angle = _angle(extended["time_sca"].values, scene.sca_time, added["attitude"])
        values = extended["quaternion"].values
        values[rows] = frames.quaternion_product(values[rows], frames.from_rotation_vector(-angle))
        if turned:  # the field as a body that did not turn would see it
            rows, angle = _angle(extended["time_mag"].values, scene.sca_time, added["attitude"])
            extended["field_measured_b"].values[rows] = _rotated(angle, extended["field_measured_b"].values[rows])
    if "magnetometer" in added:
        _subtract_field(extended, view.magnetometer[0], added["magnetometer"])


def _angle(time, known, angle):
    """Rows of a record near a manoeuvre, and the rotation there; held beyond its ends, where others interpolate."""
    rows = slice(*np.searchsorted(time, [known[0] - BEYOND_S, known[-1] + BEYOND_S]))
    return rows, np.stack([np.interp(time[rows], known, a) for a in angle.T], axis=1)


def _rotated(angle, vectors):
    """Turned vectors; one that is written a second time stays what it was the first time."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_rotvec(angle).apply(vectors)
    again = 1 + np.flatnonzero(np.all(vectors[1:] == vectors[:-1], axis=1))
    turned[again] = turned[again - 1]
    return turned


def _subtract_field(extended, time, added):
    """Contribution taken out of the field, in place; a value that is written twice stays the same in both records."""
    values = extended["field_measured_b"].values
    rows = np.searchsorted(extended["time_mag"].values, time)
    size = len(values) - 1
    again = [np.all(values[np.clip(rows + d, 0, size)] == values[rows], axis=1) for d in (-1, 1)]
    for step, same in zip((-1, 1), again, strict=True):
        others = np.clip(rows[same] + step, 0, size)
        fresh = ~np.isin(others, rows)
        values[others[fresh]] -= added[same][fresh]
    values[rows] -= added
