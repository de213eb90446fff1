"""A simulated day of a magnetometer: reference field, torquers, and an instrument of true parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gravcal.effects import Context, effect
from gravcal.physics import earth, frames, magnetic, orbit_environment
from gravcal.simulation import orbit, sensors
from gravcal.simulation.injection import within

#: Effects that the instrument has, each parameter drawn about nought with its plausible size times a scatter.
EFFECTS = (
    "magnetometer.bias",
    "magnetometer.scale",
    "magnetometer.misalignment",
    "magnetometer.current_leak",
    "magnetometer.external_field",
    "timing.magnetometer_delay",
)
NAMES = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")


def simulate(satellite: Mapping, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns of a simulated day and its truth.

    Parameters
    ----------
    satellite : numbers of the catalogue
    chosen : parameters of the simulation
    day : GPS s of midnight
    seed : int
    effects : {slug: {parameter: value}}, added to what is drawn

    Returns
    -------
    columns : {product: {column: array}}
    truth : plain dict, SI, parameters as the result document names them
    """
    rng = np.random.default_rng(seed)
    given = within(effects, EFFECTS)
    drawn = {}
    for slug in EFFECTS:
        parameters = effect(slug).parameters
        scatter = chosen.scatter * np.array([p.prior_sigma for p in parameters]) * rng.standard_normal(len(parameters))
        drawn[slug] = scatter + effect(slug).values(given.get(slug, {}))
    lack = chosen.scatter * effect("magnetometer.misalignment").parameters[0].prior_sigma * rng.standard_normal(3)
    angles = rng.uniform(0, 2 * np.pi, 2)
    start = orbit.initial_state(1e3 * chosen.altitude_km, np.radians(chosen.inclination_deg), 1e-3, *angles)
    path = orbit.fly_orbit(start, day - 60, day + chosen.duration_s + 60)
    second = np.arange(day, day + chosen.duration_s)
    state = path(second)
    attitude, _ = orbit.nominal_attitude(state, satellite["x_along_velocity"])
    wobble = chosen.pointing_error_rad * np.sin(
        2 * np.pi * second[:, None] / rng.uniform(300, 1500, 3) + rng.uniform(0, 2 * np.pi, 3)
    )
    attitude = frames.quaternion_product(attitude, frames.from_rotation_vector(wobble))
    columns = {"SCA1B": {"gps_time": second.astype(np.int64)} | dict(zip(NAMES, attitude.T, strict=True))}
    fixed = np.concatenate(earth.state_to_fixed(second, state[:, :3], state[:, 3:]), axis=1)
    columns["GNV1B"] = {"gps_time": second.astype(np.int64)} | dict(zip(STATE, fixed.T, strict=True))
    tag = np.arange(day + 5.0, day + chosen.duration_s - 5.0, chosen.step_s)
    read = _reading(tag, second, attitude, fixed[:, :3], satellite, chosen, drawn, lack, rng)
    columns["MAG1B"] = read
    parameters = {f"bias_{a}": v for a, v in zip("xyz", drawn["magnetometer.bias"], strict=True)}
    parameters |= {f"scale_{a}": v for a, v in zip("xyz", drawn["magnetometer.scale"], strict=True)}
    parameters |= {f"misalignment_{a}": v for a, v in zip("xyz", drawn["magnetometer.misalignment"], strict=True)}
    parameters |= {f"nonorthogonality_{a}": v for a, v in zip(("xy", "xz", "yz"), lack, strict=True)}
    leaks = [p.name for p in effect("magnetometer.current_leak").parameters]
    parameters |= {f"leak_{a}": v for a, v in zip(leaks, drawn["magnetometer.current_leak"], strict=True)}
    parameters |= {"external_field": drawn["magnetometer.external_field"][0]}
    parameters |= {"delay": drawn["timing.magnetometer_delay"][0]}
    truth = {"seed": seed, "day": day, "parameters": {name: float(value) for name, value in parameters.items()}}
    return columns, truth | {"effects": {slug: dict(values) for slug, values in effects.items()}}


def _reading(tag, second, attitude, position_e, satellite, chosen, drawn, lack, rng):
    """Columns of MAG1B."""
    from scipy.interpolate import CubicSpline

    time = tag - drawn["timing.magnetometer_delay"][0]
    R_bi = frames.R_bi_from_quaternion(frames.interpolate(second, attitude, time))
    field_e = magnetic.field_e(second, position_e, chosen.igrf_generation)
    field_i = CubicSpline(second, np.matvec(np.swapaxes(earth.R_ei(second), 1, 2), field_e))(time)
    field = np.matvec(R_bi, field_i)
    axis = np.matvec(R_bi, orbit_environment.dipole_axis_i(time))
    current = _currents(time, chosen, rng)
    quantum = satellite["torquer_current_step"]
    current = sensors.quantised(current, quantum)
    dipole = current * np.array(satellite["dipole_per_current"])
    context = Context(time=time, field_b=field, dipole_b=dipole, extra={"axis_b": axis})
    read = field + sum(effect(slug).contribution(context, drawn[slug]) for slug in EFFECTS[:-1])  # the delay is in time
    xy, xz, yz = lack
    read = read + field @ np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    read = read + _noise(time.size, chosen, rng)
    whole = np.floor(tag)
    columns = {"time_intg": whole.astype(np.int64), "time_frac": np.round(1e6 * (tag - whole)).astype(np.int64)}
    measured = 1e6 * sensors.quantised(read, satellite["magnetometer_step"])
    columns |= {f"Mfv{name}_RAW": measured[:, i] for i, name in enumerate("XYZ")}
    return columns | sensors.coil_currents(current)


def _currents(time, chosen, rng):
    """Currents (n, 3) mA that step at random times, as a control of attitude asks for them."""
    spacing = rng.exponential(chosen.current_spacing_s, (int(2 * np.ptp(time) / chosen.current_spacing_s) + 10, 3))
    found = np.empty((time.size, 3))
    for axis in range(3):
        level = chosen.current_ma * rng.standard_normal(len(spacing) + 1)
        found[:, axis] = level[np.searchsorted(time[0] + np.cumsum(spacing[:, axis]), time)]
    return found


def _noise(count, chosen, rng):
    """White noise and slow errors (n, 3) T of the reference field, a first-order Markov process."""
    from scipy.signal import lfilter

    keep = np.exp(-chosen.step_s / chosen.field_error_s)
    drive = 1e-9 * chosen.field_error_nt * np.sqrt(1 - keep**2) * rng.standard_normal((count + 2000, 3))
    slow = lfilter([1.0], [1.0, -keep], drive, axis=0)[2000:]
    return slow + 1e-9 * chosen.noise_nt * rng.standard_normal((count, 3))
