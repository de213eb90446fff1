"""A simulated day of S-GRS: two test masses, drag, a controlled attitude, and their truth.

The gravity the satellite feels is the modelled field plus errors drawn from its standard deviations. Attitude follows
from torques: drag at the centre of pressure, slow disturbances and a controller; the satellite points to nadir.
"""

from collections.abc import Mapping

import numpy as np
from scipy.signal import cont2discrete, lfilter

from gravcal.effects import Context
from gravcal.effects.gradient import EFFECTS, tesseral
from gravcal.physics import dynamics, earth, frames, gravity, kinematics, magnetic, sensing
from gravcal.physics.constants import EARTH_RADIUS
from gravcal.simulation import added, flight, within

AHEAD = 4000  # s, filters run in before the record starts
KNOWN = (*(e.slug for e in EFFECTS), "torque.aerodynamic", "torque.residual_dipole")
KNOWN += ("attitude.star_camera_misalignment",)
BEYOND = np.linalg.solve(np.vander(np.arange(6.0)).T, np.vander(np.arange(6.0, 9.0), 6).T).T  # (3, 6) extrapolation
PASSES = 5  # torque and motion in turn; gravity gradient and coupling are a tenth of the control: 1e-5 of the torque


def simulate(satellite: Mapping, chosen, field, day: float, seed: int, effects=None, nongravitational=None):
    """Columns of an SGRS file and their truth, whose series are arrays; arguments as of `gravcal.simulation`.

    The analysis knows the Field; nongravitational (n,) s -> (n, 3) m s-2 in b may take the place of the invented drag.
    """
    rng = np.random.default_rng(seed)
    time = day + chosen.step_s * np.arange(int(chosen.duration_s / chosen.step_s))
    drag = nongravitational(time) if nongravitational else _invented_drag(time, chosen, rng)
    body = _body(satellite, chosen, rng)
    effects = within(effects or {}, KNOWN)
    motion, state_i, quaternion = _motion(time, chosen, body, effects, _true_field(field, chosen, rng), drag, rng)
    linear, angular = _readings(motion, state_i, quaternion, body, drag, effects)
    band = chosen.sensor_noise * np.sqrt(1 / (2 * chosen.step_s))  # of white noise of the catalogue's densities
    spread = [np.array(satellite[f"{name}_noise_density"]) * band for name in ("linear", "angular")]
    noise = [size * rng.standard_normal(linear.shape) for size in spread]
    angle = np.array(satellite["attitude_noise"]) * chosen.tracker_noise * rng.standard_normal((time.size, 3))
    tracker = frames.from_rotation_vector(angle + added(effects, "pointing_b", Context(time)))
    columns = {
        "time": time,
        "linear": linear + noise[0],
        "angular": angular + noise[1],
        "q": frames.continuous(frames.quaternion_product(quaternion, tracker)),
        "position": state_i[:, :3],
        "velocity": state_i[:, 3:],
        "sensor_position": body["stated_position"],
    }
    truth = {
        "seed": seed,
        "day": float(motion.time[0]),
        "height_m": float(np.mean(np.linalg.norm(state_i[:, :3], axis=1)) - EARTH_RADIUS),
        "sensor_position_m": body["position"].tolist(),
        "centre_of_pressure_m": body["pressure"].tolist(),
        "elongation": chosen.elongation,
        "time": motion.time,
        "drag": drag,
        "rate": motion.rate_b,
        "rate_dot": motion.rate_dot_b,
        "gradient": motion.gradient_b,
        "clean": columns | {"linear": linear, "angular": angular, "q": quaternion},
    }
    return columns, truth


def _invented_drag(time, chosen, rng):
    """Non-gravitational acceleration (n, 3) m s-2 in b: against the flight, once and twice per revolution, wind."""
    u = 2 * np.pi * (time - time[0]) / 5660.0  # argument of latitude: 5660 s a revolution
    phase = rng.uniform(0, 2 * np.pi, (2, 3))
    size = chosen.drag_m_s2
    mean, once, twice = size * np.array([[-1.0, 0.02, -0.05], [0.4, 0.15, 0.1], [0.15, 0.05, 0.05]])
    slow = mean + once * np.cos(u[:, None] + phase[0]) + twice * np.cos(2 * u[:, None] + phase[1])
    wind = np.stack([coloured(time, chosen.drag_corner_hz, rng) for _ in range(3)], axis=1)
    return slow + chosen.drag_scatter * size * wind * np.array([1.0, 0.5, 0.3])


def coloured(time, corner, rng):
    """Noise (n,) of unit variance through four equal poles at a corner frequency Hz, at even times (n,) s."""
    step = time[1] - time[0]
    ahead = int(AHEAD / step)
    pole = np.exp(-2 * np.pi * corner * step)
    values = rng.standard_normal(ahead + time.size)
    for _ in range(4):
        values = lfilter([1 - pole], [1, -pole], values)
    lag = np.arange(4 * int(1 / (corner * step)))  # variance of four equal poles from its impulse response
    response = (1 - pole) ** 4 * (lag + 1) * (lag + 2) * (lag + 3) / 6 * pole**lag
    return values[ahead:] / np.sqrt(np.sum(response**2))


