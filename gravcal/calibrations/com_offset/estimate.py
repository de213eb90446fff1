"""Offset of every manoeuvre and of all together, with noise as measured in quiet data, and whether they agree."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset.model import SCHEMAS, VARIANTS, arrays, reading, samples, where
from gravcal.calibrations.schemas import build, replaced, widened
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import estimate as estimating
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, levels, whiten
from gravcal.estimation.resampling import lowpass_resampler
from gravcal.physics import sensing

#: Loose prior of the offset, 1 mm about zero: requirement 100 um, largest seen 333 um.
PRIOR = np.eye(3) / 1e-3**2
#: A direction in which one manoeuvre knows the offset worse than this is held at the value of all of them.
DIRECTION_LIMIT_M = 1e-4
#: s, shortest quiet data from which the noise is measured.
QUIET_S = 300.0
#: m s-2, far below a step of any accelerometer: a channel that moves no more is dead.
SILENT = 1e-14
FREQUENCY = np.linspace(0.005, 1.0, 200)
#: Of the CoM paper: cut-off (Sec. 4.3), weights of x, y, z (Sec. 3.1), latitude rad between the areas of Table 3.
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

    CoM paper eqs. 3-6 with generalised weights; erratum C-12 for the weights and the operator. Products are
    "com_offset.equations" and "com_offset.noise"; settings are drift_degree and noise_order.
    """
    equations = arrays(resampled)
    settings = settings | {"step_s": float(resampled.attrs["step_s"])}
    noise, source = [], measured.attrs["source_of_noise"].replace("none", "residuals")
    if source != "residuals":
        pairs = zip(measured["reflection"].values, measured["variance"].values, strict=True)
        noise = [NoiseModel(*pair, float(measured.attrs["step_s"])) for pair in pairs]
    blocks = [_block(equations, i, settings) for i in range(resampled.sizes["manoeuvre"])]
    if not noise:
        noise = _residual_noise(blocks, settings)
    level = measured["level"].values
    louder = [[m.louder(f) for m, f in zip(noise, row, strict=False)] for row in level]  # no noise, no block
    whitened = [_whitened(block, models) for block, models in zip(blocks, louder, strict=True)]
    scores = [None if w is None else w["score"] for w in whitened]
    values = _values(blocks, whitened, scores, _joint_offset(scores), resampled.sizes["mode_index"])
    density = np.array([n.density(FREQUENCY) for n in noise]) if noise else np.full((3, FREQUENCY.size), np.nan)
    return product(values | {"noise_density": density}, equations, resampled.attrs["variant"], source)


def product(values, place, variant: str, source: str) -> xr.Dataset:
    """Product "com_offset.solve" from its values; place holds kind, times, latitude and modes of the manoeuvres."""
    kept = {n: place[n] for n in ("kind", "start", "stop", "latitude", "mode_shared", "mode_catalogue")}
    attrs = {"variant": variant, "direction": "proof_mass_to_com", "noise_source": source}
    return build(SCHEMAS["solve"], values | kept | {"frequency": FREQUENCY}, **attrs)


def nothing(count: int) -> dict[str, np.ndarray]:
    """Values of "com_offset.solve" for so many manoeuvres, none of which determines anything."""
    return _values([None] * count, [], [], None, 0) | {"noise_density": np.full((3, FREQUENCY.size), np.nan)}


def _joint_offset(scores):
    """Offset (3,) m of all manoeuvres together, for residuals and for errors that scale with it; NaN without a Score.

    A component that nothing determines stays near zero by a loose prior, so that it does not enlarge these errors.
    """
    usable = [s for s in scores if s is not None]
    if not usable:
        return np.full(3, np.nan)
    return least_squares.stable_inverse(sum(s.normal for s in usable) + PRIOR) @ sum(s.right for s in usable)


