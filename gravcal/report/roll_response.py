"""Torquers seen without a manoeuvre: slope of the measured roll acceleration on (m x B)_x."""

import numpy as np

from gravcal.physics import frames

MINIMUM = 20  # seconds of star camera with torquer currents
FINE_S = 0.02
DRIFT_DEGREE = 2


def roll_response(aligned, field):
    """Roll acceleration for one mA T of torquer current times field, k / Jxx.

    Parameters
    ----------
    aligned : Dataset, "com_offset.align"
    field : Dataset, "com_offset.field"

    Returns
    -------
    response : {"value", "sigma", "unit", "samples", "span_s"}, or None where too little overlaps

    Notes
    -----
    w_x(t) = c0 + c1 t + c2 t^2 + slope x integral of (m x B)_x, the rate from successive star-camera attitudes; roll
    row of eq. 18, 10.3390/rs14164030. The error is widened by the correlation of neighbouring residuals.
    """
    series = roll_series(aligned, field)
    if series is None:
        return None
    slope, sigma = series["slope"], series["sigma"]
    span = float(np.ptp(series["time"]))
    unit = "rad s-2 mA-1 T-1"
    return {"value": slope, "sigma": sigma, "unit": unit, "samples": int(series["time"].size), "span_s": span}


def roll_series(aligned, field):
    """Measured and fitted roll rate with the slope that joins them.

    Parameters
    ----------
    aligned : Dataset, "com_offset.align"
    field : Dataset, "com_offset.field"

    Returns
    -------
    series : {"time", "measured", "fitted", "slope", "sigma"} in s, rad s-1, or None
    """
    mag_time, torque = _torque(aligned, field)
    time, rate = _roll_rate(aligned)
    if mag_time.size < 2 or time.size < MINIMUM:
        return None
    inside = (time - 0.5 >= mag_time[0]) & (time + 0.5 <= mag_time[-1])
    if inside.sum() < MINIMUM:
        return None
    time, rate = time[inside], rate[inside]
    change = _mean_of_integral(time, mag_time, torque)
    scaled = (time - time.mean()) / np.ptp(time)
    return _fit(time, rate, np.column_stack([change, np.vander(scaled, DRIFT_DEGREE + 1)]))


def _torque(aligned, field):
    """Epochs (n,) s and (m x B)_x (n,) mA T where both are usable."""
    current, model = aligned["current_b"].values, field["model_b"].values
    torque = np.cross(current, model)[:, 0]
    usable = np.isfinite(torque) & (aligned["mag_flag"].values == 0)
    return aligned["time_mag"].values[usable], torque[usable]


def _roll_rate(aligned):
    """Mean roll rate between successive star-camera epochs 1 s apart."""
    quaternion, time = aligned["quaternion"].values, aligned["time_sca"].values
    good = np.isfinite(quaternion).all(axis=1)
    quaternion, time = quaternion[good], time[good]
    if time.size < 2:
        return np.zeros(0), np.zeros(0)
    step = np.diff(time)
    turn = frames.rotation_vector(frames.quaternion_product(frames.conjugate(quaternion[:-1]), quaternion[1:]))
    near = np.abs(step - 1.0) < 1e-3
    return ((time[1:] + time[:-1]) / 2)[near], (turn[:, 0] / step)[near]


def _mean_of_integral(time, mag_time, torque):
    """Integral of the torque from the first epoch, averaged over the second round each of `time`."""
    fine = np.arange(mag_time[0], mag_time[-1] + FINE_S, FINE_S)
    once = np.cumsum(np.interp(fine, mag_time, torque)) * FINE_S
    twice = np.cumsum(once) * FINE_S
    return np.interp(time + 0.5, fine, twice) - np.interp(time - 0.5, fine, twice)


def _fit(time, rate, design):
    """Least squares with an error that allows for neighbouring residuals being alike."""
    scale = np.linalg.norm(design, axis=0)
    if not np.all(scale > 0):
        return None
    value, _, rank, _ = np.linalg.lstsq(design / scale, rate, rcond=None)
    if rank < design.shape[1]:
        return None
    residual = rate - design / scale @ value
    variance = residual @ residual / (time.size - rank)
    alike = float(np.clip(residual[1:] @ residual[:-1] / max(residual @ residual, 1e-300), 0.0, 0.9))
    inverse = np.linalg.inv(design.T @ design / np.outer(scale, scale))
    sigma = np.sqrt(inverse[0, 0] * variance * (1 + alike) / (1 - alike)) / scale[0]
    drift = design[:, 1:] / scale[1:] @ value[1:]
    return {
        "time": time,
        "measured": rate - drift,
        "fitted": design[:, 0] / scale[0] * value[0],
        "slope": float(value[0] / scale[0]),
        "sigma": float(sigma),
    }
