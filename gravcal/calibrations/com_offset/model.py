"""Field along the orbit, four angular accelerations, and reading and columns of every manoeuvre for each of them."""

import numpy as np
import xarray as xr

from gravcal.calibrations.align import between
from gravcal.calibrations.com_offset.align import SCHEMAS, SURVEY_S
from gravcal.calibrations.schemas import build
from gravcal.estimation import least_squares
from gravcal.estimation.resampling import lines_between, operator_for
from gravcal.physics import earth, frames, kinematics, magnetic, sensing

HALF_WIDTH = 2  # star-camera samples on either side of an epoch, of the parabola whose slope is the rate
DRIFT_DEGREE = 2  # of the polynomial in the roll rate that stands for all torques but those of the torquers
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
ORBITAL_PERIOD_S = 97.13 * 60.0  # Sec. 3.4 of the CoM paper; erratum C-7


def field(aligned: xr.Dataset, *, igrf_generation: int) -> xr.Dataset:
    """Product "com_offset.field" of an "align": IGRF along the orbit, and magnetometer minus IGRF in the body."""
    good = aligned["orbit_flag"].values == 0
    time = aligned["time_orbit"].values[good]
    position_e = aligned["position_e"].values[good]
    field_e = magnetic.field_e(time, position_e, igrf_generation)
    field_i = np.matvec(np.swapaxes(earth.R_ei(time), 1, 2), field_e)
    usable, model_b = _at_magnetometer(aligned, time, field_i)
    difference = aligned["field_measured_b"].values - model_b
    used = difference[usable] if usable.any() else np.full((1, 3), np.nan)
    latitude, longitude, _ = earth.geocentric(position_e)
    values = {
        "time_orbit": time,
        "time_mag": aligned["time_mag"].values,
        "field_i": field_i,
        "position_i": aligned["position_i"].values[good],
        "latitude": latitude,
        "longitude": longitude,
        "model_b": model_b,
        "measured_b": aligned["field_measured_b"].values,
        "difference_b": difference,
        "used": usable,
        "bias": used.mean(axis=0),
        "rms": np.sqrt(np.mean(used**2, axis=0)),
        "maximum": np.abs(used).max(axis=0),
    }
    digest = magnetic.coefficient_digest(igrf_generation)
    return build(SCHEMAS["field"], values, igrf_generation=igrf_generation, igrf_sha256=digest)


def _at_magnetometer(aligned, time, field_i):
    """Usable (m,) bool, and IGRF in the body (m, 3) T at the magnetometer epochs, NaN without attitude or orbit."""
    mag_time = aligned["time_mag"].values
    sca_time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    known = np.isfinite(quaternion).all(axis=1)
    model_b = np.full((mag_time.size, 3), np.nan)
    if known.sum() < 2 or time.size < 2:
        return np.zeros(mag_time.size, dtype=bool), model_b
    covered = between(mag_time, sca_time[known], 2.0) & between(mag_time, time, 2.0)
    epochs = mag_time[covered]
    attitude = frames.interpolate(sca_time[known], quaternion[known], epochs)
    model_b[covered] = np.matvec(frames.R_bi_from_quaternion(attitude), lines_between(epochs, time, field_i))
    measured = aligned["field_measured_b"].values
    return covered & (aligned["mag_flag"].values == 0) & np.isfinite(measured).all(axis=1), model_b


def survey(aligned: xr.Dataset, checked: xr.Dataset) -> xr.Dataset:
    """Slope of the roll motion seen by the star camera on the roll torque of current and measured field.

    Rate and torque pass the same operator: the slope of a parabola over five samples of the attitude, and of the torque
    integrated twice. A quadratic drift of the rate is estimated along, and the error counts the correlation of the
    residuals. slope = k / Ixx, dipole per current over roll inertia (docs/com_offset.md, Limits). Products are "align"
    and "com_offset.field".
    """
    time, rate, impulse = _series(aligned, checked)
    slope, sigma = _slope(rate, impulse)
    values = {
        "time_sca": time,
        "roll_rate": rate,
        "roll_impulse": impulse,
        "slope": slope,
        "slope_sigma": sigma,
    }
    return build(SCHEMAS["survey"], values, title="Torque against roll acceleration")


