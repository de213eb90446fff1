"""Signals of catalogue effects and of unlisted drivers in the channels of a manoeuvre and in the edge times.

A view is the `Manoeuvre` of one manoeuvre. Edge times are one more block: edges seen by the accelerometer minus those
seen by the star camera, and their delay against the telemetry. The phase of a line is free in every manoeuvre.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import xarray as xr

from gravcal.calibrations.causes import listed, on_axes, unknown
from gravcal.calibrations.com_offset import lag, manoeuvre
from gravcal.calibrations.com_offset.manoeuvre import Manoeuvre, at_accelerometer, attitude_at, field_at, of_torque
from gravcal.effects import Context, catalogue, effect
from gravcal.effects.accelerometer import deflection
from gravcal.effects.base import Effect
from gravcal.effects.drivers import CONSTANTS, MEMORY, WAVES, Law, laws, play, products
from gravcal.effects.sensors import OF_WARMTH
from gravcal.estimation import least_squares
from gravcal.estimation.records import Block, Candidate, Entry, Parameter, Shape, Wave, Wider
from gravcal.physics import frames

FAMILIES = ("timing", "torque", "accelerometer", "attitude", "magnetometer")
STEP = "accelerometer.bias_step"
#: Baseline parameters, searched for along the time or frequency axis, of records that are not read here, or of days.
NOT_HERE = ("accelerometer.offset", STEP, "accelerometer.stray_tone", "torque.thruster_firings", *OF_WARMTH)
NOT_HERE += ("timing.thruster_delay", "timing.orbit_delay", "attitude.star_camera_heads")
NOT_HERE += ("magnetometer.nonorthogonality",)  # in a field of one direction it is a scale and a misalignment
TONES = {"linear": "accelerometer.stray_tone", "angular": "unknown:time"}
UNITS = {"linear": "m s-2", "angular": "rad s-2"}
MODE_STEP_HZ = 0.02
MODES_HZ = np.arange(0.10, 0.80, MODE_STEP_HZ)
STEP_S = 2.0  # over which the field is differentiated
REACHED = 0.9  # share of the largest dipole of a session above which a rod may saturate
DAMPING = 0.02  # of a flexible mode, while its frequency is looked for
#: Channel of an effect -> channel of a manoeuvre.
READ = {"linear_b": "linear", "angular_b": "angular", "pointing_b": "attitude", "field_b": "magnetometer"}
#: Tags that a delay moves; edges are seen in the currents, which have the tags of the magnetometer.
TAGS = {"acc_delay": "time_acc", "sca_delay": "time_sca", "mag_delay": "time_mag"}
EDGES = ("edge_lower", "edge_upper", "start", "stop")
# drivers in no list
PLAY = (0.3, 0.6, 1.0, 1.5)  # widths of a play operator, in units of the largest current
SETTLING_S = (15.0, 40.0, 80.0)

Signal = dict[str, np.ndarray]


@dataclass(frozen=True)
class Form:
    """A cause in one form, with the function that gives its signal in a manoeuvre.

    `frequency` of a flexible mode, `tau` of a lag and the `constants` of a `law` are refined where the form comes near
    what was measured. Where a form with a `base` comes near, all laws of that series are tried.
    """

    whole: Candidate  #: without its columns
    signal: Callable[[Manoeuvre], Signal | None]  #: per unit of each parameter, None where it adds nothing
    frequency: float | None = None  #: Hz, natural frequency of a flexible mode
    tau: float | None = None  #: s, time constant of a lag
    law: Law | None = None  #: of an unlisted driver
    constants: tuple[float, ...] = ()  #: of the law, in the order of its `names`
    base: str = ""  #: key in `_bases` of a series that laws can be made of

    def of(self, one: Manoeuvre) -> Signal | None:
        """Signal in a manoeuvre, computed once and kept in its memory."""
        return one.remembered(("signal", self.whole.cause, self.whole.form), self.signal)


def candidates(views: list[Manoeuvre], smoothed: xr.Dataset, starts: np.ndarray, forms=None) -> list[Candidate]:
    """Candidates with whitened columns in views and edge times: the catalogue and unlisted drivers, or given forms."""
    if forms is None:
        forms = [form for entry in _entries() for form in _forms(entry)] + (_drivers(views[0]) if views else [])
    causes = []
    for form in forms:
        signals, shape, candidate = [form.of(one) for one in views], None, form.whole
        columns = [None if s is None else one.whitened(s) for one, s in zip(views, signals, strict=True)]
        timing = edge_column(candidate.cause, smoothed, starts)
        if form.frequency is not None:
            shape = _mode_shape(views, form.frequency)
        if form.tau is not None:
            timing = lag.edge_rows(views, smoothed, form.tau, [lag.usual_lead(form.tau)] * len(views)) / form.tau
            shape = lag.shape(views, smoothed, form.tau)
        if timing is None and all(c is None for c in columns):
            continue
        if form.constants:
            shape = _law_shape(views, form)
        key = *candidate.form.split()[:1], form.base
        wider = Wider(key, partial(_wider, form, views, smoothed, starts)) if form.base else None
        candidate = replace(candidate, columns=[*columns, timing], shape=shape, wider=wider)
        causes += [candidate] if not candidate.listed or candidate.form.endswith("Hz") else candidate.each_alone()
    return causes


def _entries():
    """Catalogue effects that this calibration tries."""
    return [e for s, e in catalogue().items() if s.partition(".")[0] in FAMILIES and s not in NOT_HERE]


def _forms(entry: Effect) -> list[Form]:
    """Forms of an effect: one for each time constant or natural frequency of a grid, else a single one."""
    if entry.slug == lag.CAUSE:
        per_second = lambda tau: lambda one: lag.per_second(one, tau, lag.usual_lead(tau))  # noqa: E731
        return [Form(listed(entry, [], f"tau {t:g} s"), per_second(t), tau=t) for t in lag.TRIED_S]
    if entry.slug == "accelerometer.flexible_mode":
        axes = slice(2, None)
        return [Form(listed(entry, [], f"{f:.2f} Hz", axes), _deflected(f, DAMPING), frequency=f) for f in MODES_HZ]
    if entry.slug == "torque.saturation":
        return [Form(listed(entry, []), lambda one: of_torque(one, _clipped))]
    if entry.channel in ("dipole_b", "torque_b"):
        return [Form(listed(entry, []), lambda one: of_torque(one, _torque_of(entry, entry.columns)))]
    return [Form(listed(entry, []), lambda one: _reading(one, entry, entry.columns))]


def attitude_of_torques(one: Manoeuvre) -> np.ndarray:
    """Attitude response (k, 3, q) rad to every torque that is tried, per unit of each parameter."""
    entries = [e for e in _entries() if e.channel in ("dipole_b", "torque_b")]
    return np.concatenate([form.of(one)["attitude"] for entry in entries for form in _forms(entry)], axis=2)


def _torque_of(entry, values_of):
    """Function Context -> torque (n, 3, q) N m of `values_of`, Context -> (n, 3, q): a torque, or a dipole times B."""

    def torque(context):
        values = values_of(context)
        if entry.channel == "torque_b":
            return values
        return np.moveaxis(np.cross(np.moveaxis(values, 2, 1), context.field_b[:, None, :]), 1, 2)

    return torque


def _clipped(context):
    """Torque (n, 3, 1) N m per A m2 missing on every rod near the largest dipole of the session, which may saturate."""
    full = np.abs(context.dipole_b) > REACHED * context.extra["largest_dipole"]
    return np.cross(np.where(full, -np.sign(context.dipole_b), 0.0), context.field_b)[..., None]


def _reading(view, entry, values_of):
    """Signal of `values_of`, Context -> (samples, 3, q), in the channel of an effect; None where it is not observed."""
    channel = READ.get(entry.channel)
    if channel is None:
        return of_delay(view, entry.slug)
    if channel == "magnetometer":
        time = view.magnetometer[0]
        return {channel: values_of(view.at(time))} if time.size else None
    contexts = {"linear": view.wide, "angular": view.context, "attitude": Context(time=view.window.time)}
    return {channel: values_of(contexts[channel])}


def of_delay(one: Manoeuvre, slug: str) -> Signal | None:
    """Signal of a delay of 1 s, or a clock drift of 1 s s-1, that arises through the field; None where there is none.

    A late magnetometer reads the earlier field, a late star camera predicts it with the earlier attitude: measured
    minus predicted field changes by -dB/dt and -w x B in the body, T s-1. The torque predicted for accelerometer
    readings takes the field at their tags, so that the readings differ by the torque of the same change.
    """
    word, since = slug.partition(".")[2], 1.0
    if slug == "timing.clock_drift":
        word, since = "accelerometer_delay", one.context.start[one.index] - one.context.start[0]
    if word not in ("accelerometer_delay", "star_camera_delay", "magnetometer_delay"):
        return None
    signal, time = {}, one.magnetometer[0]
    if time.size and word != "accelerometer_delay":
        signal["magnetometer"] = _earlier(one, one.at(time), word)[..., None]
    if word != "magnetometer_delay":
        torque = np.cross(one.context.dipole_b, since * _earlier(one, one.context, word))
        signal |= at_accelerometer(one, np.linalg.solve(one.context.inertia_b, torque.T).T[..., None])
    return signal


def _earlier(view, context, word):
    """Measured minus predicted field (n, 3) T per second of delay: -w x B of a star camera, else -dB/dt in the body."""
    if word == "star_camera_delay":
        return -np.cross(context.rate_b, context.field_b)
    epochs = [context.time + d for d in (-STEP_S, STEP_S)]
    before, after = (field_at(view.arc, t, attitude_at(view.window, t)) for t in epochs)
    return (before - after) / (2 * STEP_S)


def _deflected(frequency, damping):
    """Function view -> signal (n, 3, 9) of a flexible mode (Hz, damping ratio), per metre of each `x_from_y`."""

    def signal(view):
        first = view.wide.angular_b[:1]  # of the pad, to which the mode is bent when the reading begins
        deflected = first + deflection(view.wide.time, view.wide.angular_b - first, frequency, damping)
        return {"linear": np.einsum("nb,ac->nacb", deflected, np.eye(3)).reshape(len(deflected), 3, 9)}

    return signal


def _mode_shape(views, frequency):
    """Shape of a flexible mode: natural frequency and damping ratio, refined from near a frequency (Hz) of the grid."""
    near = frequency + np.linspace(-MODE_STEP_HZ, MODE_STEP_HZ, 7)
    tried = np.array([(f, d) for f in near for d in (DAMPING / 4, DAMPING, 4 * DAMPING)])
    lower, upper = (np.array([frequency + sign * 2 * MODE_STEP_HZ, d]) for sign, d in ((-1, 1e-3), (1, 0.5)))
    columns = lambda value: [*(view.whitened(_deflected(*value)(view)) for view in views), None]  # noqa: E731
    return Shape(("frequency", "damping"), ("Hz", "1"), np.array([frequency, DAMPING]), columns, tried, lower, upper)


def _drivers(one: Manoeuvre) -> list[Form]:
    """Forms of every unlisted driver in the linear and in the angular reading, a coefficient for each of three axes."""
    forms = []
    for channel in UNITS:
        bases = _bases(one, channel)
        linear = channel == "linear"
        for k, (driver, form, shape) in enumerate(_series(one, channel)):
            signal = lambda one, channel=channel, k=k: {channel: on_axes(_series(one, channel)[k][2])}  # noqa: E731
            base = form if form in bases and linear else ""
            forms.append(_unknown(channel, driver, form, shape.shape[1], signal, base=base))
        forms += [_of_law(law, values, channel, bases[law.base][0], linear) for law, values in SCREENED]
    return forms


def _unknown(channel, driver, form, width, signal, **fields):
    """Form of an unlisted driver with `width` series on three axes of a reading; other fields of Form in `fields`."""
    names = [f"{channel}_{a}_{w}" if width > 1 else f"{channel}_{a}" for w in range(width) for a in "xyz"]
    return Form(unknown(driver, f"{channel} reading, {form}", [], UNITS[channel], names), signal, **fields)


def _series(view, channel) -> list[tuple[str, str, np.ndarray]]:
    """Drivers of a reading, computed once: channels they come from, form in words, (n, k) of order one at epochs."""
    return view.remembered(("drivers", channel), partial(_made_series, channel=channel))


def _there(view, channel):
    """Context at the epochs of the linear reading, pads included, or at those of the angular reading."""
    return view.wide if channel == "linear" else view.context


def _made_series(one, channel):
    """Rows of `_series`: hysteresis, products, the series of `_bases`, decays and a saw-tooth of the second."""
    bases, context = _bases(one, channel), _there(one, channel)
    time, since, length = context.time, context.time - one.time[0], one.time[-1] - one.time[0]
    current, sine = bases[CURRENT][1], np.sin(bases[LATITUDE][1])
    angle = np.cumsum((context.rate_b - context.rate_b.mean(axis=0)) * np.diff(time, prepend=time[0])[:, None], axis=0)
    angle = (angle - angle.mean(axis=0)) / max(np.abs(angle).max(), 1e-30)
    rate = np.stack([bases[f"rate {a}"][1] for a in "xyz"], axis=1)
    field = context.field_b * 2e4
    rows = [("torquer_current", f"hysteresis of {w:g} of full", play(current, w)) for w in PLAY]
    strength = np.linalg.norm(field, axis=1)
    rows.append(("torquer_current*field", "current times field strength", current * strength))
    rows += [("torquer_current*field", f"current times field {'xyz'[i]}", current * field[:, i]) for i in range(3)]
    rows.append(("torquer_current*latitude", "current times sine of latitude", current * sine))
    rows.append(("torquer_current*time", "current growing along the manoeuvre", current * (since / length - 0.5)))
    rows += [(name, *one) for name, values in (("rate", rate), ("attitude", angle)) for one in products(values)]
    rows += [(name, form, values) for form, (name, values) in bases.items()]
    decays = [(t, np.where(since >= 0, np.exp(-np.maximum(since, 0.0) / t), 0.0)) for t in SETTLING_S]
    rows += [("time", f"decay {t:g} s from the start", values) for t, values in decays]
    rows.append(("time", "saw-tooth of the second", (time % 1.0) - 0.5))
    return [(driver, form, values.reshape(len(values), -1)) for driver, form, values in rows]


def _bases(view, channel) -> dict[str, tuple[str, np.ndarray]]:
    """Measured series that laws of a reading are made of, computed once: {words: (channel, (n,) of order one)}."""
    return view.remembered(("bases", channel), partial(_made_bases, channel=channel))


def _made_bases(view, channel):
    """Series of `_bases`: current, body rate, angular acceleration, attitude, field, latitude and sunlight."""
    c = _there(view, channel)
    time = c.time
    current = c.dipole_b.sum(axis=1) / max(np.abs(c.dipole_b).max(), 1e-30)
    rate, place = c.rate_b - c.rate_b.mean(axis=0), [np.interp(time, view.orbit[0], p) for p in view.orbit[1].T]
    angle = np.cumsum(rate * np.diff(time, prepend=time[0])[:, None], axis=0)
    vectors = {"rate": rate, "angular acceleration": c.rate_dot_b, "attitude": angle - angle.mean(axis=0)}
    change = np.diff(current, prepend=0.0) / np.median(np.diff(time))
    bases = {CURRENT: ("torquer_current", current), CHANGE: ("torquer_current", change)}
    for name, values in vectors.items():
        size = max(np.abs(values).max(), 1e-30)
        bases |= {f"{name} {a}": (name.replace(" ", "_"), values[:, i] / size) for i, a in enumerate("xyz")}
    bases |= {f"field {a}": ("field", 2e4 * c.field_b[:, i]) for i, a in enumerate("xyz")}
    bases["strength of the field"] = ("field", 2e4 * np.linalg.norm(c.field_b, axis=1))
    bases[LATITUDE] = ("latitude", np.arcsin(place[2] / np.linalg.norm(place, axis=0)))
    return bases | {"sunlight with a lag": ("eclipse", c.extra["warmth"])}


CURRENT, CHANGE, LATITUDE = "the current", "the change of the current", "the latitude"
#: Laws with constants that stand for all others while it is looked for what comes near.
SCREENED = [(Law(CURRENT, n, MEMORY), (t,)) for n in ("{}", "the square of {}") for t in (0.5, 2.0, 6.0, 20.0, 60.0)]
SCREENED += [(Law(CHANGE, n, MEMORY), (t,)) for n in ("{}", "the size of {}") for t in (0.3, 0.7, 2.0)]
SCREENED += [(Law(CURRENT, "the square of {}"), ())]
SCREENED += [(Law(LATITUDE, WAVES), (k,)) for k in (4.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 100.0)]


def _values(law: Law, view: Manoeuvre, channel: str, constants) -> np.ndarray:
    """Values (n, w) of a law at the epochs of a reading; the current is taken to be off before the first of them."""
    bases, rested = _bases(view, channel), law.base in (CURRENT, CHANGE)
    off = np.abs(bases[CURRENT][1]) < 0.05
    return law.values(_there(view, channel).time, bases[law.base][1], constants, off=off, rested=rested)


def _wider(form, views, smoothed, starts):
    """Candidates of every law that can be made of the `base` of a form, one for each set of constants tried."""
    channel, driver = form.whole.form.split()[0], form.whole.cause.partition(":")[2]
    every_law = laws(form.base, form.base == LATITUDE)
    forms = [_of_law(law, constants, channel, driver) for law in every_law for constants in law.tried()]
    return candidates(views, smoothed, starts, forms)


def _of_law(law, constants, channel, driver, screened=False):
    """Form of a law with constants; a `screened` one stands for all laws of its base, which it leads to."""
    signal = lambda one: {channel: on_axes(_values(law, one, channel, constants))}  # noqa: E731
    fields = {"law": law, "constants": tuple(map(float, constants)), "base": law.base if screened else ""}
    return _unknown(channel, driver, law.told(constants), law.width, signal, **fields)


def _law_shape(views, form):
    """Shape of a form with a law: its constants, refined from about those that were tried."""
    law, channel, value = form.law, form.whole.form.split()[0], np.array(form.constants)
    signal = lambda one, v: {channel: on_axes(_values(law, one, channel, v))}  # noqa: E731
    columns = lambda v: [*(one.whitened(signal(one, v)) for one in views), None]  # noqa: E731
    lower, upper = np.transpose([CONSTANTS[name][2] for name in law.names])
    steps = (0.98, 1.0, 1.02) if "cycles" in law.names else (0.6, 1.0, 1.6)
    tried = np.clip(np.array(list(itertools.product(*[[s * v for s in steps] for v in value]))), lower, upper)
    units = tuple(CONSTANTS[name][0] for name in law.names)
    return Shape(law.names, units, value, columns, tried, lower, upper, words=f"{channel} reading, {law.words}")


def edge_block(smoothed: xr.Dataset) -> Block:
    """Block of k + 1 whitened edge times: accelerometer minus star camera in each manoeuvre, delay to telemetry."""
    rows = np.append(smoothed["acc_shift"].values - smoothed["sca_shift"].values, float(smoothed["acc_delay"]))
    observed, count = lag.whitened_edges(smoothed, rows), rows.size
    return Block.of("timing", observed, "timing", 0, np.arange(float(count)), shared=np.zeros((count, 3)))


def edge_column(slug: str, smoothed: xr.Dataset, starts: np.ndarray) -> np.ndarray | None:
    """Whitened column (k + 1, 1) of a timing effect in the edge times, starts (k,) s; None where it changes none."""
    ones, middle = np.ones(smoothed["acc_shift"].size), starts - starts[0]
    column = {
        "timing.accelerometer_delay": lambda: np.append(ones, 1.0),
        "timing.star_camera_delay": lambda: np.append(-ones, 0.0),
        "timing.magnetometer_delay": lambda: np.append(0 * ones, -1.0),
        "timing.clock_drift": lambda: np.append(middle, middle.mean()),
    }.get(slug)
    return None if column is None else lag.whitened_edges(smoothed, column())[:, None]


def waves(entry: Entry, views: list[Manoeuvre], blocks: list[Block]) -> tuple[Wave, ...]:
    """Cosine and sine of a line, in the unit of the reading, on each axis of each manoeuvre.

    The search fits whitened rows: of the entry's parameters cosine_<axis>_<manoeuvre> and sine_<axis>_<manoeuvre> have
    no unit. The sine of the reading is that which low-pass and whitening take to the same rows.
    """
    values, channel, lines = entry.values, entry.form.split()[0], []
    for number, (one, block) in enumerate(zip(views, blocks[: len(views)], strict=True)):
        sizes: dict[str, tuple[float, float] | None] = dict.fromkeys("xyz")
        for axis, letter in enumerate("xyz"):
            names = (f"cosine_{letter}_{number}", f"sine_{letter}_{number}")
            if not all(n in values for n in names):
                continue
            rows = (block.channel == channel) & (block.axis == axis)
            target = _sine_and_cosine(2 * np.pi * values["frequency"] * block.time[rows]) @ [values[n] for n in names]
            since = _there(one, channel).time - one.time[0]
            signal = np.zeros((since.size, 3, 2))
            signal[:, axis] = _sine_and_cosine(2 * np.pi * values["frequency"] * since)
            columns = one.whitened({channel: signal})[rows]
            used = np.any(columns != 0, axis=1)
            sizes[letter] = tuple(np.linalg.lstsq(columns[used], target[used], rcond=None)[0].tolist())
        lines.append(Wave(float(one.time[0]), channel, **sizes))
    return tuple(lines)


def _sine_and_cosine(phase):
    """Cosine and sine (n, 2) of a phase (n,) rad."""
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


def amplitudes(entry: Entry, views: list[Manoeuvre]) -> dict[str, Parameter]:
    """Frequency Hz of a line, and amplitude per axis, rms over the manoeuvres: whitened, over that of a unit sine."""
    parameters, channel = entry.parameters, entry.form.split()[0]
    line, phase = {"frequency": parameters["frequency"]}, 2 * np.pi * parameters["frequency"].value
    for axis, letter in enumerate("xyz"):
        names = [(f"cosine_{letter}_{i}", f"sine_{letter}_{i}", one) for i, one in enumerate(views)]
        squares, errors, sizes = [], [], []
        for cosine, sine, one in (row for row in names if row[0] in parameters and row[1] in parameters):
            squares += [parameters[n].value ** 2 for n in (cosine, sine)]
            errors += [parameters[n].sigma ** 2 for n in (cosine, sine)]
            time = _there(one, channel).time
            signal = np.zeros((time.size, 3, 1))
            signal[:, axis, 0] = np.sqrt(2) * np.sin(phase * time)
            rows = one.whitened({channel: signal})[:, 0]
            sizes.append(float(np.sqrt(np.mean(rows[rows != 0] ** 2))))
        if sizes:
            square = (np.sum(squares) - np.sum(errors)) / np.sum(np.square(sizes))
            error = np.sqrt(np.mean(errors) / np.sum(np.square(sizes)))
            line[letter] = Parameter(float(np.sqrt(max(square, 0.0))), float(error), UNITS[channel])
    return line


def contribution(one: Manoeuvre, entry: Entry) -> dict[str, np.ndarray]:
    """What an entry of a model adds to the channels of a manoeuvre, {channel: (samples, 3)}.

    The linear reading of an unlisted driver comes without its polynomial drift, which the search leaves free: only a
    thousandth of a decay by 80 s is determined beside it, and a solution of lower degree makes an offset of the rest.
    """
    if "frequency" in entry.parameters and entry.cause in TONES.values():
        known = [w for w in entry.waves if abs(w.start - one.time[0]) < 5.0]
        if not known:  # the phase is not known here
            return {}
        since = _there(one, known[0].channel).time - known[0].start
        unit = _sine_and_cosine(2 * np.pi * entry.values["frequency"] * since)
        axes = [np.zeros(2) if size is None else np.array(size) for size in (known[0].x, known[0].y, known[0].z)]
        return {known[0].channel: np.stack([unit @ size for size in axes], axis=1)}
    if not entry.listed:
        words = entry.form.partition(" reading, ")[2]
        channel = entry.form.split()[0]
        matches = (law for base in _bases(one, channel) for law in laws(base, base == LATITUDE) if law.tells(words))
        law = next(matches, None)
        forms = [f for f in _drivers(one) if (f.whole.cause, f.whole.form) == (entry.cause, entry.form)]
        if law is not None:
            constants = [entry.values[name] for name in law.names]
            forms = [_of_law(law, constants, channel, entry.cause.partition(":")[2])]
        signal = forms[0].signal(one) if forms else {}
        added = dict(zip(signal, replace(forms[0].whole, columns=[*signal.values()]).added(entry), strict=True))
        if "linear" in added:
            drift = least_squares.polynomial(one.wide.time, one.drift_degree, *one.wide.time[[0, -1]])
            added["linear"] = least_squares.project_out(drift, added["linear"])
        return added
    known = effect(entry.cause)
    if known.slug == lag.CAUSE:
        return lag.contribution(one, entry)
    values = known.values(entry.values)
    if known.slug == STEP and entry.leads:
        since = lag.known_lead(one, entry)
        if since is None:
            return {}
        values = np.append(values[:3], one.time[0] + since)
    added_to = lambda context: known.contribution(context, values)[..., None]  # noqa: E731
    if known.channel in ("dipole_b", "torque_b"):
        signal = of_torque(one, _torque_of(known, added_to))
    else:
        signal = _reading(one, known, added_to) if known.channel in READ else None
    return {channel: columns[:, :, 0] for channel, columns in (signal or {}).items()}


def without(aligned: xr.Dataset, views: list[Manoeuvre], model: Sequence[Entry]) -> xr.Dataset:
    """Aligned records without the effects of a model, so that the baseline describes what is left.

    To first order in the effects: readings less their contribution, attitude less the rotation that an extra torque
    makes, tags less their delay. Beyond the manoeuvres and their pads only tags change, and what follows a step.
    """
    extended, step, context = aligned.copy(deep=True), effect(STEP), Context(time=aligned["time_acc"].values)
    for entry in sorted(model, key=lambda e: e.cause == lag.CAUSE):  # what is left says where edges fall
        if entry.cause == STEP:
            *sizes, at = step.values(entry.values)
            for one in [lead.start + lead.lead for lead in entry.leads] or [at]:
                extended["linear_b"].values -= step.contribution(context, [*sizes, one])
            continue
        turns = entry.listed and effect(entry.cause).channel in ("dipole_b", "torque_b")
        for one in views:
            placed = lag.placed(one, entry, extended) if entry.cause == lag.CAUSE else entry
            _subtract(extended, one, contribution(one, placed), turns)
    extended = tags_moved(extended, model)  # last: the samples are found by their tags
    return extended.assign_attrs(model=" ".join(e.cause for e in model))


def tags_moved(records: xr.Dataset, model: Sequence[Entry]) -> xr.Dataset:
    """Records whose tags are less by the delays of a model; drifts are below the tags' own error within a day."""
    for entry in (one for one in model if one.listed):
        name, listed_effect = TAGS.get(effect(entry.cause).channel), effect(entry.cause)
        if name and listed_effect.slug.endswith("delay"):
            names = (name, *EDGES) if name == "time_mag" else (name,)
            records = records.assign({n: records[n] - listed_effect.values(entry.values)[0] for n in names})
    return records


