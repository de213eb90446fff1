"""Offset from one manoeuvre: the same operator on reading and columns, noise as measured in quiet data."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset.windows import operator_for
from gravcal.effects import Context, effect
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, fit_noise, whiten
from gravcal.methods.resampling import lowpass_resampler

#: Shortest quiet data from which the noise is measured.
QUIET_S = 300.0


def quiet_noise(aligned: xr.Dataset, settings: dict) -> tuple[list[NoiseModel], float]:
    """Noise of the linear channels outside the manoeuvres.

    Parameters
    ----------
    aligned : Dataset, "align"
    settings : lowpass_hz, half_width_s, step_s, drift_degree, noise_order, quiet_margin_s

    Returns
    -------
    noise : model of each axis, on the grid of the solution
    seconds : length of the quiet data used
    """
    time, linear = aligned["acc_time"].values, aligned["linear_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(linear).all(axis=1)
    pieces = [_quiet_piece(time, linear, good, *ends, settings) for ends in _quiet_spans(aligned, settings)]
    pieces = [p for p in pieces if p is not None]
    seconds = settings["step_s"] * sum(int(np.isfinite(p[:, 0]).sum()) for p in pieces)
    removed = len(pieces) * (settings["drift_degree"] + 1)
    if seconds < QUIET_S:
        return [], seconds
    order = settings["noise_order"]
    return [fit_noise([p[:, a] for p in pieces], order, settings["step_s"], removed) for a in range(3)], seconds


def _quiet_spans(aligned, settings):
    """Pieces as long as a manoeuvre, inside the windows and clear of every manoeuvre."""
    start, stop = aligned["start"].values, aligned["stop"].values
    margin = settings["quiet_margin_s"]
    for window_start, window_stop, length in zip(
        aligned["window_start"].values, aligned["window_stop"].values, stop - start, strict=True
    ):
        busy = [(a - margin, b + margin) for a, b in zip(start, stop, strict=True)]
        begin = window_start
        while begin + length <= window_stop:
            hit = [b for a, b in busy if a < begin + length and b > begin]
            if hit:
                begin = max(hit)
                continue
            yield begin, begin + length
            begin += length


def _quiet_piece(time, linear, good, begin, end, settings):
    inside = slice(*np.searchsorted(time, [begin, end]))
    if inside.stop - inside.start < 200:
        return None
    grid = np.arange(np.ceil(begin / settings["step_s"]), np.floor(end / settings["step_s"])) * settings["step_s"]
    operator = lowpass_resampler(
        time[inside], good[inside], grid, lowpass_hz=settings["lowpass_hz"], half_width_s=settings["half_width_s"]
    )
    if operator.valid.sum() < 100:
        return None
    values = operator(linear[inside] - linear[inside][good[inside]].mean(axis=0))
    drift = estimation.polynomial(grid, settings["drift_degree"], grid[0], grid[-1])[operator.valid]
    values[operator.valid] = estimation.without(drift, values[operator.valid])
    return values


def solve(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset, **settings) -> xr.Dataset:
    """Offset, information and mode shifts of every manoeuvre for one angular acceleration.

    CoM paper eqs. 3-6 with generalised weights; erratum C-12 for the weights and the operator.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"
    settings : lowpass_hz, half_width_s, step_s, drift_degree, noise_order, quiet_margin_s

    Returns
    -------
    solved : Dataset, "com_offset.solve"
    """
    noise, seconds = quiet_noise(aligned, settings)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(aligned, smoothed, angular, i, settings) for i in range(aligned.sizes["manoeuvre"])]
    if not noise:
        white = [NoiseModel(np.zeros(0), np.array([1e-18]), settings["step_s"])] * 3
        noise = residual_noise(blocks, [_solve_block(b, white) for b in blocks], settings)
    solved = [_solve_block(b, noise) for b in blocks]
    attrs = {"noise_source": source, "quiet_seconds": seconds, "variant": angular.attrs["variant"]}
    labels = {name: angular[name] for name in ("mode_shared", "mode_catalogue")}
    return _as_dataset(blocks, solved, noise, aligned, attrs).assign(labels)


def _block(aligned, smoothed, angular, index, settings):
    """Resampled reading, columns, instruments, modes and drift of one manoeuvre; None without samples."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"].values == index)
    if inside.size < 200:
        return None
    time = smoothed["acc_time"].values[inside]
    at = np.searchsorted(aligned["acc_time"].values, time)
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


def _as_dataset(blocks, solved, noise, aligned, attrs):
    count = len(blocks)
    modes = len(next((s["modes"] for s in solved if s), ()))
    offset, information = np.full((count, 3), np.nan), np.zeros((count, 3, 3))
    shift, chi2, dof = np.zeros((count, modes, 3)), np.full(count, np.nan), np.zeros(count, dtype=np.int32)
    times, series = [], {"reading": [], "model": [], "manoeuvre": []}
    for i, (block, one) in enumerate(zip(blocks, solved, strict=True)):
        if one is None:
            continue
        offset[i], information[i], shift[i] = one["value"], one["information"], one["modes"]
        chi2[i], dof[i] = one["chi2"], one["dof"]
        valid = block["operator"].valid
        drift = block["drift"][valid]
        times.append(block["operator"].time[valid])
        series["reading"].append(estimation.without(drift, block["reading"][valid]))
        series["model"].append(estimation.without(drift, block["design"][valid] @ one["value"]))
        series["manoeuvre"].append(np.full(int(valid.sum()), i, dtype=np.int16))
    frequency = np.linspace(0.005, 1.0, 200)
    density = np.array([n.density(frequency) for n in noise]) if noise else np.full((3, 200), np.nan)
    join = lambda parts, shape: np.concatenate(parts) if parts else np.zeros(shape)  # noqa: E731
    metre, reading = {"units": "m", "frame": "b"}, {"units": "m s-2", "frame": "b"}
    return xr.Dataset(
        {
            "offset": (("manoeuvre", "axis"), offset, metre | {"long_name": "proof mass to centre of mass"}),
            "information": (("manoeuvre", "axis", "axis_2"), information, {"units": "m-2", "frame": "b"}),
            "mode_shift": (("manoeuvre", "mode_index", "axis"), shift, metre | {"long_name": "change for one sigma"}),
            "chi2": ("manoeuvre", chi2, {"units": "1", "long_name": "whitened residuals"}),
            "dof": ("manoeuvre", dof, {"long_name": "degrees of freedom"}),
            "kind": aligned["kind"],
            "start": aligned["start"],
            "stop": aligned["stop"],
            "reading": (
                ("grid_time", "axis"),
                join(series["reading"], (0, 3)),
                reading | {"long_name": "drift removed"},
            ),
            "model": (("grid_time", "axis"), join(series["model"], (0, 3)), reading | {"long_name": "drift removed"}),
            "grid_manoeuvre": ("grid_time", join(series["manoeuvre"], 0).astype(np.int16), {"long_name": "manoeuvre"}),
            "noise_density": (
                ("axis", "frequency"),
                density,
                {"units": "m2 s-4 Hz-1", "long_name": "noise as measured"},
            ),
        },
        coords={
            "grid_time": ("grid_time", join(times, 0), {"units": "s", "time_scale": "GPS"}),
            "frequency": ("frequency", frequency, {"units": "Hz"}),
        },
        attrs=attrs | {"direction": "proof_mass_to_com"},
    )
