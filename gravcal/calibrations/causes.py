"""Causes as the adapters of several calibrations try them: effects of the catalogue, and drivers in no list."""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gravcal.effects import Effect, effect
from gravcal.estimation.noise import fit_noise, whiten
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Observations, Parameter

Columns = list[np.ndarray | None]
SPIKE = 12.0  # times the median distance from the median, 8 sigma
PARTS, ROWS = 8, 40  # most blocks of a record, and their least rows


def listed(
    entry: Effect, columns: Columns, form: str = "", kept: slice = slice(None), suffix: str = "", prior: bool = True
) -> Candidate:
    """Candidate of an effect with all its parameters, or some of them, whose names may end in a suffix."""
    parameters = entry.parameters[kept]
    names, units = [f"{p.name}{suffix}" for p in parameters], [p.unit for p in parameters]
    return Candidate(entry.slug, form, names, units, columns, [p.prior_sigma for p in parameters if prior])


def unknown(driver: str, form: str, channel: str, unit: str, columns: Columns) -> Candidate:
    """Candidate in no list, added to the three readings of a channel."""
    return Candidate(f"unknown:{driver}", form, [f"{channel}_{a}" for a in "xyz"], [unit] * 3, columns)


def added_by(entry: Entry, channel: str, words: str, series: Iterable[tuple[str, str, np.ndarray]]) -> np.ndarray:
    """What an entry in no list adds to the three readings of a channel, (n, 3), zero if it follows none of these.

    Series are driver, form and values (n,); the form of the entry begins with the words.
    """
    size, total = np.array([entry.values.get(f"{channel}_{axis}", 0.0) for axis in "xyz"]), np.zeros(3)
    for driver, form, values in series:
        if (entry.cause, entry.form) == (f"unknown:{driver}", f"{words}{form}"):
            total = values[:, None] * size
    return total


def on_axes(series: np.ndarray) -> np.ndarray:
    """Series (n,) or (n, w) on each of three axes, (n, 3, 3 w)."""
    series = series.reshape(len(series), -1)
    return np.einsum("nw,ac->nawc", series, np.eye(3)).reshape(len(series), 3, -1)


@dataclass(frozen=True)
class LateOrbit(Observations):
    """Records of which the orbit has tags that are minutes off: of them nothing but that is looked for."""

    records: Any  #: what the calibration is made of once the delay is taken out
    time: np.ndarray  #: (n,) s
    left: np.ndarray  #: (n,) 1, what contradicts the orbit as tagged
    change: np.ndarray  #: (n,) s-1, of that by each second of delay
    delay: Parameter
    channel: str
    name: str
    form: str = ""
    parameters: tuple[str, ...] = ()  #: of a calibration whose result is made anew, of which these rows know nothing
    unit: str = "1"

    step, readable, shifted = "unknown:step", ("none",), True
    order = 30  # most coefficients of the noise

    @property
    def channels(self) -> tuple[str, ...]:
        """The one that contradicts the orbit."""
        return (self.channel,)

    @property
    def scale(self) -> np.ndarray:
        """One for each parameter."""
        return np.ones(len(self.parameters))

    @property
    def start(self) -> np.ndarray:
        """Nought for each."""
        return np.zeros(len(self.parameters))

    @functools.cached_property
    def rows(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Epochs, and rows (m, 2) of what is left and of the change, of each block, white by its own noise.

        Spikes are left out.
        """
        both = np.column_stack([self.left, self.change, self.left - self.delay.value * self.change])
        away = np.abs(both[:, 2] - np.nanmedian(both[:, 2]))
        step = np.median(np.diff(self.time))
        place = np.rint((self.time - self.time[0]) / step).astype(int)
        even = np.full((place[-1] + 1, 3), np.nan)
        even[place] = np.where((away <= SPIKE * np.nanmedian(away))[:, None], both, np.nan)
        known = np.flatnonzero(np.isfinite(even[:, 2]))
        known = np.array_split(known, np.clip(known.size // ROWS, 2, PARTS))
        made = []
        for p in (np.arange(one[0], one[-1] + 1) for one in known):
            there = np.isfinite(even[p, 2])
            white = whiten(fit_noise([even[p, 2]], self.order, 1.0), even[p, :2], there)
            made.append((self.time[0] + step * p[there], white[there]))
        return made

    @property
    def blocks(self) -> list[Block]:
        """One block a stretch of time."""
        made = []
        for time, rows in self.rows:
            channel, axis = np.full(time.size, self.channel), np.zeros(time.size, dtype=int)
            none = np.zeros((time.size, len(self.parameters))), np.zeros((time.size, 0))
            made.append(Block(f"from {time[0]:.0f} s", rows[:, 0], *none, channel, axis, time))
        return made

    @property
    def candidates(self) -> list[Candidate]:
        """Late tags of the orbit."""
        return [listed(effect("timing.orbit_delay"), [rows[:, 1:] for _, rows in self.rows], self.form, prior=False)]

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:  # noqa: ARG002
        """The delay as it was found."""
        return replace(entry, parameters={"delay": self.delay})

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """Never: the records that are left are not those of the orbit."""
        return False

    def without(self, model: Sequence[Entry]) -> Any:  # noqa: ARG002
        """Records with the orbit where it was, or as they are."""
        return self.records
