"""Stage `offset`: from the centre of mass to the test mass, by the common-mode voltages of a swing."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import (
    cleaning,
    offset_fit,
    published_swing,
    schemas,
)
from gravcal.calibrations.inertial_sensor.scale import quiet_blocks
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation import least_squares
from gravcal.estimation.noise import fit_noise
from gravcal.physics import sensing

CHOICES = ((0, 1, 2), (0, 2))  # linear axes used: all, and without a_y, whose factor nothing in orbit gives


def offset(aligned: xr.Dataset, scaled: xr.Dataset, *, method, quiet_margin_s, drift_degree, noise_order) -> xr.Dataset:
    """Offset of one swing.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"; scaled : Dataset, "inertial_sensor.scale"
    method : "gravcal" or "published"
    quiet_margin_s : s kept clear of the swing where the noise is measured
    drift_degree : of the polynomial that stands for bias, drag and radiation
    noise_order : of the autoregressive noise

    Returns
    -------
    found : Dataset, "inertial_sensor.offset"
    """
    record = prepare(aligned, scaled, quiet_margin_s, drift_degree, noise_order)
    k = scaled.k.values[int(scaled.chosen_arm)]
    tensor = published_swing.offset_matrix if method == "published" else sensing.offset_tensor
    relative = _relative(scaled)
    fits = [offset_fit.fit(record, k, axes, tensor) for axes in CHOICES]
    moved = [offset_fit.shifts(record, k, axes, relative) for axes in CHOICES]
    shift = np.array([[one[name] for name in relative] for one in moved])
    covariance = np.array([one.covariance for one in fits])
    total = covariance + np.einsum("cqi,cqj->cij", shift, shift)
    values = {
        "offset": [one.value for one in fits],
        "covariance": covariance,
        "covariance_total": total,
        "adopted": np.argmin(np.trace(total, axis1=1, axis2=2)),
        "shift": shift,
        "chi2": fits[0].chi2,
        "dof": fits[0].dof,
        "noise_density": [np.sqrt(2 * n.step_s * n.variance[-1]) for n in record.noise],
    }
    values |= _shown(record, k, fits[0], tensor) | _history(fits[0], record.time)
    return build(schemas.OFFSET, values, causes=" ".join(relative), direction="com_to_test_mass", method=method)


def prepare(aligned, scaled, quiet_margin_s: float, degree: int, order: int) -> offset_fit.Record:
    """Bin means of the linear readouts and the motion, with the noise of the quiet data.

    Parameters
    ----------
    aligned : Dataset, "inertial_sensor.align"; scaled : Dataset, "inertial_sensor.scale"
    quiet_margin_s : s; degree : of the polynomial; order : of the noise
    """
    time_bin = scaled.time_bin.values
    step = float(time_bin[1] - time_bin[0])
    readout = electrodes.readouts(aligned.volts.values)[:, :3]
    blocks = [_without_polynomial(block, 3) for block in quiet_blocks(aligned, readout, step, quiet_margin_s)]
    noise = tuple(_noise([b[:, axis] for b in blocks], order, step) for axis in range(3))
    edges = np.append(time_bin - step / 2, time_bin[-1] + step / 2)
    return offset_fit.Record(
        time=time_bin,
        linear_volt=cleaning.bin_means(aligned.time.values, readout, edges)[0],
        rate_b=scaled.rate_b.values,
        rate_dot_b=scaled.rate_dot_b.values,
        gradient_b=scaled.gradient_b.values,
        noise=noise,
        degree=degree,
    )


def _noise(blocks, order, step):
    """Noise of the order that the data ask for (Schwarz); white noise without the colour of its detrending."""
    models = [fit_noise(blocks, k, step, removed=4 * len(blocks)) for k in range(order + 1)]
    count = sum(int(np.count_nonzero(np.isfinite(block))) for block in blocks)
    cost = [count * np.log(model.variance[-1]) + k * np.log(max(count, 2)) for k, model in enumerate(models)]
    return models[int(np.argmin(cost))]


def _without_polynomial(block, degree):
    """Columns with a polynomial of the index taken off, NaN rows kept."""
    good = np.isfinite(block).all(axis=1)
    basis = np.polynomial.legendre.legvander(np.linspace(-1, 1, good.size), degree)
    out = np.full_like(block, np.nan)
    out[good] = least_squares.without(basis[good], block[good])
    return out


def _relative(scaled):
    """Relative errors that the offset inherits."""
    beta = scaled.beta_sigma.values / scaled.beta.values
    ratio = scaled.ratio_relative_sigma.values
    return {
        "beta_x": beta[0],
        "beta_y": beta[1],
        "ratio_x": ratio[0],
        "ratio_y": ratio[1],
        "k_y": float(scaled.k_sigma[0, 1] / scaled.k[0, 1]),
    }


def _shown(record, k, fitted, tensor):
    """Reading and model with the slow part removed, for the figures."""
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    trend = least_squares.polynomial(record.time, record.degree, record.time[0], record.time[-1])
    reading = np.nan_to_num(k * record.linear_volt)
    return {
        "time_bin": record.time,
        "reading": least_squares.without(trend, reading),
        "model": least_squares.without(trend, np.matvec(columns, fitted.value)),
    }


def _history(fitted, time):
    """Kalman estimates after each bin."""
    run = offset_fit.filtered(fitted)
    rows = np.arange(time.size) * 3 + 2
    return {"filter_value": run.value[rows, :3], "filter_sigma": run.sigma[rows, :3]}
