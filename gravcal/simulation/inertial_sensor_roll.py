"""A simulated roll of the inertial sensor about its y axis, made span by span so that nineteen days fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravcal.physics import frames
from gravcal.simulation import inertial_sensor as instruments
from gravcal.simulation import inertial_sensor_effects as effects
from gravcal.simulation import inertial_sensor_truth as truths

KNOT = 500.0  # s, spacing of the changes of roll rate and bias
MEMORY = 21600.0  # s, correlation time of the wander of the bias


@dataclass(frozen=True)
class Roll:
    """Everything drawn before the satellite rolls.

    Attributes
    ----------
    start, stop : s; path : orbit
    knot : (m,) s; rate : (m,) rad s-1, roll with respect to the orbit frame, linear between; angle : (m,) rad there
    drift : (m, 3) m s-2, wander of the bias, linear between
    """

    start: float
    stop: float
    path: Callable
    knot: np.ndarray
    rate: np.ndarray
    angle: np.ndarray
    drift: np.ndarray


def draw_roll(chosen, start: float, rng) -> Roll:
    """Orbit, roll rate and wander of the bias.

    Parameters
    ----------
    chosen : parameters of the simulation; start : GPS s, whole; rng : source of randomness
    """
    stop = start + chosen.roll_s
    knot = start - KNOT + KNOT * np.arange(int(np.ceil(chosen.roll_s / KNOT)) + 3)
    path = truths.draw_orbit(chosen, knot[0], knot[-1], rng)
    block = rng.random(knot.size // 6 + 1) < chosen.roll_disturbed_share
    size = chosen.roll_rate_scatter * np.where(np.repeat(block, 6)[: knot.size], 5.0, 1.0)
    inertial = 2 * np.pi / chosen.roll_period_s * (1 + size * rng.standard_normal(knot.size))
    rate = inertial + truths.orbital_rate(chosen)
    steps = KNOT * (rate[1:] + rate[:-1]) / 2
    angle = np.concatenate([[rng.uniform(0, 2 * np.pi)], steps]).cumsum()
    return Roll(start, stop, path, knot, rate, angle, _wander(knot.size, chosen.bias_drift_m_s2, rng))


def _wander(count, sigma, rng):
    """First-order Markov process at the knots (count, 3)."""
    from scipy.signal import lfilter

    keep = np.exp(-KNOT / MEMORY)
    kicks = sigma * np.sqrt(1 - keep**2) * rng.standard_normal((count, 3))
    kicks[0] = sigma * rng.standard_normal(3)
    return lfilter([1.0], [1.0, -keep], kicks, axis=0)


def attitude(roll: Roll, time: np.ndarray) -> np.ndarray:
    """True attitude while rolling about y, (n, 4).

    Parameters
    ----------
    roll : Roll; time : (n,) s
    """
    place = np.clip(np.searchsorted(roll.knot, time, side="right") - 1, 0, roll.knot.size - 2)
    u = time - roll.knot[place]
    slope = (roll.rate[place + 1] - roll.rate[place]) / KNOT
    angle = roll.angle[place] + roll.rate[place] * u + slope * u**2 / 2
    c, s, o, e = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    R_bo = np.stack([c, o, -s, o, e, o, s, o, c], axis=-1).reshape(-1, 3, 3)
    return frames.continuous(frames.quaternion_from_R_bi(R_bo @ truths.R_oi(roll.path(time))))


def span(chosen, roll: Roll, bounds, truth: truths.Truth, rng, hide=effects.Hidden()) -> dict:  # noqa: B008 - frozen
    """Voltages, attitude and orbit of one span of the roll; arguments and result as `inertial_sensor.swing`.

    Parameters
    ----------
    chosen : parameters of the simulation
    roll : Roll; bounds : s and s, whole; truth : Truth; rng : source of randomness
    hide : effects.Hidden
    """
    start, stop = bounds
    coarse = np.arange(start - 2, stop + 3)  # the motion changes over minutes: 1 s, then straight lines
    q, state = attitude(roll, coarse), roll.path(coarse)
    rate, rate_dot = _rates(roll, coarse, state)
    linear, angular = truths.electrostatic(coarse, q, rate, rate_dot, state, truth, chosen)
    tag = start + instruments.STEP_SENSOR * np.arange(round((stop - start) / instruments.STEP_SENSOR))
    at = effects.read(tag, *(_lines(tag, coarse, values) for values in (linear, angular)), truth, hide)
    drift = _lines(tag, roll.knot, roll.drift)
    seen = start + instruments.STEP_TRACKER * np.arange(round((stop - start) / instruments.STEP_TRACKER))
    shown = frames.interpolate(coarse, q, np.clip(seen - truth.delay - effects.late(seen, hide), coarse[0], coarse[-1]))
    shown = effects.tracked(seen, shown, hide)
    return {
        "IS1": {"time": tag, "volts": instruments.read_volts(*at, truth, chosen, rng, drift)},
        "ATT": {"time": seen, "quaternion": instruments.measured(shown, chosen.tracker_noise_rad, rng)},
        "ORB": instruments.orbit_record(start, stop - start, roll.path),
    }


def _rates(roll, time, state):
    """Body rate: roll about y and the turning of the orbit frame; its derivative is that of the roll."""
    momentum = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1)
    rate, rate_dot = np.zeros((time.size, 3)), np.zeros((time.size, 3))
    rate[:, 1] = np.interp(time, roll.knot, roll.rate) - momentum / np.sum(state[:, :3] ** 2, axis=1)
    place = np.clip(np.searchsorted(roll.knot, time, side="right") - 1, 0, roll.knot.size - 2)
    rate_dot[:, 1] = (roll.rate[place + 1] - roll.rate[place]) / KNOT
    return rate, rate_dot


def _lines(at, time, values):
    """Straight lines between samples, column by column."""
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)
