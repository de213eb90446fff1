"""Responses of a swing and a roll to effects of the catalogue and drivers in no list; the records without them."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.calibrations.causes import added_by, along, listed, on_axes, unknown
from gravcal.calibrations.inertial_sensor import model as fits
from gravcal.calibrations.inertial_sensor.bias import cut
from gravcal.calibrations.inertial_sensor.observed_roll import CHANNEL, RollView, view_of_segments
from gravcal.calibrations.inertial_sensor.observed_swing import STEP, TONE, SwingView
from gravcal.effects import Context, effect
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.drivers import lagged, products
from gravcal.estimation.records import Candidate, Entry, at_epoch
from gravcal.estimation.resampling import lines_between
from gravcal.physics import frames

LOOP = "inertial_sensor.loop_delay"
#: Effects of other families that a sensor of this kind can have.
OTHERS = tuple(f"accelerometer.{name}" for name in ("scale", "misalignment", "angular_leak"))
OTHERS += ("timing.accelerometer_delay", "timing.star_camera_delay")
EFFECTS = (*electrodes.EFFECTS, *map(effect, OTHERS))
#: First of the three combinations of voltages that read a channel.
COMBINATIONS = {"linear": slice(0, 3), "angular": slice(3, 6)}
STEP_S, QUIET_STEP_S = 2.0, 6.0  # between epochs at which a step is looked for, in a swing and in the quiet data beside
MARGIN_S = 10.0  # from the ends of the record, where none is
MEMORIES_S = 4.0 * 1.6 ** np.arange(6)  # of the size of a rate that may warm something; nearer ones are hardly apart
REST = 1e-3  # s, memory of what ends with the motion
FIXED_POINT = 6  # iterations of offset and effects from each other
INVERTED = 30  # iterations of voltages from what was added to them


def of_swing(view: SwingView) -> list[Candidate]:
    """Candidates: effects, steps, then functions of motion and time, added to the linear or to the angular readings."""
    about, candidates = view.context(), []
    for entry in EFFECTS:
        candidates += listed(entry, view.cut(**_of_effect(view, entry, about))).each_alone()
    epochs = np.arange(view.time[0] + MARGIN_S, view.time[-1] - MARGIN_S, STEP_S)
    kept = [abs(at - view.record.time.mean()) < np.ptp(view.record.time) / 2 for at in epochs]
    kept |= np.arange(epochs.size) % round(QUIET_STEP_S / STEP_S) == 0
    candidates += steps(view, epochs[kept])
    for driver, form, values, tau in _series(view, about):
        added = _at(view.time, about.time, values, tau)
        added[view.inside] = view.binned(values)
        linear, angular = view.linear_rows(on_axes(added)), -view.turned_rows(on_axes(values))
        read = ("linear", view.cut(linear=linear), "m s-2"), ("angular", view.cut(attitude=angular), "rad s-2")
        if driver == "angular_acceleration" and form.startswith("component"):  # of the linear reading: the angular leak
            read = read[1:]
        candidates += [unknown(driver, f"{name} reading, {form}", c, unit, along(name)) for name, c, unit in read]
    return candidates


def _of_effect(view, entry, about):
    """Whitened rows {channel: (n, q)} of an effect, from the context of the swing."""
    match entry.channel:
        case "linear_b":
            return {"linear": view.linear_rows(view.binned(entry.columns(about)))}
        case "angular_b":
            return _of_angular(view, entry.columns(about))
        case "electrode_v":
            added = np.einsum("rv,nvq->nrq", electrodes.READOUT, entry.columns(about))
            rows = _of_angular(view, view.unknowns.factors[fits.OWNER][:, None] * added[:, 3:])
            linear = view.linear_rows(view.binned(view.k[:, None] * added[:, :3]))
            return rows | {"linear": rows["linear"] + linear}
        case "acc_delay":  # readings of before; linear ones and their model move together
            late = np.gradient(about.angular_b, about.time, axis=0)[:, :, None]
            return {"attitude": view.turned_rows(late)}
        case "sca_delay":
            rate = lines_between(view.swing.time_att, about.time, about.rate_b)
            return {"attitude": view.attitude_rows(-rate[:, :, None])}
    return {"attitude": view.attitude_rows(np.broadcast_to(np.eye(3), (view.swing.time_att.size, 3, 3)))}


def _of_angular(view, added):
    """Whitened rows {channel: (n, q)} of additions (n, 3, q) rad s-2 to angular readings, linear ones by the offset."""
    linear = np.moveaxis(np.cross(np.moveaxis(added, 2, 1), view.start[3:6]), 1, 2)
    return {"attitude": -view.turned_rows(added), "linear": -view.linear_rows(view.binned(linear))}


def steps(view: SwingView, epochs: np.ndarray) -> list[Candidate]:
    """Candidates of a step of the linear readings at each of some epochs (k,) s."""
    time, width = view.time, view.record.time[1] - view.record.time[0]
    after = np.clip((time + width / 2 - epochs[:, None]) / width, 0, 1)[:, :, None, None] * np.eye(3)
    return [step(t, view.cut(linear=view.linear_rows(one))) for t, one in zip(epochs, after, strict=True)]


def step(epoch: float, columns: list[np.ndarray | None]) -> Candidate:
    """Candidate of a step of the linear readings at an epoch s, from the whitened columns (n, 3) of each block."""
    return Candidate(at_epoch(STEP, epoch), f"time {epoch:.1f} s", ["x", "y", "z"], ["m s-2"] * 3, columns)


def _at(time, epochs, values, tau):
    """Values (n,) at `epochs` (n,) s, interpolated to times s; zero before, decaying with memory tau s behind."""
    return np.interp(time, epochs, values, left=0.0) * np.exp(-np.clip(time - epochs[-1], 0, None) / tau)


def _series(view, about) -> list[tuple[str, str, np.ndarray, float]]:
    """Regressors at the epochs of a context: driver, form, values (n,) 1 of size near one, and their memory s."""
    rate = about.rate_b - about.rate_b.mean(axis=0)
    angle = np.cumsum(np.nan_to_num(rate) * np.diff(about.time, prepend=about.time[0])[:, None], axis=0)
    rows = []
    for name, values in (("rate", rate), ("attitude", angle), ("angular_acceleration", about.rate_dot_b)):
        values = np.nan_to_num(values) / max(np.nanmax(np.abs(values)), 1e-30)
        rows += [(name, f"component {a}", values[:, i], REST) for i, a in enumerate("xyz")]
        rows += [(name, *one, REST) for one in products(values)]
        rows += [(name, f"size of {a}", np.abs(values[:, i]), REST) for i, a in enumerate("xyz")]
        rows += [(name, f"cube of {a}", values[:, i] ** 3, REST) for i, a in enumerate("xyz")]
    rate_size = np.abs(np.nan_to_num(rate)) / max(np.nanmax(np.abs(rate)), 1e-30)
    for tau, (i, a) in itertools.product(MEMORIES_S, enumerate("xyz")):
        rows.append(("rate", f"memory of {tau:g} s of the size of {a}", lagged(about.time, rate_size[:, i], tau), tau))
    since = np.clip(about.time - view.record.time[0], 0, None)
    return rows + [("time", f"decay of {t:g} s", np.exp(-since / t), t) for t in (10.0, 30.0, 90.0)]


def swing_without(view: SwingView, model: Sequence[Entry]) -> xr.Dataset:
    """Record of the swing without the effects of a model, so that the baseline describes what is left.

    Contributions are taken out of the combinations of voltages that read them, tags lose their delay, the attitude
    is turned back. A line is left where it is: the model does not hold its phase.
    """
    extended = view.aligned.copy(deep=True)
    volts, time = extended["volts"].values, extended["time"].values
    about, added = view.context(time, _place_without(view, model)), np.zeros((time.size, 6))
    for entry in model:
        if entry.listed and effect(entry.cause).channel == "electrode_v":  # first: it acted on all that was read
            volts -= distortion(entry, about, volts)
        for channel, part in COMBINATIONS.items():
            added[:, part] += _added(view, entry, channel, about)
    volts -= electrodes.volts(added / np.concatenate([view.k, view.unknowns.factors[fits.OWNER]]))
    for entry in (one for one in model if one.listed):  # last: what is added was read at the tags as they are
        known = effect(entry.cause)
        values = known.values(entry.values)
        if known.channel == "acc_delay":
            volts[:] = lines_between(time + values[0], time, volts)
        elif known.slug == LOOP:
            readouts = electrodes.readouts(volts)
            readouts[:, 3:] = lines_between(time + values[0], time, readouts[:, 3:])
            volts[:] = electrodes.volts(readouts)
        elif known.channel == "sca_delay":
            extended.coords["time_att"] = extended["time_att"] - values[0]
        elif known.channel == "pointing_b":
            attitude = extended["quaternion"].values
            back = frames.from_rotation_vector(np.tile(-values, (len(attitude), 1)))
            attitude[:] = frames.quaternion_product(attitude, back)
    return extended.assign_attrs(model=" ".join(one.cause for one in model if one.values))


def distortion(entry: Entry, about: Context, recorded: np.ndarray) -> np.ndarray:
    """Voltages (n, 6) V that an entry has added to the recorded ones, by its law of the undistorted ones.

    Beyond the reading itself the law of a square has no way back: its share is limited to that.
    """
    known, added = effect(entry.cause), np.zeros_like(recorded)
    for _ in range(INVERTED):
        before = replace(about, extra={**about.extra, "volts": recorded - added})
        added = known.contribution(before, known.values(entry.values)).clip(-np.abs(recorded), np.abs(recorded))
    return added


def _place_without(view, model):
    """Offset (3,) m by the readings along x and z less the effects of a model, which in turn depend on the offset.

    With a coupling of a quarter the offset of the readings as they are left z wrong by 4.3 sigma, this one by 0.3.
    """
    offset = view.start[3:6]
    columns = np.concatenate([np.nan_to_num(view.tensor), on_axes(view.record.trend)], axis=2)
    along_xz = np.repeat([True, False, True], view.time.size)  # the factor of a_y is not known
    for _ in range(FIXED_POINT):
        about = view.context(place=offset)
        added = np.zeros_like(about.linear_b) + sum(_added(view, entry, "linear", about) for entry in model)
        rest = view.k * np.nan_to_num(view.record.linear_volt) - view.binned(added)
        both = np.where(view.good[view.inside, None, None], np.concatenate([rest[:, :, None], columns], axis=2), 0.0)
        rows = view.linear_rows(both)[along_xz]
        offset = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0][:3]
    return offset


def _added(view, entry, channel, about):
    """Addition (n, 3) m s-2 or rad s-2 of an entry to the linear or angular readings, at the epochs of a context."""
    if entry.listed:
        known = effect(entry.cause)
        if known.channel != f"{channel}_b" or known.slug in (TONE, LOOP):
            return 0.0
        return known.contribution(about, known.values(entry.values))
    own = view.context()  # where its candidates are made
    rows = ((d, f, _at(about.time, own.time, values, tau)) for d, f, values, tau in _series(view, own))
    return added_by(entry, channel, f"{channel} reading, ", rows)


def of_roll(view: RollView) -> list[Candidate]:
    """Candidates of a roll: effects on the linear readings, then regressors that these may follow."""
    about, candidates = view.context(), []
    for entry in EFFECTS:
        if entry.channel in ("linear_b", "electrode_v"):
            columns = _read(view, entry, entry.columns(about)).reshape(*view.time.shape, 3, -1)
            candidates += listed(entry, view.rows(columns)).each_alone()
        elif entry.channel == "pointing_b":
            candidates += listed(entry, view.rows(turned(view))).each_alone()
    for driver, form, values in view.series():
        columns = view.rows(np.stack([on_axes(one) for one in values]))
        names = along("linear", values.ndim > 2)
        candidates.append(unknown(driver, f"{CHANNEL} reading, {form}", columns, "m s-2", names))
    return candidates


def _read(view, entry, added):
    """Linear readings (n, 3, ...) m s-2 of what an effect adds to them, or to the electrodes (n, 6, ...) V."""
    if entry.channel == "linear_b":
        return added
    return np.einsum("a,av,nv...->na...", view.k, electrodes.READOUT[:3], added)


def turned(view: RollView) -> np.ndarray:
    """Derivative (s, b, 3, 3) m s-2 rad-1 of the readings of a model by a turn of its attitude about each axis."""
    place, term = view.start[3:], np.matvec(view.tensor, view.start[3:])
    columns = [np.cross(axis, term) - np.matvec(view.tensor, np.cross(axis, place)) for axis in np.eye(3)]
    return np.stack(columns, axis=3)


def roll_without(view: RollView, model: Sequence[Entry]) -> xr.Dataset:
    """Bins of the roll without the effects of a model; drifts count from its middle."""
    segmented = view.products["segment"]
    extended = segmented.copy(deep=True).assign_attrs(model=" ".join(one.cause for one in model if one.values))
    _, parts = cut(segmented["time"].values, view.settings["segment_s"])
    names = ("linear_volt", "R_bo", "rate_b", "gradient_b")
    complete = [k for k, part in enumerate(parts) if all(np.isfinite(segmented[n].values[part]).all() for n in names)]
    view = view_of_segments(view.products, view.settings, complete)
    about, added = view.context(), np.zeros((view.time.size, 3))
    volts = np.concatenate([segmented["linear_volt"].values[parts[k]] for k in complete])
    recorded = electrodes.volts(np.concatenate([volts, np.zeros_like(volts)], axis=1))  # hardly any torque
    rows = [(driver, form, np.concatenate(values)) for driver, form, values in view.series()]
    for entry in model:
        if not entry.listed:
            added += added_by(entry, "linear", f"{CHANNEL} reading, ", rows)
            added += [entry.values.get(f"mean_{axis}", 0.0) for axis in "xyz"]
            continue
        known = effect(entry.cause)
        if known.channel == "pointing_b":
            turn = frames.R_bi_from_quaternion(frames.from_rotation_vector(-known.values(entry.values)))
            extended["R_bo"].values[:] = turn @ extended["R_bo"].values
            extended["rate_b"].values[:] = extended["rate_b"].values @ turn.T
            extended["gradient_b"].values[:] = turn @ extended["gradient_b"].values @ turn.T
        before = entry.values.get("time", np.inf) < about.time[0]  # a step that the bias of the roll contains
        if known.channel == "electrode_v":
            added += _read(view, known, distortion(entry, about, recorded))
        elif known.channel == "linear_b" and known.slug != TONE and not before:
            added += known.contribution(about, known.values(entry.values))
    for k, volts in zip(complete, added.reshape(*view.time.shape, 3) / view.k, strict=True):
        extended["linear_volt"].values[parts[k]] -= volts
    return extended
