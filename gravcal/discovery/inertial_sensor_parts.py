"""Swing and roll of an inertial sensor as one problem: blocks and candidates of both, offset and bias shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.inertial_sensor import discovery_candidates as in_swing
from gravcal.calibrations.inertial_sensor import discovery_roll as rolls
from gravcal.calibrations.inertial_sensor import discovery_roll_candidates as in_roll
from gravcal.calibrations.inertial_sensor.discovery_reading import reading
from gravcal.calibrations.inertial_sensor.discovery_roll import Roll
from gravcal.calibrations.inertial_sensor.discovery_view import CHANNELS, PARAMETERS, View, blocks
from gravcal.discovery import epochs
from gravcal.discovery.blocks import Block, Candidate
from gravcal.estimation.noise import unwhiten

#: Of the reported parameters: 1e-6 rad s-2 V-1, ms, um; and nm s-2.
SWING = np.array([1e6, 1e6, 1e3, 1e6, 1e6, 1e6]), "1e-6 rad s-2 V-1, ms, um"
BIAS = np.full(3, 1e9), "nm s-2"


@dataclass(frozen=True)
class Parts:
    """What was recorded: a swing, a roll, or both.

    Attributes
    ----------
    swing, roll : views, None where there is none
    names : of the reported parameters, the first of the shared ones; scale : (n,) to their units; unit : words
    start : (n,) SI units, what residuals are formed with
    """

    swing: View | None
    roll: Roll | None
    names: tuple[str, ...]
    scale: np.ndarray
    unit: str
    start: np.ndarray

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels in the order of the pages."""
        return (CHANNELS if self.swing else ()) + ((rolls.CHANNEL,) if self.roll else ())

    @property
    def quiet(self) -> dict[str, float]:
        """Quiet samples an axis of each channel; in a roll the noise is measured in the rows themselves."""
        return self.swing.quiet if self.swing else {}


def parts_of(swing: View | None, roll: Roll | None) -> Parts:
    """Parts with their reported parameters.

    Parameters
    ----------
    swing, roll : views; not both None
    """
    if roll is None:
        return Parts(swing, None, PARAMETERS, *SWING, swing.start)
    offset = np.full(3, 1e6)
    if swing is None:
        scale, unit = np.concatenate([BIAS[0], offset]), f"{BIAS[1]}, um"
        return Parts(None, roll, (*rolls.PARAMETERS, *PARAMETERS[3:]), scale, unit, roll.start)
    names, scale = (*PARAMETERS, *rolls.PARAMETERS), np.concatenate([SWING[0], BIAS[0]])
    return Parts(swing, roll, names, scale, f"{SWING[1]}, {BIAS[1]}", np.concatenate([swing.start, roll.start[:3]]))


def made(seen: Parts) -> tuple[list[Block], list[Candidate]]:
    """Blocks and candidates of both.

    Parameters
    ----------
    seen : Parts
    """
    turned = blocks(seen.swing) if seen.swing else []
    rolled = rolls.blocks(seen.roll, alone=seen.swing is None) if seen.roll else []
    if turned and rolled:
        width = turned[0]["shared"].shape[1] + 3
        turned = [one | {"shared": np.insert(one["shared"], [6] * 3, 0.0, axis=1)} for one in turned]
        rolled = [one | {"shared": _placed(one["shared"], width)} for one in rolled]
    return [Block(**one) for one in (*turned, *rolled)], _candidates(seen, len(turned), len(rolled))


def _placed(shared, width):
    """Columns of bias and offset where a swing's shared columns have the offset, and the bias after it."""
    placed = np.zeros((len(shared), width))
    placed[:, 3:6], placed[:, 6:9] = shared[:, 3:], shared[:, :3]
    return placed


def _candidates(seen, turned, rolled):
    """Candidates over the blocks of both; an effect that both can show acts in both."""
    swung = in_swing.candidates(seen.swing) if seen.swing else []
    found = in_roll.candidates(seen.roll) if seen.roll else []
    last = [None] * (rolled - seen.roll.time.shape[0]) if seen.roll else []  # what is known of the offset
    in_both = {_key(one): [*one["columns"], *last] for one in found}
    both = [one | {"columns": [*one["columns"], *in_both.pop(_key(one), [None] * rolled)]} for one in swung]
    left = [one | {"columns": [*[None] * turned, *in_both[_key(one)]]} for one in found if _key(one) in in_both]
    return [epochs.each_its_own(Candidate(**one), in_swing.STEP) for one in (*both, *left)]


