"""Phase centres: whitened equations, least squares and robust, all manoeuvres and sub-sets, all observables."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import noise
from gravcal.calibrations.kbr_phase_centre.model import MANOEUVRE, OBSERVABLES, PARAMETERS, SCHEMAS, SUBSETS, schema_of
from gravcal.calibrations.schemas import build, replaced, widened
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import estimate as estimating
from gravcal.estimation import least_squares, robust
from gravcal.estimation.noise import NoiseModel

X = np.array([True, False, False] * 2)
LONGEST = 4000  # observations of one stretch, whose covariance is held as a matrix; a wiggle of 1000 s at 5 s has 200
#: Degree of the polynomial that the source paper removes from the observations, Remote Sens. 2022, 14, 3395, Sec. 4.1.
PUBLISHED_DEGREE = (15, 13, None)
STACKED = ("centre", "covariance", "formal_sigma", "condition", "sigma0", "kept")
STACKED += ("arc_value", "arc_sigma", "arcs_chi2", "arcs_dof")


def estimate(
    line_of_sight_b: np.ndarray,
    range_less_orbit: np.ndarray,
    time: np.ndarray,
    noise: NoiseModel,
    drift_degree: int = 15,
) -> estimating.Estimate:
    """Vectors from the centres of mass to the phase centres, from one wiggle or several minutes of any turning.

    Parameters
    ----------
    line_of_sight_b : (n, 2, 3) 1, unit vector from each satellite to the other, in its own SRF
    range_less_orbit : (n,) m, measured range, light time corrected, less the distance of the centres of mass; NaN where
        missing
    time : (n,) s, evenly spaced
    noise : NoiseModel of the range, m
    drift_degree : of the polynomial that stands for the range bias and slow orbit errors

    Returns
    -------
    estimate : Estimate of x_a, y_a, z_a, x_b, y_b, z_b in m (SRF); what one wiggle does not turn is NaN or has a large
        error

    Notes
    -----
    rho - norm(r_b - r_a) = -e_a . c_a - e_b . c_b; Remote Sens. 2022, 14, 3395, eq. 10, each line towards the other
    satellite. The part square in the offsets (c^2 / 2 rho, 0.01 mm) is left to the pipeline.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import kbr_phase_centre
    >>> from gravcal.estimation.noise import fit_noise
    >>> rng, time = np.random.default_rng(2), 5.0 * np.arange(756)
    >>> noise = fit_noise([1e-6 * rng.standard_normal(3000)], 1, 5.0)
    >>> pitch = np.deg2rad(2 + np.sin(2 * np.pi * time / 250))
    >>> turned = np.stack([np.cos(pitch), 0 * pitch, -np.sin(pitch)], axis=1)
    >>> line = np.stack([turned, np.tile([1.0, 0.0, 0.0], (756, 1))], axis=1)
    >>> rho = -turned @ [1.444, 0.0, 0.0003] - 1.445 + 1e-6 * rng.standard_normal(756)
    >>> centre = kbr_phase_centre.estimate(line, rho, time, noise)
    >>> bool(abs(centre.value[2] - 0.0003) < 4 * centre.sigma[2]), bool(np.isnan(centre.value[3]))
    (True, True)
    """
    time, line = np.asarray(time, dtype=float), np.asarray(line_of_sight_b, dtype=float)
    columns = -line.reshape(len(line), 1, 6)
    drift = least_squares.polynomial(time, drift_degree, time[0], time[-1])
    observed = np.asarray(range_less_orbit, dtype=float)[:, None]
    return estimating.estimate(observed, columns, [noise], drift, PARAMETERS, "m")


@dataclass(frozen=True)
class Arc:
    """One manoeuvre after whitening and projection."""

    index: np.ndarray  #: (n,) row numbers in the observations
    observed: np.ndarray  #: (n,) whitened, nuisance projected out
    column: np.ndarray  #: (n, 6) of the phase centres, the same; (n, 7) with the range bias of the published method
    basis: np.ndarray  #: (n, k) orthonormal, whitened nuisance


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
    """Product "kbr_phase_centre.solve": phase centres from "range", "range_rate" or "range_acceleration".

    The method "published" makes the choices of the source paper; sub-sets that fix x hold it at nominal_m (2, 3) m.
    """
    derivative = OBSERVABLES.index(variant)
    nominal = np.asarray(nominal_m, dtype=float).reshape(6)
    if method == "published":
        parts, of_noise = published_arcs(equations, derivative, published_trim_s), None
    else:
        parts, of_noise = arcs(equations, measured, derivative, orbit_degree, band_hz[1]), (measured, band_hz)
    numbers = [int(equations["arc"].values[part.index[0]]) for part in parts]
    sign = equations["sign"].values[numbers] if numbers else np.zeros(0)
    results = [_subset(name, parts, sign, nominal, (robust_k0, robust_k1), of_noise) for name in SUBSETS]
    values = {key: np.stack([result[key] for result in results]) for key in results[0]}
    centre = values["centre"][0, 0]
    joint = np.where(np.isfinite(centre), centre, nominal)
    values |= _by_manoeuvre(equations, parts, numbers, joint, values["sigma0"][0, 0])
    values |= _series(equations, parts, centre, derivative, orbit_degree)
    values |= {name: equations[name].values for name in MANOEUVRE}
    attrs = {"title": f"Phase centres from {variant}", "observable": variant, "method": method}
    attrs |= {n: equations.attrs[n] for n in ("unit", "satellites", "ranging")}
    return build(schema_of("solve", variant), values, **attrs)


def arcs(equations: xr.Dataset, measured: xr.Dataset, derivative: int, degree: int, highest_hz: float) -> list[Arc]:
    """Whitened manoeuvres, those with more epochs than unknowns; an EstimationError for one of more than `LONGEST`.

    The polynomial of slow orbit errors has a degree lower by one for each derivative; satellites move to `highest_hz`.
    """
    indices = of_manoeuvres(equations)
    largest = max((index.size for index in indices), default=0)
    if largest > LONGEST:
        stretch, remedy = f"{largest} observations in one stretch", "Check that orbits and attitudes are those of them."
        expected = f"at most {LONGEST}: the pointing is off its mean for hours"
        refuse("both satellites", stretch, expected, remedy, EstimationError)
    step = float(measured.attrs["step_s"])
    time, segment, lever = (equations[name].values for name in ("time_kbr", "segment", "lever"))
    longest = max((float(time[index[-1]] - time[index[0]]) for index in indices if index.size), default=0.0)
    lags = noise.lags(measured, derivative, int(longest / step) + 3, highest_hz)
    result = []
    for index in indices:
        slow = noise.slow_columns(time[index], segment[index], degree - derivative, derivative)
        if index.size <= slow.shape[1] + 10:
            continue
        observed = equations["observed"].values[index]  # less its mean: a bias of 220 km would cost six digits
        data = np.column_stack([observed - observed.mean(), equations["column"].values[index], slow])
        place = np.rint((time[index] - time[index[0]]) / step).astype(int)
        white = noise.white(noise.factor(lags, place, lever[index]), data)
        basis = least_squares.orthonormal(white[:, 7:])
        clean = white[:, :7] - basis @ (basis.T @ white[:, :7])
        result.append(Arc(index, clean[:, 0], clean[:, 1:], basis))
    return result


def of_manoeuvres(equations: xr.Dataset) -> list[np.ndarray]:
    """Row numbers (n,) of the observations of each manoeuvre."""
    return [np.flatnonzero(equations["arc"].values == k) for k in range(equations.sizes["manoeuvre"])]


def published_arcs(equations: xr.Dataset, derivative: int, trim_s: float) -> list[Arc]:
    """Every manoeuvre as the paper treats it: observations detrended, columns not, identity weights, one range bias.

    The polynomial takes the level of the range with it; the columns keep theirs, so that the mean levels of positive
    and mirror arcs act as observations of zero (erratum K-3). The bias of the range is a seventh column.
    """
    time, column, degree = equations["time_kbr"].values, equations["published_column"].values, PUBLISHED_DEGREE
    result = []
    for k in range(equations.sizes["manoeuvre"]):
        start, stop = float(equations["start"][k]), float(equations["stop"][k])
        inside = (time >= start + trim_s) & (time <= stop - trim_s) & np.isfinite(column).all(axis=1)
        index = np.flatnonzero(inside & (equations["arc"].values == k))
        if index.size < 30:
            continue
        observed, columns = equations["observed"].values[index], column[index]
        if degree[derivative] is not None:
            slow = least_squares.polynomial(time[index], degree[derivative], start, stop)
            observed = least_squares.project_out(slow, observed)
        if derivative == 0:
            columns = np.column_stack([columns, np.ones(index.size)])
        result.append(Arc(index, observed, columns, np.zeros((index.size, 0))))
    return result


def _subset(name, parts, sign, nominal, constants, of_noise):
    """Phase centres of a sub-set of arcs by least squares and robust estimation, {variable: array}.

    Name is one of SUBSETS, sign (k,) that of the offset of each arc, nominal (6,) m, constants k0 and k1 of weights,
    of_noise its product and the band Hz, None for no scaling. The first axis of centre and errors is the estimator.
    """
    result = {
        "centre": np.full((2, 6), np.nan),
        "covariance": np.full((2, 6, 6), np.nan),
        "formal_sigma": np.full((2, 6), np.nan),
        "condition": np.nan,
        "sigma0": np.full(2, np.nan),
        "kept": np.nan,
    }
    in_subset = {"positive": sign > 0, "mirror": sign < 0}.get(name.removesuffix("_x_fixed"), np.ones(len(parts), bool))
    subset = [part for part, use in zip(parts, in_subset, strict=True) if use]
    if not subset:
        return result
    biases = subset[0].column.shape[1] - 6  # the common bias of the published range solution
    free = np.append(~X if name.endswith("_x_fixed") else np.ones(6, dtype=bool), np.ones(biases, dtype=bool))
    start = np.append(np.where(free[:6], 0.0, nominal), np.zeros(biases))
    columns = np.concatenate([part.column for part in subset])
    observed = np.concatenate([part.observed for part in subset]) - columns @ start
    design = columns[:, free]
    unknowns = design.shape[1] + sum(part.basis.shape[1] for part in subset)
    normal = design.T @ design
    value = least_squares.stable_inverse(normal) @ (design.T @ observed)
    residual = observed - design @ value
    variance = residual @ residual / max(observed.size - unknowns, 1)
    sharp = robust.solve(observed, design, constants, unknowns)
    shape = noise_variance(subset, design, residual, *of_noise) / variance if of_noise else 1.0
    place = np.flatnonzero(free[:6])
    solutions = (value, normal / (variance * shape), 1.0), (sharp.value, sharp.information / shape, sharp.formal_factor)
    for k, (estimate, information, formal) in enumerate(solutions):
        covariance = least_squares.covariance(information)[: place.size, : place.size]
        result["centre"][k] = start[:6]
        result["centre"][k, place] += estimate[: place.size]
        result["covariance"][k][np.ix_(place, place)] = covariance
        result["formal_sigma"][k, place] = np.sqrt(np.diag(covariance) / shape) * formal
    result["condition"] = float(np.linalg.cond(design))
    result["sigma0"] = np.sqrt(np.array([variance * shape, sharp.scale**2]))
    result["kept"] = float(sharp.weight.mean())
    return result


def noise_variance(parts: list[Arc], design, residual, measured: xr.Dataset, band_hz) -> float:
    """Variance of the noise at the frequencies of the design (n, p) over that assumed; 1 if noise is as measured.

    Power of whitened residuals (n,) over that expected: of the band, times its ratio there to it, whose log is that of
    the residuals and 0 of quiet data, weighted by their variances; what both leave open raises the mean of 1 / power.
    """
    waves, cuts = [], np.cumsum([part.observed.size for part in parts])[:-1]
    columns = least_squares.orthonormal(design), design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    for part, fitted, own, piece in zip(parts, *(np.split(one, cuts) for one in (*columns, residual)), strict=True):
        frequency = np.fft.rfftfreq(piece.size, float(measured.attrs["step_s"]))
        series = piece[:, None], np.column_stack([part.basis, fitted]), own
        power = [np.sum(np.abs(np.fft.rfft(one, axis=0)) ** 2, axis=1) / piece.size for one in series]
        waves.append(np.stack([frequency, *power])[:, (frequency >= band_hz[0]) & (frequency <= band_hz[1])])
    frequency, power, leverage, weight = np.concatenate(waves, axis=1)
    in_band, expected = power.sum() / max(np.sum(1 - leverage), 1.0), max(weight @ (1 - leverage), 1e-300)
    spectrum, of_residuals = noise.spectrum(measured), weight**2 @ (1 - leverage) / expected**2
    share = (weight / max(weight.sum(), 1e-300) - 1 / max(weight.size, 1)) @ spectrum.shares(frequency)
    trust = 1 / (1 + of_residuals / max(share @ spectrum.covariance @ share, 1e-300))
    return in_band * (weight @ power / expected / in_band) ** trust * (1 + trust * of_residuals)


def _by_manoeuvre(equations, parts, numbers, joint, scale):
    """Transverse component m of each manoeuvre, others held at `joint` (6,) m, sigma, chi-square; scale: sigma0."""
    value, sigma = (np.full(equations.sizes["manoeuvre"], np.nan) for _ in range(2))
    chi2, explained, normal = 0.0, 0.0, sum(part.column.T @ part.column for part in parts)
    for part, k in zip(parts, numbers, strict=True):
        parameter = 3 * int(equations["satellite_index"][k]) + (2, 1)[int(equations["axis_index"][k])]
        column = part.column[:, parameter]
        residual = part.observed - part.column[:, :6] @ joint
        if part.column.shape[1] > 6:  # a bias beside
            column, residual = column - column.mean(), residual - residual.mean()
        information = column @ column
        value[k] = joint[parameter] + column @ residual / information
        sigma[k] = scale / np.sqrt(information)
        chi2 += float((column @ residual) ** 2 / information / scale**2)
        shown = part.column.T @ column
        explained += shown @ least_squares.stable_inverse(normal) @ shown / information
    dof = max(len(parts) - round(explained), 0)  # what the joint fit takes of each, of x as of y and z
    return {"arc_value": value, "arc_sigma": sigma, "arcs_chi2": chi2, "arcs_dof": dof}


def _series(equations, parts, centre, derivative, degree):
    """Detrended observations and model of the manoeuvres, and their spectral densities, {variable: array}."""
    time, step = equations["time_kbr"].values, float(np.median(np.diff(equations["time_kbr"].values)))
    index = np.concatenate([part.index for part in parts]) if parts else np.zeros(0, dtype=int)
    series, pieces = [np.zeros((0, 2))], []
    for part in (part.index for part in parts):
        slow = noise.slow_columns(time[part], equations["segment"].values[part], degree - derivative, derivative)
        both = np.column_stack([equations["observed"].values[part], equations["column"].values[part] @ centre])
        series.append(least_squares.project_out(slow, both))
        pieces.append(noise.on_even_grid(time[part], step, series[-1]))
    detrended, modelled = np.concatenate(series).T
    frequency = np.linspace(0, 0.5 / step, 257)[1:]
    return {
        "time_kbr": time[index],
        "frequency": frequency,
        "detrended": detrended,
        "modelled": modelled,
        "arc": equations["arc"].values[index],
        "spectrum_observed": noise.density([p[:, 0] for p in pieces], step, frequency),
        "spectrum_residual": noise.density([p[:, 0] - p[:, 1] for p in pieces], step, frequency),
    }


def combine(
    *solved: xr.Dataset,
    adopted_observable: str,
    adopted_estimator: str,
    determined_limit_mm: float,
    offset_deg: float,
) -> xr.Dataset:
    """Product "kbr_phase_centre.combine": all estimates stacked, from one "kbr_phase_centre.solve" per observable."""
    values = {name: np.stack([one[name].values for one in solved]) for name in STACKED}
    values["determined"] = _determined(values["covariance"], determined_limit_mm)
    values["shift"] = values["centre"][:, :, 0] - values["centre"][:, :1, 0]
    # dY = +tan(theta0) dX and dZ = -tan(theta0) dX of the positive set, of offset angle theta0, the other way of the
    # mirror set: at first order in the amplitude x and the transverse component have proportional columns
    values["predicted_shift"], tangent = np.full_like(values["shift"], np.nan), np.tan(np.radians(offset_deg))
    for row, sign in ((SUBSETS.index("positive"), 1.0), (SUBSETS.index("mirror"), -1.0)):  # Table 5, erratum K-2
        predicted = sign * tangent * values["shift"][:, row, ::3]
        values["predicted_shift"][:, row, 1::3], values["predicted_shift"][:, row, 2::3] = predicted, -predicted
    values |= {name: solved[0][name].values for name in MANOEUVRE}
    attrs = {"adopted_observable": adopted_observable, "adopted_estimator": adopted_estimator}
    attrs |= {"observables": " ".join(one.attrs["observable"] for one in solved)}
    attrs |= {n: solved[0].attrs[n] for n in ("satellites", "ranging", "method")}
    return build(SCHEMAS["combine"], values, title="Phase centres from all observables", **attrs)


def with_model_error(
    combined: xr.Dataset, *moved: xr.Dataset, determined_limit_mm: float, added: str = ""
) -> xr.Dataset:
    """Combined product with model errors in its covariances; moved: one for each direction; added as of `widened`."""
    new = widened(combined, moved, {"centre": ("covariance",)}, added)
    return replaced(combined, new | {"determined": _determined(new["covariance"], determined_limit_mm).astype("u1")})


def _determined(covariance, limit_mm):
    """True (observable, subset, parameter) where the sigma of least squares is at most limit_mm."""
    sigma = np.sqrt(np.diagonal(covariance[:, :, 0], axis1=-2, axis2=-1))
    return np.isfinite(sigma) & (sigma <= 1e-3 * limit_mm)
