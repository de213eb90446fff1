"""Causes as the adapters of several calibrations try them: effects of the catalogue, and drivers in no list."""

from collections.abc import Iterable, Sequence

import numpy as np

from gravcal.effects import Effect
from gravcal.estimation.noise import NoiseModel, whiten
from gravcal.estimation.records import Candidate, Entry

Columns = list[np.ndarray | None]


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


def whitened(noise: Sequence[NoiseModel], values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Whitened rows (3 n, q), axis after axis, of values (n, 3, q) with a noise model for each axis."""
    return np.concatenate([whiten(model, np.ascontiguousarray(values[:, a]), valid) for a, model in enumerate(noise)])