def _key(one):
    return one["cause"], one["form"]


def steps(seen: Parts, rows: list[Block], epoch: float, near: np.ndarray) -> list[Candidate]:
    """A step of the linear readings at epochs near one that was found, in the swing or in a segment of the roll.

    Parameters
    ----------
    seen : Parts
    rows : blocks
    epoch : s; near : (k,) 1, from -1 to 1 of the spacing of the search
    """
    at, inside = epoch + spacing(seen, epoch) * near, _segment(seen, epoch)
    if inside:
        before = _first(rows, rolls.CHANNEL) + inside[0]
        after = [None] * (len(rows) - before - 1)
        each = rolls.steps(seen.roll, inside[0], at)
        found = [in_swing.step(one, [*[None] * before, columns, *after]) for one, columns in each.items()]
    else:
        found = in_swing.steps(seen.swing, at)
        after = [None] * (len(rows) - len(found[0]["columns"]))
        found = [one | {"columns": [*one["columns"], *after]} for one in found]
    return [epochs.each_its_own(Candidate(**one), in_swing.STEP) for one in found]


def _first(rows, channel):
    """Number of the first block that holds a channel."""
    return next(k for k, one in enumerate(rows) if channel in one.channel)


def spacing(seen: Parts, epoch: float) -> float:
    """Spacing s of the search for steps where an epoch lies; arguments as of `steps`."""
    return rolls.STEP_EVERY_S if _segment(seen, epoch) else in_swing.STEP_S


def _segment(seen, epoch):
    """Number of the segment of a roll that an epoch lies in, in a list; empty where it lies in none."""
    time = seen.roll.time if seen.roll else np.zeros((0, 1))
    return [k for k, one in enumerate(time) if one[0] <= epoch <= one[-1]]


def groups(rows: list[Block]) -> list[int]:
    """Number of the manoeuvre of each block: a line has a phase of its own in the swing and in each segment of a roll.

    Parameters
    ----------
    rows : blocks
    """
    rolled = [rolls.CHANNEL in one.channel for one in rows]
    return [sum(rolled[: k + 1]) if one else 0 for k, one in enumerate(rolled)]


def waves(seen: Parts, rows: list[Block], channel: str, axis: int):
    """Function (block, Hz) -> whitened cosine and sine (n, 2) on one axis of a channel, zero in the other channels.

    Parameters
    ----------
    seen : Parts
    rows : blocks
    channel : "linear" or "roll"; axis : 0, 1 or 2
    """
    rolled = channel == rolls.CHANNEL
    shift = _first(rows, channel) if rolled else 0
    wave = in_roll.waves(seen.roll, axis) if rolled else in_swing.waves(seen.swing, axis)

    def found(block, frequency):
        if channel in rows[block].channel:
            return wave(block - shift, frequency)
        return np.zeros((rows[block].observed.size, 2))

    return found


def shown(seen: Parts, block: Block, channel: str, rows: np.ndarray) -> tuple:
    """Reading that the baseline predicts, and whitened rows in its unit, as `readings.variables` takes them.

    Parameters
    ----------
    seen : Parts
    block : whose rows are given; channel : name
    rows : (n, q) 1
    """
    if channel == "linear":
        return reading(seen.swing, rows)
    roll = seen.roll
    each = rows[block.channel == channel].reshape(3, *roll.time.shape, -1)
    whole = np.ones(roll.time.shape[1], dtype=bool)
    columns = [[unwhiten(roll.noise[a], one, whole) for one in each[a]] for a in range(3)]
    columns = np.moveaxis(np.array(columns).reshape(3, roll.time.size, -1), (2, 1, 0), (0, 1, 2))
    model = np.matvec(roll.tensor, roll.start[3:]) - roll.start[:3]
    return roll.time.ravel(), model.reshape(-1, 3), columns
