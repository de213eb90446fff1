"""Stage `offset`: from the centre of mass to the test mass, by the common-mode voltages of a swing.

The angular acceleration is the sensor's own, with the voltage noise that the star tracker shows taken out of it. The
vector points from the centre of mass to the test mass (the published design matrix says so, erratum T-2).
"""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import bins
from gravcal.calibrations.inertial_sensor.scale import published_offset_matrix, quiet_blocks
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation import kalman, least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.physics import sensing

SCHEMAS = schemas.of("inertial_sensor.toml")

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


@dataclass(frozen=True)
class Offset:
    """Offset (3,) m with covariance (3, 3) m2, scale factors held; chi2, dof.

    `observed` (3 b,) and `design` (3 b, p) are the whitened rows in order of time, polynomials included.
    """

    value: np.ndarray
    covariance: np.ndarray
    chi2: float
    dof: int
    observed: np.ndarray
    design: np.ndarray


def offset(aligned: xr.Dataset, scaled: xr.Dataset, *, method, quiet_margin_s, drift_degree, noise_order) -> xr.Dataset:
    """Offset of one swing.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"; scaled : Dataset, "inertial_sensor.scale"
    method : "gravcal" or "published"
    quiet_margin_s : s kept clear of the swing where the noise is measured
    drift_degree : of the polynomial that stands for bias, drag and radiation
    noise_order : of the autoregressive noise, at most
    """
    record = prepare(aligned, scaled, quiet_margin_s, drift_degree, noise_order)
    k = scaled.k.values[int(scaled.chosen_arm)]
    tensor = published_offset_matrix if method == "published" else sensing.offset_tensor
    beta, ratio = scaled.beta_sigma.values / scaled.beta.values, scaled.ratio_relative_sigma.values
    relative = np.array([*beta[:2], *ratio[:2], scaled.k_sigma.values[0, 1] / scaled.k.values[0, 1]])
    fits = [fit(record, k, axes, tensor) for axes in CHOICES]
    shift = np.array([shifts(record, k, axes) * relative[:, None] for axes in CHOICES])
    covariance = np.array([one.covariance for one in fits])
    total = covariance + np.einsum("cqi,cqj->cij", shift, shift)
    run, rows = _filtered(fits[0]), np.arange(record.time.size) * 3 + 2
    factor, factor_sigma, factor_total = factor_y(record, k, relative[:4])
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
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
        "reading": least_squares.without(record.trend, np.nan_to_num(k * record.linear_volt)),
        "model": least_squares.without(record.trend, np.matvec(columns, fits[0].value)),
        "filter_value": run.value[rows, :3],
        "filter_sigma": run.sigma[rows, :3],
    }
    return build(SCHEMAS["offset"], values, causes=" ".join(FACTORS), direction="com_to_test_mass", method=method)


def prepare(aligned: xr.Dataset, scaled: xr.Dataset, quiet_margin_s: float, degree: int, order: int) -> Record:
    """Bin means of the linear readouts and the motion, with the noise of the quiet data; settings as of `offset`."""
    time_bin = scaled.time_bin.values
    step = float(time_bin[1] - time_bin[0])
    edges = np.append(time_bin - step / 2, time_bin[-1] + step / 2)
    readout = electrodes.readouts(aligned.volts.values)[:, :3]
    return Record(
        time=time_bin,
        linear_volt=bins.bin_means(aligned.time.values, readout, edges)[0],
        rate_b=scaled.rate_b.values,
        rate_dot_b=scaled.rate_dot_b.values,
        gradient_b=scaled.gradient_b.values,
        noise=noise_models(quiet_blocks(aligned, readout, step, quiet_margin_s), order, step),
        degree=degree,
    )


def noise_models(blocks: list[np.ndarray], order: int, step_s: float) -> tuple[NoiseModel, NoiseModel, NoiseModel]:
    """Noise of each axis of quiet blocks (n, 3), of the order that the data ask for (Schwarz), at most a given one."""
    chosen = []
    for axis in range(3):
        rows = [block[:, axis] for block in blocks]
        models = [fit_noise(rows, k, step_s, removed=4 * len(rows)) for k in range(order + 1)]
        count = sum(int(np.count_nonzero(np.isfinite(one))) for one in rows)
        cost = [count * np.log(model.variance[-1]) + k * np.log(max(count, 2)) for k, model in enumerate(models)]
        chosen.append(models[int(np.argmin(cost))])
    return tuple(chosen)


