"""Offset from one manoeuvre: the same operator on reading and columns, noise as measured in quiet data."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.noise import FREQUENCY, models_of
from gravcal.calibrations.com_offset.schemas import SOLVE
from gravcal.calibrations.com_offset.windows import operator_for
from gravcal.effects import Context, effect
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, fit_noise, whiten

#: Loose prior of the offset, 1 mm about zero: requirement 100 um, largest seen 333 um.
PRIOR = np.eye(3) / 1e-3**2
#: A direction in which one manoeuvre knows the offset worse than this is held at the value of all of them.
DIRECTION_LIMIT_M = 1e-4


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
    settings : method, lowpass_hz, half_width_s, step_s, drift_degree, noise_order

    Returns
    -------
    solved : Dataset, "com_offset.solve"
    """
    if settings["method"] == "published":
        return _published(aligned, smoothed, angular)
    noise = models_of(measured)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(aligned, smoothed, angular, i, settings) for i in range(aligned.sizes["manoeuvre"])]
    if not noise:
        noise = _residual_noise(blocks, settings)
    whitened = [_whitened(b, noise) for b in blocks]
    scores = [None if w is None else estimation.score(*w[:4]) for w in whitened]
    joint = _joint(scores)
    values = _values(blocks, whitened, scores, joint, angular.sizes["mode_index"])
    values |= {n: angular[n].values for n in ("mode_shared", "mode_catalogue")}
    values |= _where(aligned)
    density = np.array([n.density(FREQUENCY) for n in noise]) if noise else np.full((3, FREQUENCY.size), np.nan)
    values |= {"frequency": FREQUENCY, "noise_density": density}
    attrs = {"variant": angular.attrs["variant"], "direction": "proof_mass_to_com", "noise_source": source}
    return build(SOLVE, values, **attrs)


def _where(aligned):
    """Kind, times and latitude of every manoeuvre."""
    start, stop = aligned["start"].values, aligned["stop"].values
    position, time = aligned["position_e"].values, aligned["time_orbit"].values
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"].values, "start": start, "stop": stop, "latitude": latitude}


def _published(aligned, smoothed, angular):
    """Offsets and formal errors as printed."""
    count = aligned.sizes["manoeuvre"]
    offset, information, where = np.full((count, 3), np.nan), np.zeros((count, 3, 3)), _where(aligned)
    for i in range(count):
        inside = np.flatnonzero(smoothed["acc_manoeuvre"].values == i)
        if inside.size < 200:
            continue
        time = smoothed["time_acc"].values[inside]
        linear, marked = _reading(aligned, time)
        rates = smoothed["rate_b"].values[inside], angular["rate_dot_b"].values[inside]
        kept = published.components(int(where["kind"][i]), float(where["latitude"][i]))
        offset[i], formal = published.solve_one(time, ~marked, linear, rates, kept)
        information[i][np.ix_(kept, kept)] = estimation.stable_inverse(formal[np.ix_(kept, kept)])
    values = _values([None] * count, [], [], None, 0) | where
    values |= {"offset": offset, "information": information, "normal": information}
    values |= {"right": np.matvec(information, np.nan_to_num(offset)), "mode_shared": [], "mode_catalogue": []}
    values |= {"frequency": FREQUENCY, "noise_density": np.full((3, FREQUENCY.size), np.nan)}
    attrs = {"variant": angular.attrs["variant"], "direction": "proof_mass_to_com", "noise_source": "published"}
    return build(SOLVE, values, **attrs)


def _joint(scores):
    """Offset of all manoeuvres together, for errors that scale with it and for residuals; NaN without any.

    A component that nothing determines stays near zero by a loose prior, so that it does not enlarge these errors.
    """
    seen = [s for s in scores if s is not None]
    if not seen:
        return np.full(3, np.nan)
    normal = sum(s.normal for s in seen) + PRIOR
    return estimation.stable_inverse(normal) @ sum(s.right for s in seen)


