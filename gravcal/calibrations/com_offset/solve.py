"""Offset from one manoeuvre: the same operator on reading and columns, noise as measured in quiet data."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.noise import FREQUENCY, models_of
from gravcal.calibrations.com_offset.schemas import SOLVE
from gravcal.calibrations.com_offset.windows import operator_for
from gravcal.effects import Context, effect
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, fit_noise, whiten


def solve(
    aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset, measured: xr.Dataset, **settings
) -> xr.Dataset:
    """Offset, information and mode shifts of every manoeuvre for one angular acceleration.

    CoM paper eqs. 3-6 with generalised weights; erratum C-12 for the weights and the operator.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"
    measured : Dataset, "com_offset.noise"
    settings : lowpass_hz, half_width_s, step_s, drift_degree, noise_order

    Returns
    -------
    solved : Dataset, "com_offset.solve"
    """
    noise = models_of(measured)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(aligned, smoothed, angular, i, settings) for i in range(aligned.sizes["manoeuvre"])]
    if not noise:
        white = [NoiseModel(np.zeros(0), np.array([1e-18]), settings["step_s"])] * 3
        noise = residual_noise(blocks, [_solve_block(b, white) for b in blocks], settings)
    solved = [_solve_block(b, noise) for b in blocks]
    values = _values(blocks, solved) | {n: angular[n].values for n in ("mode_shared", "mode_catalogue")}
    values |= {n: aligned[n].values for n in ("kind", "start", "stop")}
    values |= {"frequency": FREQUENCY, "noise_density": np.array([n.density(FREQUENCY) for n in noise]).reshape(3, -1)}
    attrs = {"variant": angular.attrs["variant"], "direction": "proof_mass_to_com", "noise_source": source}
    return build(SOLVE, values, **attrs)


def _block(aligned, smoothed, angular, index, settings):
    """Resampled reading, columns, instruments, modes and drift of one manoeuvre; None without samples."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"].values == index)
    if inside.size < 200:
        return None
    time = smoothed["time_acc"].values[inside]
    at = np.searchsorted(aligned["time_acc"].values, time)
    linear = aligned["linear_b"].values[at]
    value, modes = angular["rate_dot_b"].values[inside], angular["mode"].values[:, inside]
    good = (aligned["acc_flag"].values[at] == 0) & np.isfinite(linear).all(axis=1) & np.isfinite(value).all(axis=1)
    edges = _ends(aligned, smoothed, index)
    operator = operator_for(
        time,
        good,
        max(edges[0], time[0]),
        min(edges[1], time[-1]),
        settings["lowpass_hz"],
        settings["half_width_s"],
        settings["step_s"],
    )
    if operator.valid.sum() < 60:
        return None
    rate, gradient = smoothed["rate_b"].values[inside], smoothed["gradient_b"].values[inside]
    design = _columns(time, rate, np.nan_to_num(value), gradient)
    block = {
        "operator": operator,
        "reading": operator(np.nan_to_num(linear - linear[good].mean(axis=0))),
        "design": operator(design),
        "instruments": None,
        "modes": [operator(_columns(time, 0 * rate, m, 0 * gradient)) for m in modes],
        "drift": estimation.polynomial(operator.time, settings["drift_degree"], operator.time[0], operator.time[-1]),
    }
    if angular.attrs["noisy"]:
        clean = smoothed["rate_dot_mtq_b"].values[inside]
        block["instruments"] = operator(_columns(time, rate, clean, gradient))
    return block


def _ends(aligned, smoothed, index):
    """First and last edge as the accelerometer sees them."""
    count = int(np.isfinite(aligned["edge_lower"].values[index]).sum())
    late = np.nan_to_num(smoothed["acc_shift"].values[index])
    return (
        aligned["edge_upper"].values[index, 0] + max(late, 0.0),
        aligned["edge_lower"].values[index, count - 1] + min(late, 0.0),
    )


def _columns(time, rate, rate_dot, gradient):
    """Reading per metre of offset, (n, axis, component)."""
    context = Context(time=time, rate_b=rate, rate_dot_b=rate_dot, gradient_b=gradient)
    return effect("accelerometer.offset").columns(context)


