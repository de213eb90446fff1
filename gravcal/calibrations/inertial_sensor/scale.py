"""Stage `scale`: angular and linear scale factors and the tracker delay from a swing."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import (
    cleaning,
    linear_factors,
    published_swing,
    schemas,
    swing_fit,
    swing_model,
)
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError
from gravcal.estimation import kalman
from gravcal.physics import frames, gravity

LINEAR = ("k", "k_sigma", "k_sigma_total")
EDGE = 5.0  # s fitted before the first and after the last reversal


def scale(
    aligned: xr.Dataset, *, method, bin_s, quiet_margin_s, first_beta, arm_x_mm, k_y, k_y_sigma, geometry
) -> xr.Dataset:
    """Scale factors of one swing.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"
    method : "gravcal" or "published"
    bin_s : s, of the means that are fitted
    quiet_margin_s : s kept clear of the swing where the noise is measured
    first_beta : (2,) rad s-2 V-1, to start from, about x and about y and z
    arm_x_mm : mm, 8.0 or 10.45
    k_y, k_y_sigma : m s-2 V-1, taken as they are
    geometry : {"mass" kg, "inertia" kg m2, "arm" m, and each with "_sigma"}

    Returns
    -------
    scaled : Dataset, "inertial_sensor.scale"
    """
    swing = prepare(aligned, bin_s, quiet_margin_s, np.array(geometry["inertia"]))
    fitted = swing_fit.fit(swing, np.array(first_beta, dtype=float))
    values = _estimates(swing, fitted) | _motion(swing, fitted) | _history(swing, fitted)
    if method == "published":
        values |= published_swing.estimates(aligned, bin_s)
    tied = linear_factors.linear_factors(
        values["beta"], values["beta_sigma"], geometry, (k_y, k_y_sigma), method == "published"
    )
    values |= {name: tied[name] for name in (*LINEAR, "ratio_relative_sigma", "k_budget")}
    arm = int(np.argmin(np.abs(np.array(linear_factors.ARMS_X) - arm_x_mm * 1e-3)))
    values |= {"arm_x": linear_factors.ARMS_X, "chosen_arm": arm}
    causes = " ".join(linear_factors.CAUSES)
    return build(schemas.SCALE, values, method=method, estimated="beta_x beta_y delay", causes=causes)


def prepare(aligned: xr.Dataset, bin_s: float, quiet_margin_s: float, inertia: np.ndarray) -> swing_model.Swing:
    """Swing with its noise measured in the quiet data either side.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"
    bin_s, quiet_margin_s : s; inertia : (3,) kg m2 of the test mass
    """
    start, stop = float(aligned.start), float(aligned.stop)
    time, time_att = aligned.time.values, aligned.time_att.values
    readout = electrodes.readouts(aligned.volts.values)[:, 3:]
    edges = start - EDGE + bin_s * np.arange(np.floor((stop - start + 2 * EDGE) / bin_s) + 1)
    part = (time >= edges[0] - 1) & (time <= edges[-1] + 1)
    seen = (time_att >= edges[0] - 1) & (time_att <= edges[-1] + 1)
    blocks = quiet_blocks(aligned, readout, bin_s, quiet_margin_s)
    variance = cleaning.scatter_about_polynomial(blocks, 3)
    if not np.all(variance > 0):
        raise EstimationError(
            f"swing from {start:.0f} s: found {sum(len(b) for b in blocks)} quiet bins beside it, expected at least "
            f"300 s either side to measure the noise. Give a longer record, or lower quiet_margin_s.",
        )
    calm = (time_att < start - quiet_margin_s) | (time_att > stop + quiet_margin_s)
    return swing_model.Swing(
        time=time[part],
        angular_volt=readout[part],
        time_att=time_att[seen],
        quaternion=aligned.quaternion.values[seen],
        edges=edges,
        position_i=aligned.position_i.values[part],
        inertia=inertia,
        voltage_variance=variance,
        tracker_variance=tracker_variance(time_att, aligned.quaternion.values, calm),
        owner=(0, 1, 1),
    )


def quiet_blocks(aligned: xr.Dataset, values: np.ndarray, bin_s: float, margin_s: float) -> list[np.ndarray]:
    """Bin means before and after the swing, NaN where samples are missing.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"; values : (n, m) on its time; bin_s, margin_s : s
    """
    time = aligned.time.values
    values = np.where((aligned.flag.values == 2).any(axis=1, keepdims=True), np.nan, values)
    spans = ((time[0], float(aligned.start) - margin_s), (float(aligned.stop) + margin_s, time[-1]))
    spans = [span for span in spans if span[1] - span[0] > 20 * bin_s]
    edges = [a + bin_s * np.arange(np.floor((b - a) / bin_s) + 1) for a, b in spans]
    return [cleaning.bin_means(time, values, one)[0] for one in edges]


def tracker_variance(time: np.ndarray, quaternion: np.ndarray, calm: np.ndarray) -> np.ndarray:
    """Noise of one attitude sample (3,) rad2, from third differences of the angle while nothing turns fast.

    Parameters
    ----------
    time : (n,) s; quaternion : (n, 4); calm : (n,) bool
    """
    turn = frames.attitude_error(quaternion[1:], quaternion[:-1])
    even = np.abs(np.diff(time) - np.median(np.diff(time))) < 1e-3
    turn[~(even & calm[1:] & calm[:-1])] = np.nan
    return cleaning.scatter_of_third_differences(np.nancumsum(turn, axis=0) + 0 * turn)


def _estimates(swing, fitted):
    """Factors, delay and their errors."""
    sigma = np.sqrt(np.diag(fitted.covariance))
    owner = list(swing.owner)
    return {
        "beta": fitted.unknowns.factors[owner],
        "beta_sigma": sigma[owner],
        "delay": fitted.unknowns.delay,
        "delay_sigma": sigma[swing.factors],
        "covariance": fitted.covariance[:3, :3],
        "tracker_sigma": np.sqrt(swing.tracker_variance),
        "voltage_density": np.sqrt(2 * (swing.edges[1] - swing.edges[0]) * swing.voltage_variance),
        "chi2": fitted.chi2,
        "dof": fitted.dof,
    }


def _motion(swing, fitted):
    """Bin means of the motion, and the measured angle for the figures."""
    motion, edges = fitted.motion, swing.edges
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    gradient = gravity.rotate_tensor(R_bi, gravity.gradient_i(swing.position_i))
    mean = lambda values: cleaning.bin_means(swing.time, values, edges)[0]  # noqa: E731
    beta = fitted.unknowns.factors[list(swing.owner)]
    rate = mean(motion.rate_b)
    angle = np.cumsum(rate - rate.mean(axis=0), axis=0) * (edges[1] - edges[0])
    return {
        "time_bin": swing.middle,
        "residual_b": fitted.residual,
        "angle_b": angle - angle.mean(axis=0) + np.nan_to_num(fitted.residual),
        "rate_b": rate,
        "rate_dot_b": mean(motion.rate_dot_b) - beta * fitted.voltage_noise,
        "gradient_b": mean(gradient),
        "angular_volt": mean(swing.angular_volt),
    }


def _history(swing, fitted):
    """Kalman estimates after each bin and the batch values they end at."""
    start = kalman.free_start(fitted.design, 1.0)
    zero = np.zeros(fitted.design.shape[1])
    run = kalman.filter_constants(fitted.observed, fitted.design, zero, start, 1.0)
    last = np.cumsum(np.where(fitted.count > 0, 3, 0)) - 1
    shown = np.maximum(last, 0)
    wanted = slice(0, swing.factors + 1)
    return {
        "filter_value": run.value[shown, wanted],
        "filter_sigma": run.sigma[shown, wanted],
        "batch_value": np.append(fitted.unknowns.factors, fitted.unknowns.delay),
    }
