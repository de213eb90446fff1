"""Angular factors as the paper does it: angular acceleration of the star tracker against voltages, Kalman filter.

The tracker is differenced twice and filtered; noisy voltages are the regressor. For comparison only.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import cleaning
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation import crn, kalman
from gravcal.physics import frames
from gravcal.physics.sensing import rotation_tensor

FILTER = crn.Crn(window_s=30.0, bandwidth_hz=0.1, convolutions=5)


def estimates(aligned: xr.Dataset, bin_s: float) -> dict:
    """Beta and its published error, the standard deviation of the estimate after convergence.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"; bin_s : s

    Returns
    -------
    values : {"beta", "beta_sigma" (3,) rad s-2 V-1; "rate_dot_b" (b, 3) rad s-2 by the voltages}

    Notes
    -----
    y = (wd_x, wd_y), H = (V_z1 - V_z2, V_x2 - V_x3), one filter each; Remote Sens. 2023, 15, 3817, eqs. 18-23.
    """
    first, last = float(aligned.start) - 5.0, float(aligned.stop) + 5.0
    reach = FILTER.window_s / 2 + 3 * bin_s
    edges = first - reach + bin_s * np.arange(np.floor((last - first + 2 * reach) / bin_s) + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    volt = cleaning.bin_means(aligned.time.values, electrodes.readouts(aligned.volts.values)[:, 3:], edges)[0]
    turned = tracker_rate_dot(aligned.time_att.values, aligned.quaternion.values, edges)
    inside = (middle >= first) & (middle <= last)
    operator = crn.operator(FILTER, 0, np.ones(middle.size, dtype=bool), (middle[0], bin_s), middle[inside])
    y, h = (_detrended(operator(np.nan_to_num(values))) for values in (turned, volt))
    pairs = [_filtered(y[:, axis], h[:, axis]) for axis in (0, 1)]
    beta = np.array([pairs[0][0], pairs[1][0], pairs[1][0]])
    sigma = np.array([pairs[0][1], pairs[1][1], pairs[1][1]])
    return {"beta": beta, "beta_sigma": sigma}


def filtered_readouts(aligned: xr.Dataset) -> tuple[float, np.ndarray, np.ndarray]:
    """The six readouts before and after the CRN filter, for spectra.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"

    Returns
    -------
    step : s; before, after : (n, 6) V, means taken off, where the filter is complete
    """
    time = aligned.time.values
    step = float(np.median(np.diff(time)))
    readout = electrodes.readouts(aligned.volts.values)
    readout = readout - readout.mean(axis=0)
    grid = time[0] + step * np.arange(time.size)
    after = crn.operator(FILTER, 0, np.ones(time.size, dtype=bool), (time[0], step), grid)(readout)
    inside = np.isfinite(after).all(axis=1)
    return step, readout[inside], after[inside]


def tracker_rate_dot(time: np.ndarray, quaternion: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Angular acceleration of the star tracker by differencing bin means twice (b, 3) rad s-2, NaN at the ends.

    Parameters
    ----------
    time : (n,) s; quaternion : (n, 4); edges : (b + 1,) s
    """
    from gravcal.calibrations.inertial_sensor.roll_bins import mean_attitude

    step = edges[1] - edges[0]
    attitude = mean_attitude(time, quaternion, edges)
    good = np.isfinite(attitude).all(axis=1)
    attitude = np.where(good[:, None], attitude, [1.0, 0.0, 0.0, 0.0])
    turn = frames.attitude_error(attitude[1:], attitude[:-1]) / step
    out = np.full((attitude.shape[0], 3), np.nan)
    out[1:-1] = np.diff(turn, axis=0) / step
    return out


def offset_matrix(rate_b, rate_dot_b, gradient_b):  # noqa: ARG001 - the printed form drops the gradient
    """Matrix A of eq. 13 as printed: element (3,1) with the wrong sign (erratum T-1), no gravity gradient.

    Parameters
    ----------
    rate_b, rate_dot_b : (..., 3) rad s-1, rad s-2; gradient_b : not used

    Returns
    -------
    matrix_b : (..., 3, 3) s-2
    """
    matrix = rotation_tensor(rate_b, rate_dot_b)
    matrix[..., 2, 0] += 2 * np.asarray(rate_dot_b)[..., 1]
    return matrix


def _detrended(values):
    """Values without their straight line."""
    u = np.linspace(-1, 1, values.shape[0])
    basis = np.linalg.qr(np.stack([np.ones_like(u), u], axis=1))[0]
    return values - basis @ (basis.T @ values)


def _filtered(y, h):
    """Last value of the filter and the standard deviation of its second half; start and R from batch least squares."""
    batch = (h @ y) / (h @ h)
    noise = np.var(y - h * batch)
    run = kalman.filter_constants(y, h[:, None], np.array([batch]), np.array([[noise / (h @ h)]]), noise)
    return float(run.value[-1, 0]), float(np.std(run.value[y.size // 2 :, 0]))
