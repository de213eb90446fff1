"""A simulated swing of the inertial sensor: voltages, star-tracker attitude and orbit, and their truth."""

from __future__ import annotations

import numpy as np

from gravcal.effects import inertial_sensor as electrodes
from gravcal.physics import frames
from gravcal.simulation import inertial_sensor_effects as effects
from gravcal.simulation import inertial_sensor_motion as motion
from gravcal.simulation import inertial_sensor_truth as truths

STEP_SENSOR, STEP_TRACKER, STEP_ORBIT = 0.1, 0.25, 1.0  # s, formats.md section 6
FINE = 0.05  # s, every epoch of sensor and tracker is a multiple


def swing_rate_dot(time: np.ndarray, start: float, chosen) -> np.ndarray:
    """Angular acceleration of a swing: square wave with rounded edges, whole periods, rate zero at both ends.

    Parameters
    ----------
    time : (n,) s
    start : s
    chosen : parameters of the simulation

    Returns
    -------
    rate_dot_b : (n, 3) rad s-2
    """
    out = np.zeros((time.size, 3))
    rise = max(chosen.swing_rise_s, 1e-3)
    for axis, (period, rate) in enumerate(zip(chosen.swing_period_s, chosen.swing_rate_rad_s, strict=True)):
        length = np.floor(chosen.swing_s / period) * period
        u = time - start
        wave = np.tanh(np.cos(2 * np.pi * u / period) * period / (2 * np.pi) / rise)
        gate = (np.tanh(u / rise) - np.tanh((u - length) / rise)) / 2
        out[:, axis] = 4 * rate / period * wave * gate
    return out


def swing(chosen, start: float, truth: truths.Truth, rng, hide=effects.Hidden()) -> dict:  # noqa: B008 - frozen
    """Voltages, attitude and orbit round one swing.

    Parameters
    ----------
    chosen : parameters of the simulation
    start : GPS s, begin of the record, whole
    truth : Truth
    rng : source of randomness
    hide : effects.Hidden

    Returns
    -------
    record : {"IS1": {"time", "volts"}, "ATT": {"time", "quaternion"}, "ORB": {"time", "position", "velocity"}}
    """
    length = 2 * chosen.quiet_s + chosen.swing_s
    path = truths.draw_orbit(chosen, start, start + length, rng)
    fine = start - 10 + FINE * np.arange(round((length + 20) / FINE) + 1)
    quaternion, rate, rate_dot = _motion(fine, start + chosen.quiet_s, path, chosen, rng)
    tag = start + STEP_SENSOR * np.arange(round(length / STEP_SENSOR))
    pick = np.rint((tag - fine[0]) / FINE).astype(int)
    state = path(tag)
    linear, angular = truths.electrostatic(tag, quaternion[pick], rate[pick], rate_dot[pick], state, truth, chosen)
    felt = effects.read(tag, linear, angular, truth, hide)
    return {
        "IS1": {"time": tag, "volts": read_volts(*felt, truth, chosen, rng)},
        "ATT": _tracker((start, length), (fine, quaternion), (truth.delay, hide), chosen, rng),
        "ORB": orbit_record(start, length, path),
    }


def _motion(fine, swing_start, path, chosen, rng):
    """Attitude, rate and its derivative on the fine grid; between manoeuvres the control lets it sway slowly."""
    rate_dot = swing_rate_dot(fine, swing_start, chosen) if chosen.manoeuvre != "none" else np.zeros((fine.size, 3))
    sway = rng.uniform(300.0, 900.0, 3)
    phase = rng.uniform(0, 2 * np.pi, 3)
    rate_dot = rate_dot + 2e-8 * np.sin(2 * np.pi * fine[:, None] / sway + phase)
    rate = motion.from_derivative(FINE, rate_dot)
    rate = rate - rate.mean(axis=0) * 0.1 + np.array([0.0, -truths.orbital_rate(chosen), 0.0])
    first = frames.quaternion_from_R_bi(truths.R_oi(path(fine[:1])))[0]
    pointing = frames.from_rotation_vector(5e-4 * rng.standard_normal(3))
    start = frames.quaternion_product(first, pointing)
    return motion.attitude(FINE, rate, start), rate, rate_dot


def read_volts(linear_b, angular_b, truth: truths.Truth, chosen, rng, drift_b=0.0) -> np.ndarray:
    """Recorded voltages of the six electrodes.

    Parameters
    ----------
    linear_b : (n, 3) m s-2; angular_b : (n, 3) rad s-2, that hold the test mass
    truth : Truth; chosen : parameters of the simulation; rng : source of randomness
    drift_b : (n, 3) m s-2, wander of the bias

    Returns
    -------
    volts : (n, 6) V, in the order of electrodes.VOLTAGES

    Notes
    -----
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


def _tracker(span, path, timing, chosen, rng):
    """Measured attitude at 4 Hz; a tag late by the delay shows the attitude of before."""
    (start, length), (fine, quaternion), (delay, hide) = span, path, timing
    tag = start + STEP_TRACKER * np.arange(round(length / STEP_TRACKER))
    true = frames.interpolate(fine, quaternion, np.clip(tag - delay - effects.late(tag, hide), fine[0], fine[-1]))
    return {"time": tag, "quaternion": measured(effects.tracked(tag, true, hide), chosen.tracker_noise_rad, rng)}


def measured(quaternion: np.ndarray, sigma: float, rng) -> np.ndarray:
    """Attitude with white noise about each axis.

    Parameters
    ----------
    quaternion : (n, 4); sigma : rad; rng : source of randomness
    """
    noise = frames.from_rotation_vector(sigma * rng.standard_normal((quaternion.shape[0], 3)))
    return frames.continuous(frames.quaternion_product(quaternion, noise))


def orbit_record(start: float, length: float, path) -> dict:
    """Orbit at whole seconds from one minute before to one minute after, as far as the day file would."""
    time = np.arange(start, start + length + 1, STEP_ORBIT)
    state = path(time)
    return {"time": time, "position": state[:, :3], "velocity": state[:, 3:]}
