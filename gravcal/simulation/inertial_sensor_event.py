"""Simulated days of an inertial sensor: swing, roll or both, record by record, and their truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gravcal.effects.inertial_sensor import linear_over_angular
from gravcal.physics.constants import DAY
from gravcal.simulation import inertial_sensor as swings
from gravcal.simulation import inertial_sensor_effects as effects
from gravcal.simulation import inertial_sensor_roll as rolls
from gravcal.simulation import inertial_sensor_truth as truths


def simulate(
    satellite: Mapping, chosen, day: float, seed: int, hide: Mapping | None = None
) -> tuple[Iterator[dict], dict]:
    """Records of an event, one day or less at a time, and the truth.

    Parameters
    ----------
    satellite : numbers of the catalogue, with `_sigma` beside them
    chosen : parameters of the simulation
    day : GPS s of midnight
    seed : int
    hide : {slug: {parameter: value}}, effects of inertial_sensor_effects.KNOWN

    Returns
    -------
    records : iterator of {"IS1", "ATT", "ORB"}, none across midnight
    truth : plain dict, SI and um where named so
    """
    hidden = effects.hidden(hide, day)
    first, second = np.random.SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(first)
    truth = truths.draw(satellite, chosen, rng)
    swing_start = day + chosen.swing_at_s
    swinging = chosen.manoeuvre in ("swing", "both")
    rolling = chosen.manoeuvre in ("roll", "both")
    roll = rolls.draw_roll(chosen, day + (DAY if swinging else 0.0), rng) if rolling else None

    def records():
        if swinging or not rolling:
            yield swings.swing(chosen, swing_start, truth, rng, hidden)
        if rolling:
            yield from _rolled(chosen, roll, truth, np.random.default_rng(second), hidden)

    plain = _plain(truth, satellite, chosen, seed, swing_start if swinging else None, roll)
    return records(), plain | {"effects": dict(hidden.effects)}


def _rolled(chosen, roll, truth, rng, hidden):
    """Spans of a roll, cut at midnight."""
    start = roll.start
    while start < roll.stop:
        stop = min(roll.stop, (np.floor((start + DAY / 2) / DAY) + 1) * DAY - DAY / 2)
        yield rolls.span(chosen, roll, (start, stop), truth, rng, hidden)
        start = stop


def _plain(truth, satellite, chosen, seed, swing_start, roll):
    """Truth as JSON has it."""
    drift = np.zeros(3) if roll is None else roll.drift[1:-1].mean(axis=0)
    arm = [chosen.arm_x_mm * 1e-3, *satellite["electrode_arm"][1:]]
    ratio = linear_over_angular(satellite["test_mass"], satellite["test_mass_inertia"], arm)
    return {
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
        "swing": None if swing_start is None else [swing_start + chosen.quiet_s, chosen.swing_s],
        "roll": None if roll is None else [roll.start, roll.stop],
    }