def _block(aligned, smoothed, angular, index, settings):
    """Resampled reading, columns, instruments, modes and drift of one manoeuvre; None without samples."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"].values == index)
    if inside.size < 200:
        return None
    time = smoothed["time_acc"].values[inside]
    linear, marked = _reading(aligned, time)
    value, modes = angular["rate_dot_b"].values[inside], angular["mode"].values[:, inside]
    good = ~marked & np.isfinite(value).all(axis=1)
    operator = _operator(_ends(aligned, smoothed, index), time, good, settings)
    if operator.valid.sum() < 60:
        return None
    rate, gradient = smoothed["rate_b"].values[inside], smoothed["gradient_b"].values[inside]
    columns = lambda rate_dot: operator(_columns(time, rate, np.nan_to_num(rate_dot), gradient))  # noqa: E731
    instruments = None
    if angular.attrs["variant"] != "mtq":
        wave = angular["ratio"].values * smoothed["magnetic_b"].values[inside]
        instruments = columns(smoothed["smooth_b"].values[inside] + wave)
    return {
        "operator": operator,
        "reading": operator(np.nan_to_num(linear - linear[good].mean(axis=0))),
        "design": columns(value),
        "instruments": instruments,
        "modes": [operator(_columns(time, 0 * rate, m, 0 * gradient)) for m in modes],
        "drift": estimation.polynomial(operator.time, settings["drift_degree"], *operator.time[[0, -1]]),
    }


def _reading(aligned, time):
    """Linear acceleration (n, 3) at epochs of the record and which of them are not usable (n,)."""
    at = np.searchsorted(aligned["time_acc"].values, time)
    linear = aligned["linear_b"].values[at]
    return linear, (aligned["acc_flag"].values[at] != 0) | ~np.isfinite(linear).all(axis=1)


def _operator(ends, time, good, settings):
    """Low-pass and resampling between the first and the last edge."""
    filters = [settings[name] for name in ("lowpass_hz", "half_width_s", "step_s")]
    return operator_for(time, good, max(ends[0], time[0]), min(ends[1], time[-1]), *filters)


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


def _whitened(block, noise):
    """Whitened reading, columns, drift, instruments and modes of a block, the rows of the three axes stacked."""
    if block is None:
        return None
    valid = block["operator"].valid
    turn = lambda columns: np.concatenate([whiten(noise[a], columns[:, a], valid) for a in range(3)])  # noqa: E731
    width = block["drift"].shape[1]
    drift = np.zeros((3 * valid.size, 3 * width))
    for a in range(3):
        rows = slice(a * valid.size, (a + 1) * valid.size)
        drift[rows, a * width : (a + 1) * width] = whiten(noise[a], block["drift"], valid)
    instruments = None if block["instruments"] is None else turn(block["instruments"])
    return turn(block["reading"]), turn(block["design"]), drift, instruments, [turn(m) for m in block["modes"]]


def _residual_noise(blocks, settings):
    """Noise from the residuals of a first solution with white noise, where quiet data are missing."""
    white = [NoiseModel(np.zeros(0), np.array([1e-18]), settings["step_s"])] * 3
    whitened = [_whitened(b, white) for b in blocks]
    joint = _joint([None if w is None else estimation.score(*w[:4]) for w in whitened])
    pieces = [_residual(b, joint) for b in blocks if b is not None]
    removed = len(pieces) * (settings["drift_degree"] + 1) + 1
    order = settings["noise_order"]
    return (
        [fit_noise([p[:, a] for p in pieces], order, settings["step_s"], removed) for a in range(3)] if pieces else []
    )


def _residual(block, value):
    """Reading minus model with its drift removed, on the resampled grid (n, 3)."""
    residual = block["reading"] - block["design"] @ value
    valid = block["operator"].valid
    residual[valid] = estimation.without(block["drift"][valid], residual[valid])
    return residual


def _values(blocks, whitened, scores, joint, modes):
    """Estimating equations of every manoeuvre and the series they come from, drift removed."""
    count = len(blocks)
    table = {"offset": np.full((count, 3), np.nan), "right": np.zeros((count, 3)), "chi2": np.full(count, np.nan)}
    table |= {"normal": np.zeros((count, 3, 3)), "information": np.zeros((count, 3, 3))}
    table |= {"mode_shift": np.zeros((count, modes, 3)), "dof": np.zeros(count)}
    series = {"time_grid": [np.zeros(0)], "grid_manoeuvre": [np.zeros(0)]}
    series |= {"reading": [np.zeros((0, 3))], "model": [np.zeros((0, 3))]}
    for i, (block, white, score) in enumerate(zip(blocks, whitened, scores, strict=False)):
        if block is None:
            continue
        for name, value in _estimate(white, score, joint).items():
            table[name][i] = value
        valid = block["operator"].valid
        drift = block["drift"][valid]
        series["time_grid"].append(block["operator"].time[valid])
        series["grid_manoeuvre"].append(np.full(int(valid.sum()), i))
        series["reading"].append(estimation.without(drift, block["reading"][valid]))
        series["model"].append(estimation.without(drift, block["design"][valid] @ joint))
    return table | {n: np.concatenate(v) for n, v in series.items()}


def _estimate(white, score, joint):
    """Numbers of one manoeuvre; noise of the columns weakens its equation, modes act on the joint offset."""
    y, A, drift, Z, modes = white
    clean = estimation.without(drift, A if Z is None else Z)
    gain = estimation.stable_inverse(score.information) @ clean.T
    residual = estimation.without(drift, y - A @ joint)
    used = np.any(drift != 0, axis=1)
    extra = 0.0
    if Z is not None:
        noisy = estimation.without(clean, estimation.without(drift, A))
        extra = float(np.sum((noisy @ joint) ** 2) / max(used.sum(), 1))
    return {
        "offset": score.determined(joint, DIRECTION_LIMIT_M),
        "right": score.right / (1 + extra),
        "normal": score.normal / (1 + extra),
        "information": score.information / (1 + extra),
        "mode_shift": np.array([-gain @ m @ joint for m in modes]).reshape(-1, 3),
        "chi2": float(residual @ residual),
        "dof": int(used.sum() - drift.shape[1]),
    }
