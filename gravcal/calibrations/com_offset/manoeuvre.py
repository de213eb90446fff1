"""A manoeuvre as discovery sees it: motion, torques, noise, and the whitened rows of any signal.

A signal is {channel: (samples, 3, q)}: linear m s-2 and angular rad s-2 at the accelerometer epochs, attitude rad at
those of the star camera, magnetometer T once a second. The linear reading reaches a minute beyond the manoeuvre, with
one drift: a slow response to the current bends at the ends, and within them would be taken for drift.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from numpy.polynomial import polynomial

from gravcal.calibrations.causes import on_axes
from gravcal.calibrations.com_offset import attitude as motion
from gravcal.calibrations.com_offset.estimate import nearest, quiet_operators, quiet_spans
from gravcal.effects import Context, catalogue
from gravcal.estimation import least_squares
from gravcal.estimation import noise as noises
from gravcal.estimation.records import Block
from gravcal.estimation.resampling import Resampler, lines_between, operator_for
from gravcal.physics import dynamics, frames, gravity, kinematics, orbit_environment

CHANNELS = ("linear", "angular", "attitude", "magnetometer")
#: s, spacing of the epochs at which a step is looked for (one 1.5 s off loses a third of its gain), and from the ends.
STEP_S, ENDS_S = 1.0, 6.0
DRAG = np.array([6e-8, 0.0, 0.0])  # m s-2, of the environment that effects look at
PADS_S = 60.0  # of linear reading on either side of a manoeuvre
BEYOND_S = 10.0  # of a manoeuvre, in which records are still turned back
ENOUGH = 40  # attitudes of a pad that determine its motion
SHOWN = 0.05  # share of the square of what a finding adds that lies beside the manoeuvre, from which on this is shown


@dataclass(frozen=True)
class Measured:
    """Noise of a channel as measured."""

    models: list[list[noises.NoiseModel]]  #: of each manoeuvre and axis
    error: np.ndarray  #: (m, 3) 1, relative standard deviation of the noise amplitude at each manoeuvre


@dataclass(frozen=True)
class Manoeuvre:
    """Manoeuvre as arrays, with what turns a signal into whitened rows."""

    index: int  #: of the manoeuvre
    window: motion.Window  #: its observations and torques
    time: np.ndarray  #: (n,) s, accelerometer epochs
    rows: np.ndarray  #: indices of these epochs in the aligned product
    operator: Resampler  #: low-pass and resampling of the accelerometer
    transition: np.ndarray  #: (k, 6, 6) of angle and rate from the origin, at the epochs of the window
    local_attitude: np.ndarray  #: (k, 3, p) rad per unit of start angle, rate, slow torque and edge shift
    scale_attitude: np.ndarray  #: (k, 3, 3) rad per unit of the torque scale of each axis
    shift: float  #: s, by which edges seen by the star camera are later than those of the arc
    acc_shift: float  #: s, the same of edges seen by the accelerometer
    measured: dict[str, Measured]  #: {channel: noise of all manoeuvres}, may be completed later
    context: Context  #: Context at the accelerometer epochs
    wide: Context  #: Context at those of the linear reading, pads included; motion in these is that of a mean attitude
    wide_rows: slice  #: of the aligned product
    wide_operator: Resampler  #: low-pass and resampling of the linear reading
    offset: np.ndarray  #: (3,) m, present estimate
    drift_degree: int  #: of the polynomial that stands for the drift of the linear reading, pads included
    magnetometer: tuple  #: time (m,) s, measured minus model field (m, 3) T and valid (m,) at 1 Hz
    orbit: tuple  #: (time, position_i) s, m, of the whole record
    memory: dict = field(default_factory=dict)  #: contexts at other epochs and signals, made once

    @property
    def arc(self) -> motion.Arc:
        """Edges, dipoles and field of the window."""
        return self.window.arc

    @functools.cached_property
    def propagator(self) -> Callable[[Callable], np.ndarray]:
        """Attitude after angular accelerations that jump at the edges."""
        return motion.propagator(self.window.time, self.transition, self.arc.edges + self.shift)

    @property
    def noise(self) -> dict[str, list[noises.NoiseModel]]:
        """Noise model of each axis of each channel at this manoeuvre."""
        return {channel: one.models[self.index] for channel, one in self.measured.items()}

    @property
    def valid(self) -> dict[str, np.ndarray]:
        """Usable samples of each channel."""
        valid = (self.wide_operator.valid, self.operator.valid, self.window.good, self.magnetometer[2])
        return dict(zip(CHANNELS, valid, strict=True))

    @property
    def times(self) -> dict[str, np.ndarray]:
        """Epochs s of the samples of each channel, as they stand in the rows."""
        grids = self.wide_operator.time, self.operator.time
        return dict(zip(CHANNELS, (*grids, self.window.time, self.magnetometer[0]), strict=True))

    @property
    def size(self) -> int:
        """Number of rows of all channels."""
        return 3 * sum(valid.size for valid in self.valid.values())

    def place(self, channel: str) -> slice:
        """Slice of the rows of one channel among those of all."""
        sizes = [3 * valid.size for valid in self.valid.values()]
        first = sum(sizes[: CHANNELS.index(channel)])
        return slice(first, first + sizes[CHANNELS.index(channel)])

    def whitened(self, signal: dict[str, np.ndarray]) -> np.ndarray:
        """Whitened rows (n, q) of a signal, zero where a channel has none; readings go through the low-pass."""
        rows = np.zeros((self.size, next(iter(signal.values())).shape[2]))
        if {"linear", "attitude"} <= set(signal):  # a slow torque follows the attitude: what is left is seen
            local, turned = (one[self.window.good] for one in (self.local_attitude, signal["attitude"]))
            fitted = np.linalg.lstsq(local.reshape(-1, local.shape[2]), turned.reshape(-1, turned.shape[2]))[0][6:-1]
            slow = least_squares.polynomial(self.time, len(fitted) // 3 - 1, self.arc.origin, self.arc.stop)
            torque = np.einsum("nk,kaq->naq", slow, fitted.reshape(slow.shape[1], 3, -1))
            slow = at_accelerometer(self, np.linalg.inv(self.arc.inertia) @ torque)
            signal = signal | {"linear": signal["linear"] - slow["linear"]}
        for channel, values in signal.items():
            rows[self.place(channel)] = self.whitened_channel(channel, values)
        return rows

    def whitened_channel(self, channel: str, values: np.ndarray) -> np.ndarray:
        """Whitened rows (3 m, q) of one channel, from its values (samples, 3, q) before any low-pass."""
        if channel == "linear":
            values = self.wide_operator(values)
        elif channel == "angular":
            values = self.operator(values)
        return noises.whitened(self.noise[channel], values, self.valid[channel])

    def widened(self, values: np.ndarray) -> np.ndarray:
        """Linear reading (n, ...) at the accelerometer epochs of the manoeuvre, with zeros in the pads."""
        out = np.zeros((self.wide.time.size, *values.shape[1:]))
        out[self.rows - self.wide_rows.start] = values
        return out

    def at(self, time: np.ndarray) -> Context:
        """Context at any epochs of the manoeuvre."""
        key = (time.size, float(time[0]), float(time[-1]))
        return self.remembered(key, lambda one: _context(one.window, one.shift, one.context, one.orbit, time))

    def remembered(self, key: tuple, make) -> dict[str, np.ndarray]:
        """Signal or Context that `make` gives for this manoeuvre, computed once and kept under a key."""
        if key not in self.memory:
            self.memory[key] = make(self)
        return self.memory[key]


def manoeuvres(aligned: xr.Dataset, field_: xr.Dataset, smoothed: xr.Dataset, offset, noise, settings) -> list:
    """Every manoeuvre that has an attitude and accelerometer samples.

    Products are "align", "com_offset.field" and "com_offset.attitude", the offset (3,) m is the present estimate, noise
    {channel: Measured} may be completed later; settings as of `observations.observe`.
    """
    per_current = np.asarray(settings["dipole_per_current"])
    windows = motion.windows(aligned, field_, settings["inertia"], per_current, settings["dynamics"] == "full")
    settings = settings | {"largest_dipole": max((float(np.abs(w.arc.dipole_b).max()) for w in windows), default=0.0)}
    views = [_manoeuvre((aligned, field_, smoothed), i, w, (offset, noise), settings) for i, w in enumerate(windows)]
    return [view for view in views if view is not None]


def _manoeuvre(products, index, window, estimates, settings):
    """Manoeuvre of a Window; products (align, field, attitude), estimates (offset (3,) m, noise); None if too short."""
    aligned, field_, smoothed = products
    own_samples = np.flatnonzero(smoothed["acc_manoeuvre"].values == index)
    shift = float(smoothed["sca_shift"].values[index])
    if own_samples.size < 200 or window.rod < 0 or not np.isfinite(shift):
        return None
    acc_shift = float(np.nan_to_num(smoothed["acc_shift"].values[index], nan=shift))
    time = smoothed["time_acc"].values[own_samples]
    rows = np.searchsorted(aligned["time_acc"].values, time)
    good = aligned["acc_flag"].values[rows] == 0
    good &= np.isfinite(aligned["linear_b"].values[rows]).all(axis=1)
    good &= np.isfinite(aligned["angular_b"].values[rows]).all(axis=1)
    first, last = window.arc.edges[[0, -1]] + acc_shift
    filters = (settings["lowpass_hz"], settings["half_width_s"], settings["step_s"])
    operator = operator_for(time, good, max(first, time[0]), min(last, time[-1]), *filters)
    if operator.valid.sum() < 60:
        return None
    # transition and columns of the attitude along a path that follows the measured one
    known = np.isfinite(aligned["quaternion"].values).all(axis=1) & (aligned["sca_flag"].values == 0)
    tags = aligned["time_sca"].values[known]
    origin = np.clip(np.array([window.arc.origin]), tags[0], tags[-1])
    quaternion = frames.interpolate(tags, aligned["quaternion"].values[known], origin)[0]
    state = dynamics.State(window.arc.origin, quaternion, smoothed["rate_b"].values[own_samples[0]])
    degree, scale = settings["torque_degree"], np.nan_to_num(smoothed["torque_scale"].values[index], nan=1.0)
    torques = motion.torque_of(window.arc, motion.Solution(state, np.zeros((degree + 1, 3)), scale, shift))
    step = settings["integration_step_s"]
    _, _, _, sensitivity = dynamics.integrate_with_sensitivity(window.time, state, torques, max_step=step)
    slow = motion.slow_torque_response(window.arc, window.time, sensitivity[:, :, :6], degree)
    local = np.concatenate([sensitivity[:, :3, :6], slow, sensitivity[:, :3, 9:10]], axis=2)
    # what effects look at; tags are taken as they are, for edges tell a delay to 0.1 s and the field would take that up
    orbit = field_["time_orbit"].values, field_["position_i"].values
    basic = Context(
        time=time,
        rate_b=smoothed["rate_b"].values[own_samples],
        gradient_b=smoothed["gradient_b"].values[own_samples],
        inertia_b=window.arc.inertia,
        start=aligned["start"].values,
        stop=aligned["stop"].values,
        extra={name: settings[name] for name in ("mass", "largest_dipole")},
    )
    context = _context(window, acc_shift, basic, orbit, time)
    torque = np.cross(context.dipole_b, context.field_b)
    rate_dot = smoothed["smooth_b"].values[own_samples] + np.linalg.solve(context.inertia_b, torque.T).T
    context = replace(context, rate_dot_b=rate_dot, angular_b=rate_dot)
    offset, noise = estimates
    sampled = at_one_hertz(field_, *window.arc.edges[[0, -1]])
    partials = sensitivity[:, :, :6], local, sensitivity[:, :3, 6:9], shift, acc_shift
    start, stop = aligned["start"].values, aligned["stop"].values  # pads reach up to half way to the next manoeuvre
    begin = [first - PADS_S, *((stop[stop < first] + first) / 2), aligned["window_start"].values[index]]
    end = [last + PADS_S, *((start[start > last] + last) / 2), aligned["window_stop"].values[index]]
    pads = slice(*np.searchsorted(aligned["time_acc"].values, [max(begin), min(end)]))
    wide = _wide(aligned, field_, pads, rows, context, orbit)
    degree = round(settings["linear_drift_degree"] * np.ptp(wide.time) / (last - first))
    usable = (aligned["acc_flag"].values == 0) & np.isfinite(aligned["linear_b"].values).all(axis=1)
    wide_operator = operator_for(wide.time, usable[pads], wide.time[0], wide.time[-1], *filters)
    law = catalogue()["accelerometer.offset"]
    context, wide = (replace(one, linear_b=law.contribution(one, offset)) for one in (context, wide))
    present = context, wide, pads, wide_operator, offset, degree, sampled, orbit
    return Manoeuvre(index, window, time, rows, operator, *partials, noise, *present)


def _wide(aligned, field_, pads, rows, context, orbit):
    """Context at the epochs of the linear reading (slice `pads`): outside `rows` no current, measured motion."""
    time, inside = aligned["time_acc"].values[pads], rows - pads.start
    R_bi, field_b = _attitude_and_field(aligned, field_, time)
    turn = R_bi * context.gradient_b.any()  # the published dynamics have no gradient
    gradient_b = turn @ gravity.gradient_i(lines_between(time, *orbit)) @ np.swapaxes(turn, 1, 2)
    rate, rate_dot = np.broadcast_to(context.rate_b.mean(axis=0), (time.size, 3)).copy(), np.zeros((time.size, 3))
    spans = (time[0], context.time[0] - BEYOND_S), (context.time[-1] + BEYOND_S, time[-1])
    for outer, span in zip((slice(0, inside[0]), slice(inside[-1] + 1, None)), spans, strict=True):
        rate[outer], rate_dot[outer] = _slow_motion(aligned, span, time[outer]) or (rate[outer], 0.0)
    parts = {"rate_b": rate, "rate_dot_b": rate_dot, "angular_b": rate_dot.copy(), "gradient_b": gradient_b}
    parts |= {"dipole_b": np.zeros((time.size, 3)), "field_b": field_b}
    for name, values in parts.items():
        values[inside] = getattr(context, name)
    environment = orbit_environment.extras(time, *orbit, R_bi, context.extra["mass"], DRAG)
    return replace(context, time=time, **parts, extra=context.extra | environment)


def _slow_motion(aligned, span, time):
    """Rate and its derivative (n, 3) rad s-1 and s-2 at epochs (n,) s, of a cubic through a span; None of too few."""
    tags, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    good = np.isfinite(quaternion).all(axis=1) & (tags >= span[0]) & (tags <= span[1])  # none that is flagged
    if good.sum() < ENOUGH:
        return None
    rate, _ = kinematics.rates_from_attitude(tags[good], quaternion[good], (int(good.sum()) - 1) // 2, 3)
    fitted, since = polynomial.polyfit(tags[good] - span[0], rate, 2), time - span[0]
    return polynomial.polyval(since, fitted).T, polynomial.polyval(since, polynomial.polyder(fitted)).T


def _attitude_and_field(aligned, field_, time):
    """Attitude (n, 3, 3) R_bi by the star camera and field (n, 3) T in the body, at any epochs of the records."""
    known = np.isfinite(aligned["quaternion"].values).all(axis=1)
    tags = aligned["time_sca"].values[known]
    quaternion = frames.interpolate(tags, aligned["quaternion"].values[known], np.clip(time, tags[0], tags[-1]))
    R_bi = frames.R_bi_from_quaternion(quaternion)
    return R_bi, np.matvec(R_bi, lines_between(time, field_["time_orbit"].values, field_["field_i"].values))


def attitude_at(window: motion.Window, time: np.ndarray) -> np.ndarray:
    """Measured attitude (n, 3, 3) R_bi at any epochs of the arc."""
    good = window.good[1:]
    known = window.time[1:][good]
    at = np.clip(time, known[0], known[-1])
    return frames.R_bi_from_quaternion(frames.interpolate(known, window.quaternion[1:][good], at))


def field_at(arc: motion.Arc, time: np.ndarray, R_bi: np.ndarray) -> np.ndarray:
    """Field in the body (n, 3) T at epochs (n,) s with attitude R_bi (n, 3, 3)."""
    return np.matvec(R_bi, lines_between(time, arc.field_time, arc.field_i))


def _context(window, shift, base, orbit, time):
    """Context at epochs (n,) s near a manoeuvre: motion interpolated from the Context `base`, edges `shift` s later."""
    resampled = lambda v: lines_between(time, base.time, v)  # noqa: E731
    R_bi = attitude_at(window, time)
    environment = orbit_environment.extras(time, *orbit, R_bi, base.extra["mass"], DRAG)
    return replace(
        base,
        time=time,
        rate_b=resampled(base.rate_b),
        rate_dot_b=None if base.rate_dot_b is None else resampled(base.rate_dot_b),
        gradient_b=resampled(base.gradient_b.reshape(-1, 9)).reshape(-1, 3, 3),
        dipole_b=motion.dipole_at(window.arc, time, shift),
        field_b=field_at(window.arc, time, R_bi),
        linear_b=None,
        angular_b=None,
        extra=environment | {"largest_dipole": base.extra["largest_dipole"]},
    )


def block_of(one: Manoeuvre, aligned: xr.Dataset, smoothed: xr.Dataset, settings) -> Block:
    """Block of one manoeuvre: whitened residuals of the baseline, columns of the offset (per m), local columns."""
    linear, angular = aligned["linear_b"].values[one.wide_rows], aligned["angular_b"].values[one.rows]
    residual = np.zeros((one.window.time.size, 3))
    residual[one.window.good] = smoothed["sca_residual_b"].values[smoothed["sca_manoeuvre"].values == one.index]
    scale = np.nan_to_num(smoothed["torque_scale"].values[one.index], nan=1.0)
    observed = {
        "linear": (np.nan_to_num(linear - linear[len(linear) // 2]) - one.wide.linear_b)[..., None],
        "angular": (np.nan_to_num(angular - angular[len(angular) // 2]) - one.context.rate_dot_b)[..., None],
        "attitude": (residual + one.scale_attitude @ (scale - 1))[..., None],
        "magnetometer": one.magnetometer[1][..., None],
    }
    return Block(
        label=f"manoeuvre {one.index + 1}",
        observed=np.concatenate([one.whitened_channel(name, values)[:, 0] for name, values in observed.items()]),
        global_columns=one.whitened({"linear": catalogue()["accelerometer.offset"].columns(one.wide)}),
        local_columns=np.concatenate([one.whitened(columns) for columns in _local(one, settings)], axis=1),
        channel=np.repeat(CHANNELS, [3 * v.size for v in one.valid.values()]),
        axis=np.concatenate([np.repeat([0, 1, 2], v.size) for v in one.valid.values()]),
        time=np.concatenate([np.tile(t, 3) for t in one.times.values()]),
        steps=_steps(one),
        level_error={(c, a): float(m.error[one.index, a]) for c, m in one.measured.items() for a in range(3)},
    )


def _steps(view):
    """{epoch s: whitened rows (n, 3)} of unit steps of the linear reading, none within `ENDS_S` of its ends."""
    grid = view.operator.time
    epochs = np.arange(grid[0] + ENDS_S, grid[-1] - ENDS_S, STEP_S)
    shapes = view.wide_operator((view.wide.time[:, None, None] >= epochs).astype(float))[:, 0]
    rows = np.zeros((view.size, epochs.size, 3))
    rows_linear = noises.whitened(view.noise["linear"], on_axes(shapes), view.valid["linear"])
    rows[view.place("linear")] = rows_linear.reshape(-1, epochs.size, 3)
    return {float(t): rows[:, k] for k, t in enumerate(epochs)}


def _local(view, settings):
    """Signals of local parameters: drifts, start state, slow torque and edge shift, accelerometer samples at edges."""
    columns = []
    for channel, time, degree in (
        ("linear", view.wide.time, view.drift_degree),
        ("angular", view.time, settings["angular_drift_degree"]),
        ("magnetometer", view.magnetometer[0], 0),
    ):
        if time.size:
            shape = least_squares.polynomial(time, degree, time[0], max(time[-1], time[0] + 1))
            columns.append({channel: on_axes(shape)})
    columns.append({"attitude": view.local_attitude})
    sampling = view.time, view.context.field_b, float(np.median(np.diff(view.time)))
    early_late = [motion.magnetic_acceleration(view.arc, view.acc_shift + delay, *sampling) for delay in (-0.15, 0.15)]
    # Where between two samples an edge falls is known to neither model, and from one edge of the wave to the next a
    # momentary sample near it may change sides: a column each for the sample before an edge and the one after.
    near = np.searchsorted(view.time, motion.large_edges(view.arc) + view.acc_shift)[:, None] + np.array([-1, 0])
    near = np.clip(near, 0, view.time.size - 1).ravel()
    jumps = np.zeros((view.time.size, 3, near.size))
    jumps[near, :, np.arange(near.size)] = (early_late[1] - early_late[0])[near]
    return [*columns, at_accelerometer(view, jumps)]


def at_accelerometer(one: Manoeuvre, alpha: np.ndarray) -> dict[str, np.ndarray]:
    """Signal of angular accelerations (n, 3, q) rad s-2 in the accelerometer: -alpha x offset in the linear reading."""
    linear = -np.moveaxis(np.cross(np.moveaxis(alpha, 2, 1), one.offset), 1, 2)
    return {"linear": one.widened(linear), "angular": alpha}


def of_torque(one: Manoeuvre, torque_of) -> dict[str, np.ndarray]:
    """Signal, in accelerometer and attitude, of a torque that is a function Context -> (n, 3, q) N m."""
    inverse = np.linalg.inv(one.arc.inertia)

    def alpha(context):
        return np.moveaxis(torque_of(context), 2, 1) @ inverse.T

    attitude = one.propagator(lambda time: alpha(one.at(time)))
    return at_accelerometer(one, np.moveaxis(alpha(one.context), 1, 2)) | {"attitude": attitude}


def reading(one: Manoeuvre, channel: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Epochs and reading that the model of a channel predicts, and three whitened rows converted to its unit.

    Rows (n, 3): observed, left without a finding, left with it. The linear and the angular reading are those after the
    low-pass of the solution; the attitude is the rotation from a satellite whose torquers are off. Time (m,) s, model
    (m, 3) m s-2, rad s-2, rad or T, columns (3, m, 3) likewise, NaN where there is no sample.
    """
    valid, time = one.valid[channel], one.times[channel]
    parts = rows[one.place(channel)].reshape(3, valid.size, -1)
    columns = np.stack([noises.unwhiten(one.noise[channel][a], parts[a], valid) for a in range(3)], axis=1)
    if channel == "linear":
        model = one.wide_operator(one.wide.linear_b)
        inside = (time >= one.operator.time[0]) & (time <= one.operator.time[-1])
        added = np.nan_to_num(columns[:, :, 1] - columns[:, :, 2]) ** 2
        if added[~inside].sum() < SHOWN * added.sum():
            time, model, columns = time[inside], model[inside], columns[inside]
    elif channel == "angular":
        model = one.operator(one.context.rate_dot_b)
    else:  # all torques once; the field that the attitude predicts
        model = one.scale_attitude.sum(axis=2) if channel == "attitude" else one.at(time).field_b
    return time, model, np.moveaxis(columns, 2, 0)