def _block(equations, index, settings):
    """{"reading": (n, 3), "design", "instruments", "modes": (n, 3, 3), ...} of one manoeuvre; None without epochs."""
    inside = slice(*np.searchsorted(equations["grid_manoeuvre"], [index, index + 1]))
    if inside.stop == inside.start:
        return None
    time, still = equations["epoch"][inside], equations["still"][inside]
    driven, modes = equations["driven_b"][:, inside], equations["mode"][:, inside]
    rate_dot = np.concatenate([equations["rate_dot_b"][None, inside], driven, modes])
    angular_part = list(-sensing.rotation_tensor(np.zeros(3), rate_dot))
    return {
        "time": time,
        "valid": equations["valid"][inside].astype(bool),
        "reading": equations["reading"][inside],
        "design": still + angular_part[0],
        "instruments": still + angular_part[1] if len(driven) else None,
        "modes": angular_part[1 + len(driven) :],
        "drift": least_squares.polynomial(time, settings["drift_degree"], *time[[0, -1]]),
    }


def _whitened(block, noise):
    """Block (of `_block`) whitened, drift projected out, the rows of three axes stacked; with its Score and "dof"."""
    if block is None:
        return None
    valid, drift = block["valid"], block["drift"]
    designs = [block["design"], *([] if block["instruments"] is None else [block["instruments"]]), *block["modes"]]
    columns = np.concatenate([block["reading"][:, :, None], *designs], axis=2)
    white = []
    for a in range(3):
        axis_rows = whiten(noise[a], np.concatenate([columns[:, a], drift], axis=1), valid)
        white.append(least_squares.project_out(axis_rows[:, columns.shape[2] :], axis_rows[:, : columns.shape[2]]))
    reading, *parts = np.split(np.concatenate(white), np.arange(1, columns.shape[2], 3), axis=1)
    whitened = {"reading": reading[:, 0], "design": parts.pop(0)}
    whitened["instruments"] = None if block["instruments"] is None else parts.pop(0)
    none = np.zeros((len(reading), 0))
    whitened["score"] = least_squares.score(whitened["reading"], whitened["design"], none, whitened["instruments"])
    rows = 3 * int(valid.sum())
    return whitened | {"modes": parts, "rows": rows, "dof": rows - 3 * drift.shape[1]}


def _residual_noise(blocks, settings):
    """NoiseModel of each axis from the residuals of a first solution with white noise, where quiet data are missing."""
    step_s, pieces = settings["step_s"], []
    white = [NoiseModel(np.zeros(0), np.array([1e-18]), step_s)] * 3
    used = [block for block in blocks if block is not None]
    joint = _joint_offset([_whitened(block, white)["score"] for block in used])
    for block in used:
        valid, residual = block["valid"], block["reading"] - block["design"] @ joint
        residual[valid] = least_squares.project_out(block["drift"][valid], residual[valid])
        pieces.append(residual)
    removed = len(pieces) * (settings["drift_degree"] + 1) + 1
    axes = range(3 if pieces else 0)
    return [fit_noise([p[:, a] for p in pieces], settings["noise_order"], step_s, removed) for a in axes]


def _values(blocks, whitened, scores, joint, modes):
    """Values of "com_offset.solve": normal equations, chi-square, mode shifts; reading and model less their drift."""
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
        column_rest = 0.0 if Z is None else least_squares.project_out(Z, A @ joint)
        column_noise = float(np.sum(column_rest**2) / max(white["rows"], 1))  # variance, over that of the reading
        table["offset"][i] = score.determined(joint, DIRECTION_LIMIT_M)
        for name in ("right", "normal", "information"):
            table[name][i] = getattr(score, name) / (1 + column_noise)
        table["mode_shift"][i] = np.array([-gain @ mode @ joint for mode in white["modes"]]).reshape(-1, 3)
        table["chi2"][i], table["dof"][i] = residual @ residual, white["dof"]
        valid = block["valid"]
        pair = np.concatenate([block["reading"][valid], block["design"][valid] @ joint], axis=1)
        pair = least_squares.project_out(block["drift"][valid], pair)
        series["time_grid"].append(block["time"][valid])
        series["grid_manoeuvre"].append(np.full(int(valid.sum()), i))
        series["reading"].append(pair[:, :3])
        series["model"].append(pair[:, 3:])
    return table | {n: np.concatenate(v) for n, v in series.items()}