def _series(aligned, checked):
    """Epochs (n,) s, roll rate (n,) rad s-1, and time integral of (current x field)_x (n,) mA T s by one operator."""
    start = float(aligned["window_start"][0])
    stop = min(start + SURVEY_S, float(aligned["window_stop"][0]), float(aligned["time_mag"].values[-1]))
    time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    used = (time >= start) & (time <= stop) & np.isfinite(quaternion).all(axis=1)
    time = time[used]
    if time.size < 4 * HALF_WIDTH or np.any(np.abs(np.diff(time) - 1) > 1e-3):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    rate, _ = kinematics.rates_from_attitude(time, quaternion[used], half_width=HALF_WIDTH, degree=2)
    usable = aligned["mag_flag"].values == 0
    mag_time, *both = (one.values[usable] for one in (aligned["time_mag"], aligned["current_b"], checked["measured_b"]))
    torque = np.cross(*map(np.nan_to_num, both))[:, 0]
    fine_time = np.arange(time[0], time[-1] + 0.01, 0.01)
    held_torque = torque[np.searchsorted((mag_time[1:] + mag_time[:-1]) / 2, fine_time)]  # round each sample
    angle = np.interp(time, fine_time, np.cumsum(np.cumsum(held_torque)) * 1e-4)
    offset = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    slope = np.linalg.pinv(np.vander(offset, 3, increasing=True))[1]
    inner = slice(HALF_WIDTH, -HALF_WIDTH)
    return time[inner], rate[inner, 0], np.convolve(angle, slope[::-1], mode="valid")


def _slope(rate, impulse):
    """Slope of rate (n,) on impulse (n,) and its sigma, quadratic drift projected out; NaN if they are too few."""
    if rate.size < 20 or np.std(impulse) == 0:
        return np.nan, np.nan
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, rate.size), DRIFT_DEGREE)
    observed, column = (least_squares.project_out(drift, series) for series in (rate, impulse))
    normal = float(column @ column)
    value = float(column @ observed) / normal
    residual = observed - value * column
    sigma = np.sqrt(residual @ residual / (residual.size - DRIFT_DEGREE - 2) / normal)
    correlation = float(np.clip(np.corrcoef(residual[1:], residual[:-1])[0, 1], 0.0, 0.95))
    return value, float(sigma * np.sqrt((1 + correlation) / (1 - correlation)))


def angular_acceleration(smoothed: xr.Dataset, aligned: xr.Dataset, **settings) -> xr.Dataset:
    """One of the four angular accelerations on the accelerometer epochs of the manoeuvres.

    An uncertainty that has a shape is kept as a mode: the change of the angular acceleration for one standard
    deviation. Shared modes act in all manoeuvres together; catalogue modes come from inertia and dipole per current, of
    `acc` from the prior of its scale.
    """
    variant, torquer = settings["variant"], smoothed["rate_dot_mtq_b"].values
    time, manoeuvre = smoothed["time_acc"].values, smoothed["acc_manoeuvre"].values
    measured = aligned["angular_b"].values[np.searchsorted(aligned["time_acc"].values, time)].copy()
    for number in np.unique(manoeuvre):  # a bias only adds a constant
        measured[manoeuvre == number] -= np.nanmean(measured[manoeuvre == number], axis=0)
    if settings["method"] == "published":  # without errors
        value = {"mtq": torquer, "acc": np.nan_to_num(measured)}.get(variant)
        if variant == "acc_calibrated":
            value = np.zeros_like(measured)
            for number in np.unique(manoeuvre):
                rows = manoeuvre == number
                value[rows] = published_calibrated(np.nan_to_num(measured[rows]), torquer[rows], time[rows])
        elif variant == "sca":  # central differences of the attitude, eq. 15, interpolated
            known = np.isfinite(aligned["quaternion"].values).all(axis=1)
            at, attitudes = aligned["time_sca"].values[known], aligned["quaternion"].values[known]
            _, rate_dot = kinematics.published_rates_from_attitude(at, attitudes)
            inside = np.isfinite(rate_dot).all(axis=1)
            value = np.stack([np.interp(time, at[inside], c) for c in rate_dot[inside].T], axis=1)
        modes, shared, catalogued = np.zeros((0, time.size, 3)), 0, 0
        scale, sigma, ratio, attrs = np.ones(3), np.zeros(3), np.ones(3), {"method": "published"}
    else:
        scale, sigma = _angular_scale(smoothed)
        value, modes, shared, catalogued = _with_modes(smoothed, measured, scale, sigma, settings)
        ratio, attrs = _ratio(variant, scale, smoothed), {}
    index = np.arange(len(modes))
    values = {
        "time_acc": time,
        "acc_manoeuvre": manoeuvre,
        "rate_dot_b": value,
        "mode": modes,
        "mode_shared": index < shared,
        "mode_catalogue": (index >= shared - catalogued) & (index < shared),
        "ratio": ratio,
        "scale": scale,
        "scale_sigma": sigma,
    }
    return build(SCHEMAS["angular_acceleration"], values, variant=variant, **attrs)


