"""Epochs of our own netCDF layouts: put in order, repeated records joined, the day checked."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date, datetime, timedelta

import numpy as np

from gravcal.errors import refuse

ORIGIN = datetime(2000, 1, 1, 12)
MARGIN = 120.0  # s that a file may begin before its day
SHOWN = "Check the day in the file's name, or fetch the file of that day."


def increasing(time: np.ndarray) -> bool:
    """Whether all epochs are finite and each is later than the one before.

    Parameters
    ----------
    time : (n,) s
    """
    return bool(np.isfinite(time).all() and np.all(np.diff(time) > 0))


def in_order(time: np.ndarray, values: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Records by time, those without one left out; of a repeated one the first, NaN where the others contradict it.

    Parameters
    ----------
    time : (n,) s
    values : {name: (n, ...)}

    Returns
    -------
    time : (m,) s, strictly increasing
    values : {name: (m, ...)}
    """
    if increasing(time):
        return time, dict(values)
    known = np.flatnonzero(np.isfinite(time))
    order = known[np.argsort(time[known], kind="stable")]
    new = np.append(True, np.diff(time[order]) > 0)[: order.size]
    place = np.cumsum(new) - 1
    found = {}
    for name, column in values.items():
        every = np.array(column, dtype=float)[order]
        kept = every[new]
        differs = ~np.isclose(every, kept[place], rtol=0, atol=0, equal_nan=True)
        kept[place[differs.any(axis=tuple(range(1, differs.ndim)))]] = np.nan
        found[name] = kept
    return time[order][new], found


def check_day(time: np.ndarray, where, day: str) -> None:
    """Refuse a file that holds too little, or does not begin on the day of its name.

    Parameters
    ----------
    time : (n,) GPS s, in order
    where : file; day : YYYY-MM-DD
    """
    if time.size < 2:
        refuse(where, f"{time.size} epochs", "at least two with a finite time", "Fetch the file again.")
    begin = (datetime.combine(date.fromisoformat(day), datetime.min.time()) - ORIGIN).total_seconds()
    if not begin - MARGIN <= time[0] < begin + 86400:
        first = ORIGIN + timedelta(seconds=float(time[0]))
        refuse(where, f"a first epoch of {first:%Y-%m-%d %H:%M:%S} GPS", f"one on the day {day}", SHOWN)
