"""Simulated days of an inertial sensor: swing, roll or both, record by record, and their truth.

The attitude of a swing is integrated step by step; it shares nothing with the integration of the estimator. A roll is
made span by span, so that nineteen days fit.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import nnls
from scipy.signal import lfilter

from gravcal import catalog
from gravcal.effects import Context
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation.resampling import lines_between
from gravcal.physics import dynamics, frames, gravity, sensing
from gravcal.physics.constants import DAY, EARTH_RADIUS, GM
from gravcal.simulation import added, flight, within

STEP_SENSOR, STEP_TRACKER, STEP_ORBIT = 0.1, 0.25, 1.0  # s, of the layouts in gravcal/io/daily.toml
FINE = 0.05  # s, every epoch of sensor and tracker is a multiple
KNOT = 500.0  # s, spacing of the changes of roll rate and bias
MEMORY = 21600.0  # s, correlation time of the wander of the bias

#: Effects that this simulation can hide.
KNOWN = (
    *(entry.slug for entry in electrodes.EFFECTS),
    *(f"accelerometer.{name}" for name in ("scale", "misalignment", "angular_leak", "bias_step", "stray_tone")),
    *("timing.accelerometer_delay", "timing.star_camera_delay"),
)


@dataclass(frozen=True)
class Truth:
    """True numbers of the sensor."""

    k: np.ndarray  # (3,) m s-2 V-1
    beta: np.ndarray  # (3,) rad s-2 V-1
    offset: np.ndarray  # (3,) m, centre of mass to test mass
    bias: np.ndarray  # (3,) m s-2, of f = b + k V
    angular_bias: np.ndarray  # (3,) rad s-2
    inertia: np.ndarray  # (3,) kg m2 of the test mass
    delay: float  # s, star-tracker tags late


@dataclass(frozen=True)
class Hidden:
    """Effects {slug: {parameter: value}} and the epoch, GPS s, from which their drifts count."""

    effects: Mapping = field(default_factory=dict)
    epoch: float = 0.0

    def added(self, channel: str, time: np.ndarray) -> np.ndarray:
        """Sum of the effects on a channel that depends on the time (n,) s alone, 0.0 without any."""
        return added(self.effects, channel, Context(time, epoch=self.epoch))


@dataclass(frozen=True)
class Roll:
    """Everything drawn before the satellite rolls."""

    start: float  # s
    stop: float  # s
    path: Callable  # orbit
    knot: np.ndarray  # (m,) s
    rate: np.ndarray  # (m,) rad s-1, roll with respect to the orbit frame, linear between knots
    angle: np.ndarray  # (m,) rad at the knots
    drift: np.ndarray  # (m, 3) m s-2, wander of the bias, linear between knots


def simulate(
    satellite: Mapping, chosen, day: float, seed: int, effects: Mapping | None = None
) -> tuple[Iterator[dict], dict]:
    """Records {"IS1", "ATT", "ORB"} of an event and the truth; arguments as of `gravcal.simulation`.

    They are made when they are asked for, one day or less at a time, none across midnight; effects are of KNOWN.
    """
    hidden = Hidden(within(effects or {}, KNOWN), day)
    if chosen.design:  # its swing and its roll in place of those of the settings
        manoeuvres = {one.kind: one for one in catalog.design(chosen.design).manoeuvres}
        new = {"manoeuvre": "both" if len(manoeuvres) > 1 else next(iter(manoeuvres))}
        if roll := manoeuvres.get("roll"):
            new |= {"roll_s": roll.duration_s, "roll_period_s": roll.period_s}
        if driven := manoeuvres.get("swing"):
            new |= {f"swing_{name[5:]}": value for name, value in driven.facts.items() if name.startswith("axes_")}
            new |= {"swing_s": driven.duration_s}
        chosen = chosen.with_settings(new)
    first, second = np.random.SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(first)
    truth = draw(satellite, chosen, rng)
    swing_start = day + chosen.swing_at_s
    swinging = chosen.manoeuvre in ("swing", "both")
    rolling = chosen.manoeuvre in ("roll", "both")
    flown = draw_roll(chosen, day + (DAY if swinging else 0.0), rng) if rolling else None

    def records():  # yields {product: columns} of the swing, then of each day of the roll
        if swinging or not rolling:
            yield swing(chosen, swing_start, truth, rng, hidden)
        start, own = flown.start if rolling else 0.0, np.random.default_rng(second)
        while rolling and start < flown.stop:
            stop = min(flown.stop, (np.floor((start + DAY / 2) / DAY) + 1) * DAY - DAY / 2)  # midnight
            yield span(chosen, flown, (start, stop), truth, own, hidden)
            start = stop

    drift = flown.drift[1:-1].mean(axis=0) if rolling else np.zeros(3)
    arm = [chosen.arm_x_mm * 1e-3, *satellite["electrode_arm"][1:]]
    ratio = electrodes.linear_over_angular(satellite["test_mass"], satellite["test_mass_inertia"], arm)
    plain = {
        "seed": seed,
        "direction": "com_to_test_mass",
        "k": truth.k.tolist(),
        "beta": truth.beta.tolist(),
        "com_to_test_mass_um": (1e6 * truth.offset).tolist(),
        "bias": (truth.bias + drift).tolist(),
        "bias_is": "mean over the roll of b in f = b + k V",
        "constant_y_m_s2": chosen.radiation_m_s2,
        "delay_s": truth.delay,
        "linear_over_angular_m": ratio.tolist(),
        "swing": [swing_start + chosen.quiet_s, chosen.swing_s] if swinging else None,
        "roll": [flown.start, flown.stop] if rolling else None,
        "effects": dict(hidden.effects),
    }
    return records(), plain


def sessions(limits: Mapping, seconds: float) -> list[list[dict]]:
    """Swings that may be flown within some limits, as plans: the axes that are driven and their periods.

    limits : rate_rad_s, rate_dot_rad_s2, axes, period_s as of `gravcal design --constraints`; seconds : of the swing
    """
    plans = []
    for axes in ("xyz", "xy", "xz"):  # without x, k_z stays unknown
        for period in limits["period_s"] if len(axes) <= limits["axes"] else ():
            periods = [round(period * share, 3) for share in (10 / 11, 12 / 11, 1.0)]  # so that axes are told apart
            rates = [round(min(limits["rate_rad_s"], limits["rate_dot_rad_s2"] * one / 4), 9) for one in periods]
            fixed = {"kind": "swing", "count": 1, "duration_s": float(seconds), "period_s": float(period)}
            rates = [rate * (axis in axes) for axis, rate in zip("xyz", rates, strict=True)]
            plans.append([fixed | {"axes_period_s": periods, "axes_rate_rad_s": rates}])
    return plans


def measured_noise(_usual, _known, scaled, moved) -> dict:
    """Settings with the noise of star trackers, voltages and parasitic forces of a swing ("scale" and "offset").

    Every readout holds the noise of its voltages, the linear ones that of the forces over their scale factor too.
    """
    density = np.concatenate([moved["noise_density"].values, scaled["voltage_density"].values])
    k = scaled["k"].values[int(scaled["chosen_arm"])]
    contributions = np.stack([np.sum(electrodes.READOUT**2, axis=1), np.append(1 / k**2, np.zeros(3))], axis=1)
    relative = contributions / density[:, None] ** 2
    size = np.linalg.norm(relative, axis=0)
    volts, force = np.sqrt(nnls(relative / size, np.ones(6))[0] / size)
    tracker = np.sqrt(np.mean(scaled["tracker_sigma"].values ** 2))
    settings = {"voltage_noise_v_rthz": volts, "acceleration_noise_m_s2_rthz": force, "tracker_noise_rad": tracker}
    return {name: float(value) for name, value in settings.items()}


def draw(satellite: Mapping, chosen, rng) -> Truth:
    """Truth drawn about the settings; mass, inertia, arms and k_y of the catalogue or from their prior."""
    share = 1 + chosen.factor_scatter * rng.standard_normal(2)
    beta = np.array(chosen.angular_factor) * share[[0, 1, 1]]
    spread = chosen.divisor_scatter * rng.standard_normal(5)
    mass = satellite["test_mass"] + satellite["test_mass_sigma"] * spread[0]
    inertia, sigma = (np.array(satellite[f"test_mass_inertia{end}"]) for end in ("", "_sigma"))
    inertia = inertia + sigma * spread[[1, 2, 2]]
    arm = np.array([chosen.arm_x_mm * 1e-3, *satellite["electrode_arm"][1:]])
    arm = arm + np.array(satellite["electrode_arm_sigma"]) * spread[3]
    ratio = electrodes.linear_over_angular(mass, inertia, arm)
    return Truth(
        k=np.array([ratio[1] * beta[1], chosen.k_y * (1 + 0.1 * spread[4]), ratio[0] * beta[0]]),
        beta=beta,
        offset=1e-6 * (np.array(chosen.offset_um) + chosen.offset_scatter_um * rng.standard_normal(3)),
        bias=np.array(chosen.bias_m_s2) * (1 + chosen.bias_scatter * rng.standard_normal(3)),
        angular_bias=chosen.angular_bias_rad_s2 * rng.standard_normal(3),
        inertia=inertia,
        delay=float(chosen.delay_s + chosen.delay_scatter_s * rng.standard_normal()),
    )


def orbital_rate(chosen) -> float:
    """Mean motion of the orbit, rad s-1."""
    return float(np.sqrt(GM / (EARTH_RADIUS + chosen.altitude_km * 1e3) ** 3))


def electrostatic(time, quaternion, rate_b, rate_dot_b, state_i, truth: Truth, chosen) -> tuple[np.ndarray, np.ndarray]:
    """Linear m s-2 and angular acceleration rad s-2 (n, 3) that hold the test mass, without noise; states (n, 6) in i.

    f = a_ng + (M - G) p; torque / J = w' + J^-1 (w x J w - vex(J G - G J)); equations.md M1 and section 8.5. Drag acts
    against the flight, solar pressure along the normal of the orbit.
    """
    R_bi = frames.R_bi_from_quaternion(quaternion)
    R_bo = R_bi @ np.swapaxes(frames.flight_frame(state_i), 1, 2)
    gradient_b = gravity.rotate_tensor(R_bi, gravity.gradient_i(state_i[:, :3]))
    phase = orbital_rate(chosen) * time
    drag = chosen.drag_m_s2 * (1 + np.sin(phase) / 3 + 0.1 * np.sin(2 * phase + 1))
    light = np.full_like(drag, chosen.radiation_m_s2)
    air_and_light_o = np.stack([0.1 * light * np.cos(phase), light, -drag], axis=1)
    tensor = sensing.offset_tensor(rate_b, rate_dot_b, gradient_b)
    linear = np.matvec(R_bo, air_and_light_o) + np.matvec(tensor, truth.offset)
    gravity_torque = dynamics.gravity_gradient_torque(np.diag(truth.inertia), gradient_b)
    return linear, rate_dot_b + (np.cross(rate_b, rate_b * truth.inertia) - gravity_torque) / truth.inertia


def swing(chosen, start: float, truth: Truth, rng, hidden: Hidden) -> dict:
    """Voltages, attitude and orbit round one swing, {"IS1", "ATT", "ORB"}, from a whole GPS second on."""
    length = 2 * chosen.quiet_s + chosen.swing_s
    path = flight.drawn(chosen, 1e-4, start, start + length, rng)
    fine = start - 10 + FINE * np.arange(round((length + 20) / FINE) + 1)
    quaternion, rate, rate_dot = _motion(fine, start + chosen.quiet_s, path, chosen, rng)
    tag = start + STEP_SENSOR * np.arange(round(length / STEP_SENSOR))
    pick = np.rint((tag - fine[0]) / FINE).astype(int)
    held = electrostatic(tag, quaternion[pick], rate[pick], rate_dot[pick], path(tag), truth, chosen)
    return {
        "IS1": {"time": tag, "volts": read_volts(*with_effects(tag, *held, truth, hidden), truth, chosen, rng)},
        "ATT": _tracked((start, start + length), (fine, quaternion), truth, chosen, rng, hidden),
        "ORB": _orbit_record(start, length, path),
    }


def _motion(fine, swing_start, path, chosen, rng):
    """Attitude (n, 4), rate and its derivative (n, 3) on the fine grid; between manoeuvres they sway slowly.

    A swing is a square wave of torque with rounded edges, whole periods, rate zero at both ends.
    """
    rate_dot, rise = np.zeros((fine.size, 3)), max(chosen.swing_rise_s, 1e-3)
    axes = enumerate(zip(chosen.swing_period_s, chosen.swing_rate_rad_s, strict=True))
    for axis, (period, rate) in axes if chosen.manoeuvre != "none" else ():
        length = np.floor(chosen.swing_s / period) * period
        u = fine - swing_start
        wave = np.tanh(np.cos(2 * np.pi * u / period) * period / (2 * np.pi) / rise)
        gate = (np.tanh(u / rise) - np.tanh((u - length) / rise)) / 2
        rate_dot[:, axis] = 4 * rate / period * wave * gate
    sway = rng.uniform(300.0, 900.0, 3)
    rate_dot = rate_dot + 2e-8 * np.sin(2 * np.pi * fine[:, None] / sway + rng.uniform(0, 2 * np.pi, 3))
    rate = cumulative_trapezoid(rate_dot, dx=FINE, axis=0, initial=0.0)
    rate = rate - rate.mean(axis=0) * 0.1 + np.array([0.0, -orbital_rate(chosen), 0.0])  # 90 % stay: a drift
    first = frames.quaternion_from_R_bi(frames.flight_frame(path(fine[:1])))[0]
    start = frames.quaternion_product(first, frames.from_rotation_vector(5e-4 * rng.standard_normal(3)))
    return attitude(FINE, rate, start), rate, rate_dot


def attitude(step, rate, start):
    """Attitude (n, 4) from a start (4,), continuous in sign, by rates (n, 3) rad s-1, averaged over each step s."""
    turns = frames.from_rotation_vector(step / 2 * (rate[1:] + rate[:-1]))
    turn_matrices = np.stack([frames.quaternion_product(unit, turns) for unit in np.eye(4)], axis=2)  # as matrices
    quaternion = np.array(list(itertools.accumulate(turn_matrices, lambda q, turn: turn @ q, initial=start)))
    return quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)


def with_effects(time, linear_b, angular_b, truth: Truth, hidden: Hidden) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular acceleration (n, 3) m s-2, rad s-2 with the hidden effects of electrodes and loop."""
    if not hidden.effects:
        return linear_b, angular_b
    delay = hidden.added("acc_delay", time)
    if np.any(delay):
        linear_b, angular_b = (lines_between(time - delay, time, values) for values in (linear_b, angular_b))
    readings = (linear_b - truth.bias) / truth.k, (angular_b - truth.angular_bias) / truth.beta
    extra = {"volts": electrodes.volts(np.hstack(readings)), "displacement_b": -linear_b / electrodes.LOOP**2}
    context = Context(time, linear_b=linear_b, angular_b=angular_b, epoch=hidden.epoch, extra=extra)
    linear = linear_b + added(hidden.effects, "linear_b", context)
    angular = angular_b + added(hidden.effects, "angular_b", context)
    recorded = electrodes.readouts(added(hidden.effects, "electrode_v", context) + np.zeros((time.size, 6)))
    return linear + truth.k * recorded[:, :3], angular + truth.beta * recorded[:, 3:]


