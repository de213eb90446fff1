"""Swings and rolls found in the attitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import roll_bins, schemas
from gravcal.estimation.noise import runs

STEP = 2.0  # s, of the attitude looked at
SHOWN = 60.0  # s, of the rates kept
WINDOW = 28.0  # s, of the running rms, about one period of a swing
EARLY = 8.0  # s, by which a running rms shows a swing before it begins


def detect(
    *attitudes: Callable,
    swing_rate_dot_rad_s2: float,
    swing_minimum_s: float,
    roll_rate_rad_s: float,
    segment_s: float,
) -> xr.Dataset:
    """Times of swings and rolls about y.

    Parameters
    ----------
    attitudes : functions that read {"time", "quaternion"} of one day each
    swing_rate_dot_rad_s2 : rms angular acceleration over half a minute above which the satellite swings
    swing_minimum_s : s, shortest swing
    roll_rate_rad_s : mean rate about y above which the satellite rolls
    segment_s : s, shortest roll

    Returns
    -------
    detected : Dataset, "inertial_sensor.detect"
    """
    parts = [_motion(read) for read in attitudes]
    time, rate, swinging, mean = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(time)
    time, rate, swinging, mean = time[order], rate[order], swinging[order], mean[order]
    swings = _spans(time, swinging > swing_rate_dot_rad_s2, swing_minimum_s) + [EARLY, -EARLY]
    rolls = _spans(time, np.abs(mean[:, 1]) > roll_rate_rad_s, segment_s)
    every = slice(None, None, int(SHOWN / STEP))
    values = {
        "time": time[every],
        "rate_b": mean[every],
        "swing_start": swings[:, 0],
        "swing_stop": swings[:, 1],
        "roll_start": rolls[:, 0],
        "roll_stop": rolls[:, 1],
    }
    return build(schemas.DETECT, values)


def _motion(read):
    """Epochs, rate, running rms of the angular acceleration and running mean rate of one day."""
    record = read()
    edges = STEP * np.arange(np.floor(record["time"][0] / STEP), np.ceil(record["time"][-1] / STEP) + 1)
    rate = roll_bins.rates(roll_bins.mean_attitude(record["time"], record["quaternion"], edges), STEP)
    rate = _bridged(rate)
    change = np.zeros_like(rate)
    change[2:-2] = (rate[4:] - rate[:-4]) / (4 * STEP)
    middle = (edges[1:] + edges[:-1]) / 2
    rms = np.sqrt(_running(change**2, int(WINDOW / STEP)).max(axis=1))
    return middle, rate, rms, _running(rate, int(SHOWN / STEP))


def _bridged(rate):
    """Rates with straight lines over missing epochs."""
    good = np.isfinite(rate).all(axis=1)
    if not good.any():
        return np.zeros_like(rate)
    index = np.arange(rate.shape[0])
    return np.stack([np.interp(index, index[good], column[good]) for column in rate.T], axis=1)


def _running(values, width):
    """Running mean along the first axis."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(values, min(width, values.shape[0]), axis=0, mode="nearest")


def _spans(time, inside: Sequence[bool], shortest: float) -> np.ndarray:
    """Begin and end of long enough spans (s, 2); a step of the epochs over a minute ends one."""
    breaks = np.flatnonzero(np.diff(time) > 60.0) + 1
    found = []
    for part in np.split(np.arange(time.size), breaks):
        begin, end = runs(np.asarray(inside)[part])
        found += [(time[part[a]], time[part[b - 1]]) for a, b in zip(begin, end, strict=True)]
    long = [span for span in found if span[1] - span[0] >= shortest]
    return np.array(long, dtype=float).reshape(-1, 2)
