"""IGRF along the orbit, how far the magnetometer is from it, and torque against roll acceleration."""

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.align import SURVEY_S, between
from gravcal.calibrations.building import build
from gravcal.estimation import least_squares
from gravcal.physics import earth, frames, kinematics, magnetic

SCHEMAS = schemas.of("com_offset.toml")


def field(aligned: xr.Dataset, *, igrf_generation: int) -> xr.Dataset:
    """Geomagnetic field along the orbit and the magnetometer's difference to it in the body.

    Parameters
    ----------
    aligned : Dataset, "align"
    igrf_generation : 13 or 14
    """
    good = aligned["orbit_flag"].values == 0
    time = aligned["time_orbit"].values[good]
    position_e = aligned["position_e"].values[good]
    field_e = magnetic.field_e(time, position_e, igrf_generation)
    field_i = np.matvec(np.swapaxes(earth.R_ei(time), 1, 2), field_e)
    usable, model_b = _at_magnetometer(aligned, time, field_i)
    difference = aligned["field_measured_b"].values - model_b
    used = difference[usable] if usable.any() else np.full((1, 3), np.nan)
    latitude, longitude, _ = earth.geocentric(position_e)
    values = {
        "time_orbit": time,
        "time_mag": aligned["time_mag"].values,
        "field_i": field_i,
        "position_i": aligned["position_i"].values[good],
        "latitude": latitude,
        "longitude": longitude,
        "model_b": model_b,
        "measured_b": aligned["field_measured_b"].values,
        "difference_b": difference,
        "used": usable,
        "bias": used.mean(axis=0),
        "rms": np.sqrt(np.mean(used**2, axis=0)),
        "maximum": np.abs(used).max(axis=0),
    }
    digest = magnetic.coefficient_digest(igrf_generation)
    return build(SCHEMAS["field"], values, igrf_generation=igrf_generation, igrf_sha256=digest)


def _at_magnetometer(aligned, time, field_i):
    """Model in the body at the magnetometer epochs, NaN where attitude or orbit is missing."""
    mag_time = aligned["time_mag"].values
    sca_time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    known = np.isfinite(quaternion).all(axis=1)
    model_b = np.full((mag_time.size, 3), np.nan)
    if known.sum() < 2 or time.size < 2:
        return np.zeros(mag_time.size, dtype=bool), model_b
    covered = between(mag_time, sca_time[known], 2.0) & between(mag_time, time, 2.0)
    at = mag_time[covered]
    body = frames.interpolate(sca_time[known], quaternion[known], at)
    inertial = np.stack([np.interp(at, time, field_i[:, c]) for c in range(3)], axis=1)
    model_b[covered] = np.matvec(frames.R_bi_from_quaternion(body), inertial)
    measured = aligned["field_measured_b"].values
    return covered & (aligned["mag_flag"].values == 0) & np.isfinite(measured).all(axis=1), model_b


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
    return build(SCHEMAS["survey"], values, title="Torque against roll acceleration")


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
