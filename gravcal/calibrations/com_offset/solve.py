"""Offset from one manoeuvre: the same operator on reading and columns, noise as measured in quiet data."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.noise import FREQUENCY, models_of
from gravcal.calibrations.com_offset.schemas import SOLVE
from gravcal.effects import Context, effect
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, fit_noise, whiten
from gravcal.methods.remembering import remembered
from gravcal.methods.resampling import operator_for

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
    variant = angular.attrs["variant"]
    given = [_arrays(product) for product in (aligned, smoothed, angular)]
    if settings["method"] == "published":
        return _published(*given, variant)
    noise = models_of(measured)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(*given, i, settings | {"variant": variant}) for i in range(aligned.sizes["manoeuvre"])]
    if not noise:
        noise = _residual_noise(blocks, settings)
    whitened = [_whitened(b, noise) for b in blocks]
    scores = [_score(w) for w in whitened]
    joint = _joint(scores)
    values = _values(blocks, whitened, scores, joint, angular.sizes["mode_index"])
    values |= {n: angular[n].values for n in ("mode_shared", "mode_catalogue")}
    values |= _where(given[0])
    density = np.array([n.density(FREQUENCY) for n in noise]) if noise else np.full((3, FREQUENCY.size), np.nan)
    values |= {"frequency": FREQUENCY, "noise_density": density}
    attrs = {"variant": variant, "direction": "proof_mass_to_com", "noise_source": source}
    return build(SOLVE, values, **attrs)


def _arrays(product):
    """Variables of a product as bare arrays, by name."""
    return {name: variable.values for name, variable in product.variables.items()}


def _where(aligned):
    """Kind, times and latitude of every manoeuvre."""
    start, stop = aligned["start"], aligned["stop"]
    position, time = aligned["position_e"], aligned["time_orbit"]
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"], "start": start, "stop": stop, "latitude": latitude}


def _published(aligned, smoothed, angular, variant):
    """Offsets and formal errors as printed."""
    count = aligned["start"].size
    offset, information, where = np.full((count, 3), np.nan), np.zeros((count, 3, 3)), _where(aligned)
    for i in range(count):
        inside = _samples(smoothed, i)
        if inside is None:
            continue
        time = smoothed["time_acc"][inside]
        linear, marked = _reading(aligned, time)
        rates = smoothed["rate_b"][inside], angular["rate_dot_b"][inside]
        kept = published.components(int(where["kind"][i]), float(where["latitude"][i]))
        offset[i], formal = published.solve_one(time, ~marked, linear, rates, kept)
        information[i][np.ix_(kept, kept)] = estimation.stable_inverse(formal[np.ix_(kept, kept)])
    values = _values([None] * count, [], [], None, 0) | where
    values |= {"offset": offset, "information": information, "normal": information}
    values |= {"right": np.matvec(information, np.nan_to_num(offset)), "mode_shared": [], "mode_catalogue": []}
    values |= {"frequency": FREQUENCY, "noise_density": np.full((3, FREQUENCY.size), np.nan)}
    attrs = {"variant": variant, "direction": "proof_mass_to_com", "noise_source": "published"}
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
    """Resampled reading, columns, instruments, modes and drift of one manoeuvre; None without samples.

    The columns are linear in the angular acceleration, so that this is resampled, not its nine columns.
    """
    inside = _samples(smoothed, index)
    if inside is None:
        return None
    time = smoothed["time_acc"][inside]
    linear, marked = _reading(aligned, time)
    value, modes = angular["rate_dot_b"][inside], angular["mode"][:, inside]
    good = ~marked & np.isfinite(value).all(axis=1)
    motion = smoothed["rate_b"][inside], smoothed["gradient_b"][inside]
    operator, still = _still(time, good, *motion, _filter(aligned, smoothed, index, settings))
    if operator.valid.sum() < 60:
        return None
    driven = [value]
    if settings["variant"] != "mtq":
        driven.append(smoothed["smooth_b"][inside] + angular["ratio"] * smoothed["magnetic_b"][inside])
    series = np.stack([linear - linear[good].mean(axis=0), *driven, *modes], axis=1)
    reading, *turning = np.moveaxis(operator(np.nan_to_num(series)), 1, 0)
    turning = list(_columns(operator.time, np.zeros(3), np.array(turning), np.zeros((3, 3))))
    return {
        "operator": operator,
        "reading": reading,
        "design": still + turning[0],
        "instruments": still + turning[1] if driven[1:] else None,
        "modes": turning[len(driven) :],
        "drift": estimation.polynomial(operator.time, settings["drift_degree"], *operator.time[[0, -1]]),
    }


def _samples(smoothed, index):
    """Samples of one manoeuvre, as a slice where they are in one piece; None where there are too few."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"] == index)
    if inside.size < 200:
        return None
    whole = slice(inside[0], inside[-1] + 1)
    return whole if whole.stop - whole.start == inside.size else inside


