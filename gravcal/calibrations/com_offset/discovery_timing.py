"""Edge times of the instruments as one block of discovery: delays of their tags."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.estimation.records import Block


def block(smoothed: xr.Dataset) -> Block:
    """Edges of the accelerometer less those of the star camera, and their delay against the telemetry.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    """
    rows = np.append(smoothed["acc_shift"].values - smoothed["sca_shift"].values, float(smoothed["acc_delay"]))
    spread = _spread(smoothed)
    used = np.isfinite(rows) & np.isfinite(spread) & (spread > 0)
    count = rows.size
    return Block(
        label="timing",
        observed=np.where(used, rows / np.where(used, spread, 1), 0.0),
        global_columns=np.zeros((count, 3)),
        local_columns=np.zeros((count, 0)),
        channel=np.array(["timing"] * count),
        axis=np.zeros(count, dtype=int),
        time=np.arange(count, dtype=float),
    )


def columns(slug: str, smoothed: xr.Dataset, starts: np.ndarray) -> np.ndarray | None:
    """Column of an effect in the timing block, by what each instrument's tags do; None where it does nothing.

    Parameters
    ----------
    slug : of the effect
    smoothed : Dataset, "com_offset.attitude"
    starts : (k,) s, of the manoeuvres
    """
    spread = _spread(smoothed)
    count = spread.size - 1
    middle = starts - starts[0]
    column = {
        "timing.accelerometer_delay": np.append(np.ones(count), 1.0),
        "timing.star_camera_delay": np.append(-np.ones(count), 0.0),
        "timing.magnetometer_delay": np.append(np.zeros(count), -1.0),
        "timing.clock_drift": np.append(middle, middle.mean()),
    }.get(slug)
    return None if column is None else column_of(smoothed, column)


def column_of(smoothed: xr.Dataset, delays: np.ndarray) -> np.ndarray:
    """Column (k + 1, 1) of the timing block.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    delays : (k + 1,) edges of the accelerometer less those of the star camera in each manoeuvre, and against telemetry
    """
    spread = _spread(smoothed)
    used = np.isfinite(spread) & (spread > 0)
    return np.where(used, delays / np.where(used, spread, 1), 0.0)[:, None]


def _spread(smoothed):
    """Errors (k + 1,) s of the rows.

    Where between two samples of the accelerometer an edge falls cannot be told from momentary readings: the wave's
    period is a whole number of samples, so that all edges of a manoeuvre fall on the same part of it.
    """
    steps = np.diff(smoothed["time_acc"].values)
    between = float(np.median(steps)) / np.sqrt(12) if steps.size else 0.0
    parts = smoothed["acc_shift_sigma"].values, smoothed["sca_shift_sigma"].values
    each = np.sqrt(parts[0] ** 2 + parts[1] ** 2 + between**2)
    return np.append(each, np.hypot(float(smoothed["acc_delay_sigma"]), between))