def read_volts(linear_b, angular_b, truth: Truth, chosen, rng, drift_b=0.0) -> np.ndarray:
    """Recorded voltages (n, 6) of accelerations (n, 3) that hold the test mass; `drift_b` (n, 3) wander of the bias.

    V = (f - b - n)/k; Remote Sens. 2023, 15, 3817, eq. 4.
    """
    half_band = np.sqrt(0.5 / STEP_SENSOR)
    count = linear_b.shape[0]
    parasitic = chosen.acceleration_noise_m_s2_rthz * half_band * rng.standard_normal((count, 3))
    combined = np.concatenate(
        [(linear_b - truth.bias - drift_b - parasitic) / truth.k, (angular_b - truth.angular_bias) / truth.beta], axis=1
    )
    volts = electrodes.volts(combined)
    volts += chosen.voltage_noise_v_rthz * half_band * rng.standard_normal((count, 6))
    hit = rng.random(count) < chosen.spikes_per_hour / 3600 * STEP_SENSOR
    volts[hit, 0] += chosen.spike_v * rng.choice([-1.0, 1.0], np.count_nonzero(hit))
    return volts


def _tracked(bounds, path, truth, chosen, rng, hidden):
    """Record "ATT" at 4 Hz: attitude with white noise about each axis; a tag late by the delay has an earlier one."""
    (start, stop), (time, quaternion) = bounds, path
    tag = start + STEP_TRACKER * np.arange(round((stop - start) / STEP_TRACKER))
    epoch = np.clip(tag - truth.delay - hidden.added("sca_delay", tag), time[0], time[-1])
    tracked = frames.interpolate(time, quaternion, epoch)
    angle = hidden.added("pointing_b", tag)
    if np.any(angle):
        tracked = frames.quaternion_product(tracked, frames.from_rotation_vector(angle))
    noise = frames.from_rotation_vector(chosen.tracker_noise_rad * rng.standard_normal((tag.size, 3)))
    return {"time": tag, "quaternion": frames.continuous(frames.quaternion_product(tracked, noise))}