def published_solve(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset) -> xr.Dataset:
    """Offsets and formal errors as printed, CoM paper eqs. 3-9; errata C-7 and C-12 say what is wrong with them.

    Products are "align", "com_offset.attitude" and "com_offset.angular_acceleration".
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
        high = abs(float(place["latitude"][i])) > HIGH_LATITUDE  # two components of pitch and roll, Table 7, else all
        solved = {0: [1, 2], 1: [0, 2]}.get(int(place["kind"][i]) if high else 2, [0, 1, 2])
        offset[i], formal = published_offset(time, ~marked, linear, rates, solved)
        if np.isfinite(offset[i]).any():
            information[i][np.ix_(solved, solved)] = least_squares.stable_inverse(formal[np.ix_(solved, solved)])
    values = nothing(count) | {"offset": offset, "information": information, "normal": information}
    values["right"] = np.matvec(information, np.nan_to_num(offset))
    return product(values, place | {"mode_shared": [], "mode_catalogue": []}, variant, "published")


def combine(*solved: xr.Dataset, **settings) -> xr.Dataset:
    """One offset for each angular acceleration, with its covariance and three consistency tests.

    Solved are "com_offset.solve", one for each angular acceleration. A component with an error beyond
    determined_sigma_um is not determined; a constant acceleration that turns with the swinging body (drag_sigma_m_s2,
    period_s) looks like an offset; method "published" has the rows and errors of the source paper.
    """
    limit = settings["determined_sigma_um"] * 1e-6
    method = settings["method"]
    drag_covariance = (settings["drag_sigma_m_s2"] * (settings["period_s"] / (2 * np.pi)) ** 2) ** 2 * np.eye(3)
    joint = {s.attrs["variant"]: _joint(s) if method == "gravcal" else _selected(s) for s in solved}
    solutions = {s.attrs["variant"]: s for s in solved}
    names = [v for v in VARIANTS if v in joint]
    single = {}  # noise of each manoeuvre and its own modes; the shared measured ones too
    for v in names:
        shifts = solutions[v]["mode_shift"].values[:, ~solutions[v]["mode_catalogue"].values.astype(bool)]
        noise = [least_squares.covariance(information + PRIOR) for information in solutions[v]["information"].values]
        single[v] = np.array(noise).reshape(-1, 3, 3) + np.swapaxes(shifts, 1, 2) @ shifts
    determined = np.array([_determined(joint[v]["covariance"], limit) for v in names])
    values = {name: [joint[v][name] for v in names] for name in ("covariance", "chi2", "dof")}
    values |= {
        "offset": np.where(determined, [joint[v]["offset"] for v in names], np.nan),
        "covariance_total": [joint[v]["covariance_total"] + drag_covariance for v in names],
        "determined": determined,
        "manoeuvre_offset": [solutions[v]["offset"].values for v in names],
        "manoeuvre_covariance": [single[v] for v in names],
        "manoeuvre_determined": [np.array([_determined(c, limit) for c in single[v]]).reshape(-1, 3) for v in names],
        "manoeuvre_chi2": [solutions[v]["chi2"].values for v in names],
        "manoeuvre_dof": [solutions[v]["dof"].values for v in names],
    }
    # without the catalogue: neither holds its inertia or dipole; the prior of the angular scale is within
    values["variants_chi2"], values["variants_dof"] = _difference(joint, ("acc", "sca"), limit)
    # prior errors of both are in the covariance: a catalogue that is worse than it says is seen, nothing finer
    differences = [_difference(joint, ("mtq", name), limit) for name in ("acc", "sca")]
    values["catalogue_chi2"], values["catalogue_dof"] = next((one for one in differences if one[1]), (0.0, 0))
    values |= {n: solved[0][n].values for n in ("kind", "start", "stop")}
    attrs = {"method": method, "consistency_level": settings["consistency_level"], "direction": "proof_mass_to_com"}
    return build(SCHEMAS["combine"], values, variants=" ".join(names), **attrs)


def adopted(combined: xr.Dataset) -> str | None:
    """Variant of "com_offset.combine" whose offset is handed on, None if nothing is determined.

    Of those that determine most components that of the smallest total error, of equal ones the first.
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
    """Product "com_offset.combine" with covariances that include the errors of effects removed from the records.

    Single manoeuvres and the tests of consistency keep the errors of the noise alone. One moved product for each
    direction of the model's errors; added as of `schemas.widened`.
    """
    new = widened(combined, moved, {"offset": ("covariance", "covariance_total")}, added)
    offset = new.get("offset", combined["offset"].values)
    known = np.array([_determined(one, determined_sigma_um * 1e-6) for one in new["covariance"]])
    return replaced(combined, new | {"determined": known.astype("u1"), "offset": np.where(known, offset, np.nan)})


