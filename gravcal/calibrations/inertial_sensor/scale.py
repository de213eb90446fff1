"""Stage `scale`: angular and linear scale factors and the tracker delay from a swing, also as the paper prints them."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import bins, swing
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError
from gravcal.estimation import crn, kalman, least_squares
from gravcal.physics import frames, gravity
from gravcal.physics.sensing import rotation_tensor

SCHEMAS = schemas.of("inertial_sensor.toml")

EDGE = 5.0  # s fitted before the first and after the last reversal
ARMS_X = (8.00e-3, 10.45e-3)  # m, erratum T-5: Table 1 prints the first, every ratio of Table 4 follows the second
CAUSES = ("beta", "mass", "inertia", "arm")  # of the errors of k_x and k_z
FILTER = crn.Crn(window_s=30.0, bandwidth_hz=0.1, convolutions=5)  # of the published method


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
    """
    prepared = prepare(aligned, bin_s, quiet_margin_s, np.array(geometry["inertia"]))
    fitted = swing.fit(prepared, np.array(first_beta, dtype=float))
    sigma = np.sqrt(np.diag(fitted.covariance))
    start = kalman.free_start(fitted.design, 1.0)
    run = kalman.filter_constants(fitted.observed, fitted.design, np.zeros(len(start)), start, 1.0)
    last = np.maximum(np.cumsum(np.where(fitted.system.count > 0, 3, 0)) - 1, 0)  # row of each bin
    values = _motion(prepared, fitted) | {
        "beta": fitted.unknowns.factors[swing.OWNER],
        "beta_sigma": sigma[swing.OWNER],
        "delay": fitted.unknowns.delay,
        "delay_sigma": sigma[swing.FACTORS],
        "covariance": fitted.covariance[:3, :3],
        "tracker_sigma": np.sqrt(prepared.tracker_variance),
        "voltage_density": np.sqrt(2 * bin_s * prepared.voltage_variance),
        "chi2": fitted.chi2,
        "dof": fitted.dof,
        "filter_value": run.value[last, : swing.FACTORS + 1],
        "filter_sigma": run.sigma[last, : swing.FACTORS + 1],
        "batch_value": np.append(fitted.unknowns.factors, fitted.unknowns.delay),
        "arm_x": ARMS_X,
        "chosen_arm": np.argmin(np.abs(np.array(ARMS_X) - arm_x_mm * 1e-3)),
    }
    printed = method == "published"
    values |= published_factors(aligned, bin_s) if printed else {}
    values |= linear_factors(values["beta"], values["beta_sigma"], geometry, (k_y, k_y_sigma), printed)
    return build(SCHEMAS["scale"], values, method=method, estimated="beta_x beta_y delay", causes=" ".join(CAUSES))


def prepare(aligned: xr.Dataset, bin_s: float, quiet_margin_s: float, inertia: np.ndarray) -> swing.Swing:
    """Swing with its noise measured in the quiet data either side; settings as of `scale`.

    Raises
    ------
    EstimationError : no quiet data
    """
    start, stop = float(aligned.start), float(aligned.stop)
    time, time_att, quaternion = aligned.time.values, aligned.time_att.values, aligned.quaternion.values
    readout = electrodes.readouts(aligned.volts.values)[:, 3:]
    edges = start - EDGE + bin_s * np.arange(np.floor((stop - start + 2 * EDGE) / bin_s) + 1)
    part = (time >= edges[0] - 1) & (time <= edges[-1] + 1)
    part_att = (time_att >= edges[0] - 1) & (time_att <= edges[-1] + 1)
    quiet = [block[np.isfinite(block).all(axis=1)] for block in quiet_blocks(aligned, readout, bin_s, quiet_margin_s)]
    quiet = [block for block in quiet if len(block) > 13]
    variance = sum(np.sum(block**2, axis=0) for block in quiet) / max(sum(len(block) - 4 for block in quiet), 1)
    if not np.all(variance > 0):
        raise EstimationError(
            f"swing from {start:.0f} s: found {sum(map(len, quiet))} quiet bins beside it, expected at least "
            f"300 s either side to measure the noise. Give a longer record, or lower quiet_margin_s.",
        )
    calm = (time_att < start - quiet_margin_s) | (time_att > stop + quiet_margin_s)
    turn, step_att = frames.attitude_error(quaternion[1:], quaternion[:-1]), np.diff(time_att)
    turn[~((np.abs(step_att - np.median(step_att)) < 1e-3) & calm[1:] & calm[:-1])] = np.nan
    return swing.Swing(
        time=time[part],
        angular_volt=readout[part],
        time_att=time_att[part_att],
        quaternion=quaternion[part_att],
        edges=edges,
        position_i=aligned.position_i.values[part],
        inertia=inertia,
        voltage_variance=variance,
        tracker_variance=bins.scatter_of_third_differences(np.nancumsum(turn, axis=0) + 0 * turn),
    )


