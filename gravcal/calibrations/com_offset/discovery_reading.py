"""Readings of a manoeuvre in their own units, from whitened rows and the model that these are the difference to."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.com_offset.discovery_view import View, times
from gravcal.estimation.noise import unwhiten


def reading(view: View, channel: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reading that the model of a channel predicts, and whitened rows in its unit.

    The linear and the angular reading are those after the low-pass of the solution; the attitude is the rotation from
    a satellite whose torquers are off.

    Parameters
    ----------
    view : View
    channel : of `discovery_view.CHANNELS`
    rows : (n, q) 1, of all channels, as `View.rows` gives them

    Returns
    -------
    time : (m,) s
    model : (m, 3) m s-2, rad s-2, rad or T
    columns : (q, m, 3) the same unit, NaN where there is no sample
    """
    valid = view.valid()
    ends = dict(zip(valid, np.cumsum([0, *(3 * v.size for v in valid.values())]), strict=False))
    count = valid[channel].size
    parts = rows[ends[channel] : ends[channel] + 3 * count].reshape(3, count, -1)
    noise = view.noise[channel]
    columns = np.stack([unwhiten(noise[a], parts[a], valid[channel]) for a in range(3)], axis=1)
    time = dict(zip(valid, times(view), strict=True))[channel]
    return time, _model(view, channel, time), np.moveaxis(columns, 2, 0)


def _model(view, channel, time):
    """What the baseline predicts with the parameters that the observed rows were formed with."""
    if channel in ("linear", "angular"):
        return view.scene.operator(view.context.linear_b if channel == "linear" else view.context.rate_dot_b)
    if channel == "attitude":
        return view.scene.scale_attitude.sum(axis=2)  # all torques once
    return view.at(time).field_b
