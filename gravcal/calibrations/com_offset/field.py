"""IGRF along the orbit, and how far the magnetometer is from it."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.align import between
from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import FIELD
from gravcal.physics import earth, frames, magnetic


def field(aligned: xr.Dataset, *, igrf_generation: int) -> xr.Dataset:
    """Geomagnetic field along the orbit and the magnetometer's difference to it in the body.

    Parameters
    ----------
    aligned : Dataset, "align"
    igrf_generation : 13 or 14

    Returns
    -------
    checked : Dataset, "com_offset.field"
    """
    good = aligned["orbit_flag"].values == 0
    time = aligned["time_orbit"].values[good]
    position_e = aligned["position_e"].values[good]
    field_e = magnetic.field_e(time, position_e, igrf_generation)
    field_i = np.matvec(np.swapaxes(earth.R_ei(time), 1, 2), field_e)
    usable, model_b = _at_magnetometer(aligned, time, field_i)
    difference = aligned["field_measured_b"].values - model_b
    statistics = _statistics(difference[usable])
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
    }
    digest = magnetic.coefficient_digest(igrf_generation)
    return build(FIELD, values | statistics, igrf_generation=igrf_generation, igrf_sha256=digest)


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


def _statistics(difference):
    if difference.shape[0] == 0:
        return dict.fromkeys(("bias", "rms", "maximum"), np.full(3, np.nan))
    return {
        "bias": difference.mean(axis=0),
        "rms": np.sqrt(np.mean(difference**2, axis=0)),
        "maximum": np.abs(difference).max(axis=0),
    }