def fit(record: Record, k: np.ndarray, axes: tuple[int, ...] = CHOICES[0], tensor=sensing.offset_tensor) -> Offset:
    """Least squares for the offset, with k (3,) m s-2 V-1 held, by the readings of some axes.

    Notes
    -----
    k V = -b + a_ng + (M - G) p; Remote Sens. 2023, 15, 3817, eq. 12 with the gravity gradient it drops.
    """
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    good = np.isfinite(record.linear_volt).all(axis=1) & np.isfinite(columns).all(axis=(1, 2))
    trend = record.trend
    count, width = trend.shape
    whitened = np.zeros((3, count, 4 + width))  # reading, offset, trend of each axis
    for axis in axes:
        rows = np.c_[record.linear_volt[:, axis], columns[:, axis] / k[axis], trend]
        whitened[axis] = whiten(record.noise[axis], rows, good)
    reading, place, trends = np.split(whitened, [1, 4], axis=2)
    clean = np.concatenate([least_squares.without(t, a) for t, a in zip(trends, place, strict=True)])
    covariance = least_squares.stable_inverse(clean.T @ clean)
    value = covariance @ (clean.T @ reading.reshape(-1))
    left = reading[:, :, 0] - place @ value
    residual = np.array([least_squares.without(t, r) for t, r in zip(trends, left, strict=True)])
    design = np.zeros((count, 3, 3 + 3 * width))
    design[:, :, :3] = place.transpose(1, 0, 2)
    for axis in range(3):
        design[:, axis, 3 + axis * width : 3 + (axis + 1) * width] = trends[axis]
    return Offset(
        value,
        covariance,
        chi2=float(np.sum(residual**2)),
        dof=len(axes) * (int(np.count_nonzero(good)) - width) - 3,
        observed=reading[:, :, 0].T.reshape(-1),
        design=design.reshape(3 * count, -1),
    )


def factor_y(record: Record, k: np.ndarray, relative: np.ndarray) -> tuple[float, float, float]:
    """Factor of a_y from the swing itself, its statistical and its total error, m s-2 V-1.

    a_x and a_z give p, above all p_z by a_x = w'_y p_z; a_y = -w'_x p_z then has one unknown, its factor. Nothing of
    the ground enters; ``relative`` (4,) are the errors of beta and J/(M l), the first of FACTORS.
    """
    value, sigma = _factor_y(record, k)
    moved = []
    for turn, push in list(FACTORS.values())[:4]:
        scaled = replace(record, rate_dot_b=record.rate_dot_b * (1 + 1e-4 * np.array(turn)))
        moved.append(1e4 * (_factor_y(scaled, k * (1 + 1e-4 * np.array(push)))[0] - value))
    return value, sigma, float(np.hypot(sigma, np.linalg.norm(np.array(moved) * relative)))


def _factor_y(record, k):
    """Value and statistical error: Gauss-Newton in p and 1/k_y, from p without a_y."""
    columns = sensing.offset_tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    good = np.isfinite(record.linear_volt).all(axis=1) & np.isfinite(columns).all(axis=(1, 2))
    place, inverse = fit(record, k, CHOICES[1]).value, 1 / np.asarray(k, float)
    for _ in range(ROUNDS):
        term = np.matvec(columns, place)
        parts = []
        for axis in range(3):
            own = term[:, axis, None] * (axis == 1)
            left = record.linear_volt[:, axis] - inverse[axis] * term[:, axis]
            rows = whiten(record.noise[axis], np.c_[left, inverse[axis] * columns[:, axis], own, record.trend], good)
            parts.append(least_squares.without(rows[:, 5:], rows[:, :5]))
        clean = np.concatenate(parts)
        covariance = least_squares.stable_inverse(clean[:, 1:].T @ clean[:, 1:])
        step = covariance @ (clean[:, 1:].T @ clean[:, 0])
        place, inverse = place + step[:3], inverse + np.array([0, step[3], 0])
    return 1 / inverse[1], float(np.sqrt(covariance[3, 3])) / inverse[1] ** 2


def _filtered(fitted):
    """The same offset by the Kalman filter, polynomials in its state."""
    used = fitted.design[:, np.any(fitted.design != 0, axis=0)]
    start = kalman.free_start(used, 1.0)
    return kalman.filter_constants(fitted.observed, used, np.zeros(used.shape[1]), start, 1.0)


def shifts(record: Record, k: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Derivative (5, 3) m of the offset by the relative size of each of FACTORS."""
    middle, change = fit(record, k, axes).value, []
    for turn, push in FACTORS.values():
        scaled = replace(record, rate_dot_b=record.rate_dot_b * (1 + 1e-4 * np.array(turn)))
        change.append(fit(scaled, k * (1 + 1e-4 * np.array(push)), axes).value - middle)
    return 1e4 * np.array(change)
