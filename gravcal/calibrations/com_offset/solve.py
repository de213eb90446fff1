"""Offset from one manoeuvre: the same operator on reading and columns, noise as measured in quiet data."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.equations import arrays, of_rotation
from gravcal.calibrations.com_offset.noise import FREQUENCY, models_of
from gravcal.calibrations.com_offset.schemas import SOLVE
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten

#: Loose prior of the offset, 1 mm about zero: requirement 100 um, largest seen 333 um.
PRIOR = np.eye(3) / 1e-3**2
#: A direction in which one manoeuvre knows the offset worse than this is held at the value of all of them.
DIRECTION_LIMIT_M = 1e-4


def solve(resampled: xr.Dataset, measured: xr.Dataset, **settings) -> xr.Dataset:
    """Offset, information and mode shifts of every manoeuvre for one angular acceleration.

    CoM paper eqs. 3-6 with generalised weights; erratum C-12 for the weights and the operator.

    Parameters
    ----------
    resampled : Dataset, "com_offset.equations"
    measured : Dataset, "com_offset.noise"
    settings : drift_degree, noise_order

    Returns
    -------
    solved : Dataset, "com_offset.solve"
    """
    given = arrays(resampled)
    settings = settings | {"step_s": float(resampled.attrs["step_s"])}
    noise = models_of(measured)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(given, i, settings) for i in range(resampled.sizes["manoeuvre"])]
    if not noise:
        noise = _residual_noise(blocks, settings)
    whitened = [_whitened(b, noise) for b in blocks]
    scores = [_score(w) for w in whitened]
    values = _values(blocks, whitened, scores, _joint(scores), resampled.sizes["mode_index"])
    density = np.array([n.density(FREQUENCY) for n in noise]) if noise else np.full((3, FREQUENCY.size), np.nan)
    return product(values | {"noise_density": density}, given, resampled.attrs["variant"], source)


def product(values, given, variant: str, source: str) -> xr.Dataset:
    """Product of a solution.

    Parameters
    ----------
    values : arrays by name
    given : arrays of "com_offset.equations" by name, or what stands for them: kind, start, stop, latitude, modes
    variant : angular acceleration
    source : of the noise
    """
    kept = {n: given[n] for n in ("kind", "start", "stop", "latitude", "mode_shared", "mode_catalogue")}
    attrs = {"variant": variant, "direction": "proof_mass_to_com", "noise_source": source}
    return build(SOLVE, values | kept | {"frequency": FREQUENCY}, **attrs)


def nothing(count: int) -> dict[str, np.ndarray]:
    """Values of a solution in which so many manoeuvres tell nothing."""
    values = _values([None] * count, [], [], None, 0)
    return values | {"noise_density": np.full((3, FREQUENCY.size), np.nan)}


def _joint(scores):
    """Offset of all manoeuvres together, for errors that scale with it and for residuals; NaN without any.

    A component that nothing determines stays near zero by a loose prior, so that it does not enlarge these errors.
    """
    seen = [s for s in scores if s is not None]
    if not seen:
        return np.full(3, np.nan)
    normal = sum(s.normal for s in seen) + PRIOR
    return least_squares.stable_inverse(normal) @ sum(s.right for s in seen)


def _block(given, index, settings):
    """Reading, columns, instruments, modes and drift of one manoeuvre; None without epochs."""
    inside = slice(*np.searchsorted(given["grid_manoeuvre"], [index, index + 1]))
    if inside.stop == inside.start:
        return None
    time, still = given["epoch"][inside], given["still"][inside]
    driven, modes = given["driven_b"][:, inside], given["mode"][:, inside]
    turning = list(of_rotation(time, np.concatenate([given["rate_dot_b"][None, inside], driven, modes])))
    return {
        "time": time,
        "valid": given["valid"][inside].astype(bool),
        "reading": given["reading"][inside],
        "design": still + turning[0],
        "instruments": still + turning[1] if len(driven) else None,
        "modes": turning[1 + len(driven) :],
        "drift": least_squares.polynomial(time, settings["drift_degree"], *time[[0, -1]]),
    }


def _whitened(block, noise):
    """Whitened reading, columns and instruments without drift, modes; the rows of the three axes stacked.

    Returns
    -------
    white : dict of "reading", "design", "instruments" or None, "modes", "rows" that count, "dof"; None without block
    """
    if block is None:
        return None
    valid, drift = block["valid"], block["drift"]
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
    basis = least_squares.orthonormal(drift)
    return columns - basis @ (basis.T @ columns)


def _score(white):
    """Estimating equation of one manoeuvre; None without block."""
    if white is None:
        return None
    none = np.zeros((white["reading"].size, 0))
    return least_squares.score(white["reading"], white["design"], none, white["instruments"])


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
    valid = block["valid"]
    residual[valid] = least_squares.without(block["drift"][valid], residual[valid])
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
        valid = block["valid"]
        both = np.concatenate([block["reading"][valid], block["design"][valid] @ joint], axis=1)
        both = _without(block["drift"][valid], both)
        series["time_grid"].append(block["time"][valid])
        series["grid_manoeuvre"].append(np.full(int(valid.sum()), i))
        series["reading"].append(both[:, :3])
        series["model"].append(both[:, 3:])
    return table | {n: np.concatenate(v) for n, v in series.items()}


def _estimate(white, score, joint):
    """Numbers of one manoeuvre; noise of the columns weakens its equation, modes act on the joint offset."""
    A, Z = white["design"], white["instruments"]
    gain = least_squares.stable_inverse(score.information) @ (A if Z is None else Z).T
    residual = white["reading"] - A @ joint
    extra = 0.0
    if Z is not None:
        extra = float(np.sum((least_squares.without(Z, A) @ joint) ** 2) / max(white["rows"], 1))
    return {
        "offset": score.determined(joint, DIRECTION_LIMIT_M),
        "right": score.right / (1 + extra),
        "normal": score.normal / (1 + extra),
        "information": score.information / (1 + extra),
        "mode_shift": np.array([-gain @ m @ joint for m in white["modes"]]).reshape(-1, 3),
        "chi2": float(residual @ residual),
        "dof": white["dof"],
    }
