"""Columns of every effect that a roll can show, and of what its readings may follow."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.inertial_sensor import discovery_roll as rolls
from gravcal.calibrations.inertial_sensor.discovery_candidates import OTHERS, block_by_block, named, unknown, waves_of
from gravcal.calibrations.inertial_sensor.discovery_roll import Roll
from gravcal.effects import effect
from gravcal.effects.entries import each_alone
from gravcal.effects.inertial_sensor import EFFECTS


def candidates(seen: Roll) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Candidate`: effects on the linear readings, then regressors.

    Parameters
    ----------
    seen : Roll
    """
    about, found = rolls.context(seen), []
    for entry in (one for one in (*EFFECTS, *map(effect, OTHERS)) if one.channel == "linear_b"):
        added = entry.columns(about).reshape(*seen.time.shape, 3, -1)
        found += each_alone(named(entry) | {"columns": rolls.rows(seen, added)})
    for driver, form, shape in rolls.series(seen):
        columns = rolls.rows(seen, shape[:, :, None, None] * np.eye(3))
        found.append(unknown(driver, f"{rolls.CHANNEL} reading, {form}", "linear", "m s-2", columns))
    return found


def waves(seen: Roll, axis: int):
    """Function (segment, Hz) -> whitened cosine and sine (3 b + 3, 2) on one axis of the linear readings.

    Parameters
    ----------
    seen : Roll
    axis : 0, 1 or 2
    """
    width = float(seen.time[0, 1] - seen.time[0, 0])

    def columns(frequency):
        both = waves_of(seen.time.ravel() - seen.time[0, 0], width, frequency).reshape(*seen.time.shape, 2)
        return rolls.rows(seen, both[:, :, None, :] * np.eye(3)[axis][:, None])

    return block_by_block(columns)
