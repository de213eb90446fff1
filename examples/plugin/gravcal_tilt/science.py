"""Reading of a tilt meter: r = (1 + s) angle + b + noise."""

import numpy as np


def simulate(day, duration_s, scale, bias, curvature, noise, seed):
    """Columns of an invented day; the turntable swings once in ten minutes.

    Parameters
    ----------
    day : s, GPS time of its begin
    duration_s : s
    scale, bias, curvature, noise : 1, rad, rad-1, rad

    Returns
    -------
    time, angle, reading : (n,) s, rad, rad
    """
    time = day + np.arange(0.0, duration_s, 1.0)
    angle = 1e-3 * np.sin(2 * np.pi * (time - day) / 600.0)
    random = np.random.default_rng(seed).standard_normal(time.size)
    return time, angle, (1 + scale) * angle + bias + curvature * angle**2 + noise * random


def fit(angle, reading):
    """Scale and bias by least squares, white noise from the residual.

    Parameters
    ----------
    angle, reading : (n,) rad

    Returns
    -------
    value : (2,) scale 1, bias rad
    covariance : (2, 2)
    residual : (n,) rad
    """
    design = np.stack([angle, np.ones_like(angle)], axis=1)
    value, *_ = np.linalg.lstsq(design, reading - angle, rcond=None)
    residual = reading - angle - design @ value
    return value, residual.var(ddof=2) * np.linalg.inv(design.T @ design), residual
