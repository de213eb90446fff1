"""An inertial sensor as discovery sees it: a swing, a roll, or both as one problem that shares the offset."""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.align import POINTING_S, off_orbit
from gravcal.calibrations.causes import LateTags, of_late_orbit
from gravcal.calibrations.inertial_sensor import observed_roll, observed_swing, responses
from gravcal.calibrations.inertial_sensor.observed_roll import RollView
from gravcal.calibrations.inertial_sensor.observed_swing import SwingView
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation import records
from gravcal.estimation.noise import Spectrum

#: Factor from SI and unit in which a parameter is reported, by the first word of its name.
REPORTED = {
    "beta": (1e6, "1e-6 rad s-2 V-1"),
    "delay": (1e3, "ms"),
    "offset": (1e6, "um"),
    "bias": (1e9, "nm s-2"),
    "constant": (1e9, "nm s-2"),
    "k": (1e6, "1e-6 m s-2 V-1"),
}
#: Channels in which lines are searched; residuals of an attitude wander with the integrated noise of the voltages.
READABLE = ("linear", observed_roll.CHANNEL)
HARMONICS = 4  # of a smooth motion that signals driven by it have
WAVES = ("unknown:attitude", "unknown:latitude")  # their mean cannot be separated from a bias in a roll
#: Epochs round that of the search at which a step is looked for again, in spacings of the search.
NEAR = np.linspace(-1.0, 1.0, 21)


def observe(
    products: Mapping[str, xr.Dataset], *, scene: Mapping, rolling: Mapping, pointing_limit_rad: float
) -> "InertialSensor | LateTags | None":
    """Observations of an event, None without swing and roll; where the orbit of a swing is of another time, that alone.

    Products are "align", "scale" and "offset" of a swing, "segment" and "bias" of a roll, as far as they are there;
    scene holds the settings of `observed_swing.view_of`, rolling those of `observed_roll.view_of`; attitudes may be off
    the orbit by pointing_limit_rad.
    """
    if "align" in products:
        time, angle, rate = off_the_orbit(products["align"])
        if abs(np.median(angle)) > pointing_limit_rad:
            delay = records.Parameter(-float(np.median(angle / rate)), POINTING_S, "s")
            return of_late_orbit(products["align"], time, angle, -rate, delay, "attitude", InertialSensor.name)
    swing = observed_swing.view_of(products, scene) if "align" in products else None
    roll = observed_roll.view_of(products, rolling) if "bias" in products else None
    views = [view for view in (roll, swing) if view]
    if not views:
        return None
    known = {n: v for view in views for n, v in zip(view.parameters, view.start, strict=True)}  # offset of the swing
    parameters = tuple(dict.fromkeys(name for view in reversed(views) for name in view.parameters))
    factors, units = zip(*(REPORTED[name.partition("_")[0]] for name in parameters), strict=True)
    channels = tuple(channel for view in reversed(views) for channel in view.channels)
    read = [channel for channel in channels if channel in READABLE]
    return InertialSensor(
        swing,
        roll,
        channels=channels,
        parameters=parameters,
        unit=", ".join(units if len(set(units)) > 1 else units[:1]),
        scale=np.array(factors),
        start=np.array([known[name] for name in parameters]),
        epoch=float(roll.time.mean()) if roll else None,
        quiet={"attitude": swing.quiet} if swing else {},  # in a roll noise is measured in the rows
        spectra={"linear": swing.spectra} if swing else {},
        lines=tuple(records.LineSearch(c, a, observed_swing.TONE, "m s-2") for c in read for a in range(3)),
    )


