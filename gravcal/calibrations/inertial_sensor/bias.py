"""Stage `bias`: segments of a roll solved and joined by a robust mean; what rolling about y leaves undetermined."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.ndimage import median_filter
from scipy.signal import welch

from gravcal.calibrations.inertial_sensor.align import SCHEMAS
from gravcal.calibrations.schemas import build, replaced, widened
from gravcal.errors import EstimationError
from gravcal.estimation import noise
from gravcal.physics import sensing

ENOUGH = 3  # segments that a mean and its scatter need
SEPARABLE = (1, 0, 1)  # about y the direction cosines are constant: b_y and the constant acceleration are one sum (T-9)
MEMORY = 3  # order of the autoregressive noise of a residual, half a minute
LIMIT = 3.0  # standard deviations from the neighbours at which a segment is winsorised
NEIGHBOURS = 5  # segments of the running median
#: Values of a product with the variables that hold their covariances or standard deviations.
ERRORS = {
    "inertial_sensor.scale": {
        "batch_value": ("covariance",),
        "beta": ("beta_sigma",),
        "delay": ("delay_sigma",),
        "k": ("k_sigma", "k_sigma_total"),
    },
    "inertial_sensor.offset": {"offset": ("covariance", "covariance_total")},
    "inertial_sensor.bias": {"bias": ("bias_sigma", "bias_sigma_total")},
}


@dataclass(frozen=True)
class Sensor:
    """Scale factors and offset used."""

    k: np.ndarray  # (3,) m s-2 V-1
    k_sigma: np.ndarray  # (3,) m s-2 V-1, with the error of geometry
    offset: np.ndarray  # (3,) m, centre of mass to test mass
    covariance: np.ndarray  # (3, 3) m2, scale factors held
    covariance_total: np.ndarray  # (3, 3) m2, with the error of the scale factors


@dataclass(frozen=True)
class Model:
    """Terms fitted to a segment beside the bias."""

    trend_degree: int  # of the polynomial; its mean over the segment is the constant
    amplitude_degree: int  # of the polynomials by which non-gravitational accelerations change (published: 1)
    harmonics: int = 0  # of the revolution by which they change as well (published: 0)
    with_offset: bool = True  # keep the term of the offset (published: may be dropped; erratum T-10 says no)


@dataclass(frozen=True)
class Segments:
    """Constants of all segments."""

    time: np.ndarray  # (s,) s, middles
    used: np.ndarray  # (s,) bool
    uniformity: np.ndarray  # (s,) relative scatter of the roll rate
    constant: np.ndarray  # (s, 3) m s-2, of k V with the offset term taken off; minus the bias for x and z
    sigma: np.ndarray  # (s, 3) m s-2, noise as the residual shows it, correlated or not
    volt: np.ndarray  # (s, 3) V, the constant before scaling, offset term included
    offset_slope: np.ndarray  # (s, 3, 3) s-2, mean tensor: change of k V by the offset
    amplitude: np.ndarray  # (s, 2, 2) m s-2, non-gravitational acceleration along x and z of o, by x and by z


def sensor_of(swing: tuple[xr.Dataset, ...], assumed: Mapping) -> Sensor:
    """Scale factors and offset of the swing's (scale, offset), or assumed ones where there is none: ().

    `assumed` is {"k", "k_sigma" m s-2 V-1; "offset_um", "offset_sigma_um" um}.
    """
    if not swing:
        covariance = np.diag((1e-6 * np.array(assumed["offset_sigma_um"])) ** 2)
        k, k_sigma = np.array(assumed["k"]), np.array(assumed["k_sigma"])
        return Sensor(k, k_sigma, 1e-6 * np.array(assumed["offset_um"]), covariance, covariance)
    scale_product, offset_product = swing
    arm, choice = int(scale_product.chosen_arm), int(offset_product.adopted)
    return Sensor(
        scale_product.k.values[arm],
        scale_product.k_sigma_total.values[arm],
        *(offset_product[name].values[choice] for name in ("offset", "covariance", "covariance_total")),
    )


def bias(
    segmented: xr.Dataset,
    *swing: xr.Dataset,
    method,
    segment_s,
    uniformity_limit,
    share_limit,
    trend_degree,
    amplitude_degree,
    amplitude_harmonics,
    k_z_before,
    assumed,
) -> xr.Dataset:
    """Product "inertial_sensor.bias" of the linear axes; after a swing, its bias is NaN without usable segments.

    Swing are "inertial_sensor.scale" and "inertial_sensor.offset", or none, where scale factors and offset are assumed.
    The method "published" has no offset term, and amplitudes are straight lines; k_z_before m s-2 V-1 is the factor
    with which the noise of z was stated before. An EstimationError with fewer than three usable segments and no swing.
    """
    sensor = sensor_of(swing, assumed)
    bins = {name: segmented[name].values for name in segmented.variables}
    if method == "published":
        model = Model(trend_degree, amplitude_degree=1, harmonics=0, with_offset=False)
    else:
        model = Model(trend_degree, amplitude_degree, amplitude_harmonics)
    solved = solve(bins, sensor, model, segment_s, (uniformity_limit, share_limit))
    values = {
        "time_segment": solved.time,
        "segment_bias": -solved.constant,
        "segment_sigma": solved.sigma,
        "used": solved.used,
        "uniformity": solved.uniformity,
        "separable": SEPARABLE,
    }
    facts = {"method": method, "factors_from": "swing" if swing else "assumed"}
    usable = int(np.count_nonzero(solved.used))
    if usable >= ENOUGH:
        values |= estimates(solved, sensor) | spectra(bins, solved, sensor, k_z_before, segment_s)
        return build(SCHEMAS["bias"], values, **facts)
    few = (
        f"found {usable} usable of {solved.used.size} segments, expected {ENOUGH}. Raise uniformity_limit "
        f"({uniformity_limit:g}), lower share_limit ({share_limit:g}), or give a longer roll."
    )
    if not swing:
        raise EstimationError(f"roll: {few}", segments=int(solved.used.size))
    unknown = [name for name, stated in SCHEMAS["bias"].items() if stated["dims"] == "axis"]
    nothing = dict.fromkeys(unknown, np.full(3, np.nan)) | {"amplitude": np.full((2, 2), np.nan)}
    nothing |= {"frequency": np.zeros(0), "density": np.zeros((3, 0))}
    return build(SCHEMAS["bias"], nothing | values, not_determined=few, **facts)


def cut(time: np.ndarray, segment_s: float) -> tuple[float, list[slice]]:
    """Length s of the bins, at epochs (b,) s, of a roll, and slices of the bins of each segment; none holds a gap.

    Where there is one bin only it is as long as a segment.
    """
    step_s = float(np.median(np.diff(time[:1000]))) if time.size > 1 else segment_s
    length = int(round(segment_s / step_s))
    bounds = [0, *(np.flatnonzero(np.diff(time) > 1.5 * step_s) + 1).tolist(), time.size]
    starts = (range(a, b - length + 1, length) for a, b in zip(bounds[:-1], bounds[1:], strict=True))
    return step_s, [slice(first, first + length) for part in starts for first in part]


def offset_terms(rate_b, gradient_b, step_s: float) -> np.ndarray:
    """Tensors (b, 3, 3) s-2 of the offset in the bins of a segment; angular acceleration is that of a line of rates."""
    slope = np.polyfit(step_s * np.arange(len(rate_b)), rate_b, 1)[0]
    return sensing.offset_tensor(rate_b, np.broadcast_to(slope, rate_b.shape), gradient_b)


def orbital_phase(gradient_b: np.ndarray, step_s: float) -> np.ndarray:
    """Angle along the orbit since the first bin (b,) rad, from the gravity gradient (b, 3, 3): |G| = sqrt(6) n^2."""
    return step_s * np.cumsum(np.sqrt(np.linalg.norm(gradient_b, axis=(1, 2)) / np.sqrt(6)))


def design(axis: int, R_bo: np.ndarray, model: Model, phase: np.ndarray | None = None) -> np.ndarray:
    """Columns (b, p) that are fitted to one axis of a segment, the constant first; arguments as of `solve_axis`."""
    trend = np.polynomial.legendre.legvander(np.linspace(-1, 1, len(R_bo)), model.trend_degree)
    change = _changes(len(R_bo), model, phase)
    if axis == 1:  # the constant stays the mean
        waves = change[:, model.amplitude_degree + 1 :]
        return np.concatenate([trend, waves - waves.mean(axis=0)], axis=1)
    return np.concatenate([trend, *(R_bo[:, axis, j, None] * change for j in (0, 2))], axis=1)


def _changes(count, model, phase):
    """Columns (b, c) by which non-gravitational accelerations may change over a segment of `count` bins."""
    change = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), model.amplitude_degree)
    waves = [wave(n * phase)[:, None] for n in range(1, model.harmonics + 1) for wave in (np.cos, np.sin)]
    return np.concatenate([change, *waves], axis=1)


def solve_axis(axis: int, readings: np.ndarray, R_bo: np.ndarray, model: Model, phase: np.ndarray | None = None):
    """Constants of readouts (b, m) of one axis over a segment and their sigma (m,), residual (b, m), mean amplitudes.

    The amplitudes (t, m) are those of each direction that turns; none about y. Phase (b,) rad along the orbit is for
    harmonics.

    Notes
    -----
    k V = -b + trend + sum_J c_iJ (a_J t + a_0J); Remote Sens. 2023, 15, 3817, eqs. 14 and 15 with direction cosines
    (erratum T-3); a_J may hold one and two cycles per revolution beside, as drag does. The cosine with y is constant:
    the constant holds b and the mean of a_y (T-9), and only what changes with the revolution is fitted beside it.
    """
    columns = design(axis, R_bo, model, phase)
    basis, triangle = np.linalg.qr(columns)
    weights = np.linalg.solve(triangle.T, np.eye(triangle.shape[0])[0])  # weights of the constant along the basis
    share = basis.T @ readings
    residual = readings - basis @ share
    variance = np.einsum("bm,bm->m", residual, residual) / (columns.shape[0] - columns.shape[1])
    mean = _changes(len(R_bo), model, phase).mean(axis=0)
    coefficient = np.linalg.solve(triangle, share)[model.trend_degree + 1 :]
    coefficient = coefficient[: 0 if axis == 1 else None].reshape(-1, mean.size, readings.shape[1])
    amplitude = np.einsum("c,jcm->jm", mean, coefficient)
    return weights @ share, np.sqrt(variance * (weights @ weights)), residual, amplitude


def solve(bins: Mapping[str, np.ndarray], sensor: Sensor, model: Model, segment_s: float, limits) -> Segments:
    """Constants of every segment of the bins of `align.reduced`, several spans joined; NaN where bins are missing.

    Limits of a segment that is used: largest relative scatter of the roll rate, least share of samples in a bin.
    """
    (step_s, parts), (uniform, share) = cut(bins["time"], segment_s), limits
    used = np.zeros(len(parts), dtype=bool)
    shapes = (), (3,), (3,), (3,), (3, 3), (2, 2)
    uniformity, constant, sigma, volt, slope, amplitude = (np.full((len(parts), *one), np.nan) for one in shapes)
    residuals = []
    for s, part in enumerate(parts):
        one = {name: values[part] for name, values in bins.items()}
        rate, linear_volt = one["rate_b"], one["linear_volt"]
        if not all(np.isfinite(values).all() for values in (linear_volt, one["R_bo"], rate)):
            continue
        uniformity[s] = np.std(rate[:, 1]) / np.abs(np.mean(rate[:, 1]))
        used[s] = uniformity[s] <= uniform and one["share"].min() >= share
        tensor = offset_terms(rate, one["gradient_b"], step_s)
        offset_term = np.matvec(tensor, sensor.offset) if model.with_offset else 0.0
        readings = np.stack([sensor.k * linear_volt - offset_term, linear_volt], axis=2)
        phase = orbital_phase(one["gradient_b"], step_s)
        residual = np.empty_like(linear_volt)
        for axis in range(3):
            fitted, error, rest, amplitudes = solve_axis(axis, readings[:, axis], one["R_bo"], model, phase)
            (constant[s, axis], volt[s, axis]), sigma[s, axis], residual[:, axis] = fitted, error[0], rest[:, 0]
            if axis != 1:
                amplitude[s, axis // 2] = amplitudes[:, 0]
        slope[s] = tensor.mean(axis=0)
        if used[s]:
            residuals.append(residual)
    if residuals:
        sigma *= redness(np.array(residuals), step_s)
    time = np.array([np.mean(bins["time"][part]) for part in parts])
    return Segments(time, used, uniformity, constant, sigma, volt, slope, amplitude)


def redness(residual: np.ndarray, step_s: float) -> np.ndarray:
    """Ratio (3,) by which noise below a few cycles of the roll exceeds white noise of the same variance, at least 1."""
    slow = np.linspace(0, 4 / (residual.shape[1] * step_s), 9)
    models = [noise.fit_noise(list(residual[:, :, axis]), MEMORY, step_s) for axis in range(3)]
    white = np.maximum(2 * step_s * np.mean(residual**2, axis=(0, 1)), 1e-300)
    return np.sqrt(np.maximum([m.density(slow).mean() for m in models] / white, 1.0))


def robust_mean(values: np.ndarray, sigma: np.ndarray, missing: Sequence[int] = ()) -> tuple[float, float, float]:
    """Winsorised mean of values (n,) with sigma (n,) over the time covered, its sigma, and rms of their slow wander.

    Its error comes from the error of every value; what the values scatter beyond it is a slow wander, which a mean over
    the time covered rightly contains. So a value is judged by its neighbours: judged by the mean of all, wander would
    count as outlying, and the result be no mean of it. Where values are missing the wander is not seen, and its error
    is added: runs of r values left out of N add wander^2 sum r^2 / N^2, neighbours being alike. Sigma is NaN for fewer
    than three values; missing are the lengths of the runs left out between them.
    """
    if values.size < 3:
        return float(np.mean(values)) if values.size else np.nan, np.nan, np.nan
    white = np.sqrt(np.mean(np.minimum(sigma, LIMIT * np.median(sigma)) ** 2))  # one that is disturbed sets no limit
    local = median_filter(values, size=min(NEIGHBOURS, values.size), mode="mirror")
    deviation = values - local
    limit = LIMIT * max(1.4826 * np.median(np.abs(deviation)), white, 1e-300)
    winsorised = local + np.minimum(1.0, limit / np.maximum(np.abs(deviation), 1e-300)) * deviation
    wander = np.sqrt(max(np.var(winsorised, ddof=1) - white**2, 0.0))
    unobserved = wander * np.linalg.norm(missing) / (values.size + sum(missing))
    return float(winsorised.mean()), float(np.hypot(white / np.sqrt(values.size), unobserved)), float(wander)


def estimates(solved: Segments, sensor: Sensor) -> dict:
    """Joined bias (3,) m s-2, the parts of its error, mean non-gravitational amplitudes, {variable: array}.

    Notes
    -----
    b = -(constant of k V); sigma holds the noise of the segments and the error of the offset, which is common to
    all of them; the total adds the relative error of k, which multiplies b (erratum T-8).
    """
    used = solved.used
    edges = np.flatnonzero(np.diff(np.concatenate([[1], used, [1]]).astype(int)))
    gaps = (edges[1::2] - edges[::2]).tolist()
    sigma = solved.sigma[used]
    values, readings = -solved.constant[used].T, -solved.volt[used].T
    value, statistical, wander = np.transpose([robust_mean(*one, gaps) for one in zip(values, sigma.T, strict=True)])
    of_volts = zip(readings, (sigma / sensor.k).T, strict=True)
    volt, volt_sigma, _ = np.transpose([robust_mean(*one, gaps) for one in of_volts])
    slope = solved.offset_slope[used].mean(axis=0)
    of_offset = sensor.covariance, sensor.covariance_total
    common, common_total = (np.sqrt(np.diag(slope @ matrix @ slope.T)) for matrix in of_offset)
    factor = np.abs(value) * sensor.k_sigma / sensor.k
    return {
        "bias": value,
        "bias_sigma": np.hypot(statistical, common),
        "bias_sigma_total": np.hypot(np.hypot(statistical, common_total), factor),
        "bias_volt": volt,
        "bias_volt_sigma": volt_sigma,
        "statistical_sigma": statistical,
        "offset_sigma": common,
        "factor_sigma": factor,
        "wander": wander,
        "offset_effect": -slope @ sensor.offset,
        "amplitude": solved.amplitude[used].mean(axis=0),
    }


def spectra(bins: Mapping[str, np.ndarray], solved: Segments, sensor: Sensor, k_z_before: float, segment_s) -> dict:
    """Amplitude spectra {"frequency": (f,) Hz, "density": (3, f)} of z: by old factor, by new, less motion and drag.

    Notes
    -----
    Median over the segments, over what the median of so many periodograms is of the mean: 0.69 to 1 in power. White
    noise keeps its density in means of bins: what their roll-off takes, aliasing gives back.
    """
    step, parts = cut(bins["time"], segment_s)
    raw, residuals = [], []
    for part in (part for part, used in zip(parts, solved.used, strict=True) if used):
        volt, gradient, R_bo = (bins[name][part] for name in ("linear_volt", "gradient_b", "R_bo"))
        tensor = offset_terms(bins["rate_b"][part], gradient, step)
        reading = sensor.k[2] * volt[:, 2] - (tensor @ sensor.offset)[:, 2]
        raw.append(volt[:, 2])
        residuals.append(solve_axis(2, reading[:, None], R_bo, Model(3, 1, 2), orbital_phase(gradient, step))[2][:, 0])
    spectrum = {"fs": 1 / step, "nperseg": raw[0].size, "noverlap": 0, "average": "median"}
    frequency, volts = welch(np.concatenate(raw), detrend="linear", **spectrum)
    _, residual_power = welch(np.concatenate(residuals), **spectrum)
    density = np.sqrt([k_z_before**2 * volts, sensor.k[2] ** 2 * volts, residual_power])
    return {"frequency": frequency[2:], "density": density[:, 2:]}


def with_model_error(solved: xr.Dataset, *moved: xr.Dataset, kind: str) -> xr.Dataset:
    """Product whose errors hold those of a model taken out before; one moved product for each direction of these."""
    return replaced(solved, widened(solved, moved, ERRORS[kind]))
