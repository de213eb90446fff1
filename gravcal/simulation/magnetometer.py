"""A simulated day of a magnetometer: reference field, torquers, and an instrument of true parameters."""

from collections.abc import Mapping

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from gravcal.effects import Context, effect
from gravcal.effects.sensors import OF_MAGNETOMETER, OF_WARMTH
from gravcal.physics import earth, frames, magnetic, orbit_environment
from gravcal.simulation import flight, sensors, within

#: Each parameter is drawn about nought with its plausible size times a scatter, but for those of the warmth.
SKEW, DELAY = "magnetometer.nonorthogonality", "timing.magnetometer_delay"
EFFECTS = (*(slug for slug in OF_MAGNETOMETER if slug != SKEW), SKEW)


def simulate(satellite: Mapping, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns of a simulated day and its truth; arguments as of `gravcal.simulation`."""
    rng = np.random.default_rng(seed)
    hidden = within(effects, EFFECTS)
    drawn = {}
    for slug in EFFECTS:
        parameters = effect(slug).parameters
        drawn[slug] = effect(slug).values(hidden.get(slug, {}))
        if slug not in OF_WARMTH:
            size = chosen.scatter * np.array([p.prior_sigma for p in parameters])
            drawn[slug] = size * rng.standard_normal(len(parameters)) + drawn[slug]
    second = np.arange(day, day + chosen.duration_s)
    state = flight.drawn(chosen, 1e-3, day, day + chosen.duration_s, rng)(second)
    attitude, _ = flight.nominal_attitude(state, satellite["x_along_velocity"])
    pointing = chosen.pointing_error_rad * np.sin(
        2 * np.pi * second[:, None] / rng.uniform(300, 1500, 3) + rng.uniform(0, 2 * np.pi, 3)
    )
    attitude = frames.quaternion_product(attitude, frames.from_rotation_vector(pointing))
    orbit = sensors.orbit_columns(second, state, "GNV1B")
    position_e = np.stack([orbit[name] for name in sensors.STATE[:3]], axis=1)
    tag = np.arange(day + 5.0, day + chosen.duration_s - 5.0, chosen.step_s)
    time = tag - drawn[DELAY][0]
    R_bi = frames.R_bi_from_quaternion(frames.interpolate(second, attitude, time))
    field_e = magnetic.field_e(second, position_e, chosen.igrf_generation)
    field_i = CubicSpline(second, np.matvec(np.swapaxes(earth.R_ei(second), 1, 2), field_e))(time)
    field = np.matvec(R_bi, field_i)
    spacing = rng.exponential(chosen.current_spacing_s, (int(2 * np.ptp(time) / chosen.current_spacing_s) + 10, 3))
    current = np.empty((time.size, 3))  # mA, steps at random times, as a control of attitude asks for them
    for axis in range(3):
        level = chosen.current_ma * rng.standard_normal(len(spacing) + 1)
        current[:, axis] = level[np.searchsorted(time[0] + np.cumsum(spacing[:, axis]), time)]
    current = sensors.quantised(current, satellite["torquer_current_step"])
    dipole = current * np.array(satellite["dipole_per_current"])
    position_i = np.matvec(np.swapaxes(earth.R_ei(second), 1, 2), position_e)
    extra = {
        "axis_b": np.matvec(R_bi, orbit_environment.dipole_axis_i(time)),
        "warmth": orbit_environment.warmth(time, second, position_i),
    }
    context = Context(time=time, field_b=field, dipole_b=dipole, extra=extra)
    added = (effect(slug).contribution(context, drawn[slug]) for slug in EFFECTS if slug != DELAY)  # that is in time
    read = field + sum(added)
    keep = np.exp(-chosen.step_s / chosen.field_error_s)  # of slow errors of the reference field, a Markov process
    drive = 1e-9 * chosen.field_error_nt * np.sqrt(1 - keep**2) * rng.standard_normal((time.size + 2000, 3))
    noise = lfilter([1.0], [1.0, -keep], drive, axis=0)[2000:]
    noise = noise + 1e-9 * chosen.noise_nt * rng.standard_normal((time.size, 3))
    read = sensors.magnetometer_columns(tag, read + noise, current, satellite)
    columns = {"SCA1B": sensors.attitude_columns(second, attitude), "GNV1B": orbit, "MAG1B": read}
    parameters = {"external_field": drawn["magnetometer.external_field"][0], "delay": drawn[DELAY][0]}
    for name in ("bias", "scale", "misalignment", "nonorthogonality", "current_leak"):
        slug, word = f"magnetometer.{name}", name.removeprefix("current_")
        own = (f"{word}_{p.name.removeprefix('angle_')}" for p in effect(slug).parameters)
        parameters |= dict(zip(own, drawn[slug], strict=True))
    truth = {"seed": seed, "day": day, "parameters": {name: float(value) for name, value in parameters.items()}}
    return columns, truth | {"effects": {slug: dict(values) for slug, values in effects.items()}}
