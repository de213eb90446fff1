"""Torque against roll acceleration of a record, whether or not it holds a manoeuvre."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import SURVEY
from gravcal.calibrations.com_offset.windows import SURVEY_S
from gravcal.physics import kinematics

HALF_WIDTH = 2  # star-camera samples either side of the parabola whose curvature is the acceleration


def survey(aligned: xr.Dataset, checked: xr.Dataset) -> xr.Dataset:
    """Slope of the roll acceleration seen by the star camera on the roll torque of current and measured field.

    Acceleration and torque pass the same operator: the curvature of a parabola over five samples of the attitude, and
    of the torque integrated twice. The error counts the correlation of the residuals. slope = k / Ixx; formats.md 4.7.

    Parameters
    ----------
    aligned : Dataset, "align"
    checked : Dataset, "com_offset.field"

    Returns
    -------
    surveyed : Dataset, "com_offset.survey"
    """
    time, acceleration, torque = _series(aligned, checked)
    slope, sigma = _slope(acceleration, torque)
    values = {
        "time_sca": time,
        "roll_acceleration": acceleration,
        "roll_torque": torque,
        "slope": slope,
        "slope_sigma": sigma,
    }
    return build(SURVEY, values, title="Torque against roll acceleration")


def _series(aligned, checked):
    """Epochs, roll acceleration and roll torque (current times field), both through the same operator."""
    start = float(aligned["window_start"][0])
    stop = min(start + SURVEY_S, float(aligned["window_stop"][0]), float(aligned["time_mag"].values[-1]))
    time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    used = (time >= start) & (time <= stop) & np.isfinite(quaternion).all(axis=1)
    time = time[used]
    if time.size < 4 * HALF_WIDTH or np.any(np.abs(np.diff(time) - 1) > 1e-3):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    _, rate_dot = kinematics.rates_from_attitude(time, quaternion[used], half_width=HALF_WIDTH, degree=2)
    mag_time = aligned["time_mag"].values
    torque = np.cross(np.nan_to_num(aligned["current_b"].values), np.nan_to_num(checked["measured_b"].values))[:, 0]
    fine = np.arange(time[0], time[-1] + 0.01, 0.01)
    held = torque[np.clip(np.searchsorted(mag_time, fine, side="right") - 1, 0, mag_time.size - 1)]
    angle = np.interp(time, fine, np.cumsum(np.cumsum(held)) * 1e-4)
    offset = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    curvature = 2 * np.linalg.pinv(np.vander(offset, 3, increasing=True))[2]
    smooth = np.full(time.size, np.nan)
    smooth[HALF_WIDTH:-HALF_WIDTH] = np.convolve(angle, curvature[::-1], mode="valid")
    inner = np.isfinite(smooth) & np.isfinite(rate_dot[:, 0])
    return time[inner], rate_dot[inner, 0], smooth[inner]


def _slope(acceleration, torque):
    """Slope and its error, a constant estimated along; NaN where torque or time are too little."""
    if acceleration.size < 20 or np.std(torque) == 0:
        return np.nan, np.nan
    columns = np.stack([torque - torque.mean(), np.ones_like(torque)], axis=1)
    unknown = np.linalg.lstsq(columns, acceleration, rcond=None)[0]
    residual = acceleration - columns @ unknown
    sigma = np.sqrt(np.sum(residual**2) / (residual.size - 2) / np.sum(columns[:, 0] ** 2))
    lag = float(np.clip(np.corrcoef(residual[1:], residual[:-1])[0, 1], 0.0, 0.95))
    return float(unknown[0]), float(sigma * np.sqrt((1 + lag) / (1 - lag)))
