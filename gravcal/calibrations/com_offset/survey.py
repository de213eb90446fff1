"""Torque against roll acceleration of a record, whether or not it holds a manoeuvre."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.align import SURVEY_S
from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import SURVEY
from gravcal.estimation import least_squares
from gravcal.physics import kinematics

HALF_WIDTH = 2  # star-camera samples either side of the parabola whose slope is the rate
DRIFT_DEGREE = 2  # of the roll rate, for the torques that are not of the torquers


def survey(aligned: xr.Dataset, checked: xr.Dataset) -> xr.Dataset:
    """Slope of the roll motion seen by the star camera on the roll torque of current and measured field.

    Rate and torque pass the same operator: the slope of a parabola over five samples of the attitude, and of the torque
    integrated twice. A quadratic drift of the rate is estimated along, and the error counts the correlation of the
    residuals. slope = k / Ixx, dipole per current over roll inertia (docs/com_offset.md, Limits).

    Parameters
    ----------
    aligned : Dataset, "align"
    checked : Dataset, "com_offset.field"

    Returns
    -------
    surveyed : Dataset, "com_offset.survey"
    """
    time, rate, impulse = _series(aligned, checked)
    slope, sigma = _slope(rate, impulse)
    values = {
        "time_sca": time,
        "roll_rate": rate,
        "roll_impulse": impulse,
        "slope": slope,
        "slope_sigma": sigma,
    }
    return build(SURVEY, values, title="Torque against roll acceleration")


def _series(aligned, checked):
    """Epochs, roll rate and integrated roll torque (current times field), both through the same operator."""
    start = float(aligned["window_start"][0])
    stop = min(start + SURVEY_S, float(aligned["window_stop"][0]), float(aligned["time_mag"].values[-1]))
    time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    used = (time >= start) & (time <= stop) & np.isfinite(quaternion).all(axis=1)
    time = time[used]
    if time.size < 4 * HALF_WIDTH or np.any(np.abs(np.diff(time) - 1) > 1e-3):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    rate, _ = kinematics.rates_from_attitude(time, quaternion[used], half_width=HALF_WIDTH, degree=2)
    mag_time = aligned["time_mag"].values
    torque = np.cross(np.nan_to_num(aligned["current_b"].values), np.nan_to_num(checked["measured_b"].values))[:, 0]
    fine = np.arange(time[0], time[-1] + 0.01, 0.01)
    held = torque[np.clip(np.searchsorted(mag_time, fine, side="right") - 1, 0, mag_time.size - 1)]
    angle = np.interp(time, fine, np.cumsum(np.cumsum(held)) * 1e-4)
    offset = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    slope = np.linalg.pinv(np.vander(offset, 3, increasing=True))[1]
    inner = slice(HALF_WIDTH, -HALF_WIDTH)
    return time[inner], rate[inner, 0], np.convolve(angle, slope[::-1], mode="valid")


def _slope(rate, impulse):
    """Slope and its error, drift estimated along; NaN where torque or time are too little."""
    if rate.size < 20 or np.std(impulse) == 0:
        return np.nan, np.nan
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, rate.size), DRIFT_DEGREE)
    observed, column = (least_squares.without(drift, series) for series in (rate, impulse))
    square = float(column @ column)
    value = float(column @ observed) / square
    residual = observed - value * column
    sigma = np.sqrt(residual @ residual / (residual.size - DRIFT_DEGREE - 2) / square)
    lag = float(np.clip(np.corrcoef(residual[1:], residual[:-1])[0, 1], 0.0, 0.95))
    return value, float(sigma * np.sqrt((1 + lag) / (1 - lag)))
