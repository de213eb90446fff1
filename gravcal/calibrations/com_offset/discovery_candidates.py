"""Columns of every effect of the catalogue that an event can show, in every form that is tried."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.com_offset import discovery_drivers, discovery_lag, discovery_timing
from gravcal.calibrations.com_offset.discovery_scene import attitude_at, field_at
from gravcal.calibrations.com_offset.discovery_view import View, turning
from gravcal.effects import Context, catalogue
from gravcal.effects.base import Effect
from gravcal.effects.kernels import ringing
from gravcal.estimation.records import Candidate, Shape
from gravcal.physics import frames

FAMILIES = ("timing", "torque", "accelerometer", "attitude", "magnetometer")
#: Baseline parameters, searched for along the time or frequency axis, or of records that are not read here.
NOT_HERE = (
    "accelerometer.offset",
    "accelerometer.bias_step",
    "accelerometer.stray_tone",
    "torque.thruster_firings",
    "timing.thruster_delay",
)
MODE_STEP_HZ = 0.02
MODES_HZ = np.arange(0.10, 0.80, MODE_STEP_HZ)
STEP_S = 2.0  # over which the field is differentiated
AT_ONCE = 12  # shapes that go through the operators together: with more, their samples leave the cache
DAMPING = 0.02  # of a flexible mode, while its frequency is looked for
#: Channel of an effect -> channel of the view.
READ = {"linear_b": "linear", "angular_b": "angular", "pointing_b": "attitude", "field_b": "magnetometer"}


def candidates(views: list[View], smoothed, starts) -> list[Candidate]:
    """Effects of the catalogue, then regressors made of the measured channels.

    Parameters
    ----------
    views : list of View
    smoothed : Dataset, "com_offset.attitude"
    starts : (k,) s, of the manoeuvres

    Returns
    -------
    candidates : list of Candidate, one column set a view and one for the edge times
    """
    shapes = [shape for entry in _entries() for shape in shapes_of(entry)]
    shapes += discovery_drivers.shapes(views[0]) if views else []
    tables = [_table(view, shapes) for view in views]
    found = []
    for k, shape in enumerate(shapes):
        columns = [t[k] for t in tables]
        timing = discovery_timing.columns(shape["cause"], smoothed, starts)
        timing = None if timing is None or shape["form"].startswith("manoeuvre") else timing
        curve = None
        if "frequency" in shape:
            curve = _mode_shape(views, shape["frequency"])
        if "lag" in shape:
            tau, leads = shape["lag"], [discovery_lag.usual_lead(shape["lag"])] * len(views)
            timing = discovery_lag.edge_rows(views, smoothed, tau, leads) / tau
            curve = discovery_lag.shape(views, smoothed, tau)
        if any(c is not None for c in columns) or timing is not None:
            words = shape["cause"], shape["form"], shape["names"], shape["units"]
            whole = Candidate(*words, [*columns, timing], shape["prior"], shape=curve)
            stays = not whole.listed or whole.form.endswith("Hz")
            found += [whole] if stays else whole.each_alone()
    return found


def shapes_of(entry: Effect) -> list[dict]:
    """Forms of an effect: {"cause", "form", "names", "units", "prior", "signal"}, signal: View -> signal or None."""
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    plain = {"cause": entry.slug, "form": "", "names": names, "units": units}
    plain["prior"] = [p.prior_sigma for p in entry.parameters]
    if entry.slug == "torque.dipole_lag":
        return [plain | {"form": f"tau {t:g} s", "lag": t, "signal": _lag(t)} for t in discovery_lag.TRIED_S]
    if entry.slug == "torque.saturation":
        return [plain | {"signal": _torque(_clipped)}]
    if entry.slug == "accelerometer.flexible_mode":
        axes = {"names": names[2:], "units": units[2:], "prior": plain["prior"][2:]}
        return [
            plain | axes | {"form": f"{f:.2f} Hz", "frequency": f, "signal": _ringing(f, DAMPING)} for f in MODES_HZ
        ]
    if entry.channel in ("dipole_b", "torque_b"):
        return [plain | {"signal": _torque(_torque_of(entry))}]
    return [plain | {"signal": _reading(entry)}]


def _table(view: View, shapes: list[dict]) -> list[np.ndarray | None]:
    """Whitened rows of every shape in one manoeuvre, some at once through the operators."""
    signals = [_signal(view, shape) for shape in shapes]
    table: list[np.ndarray | None] = [None] * len(signals)
    groups: dict[tuple, list[int]] = {}
    for k, signal in enumerate(signals):
        if signal is not None:
            groups.setdefault(tuple(sorted(signal)), []).append(k)
    for group in groups.values():
        for members in (group[k : k + AT_ONCE] for k in range(0, len(group), AT_ONCE)):
            for k, part in zip(members, _rows(view, [signals[k] for k in members]), strict=True):
                table[k] = part
    return table


def _rows(view, signals):
    """Whitened rows of signals in the same channels."""
    widths = [next(iter(signal.values())).shape[2] for signal in signals]
    joined = {channel: np.concatenate([signal[channel] for signal in signals], axis=2) for channel in signals[0]}
    return np.split(view.rows(joined), np.cumsum(widths)[:-1], axis=1)


def _signal(view, shape):
    """Signal of a shape in a view, made once."""
    key = ("signal", shape["cause"], shape["form"])
    if key not in view.memory:
        view.memory[key] = shape["signal"](view)
    return view.memory[key]


def attitude_of_torques(view: View) -> np.ndarray:
    """Attitude (k, 3, q) rad after every torque that is tried, what all of them can explain.

    Parameters
    ----------
    view : View
    """
    entries = [e for e in _entries() if e.channel in ("dipole_b", "torque_b")]
    shapes = [shape for entry in entries for shape in shapes_of(entry)]
    return np.concatenate([_signal(view, s)["attitude"] for s in shapes], axis=2)


def _entries():
    return [e for s, e in catalogue().items() if s.partition(".")[0] in FAMILIES and s not in NOT_HERE]


def _reading(entry):
    """Signal of an effect that is added to a reading; None where the channel is not observed."""

    def signal(view):
        if entry.channel not in READ:
            return field_of_delay(view, entry.slug)
        channel = READ[entry.channel]
        if channel == "magnetometer":
            time = view.magnetometer[0]
            return {channel: entry.columns(view.at(time))} if time.size else None
        context = Context(time=view.scene.sca_time) if channel == "attitude" else view.context
        return {channel: entry.columns(context)}

    return signal


def field_of_delay(view: View, slug: str) -> dict[str, np.ndarray] | None:
    """What a delay of one second does to the difference of measured and predicted field; None where nothing.

    A late tag of the magnetometer shows the field of before, one of the star camera predicts it with the attitude of
    before: -dB/dt and -w x B in the body.

    Parameters
    ----------
    view : View
    slug : of the delay

    Returns
    -------
    signal : {"magnetometer": (n, 3, 1) T s-1}
    """
    time = view.magnetometer[0]
    if not time.size or slug not in ("timing.magnetometer_delay", "timing.star_camera_delay"):
        return None
    if slug == "timing.star_camera_delay":
        there = view.at(time)
        return {"magnetometer": -np.cross(there.rate_b, there.field_b)[..., None]}
    ends = [time + d for d in (-STEP_S, STEP_S)]
    fields = [field_at(view.scene, t, frames.R_bi_from_quaternion(attitude_at(view.scene, t))) for t in ends]
    return {"magnetometer": -(fields[1] - fields[0])[..., None] / (2 * STEP_S)}


def _torque(torque_of):
    return lambda view: turning(view, torque_of)


def _torque_of(entry):
    """Context -> torque (n, 3, q) N m per parameter."""

    def torque(context):
        values = entry.columns(context)
        if entry.channel == "torque_b":
            return values
        return np.moveaxis(np.cross(np.moveaxis(values, 2, 1), context.field_b[:, None, :]), 1, 2)

    return torque


def torque_by(entry: Effect, values: np.ndarray):
    """Context -> torque (n, 3, 1) N m of an effect at given values.

    Parameters
    ----------
    entry : Effect on dipole_b or torque_b
    values : (p,) of its parameters
    """

    def torque(context):
        added = entry.contribution(context, values)
        return (added if entry.channel == "torque_b" else np.cross(added, context.field_b))[..., None]

    return torque


def _lag(tau):
    """Signal per second of lag."""
    return lambda view: discovery_lag.column(view, tau, discovery_lag.usual_lead(tau))


def _clipped(context):
    """Torque per dipole missing at full dipole: what saturation takes from the square wave."""
    largest = np.abs(context.dipole_b).max()
    missing = np.where(np.abs(context.dipole_b) > 0.5 * largest, np.sign(context.dipole_b), 0.0)
    return np.cross(missing, context.field_b)[..., None]


def _ringing(frequency, damping):
    """Linear reading per ringing dipole on each axis."""

    def signal(view):
        c = view.context
        wave = ringing(c.time, c.dipole_b.sum(axis=1), frequency, damping)
        return {"linear": wave[:, None, None] * np.eye(3)}

    return signal


def _mode_shape(views, frequency):
    """Shape of a flexible mode about a frequency of the grid."""
    near = frequency + np.linspace(-MODE_STEP_HZ, MODE_STEP_HZ, 7)
    tried = np.array([(f, d) for f in near for d in (DAMPING / 4, DAMPING, 4 * DAMPING)])
    lower, upper = (np.array([frequency + s * 2 * MODE_STEP_HZ, d]) for s, d in ((-1, 1e-3), (1, 0.5)))
    columns = lambda value: [*(v.rows(_ringing(*value)(v)) for v in views), None]  # noqa: E731
    return Shape(("frequency", "damping"), ("Hz", "1"), np.array([frequency, DAMPING]), columns, tried, lower, upper)
