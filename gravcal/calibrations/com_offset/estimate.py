"""Offset of every manoeuvre and of all together, with noise as measured in quiet data, and whether they agree."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build, replaced, widened
from gravcal.calibrations.com_offset.model import VARIANTS, arrays, reading, samples, where
from gravcal.calibrations.com_offset.noise import FREQUENCY, models_of
from gravcal.estimation import estimate as estimating
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.estimation.resampling import lowpass_resampler
from gravcal.physics import sensing

SCHEMAS = schemas.of("com_offset.toml")
#: Loose prior of the offset, 1 mm about zero: requirement 100 um, largest seen 333 um.
PRIOR = np.eye(3) / 1e-3**2
#: A direction in which one manoeuvre knows the offset worse than this is held at the value of all of them.
DIRECTION_LIMIT_M = 1e-4
#: Of the CoM paper: Sec. 4.3, Sec. 3.1, and between the areas of Table 3.
LOWPASS_HZ, WEIGHTS, HIGH_LATITUDE = 0.166, np.array([1.0, 0.09, 1.0]), np.radians(45.0)


def estimate(
    rate_b: np.ndarray,
    rate_dot_b: np.ndarray,
    gradient_b: np.ndarray,
    reading_b: np.ndarray,
    time: np.ndarray,
    noise: Sequence[NoiseModel],
    drift_degree: int = 5,
) -> estimating.Estimate:
    """Vector from the proof mass to the centre of mass.

    Parameters
    ----------
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2, of the body with respect to inertial
    gradient_b : (n, 3, 3) s-2, dg/dr
    reading_b : (n, 3) m s-2, linear accelerometer in SRF, NaN where missing
    time : (n,) s, evenly spaced
    noise : three NoiseModel, one an axis, m s-2; `gravcal.estimation.noise.fit_noise` makes them of quiet data
    drift_degree : of the polynomial per axis that stands for bias, drag and radiation pressure

    Returns
    -------
    estimate : Estimate of x, y, z in m, from the proof mass to the centre of mass (SRF)

    Notes
    -----
    f = T p + drift with T = [w' x] + [w x][w x] - G and p = -d; Remote Sens. 2022, 14, 4030, eq. 1 (equations.md, M1).
    Rates and angular accelerations are taken as true: their errors are treated by the pipeline's `com_offset.solve`.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import com_offset
    >>> from gravcal.estimation.noise import fit_noise
    >>> from gravcal.physics.sensing import offset_tensor
    >>> rng, time = np.random.default_rng(1), 0.1 * np.arange(1800)
    >>> noise = [fit_noise([1e-10 * rng.standard_normal(3000)], 1, 0.1) for _ in range(3)]
    >>> phase = 2 * np.pi * time / 12
    >>> rate_dot = 2e-6 * np.stack([np.sin(phase), 0.5 * np.cos(phase), np.sin(2 * phase)], axis=1)
    >>> rate, gradient = np.zeros((1800, 3)), np.zeros((1800, 3, 3))
    >>> reading = -offset_tensor(rate, rate_dot, gradient) @ [100e-6, -20e-6, 30e-6] + 3e-7
    >>> reading += 1e-10 * rng.standard_normal(reading.shape)
    >>> found = com_offset.estimate(rate, rate_dot, gradient, reading, time, noise)
    >>> bool(np.all(np.abs(found.value - [100e-6, -20e-6, 30e-6]) < 4 * found.sigma))
    True
    """
    time = np.asarray(time, dtype=float)
    columns = -sensing.offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    drift = least_squares.polynomial(time, drift_degree, time[0], time[-1])
    return estimating.estimate(reading_b, columns, noise, drift, ("x", "y", "z"), "m")


def solve(resampled: xr.Dataset, measured: xr.Dataset, **settings) -> xr.Dataset:
    """Offset, information and mode shifts of every manoeuvre for one angular acceleration.

    CoM paper eqs. 3-6 with generalised weights; erratum C-12 for the weights and the operator.

    Parameters
    ----------
    resampled : Dataset, "com_offset.equations"
    measured : Dataset, "com_offset.noise"
    settings : drift_degree, noise_order
    """
    given = arrays(resampled)
    settings = settings | {"step_s": float(resampled.attrs["step_s"])}
    noise = models_of(measured)
    source = "quiet data" if noise else "residuals"
    blocks = [_block(given, i, settings) for i in range(resampled.sizes["manoeuvre"])]
    if not noise:
        noise = _residual_noise(blocks, settings)
    level = measured["level"].values
    whitened = [
        _whitened(b, [m.louder(f) for m, f in zip(noise, row, strict=True)])
        for b, row in zip(blocks, level, strict=True)
    ]
    scores = [None if w is None else w["score"] for w in whitened]
    values = _values(blocks, whitened, scores, _joint_offset(scores), resampled.sizes["mode_index"])
    density = np.array([n.density(FREQUENCY) for n in noise]) if noise else np.full((3, FREQUENCY.size), np.nan)
    return product(values | {"noise_density": density}, given, resampled.attrs["variant"], source)


def product(values, given, variant: str, source: str) -> xr.Dataset:
    """Product of a solution."""
    kept = {n: given[n] for n in ("kind", "start", "stop", "latitude", "mode_shared", "mode_catalogue")}
    attrs = {"variant": variant, "direction": "proof_mass_to_com", "noise_source": source}
    return build(SCHEMAS["solve"], values | kept | {"frequency": FREQUENCY}, **attrs)


def nothing(count: int) -> dict[str, np.ndarray]:
    """Values of a solution in which so many manoeuvres tell nothing."""
    values = _values([None] * count, [], [], None, 0)
    return values | {"noise_density": np.full((3, FREQUENCY.size), np.nan)}


def _joint_offset(scores):
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
    rate_dot = np.concatenate([given["rate_dot_b"][None, inside], driven, modes])
    turning = list(-sensing.rotation_tensor(np.zeros(3), rate_dot))
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
    """Whitened reading, columns and instruments without drift, modes; the rows of the three axes stacked."""
    if block is None:
        return None
    valid, drift = block["valid"], block["drift"]
    own = [block["design"], *([] if block["instruments"] is None else [block["instruments"]]), *block["modes"]]
    columns = np.concatenate([block["reading"][:, :, None], *own], axis=2)
    white = []
    for a in range(3):
        turned = whiten(noise[a], np.concatenate([columns[:, a], drift], axis=1), valid)
        white.append(least_squares.without(turned[:, columns.shape[2] :], turned[:, : columns.shape[2]]))
    reading, *parts = np.split(np.concatenate(white), np.arange(1, columns.shape[2], 3), axis=1)
    found = {"reading": reading[:, 0], "design": parts.pop(0)}
    found["instruments"] = None if block["instruments"] is None else parts.pop(0)
    none = np.zeros((len(reading), 0))
    found["score"] = least_squares.score(found["reading"], found["design"], none, found["instruments"])
    rows = 3 * int(valid.sum())
    return found | {"modes": parts, "rows": rows, "dof": rows - 3 * drift.shape[1]}


def _residual_noise(blocks, settings):
    """Noise from the residuals of a first solution with white noise, where quiet data are missing."""
    step_s, pieces = settings["step_s"], []
    white = [NoiseModel(np.zeros(0), np.array([1e-18]), step_s)] * 3
    used = [block for block in blocks if block is not None]
    joint = _joint_offset([_whitened(block, white)["score"] for block in used])
    for block in used:
        valid, residual = block["valid"], block["reading"] - block["design"] @ joint
        residual[valid] = least_squares.without(block["drift"][valid], residual[valid])
        pieces.append(residual)
    removed = len(pieces) * (settings["drift_degree"] + 1) + 1
    axes = range(3 if pieces else 0)
    return [fit_noise([p[:, a] for p in pieces], settings["noise_order"], step_s, removed) for a in axes]


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
        A, Z = white["design"], white["instruments"]
        gain = least_squares.stable_inverse(score.information) @ (A if Z is None else Z).T
        residual = white["reading"] - A @ joint
        # noise of the columns weakens the equation, modes act on the joint offset
        extra = 0.0 if Z is None else float(np.sum((least_squares.without(Z, A) @ joint) ** 2) / max(white["rows"], 1))
        table["offset"][i] = score.determined(joint, DIRECTION_LIMIT_M)
        for name in ("right", "normal", "information"):
            table[name][i] = getattr(score, name) / (1 + extra)
        table["mode_shift"][i] = np.array([-gain @ mode @ joint for mode in white["modes"]]).reshape(-1, 3)
        table["chi2"][i], table["dof"][i] = residual @ residual, white["dof"]
        valid = block["valid"]
        both = np.concatenate([block["reading"][valid], block["design"][valid] @ joint], axis=1)
        both = least_squares.without(block["drift"][valid], both)
        series["time_grid"].append(block["time"][valid])
        series["grid_manoeuvre"].append(np.full(int(valid.sum()), i))
        series["reading"].append(both[:, :3])
        series["model"].append(both[:, 3:])
    return table | {n: np.concatenate(v) for n, v in series.items()}


def published_solve(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset) -> xr.Dataset:
    """Offsets and formal errors as printed, CoM paper eqs. 3-9; errata C-7 and C-12 say what is wrong with them.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"
    """
    variant = angular.attrs["variant"]
    aligned, smoothed, angular = (arrays(one) for one in (aligned, smoothed, angular))
    place, count = where(aligned), aligned["start"].size
    offset, information = np.full((count, 3), np.nan), np.zeros((count, 3, 3))
    for i in range(count):
        inside = samples(smoothed, i)
        if inside is None:
            continue
        time = smoothed["time_acc"][inside]
        linear, marked = reading(aligned, time)
        rates = smoothed["rate_b"][inside], angular["rate_dot_b"][inside]
        kept = published_components(int(place["kind"][i]), float(place["latitude"][i]))
        offset[i], formal = published_offset(time, ~marked, linear, rates, kept)
        information[i][np.ix_(kept, kept)] = least_squares.stable_inverse(formal[np.ix_(kept, kept)])
    values = nothing(count) | {"offset": offset, "information": information, "normal": information}
    values["right"] = np.matvec(information, np.nan_to_num(offset))
    return product(values, place | {"mode_shared": [], "mode_catalogue": []}, variant, "published")


def combine(*solved: xr.Dataset, **settings) -> xr.Dataset:
    """One offset for each angular acceleration, with its covariance and three consistency tests.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve", one for each angular acceleration, with its two mode labels
    settings : method, "gravcal", or "published" for the rows and errors of the source paper;
        determined_sigma_um, a component with a larger error is not determined;
        consistency_level, probability below which manoeuvres or angular accelerations do not agree;
        drag_sigma_m_s2 and period_s, a constant acceleration that turns with the swinging body looks like an offset
    """
    limit = settings["determined_sigma_um"] * 1e-6
    method = settings["method"]
    turning = (settings["drag_sigma_m_s2"] * (settings["period_s"] / (2 * np.pi)) ** 2) ** 2 * np.eye(3)
    joint = {s.attrs["variant"]: _joint(s) if method == "gravcal" else _selected(s) for s in solved}
    own = {s.attrs["variant"]: s for s in solved}
    names = [v for v in VARIANTS if v in joint]
    single = {v: _single_covariances(own[v]) for v in names}
    determined = np.array([_determined(joint[v]["covariance"], limit) for v in names])
    values = {name: [joint[v][name] for v in names] for name in ("covariance", "chi2", "dof")}
    values |= {
        "offset": np.where(determined, [joint[v]["offset"] for v in names], np.nan),
        "covariance_total": [joint[v]["covariance_total"] + turning for v in names],
        "determined": determined,
        "manoeuvre_offset": [own[v]["offset"].values for v in names],
        "manoeuvre_covariance": [single[v] for v in names],
        "manoeuvre_determined": [np.array([_determined(c, limit) for c in single[v]]).reshape(-1, 3) for v in names],
        "manoeuvre_chi2": [own[v]["chi2"].values for v in names],
        "manoeuvre_dof": [own[v]["dof"].values for v in names],
    }
    values["variants_chi2"], values["variants_dof"] = _between_variants(joint, limit)
    values["catalogue_chi2"], values["catalogue_dof"] = _against_catalogue(joint, limit)
    values |= {n: solved[0][n].values for n in ("kind", "start", "stop")}
    attrs = {"method": method, "consistency_level": settings["consistency_level"], "direction": "proof_mass_to_com"}
    return build(SCHEMAS["combine"], values, variants=" ".join(names), **attrs)


def adopted(combined: xr.Dataset) -> str | None:
    """Variant whose offset is handed on: of those that determine most components that of the smallest total error.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"

    Returns
    -------
    variant : name; of equal ones the first, None if nothing is determined
    """
    determined = combined["determined"].values.astype(bool)
    variances = np.diagonal(combined["covariance_total"].values, axis1=1, axis2=2)
    totals = np.sum(np.where(determined, variances, 0.0), axis=1)
    counts = determined.sum(axis=1)
    best = int(np.lexsort((totals, -counts))[0])
    return combined.attrs["variants"].split()[best] if counts[best] else None


def with_model_error(
    combined: xr.Dataset, *moved: xr.Dataset, determined_sigma_um: float, added: str = ""
) -> xr.Dataset:
    """The same with covariances that hold the errors of the effects that were taken out of the records before.

    Single manoeuvres and the tests of consistency keep the errors of the noise alone.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    moved : Dataset, "com_offset.combine", one for each direction of the model's errors
    determined_sigma_um : um, a component with a larger error is not determined
    added : text, as of `building.widened`
    """
    new = widened(combined, moved, {"offset": ("covariance", "covariance_total")}, added)
    before = new.get("offset", combined["offset"].values)
    known = np.array([_determined(one, determined_sigma_um * 1e-6) for one in new["covariance"]])
    return replaced(combined, new | {"determined": known.astype("u1"), "offset": np.where(known, before, np.nan)})


def _selected(solved):
    """Rows and errors that the source paper keeps."""
    covariance = np.array([least_squares.covariance(i) for i in solved["information"].values]).reshape(-1, 3, 3)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    mean, error = published_mean(solved["kind"].values, solved["latitude"].values, solved["offset"].values, sigma)
    total = np.diag(np.where(np.isfinite(error), error, np.inf) ** 2)
    return {
        "offset": mean,
        "covariance": total,
        "covariance_total": total,
        "catalogue": np.zeros((0, 3)),
        "noise": total,
        "own": np.zeros((3, 3)),
        "chi2": 0.0,
        "dof": 0,
    }


def _joint(solved):
    """Combination of the manoeuvres of one angular acceleration with its mode errors."""
    shared = solved["mode_shared"].values.astype(bool)
    catalogue = solved["mode_catalogue"].values.astype(bool)[shared]
    seen = np.flatnonzero(np.isfinite(solved["offset"].values).all(axis=1))
    if not seen.size:
        none = np.full((3, 3), np.inf)
        nothing = {"offset": np.full(3, np.nan), "catalogue": np.zeros((catalogue.sum(), 3)), "chi2": 0.0, "dof": 0}
        return nothing | {"covariance": none, "covariance_total": none, "noise": none, "own": none}
    parts = [solved[n].values[seen] for n in ("right", "normal", "information")]
    scores = [least_squares.Score(*part) for part in zip(*parts, strict=True)]
    shift = solved["mode_shift"].values[seen]
    joined = least_squares.combine(scores, list(shift[:, ~shared]), list(shift[:, shared]), PRIOR)
    measured, given = joined.shift[~catalogue], joined.shift[catalogue]
    total = joined.covariance + measured.T @ measured
    return {
        "offset": joined.value,
        "covariance": total,
        "covariance_total": total + given.T @ given,
        "catalogue": given,
        **_parts(scores, list(shift[:, ~shared])),
        "chi2": joined.chi2,
        "dof": joined.dof,
    }


def _parts(scores, own):
    """Covariance of a combination in two parts, of the noise of the linear channels and of the own modes.

    With P = (I^-1 + M M')^-1, T = sum P: of the noise T^-1 (sum P I^-1 P) T^-1, of the modes T^-1 (sum P M M' P) T^-1.
    """
    weight = [least_squares.weakening(s.information, m) for s, m in zip(scores, own, strict=True)]
    total = least_squares.stable_inverse(PRIOR + sum(w @ s.information for w, s in zip(weight, scores, strict=True)))
    noise = sum(w @ s.information @ w.T for w, s in zip(weight, scores, strict=True))
    moves = [m @ (w @ s.information).T for w, s, m in zip(weight, scores, own, strict=True)]
    return {"noise": total @ noise @ total.T, "own": total @ sum(m.T @ m for m in moves) @ total.T}


def _single_covariances(solved):
    """Covariance (k, 3, 3) m2 of each manoeuvre: noise and its own modes; the shared measured ones too."""
    kept = ~solved["mode_catalogue"].values.astype(bool)
    own = solved["mode_shift"].values[:, kept]
    noise = [least_squares.covariance(information + PRIOR) for information in solved["information"].values]
    return np.array(noise).reshape(-1, 3, 3) + np.swapaxes(own, 1, 2) @ own


def _determined(covariance, limit):
    """Which components are known better than the limit."""
    sigma = np.sqrt(np.clip(np.diag(covariance), 0, None))
    return np.isfinite(sigma) & (sigma < limit)


def _between_variants(joint, limit):
    """Chi-square and degrees of freedom of the angular accelerometer against the star camera, without the catalogue.

    Neither holds inertia or dipole of the catalogue; the prior of the angular accelerometer's scale is within. Both
    share the noise of the linear channels; what is left is their own modes, and the noise by which they are worse than
    the best weights (mtq). acc_calibrated is acc scaled to the torquers: it says nothing that mtq and acc do not say.
    """
    return _difference(joint, ("acc", "sca"), limit)


def _against_catalogue(joint, limit):
    """Chi-square and degrees of freedom of the torquers against a measured angular acceleration.

    The prior errors of both (inertia, dipole per current, angular scale) are in the covariance, so where the catalogue
    is better than its prior the chi-square is small: this test sees a catalogue that is worse than it says, nothing
    finer.
    """
    for name in ("acc", "sca"):
        chi2, dof = _difference(joint, ("mtq", name), limit)
        if dof:
            return chi2, dof
    return 0.0, 0


def _difference(joint, names, limit):
    """Chi-square of the difference of two variants over the directions that both determine, prior errors within.

    Directions, not components: what one manoeuvre leaves open along x leaks into z by their correlation.
    """
    if not set(names) <= set(joint):
        return 0.0, 0
    one, other = (joint[name] for name in names)
    known = [one["covariance"], other["covariance"], joint.get("mtq", one)["noise"]]
    if not np.isfinite(known).all():
        return 0.0, 0
    size, vectors = np.linalg.eigh((known[0] + known[1]) / 2)
    basis = vectors[:, size < limit**2]
    inner = [{n: basis.T @ j[n] @ basis for n in ("own", "noise")} for j in (one, other)]
    shared = basis.T @ known[2] @ basis
    moves = np.concatenate([one["catalogue"], other["catalogue"]])
    covariance = sum(j["own"] + _excess(j["noise"], shared) for j in inner) + basis.T @ moves.T @ moves @ basis
    difference = basis.T @ (one["offset"] - other["offset"])
    return float(difference @ np.linalg.solve(covariance, difference)), basis.shape[1]


def _excess(covariance, noise):
    """Noise beyond the shared one, never negative, 0.1 % of that as floor."""
    size, vectors = np.linalg.eigh(covariance - noise)
    return (vectors * np.clip(size, 0, None)) @ vectors.T + 0.001 * noise


# as printed in the source paper


def published_components(kind: int, latitude: float) -> list[int]:
    """Components that the paper prints for a manoeuvre (Table 7): two of pitch and roll at high latitude, else all."""
    if abs(latitude) <= HIGH_LATITUDE:
        return [0, 1, 2]
    return {0: [1, 2], 1: [0, 2]}.get(kind, [0, 1, 2])


def published_offset(time, good, linear, rates, solved) -> tuple[np.ndarray, np.ndarray]:
    """Offset and formal covariance of one manoeuvre, eqs. 3-9, samples counted as independent (erratum C-12).

    Parameters
    ----------
    time : (n,) s; good : (n,) bool
    linear : (n, 3) m s-2
    rates : (n, 3) rad s-1 and (n, 3) rad s-2
    solved : components estimated, the others held at zero

    Returns
    -------
    offset : (3,) m, proof mass to centre of mass
    covariance : (3, 3) m2, infinite variance for components not estimated
    """
    reading = linear - linear[good].mean(axis=0)
    operator = lowpass_resampler(time, good, time, lowpass_hz=LOWPASS_HZ, half_width_s=6.0)
    filtered = operator(np.nan_to_num(np.concatenate([reading, *rates], axis=1)))[operator.valid]
    at = time[operator.valid]
    series = least_squares.without(np.stack([np.ones_like(at), at - at[0]], axis=1), filtered)
    A = sensing.published_offset_matrix(series[:, 3:6], series[:, 6:9]).reshape(-1, 3)[:, solved]
    weight, observed = np.tile(WEIGHTS, len(series)), series[:, :3].ravel()
    inverse = least_squares.stable_inverse(A.T @ (weight[:, None] * A))
    value = inverse @ A.T @ (weight * observed)
    residual = observed - A @ value
    offset, covariance = np.full(3, np.nan), np.diag(np.full(3, np.inf))
    offset[solved] = value
    covariance[np.ix_(solved, solved)] = inverse * float(weight @ residual**2) / (observed.size - len(solved))
    return offset, covariance


def published_mean(kind, latitude, offset, sigma) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of the rows that the paper keeps: x of pitch, y and z of roll, at high latitude.

    The error is the weighted mean of the errors, as printed (erratum C-9).

    Parameters
    ----------
    kind : (k,) 0 roll, 1 pitch, 2 yaw
    latitude : (k,) rad
    offset, sigma : (k, 3) m

    Returns
    -------
    mean, error : (3,) m, NaN where no row is kept
    """
    mean, error = np.full(3, np.nan), np.full(3, np.nan)
    high = np.abs(latitude) > HIGH_LATITUDE
    for axis, wanted in enumerate((1, 0, 0)):
        rows = high & (kind == wanted) & np.isfinite(offset[:, axis])
        if rows.any():
            weight = 1 / sigma[rows, axis] ** 2
            mean[axis] = np.sum(weight * offset[rows, axis]) / weight.sum()
            error[axis] = np.sum(weight * sigma[rows, axis]) / weight.sum()
    return mean, error
