"""Four angular accelerations, and reading and columns of every manoeuvre for each on the grid of the solution."""

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import published
from gravcal.effects import Context, effect
from gravcal.estimation.resampling import operator_for

SCHEMAS = schemas.of("com_offset.toml")

#: Prior of the angular accelerometer's scale (3,).
ANGULAR_SCALE_PRIOR = np.array([one.prior_sigma for one in effect("accelerometer.angular_scale").parameters])
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")


def angular_acceleration(smoothed: xr.Dataset, aligned: xr.Dataset, **settings) -> xr.Dataset:
    """One of the four angular accelerations on the accelerometer epochs of the manoeuvres.

    An uncertainty that has a shape is kept as a mode: the change of the angular acceleration for one standard
    deviation. Shared modes act in all manoeuvres together; catalogue modes come from inertia and dipole per current, of
    `acc` from the prior of its scale.

    Parameters
    ----------
    smoothed : Dataset, "com_offset.attitude"
    aligned : Dataset, "align"
    settings : variant, method, inertia, inertia_sigma, dipole_per_current, dipole_per_current_sigma
    """
    variant, torquer = settings["variant"], smoothed["rate_dot_mtq_b"].values
    time, manoeuvre = smoothed["time_acc"].values, smoothed["acc_manoeuvre"].values
    measured = aligned["angular_b"].values[np.searchsorted(aligned["time_acc"].values, time)].copy()
    for one in np.unique(manoeuvre):  # a bias only adds a constant
        measured[manoeuvre == one] -= np.nanmean(measured[manoeuvre == one], axis=0)
    if settings["method"] == "published":  # without errors
        value = {"mtq": torquer, "acc": np.nan_to_num(measured)}.get(variant)
        if variant == "acc_calibrated":
            value = np.zeros_like(measured)
            for one in np.unique(manoeuvre):
                rows = manoeuvre == one
                value[rows] = published.calibrated(np.nan_to_num(measured[rows]), torquer[rows], time[rows])
        elif variant == "sca":
            value = published.differenced(aligned["time_sca"].values, aligned["quaternion"].values, time)
        modes, shared, given = np.zeros((0, time.size, 3)), 0, 0
        scale, sigma, ratio, attrs = np.ones(3), np.zeros(3), np.ones(3), {"method": "published"}
    else:
        scale, sigma = _angular_scale(smoothed)
        value, modes, shared, given = _with_modes(smoothed, measured, scale, sigma, settings)
        ratio, attrs = _ratio(variant, scale, smoothed), {}
    index = np.arange(len(modes))
    values = {
        "time_acc": time,
        "acc_manoeuvre": manoeuvre,
        "rate_dot_b": value,
        "mode": modes,
        "mode_shared": index < shared,
        "mode_catalogue": (index >= shared - given) & (index < shared),
        "ratio": ratio,
        "scale": scale,
        "scale_sigma": sigma,
    }
    return build(SCHEMAS["angular_acceleration"], values, variant=variant, **attrs)


def _with_modes(smoothed, measured, scale, sigma, settings):
    """Angular acceleration, its modes, how many of them are shared and how many of those the catalogue's."""
    variant = settings["variant"]
    inertia, inertia_sigma = (np.diag(np.asarray(settings[name])) for name in ("inertia", "inertia_sigma"))
    dipole = np.asarray(settings["dipole_per_current_sigma"]) / np.asarray(settings["dipole_per_current"])
    catalogue = _axis_modes(smoothed["magnetic_b"].values, np.hypot(inertia_sigma / inertia, np.max(dipole)))
    if variant == "mtq":
        return smoothed["rate_dot_mtq_b"].values, catalogue, 3, 3
    if variant == "acc":  # as it is: nothing but its prior says how far its scale is off
        return measured, _axis_modes(measured, ANGULAR_SCALE_PRIOR), 3, 3
    if variant == "sca":
        return smoothed["rate_dot_sca_b"].values, smoothed["sca_modes"].values, 0, 0
    scaled = measured * scale
    return scaled, np.concatenate([_axis_modes(scaled, sigma / scale), catalogue]), 6, 3


def _axis_modes(series, sigma):
    """Scale error of each axis as a mode (3, n, 3)."""
    return np.einsum("a,na,ab->anb", np.where(np.isfinite(sigma), sigma, 0.0), np.nan_to_num(series), np.eye(3))


def _ratio(variant, scale, smoothed):
    """Size of the torquer's wave in this angular acceleration over the catalogue's, one number an axis."""
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
    """Torquer over angular accelerometer per axis (CoM paper eq. 31), from all manoeuvres; one where none turns it.

    The noise-free torquer stands on the right-hand side, so the slope carries no attenuation (erratum C-7).
    """
    ratio, sigma = smoothed["angular_scale"].values, smoothed["angular_scale_sigma"].values
    weight = np.where(np.isfinite(sigma) & (sigma > 0) & np.isfinite(ratio), 1 / np.maximum(sigma, 1e-12) ** 2, 0.0)
    total = weight.sum(axis=0)
    mean = np.sum(weight * np.nan_to_num(ratio), axis=0) / np.where(total > 0, total, 1)
    seen = (total > 0.2**-2) & (np.abs(mean) > 0.2)
    scale = np.where(seen, 1 / np.where(seen, mean, 1), 1.0)
    return scale, np.where(seen, scale**2 / np.sqrt(np.where(total > 0, total, 1)), np.inf)


