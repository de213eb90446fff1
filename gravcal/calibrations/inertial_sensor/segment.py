"""Stage `segment`: the record of a roll reduced to bins, day by day, never all of it in memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import roll_bins, schemas

NAMES = ("time", "linear_volt", "share", "R_bo", "rate_b", "gradient_b")


def segment(
    detected: xr.Dataset, days: Sequence[tuple[Callable, Callable, Callable]], *, step_s, workers
) -> xr.Dataset:
    """Bins of all rolls.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    days : functions that read sensor, tracker and orbit of each day
    step_s : s, of the bins
    workers : days held in memory at a time

    Returns
    -------
    segmented : Dataset, "inertial_sensor.segment"
    """
    spans = np.stack([detected.roll_start.values, detected.roll_stop.values], axis=1)
    return build(schemas.SEGMENT, joined(days, spans, step_s, workers))


def joined(days, spans: np.ndarray, step_s: float, workers: int) -> dict[str, np.ndarray]:
    """Bins of several days within the rolls, in order of time.

    Parameters
    ----------
    days : functions that read sensor, tracker and orbit of each day
    spans : (r, 2) s, rolls; step_s : s; workers : days at a time
    """
    import dask

    lazy = [dask.delayed(day_bins)(day, spans, step_s) for day in days]
    parts = dask.compute(*lazy, scheduler="threads", num_workers=workers)
    order = np.argsort([part["time"][0] if part["time"].size else np.inf for part in parts])
    return {name: np.concatenate([parts[i][name] for i in order]) for name in NAMES}


def day_bins(day: tuple[Callable, Callable, Callable], spans: np.ndarray, step_s: float) -> dict[str, np.ndarray]:
    """Bins of one day that lie within a roll.

    Parameters
    ----------
    day : functions that read sensor, tracker and orbit; spans : (r, 2) s; step_s : s
    """
    bins = roll_bins.reduced(*(read() for read in day), step_s)
    time = bins["time"]
    inside = np.zeros(time.size, dtype=bool)
    for start, stop in spans:
        inside |= (time >= start) & (time <= stop)
    return {name: values[inside] for name, values in bins.items()}
