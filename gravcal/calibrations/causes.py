"""Causes as the adapters of several calibrations try them: effects of the catalogue, and drivers in no list."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gravcal.effects import Effect, effect
from gravcal.estimation.noise import fit_noise, whiten
from gravcal.estimation.records import Block, Candidate, Entry, Observations, Parameter
from gravcal.estimation.resampling import on_even_grid

Columns = list[np.ndarray | None]
SPIKE = 12.0  # times the median distance from the median, 8 sigma
PARTS, ROWS, ORDER = 8, 40, 30  # most blocks of a record, their least rows, most coefficients of their noise


def listed(
    entry: Effect, columns: Columns, form: str = "", kept: slice = slice(None), suffix: str = "", prior: bool = True
) -> Candidate:
    """Candidate of an effect with all its parameters, or some of them, whose names may end in a suffix."""
    parameters = entry.parameters[kept]
    names, units = [f"{p.name}{suffix}" for p in parameters], [p.unit for p in parameters]
    return Candidate(entry.slug, form, names, units, columns, [p.prior_sigma for p in parameters if prior])


def unknown(driver: str, form: str, columns: Columns, unit: str, names: Sequence[str] = "xyz") -> Candidate:
    """Candidate in no list, of parameters of one unit."""
    return Candidate(f"unknown:{driver}", form, list(names), [unit] * len(names), columns)


def along(channel: str, wave: bool = False) -> list[str]:
    """Names of what is added to the three readings of a channel; of a wave those of its cosine and of its sine."""
    return [f"{channel}_{axis}{part}" for part in (("_cosine", "_sine") if wave else ("",)) for axis in "xyz"]


def added_by(entry: Entry, channel: str, words: str, series: Iterable[tuple[str, str, np.ndarray]]) -> np.ndarray:
    """What an entry in no list adds to the three readings of a channel, (n, 3), zero if it follows none of these.

    Series are driver, form and values (n,), of a wave (n, 2); the form of the entry begins with the words.
    """
    total = np.zeros(3)
    for driver, form, values in series:
        if (entry.cause, entry.form) == (f"unknown:{driver}", f"{words}{form}"):
            total = on_axes(values) @ [entry.values.get(name, 0.0) for name in along(channel, values.ndim > 1)]
    return total


def on_axes(series: np.ndarray) -> np.ndarray:
    """Series (n,) or (n, w) on each of three axes, (n, 3, 3 w)."""
    series = series.reshape(len(series), -1)
    return np.einsum("nw,ac->nawc", series, np.eye(3)).reshape(len(series), 3, -1)


@dataclass(frozen=True)
class LateTags(Observations):
    """Records of which some tags are minutes off: of them nothing but that is looked for."""

    records: Any  #: what the calibration is made of once the delays are taken out
    blocks: list[Block]
    columns: Mapping[str, Columns]  #: {slug: (n, 1) a block} of each second of a delay
    delays: Mapping[str, Parameter] = field()  #: {slug: delay}
    channels: tuple[str, ...]
    name: str
    form: str
    parameters: tuple[str, ...]  #: of a calibration whose result is made anew, of which these rows know nothing
    unit: str
    scale: np.ndarray
    start: np.ndarray

    step, readable, shifted = "unknown:step", ("none",), True

    @property
    def candidates(self) -> list[Candidate]:
        """Late tags."""
        return [listed(effect(slug), columns, self.form, prior=False) for slug, columns in self.columns.items()]

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """Never: the records that are left are not those of an orbit that was of another time."""
        return False

    def without(self, model: Sequence[Entry]) -> Any:  # noqa: ARG002
        """Records with an orbit where it was, or as they are."""
        return self.records


def of_late_orbit(
    records: Any,
    time: np.ndarray,
    left: np.ndarray,
    change: np.ndarray,
    delay: Parameter,
    channel: str,
    name: str,
    form: str = "",
    parameters: Sequence[str] = (),
    unit: str = "1",
) -> LateTags:
    """Records whose orbit is late, by what contradicts it as tagged (n,) and changes (n,) of that with each second.

    Each block is white by its own noise; spikes are left out. The rest are fields of `LateTags`.
    """
    both = np.column_stack([left, change, left - delay.value * change])
    away = np.abs(both[:, 2] - np.nanmedian(both[:, 2]))
    step = np.median(np.diff(time))
    even = on_even_grid(time, step, np.where((away <= SPIKE * np.nanmedian(away))[:, None], both, np.nan))
    known = np.flatnonzero(np.isfinite(even[:, 2]))
    known = np.array_split(known, np.clip(known.size // ROWS, 2, PARTS))
    blocks, columns = [], []
    for p in (np.arange(one[0], one[-1] + 1) for one in known):
        there = np.isfinite(even[p, 2])
        at, white = time[0] + step * p[there], whiten(fit_noise([even[p, 2]], ORDER, 1.0), even[p, :2], there)[there]
        none = np.zeros((at.size, len(parameters)))
        blocks.append(Block.of(f"from {at[0]:.0f} s", white[:, 0], channel, 0, at, shared=none))
        columns.append(white[:, 1:])
    slug, p = "timing.orbit_delay", len(parameters)
    about = (channel,), name, form, tuple(parameters), unit, np.ones(p), np.zeros(p)
    return LateTags(records, blocks, {slug: columns}, {slug: delay}, *about)
