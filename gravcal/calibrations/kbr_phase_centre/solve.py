"""Phase centres from one observable: least squares and robust, from all manoeuvres and from sub-sets of them."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre import published, whitened
from gravcal.calibrations.kbr_phase_centre.schemas import OBSERVABLES, SOLVE, SUBSETS, of
from gravcal.estimation import least_squares, robust

MANOEUVRE = ("satellite_index", "axis_index", "sign", "start", "stop")
X = np.array([True, False, False] * 2)


def solve(
    equations: xr.Dataset,
    measured: xr.Dataset,
    *,
    variant: str,
    method: str,
    orbit_degree: int,
    band_hz,
    robust_k0: float,
    robust_k1: float,
    nominal_m,
    published_trim_s: float,
) -> xr.Dataset:
    """Phase centres of both satellites from one observable.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable"
    measured : Dataset, "kbr_phase_centre.noise"
    variant : "range", "range_rate" or "range_acceleration"
    method : "gravcal", or "published" for the choices of the source paper
    orbit_degree : of the polynomial per manoeuvre that takes up slow orbit errors of the range
    band_hz : Hz and Hz, where the noise in the manoeuvres is compared with quiet noise
    robust_k0, robust_k1 : constants of IGG-III
    nominal_m : (2, 3) m, at which x is held in the sub-sets that fix it
    published_trim_s : s, left out at both ends by the source paper

    Returns
    -------
    solved : Dataset, "kbr_phase_centre.solve"
    """
    derivative = OBSERVABLES.index(variant)
    nominal = np.asarray(nominal_m, dtype=float).reshape(6)
    if method == "published":
        parts = published.arcs(equations, derivative, published_trim_s)
        band = None
    else:
        parts = whitened.arcs(equations, measured, whitened.of_manoeuvres(equations), derivative, orbit_degree)
        band = (tuple(band_hz), float(measured.attrs["step_s"]))
    numbers = [int(equations["arc"].values[part.index[0]]) for part in parts]
    sign = equations["sign"].values[numbers] if numbers else np.zeros(0)
    results = [_subset(name, parts, sign, nominal, ((robust_k0, robust_k1), band)) for name in SUBSETS]
    values = {key: np.stack([result[key] for result in results]) for key in results[0]}
    values |= _by_arc(equations, parts, numbers, values, nominal)
    values |= _series(equations, parts, values["centre"][0, 0], derivative, orbit_degree)
    values |= {name: equations[name].values for name in MANOEUVRE}
    attrs = {"observable": variant, "method": method, "unit": equations.attrs["unit"]} | {
        n: equations.attrs[n] for n in ("satellites", "ranging")
    }
    return build(of(SOLVE, variant), values, title=f"Phase centres from {variant}", **attrs)


def _subset(name, parts, sign, nominal, settings):
    """Estimates of one sub-set of the manoeuvres."""
    constants, band = settings
    wanted = {"positive": sign > 0, "mirror": sign < 0}.get(name.removesuffix("_x_fixed"), np.ones(len(parts), bool))
    chosen = [part for part, use in zip(parts, wanted, strict=True) if use]
    free = ~X if name.endswith("_x_fixed") else np.ones(6, dtype=bool)
    blank = {
        "centre": np.full((2, 6), np.nan),
        "covariance": np.full((2, 6, 6), np.nan),
        "formal_sigma": np.full((2, 6), np.nan),
        "condition": np.nan,
        "sigma0": np.full(2, np.nan),
        "kept": np.nan,
    }
    if not chosen:
        return blank
    extra = chosen[0].column.shape[1] - 6  # the common bias of the published range solution
    free = np.append(free, np.ones(extra, dtype=bool))
    start = np.append(np.where(free[:6], 0.0, nominal), np.zeros(extra))
    design = np.concatenate([part.column for part in chosen])
    reduced = np.concatenate([part.observed for part in chosen]) - design @ start
    return _estimates(chosen, design[:, free], reduced, free, (start, constants, band, blank))


def _estimates(chosen, design, reduced, free, given):
    """Least squares and robust values, covariances and formal errors."""
    start, constants, band, result = given
    unknowns = design.shape[1] + sum(part.basis.shape[1] for part in chosen)
    normal = design.T @ design
    value = least_squares.stable_inverse(normal) @ (design.T @ reduced)
    residual = reduced - design @ value
    variance = residual @ residual / max(reduced.size - unknowns, 1)
    sharp = robust.solve(reduced, design, constants, unknowns)
    cuts = np.cumsum([part.observed.size for part in chosen])[:-1]
    shape = 1.0
    if band:
        shape = whitened.band_variance(chosen, np.split(residual, cuts), *band) / variance
    inverses = (normal / (variance * shape), sharp.information / shape)
    place = np.flatnonzero(free[:6])
    for k, (estimate, inverse) in enumerate(zip((value, sharp.value), inverses, strict=True)):
        full = start.copy()
        full[free] += estimate
        covariance = least_squares.covariance(inverse)[: place.size, : place.size]
        result["centre"][k] = full[:6]
        result["covariance"][k][np.ix_(place, place)] = covariance
        factor = np.sqrt(1 / shape) * (1.0, sharp.formal_factor)[k]
        result["formal_sigma"][k, place] = np.sqrt(np.diag(covariance)) * factor
    return result | {
        "condition": _condition(design),
        "sigma0": np.sqrt(np.array([variance * shape, sharp.scale**2])),
        "kept": float(sharp.weight.mean()),
    }


def _condition(design):
    """Condition number of the columns as they are."""
    size = np.linalg.svd(design, compute_uv=False)
    return float(size[0] / size[-1]) if size[-1] > 0 else np.inf


def _by_arc(equations, parts, numbers, values, nominal):
    """The transverse component that each manoeuvre tells by itself, others held at the joint solution."""
    count = equations.sizes["manoeuvre"]
    result = {"arc_value": np.full(count, np.nan), "arc_sigma": np.full(count, np.nan)}
    joint = np.where(np.isfinite(values["centre"][0, 0]), values["centre"][0, 0], nominal)
    scale = values["sigma0"][0, 0]
    chi2, used = 0.0, set()
    for part, k in zip(parts, numbers, strict=True):
        satellite, axis = int(equations["satellite_index"][k]), int(equations["axis_index"][k])
        place = 3 * satellite + (2, 1)[axis]
        column = part.column[:, place]
        left = part.observed - part.column[:, :6] @ joint
        if part.column.shape[1] > 6:
            left = left - left.mean()
        size = column @ column
        result["arc_value"][k] = joint[place] + column @ left / size
        result["arc_sigma"][k] = scale / np.sqrt(size)
        chi2 += float((column @ left) ** 2 / size / scale**2)
        used.add(place)
    return result | {"arcs_chi2": chi2, "arcs_dof": max(len(parts) - len(used), 0)}


def _series(equations, parts, centre, derivative, degree):
    """Observations and model of the manoeuvres with the slow part removed, and their densities."""
    time, step = equations["time_kbr"].values, float(np.median(np.diff(equations["time_kbr"].values)))
    frequency = np.linspace(0, 0.5 / step, 257)[1:]
    chosen = [part.index for part in parts]
    index = np.concatenate(chosen) if chosen else np.zeros(0, dtype=int)
    clean, pieces = [], []
    for part in chosen:
        slow = whitened.slow_columns(time[part], equations["segment"].values[part], degree - derivative, derivative)
        both = np.column_stack([equations["observed"].values[part], equations["column"].values[part] @ centre])
        both = least_squares.without(slow, both)
        clean.append(both)
        piece = np.full((int(round((time[part[-1]] - time[part[0]]) / step)) + 1, 2), np.nan)
        piece[np.rint((time[part] - time[part[0]]) / step).astype(int)] = both
        pieces.append(piece)
    series = np.concatenate(clean) if clean else np.zeros((0, 2))
    return {
        "time_kbr": time[index],
        "frequency": frequency,
        "detrended": series[:, 0],
        "modelled": series[:, 1],
        "arc": equations["arc"].values[index],
        "spectrum_observed": noises.density([p[:, 0] for p in pieces], step, frequency),
        "spectrum_residual": noises.density([p[:, 0] - p[:, 1] for p in pieces], step, frequency),
    }
