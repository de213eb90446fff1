"""An inertial sensor as discovery sees it: a swing, a roll, or both as one problem that shares the offset."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import observed_roll, observed_swing
from gravcal.calibrations.inertial_sensor.observed_roll import RollView
from gravcal.calibrations.inertial_sensor.observed_swing import SwingView
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, LineSearch, Observations, epoch_of

#: Factor from SI and unit in which a parameter is reported, by the first word of its name.
REPORTED = {
    "beta": (1e6, "1e-6 rad s-2 V-1"),
    "delay": (1e3, "ms"),
    "offset": (1e6, "um"),
    "bias": (1e9, "nm s-2"),
}
#: Epochs round that of the search at which a step is looked for again, in spacings of the search.
NEAR = np.linspace(-1.0, 1.0, 21)


def observe(products: Mapping[str, xr.Dataset], *, scene: Mapping, rolling: Mapping) -> InertialSensor | None:
    """Observations of an event, None without swing and roll.

    Parameters
    ----------
    products : "align", "scale" and "offset" of a swing, "segment" and "bias" of a roll, as far as they are there
    scene : settings of `observed_swing.view_of`; rolling : of `observed_roll.view_of`
    """
    swing = roll = None
    if "align" in products:
        swing = observed_swing.view_of(products["align"], products["scale"], products["offset"], scene)
    if "bias" in products:
        roll = observed_roll.view_of(products, rolling)
    return InertialSensor(swing, roll) if swing or roll else None


@dataclass(frozen=True)
class InertialSensor(Observations):
    """Observations of a swing and a roll, one of them None if it was not flown."""

    swing: SwingView | None
    roll: RollView | None

    name = "inertial_sensor"
    step = observed_swing.STEP
    interleaved = True
    readable = ("linear", observed_roll.CHANNEL)  # what is left of an attitude wanders with the noise of the voltages

    @property
    def views(self) -> list[SwingView | RollView]:
        """Those that there are."""
        return [one for one in (self.swing, self.roll) if one]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels in the order of the page."""
        return tuple(channel for view in self.views for channel in view.channels)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters of the calibration; the offset of swing and roll is one."""
        return tuple(dict.fromkeys(name for view in self.views for name in view.parameters))

    @property
    def scale(self) -> np.ndarray:
        """Factors to the units of the parameters."""
        return np.array([REPORTED[name.partition("_")[0]][0] for name in self.parameters])

    @property
    def unit(self) -> str:
        """Units of the parameters, each once."""
        return ", ".join(dict.fromkeys(REPORTED[name.partition("_")[0]][1] for name in self.parameters))

    @property
    def start(self) -> np.ndarray:
        """Values that the residuals were formed with; of an offset that both have that of the swing."""
        known = {n: v for view in reversed(self.views) for n, v in zip(view.parameters, view.start, strict=True)}
        return np.array([known[name] for name in self.parameters])

    @property
    def quiet(self) -> dict[str, float]:
        """Quiet samples an axis of the swing; in a roll the noise is measured in the rows themselves."""
        return dict.fromkeys(self.swing.channels, self.swing.quiet) if self.swing else {}

    @property
    def lines(self) -> tuple[LineSearch, ...]:
        """Tones on each axis of the linear readings."""
        channels = [channel for channel in self.channels if channel != "attitude"]
        return tuple(LineSearch(c, axis, observed_swing.TONE, "m s-2") for c in channels for axis in range(3))

    @property
    def groups(self) -> list[int]:
        """A line has a phase of its own in the swing and in each segment of a roll."""
        rolled = [observed_roll.CHANNEL in block.channel for block in self.blocks]
        return [sum(rolled[: k + 1]) if one else 0 for k, one in enumerate(rolled)]

    @functools.cached_property
    def _parts(self) -> tuple[list[Block], list[Block]]:
        """Blocks of the swing and of the roll, the global columns of each its own."""
        swung = self.swing.blocks() if self.swing else []
        return swung, self.roll.blocks(alone=self.swing is None) if self.roll else []

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """Blocks of both; parameters first among the global columns, then those of the swing that are not reported."""
        swung, rolled = self._parts
        names = list(self.parameters)
        nuisance = swung[0].global_columns.shape[1] - len(self.swing.parameters) if swung else 0
        found = []
        for view, blocks in ((self.swing, swung), (self.roll, rolled)):
            for block in blocks:
                known = len(view.parameters)
                columns = np.zeros((block.observed.size, len(names) + nuisance))
                columns[:, [names.index(name) for name in view.parameters]] = block.global_columns[:, :known]
                if view is self.swing:
                    columns[:, len(names) :] = block.global_columns[:, known:]
                found.append(replace(block, global_columns=columns))
        return found

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates over the blocks of both; an effect that both can show acts in both."""
        swung, rolled = self._parts
        of_roll = {}
        for one in self.roll.candidates() if self.roll else []:
            columns = one.columns + [None] * (len(rolled) - len(one.columns))  # what is known of the offset
            of_roll[one.cause, one.form] = replace(one, columns=columns)
        found = []
        for one in self.swing.candidates() if self.swing else []:
            other = of_roll.pop((one.cause, one.form), None)
            found.append(replace(one, columns=one.columns + (other.columns if other else [None] * len(rolled))))
        return found + [replace(one, columns=[None] * len(swung) + one.columns) for one in of_roll.values()]

    def spacing(self, epoch: float) -> float:
        """Spacing s of the search for steps where an epoch lies."""
        rolling = self.roll and self.roll.segment_of(epoch) is not None
        return observed_roll.STEP_EVERY_S if rolling else observed_swing.STEP_S

    def near(self, fitted: Fitted) -> list[Candidate]:
        """Steps at epochs near that of a finding, in the swing or in a segment of the roll."""
        epoch = epoch_of(fitted.candidate.cause)
        at = epoch + self.spacing(epoch) * NEAR
        index = self.roll.segment_of(epoch) if self.roll else None
        before, after = (len(part) for part in self._parts)
        if index is None:
            return [replace(one, columns=one.columns + [None] * after) for one in self.swing.steps(at)]
        found = []
        for one in self.roll.steps_near(index, at):
            rest = [None] * (after - len(one.columns))
            found.append(replace(one, columns=[None] * before + one.columns + rest))
        return found

    def wave(self, search: LineSearch) -> Callable[[int, float], np.ndarray]:
        """Function (block, Hz) -> whitened cosine and sine (n, 2) on an axis; those of the last frequency are kept."""
        rolled = search.channel == observed_roll.CHANNEL
        view, before = (self.roll, len(self._parts[0])) if rolled else (self.swing, 0)
        columns = functools.lru_cache(1)(lambda frequency: view.wave(search.axis, frequency))

        def rows(block, frequency):
            if search.channel in self.blocks[block].channel:
                return columns(frequency)[block - before]
            return np.zeros((self.blocks[block].observed.size, 2))

        return rows

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time s, linear reading that the baseline predicts, whitened rows of the joined record in its unit."""
        if channel == "linear":
            return self.swing.reading(rows)
        joined = [block for block in self._parts[1] if channel in block.channel]
        time, axis, names = (np.concatenate([getattr(b, n) for b in joined]) for n in ("time", "axis", "channel"))
        return self.roll.reading_of(rows[names[np.lexsort((time, axis))] == channel])

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Record of the swing, of the roll where there is no other, without the effects of a model."""
        return self.views[0].without(model)