def _subtract(extended, view, added, turned):
    """Subtract {channel: (samples, 3)} from records, in place; the measured field turns with the body if `turned`."""
    for channel, name, rows in (("linear", "linear_b", view.wide_rows), ("angular", "angular_b", view.rows)):
        if channel in added:
            extended[name].values[rows] -= added[channel]
    if "attitude" in added:
        rows, angle = _angle(extended["time_sca"].values, view.window.time, added["attitude"])
        values = extended["quaternion"].values
        values[rows] = frames.quaternion_product(values[rows], frames.from_rotation_vector(-angle))
        if turned:  # the field as a body that did not turn would see it
            rows, angle = _angle(extended["time_mag"].values, view.window.time, added["attitude"])
            extended["field_measured_b"].values[rows] = rotated(angle, extended["field_measured_b"].values[rows])
    if "magnetometer" in added:
        subtract_field(extended, view.magnetometer[0], added["magnetometer"])


def _angle(time, epochs, angle):
    """Rows (slice) of a record near a manoeuvre, and the rotation (n, 3) rad there, held beyond its epochs (k,) s."""
    rows = slice(*np.searchsorted(time, [epochs[0] - manoeuvre.BEYOND_S, epochs[-1] + manoeuvre.BEYOND_S]))
    return rows, np.stack([np.interp(time[rows], epochs, component) for component in angle.T], axis=1)


def rotated(angle: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) in a body without an extra rotation (n, 3) rad; a value written twice is turned by the first."""
    turned = np.matvec(frames.R_bi_from_quaternion(frames.from_rotation_vector(-angle)), vectors)
    again = 1 + np.flatnonzero(np.all(vectors[1:] == vectors[:-1], axis=1))
    turned[again] = turned[again - 1]
    return turned


def subtract_field(extended: xr.Dataset, time: np.ndarray, added: np.ndarray) -> None:
    """Subtract (n, 3) T at epochs (n,) s from the measured field, in place; values written twice stay equal in both."""
    values = extended["field_measured_b"].values
    rows = np.searchsorted(extended["time_mag"].values, time)
    size = len(values) - 1
    again = [np.all(values[np.clip(rows + d, 0, size)] == values[rows], axis=1) for d in (-1, 1)]
    for step, same in zip((-1, 1), again, strict=True):
        others = np.clip(rows[same] + step, 0, size)
        fresh = ~np.isin(others, rows)
        values[others[fresh]] -= added[same][fresh]
    values[rows] -= added