def _with_modes(smoothed, measured, scale, sigma, settings):
    """Angular acceleration (n, 3) rad s-2 of a variant, modes (m, n, 3), numbers of shared and of catalogue modes."""
    variant = settings["variant"]
    inertia, inertia_sigma = (np.diag(np.asarray(settings[name])) for name in ("inertia", "inertia_sigma"))
    dipole = np.asarray(settings["dipole_per_current_sigma"]) / np.asarray(settings["dipole_per_current"])
    catalogue = _axis_modes(smoothed["magnetic_b"].values, np.hypot(inertia_sigma / inertia, np.max(dipole)))
    if variant == "mtq":
        return smoothed["rate_dot_mtq_b"].values, catalogue, 3, 3
    if variant == "acc":  # as it is: nothing but its prior says how far its scale is off
        return measured, _axis_modes(measured, np.full(3, settings["angular_scale_sigma"])), 3, 3
    if variant == "sca":
        return smoothed["rate_dot_sca_b"].values, smoothed["sca_modes"].values, 0, 0
    scaled = measured * scale
    return scaled, np.concatenate([_axis_modes(scaled, sigma / scale), catalogue]), 6, 3


def _axis_modes(series, sigma):
    """Modes (3, n, 3): change of a series (n, 3) by one sigma (3,) of the scale of each axis."""
    return np.einsum("a,na,ab->anb", np.where(np.isfinite(sigma), sigma, 0.0), np.nan_to_num(series), np.eye(3))


def _ratio(variant, scale, smoothed):
    """Ratio (3,) of the torquers' square wave in the angular acceleration of a variant to that of the catalogue."""
    if variant == "acc":
        return 1 / scale
    if variant != "sca":
        return np.ones(3)
    magnetic = smoothed["magnetic_b"].values
    wave = smoothed["rate_dot_sca_b"].values - smoothed["smooth_b"].values
    size = np.sum(magnetic**2, axis=0)
    ratio = np.sum(magnetic * wave, axis=0) / np.where(size > 0, size, 1.0)
    return np.where((size > 0) & (np.abs(ratio) > 0.2), ratio, 1.0)


def _angular_scale(smoothed):
    """Scale (3,) torquer over angular accelerometer (CoM paper eq. 31) and sigma; 1 and inf where none turns it.

    The noise-free torquer stands on the right-hand side, so the slope carries no attenuation (erratum C-7).
    """
    ratio, sigma = smoothed["angular_scale"].values, smoothed["angular_scale_sigma"].values
    weight = np.where(np.isfinite(sigma) & (sigma > 0) & np.isfinite(ratio), 1 / np.maximum(sigma, 1e-12) ** 2, 0.0)
    total = weight.sum(axis=0)
    mean = np.sum(weight * np.nan_to_num(ratio), axis=0) / np.where(total > 0, total, 1)
    turned = (total > 0.2**-2) & (np.abs(mean) > 0.2)
    scale = np.where(turned, 1 / np.where(turned, mean, 1), 1.0)
    return scale, np.where(turned, scale**2 / np.sqrt(np.where(total > 0, total, 1)), np.inf)


def equations(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset, **settings) -> xr.Dataset:
    """Product "com_offset.equations": resampled reading, columns, instruments and modes for one angular acceleration.

    CoM paper eqs. 3-5; erratum C-12 for the operator, one for reading and columns. The columns are linear in the
    angular acceleration, so that this is resampled, not its nine columns. A manoeuvre with too few samples has no
    epochs.
    """
    records, motion, angular_b = arrays(aligned), arrays(smoothed), arrays(angular)
    driven, modes = int(angular.attrs["variant"] != "mtq"), angular.sizes["mode_index"]
    blocks = {-1: {"epoch": np.zeros(0), "valid": np.zeros(0), "reading": np.zeros((0, 3))}}  # for the shapes
    blocks[-1] |= {"still": np.zeros((0, 3, 3)), "rate_dot_b": np.zeros((1 + driven + modes, 0, 3))}
    for index in range(aligned.sizes["manoeuvre"]):
        block = _block(records, motion, angular_b, index, driven, settings)
        blocks |= {} if block is None else {index: block}
    sizes = [one["epoch"].size for one in blocks.values()]
    values = {"grid_manoeuvre": np.repeat(list(blocks), sizes)}
    for name in ("epoch", "valid", "reading", "still"):
        values[name] = np.concatenate([one[name] for one in blocks.values()])
    rate_dot = np.concatenate([one["rate_dot_b"] for one in blocks.values()], axis=1)
    values |= {"rate_dot_b": rate_dot[0], "driven_b": rate_dot[1 : 1 + driven], "mode": rate_dot[1 + driven :]}
    values |= {n: angular[n].values for n in ("mode_shared", "mode_catalogue")} | where(records)
    return build(SCHEMAS["equations"], values, variant=angular.attrs["variant"], step_s=settings["step_s"])