def _selected(solved):
    """Joint solution, with the keys of `_joint`, from the components and errors that the source paper keeps."""
    covariance = np.array([least_squares.covariance(i) for i in solved["information"].values]).reshape(-1, 3, 3)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    mean, error = published_mean(solved["kind"].values, solved["latitude"].values, solved["offset"].values, sigma)
    total = np.diag(np.where(np.isfinite(error), error, np.inf) ** 2)
    errors = dict.fromkeys(("covariance", "covariance_total", "noise"), total)
    return errors | {"offset": mean, "catalogue": np.zeros((0, 3)), "own": np.zeros((3, 3)), "chi2": 0.0, "dof": 0}


def _joint(solved):
    """Joint solution of a variant: offset (3,) m, covariances (3, 3), shifts by catalogue modes (m, 3), chi2, dof."""
    shared = solved["mode_shared"].values.astype(bool)
    catalogue = solved["mode_catalogue"].values.astype(bool)[shared]
    used = np.flatnonzero(np.isfinite(solved["offset"].values).all(axis=1))
    if not used.size:
        nothing = {"offset": np.full(3, np.nan), "catalogue": np.zeros((catalogue.sum(), 3)), "chi2": 0.0, "dof": 0}
        return nothing | dict.fromkeys(("covariance", "covariance_total", "noise", "own"), np.full((3, 3), np.inf))
    parts = [solved[n].values[used] for n in ("right", "normal", "information")]
    scores = [least_squares.Score(*part) for part in zip(*parts, strict=True)]
    shift = solved["mode_shift"].values[used]
    joined = least_squares.combine(scores, list(shift[:, ~shared]), list(shift[:, shared]), PRIOR)
    measured, catalogued = joined.shift[~catalogue], joined.shift[catalogue]
    total = joined.covariance + measured.T @ measured
    fit = {name: getattr(joined, name) for name in ("noise", "own", "chi2", "dof")}
    return fit | {
        "offset": joined.value,
        "covariance": total,
        "covariance_total": total + catalogued.T @ catalogued,
        "catalogue": catalogued,
    }


def _determined(covariance, limit):
    """True (3,) for components whose standard deviation in a covariance (3, 3) is finite and below the limit."""
    sigma = np.sqrt(np.clip(np.diag(covariance), 0, None))
    return np.isfinite(sigma) & (sigma < limit)


def _difference(joint, names, limit):
    """Chi-square and degrees of freedom of the difference of two variants, over the directions that both determine.

    Both share the noise of the linear channels: the covariance is that of their modes, with prior errors, and of the
    noise by which they are worse than the best weights (mtq). acc_calibrated is acc scaled to the torquers: it adds no
    test. Directions, not components: what one manoeuvre leaves undetermined along x is correlated with z.
    """
    if not set(names) <= set(joint):
        return 0.0, 0
    one, other = (joint[name] for name in names)
    covariances = [one["covariance"], other["covariance"], joint.get("mtq", one)["noise"]]
    if not np.isfinite(covariances).all():
        return 0.0, 0
    size, vectors = np.linalg.eigh((covariances[0] + covariances[1]) / 2)
    basis = vectors[:, size < limit**2]
    inner = [{n: basis.T @ j[n] @ basis for n in ("own", "noise")} for j in (one, other)]
    shared = basis.T @ covariances[2] @ basis
    shifts = np.concatenate([one["catalogue"], other["catalogue"]])
    covariance = basis.T @ shifts.T @ shifts @ basis
    for part in inner:  # noise beyond the shared one, never negative, 0.1 % of that as floor
        beyond, directions = np.linalg.eigh(part["noise"] - shared)
        covariance = covariance + part["own"] + (directions * np.clip(beyond, 0, None)) @ directions.T + 0.001 * shared
    difference = basis.T @ (one["offset"] - other["offset"])
    return float(difference @ np.linalg.solve(covariance, difference)), basis.shape[1]