def _reading(aligned, time):
    """Linear acceleration (n, 3) at epochs of the record and which of them are not usable (n,)."""
    at = np.searchsorted(aligned["time_acc"], time)
    linear = aligned["linear_b"][at]
    return linear, (aligned["acc_flag"][at] != 0) | ~np.isfinite(linear).all(axis=1)


@remembered(16)
def _still(time, good, rate, gradient, filtered):
    """Low-pass and resampling, and the columns without angular acceleration: one for all variants of a manoeuvre."""
    start, stop, *settings = filtered
    operator = operator_for(time, good, max(start, time[0]), min(stop, time[-1]), *settings)
    return operator, operator(_columns(time, rate, np.zeros(3), gradient))


def _filter(aligned, smoothed, index, settings):
    """First and last edge, and what the low-pass and resampling between them needs."""
    return *_ends(aligned, smoothed, index), *(settings[name] for name in ("lowpass_hz", "half_width_s", "step_s"))


def _ends(aligned, smoothed, index):
    """First and last edge as the accelerometer sees them."""
    count = int(np.isfinite(aligned["edge_lower"][index]).sum())
    late = np.nan_to_num(smoothed["acc_shift"][index])
    return aligned["edge_upper"][index, 0] + max(late, 0.0), aligned["edge_lower"][index, count - 1] + min(late, 0.0)


def _columns(time, rate, rate_dot, gradient):
    """Reading per metre of offset, (n, axis, component)."""
    context = Context(time=time, rate_b=rate, rate_dot_b=rate_dot, gradient_b=gradient)
    return effect("accelerometer.offset").columns(context)


def _whitened(block, noise):
    """Whitened reading, columns and instruments without drift, modes; the rows of the three axes stacked.

    Returns
    -------
    white : dict of "reading", "design", "instruments" or None, "modes", "rows" that count, "dof"; None without block
    """
    if block is None:
        return None
    valid, drift = block["operator"].valid, block["drift"]
    own = [block["design"], *([] if block["instruments"] is None else [block["instruments"]]), *block["modes"]]
    columns = np.concatenate([block["reading"][:, :, None], *own], axis=2)
    white = []
    for a in range(3):
        turned = whiten(noise[a], np.concatenate([columns[:, a], drift], axis=1), valid)
        white.append(_without(turned[:, columns.shape[2] :], turned[:, : columns.shape[2]]))
    reading, *parts = np.split(np.concatenate(white), np.arange(1, columns.shape[2], 3), axis=1)
    found = {"reading": reading[:, 0], "design": parts.pop(0)}
    found["instruments"] = None if block["instruments"] is None else parts.pop(0)
    rows = 3 * int(valid.sum())
    return found | {"modes": parts, "rows": rows, "dof": rows - 3 * drift.shape[1]}


def _without(drift, columns):
    """Columns without drift."""
    basis = _basis(drift)
    return columns - basis @ (basis.T @ columns)


#: Basis of a drift; all variants of a manoeuvre have the same.
_basis = remembered(64)(estimation.orthonormal)


def _score(white):
    """Estimating equation of one manoeuvre; None without block."""
    if white is None:
        return None
    none = np.zeros((white["reading"].size, 0))
    return estimation.score(white["reading"], white["design"], none, white["instruments"])


def _residual_noise(blocks, settings):
    """Noise from the residuals of a first solution with white noise, where quiet data are missing."""
    white = [NoiseModel(np.zeros(0), np.array([1e-18]), settings["step_s"])] * 3
    whitened = [_whitened(b, white) for b in blocks]
    joint = _joint([_score(w) for w in whitened])
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
        both = np.concatenate([block["reading"][valid], block["design"][valid] @ joint], axis=1)
        both = _without(block["drift"][valid], both)
        series["time_grid"].append(block["operator"].time[valid])
        series["grid_manoeuvre"].append(np.full(int(valid.sum()), i))
        series["reading"].append(both[:, :3])
        series["model"].append(both[:, 3:])
    return table | {n: np.concatenate(v) for n, v in series.items()}


def _estimate(white, score, joint):
    """Numbers of one manoeuvre; noise of the columns weakens its equation, modes act on the joint offset."""
    A, Z = white["design"], white["instruments"]
    gain = estimation.stable_inverse(score.information) @ (A if Z is None else Z).T
    residual = white["reading"] - A @ joint
    extra = 0.0
    if Z is not None:
        extra = float(np.sum((estimation.without(Z, A) @ joint) ** 2) / max(white["rows"], 1))
    return {
        "offset": score.determined(joint, DIRECTION_LIMIT_M),
        "right": score.right / (1 + extra),
        "normal": score.normal / (1 + extra),
        "information": score.information / (1 + extra),
        "mode_shift": np.array([-gain @ m @ joint for m in white["modes"]]).reshape(-1, 3),
        "chi2": float(residual @ residual),
        "dof": white["dof"],
    }