def _orbit_record(start, length, path):
    """Record "ORB": states of a path at whole seconds."""
    time = np.arange(start, start + length + 1, STEP_ORBIT)
    state = path(time)
    return {"time": time, "position": state[:, :3], "velocity": state[:, 3:]}


def draw_roll(chosen, start: float, rng) -> Roll:
    """Orbit, roll rate and wander of the bias, a first-order Markov process at the knots; start GPS s, whole."""
    stop = start + chosen.roll_s
    knot = start - KNOT + KNOT * np.arange(int(np.ceil(chosen.roll_s / KNOT)) + 3)
    path = flight.drawn(chosen, 1e-4, knot[0], knot[-1], rng)
    block = rng.random(knot.size // 6 + 1) < chosen.roll_disturbed_share
    size = chosen.roll_rate_scatter * np.where(np.repeat(block, 6)[: knot.size], 5.0, 1.0)
    inertial = 2 * np.pi / chosen.roll_period_s * (1 + size * rng.standard_normal(knot.size))
    rate = inertial + orbital_rate(chosen)
    steps = KNOT * (rate[1:] + rate[:-1]) / 2
    angle = np.concatenate([[rng.uniform(0, 2 * np.pi)], steps]).cumsum()
    keep = np.exp(-KNOT / MEMORY)
    kicks = chosen.bias_drift_m_s2 * np.sqrt(1 - keep**2) * rng.standard_normal((knot.size, 3))
    kicks[0] = chosen.bias_drift_m_s2 * rng.standard_normal(3)
    return Roll(start, stop, path, knot, rate, angle, lfilter([1.0], [1.0, -keep], kicks, axis=0))


def span(chosen, roll: Roll, bounds, truth: Truth, rng, hidden: Hidden) -> dict:
    """Voltages, attitude and orbit of one span of the roll between whole seconds; result as of `swing`."""
    start, stop = bounds
    coarse = np.arange(start - 2, stop + 3)  # the motion changes over minutes: 1 s, then straight lines
    state = roll.path(coarse)
    place = np.clip(np.searchsorted(roll.knot, coarse, side="right") - 1, 0, roll.knot.size - 2)
    slope = (roll.rate[place + 1] - roll.rate[place]) / KNOT
    u = coarse - roll.knot[place]
    angle = roll.angle[place] + roll.rate[place] * u + slope * u**2 / 2
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    R_bo = np.stack([c, zero, -s, zero, one, zero, s, zero, c], axis=-1).reshape(-1, 3, 3)
    quaternion = frames.continuous(frames.quaternion_from_R_bi(R_bo @ frames.flight_frame(state)))
    momentum = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1)
    rate, rate_dot = np.zeros((coarse.size, 3)), np.zeros((coarse.size, 3))
    rate[:, 1] = np.interp(coarse, roll.knot, roll.rate) - momentum / np.sum(state[:, :3] ** 2, axis=1)
    rate_dot[:, 1] = slope
    tag = start + STEP_SENSOR * np.arange(round((stop - start) / STEP_SENSOR))
    held = electrostatic(coarse, quaternion, rate, rate_dot, state, truth, chosen)
    held = with_effects(tag, *(lines_between(tag, coarse, values) for values in held), truth, hidden)
    drift = lines_between(tag, roll.knot, roll.drift)
    return {
        "IS1": {"time": tag, "volts": read_volts(*held, truth, chosen, rng, drift)},
        "ATT": _tracked(bounds, (coarse, quaternion), truth, chosen, rng, hidden),
        "ORB": _orbit_record(start, stop - start, roll.path),
    }
