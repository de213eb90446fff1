"""Readings of the instruments in a simulated motion, and the columns of the Level-1 files."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from gravcal.effects import Context, effect
from gravcal.estimation.noise import coloured
from gravcal.estimation.resampling import lines_between
from gravcal.physics import constants, earth, frames, gravity, orbit_environment
from gravcal.simulation import added

QUATERNION = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")
MAG_FRACTION = 0.083329  # s, tags of MAG1B after the half second, as in the real file of 2023-06-01


@dataclass(frozen=True)
class Clock:
    """Receiver clock and on-board mapping of a day."""

    receiver: np.ndarray  #: (c,) s, CLK1B nodes
    offset: np.ndarray  #: (c,) s, GPS minus receiver
    onboard: np.ndarray  #: (m,) s, TIM1B nodes
    mapping_ns: np.ndarray  #: (m,) ns, receiver minus on-board

    def gps(self, tag: np.ndarray) -> np.ndarray:
        """GPS time of on-board tags (s)."""
        receiver = tag + 1e-9 * np.interp(tag, self.onboard, self.mapping_ns)
        return receiver + np.interp(receiver, self.receiver, self.offset)


@dataclass(frozen=True)
class Epochs:
    """True times of the readings of one span and the tags they get."""

    acc: np.ndarray  #: (n,) s, true GPS time of the readings
    acc_tag: np.ndarray  #: (n,) us past `origin`, integer on-board tags
    sca: np.ndarray  #: (n,) s, true
    sca_tag: np.ndarray  #: (n,) s, GPS
    mag: np.ndarray  #: (n,) s, true
    mag_tag: np.ndarray  #: (n,) s, GPS


@dataclass(frozen=True)
class Motion:
    """True motion at the bounds of the steps; after an edge where it jumps."""

    time: np.ndarray  #: (n,) s
    quaternion: np.ndarray  #: (n, 4)
    rate_b: np.ndarray  #: (n, 3) rad s-1
    rate_dot_b: np.ndarray  #: (n, 3) rad s-2
    gradient_b: np.ndarray  #: (n, 3, 3) s-2
    field_b: np.ndarray  #: (n, 3) T
    command_b: np.ndarray  #: (n, 3) A m2, dipole of the rods

    def at(self, time: np.ndarray) -> "Motion":
        """Motion at the bounds (m,) s among its own that are asked for."""
        index = np.clip(np.searchsorted(self.time, time - 1e-7), 0, self.time.size - 1)
        return Motion(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


def draw_clock(chosen, day: float, rng) -> tuple[Clock, dict]:
    """Clock offset with drift and the mapping jitter of TIM1B, and the columns of CLK1B and TIM1B."""
    receiver = np.arange(day - 300, day + constants.DAY + 301, 10.0)
    offset = rng.uniform(-1, 1) * chosen.clock_offset_s + chosen.clock_drift * (receiver - day)
    onboard = np.arange(day - 295, day + constants.DAY + 300, 8.0)
    mapping_ns = 119.0 * rng.integers(-1, 2, onboard.size)  # jitter of one step of 119 ns
    tag, drift = np.round(onboard * 1e9).astype(np.int64) + mapping_ns.astype(np.int64), chosen.clock_drift
    whole = receiver.astype(np.int64), onboard.astype(np.int64)
    columns = {"CLK1B": {"rcv_time": whole[0], "eps_time": offset, "eps_drift": np.full(offset.size, drift)}}
    columns["TIM1B"] = {"obctime": whole[1], "rcvtime_intg": tag // 10**9, "rcvtime_frac": tag % 10**9}
    return Clock(receiver, offset, onboard, mapping_ns), columns


def draw_epochs(span, clock: Clock, effects, satellite) -> Epochs:
    """Epochs of a span (2,) s: tags of each instrument and their true times; a late tag is an earlier reading."""
    step = satellite["accelerometer_interval"]
    first = np.ceil((span[0] - 1) / step)
    tag = np.round(1e6 * (np.arange(first, np.floor((span[1] + 1) / step)) * step)).astype(np.int64)
    gps = clock.gps(tag * 1e-6)
    inside = (gps >= span[0]) & (gps < span[1])
    tag, gps = tag[inside], gps[inside]
    sca = np.arange(np.ceil(span[0]), span[1])
    mag = np.arange(np.ceil(2 * span[0]), np.floor(2 * span[1])) / 2 + MAG_FRACTION
    late = lambda name, time: added(effects, f"{name}_delay", Context(time=time, epoch=clock.receiver[0]))  # noqa: E731
    return Epochs(gps - late("acc", gps), tag, sca - late("sca", sca), sca, mag - late("mag", mag), mag)


def read_instruments(epochs, motion, scene, satellite, chosen, effects, rng):
    """Level-1 columns {product: {column: array}} of every product for one span."""
    return {
        "ACC1A": _accelerometer(epochs, motion.at(epochs.acc), scene, satellite, chosen, effects, rng),
        "SCA1B": _star_camera(epochs, motion.at(epochs.sca), chosen, effects, rng),
        "MAG1B": _magnetometer(epochs, motion.at(epochs.mag), scene, satellite, chosen, effects, rng),
    } | {name: orbit_columns(epochs.sca_tag, scene.orbit(epochs.sca_tag), name) for name in ("GNI1B", "GNV1B")}


def _accelerometer(epochs, motion, scene, satellite, chosen, effects, rng):
    """Columns of ACC1A: drag, offset, effects, noise and bias of a true motion at the readings."""
    shared = {name: getattr(motion, name) for name in ("rate_b", "rate_dot_b", "gradient_b", "field_b")}
    shared |= {"dipole_b": motion.command_b, "inertia_b": scene.inertia_b, "start": scene.start, "stop": scene.stop}
    shared["epoch"] = scene.spans[0, 0]
    extra = _extras(epochs.acc, motion, scene) if effects else {}
    context = Context(time=epochs.acc, angular_b=motion.rate_dot_b, extra=extra, **shared)
    state = scene.orbit(epochs.acc)
    direction = state[:, 3:] / np.linalg.norm(state[:, 3:], axis=1, keepdims=True)
    density = 1 + 0.5 * np.sin(1.1e-3 * (epochs.acc - scene.spans[0, 0]))  # of air, about once a revolution
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    drag = np.matvec(R_bi, -chosen.drag_m_s2 * density[:, None] * direction)  # against the flight
    linear = drag + effect("accelerometer.offset").contribution(context, scene.offset)
    context = replace(context, linear_b=linear)
    linear = linear + added(effects, "linear_b", context)
    angular = motion.rate_dot_b + added(effects, "angular_b", context)
    read = {
        "lin": _digitised(linear, "linear", "accelerometer", satellite, chosen, rng),
        "ang": _digitised(angular, "angular", "angular", satellite, chosen, rng),
    }
    seconds, micro = np.divmod(epochs.acc_tag, 1_000_000)
    columns = {f"{kind}_accl_{axis}": read[kind][:, i] for kind in read for i, axis in enumerate("xyz")}
    return {"rcvtime_intg": seconds, "rcvtime_frac": micro} | columns


def _extras(time, motion, scene):
    """Drivers of slow disturbances at times (n,) s, {name: array} of `orbit_environment.extras`."""
    orbit = np.arange(max(time[0] - 3 * orbit_environment.WARMING_S, scene.begin), time[-1] + 10, 5.0)
    position_i = scene.orbit(orbit)[:, :3]
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    return orbit_environment.extras(time, orbit, position_i, R_bi, scene.mass, scene.drag_b)


def context_of_steps(inner, parts: int, steps, around, states, dipole_b, scene) -> Context:
    """Context of dipole and torque effects at `parts` epochs (n,) s inside each step; states are at its start."""
    begin, state = steps.bound[:-1], states[:-1]
    R_bi, position_i = frames.R_bi_from_quaternion(state[:, :4]), lines_between(begin, around.time, around.position_i)
    extra = orbit_environment.extras(begin, around.time, around.position_i, R_bi, scene.mass, scene.drag_b)
    spread = lambda v: v if np.ndim(v) == 0 else np.repeat(v, parts, axis=0)  # noqa: E731
    return Context(
        time=inner,
        rate_b=spread(state[:, 4:]),
        gradient_b=spread(R_bi @ gravity.gradient_i(position_i) @ np.swapaxes(R_bi, 1, 2)),
        dipole_b=spread(dipole_b),
        field_b=spread(np.matvec(R_bi, lines_between(begin, around.time, around.field_i))),
        inertia_b=scene.inertia_b,
        start=scene.start,
        stop=scene.stop,
        epoch=scene.spans[0, 0],
        extra={name: spread(value) for name, value in extra.items()},
    )


def _digitised(true, kind, names, satellite, chosen, rng):
    """Reading (n, 3) of true values (n, 3): noise and bias of each axis added, in whole steps of the converter."""
    shapes = [table_density(chosen.noise_frequency_hz, getattr(chosen, f"{kind}_noise_{axis}")) for axis in "xyz"]
    drawn = [coloured(one, len(true), satellite["accelerometer_interval"], rng) for one in shapes]
    noise = chosen.noise_scale * np.stack(drawn, axis=1)
    return quantised(true + noise + satellite[f"{names}_bias"], np.array(satellite[f"{names}_step"]))


def _star_camera(epochs, motion, chosen, effects, rng):
    """Columns of SCA1B: attitude of a true motion at the readings, with noise and effects."""
    angle = star_camera_noise(epochs.sca.size, chosen, rng)
    angle = angle + added(effects, "pointing_b", Context(time=epochs.sca, rate_b=motion.rate_b))
    return attitude_columns(epochs.sca_tag, star_camera(motion.quaternion, angle, rng))


def _magnetometer(epochs, motion, scene, satellite, chosen, effects, rng):
    """Columns of MAG1B at 2 Hz, each field twice, with bias, noise and effects; currents of the rods."""
    extra = _extras(epochs.mag, motion, scene) if effects else {}
    context = Context(time=epochs.mag, field_b=motion.field_b, dipole_b=motion.command_b, extra=extra)
    noise = chosen.noise_scale * np.array(satellite["magnetometer_noise"]) * rng.standard_normal((epochs.mag.size, 3))
    field = motion.field_b + added(effects, "field_b", context) + scene.magnetometer_bias + noise
    held = np.maximum(np.arange(epochs.mag.size) - np.arange(epochs.mag.size) % 2, 0)
    return magnetometer_columns(epochs.mag_tag, field[held], motion.command_b / scene.dipole_per_current, satellite)


def attitude_columns(time, quaternion) -> dict:
    """Columns of SCA1B from quaternions (n, 4) at whole seconds."""
    return {"gps_time": np.round(time).astype(np.int64)} | dict(zip(QUATERNION, quaternion.T, strict=True))


def orbit_columns(time, state_i, product: str) -> dict:
    """Columns of GNI1B or GNV1B from inertial states (n, 6) m, m s-1 at whole seconds."""
    if product == "GNV1B":
        state_i = np.concatenate(earth.state_to_fixed(time, state_i[:, :3], state_i[:, 3:]), axis=1)
    return {"gps_time": np.round(time).astype(np.int64)} | dict(zip(STATE, state_i.T, strict=True))


def split_time(tag) -> dict:
    """Columns of tags (n,) s that are whole seconds and microseconds."""
    whole = np.floor(tag)
    return {"time_intg": whole.astype(np.int64), "time_frac": np.round(1e6 * (tag - whole)).astype(np.int64)}


def magnetometer_columns(tag, field_b, current_ma, satellite) -> dict:
    """Columns of MAG1B from field (n, 3) T and currents (n, 3) mA, which are read in whole steps."""
    field = 1e6 * quantised(field_b, satellite["magnetometer_step"])
    current = quantised(current_ma, satellite["torquer_current_step"])
    columns = split_time(tag) | {f"Mfv{axis}_RAW": field[:, i] for i, axis in enumerate("XYZ")}
    columns |= {f"torque{i + 1}A": np.maximum(current[:, i], 0) for i in range(3)}  # six coils of GRACE-FO: A, positive
    return columns | {f"torque{i + 1}B": np.minimum(current[:, i], 0) for i in range(3)}  # B, negative


def join(parts: list[dict]) -> dict:
    """Columns {product: {column: array}} of several spans, one after the other."""
    return {p: {n: np.concatenate([part[p][n] for part in parts]) for n in parts[0][p]} for p in parts[0]}


def quantised(values: np.ndarray, step) -> np.ndarray:
    """Values rounded to multiples of the step (any unit)."""
    return np.round(values / step) * step


def table_density(frequency_hz, amplitude):
    """One-sided power density, Hz -> unit^2 Hz-1, from amplitude densities at nodes, joined in log-log."""
    log_f, log_a = np.log(frequency_hz), np.log(np.maximum(amplitude, 1e-300))
    return lambda f: np.exp(2 * np.interp(np.log(f), log_f, log_a))


def star_camera_noise(count: int, chosen, rng) -> np.ndarray:
    """White and first-order Markov noise of the attitude at 1 Hz, (count, 3) rad in b."""
    keep = np.exp(-1.0 / chosen.star_camera_slow_s)
    drive = rng.standard_normal((count + 200, 3)) * chosen.star_camera_slow_rad * np.sqrt(1 - keep**2)
    slow = lfilter([1.0], [1.0, -keep], drive, axis=0)[200:]
    return chosen.noise_scale * (slow + chosen.star_camera_white_rad * rng.standard_normal((count, 3)))


def star_camera(quaternion: np.ndarray, angle_b: np.ndarray, rng) -> np.ndarray:
    """Measured quaternions: the error angle applied in the body, the sign of a few runs flipped."""
    measured = frames.quaternion_product(quaternion, frames.from_rotation_vector(angle_b))
    sign = np.where(np.cumsum(rng.random(len(measured)) < 2e-4) % 2 == 1, -1.0, 1.0)  # a flip in 5000
    return measured * sign[:, None]