def published_offset(time, good, linear, rates, solved) -> tuple[np.ndarray, np.ndarray]:
    """Offset (3,) m and formal covariance of one manoeuvre, eqs. 3-9, samples counted as independent (erratum C-12).

    The components not solved for are held at zero, and have infinite variance; linear (n, 3) m s-2, rates (n, 3) rad
    s-1 and (n, 3) rad s-2.
    """
    reading = linear - linear[good].mean(axis=0)
    operator = lowpass_resampler(time, good, time, lowpass_hz=LOWPASS_HZ, half_width_s=6.0)
    offset, covariance = np.full(3, np.nan), np.diag(np.full(3, np.inf))
    if operator.valid.sum() < 100:
        return offset, covariance
    filtered = operator(np.nan_to_num(np.concatenate([reading, *rates], axis=1)))[operator.valid]
    at = time[operator.valid]
    series = least_squares.project_out(np.stack([np.ones_like(at), at - at[0]], axis=1), filtered)
    A = -sensing.rotation_tensor(series[:, 3:6], series[:, 6:9]).reshape(-1, 3)[:, solved]  # eq. 5, without gradient
    weight, observed = np.tile(WEIGHTS, len(series)), series[:, :3].ravel()
    inverse = least_squares.stable_inverse(A.T @ (weight[:, None] * A))
    value = inverse @ A.T @ (weight * observed)
    residual = observed - A @ value
    offset[solved] = value
    covariance[np.ix_(solved, solved)] = inverse * float(weight @ residual**2) / (observed.size - len(solved))
    return offset, covariance


def published_mean(kind, latitude, offset, sigma) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean (3,) m of the rows that the paper keeps: x of pitch, y and z of roll, at high latitude.

    The error is the weighted mean of the errors, as printed (erratum C-9). Kinds (k,) are 0 roll, 1 pitch, 2 yaw.
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


def quiet(aligned: xr.Dataset, **settings) -> xr.Dataset:
    """Linear channels outside the manoeuvres, low-passed and resampled like the reading of a manoeuvre.

    Pieces are as long as a manoeuvre; NaN where there are too few samples.
    """
    linear, epochs, readings = aligned["linear_b"].values, [np.zeros(0)], [np.zeros((0, 3))]
    for inside, good, operator in quiet_operators(aligned, linear, settings):
        epochs.append(operator.time)
        readings.append(operator(linear[inside] - linear[inside][good].mean(axis=0)))
    values = {"epoch": np.concatenate(epochs), "reading": np.concatenate(readings)}
    values["piece"] = np.repeat(np.arange(-1, len(epochs) - 1), [grid.size for grid in epochs])
    values["near"] = nearest(aligned, epochs[1:])
    return build(SCHEMAS["quiet"], values, step_s=settings["step_s"], manoeuvres=aligned.sizes["manoeuvre"])


def nearest(aligned: xr.Dataset, times: list[np.ndarray]) -> np.ndarray:
    """Index (k,) of the manoeuvre nearest to each of k pieces of epochs (n_i,) s; 0 where there is no manoeuvre."""
    middle = (aligned["start"].values + aligned["stop"].values) / 2
    return np.array([np.argmin(np.abs(middle - one.mean())) if middle.size else 0 for one in times], dtype=int)