def arrays(product: xr.Dataset) -> dict[str, np.ndarray]:
    """Variables of a product as bare arrays, by name."""
    return {name: variable.values for name, variable in product.variables.items()}


def where(aligned) -> dict[str, np.ndarray]:
    """{"kind", "start" s, "stop" s, "latitude" rad at the middle}, (k,) each, of the manoeuvres of an "align"."""
    start, stop = aligned["start"], aligned["stop"]
    position, time = aligned["position_e"], aligned["time_orbit"]
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"], "start": start, "stop": stop, "latitude": latitude}


def samples(smoothed, index):
    """Indices (n,) of the accelerometer samples of a manoeuvre in "com_offset.attitude"; None with too few."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"] == index)
    return inside if inside.size >= 200 else None


def reading(aligned, time) -> tuple[np.ndarray, np.ndarray]:
    """Linear acceleration (n, 3) m s-2 at epochs (n,) s of the record, and True (n,) where it is not usable."""
    at = np.searchsorted(aligned["time_acc"], time)
    linear = aligned["linear_b"][at]
    return linear, (aligned["acc_flag"][at] != 0) | ~np.isfinite(linear).all(axis=1)


def _block(aligned, smoothed, angular, index, driven, settings):
    """{"epoch", "valid", "reading", "still", "rate_dot_b"} of one manoeuvre, resampled; None with too few samples."""
    inside = samples(smoothed, index)
    if inside is None:
        return None
    time = smoothed["time_acc"][inside]
    linear, marked = reading(aligned, time)
    value, modes = angular["rate_dot_b"][inside], angular["mode"][:, inside]
    good = ~marked & np.isfinite(value).all(axis=1)
    last = int(np.isfinite(aligned["edge_lower"][index]).sum()) - 1
    edge_shift = np.nan_to_num(smoothed["acc_shift"][index])  # edges as the accelerometer sees them
    start = max(aligned["edge_upper"][index, 0] + max(edge_shift, 0.0), time[0])
    stop = min(aligned["edge_lower"][index, last] + min(edge_shift, 0.0), time[-1])
    operator = operator_for(time, good, start, stop, *(settings[n] for n in ("lowpass_hz", "half_width_s", "step_s")))
    if operator.valid.sum() < 60:
        return None
    noise_free = [smoothed["smooth_b"][inside] + angular["ratio"] * smoothed["magnetic_b"][inside]] if driven else []
    stacked = np.stack([linear - linear[good].mean(axis=0), value, *noise_free, *modes], axis=1)
    resampled = np.moveaxis(operator(np.nan_to_num(stacked)), 1, 0)
    still = operator(-sensing.offset_tensor(smoothed["rate_b"][inside], np.zeros(3), smoothed["gradient_b"][inside]))
    block = {"epoch": operator.time, "valid": operator.valid, "reading": resampled[0]}
    return block | {"still": still, "rate_dot_b": resampled[1:]}


def published_calibrated(measured: np.ndarray, torquer: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Angular accelerometer (n, 3) rad s-2 scaled to the torquers per axis, with orbital Fourier terms, eqs. 31-33."""
    phase = 2 * np.pi * (time - time[0]) / ORBITAL_PERIOD_S
    slow = [np.ones_like(phase), np.sin(phase), np.sin(2 * phase), np.cos(phase), np.cos(2 * phase)]
    adjusted = np.empty_like(measured)
    for axis in range(3):
        columns = np.stack([measured[:, axis], *slow], axis=1)
        scale = np.linalg.norm(columns, axis=0)
        unknown = np.linalg.lstsq(columns / np.where(scale > 0, scale, 1), torquer[:, axis], rcond=None)[0]
        adjusted[:, axis] = (columns / np.where(scale > 0, scale, 1)) @ unknown
    return adjusted