def _body(satellite, chosen, rng):
    """Numbers of the satellite and its sensors by name, SI: true ones, and the positions that the file states."""
    position = np.array(satellite["sensor_position"]) + 1e-3 * np.array(chosen.mounting_mm).reshape(2, 3)
    if chosen.sensors == 1:
        position = position[:1]
    error = chosen.position_scatter * np.array(satellite["sensor_position_sigma"])[: len(position)]
    pressure = np.array(satellite["centre_of_pressure"])
    scatter = chosen.pressure_scatter * np.array(satellite["centre_of_pressure_sigma"])
    mass = satellite["test_mass"]
    cube = np.sqrt(6 * np.trace(np.array(satellite["test_mass_inertia"])) / 3 / mass)
    lengths = cube * chosen.elongation ** np.array([2 / 3, -1 / 3, -1 / 3])
    return {
        "inertia": np.array(satellite["inertia"]),
        "mass": satellite["mass"],
        "stated_position": position,
        "position": position + error * rng.standard_normal(position.shape),
        "pressure": pressure + scatter * rng.standard_normal(3),
        "test_mass_inertia": mass / 12 * np.diag(np.sum(lengths**2) - lengths**2),
    }


def _true_field(field, chosen, rng):
    """True gravity Field: the model and an error drawn from its standard deviations."""
    known = gravity.truncated(field, 0, chosen.field_degree)
    if known.cosine_sigma is None or chosen.field_error_scale == 0:
        return known
    parts = [
        value + chosen.field_error_scale * sigma * rng.standard_normal(value.shape)
        for value, sigma in ((known.cosine, known.cosine_sigma), (known.sine, known.sine_sigma))
    ]
    return gravity.Field(known.gm, known.radius, *parts)


def _motion(time, chosen, body, effects, field, drag, rng):
    """Rates and gravity gradient at the epochs as a Context, orbit (n, 6) m, m s-1 in i, attitude (n, 4)."""
    beyond = chosen.step_s * np.arange(1, 4)
    padded = np.concatenate([time[0] - beyond[::-1], time, time[-1] + beyond])
    state = flight.drawn(chosen, chosen.eccentricity, padded[0], padded[-1], rng)(padded)
    nominal, _ = flight.nominal_attitude(state, 1.0)
    inner = slice(3, -3)
    R_ei = earth.R_ei(time)
    gradient_e = gravity.gradient_e(field, np.matvec(R_ei, state[inner, :3]))
    gradient_i = gravity.rotate_tensor(np.swapaxes(R_ei, -1, -2), gradient_e)
    disturbance = np.stack([coloured(time, chosen.torque_corner_hz, rng) for _ in range(3)], axis=1)
    context = Context(time, inertia_b=body["inertia"], extra={"mass": body["mass"], "non_gravitational_b": drag})
    external = chosen.torque_n_m * disturbance + body["mass"] * np.cross(body["pressure"], drag)
    external = external + added(effects, "torque_b", context)
    if "torque.residual_dipole" in effects:
        field_i = np.matvec(np.swapaxes(R_ei, -1, -2), magnetic.field_e(time, np.matvec(R_ei, state[inner, :3]), 14))
        field_b = np.matvec(frames.R_bi_from_quaternion(nominal[inner]), field_i)
        external = external + np.cross(added(effects, "dipole_b", context), field_b)
    J, W = body["inertia"], 2 * np.pi * chosen.control_hz
    plant = ([1.0], [1.0, 2 * chosen.control_damping * W, W**2])  # pointing error under a torque and the controller
    top, bottom, _ = cont2discrete(plant, chosen.step_s, method="foh")
    angle, coupling = np.zeros_like(drag), np.zeros_like(drag)
    for _ in range(PASSES):
        padded_angle = np.concatenate([(BEYOND @ angle[5::-1])[::-1], angle, BEYOND @ angle[-6:]])
        quaternion = frames.continuous(frames.quaternion_product(nominal, frames.from_rotation_vector(padded_angle)))
        rates = kinematics.rates_from_attitude(padded - time[0], quaternion, half_width=3, degree=6)
        rate, rate_dot = (part[inner] for part in rates)
        gradient_b = gravity.rotate_tensor(frames.R_bi_from_quaternion(quaternion[inner]), gradient_i)
        angle_rate = np.gradient(angle, chosen.step_s, axis=0, edge_order=2)
        control = -np.matvec(J, W**2 * angle + 2 * chosen.control_damping * W * angle_rate)
        required = np.matvec(J, rate_dot) + np.cross(rate, np.matvec(J, rate))
        required = required - dynamics.gravity_gradient_torque(J, gradient_b)
        coupling = coupling + (required - (external + control))  # torque of the motion beyond what is applied
        acceleration = np.matvec(np.linalg.inv(J), external - coupling)
        led_in = np.concatenate([np.repeat(acceleration[:1], int(AHEAD / chosen.step_s), axis=0), acceleration])
        angle = lfilter(np.squeeze(top), bottom, led_in, axis=0)[-len(acceleration) :]
    motion = Context(
        time, rate_b=rate, rate_dot_b=rate_dot, gradient_b=gradient_b, extra={"positions": body["position"]}
    )
    return motion, state[inner], quaternion[inner]


def _readings(motion, state_i, quaternion, body, drag, effects):
    """Linear and angular acceleration (n, s, 3) m s-2, rad s-2 read by each of s test masses, without noise."""
    tensor = sensing.offset_tensor(motion.rate_b, motion.rate_dot_b, motion.gradient_b)
    linear = np.stack([-drag - np.matvec(tensor, p) for p in body["position"]], axis=1)
    J = body["test_mass_inertia"]
    free = dynamics.rate_derivative(J, motion.rate_b, dynamics.gravity_gradient_torque(J, motion.gradient_b))
    angular = np.repeat((free - motion.rate_dot_b)[:, None, :], len(body["position"]), axis=1)
    if "gradient.tesseral" in effects:
        R_ei = earth.R_ei(motion.time)
        R_be = frames.R_bi_from_quaternion(quaternion) @ np.swapaxes(R_ei, -1, -2)
        motion.extra["tesseral_b"] = tesseral(np.matvec(R_ei, state_i[:, :3]), R_be)
    linear = linear - added(effects, "linear_each_b", motion)
    return linear, angular - added(effects, "angular_each_b", motion)