def quiet_operators(aligned, values, settings):
    """Yield the slice, usable samples (n,) bool and low-pass Resampler of each piece of quiet data long enough."""
    time, step_s = aligned["time_acc"].values, settings["step_s"]
    usable = (aligned["acc_flag"].values == 0) & np.isfinite(values).all(axis=1)
    filters = {name: settings[name] for name in ("lowpass_hz", "half_width_s")}
    for begin, end in quiet_spans(aligned, settings):
        inside = slice(*np.searchsorted(time, [begin, end]))
        if inside.stop - inside.start < 200:
            continue
        grid = np.arange(np.ceil(begin / step_s), np.floor(end / step_s)) * step_s
        operator = lowpass_resampler(time[inside], usable[inside], grid, **filters)
        if operator.valid.sum() >= 100:
            yield inside, usable[inside], operator


def quiet_spans(aligned, settings):
    """Yield begin and end (s) of pieces inside the windows and clear of every manoeuvre, of its length up to 180 s."""
    start, stop = aligned["start"].values, aligned["stop"].values
    margin = settings["quiet_margin_s"]
    lengths = np.minimum(stop - start, 180.0) if start.size else np.full(aligned.sizes["window"], 180.0)
    ends = aligned["window_start"].values, aligned["window_stop"].values
    for window_start, window_stop, length in zip(*ends, lengths, strict=True):
        manoeuvres = [(a - margin, b + margin) for a, b in zip(start, stop, strict=True)]
        begin = window_start
        while begin + length <= window_stop:
            overlapped = [b for a, b in manoeuvres if a < begin + length and b > begin]
            if overlapped:
                begin = max(overlapped)
                continue
            yield begin, begin + length
            begin += length


def noise(pieces: xr.Dataset, *, drift_degree: int, noise_order: int) -> xr.Dataset:
    """Product "com_offset.noise": autoregressive model of each linear channel, none with too little quiet data."""
    step, reading = float(pieces.attrs["step_s"]), pieces["reading"].values
    seconds = step * int(np.isfinite(reading[:, 0]).sum())
    count = int(pieces.attrs["manoeuvres"])
    values = {
        "level": np.ones((count, 3)),
        "level_error": np.zeros((count, 3)),
        "reflection": np.zeros((3, 0)),
        "variance": np.full((3, 1), np.nan),
        "density": np.full((3, FREQUENCY.size), np.nan),
        "frequency": FREQUENCY,
        "seconds": seconds,
    }
    if seconds < QUIET_S:
        return build(SCHEMAS["noise"], values, source_of_noise="none", step_s=step, order=0)
    silent = [axis for axis, size in zip("xyz", np.nanmax(np.abs(reading), axis=0), strict=True) if size < SILENT]
    if silent:
        symptom, remedy = f"the same reading for {seconds:.0f} s", "Fetch ACC1A again, or take another day."
        channel = f"linear acceleration along {', '.join(silent)}"
        refuse(channel, symptom, "noise of 1e-10 m s-2", remedy, EstimationError, axes=silent)
    cuts, quiet_parts = np.flatnonzero(np.diff(pieces["piece"].values)) + 1, []
    for grid, part_values in zip(np.split(pieces["epoch"].values, cuts), np.split(reading.copy(), cuts), strict=True):
        valid = np.isfinite(part_values[:, 0])
        drift = least_squares.polynomial(grid, drift_degree, grid[0], grid[-1])[valid]
        part_values[valid] = least_squares.project_out(drift, part_values[valid])
        quiet_parts.append(part_values)
    removed = len(quiet_parts) * (drift_degree + 1)
    models = [fit_noise([part[:, axis] for part in quiet_parts], noise_order, step, removed) for axis in range(3)]
    values |= {name: np.array([getattr(model, name) for model in models]) for name in ("reflection", "variance")}
    values["density"] = np.array([model.density(FREQUENCY) for model in models])
    amplitudes = levels(models, quiet_parts, [drift_degree + 1] * len(quiet_parts), pieces["near"].values, count)
    values |= {"level": amplitudes.value, "level_error": amplitudes.error}
    return build(SCHEMAS["noise"], values, source_of_noise="quiet data", step_s=step, order=models[0].reflection.size)