def off_the_orbit(aligned: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every five seconds time s, angle rad by which attitudes lie behind the orbit, and its rate rad s-1, (n,) each."""
    orbit, position = (aligned[name].values for name in ("time", "position_i"))
    valid = np.flatnonzero(np.isfinite(position).all(axis=1))[::50]
    orbit, position = orbit[valid], position[valid]
    state = np.column_stack([position, np.gradient(position, orbit, axis=0)])
    near = np.unique(np.clip(np.searchsorted(aligned["time_att"].values, orbit), 0, aligned.sizes["time_att"] - 1))
    time, quaternion = aligned["time_att"].values[near], aligned["quaternion"].values[near]
    return time, *off_orbit(time, quaternion, orbit, state, axis=2)


@dataclass(frozen=True)
class InertialSensor(records.Observations):
    """Observations of a swing and a roll, one of them None if it was not flown; blocks are made when asked for."""

    swing: SwingView | None
    roll: RollView | None
    channels: tuple[str, ...]
    parameters: tuple[str, ...]
    unit: str
    scale: np.ndarray
    start: np.ndarray
    epoch: float | None  #: middle of the segments of a roll, at which a bias that drifts is given
    quiet: Mapping[str, float] = field(default_factory=dict)
    spectra: Mapping[str, Sequence[Spectrum]] = field(default_factory=dict)
    lines: tuple[records.LineSearch, ...] = ()

    name = "inertial_sensor"
    step = observed_swing.STEP
    contiguous = True
    readable = (*SwingView.channels, observed_roll.CHANNEL)

    @functools.cached_property
    def periods(self) -> dict[float, int]:
        """Periods of the swing about each axis and of the roll, about y, {s: harmonics}, of what motion drives."""
        roll = [2 * np.pi / abs(self.roll.rate_b[..., 1].mean())] if self.roll else []
        return dict.fromkeys([*(self.swing.periods() if self.swing else ()), *roll], HARMONICS)

    @property
    def groups(self) -> list[int]:
        """Manoeuvre of each block, 0 swing and 1 roll: a line has one phase in each."""
        return [int(observed_roll.CHANNEL in block.channel) for block in self.blocks]

    @functools.cached_property
    def blocks(self) -> list[records.Block]:
        """Blocks of swing, roll and prior; global columns: the parameters, then those of the swing not reported."""
        swung = self.swing.blocks(self.parameters) if self.swing else []
        width = swung[0].global_columns.shape[1] if swung else len(self.parameters)
        rolled = self.roll.blocks(self.parameters, width, alone=not swung) if self.roll else []
        return swung + rolled + ([self._known(width, swung[0].time[:1])] if swung else [])

    def _known(self, width, time):
        """Block of the prior of k_y, the factor of the ground, with `width` global columns, at an epoch (1,) s."""
        column = np.zeros((1, width))
        column[0, self.parameters.index("k_y")] = 1 / self.swing.k_y_sigma
        return records.Block.of("known beforehand", np.zeros(1), "prior", 1, time, shared=column)

    @property
    def swung(self) -> int:
        """Number of blocks of the swing, which are the first."""
        return sum(block.channel[0] in SwingView.channels for block in self.blocks)

    @functools.cached_property
    def candidates(self) -> list[records.Candidate]:
        """Candidates over the blocks of swing and roll; an effect that both can show acts in both."""
        swung = self._over_all(responses.of_swing(self.swing)) if self.swing else []
        rolled = self._over_all(responses.of_roll(self.roll), self.swung) if self.roll else []
        biases = tuple(self.parameters.index(name) for name in RollView.parameters[:3]) if self.roll else ()
        rolled = [replace(one, means=biases) if one.cause in WAVES else one for one in rolled]
        candidates = {(one.cause, one.form): one for one in swung}
        for one in rolled:
            whole = candidates.get((one.cause, one.form), one)
            columns = [a if b is None else b for a, b in zip(whole.columns, one.columns, strict=True)]
            candidates[one.cause, one.form] = replace(whole, columns=columns)
        return list(candidates.values())

    def _over_all(self, candidates, before=0):
        """Candidates whose columns begin with block `before`, filled up with None to all blocks, the prior included."""
        rows = ((one, [None] * before + one.columns) for one in candidates)
        return [replace(one, columns=c + [None] * (len(self.blocks) - len(c))) for one, c in rows]

    def spacing(self, epoch: float) -> float:
        """Spacing s of the search for steps where an epoch lies."""
        if self.roll and self.roll.segment_of(epoch) is not None:
            return observed_roll.STEP_EVERY_S
        swung = self.swing.record.time
        return responses.STEP_S if swung[0] <= epoch <= swung[-1] else responses.QUIET_STEP_S

    def near(self, fitted: records.Fitted) -> list[records.Candidate]:
        """Candidates of steps at epochs near that of a fitted one, in the swing or in a segment of the roll."""
        one = fitted.candidate
        epoch = one.at if np.isfinite(one.at) else records.epoch_of(one.cause)
        return self._steps(epoch, epoch + self.spacing(epoch) * NEAR)

    def physical(self, entry: records.Entry, fitted: records.Fitted) -> records.Entry:
        """Entry in physical parameters, also the mean of a wave, which no record of one axis separates from a bias.

        A square of voltages whose mean is not zero changes their scale as well: where it was fitted beside the scale
        that it gives them, r = q / (1 + 4 q V), it is q = r / (1 - 4 r V), V the mean that was recorded; not determined
        where no q is such.
        """
        physical = super().physical(entry, fitted)
        record = self.swing.aligned if self.swing else self.roll.products["segment"]
        if entry.cause == "inertial_sensor.quadratic" and entry.cause not in record.attrs.get("model", ""):
            volts = (self.swing or self.roll).context().extra["volts"]
            means = {a: volts[:, row > 0].mean() for a, row in zip("xyz", electrodes.READOUT, strict=False)}
            gain = {a: max(1 - 4 * p.value * means[a], 0.0) or np.nan for a, p in physical.parameters.items()}
            scaled = lambda p, by: replace(p, value=p.value / by, sigma=p.sigma / by**2)  # noqa: E731
            return replace(physical, parameters={a: scaled(p, gain[a]) for a, p in physical.parameters.items()})
        known = physical.parameters.items() if fitted.candidate.means else ()
        sizes = {a: [p.value for n, p in known if n.split("_")[1] == a and p.value] for a in "xyz"}
        means = {f"mean_{a}": records.Parameter(0.0, float(np.linalg.norm(v)), "m s-2") for a, v in sizes.items() if v}
        return replace(physical, parameters=dict(physical.parameters) | means)

    def forms_of(self, entry: records.Entry) -> Iterable[records.Candidate]:
        """Candidates of the form of an entry; for a step the one at its own epoch."""
        epoch = entry.values.get("time", np.nan)
        if entry.cause != self.step or not (self.swing or self.roll.segment_of(epoch) is not None):
            return super().forms_of(entry)
        return self._steps(epoch, np.array([epoch]))

    def _steps(self, epoch, at):
        """Candidates of steps at epochs (n,) s near one, in the swing or in the segment of the roll that holds it."""
        index = self.roll.segment_of(epoch) if self.roll else None
        if index is not None:
            rows = self.roll.steps(index, at).items()
            return self._over_all([responses.step(t, [columns]) for t, columns in rows], self.swung + index)
        return self._over_all(responses.steps(self.swing, at))

    def wave(self, search: records.LineSearch) -> Callable[[int, float], np.ndarray]:
        """Function (block, Hz) -> whitened cosine and sine (n, 2) on an axis; those of the last frequency are kept.

        What a roll shows, a swing has as well.
        """
        rolled = search.channel == observed_roll.CHANNEL
        views = [*([self.swing] if self.swing else []), *([self.roll] if rolled else [])]

        @functools.lru_cache(1)
        def columns(frequency):
            return [one for view in views for one in view.wave(search.axis, frequency)]

        def rows(block, frequency):
            block_columns = columns(frequency)[block] if block < len(columns(frequency)) else None
            return np.zeros((self.blocks[block].observed.size, 2)) if block_columns is None else block_columns

        return rows

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time (m,) s, reading (m, 3) that the baseline predicts, rows of the whole record in its unit (q, m, 3)."""
        time, axis, names = (np.concatenate([getattr(b, n) for b in self.blocks]) for n in ("time", "axis", "channel"))
        inside = names == channel
        if channel in SwingView.channels:
            return self.swing.reading(channel, rows[inside])
        return self.roll.reading_of(rows[inside][np.lexsort((time[inside], axis[inside]))])

    def without(self, model: Sequence[records.Entry]) -> xr.Dataset:
        """Record of the swing, of the roll where there is no other, without the effects of a model."""
        swing = self.swing
        return responses.swing_without(swing, model) if swing else responses.roll_without(self.roll, model)


REPORT = records.reported(__file__, "discovery.toml")
