"""Noise of the channels that discovery looks at, measured outside the manoeuvres where that can be done."""

from __future__ import annotations

import functools

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import noise as linear_noise
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_beside, fit_detrended, without_lines
from gravcal.estimation.resampling import lowpass_resampler
from gravcal.physics import frames


def linear(aligned: xr.Dataset, settings: dict) -> tuple[list[NoiseModel], float]:
    """Linear accelerometer in quiet data; and samples an axis.

    Parameters
    ----------
    aligned : Dataset, "align"
    settings : lowpass_hz, half_width_s, step_s, linear_drift_degree, noise_order, quiet_margin_s
    """
    time = aligned["time_acc"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(aligned["linear_b"].values).all(axis=1)
    spans = linear_noise._quiet_spans(aligned, settings)
    pieces = []
    for inside in (slice(*np.searchsorted(time, s)) for s in spans):
        operator = _operator(time[inside], good[inside], settings)
        if operator is not None:
            reading = np.nan_to_num(aligned["linear_b"].values[inside])
            pieces.append(operator(reading - reading[len(reading) // 2]))
    return _model(pieces, settings["linear_drift_degree"], settings)


def _model(pieces, degree, settings):
    """Noise of quiet pieces without sharp lines, and samples an axis."""
    if not pieces:
        return [], 0.0
    order, step = settings["noise_order"], settings["step_s"]
    cleaned, _ = without_lines(pieces, step)
    count = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    return fit_detrended(cleaned, _without_drift(degree), order, step), count


def _operator(time, good, settings):
    """Low-pass of a piece of quiet data, None if it is too short."""
    if time.size < 1000:
        return None
    step = settings["step_s"]
    grid = np.arange(np.ceil(time[0] / step), np.floor(time[-1] / step)) * step
    filters = {k: settings[k] for k in ("lowpass_hz", "half_width_s")}
    operator = lowpass_resampler(time, good, grid, **filters)
    return operator if operator.valid.sum() >= 100 else None


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
    return _model(pieces, settings["angular_drift_degree"], settings)


def _without_drift(degree):
    """What removes a polynomial from a segment, NaN staying where it is."""

    @functools.cache
    def basis(count, valid):
        drift = least_squares.polynomial(np.arange(count), degree, 0, count)
        return least_squares.orthonormal(drift[np.frombuffer(valid, dtype=bool)])

    def clean(segment, _):
        valid = np.isfinite(segment).all(axis=1)
        slow, given = basis(len(segment), valid.tobytes()), segment[valid]
        cleaned = np.full_like(segment, np.nan)
        cleaned[valid] = given - slow @ (slow.T @ given)
        return cleaned

    return clean


def _piece(aligned, field, inside, good, settings):
    time = aligned["time_acc"].values[inside]
    operator = _operator(time, good[inside], settings)
    if operator is None:
        return None
    reading = np.nan_to_num(aligned["angular_b"].values[inside]) - _control(aligned, field, time, settings)
    return operator(reading - reading[len(reading) // 2])


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


def attitude(smoothed: xr.Dataset, scenes: list, wider: list[np.ndarray], settings: dict) -> list[NoiseModel]:
    """Star camera from the residuals of a fit that is wider than the baseline: with every torque that is tried.

    Control torques hide the noise outside the manoeuvres. Unexplained attitude signal widens the model, which costs
    power and never names anything.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    scenes : list of Scene
    wider : (k, 3, q) rad a scene, attitude after every torque that is tried
    settings : attitude_noise_order
    """
    manoeuvre, segments, columns = smoothed["sca_manoeuvre"].values, [], []
    for scene, more in zip(scenes, wider, strict=True):
        residual = np.full((scene.sca_time.size, 3), np.nan)
        residual[scene.sca_good] = smoothed["sca_residual_b"].values[manoeuvre == scene.index]
        segments.append(residual)
        columns.append(np.concatenate([scene.own_attitude, scene.scale_attitude, more], axis=2))
    return fit_beside(segments, columns, settings["attitude_noise_order"], 1.0)


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
        pieces.append(np.where(valid[:, None], values, np.nan))
    count = float(sum(np.isfinite(p[:, 0]).sum() for p in pieces))
    clean = _without_drift(settings["drift_degree"])
    return fit_detrended(pieces, clean, settings["attitude_noise_order"], 1.0) if pieces else [], count


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
