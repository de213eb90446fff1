"""Angular and linear scale factors, tracker delay and offset from a swing, also as the paper prints them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.causes import on_axes
from gravcal.calibrations.inertial_sensor import align, model
from gravcal.calibrations.inertial_sensor.align import SCHEMAS
from gravcal.calibrations.inertial_sensor.noise import of_tracker, quiet_blocks, quiet_edges, spectra_of
from gravcal.calibrations.schemas import build
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import crn, least_squares
from gravcal.estimation import estimate as estimating
from gravcal.estimation.noise import NoiseModel, whiten
from gravcal.estimation.resampling import bin_means
from gravcal.physics import frames, gravity, sensing

LATE_S = 10.0  # tags that are off by more are no delay of the tracker
EDGE = 5.0  # s fitted before the first and after the last reversal
ARMS_X = (8.00e-3, 10.45e-3)  # m, erratum T-5: Table 1 prints the first, every ratio of Table 4 follows the second
CAUSES = ("beta", "mass", "inertia", "arm")  # of the errors of k_x and k_z
FILTER = crn.Crn(window_s=30.0, bandwidth_hz=0.1, convolutions=5)  # of the published method
CHOICES = ((0, 1, 2), (0, 2))  # linear axes used: all, and without a_y, whose factor is that of the ground
ROUNDS = 4  # of a fit that converges in three
#: What a factor scales, angular accelerations and linear readings by axis: beta_x acts on w'_x and k_z together,
#: beta_y on w'_y, w'_z and k_x (erratum T-11); the ratios are J/(M l).
FACTORS = {
    "beta_x": ([1, 0, 0], [0, 0, 1]),
    "beta_y": ([0, 1, 1], [1, 0, 0]),
    "ratio_x": ([0, 0, 0], [0, 0, 1]),
    "ratio_y": ([0, 0, 0], [1, 0, 0]),
    "k_y": ([0, 0, 0], [0, 1, 0]),
}


def estimate(
    rate_b: np.ndarray,
    rate_dot_b: np.ndarray,
    gradient_b: np.ndarray,
    linear_volt: np.ndarray,
    time: np.ndarray,
    noise: Sequence[NoiseModel],
    scale: Sequence[float],
    drift_degree: int = 3,
) -> estimating.Estimate:
    """Vector from the centre of mass to the test mass, scale factors held.

    Parameters
    ----------
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2
    gradient_b : (n, 3, 3) s-2, dg/dr
    linear_volt : (n, 3) V, linear readouts (`gravcal.effects.inertial_sensor.readouts`), NaN where missing
    time : (n,) s, evenly spaced
    noise : three NoiseModel of the readouts, V
    scale : (3,) m s-2 V-1, k of f = b + k V
    drift_degree : of the polynomial per axis that stands for bias, drag and radiation pressure

    Returns
    -------
    estimate : Estimate of x, y, z in m; the errors of the scale factors are not in it

    Notes
    -----
    k V = -b + a_ng + (M - G) p; Remote Sens. 2023, 15, 3817, eq. 12 with the gravity gradient it drops.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import inertial_sensor
    >>> from gravcal.estimation.noise import fit_noise
    >>> from gravcal.physics.sensing import offset_tensor
    >>> rng, time = np.random.default_rng(3), 0.1 * np.arange(2000)
    >>> noise = [fit_noise([1e-6 * rng.standard_normal(3000)], 1, 0.1) for _ in range(3)]
    >>> phase = 2 * np.pi * time / 27
    >>> rate_dot = 1e-4 * np.stack([np.sin(phase), np.cos(phase), np.sin(phase)], axis=1)
    >>> still, gradient = np.zeros((2000, 3)), np.zeros((2000, 3, 3))
    >>> scale = np.array([5.4e-4, 2.7e-4, 1.1e-4])
    >>> volt = offset_tensor(still, rate_dot, gradient) @ [-140e-6, 628e-6, -896e-6] / scale
    >>> volt += 0.1 + 1e-6 * rng.standard_normal(volt.shape)
    >>> offset = inertial_sensor.estimate(still, rate_dot, gradient, volt, time, noise, scale)
    >>> bool(np.all(np.abs(offset.value - [-140e-6, 628e-6, -896e-6]) < 4 * offset.sigma))
    True
    """
    time = np.asarray(time, dtype=float)
    tensor = sensing.offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    columns = tensor / np.asarray(scale, dtype=float)[:, None]
    drift = least_squares.polynomial(time, drift_degree, time[0], time[-1])
    return estimating.estimate(linear_volt, columns, noise, drift, ("x", "y", "z"), "m")


def scale(
    aligned: xr.Dataset, *, method, bin_s, quiet_margin_s, first_beta, arm_x_mm, k_y, k_y_sigma, geometry
) -> xr.Dataset:
    """Product "inertial_sensor.scale" of one swing, by the method "gravcal" or "published".

    first_beta (2,) rad s-2 V-1 is where the fit starts, about x and about y and z; k_y m s-2 V-1 is taken as it is;
    geometry holds "mass" kg, "inertia" kg m2, "arm" m, and each with "_sigma".
    """
    late = align.late(aligned)
    if abs(late) > LATE_S:
        lateness = f"attitudes tagged {late} s late against the voltages"
        expected = f"at most {LATE_S:.0f} s, for one is integrated to the other"
        remedy = "Correct the tags of one file."
        refuse(f"swing from {float(aligned.start):.0f} s", lateness, expected, remedy, EstimationError, late_s=late)
    prepared = swing_of(aligned, bin_s, quiet_margin_s, np.array(geometry["inertia"]))
    fitted = model.fit(prepared, np.array(first_beta, dtype=float))
    sigma = np.sqrt(np.diag(fitted.covariance))
    start = least_squares.free_start(fitted.design, 1.0)
    run = least_squares.filter_constants(fitted.observed, fitted.design, np.zeros(len(start)), start, 1.0)
    last = np.maximum(np.cumsum(np.where(fitted.system.count > 0, 3, 0)) - 1, 0)  # row of each bin
    values = _motion(prepared, fitted) | {
        "beta": fitted.unknowns.factors[model.OWNER],
        "beta_sigma": sigma[model.OWNER],
        "delay": fitted.unknowns.delay,
        "delay_sigma": sigma[model.FACTORS],
        "covariance": fitted.covariance[:3, :3],
        "tracker_sigma": np.sqrt(prepared.tracker_variance),
        "voltage_density": np.sqrt(2 * bin_s * prepared.voltage_variance),
        "chi2": fitted.chi2,
        "dof": fitted.dof,
        "filter_value": run.value[last, : model.FACTORS + 1],
        "filter_sigma": run.sigma[last, : model.FACTORS + 1],
        "batch_value": np.append(fitted.unknowns.factors, fitted.unknowns.delay),
        "arm_x": ARMS_X,
        "chosen_arm": np.argmin(np.abs(np.array(ARMS_X) - arm_x_mm * 1e-3)),
    }
    printed = method == "published"
    values |= published_factors(aligned, bin_s) if printed else {}
    values |= linear_factors(values["beta"], values["beta_sigma"], geometry, (k_y, k_y_sigma), printed)
    return build(SCHEMAS["scale"], values, method=method, estimated="beta_x beta_y delay", causes=" ".join(CAUSES))


def swing_of(aligned: xr.Dataset, bin_s: float, quiet_margin_s: float, inertia: np.ndarray) -> model.Swing:
    """Swing with its noise measured in quiet data either side, an EstimationError without; settings as of `scale`."""
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
        bins, remedy = f"{sum(map(len, quiet))} quiet bins beside it", "Give a longer record, or lower quiet_margin_s."
        expected = "at least 300 s either side to measure the noise"
        refuse(f"swing from {start:.0f} s", bins, expected, remedy, EstimationError)
    calm = (time_att < start - quiet_margin_s) | (time_att > stop + quiet_margin_s)
    turn, step_att = frames.attitude_error(quaternion[1:], quaternion[:-1]), np.diff(time_att)
    turn[~((np.abs(step_att - np.median(step_att)) < 1e-3) & calm[1:] & calm[:-1])] = np.nan
    angle = np.nancumsum(turn, axis=0) + 0 * turn
    tracker = [bin_means(time_att[1:], angle, one) for one in quiet_edges(aligned, bin_s, quiet_margin_s)]
    variance_att = align.scatter_of_third_differences(angle)
    return model.Swing(
        time=time[part],
        angular_volt=readout[part],
        time_att=time_att[part_att],
        quaternion=quaternion[part_att],
        edges=edges,
        position_i=aligned.position_i.values[part],
        inertia=inertia,
        voltage_variance=variance,
        tracker_variance=variance_att,
        tracker_noise=of_tracker(tracker, variance_att, edges.size - 1, bin_s),
    )


def _motion(prepared, fitted):
    """Bin means (b, 3) of the fitted motion, residual, and measured angle for the figures, {variable: array}."""
    motion, edges, system = fitted.motion, prepared.edges, fitted.system
    residual = np.full(system.valid.size, np.nan)
    residual[system.valid] = system.residual
    residual = residual.reshape(-1, 3)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    gradient = gravity.rotate_tensor(R_bi, gravity.gradient_i(prepared.position_i))
    rate, rate_dot, gradient, volt = (
        bin_means(prepared.time, values, edges)[0]
        for values in (motion.rate_b, motion.rate_dot_b, gradient, prepared.angular_volt)
    )
    angle = np.cumsum(rate - rate.mean(axis=0), axis=0) * (edges[1] - edges[0])
    return {
        "time_bin": prepared.middle,
        "residual_b": residual,
        "angle_b": angle - angle.mean(axis=0) + np.nan_to_num(residual),
        "rate_b": rate,
        "rate_dot_b": rate_dot - fitted.unknowns.factors[model.OWNER] * system.voltage_noise,
        "gradient_b": gradient,
        "angular_volt": volt,
    }


def linear_factors(beta, beta_sigma, geometry: Mapping, k_y: tuple[float, float], printed: bool) -> dict:
    """Linear factors and their errors for both arms about x.

    Beta (3,) is rad s-2 V-1, k_y value and sigma in m s-2 V-1, not tied to any angular factor; printed: eqs. 8-10 as
    printed. k, k_sigma, k_sigma_total are (2, 3) m s-2 V-1, k_budget (4, 3) relative errors of k by CAUSES, NaN for y.

    Notes
    -----
    k_x = beta_y J_y/(M l), k_z = beta_x J_x/(M l); errata T-4 to T-6.
    """
    arms = [np.array([arm, *geometry["arm"][1:]]) for arm in ARMS_X]
    factor = 2 if printed else 1  # the printed 1/2 in beta makes k twice too large
    ratio = [factor * electrodes.linear_over_angular(geometry["mass"], geometry["inertia"], arm) for arm in arms]
    mass, inertia, arm = (np.array(geometry[f"{n}_sigma"]) / geometry[n] for n in ("mass", "inertia", "arm"))
    relative = np.sqrt(mass**2 + inertia**2 + arm**2)
    k = np.array([[one[1] * beta[1], k_y[0], one[0] * beta[0]] for one in ratio])
    share = np.abs([beta_sigma[1] / beta[1], k_y[1] / k_y[0], beta_sigma[0] / beta[0]])
    return {
        "k": k,
        "k_sigma": np.abs(k) * share,
        "k_sigma_total": np.abs(k) * np.hypot(share, [relative[1], 0.0, relative[0]]),
        "ratio_relative_sigma": relative,
        "k_budget": [[one[1], np.nan, one[0]] for one in (np.abs(beta_sigma / beta), np.full(3, mass), inertia, arm)],
    }


def published_factors(aligned: xr.Dataset, bin_s: float) -> dict:
    """Published {"beta", "beta_sigma": (3,)}: tracker angular acceleration against noisy voltages, Kalman filter.

    Its sigma is the scatter of the estimate after convergence. y = (wd_x, wd_y), H = (V_z1 - V_z2, V_x2 - V_x3), one
    filter each; Remote Sens. 2023, 15, 3817, eqs. 18-23.
    """
    first, last = float(aligned.start) - 5.0, float(aligned.stop) + 5.0
    reach = FILTER.window_s / 2 + 3 * bin_s
    edges = first - reach + bin_s * np.arange(np.floor((last - first + 2 * reach) / bin_s) + 1)
    middle = (edges[1:] + edges[:-1]) / 2
    volt = bin_means(aligned.time.values, electrodes.readouts(aligned.volts.values)[:, 3:], edges)[0]
    attitude = align.mean_attitude(aligned.time_att.values, aligned.quaternion.values, edges)
    good = np.isfinite(attitude).all(axis=1)
    attitude = frames.interpolate(middle[good], attitude[good], np.clip(middle, *middle[good][[0, -1]]))
    rate_dot = np.full((middle.size, 3), np.nan)
    rate_dot[1:-1] = np.diff(frames.attitude_error(attitude[1:], attitude[:-1]) / bin_s, axis=0) / bin_s
    inside = (middle >= first) & (middle <= last)
    operator = crn.operator(FILTER, 0, np.ones(middle.size, dtype=bool), (middle[0], bin_s), middle[inside])
    filtered = [operator(np.nan_to_num(values)) for values in (rate_dot, volt)]
    trend = np.linalg.qr(np.stack([np.ones(len(filtered[0])), np.linspace(-1, 1, len(filtered[0]))], axis=1))[0]
    y, h = (values - trend @ (trend.T @ values) for values in filtered)
    beta, sigma = np.zeros(2), np.zeros(2)
    for axis, (one, column) in enumerate(zip(y.T[:2], h.T[:2], strict=True)):
        batch = (column @ one) / (column @ column)  # start and R from batch least squares
        noise = np.var(one - column * batch)
        start = np.array([batch]), np.array([[noise / (column @ column)]])
        run = least_squares.filter_constants(one, column[:, None], *start, noise).value[:, 0]
        beta[axis], sigma[axis] = run[-1], np.std(run[one.size // 2 :])
    return {"beta": beta[model.OWNER], "beta_sigma": sigma[model.OWNER]}


def filtered_readouts(aligned: xr.Dataset) -> tuple[float, np.ndarray, np.ndarray]:
    """Sampling s, and the six readouts (n, 6) V less means, before and after the CRN filter of the published method."""
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
    matrix = sensing.rotation_tensor(rate_b, rate_dot_b)
    matrix[..., 2, 0] += 2 * np.asarray(rate_dot_b)[..., 1]
    return matrix


@dataclass(frozen=True)
class Record:
    """Bin means of a swing."""

    time: np.ndarray  # (b,) s
    linear_volt: np.ndarray  # (b, 3) V, linear readouts
    rate_b: np.ndarray  # (b, 3) rad s-1
    rate_dot_b: np.ndarray  # (b, 3) rad s-2
    gradient_b: np.ndarray  # (b, 3, 3) s-2
    noise: tuple[NoiseModel, NoiseModel, NoiseModel]  # of linear_volt, V
    degree: int  # of the polynomial that stands for bias, drag and radiation

    @property
    def trend(self) -> np.ndarray:
        """(b, degree + 1) columns of bias, drag and radiation."""
        return least_squares.polynomial(self.time, self.degree, self.time[0], self.time[-1])


def offset(aligned: xr.Dataset, scaled: xr.Dataset, *, method, quiet_margin_s, drift_degree, noise_order) -> xr.Dataset:
    """Product "inertial_sensor.offset" of one swing, from its "align" and "scale"; method "gravcal" or "published"."""
    record = record_of(aligned, scaled, quiet_margin_s, drift_degree, noise_order)
    k = scaled.k.values[int(scaled.chosen_arm)]
    tensor = published_offset_matrix if method == "published" else sensing.offset_tensor
    beta_error, ratio_error = scaled.beta_sigma.values / scaled.beta.values, scaled.ratio_relative_sigma.values
    relative = np.array([*beta_error[:2], *ratio_error[:2], scaled.k_sigma.values[0, 1] / scaled.k.values[0, 1]])
    fits = [fit_offset(record, k, axes, tensor) for axes in CHOICES]
    shift = np.array([shifts(record, k, axes) * relative[:, None] for axes in CHOICES])
    covariance = np.array([one.covariance for one in fits])
    total = covariance + np.einsum("cqi,cqj->cij", shift, shift)
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    good = np.isfinite(record.linear_volt).all(axis=1) & np.isfinite(columns).all(axis=(1, 2))
    rows = np.concatenate([record.linear_volt[:, :, None], columns / k[:, None], on_axes(record.trend)], axis=2)
    white = np.stack([whiten(model, rows[:, a], good) for a, model in enumerate(record.noise)], axis=1)
    white = white.reshape(-1, rows.shape[2])
    observed, design = white[:, 0], white[:, 1:]
    start, last_row = least_squares.free_start(design, 1.0), np.arange(record.time.size) * 3 + 2  # of a bin
    run = least_squares.filter_constants(observed, design, np.zeros(design.shape[1]), start, 1.0)
    factor, factor_sigma, factor_total = factor_y(record, k, relative[:4])
    values = {
        "offset": [one.value for one in fits],
        "covariance": covariance,
        "covariance_total": total,
        "adopted": np.argmin(np.trace(total, axis1=1, axis2=2)),
        "shift": shift,
        "k_y": factor,
        "k_y_sigma": factor_sigma,
        "k_y_sigma_total": factor_total,
        "chi2": fits[0].chi2,
        "dof": fits[0].dof,
        "noise_density": [np.sqrt(2 * n.step_s * n.variance[-1]) for n in record.noise],
        "time_bin": record.time,
        "reading": least_squares.project_out(record.trend, np.nan_to_num(k * record.linear_volt)),
        "model": least_squares.project_out(record.trend, np.matvec(columns, fits[0].value)),
        "filter_value": run.value[last_row, :3],
        "filter_sigma": run.sigma[last_row, :3],
    }
    return build(SCHEMAS["offset"], values, causes=" ".join(FACTORS), direction="com_to_test_mass", method=method)


def record_of(aligned: xr.Dataset, scaled: xr.Dataset, quiet_margin_s: float, degree: int, order: int) -> Record:
    """Bin means of the linear readouts and the motion, with the noise of the quiet data; settings as of `offset`."""
    time_bin = scaled.time_bin.values
    step = float(time_bin[1] - time_bin[0])
    edges = np.append(time_bin - step / 2, time_bin[-1] + step / 2)
    readout = electrodes.readouts(aligned.volts.values)[:, :3]
    spectra = spectra_of(quiet_blocks(aligned, readout, step, quiet_margin_s), step)
    return Record(
        time=time_bin,
        linear_volt=bin_means(aligned.time.values, readout, edges)[0],
        rate_b=scaled.rate_b.values,
        rate_dot_b=scaled.rate_dot_b.values,
        gradient_b=scaled.gradient_b.values,
        noise=tuple(one.model(order, step) for one in spectra),
        degree=degree,
    )


def fit_offset(
    record: Record, k: np.ndarray, axes: tuple[int, ...] = CHOICES[0], tensor=sensing.offset_tensor
) -> estimating.Estimate:
    """Least squares for the offset, with k (3,) m s-2 V-1 held, by the readings of some axes.

    k V = -b + a_ng + (M - G) p; Remote Sens. 2023, 15, 3817, eq. 12 with the gravity gradient it drops.
    """
    volts = np.where(np.isin(range(3), axes), record.linear_volt, np.nan)
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b) / np.asarray(k)[:, None]
    return _finite(estimating.estimate(volts, columns, record.noise, record.trend, ("x", "y", "z"), "m"))


def _finite(solution):
    """Estimate by pseudo-inverse: directions that nothing determines are zero, without error."""
    covariance = least_squares.stable_inverse(solution.information)
    return replace(solution, value=covariance @ solution.right, covariance=covariance)


def factor_y(record: Record, k: np.ndarray, relative: np.ndarray) -> tuple[float, float, float]:
    """Factor of a_y from the swing itself, its statistical and its total error, m s-2 V-1.

    a_x and a_z give p, above all p_z by a_x = w'_y p_z; a_y = -w'_x p_z then has one unknown, its factor. Nothing of
    the ground enters; ``relative`` (4,) are the errors of beta and J/(M l), the first of FACTORS.
    """
    value, sigma = _factor_y(record, k)
    moved = 1e4 * np.array([_factor_y(*one)[0] - value for one in _scaled(record, k)[:4]])
    return value, sigma, float(np.hypot(sigma, np.linalg.norm(moved * relative)))


def _factor_y(record, k):
    """k_y and its statistical error, m s-2 V-1: Gauss-Newton in p and 1/k_y, from p without a_y."""
    columns = sensing.offset_tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    place, inverse = fit_offset(record, k, CHOICES[1]).value, 1 / np.asarray(k, float)
    for _ in range(ROUNDS):
        term = np.matvec(columns, place)
        rows = np.concatenate([inverse[:, None] * columns, (term * [0, 1, 0])[:, :, None]], axis=2)
        residual, names = record.linear_volt - inverse * term, ("x", "y", "z", "1/k_y")
        step = _finite(estimating.estimate(residual, rows, record.noise, record.trend, names, "m, m, m, V s2 m-1"))
        place, inverse = place + step.value[:3], inverse + np.array([0, step.value[3], 0])
    return 1 / inverse[1], float(step.sigma[3]) / inverse[1] ** 2


def shifts(record: Record, k: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Derivative (5, 3) m of the offset by the relative size of each of FACTORS: refits with each 1e-4 larger."""
    middle = fit_offset(record, k, axes).value
    return 1e4 * np.array([fit_offset(*one, axes).value - middle for one in _scaled(record, k)])


def _scaled(record, k):
    """Pairs (record, k), one for each of FACTORS, in which that factor is larger by 1e-4."""
    rows = [(1 + 1e-4 * np.array(turn), 1 + 1e-4 * np.array(push)) for turn, push in FACTORS.values()]
    return [(replace(record, rate_dot_b=record.rate_dot_b * turn), k * push) for turn, push in rows]