def quiet_blocks(aligned: xr.Dataset, values: np.ndarray, bin_s: float, margin_s: float) -> list[np.ndarray]:
    """Bin means before and after the swing of values (n, m) less a cubic of each, NaN where samples are missing."""
    time, cubic = aligned.time.values, np.polynomial.legendre.legvander
    values = np.where((aligned.flag.values == 2).any(axis=1, keepdims=True), np.nan, values)
    spans = ((time[0], float(aligned.start) - margin_s), (float(aligned.stop) + margin_s, time[-1]))
    edges = [a + bin_s * np.arange(np.floor((b - a) / bin_s) + 1) for a, b in spans if b - a > 20 * bin_s]
    blocks = [bins.bin_means(time, values, one)[0] for one in edges]
    for block in blocks:
        good = np.isfinite(block).all(axis=1)
        block[good] = least_squares.without(cubic(np.linspace(-1, 1, good.size), 3)[good], block[good])
        block[~good] = np.nan
    return blocks


def _motion(prepared, fitted):
    """Bin means of the motion, and the measured angle for the figures."""
    motion, edges, system = fitted.motion, prepared.edges, fitted.system
    residual = np.full(system.valid.size, np.nan)
    residual[system.valid] = system.residual
    residual = residual.reshape(-1, 3)
    gradient = gravity.rotate_tensor(
        frames.R_bi_from_quaternion(motion.quaternion), gravity.gradient_i(prepared.position_i)
    )
    rate, rate_dot, gradient, volt = (
        bins.bin_means(prepared.time, values, edges)[0]
        for values in (motion.rate_b, motion.rate_dot_b, gradient, prepared.angular_volt)
    )
    angle = np.cumsum(rate - rate.mean(axis=0), axis=0) * (edges[1] - edges[0])
    return {
        "time_bin": prepared.middle,
        "residual_b": residual,
        "angle_b": angle - angle.mean(axis=0) + np.nan_to_num(residual),
        "rate_b": rate,
        "rate_dot_b": rate_dot - fitted.unknowns.factors[swing.OWNER] * system.voltage_noise,
        "gradient_b": gradient,
        "angular_volt": volt,
    }


def linear_factors(beta, beta_sigma, geometry: Mapping, k_y: tuple[float, float], printed: bool) -> dict:
    """Linear factors and their errors for both arms about x.

    Parameters
    ----------
    beta, beta_sigma : (3,) rad s-2 V-1
    geometry : {"mass", "inertia" (3,), "arm" (3,), and each with "_sigma"}; the arm about x is replaced by both
    k_y : value and sigma, m s-2 V-1, not tied to any angular factor
    printed : use eqs. 8-10 as printed

    Returns
    -------
    factors : {"k", "k_sigma", "k_sigma_total" (2, 3) m s-2 V-1; "ratio_relative_sigma" (3,) of J/(M l);
        "k_budget" (4, 3) 1, relative errors of k by CAUSES, NaN for y}

    Notes
    -----
    k_x = beta_y J_y/(M l), k_z = beta_x J_x/(M l); errata T-4 to T-6.
    """
    form = electrodes.published_linear_over_angular if printed else electrodes.linear_over_angular
    arms = [np.array([arm, *geometry["arm"][1:]]) for arm in ARMS_X]
    ratio = [form(geometry["mass"], geometry["inertia"], arm) for arm in arms]
    mass, inertia, arm = (np.array(geometry[f"{n}_sigma"]) / geometry[n] for n in ("mass", "inertia", "arm"))
    relative = electrodes.ratio_relative_sigma(mass, inertia, arm)
    k = np.array([[one[1] * beta[1], k_y[0], one[0] * beta[0]] for one in ratio])
    share = np.array([beta_sigma[1] / beta[1], k_y[1] / k_y[0], beta_sigma[0] / beta[0]])
    return {
        "k": k,
        "k_sigma": k * share,
        "k_sigma_total": k * np.hypot(share, [relative[1], 0.0, relative[0]]),
        "ratio_relative_sigma": relative,
        "k_budget": [[one[1], np.nan, one[0]] for one in (beta_sigma / beta, np.full(3, mass), inertia, arm)],
    }