def quiet_noise(aligned: xr.Dataset, field_: xr.Dataset, settings) -> tuple[dict[str, Measured], dict]:
    """{channel: Measured} and {channel: samples an axis} of all channels but the attitude, from quiet data."""
    time, spans = aligned["time_acc"].values, list(quiet_spans(aligned, settings))
    models, samples, count, usable = {}, {}, aligned.sizes["manoeuvre"], aligned["mag_flag"].values == 0
    mag, current = aligned["time_mag"].values[usable], np.nan_to_num(aligned["current_b"].values[usable])
    between = (mag[1:] + mag[:-1]) / 2
    for channel in ("linear", "angular"):
        values, pieces, epochs = aligned[f"{channel}_b"].values, [], []
        for inside, _, operator in quiet_operators(aligned, values, settings):
            piece = np.nan_to_num(values[inside])
            if channel == "angular":  # the torque of the control currents, held from sample to sample, is no noise
                field_b = _attitude_and_field(aligned, field_, time[inside])[1]
                held = current[np.searchsorted(between, time[inside])]
                torque = np.cross(held * np.asarray(settings["dipole_per_current"]), field_b)
                piece = piece - np.linalg.solve(np.asarray(settings["inertia"]), torque.T).T
            pieces.append(operator(piece - piece[len(piece) // 2]))
            epochs.append(operator.time)
        cleaned, _ = noises.without_lines(pieces, settings["step_s"]) if pieces else ([], None)
        drifts = _drifts(cleaned, settings[f"{channel}_drift_degree"])
        orders = settings["noise_order"], settings["step_s"]
        models[channel] = _measured(cleaned, drifts, orders, nearest(aligned, epochs), count)
        samples[channel] = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    sampled = [(t, v, valid) for t, v, valid in (at_one_hertz(field_, *span) for span in spans) if valid.sum() >= 60]
    pieces = [np.where(valid[:, None], values, np.nan) for _, values, valid in sampled]
    near = nearest(aligned, [t for t, _, _ in sampled])
    drifts, orders = _drifts(pieces, settings["drift_degree"]), (settings["attitude_noise_order"], 1.0)
    models["magnetometer"] = _measured(pieces, drifts, orders, near, count)
    samples["magnetometer"] = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    return models, samples


def _measured(pieces, columns, orders, near, count):
    """Measured of `count` manoeuvres from pieces less columns (n_i, 3, q_i), each near (k,) one; orders: AR, step s."""
    if not pieces:
        return Measured([[noises.NoiseModel(np.zeros(0), np.ones(1), orders[1])] * 3] * count, np.zeros((count, 3)))
    detrended, lost = noises.beside(pieces, columns), [one.shape[2] / 3 for one in columns]
    models = noises.fit_detrended(pieces, detrended, *orders)
    levels = noises.levels(models, [detrended(piece, index) for index, piece in enumerate(pieces)], lost, near, count)
    louder = [[m.louder(f) for m, f in zip(models, row, strict=True)] for row in levels.value]
    return Measured(louder, levels.error)


def _drifts(pieces, degree):
    """Columns (n_i, 3, 3 (degree + 1)) of a polynomial on each axis of pieces (n_i, 3)."""
    counts = [len(one) for one in pieces]
    return [on_axes(least_squares.polynomial(np.arange(count), degree, 0, count)) for count in counts]


def attitude_noise(smoothed: xr.Dataset, views: list[Manoeuvre], wider: list[np.ndarray], order: int):
    """Measured noise of the star camera, from residuals of a fit of the baseline and every torque that is tried.

    Control torques hide the noise outside the manoeuvres. Unexplained attitude signal widens the model, which costs
    power and never names anything. Wider are (k, 3, q) rad of each manoeuvre, the attitude response to these torques.
    """
    manoeuvre, segments, columns = smoothed["sca_manoeuvre"].values, [], []
    for one, of_torques in zip(views, wider, strict=True):
        residual = np.full((one.window.time.size, 3), np.nan)
        residual[one.window.good] = smoothed["sca_residual_b"].values[manoeuvre == one.index]
        segments.append(residual)
        columns.append(np.concatenate([one.local_attitude, one.scale_attitude, of_torques], axis=2))
    index = np.array([one.index for one in views])
    return _measured(segments, columns, (order, 1.0), index, 1 + max(index, default=-1))


def at_one_hertz(field_: xr.Dataset, begin: float, end: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (n,) s, measured minus model field (n, 3) T, valid (n,) at 1 Hz: each value is written twice."""
    time = field_["time_mag"].values
    inside = np.flatnonzero((time > begin) & (time < end))
    measured = field_["measured_b"].values[inside]
    if inside.size < 10:
        return np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool)
    half = np.rint(2 * (time[inside] - time[inside[0]])).astype(int) % 2
    renewed = [int(np.sum(np.any(np.diff(measured, axis=0)[half[1:] == k] != 0, axis=1))) for k in (0, 1)]
    inside = inside[half == int(renewed[1] >= renewed[0])]
    difference = field_["difference_b"].values[inside]
    valid = (field_["used"].values[inside] > 0) & np.isfinite(difference).all(axis=1)
    return time[inside], np.where(valid[:, None], difference, 0.0), valid
