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
PARTS, ROWS, ORDER = 8, 40, 30  # largest number of blocks, least rows of one, highest order of its noise model


def listed(
    entry: Effect, columns: Columns, form: str = "", kept: slice = slice(None), suffix: str = "", prior: bool = True
) -> Candidate:
    """Candidate of a catalogue effect with its parameters (or those `kept`), one column array or None a block."""
    parameters = entry.parameters[kept]
    names, units = [f"{p.name}{suffix}" for p in parameters], [p.unit for p in parameters]
    return Candidate(entry.slug, form, names, units, columns, [p.prior_sigma for p in parameters if prior])


def unknown(driver: str, form: str, columns: Columns, unit: str, names: Sequence[str] = "xyz") -> Candidate:
    """Candidate that is not in the catalogue, "unknown:<driver>", with parameters of one unit."""
    return Candidate(f"unknown:{driver}", form, list(names), [unit] * len(names), columns)


def along(channel: str, wave: bool = False) -> list[str]:
    """Parameter names of a driver on three axes of a channel: (3,), of a wave (6,), cosines before sines."""
    return [f"{channel}_{axis}{part}" for part in (("_cosine", "_sine") if wave else ("",)) for axis in "xyz"]


def added_by(entry: Entry, channel: str, words: str, series: Iterable[tuple[str, str, np.ndarray]]) -> np.ndarray:
    """Contribution (n, 3) of an entry outside the catalogue to a channel, (3,) zeros if it follows none of the series.

    Series are driver, form and values (n,), of a wave (n, 2); `words` are what the form of the entry begins with.
    """
    added = np.zeros(3)
    for driver, form, values in series:
        if (entry.cause, entry.form) == (f"unknown:{driver}", f"{words}{form}"):
            added = on_axes(values) @ [entry.values.get(name, 0.0) for name in along(channel, values.ndim > 1)]
    return added


def on_axes(series: np.ndarray) -> np.ndarray:
    """Columns (n, 3, 3 w) of series (n,) or (n, w), each on one of three axes: three columns for each series."""
    series = series.reshape(len(series), -1)
    return np.einsum("nw,ac->nawc", series, np.eye(3)).reshape(len(series), 3, -1)


@dataclass(frozen=True)
class LateTags(Observations):
    """Observations of records with tags minutes off: no other cause is searched for."""

    records: Any  #: what the calibration is made of once the delays are taken out
    blocks: list[Block]  #: whitened residuals with the tags as they are
    columns: Mapping[str, Columns]  #: {slug: whitened (n, 1) a block, per second of delay}
    delays: Mapping[str, Parameter] = field()  #: {slug: delay s with its error}
    channels: tuple[str, ...]
    name: str
    form: str
    parameters: tuple[str, ...]  #: of the calibration, on which these rows do not depend
    unit: str
    scale: np.ndarray
    start: np.ndarray

    step, readable, shifted = "unknown:step", ("none",), True

    @property
    def candidates(self) -> list[Candidate]:
        """One candidate, a delay, for each slug."""
        return [listed(effect(slug), columns, self.form, prior=False) for slug, columns in self.columns.items()]

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """False: the orbit in the records that are left is no longer one of another time."""
        return False

    def without(self, model: Sequence[Entry]) -> Any:  # noqa: ARG002
        """The `records`, in which the delays are corrected already or do not matter."""
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
    """LateTags of a late orbit, from residuals `left` (n,) with its tags and their `change` (n,) per second of delay.

    Time is (n,) s; each block is whitened by its own noise, spikes are left out. Others are fields of `LateTags`.
    """
    both = np.column_stack([left, change, left - delay.value * change])
    distance = np.abs(both[:, 2] - np.nanmedian(both[:, 2]))
    step = np.median(np.diff(time))
    even = on_even_grid(time, step, np.where((distance <= SPIKE * np.nanmedian(distance))[:, None], both, np.nan))
    known = np.flatnonzero(np.isfinite(even[:, 2]))
    known = np.array_split(known, np.clip(known.size // ROWS, 2, PARTS))
    blocks, columns = [], []
    for p in (np.arange(one[0], one[-1] + 1) for one in known):
        valid = np.isfinite(even[p, 2])
        at, white = time[0] + step * p[valid], whiten(fit_noise([even[p, 2]], ORDER, 1.0), even[p, :2], valid)[valid]
        no_columns = np.zeros((at.size, len(parameters)))
        blocks.append(Block.of(f"from {at[0]:.0f} s", white[:, 0], channel, 0, at, shared=no_columns))
        columns.append(white[:, 1:])
    slug, p = "timing.orbit_delay", len(parameters)
    about = (channel,), name, form, tuple(parameters), unit, np.ones(p), np.zeros(p)
    return LateTags(records, blocks, {slug: columns}, {slug: delay}, *about)
