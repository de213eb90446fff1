"""A simulated day of attitude thrusters: firings of true gain and delay, a slow control, star cameras."""

from collections.abc import Mapping

import numpy as np

from gravcal.effects import Context, effect
from gravcal.physics import frames
from gravcal.simulation import added, flight, sensors, within

#: Effects that can be hidden in such a day.
EFFECTS = (
    "torque.thruster_firings",
    "timing.thruster_delay",
    "torque.constant",
    "torque.residual_dipole",
    "attitude.star_camera_misalignment",
)
LEAD_S = 5.0  # flown before and after what is written


def simulate(satellite: Mapping, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns of a simulated day and its truth; arguments as of `gravcal.simulation`."""
    rng = np.random.default_rng(seed)
    within(effects, EFFECTS)
    values = {slug: effect(slug).values(effects.get(slug, {})) for slug in EFFECTS[:2]}
    gain = 1 + chosen.gain_scatter * rng.standard_normal(3) + values["torque.thruster_firings"]
    delay = chosen.delay_scatter_s * rng.standard_normal() + values["timing.thruster_delay"][0]
    path = flight.drawn(chosen, 1e-3, day, day + chosen.duration_s, rng)
    # firings: start (k,) s, thrusters in use (k, 12), time on (k,) ms; each undoes the last about its axis
    spacing = rng.exponential(chosen.firing_spacing_s, int(2 * chosen.duration_s / chosen.firing_spacing_s) + 10) + 2.0
    start = day + np.cumsum(spacing)
    quiet = (start - day) % chosen.quiet_every_s < chosen.quiet_s
    start = np.round(start[(start < day + chosen.duration_s - 2.0) & ~quiet], 6)
    axis, on_ms = rng.integers(0, 3, start.size), rng.integers(*chosen.on_time_ms, start.size)
    torque = np.cross(np.array(satellite["thruster_position"])[:12], np.array(satellite["thruster_force"])[:12])  # N m
    thrusters = np.zeros((start.size, 12), dtype=bool)
    main_axis, sense = np.argmax(np.abs(torque), axis=1), np.sign(torque)
    for one in range(3):
        of_axis = np.flatnonzero(axis == one)
        for k, row in enumerate(of_axis):
            thrusters[row] = (main_axis == one) & (sense[:, one] == (1, -1)[k % 2])
        on_ms[of_axis[1::2]] = on_ms[of_axis[: 2 * (of_axis.size // 2) : 2]]
    time, quaternion = _flown(satellite, chosen, path, (start, thrusters @ torque, on_ms), gain, effects, day)
    angle = added(effects, "pointing_b", Context(time=time))
    heads = 1 + ((time - day) // chosen.head_s).astype(int) % 2
    step = chosen.head_step_rad * rng.standard_normal(3)
    angle = angle + (heads == 2)[:, None] * step + chosen.star_camera_noise_rad * rng.standard_normal((time.size, 3))
    measured = sensors.star_camera(quaternion, angle, rng)
    columns = {
        "SCA1B": sensors.attitude_columns(time, measured) | {"sca_id": heads},
        "GNV1B": sensors.orbit_columns(time, path(time), "GNV1B"),
        "THR1B": sensors.split_time(start + delay)
        | {f"on_time_att_ctrl_{1 + k // 6}_{1 + k % 6}": np.where(thrusters[:, k], on_ms, 0) for k in range(12)},
    }
    truth = {"seed": seed, "day": day, "gain": gain.tolist(), "delay_s": float(delay)}
    return columns, truth | {"camera_step_rad": step.tolist(), "effects": {s: dict(v) for s, v in effects.items()}}


def _flown(satellite, chosen, path, firings, gain, effects, day):
    """Epochs (n,) s of the star camera and true attitude (n, 4) there."""
    start, torque_b, on_ms = firings
    nodes = np.arange(day - LEAD_S, day + chosen.duration_s + LEAD_S + 0.5)
    around = flight.environment(nodes, path, 1.0, chosen.igrf_generation)
    bound = np.unique(np.concatenate([nodes[:-1], start, start + 1e-3 * on_ms]))
    middle = (bound[:-1] + bound[1:]) / 2
    firing = np.searchsorted(start, middle) - 1
    burning = (firing >= 0) & (middle < start[firing] + 1e-3 * on_ms[firing])
    context = Context(time=middle, dipole_b=np.zeros((middle.size, 3)))
    torque = burning[:, None] * gain * torque_b[firing] + added(effects, "torque_b", context)
    dipole = np.zeros((middle.size, 3)) + added(effects, "dipole_b", context)
    whole = np.isin(bound[:-1], nodes)
    steps = flight.Steps(bound, whole, np.zeros(middle.size, dtype=bool), np.zeros((middle.size, 3)))
    body = flight.Body(np.array(satellite["inertia"]), chosen.control_frequency_rad_s, 0.7, 0.0, 1.0)  # no rods
    ends = tuple(np.repeat(one[:, None], 2, axis=1) for one in (dipole, torque))
    states, _ = flight.fly(steps, around, body, np.concatenate([around.target[0], around.target_rate_b[0]]), ends)
    time = day + chosen.star_camera_step_s * np.arange(int(chosen.duration_s / chosen.star_camera_step_s))
    return time, frames.continuous(states[np.searchsorted(bound, time), :4])