def _solve_block(block, noise):
    """Whitened solution of one block with the shift of its modes."""
    if block is None:
        return None
    valid = block["operator"].valid
    y = np.concatenate([whiten(noise[a], block["reading"][:, a], valid) for a in range(3)])
    A = np.concatenate([whiten(noise[a], block["design"][:, a], valid) for a in range(3)])
    Z = None
    if block["instruments"] is not None:
        Z = np.concatenate([whiten(noise[a], block["instruments"][:, a], valid) for a in range(3)])
    width = block["drift"].shape[1]
    drift = np.zeros((y.size, 3 * width))
    for a in range(3):
        rows = slice(a * valid.size, (a + 1) * valid.size)
        drift[rows, a * width : (a + 1) * width] = whiten(noise[a], block["drift"], valid)
    estimate = estimation.solve(y, A, drift, Z)
    modes = [
        -estimate.gain @ np.concatenate([whiten(noise[a], m[:, a], valid) for a in range(3)]) @ estimate.value
        for m in block["modes"]
    ]
    information = estimate.information
    if Z is not None:
        information = information / (1 + _regressor_noise(A, Z, drift, estimate.value, valid))
    return {
        "value": estimate.value,
        "information": information,
        "modes": np.array(modes).reshape(-1, 3),
        "chi2": float(estimate.residual @ estimate.residual),
        "dof": int(3 * valid.sum() - 3 - 3 * width),
    }


def _regressor_noise(A, Z, drift, value, valid):
    """Variance that the noise of the columns adds to each whitened observation."""
    A, Z = estimation.without(drift, A), estimation.without(drift, Z)
    noisy = A - Z @ np.linalg.lstsq(Z, A, rcond=None)[0]
    return float(np.sum((noisy @ value) ** 2) / (3 * valid.sum()))


def residual_noise(blocks, solved, settings):
    """Noise from the residuals of a first solution, where quiet data are missing."""
    pieces = []
    for block, one in zip(blocks, solved, strict=True):
        if block is not None:
            pieces.append(_residual(block, one["value"]))
    removed = len(pieces) * (settings["drift_degree"] + 2)
    order = settings["noise_order"]
    return [fit_noise([p[:, a] for p in pieces], order, settings["step_s"], removed) for a in range(3)]


def _residual(block, value):
    """Reading minus model with its drift removed, on the resampled grid (n, 3)."""
    residual = block["reading"] - block["design"] @ value
    valid = block["operator"].valid
    residual[valid] = estimation.without(block["drift"][valid], residual[valid])
    return residual


def _values(blocks, solved):
    """Estimates of every manoeuvre and the series they come from, drift removed."""
    count = len(blocks)
    modes = len(next((s["modes"] for s in solved if s), ()))
    offset, information = np.full((count, 3), np.nan), np.zeros((count, 3, 3))
    shift, chi2, dof = np.zeros((count, modes, 3)), np.full(count, np.nan), np.zeros(count)
    time, series = [np.zeros(0)], {"reading": [np.zeros((0, 3))], "model": [np.zeros((0, 3))]}
    index = [np.zeros(0)]
    for i, (block, one) in enumerate(zip(blocks, solved, strict=True)):
        if one is None:
            continue
        offset[i], information[i], shift[i] = one["value"], one["information"], one["modes"]
        chi2[i], dof[i] = one["chi2"], one["dof"]
        valid = block["operator"].valid
        drift = block["drift"][valid]
        time.append(block["operator"].time[valid])
        series["reading"].append(estimation.without(drift, block["reading"][valid]))
        series["model"].append(estimation.without(drift, block["design"][valid] @ one["value"]))
        index.append(np.full(int(valid.sum()), i))
    joined = {n: np.concatenate(v) for n, v in series.items()}
    joined |= {"time_grid": np.concatenate(time), "grid_manoeuvre": np.concatenate(index)}
    return joined | {"offset": offset, "information": information, "mode_shift": shift, "chi2": chi2, "dof": dof}