def published_factors(aligned: xr.Dataset, bin_s: float) -> dict:
    """Beta as the paper finds it: angular acceleration of the star tracker against noisy voltages, Kalman filter.

    Its sigma is the scatter of the estimate after convergence.

    Notes
    -----
    y = (wd_x, wd_y), H = (V_z1 - V_z2, V_x2 - V_x3), one filter each; Remote Sens. 2023, 15, 3817, eqs. 18-23.
    """
    first, last = float(aligned.start) - 5.0, float(aligned.stop) + 5.0
    reach = FILTER.window_s / 2 + 3 * bin_s
    edges = first - reach + bin_s * np.arange(np.floor((last - first + 2 * reach) / bin_s) + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    volt = bins.bin_means(aligned.time.values, electrodes.readouts(aligned.volts.values)[:, 3:], edges)[0]
    attitude = bins.mean_attitude(aligned.time_att.values, aligned.quaternion.values, edges)
    good = np.isfinite(attitude).all(axis=1)
    attitude = np.where(good[:, None], attitude, [1.0, 0.0, 0.0, 0.0])
    rate_dot = np.full((middle.size, 3), np.nan)
    rate_dot[1:-1] = np.diff(frames.attitude_error(attitude[1:], attitude[:-1]) / bin_s, axis=0) / bin_s
    inside = (middle >= first) & (middle <= last)
    operator = crn.operator(FILTER, 0, np.ones(middle.size, dtype=bool), (middle[0], bin_s), middle[inside])
    filtered = [operator(np.nan_to_num(values)) for values in (rate_dot, volt)]
    line = np.linalg.qr(np.stack([np.ones(len(filtered[0])), np.linspace(-1, 1, len(filtered[0]))], axis=1))[0]
    y, h = (values - line @ (line.T @ values) for values in filtered)
    (x, x_sigma), (y, y_sigma) = (_recursive(y[:, axis], h[:, axis]) for axis in (0, 1))
    return {"beta": np.array([x, y, y]), "beta_sigma": np.array([x_sigma, y_sigma, y_sigma])}


def _recursive(y, h):
    """Last value of the filter and the standard deviation of its second half; start and R from batch least squares."""
    batch = (h @ y) / (h @ h)
    noise = np.var(y - h * batch)
    run = kalman.filter_constants(y, h[:, None], np.array([batch]), np.array([[noise / (h @ h)]]), noise)
    return float(run.value[-1, 0]), float(np.std(run.value[y.size // 2 :, 0]))


def filtered_readouts(aligned: xr.Dataset) -> tuple[float, np.ndarray, np.ndarray]:
    """Sampling s, and the six readouts (n, 6) V before and after the CRN filter of the published method; no means."""
    time = aligned.time.values
    step = float(np.median(np.diff(time)))
    readout = electrodes.readouts(aligned.volts.values)
    readout = readout - readout.mean(axis=0)
    grid = time[0] + step * np.arange(time.size)
    after = crn.operator(FILTER, 0, np.ones(time.size, dtype=bool), (time[0], step), grid)(readout)
    inside = np.isfinite(after).all(axis=1)
    return step, readout[inside], after[inside]


def published_offset_matrix(rate_b, rate_dot_b, gradient_b):  # noqa: ARG001 - the printed form drops the gradient
    """Matrix A (..., 3, 3) s-2 of eq. 13 as printed: element (3,1) of wrong sign (erratum T-1), no gravity gradient."""
    matrix = rotation_tensor(rate_b, rate_dot_b)
    matrix[..., 2, 0] += 2 * np.asarray(rate_dot_b)[..., 1]
    return matrix
