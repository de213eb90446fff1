"""Noise of the channels that discovery looks at, measured outside the manoeuvres where that can be done."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import noise as linear_noise
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, fit_noise
from gravcal.methods.resampling import lowpass_resampler
from gravcal.physics import frames


def angular(aligned: xr.Dataset, field: xr.Dataset, settings: dict) -> tuple[list[NoiseModel], float]:
    """Angular accelerometer in quiet data, the torque of the control currents removed; and samples an axis.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    settings : inertia, dipole_per_current, lowpass_hz, half_width_s, step_s, angular_drift_degree, noise_order,
        quiet_margin_s, drift_degree
    """
    time = aligned["time_acc"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(aligned["angular_b"].values).all(axis=1)
    spans = linear_noise._quiet_spans(aligned, settings)
    pieces = [_piece(aligned, field, slice(*np.searchsorted(time, s)), good, settings) for s in spans]
    pieces = [p for p in pieces if p is not None]
    removed = len(pieces) * (settings["angular_drift_degree"] + 1)
    order, step = settings["noise_order"], settings["step_s"]
    count = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    return [fit_noise([p[:, a] for p in pieces], order, step, removed) for a in range(3)], count


def _piece(aligned, field, inside, good, settings):
    time = aligned["time_acc"].values[inside]
    if time.size < 1000:
        return None
    step = settings["step_s"]
    grid = np.arange(np.ceil(time[0] / step), np.floor(time[-1] / step)) * step
    filters = {k: settings[k] for k in ("lowpass_hz", "half_width_s")}
    operator = lowpass_resampler(time, good[inside], grid, **filters)
    if operator.valid.sum() < 100:
        return None
    reading = np.nan_to_num(aligned["angular_b"].values[inside]) - _control(aligned, field, time, settings)
    values = operator(reading - reading[len(reading) // 2])
    drift = estimation.polynomial(grid, settings["angular_drift_degree"], grid[0], grid[-1])[operator.valid]
    values[operator.valid] = estimation.without(drift, values[operator.valid])
    return values


def _control(aligned, field, time, settings):
    """Angular acceleration (n, 3) by the control currents, held from sample to sample, rad s-2."""
    mag = aligned["time_mag"].values
    index = np.clip(np.searchsorted((mag[1:] + mag[:-1]) / 2, time), 0, mag.size - 1)
    dipole = np.nan_to_num(aligned["current_b"].values[index]) * np.asarray(settings["dipole_per_current"])
    known = np.isfinite(aligned["quaternion"].values).all(axis=1)
    sca = aligned["time_sca"].values[known]
    quaternion = frames.interpolate(sca, aligned["quaternion"].values[known], np.clip(time, sca[0], sca[-1]))
    inertial = np.stack([np.interp(time, field["time_orbit"].values, c) for c in field["field_i"].values.T], axis=1)
    torque = np.cross(dipole, np.matvec(frames.R_bi_from_quaternion(quaternion), inertial))
    return np.linalg.solve(np.asarray(settings["inertia"]), torque.T).T


def attitude(smoothed: xr.Dataset, settings: dict) -> list[NoiseModel]:
    """Star camera from the residuals of the fit with torque scale and slow torque free.

    Control torques hide the noise outside the manoeuvres, so it comes from residuals of a fit that is wider than the
    baseline; unexplained attitude signal widens it, which costs power and never names anything.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    settings : attitude_noise_order, torque_degree
    """
    manoeuvre = smoothed["sca_manoeuvre"].values
    segments = []
    for one in np.unique(manoeuvre):
        inside = manoeuvre == one
        time = smoothed["time_sca"].values[inside]
        grid = np.full((int(round(time[-1] - time[0])) + 1, 3), np.nan)
        grid[np.round(time - time[0]).astype(int)] = smoothed["sca_residual_b"].values[inside]
        segments.append(grid)
    removed = len(segments) * (settings["torque_degree"] + 3 + 1)
    order = settings["attitude_noise_order"]
    return [fit_noise([s[:, a] for s in segments], order, 1.0, removed) for a in range(3)]


def magnetometer(aligned: xr.Dataset, field: xr.Dataset, settings: dict) -> tuple[list[NoiseModel], float]:
    """Magnetometer minus IGRF at 1 Hz in quiet data, slow part removed; and samples an axis.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    settings : attitude_noise_order, drift_degree, quiet_margin_s
    """
    pieces = []
    for begin, end in linear_noise._quiet_spans(aligned, settings):
        _, values, valid = at_one_hertz(field, begin, end)
        if valid.sum() < 60:
            continue
        drift = estimation.polynomial(np.arange(valid.size), settings["drift_degree"], 0, valid.size)[valid]
        cleaned = np.full_like(values, np.nan)
        cleaned[valid] = estimation.without(drift, values[valid])
        pieces.append(cleaned)
    order, removed = settings["attitude_noise_order"], len(pieces) * (settings["drift_degree"] + 1)
    count = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    return [fit_noise([p[:, a] for p in pieces], order, 1.0, removed) for a in range(3)] if pieces else [], count


def at_one_hertz(field: xr.Dataset, begin: float, end: float):
    """Every second sample: the magnetometer is renewed once a second and written twice.

    Parameters
    ----------
    field : Dataset, "com_offset.field"
    begin, end : s

    Returns
    -------
    time : (n,) s; difference_b : (n, 3) T; valid : (n,) bool
    """
    time = field["time_mag"].values
    inside = np.flatnonzero((time > begin) & (time < end))
    measured = field["measured_b"].values[inside]
    if inside.size < 10:
        return np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool)
    renewed = [int(np.sum(np.any(np.diff(measured, axis=0)[k::2] != 0, axis=1))) for k in (0, 1)]
    inside = inside[1::2] if renewed[0] >= renewed[1] else inside[::2]
    difference = field["difference_b"].values[inside]
    valid = (field["used"].values[inside] > 0) & np.isfinite(difference).all(axis=1)
    return time[inside], np.where(valid[:, None], difference, 0.0), valid