def equations(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset, **settings) -> xr.Dataset:
    """Resampled reading, columns, instruments and modes of every manoeuvre, for one angular acceleration.

    CoM paper eqs. 3-5; erratum C-12 for the operator, one for reading and columns. The columns are linear in the
    angular acceleration, so that this is resampled, not its nine columns.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"
    settings : lowpass_hz, half_width_s, step_s

    Returns
    -------
    resampled : Dataset, "com_offset.equations"; a manoeuvre with too few samples has no epochs in it
    """
    records, motion, turning = arrays(aligned), arrays(smoothed), arrays(angular)
    driven, modes = int(angular.attrs["variant"] != "mtq"), angular.sizes["mode_index"]
    blocks = {-1: {"epoch": np.zeros(0), "valid": np.zeros(0), "reading": np.zeros((0, 3))}}  # for the shapes
    blocks[-1] |= {"still": np.zeros((0, 3, 3)), "rate_dot_b": np.zeros((1 + driven + modes, 0, 3))}
    for index in range(aligned.sizes["manoeuvre"]):
        block = _block(records, motion, turning, index, driven, settings)
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
    """Kind, times (s) and latitude (rad) of every manoeuvre."""
    start, stop = aligned["start"], aligned["stop"]
    position, time = aligned["position_e"], aligned["time_orbit"]
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"], "start": start, "stop": stop, "latitude": latitude}


def samples(smoothed, index):
    """Samples of a manoeuvre in "com_offset.attitude", as a slice where they are in one piece; None with too few."""
    inside = np.flatnonzero(smoothed["acc_manoeuvre"] == index)
    if inside.size < 200:
        return None
    whole = slice(inside[0], inside[-1] + 1)
    return whole if whole.stop - whole.start == inside.size else inside


def reading(aligned, time) -> tuple[np.ndarray, np.ndarray]:
    """Linear acceleration (n, 3) m s-2 at epochs of the record, and which of them are not usable (n,)."""
    at = np.searchsorted(aligned["time_acc"], time)
    linear = aligned["linear_b"][at]
    return linear, (aligned["acc_flag"][at] != 0) | ~np.isfinite(linear).all(axis=1)


def columns(time, rate, rate_dot, gradient) -> np.ndarray:
    """Reading per metre of offset, s-2.

    Parameters
    ----------
    time : (n,) s
    rate : (n, 3) or (3,) rad s-1
    rate_dot : (..., n, 3) rad s-2
    gradient : (n, 3, 3) or (3, 3) s-2

    Returns
    -------
    columns : (..., n, 3, 3), axis and component
    """
    context = Context(time=time, rate_b=rate, rate_dot_b=rate_dot, gradient_b=gradient)
    return effect("accelerometer.offset").columns(context)


def of_rotation(time, rate_dot) -> np.ndarray:
    """The part of the columns that an angular acceleration has; arguments and result as of `columns`."""
    return columns(time, np.zeros(3), rate_dot, np.zeros((3, 3)))


def _block(aligned, smoothed, angular, index, driven, settings):
    """Resampled reading, columns and angular accelerations of one manoeuvre; None without samples."""
    inside = samples(smoothed, index)
    if inside is None:
        return None
    time = smoothed["time_acc"][inside]
    linear, marked = reading(aligned, time)
    value, modes = angular["rate_dot_b"][inside], angular["mode"][:, inside]
    good = ~marked & np.isfinite(value).all(axis=1)
    last = int(np.isfinite(aligned["edge_lower"][index]).sum()) - 1
    late = np.nan_to_num(smoothed["acc_shift"][index])  # edges as the accelerometer sees them
    start = max(aligned["edge_upper"][index, 0] + max(late, 0.0), time[0])
    stop = min(aligned["edge_lower"][index, last] + min(late, 0.0), time[-1])
    operator = operator_for(time, good, start, stop, *(settings[n] for n in ("lowpass_hz", "half_width_s", "step_s")))
    if operator.valid.sum() < 60:
        return None
    noise_free = [smoothed["smooth_b"][inside] + angular["ratio"] * smoothed["magnetic_b"][inside]] if driven else []
    series = np.stack([linear - linear[good].mean(axis=0), value, *noise_free, *modes], axis=1)
    resampled = np.moveaxis(operator(np.nan_to_num(series)), 1, 0)
    still = operator(columns(time, smoothed["rate_b"][inside], np.zeros(3), smoothed["gradient_b"][inside]))
    block = {"epoch": operator.time, "valid": operator.valid, "reading": resampled[0]}
    return block | {"still": still, "rate_dot_b": resampled[1:]}
