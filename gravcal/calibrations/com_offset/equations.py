"""Four angular accelerations, and reading and columns of every manoeuvre for each on the grid of the solution."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.schemas import ANGULAR, EQUATIONS
from gravcal.effects import Context, effect
from gravcal.estimation.resampling import operator_for

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

    Returns
    -------
    angular : Dataset, "com_offset.angular_acceleration"
    """
    variant = settings["variant"]
    if settings["method"] == "published":
        return _published(smoothed, aligned, variant)
    scale, sigma = _angular_scale(smoothed)
    value, modes, shared, given = _with_modes(smoothed, _measured(smoothed, aligned), scale, sigma, settings)
    index = np.arange(len(modes))
    values = {
        "time_acc": smoothed["time_acc"].values,
        "acc_manoeuvre": smoothed["acc_manoeuvre"].values,
        "rate_dot_b": value,
        "mode": modes,
        "mode_shared": index < shared,
        "mode_catalogue": (index >= shared - given) & (index < shared),
        "ratio": _ratio(variant, scale, smoothed),
        "scale": scale,
        "scale_sigma": sigma,
    }
    return build(ANGULAR, values, variant=variant)


def _with_modes(smoothed, measured, scale, sigma, settings):
    """Angular acceleration, its modes, how many of them are shared and how many of those the catalogue's."""
    variant, magnetic = settings["variant"], smoothed["magnetic_b"].values
    catalogue = _axis_modes(magnetic, _relative_sigma(settings))
    if variant == "mtq":
        return smoothed["rate_dot_mtq_b"].values, catalogue, 3, 3
    if variant == "acc":  # as it is: nothing but its prior says how far its scale is off
        return measured, _axis_modes(measured, ANGULAR_SCALE_PRIOR), 3, 3
    if variant == "sca":
        return smoothed["rate_dot_sca_b"].values, smoothed["sca_modes"].values, 0, 0
    scaled = measured * scale
    return scaled, np.concatenate([_axis_modes(scaled, sigma / scale), catalogue]), 6, 3


def _published(smoothed, aligned, variant):
    """The angular acceleration as printed, without its errors."""
    time, manoeuvre = smoothed["time_acc"].values, smoothed["acc_manoeuvre"].values
    measured, torquer = np.nan_to_num(_measured(smoothed, aligned)), smoothed["rate_dot_mtq_b"].values
    value = {"mtq": torquer, "acc": measured}.get(variant)
    if variant == "acc_calibrated":
        value = np.zeros_like(measured)
        for one in np.unique(manoeuvre):
            rows = manoeuvre == one
            value[rows] = published.calibrated(measured[rows], torquer[rows], time[rows])
    if variant == "sca":
        value = published.differenced(aligned["time_sca"].values, aligned["quaternion"].values, time)
    values = {
        "time_acc": time,
        "acc_manoeuvre": manoeuvre,
        "rate_dot_b": value,
        "mode": np.zeros((0, time.size, 3)),
        "mode_shared": np.zeros(0),
        "mode_catalogue": np.zeros(0),
        "ratio": np.ones(3),
        "scale": np.ones(3),
        "scale_sigma": np.zeros(3),
    }
    return build(ANGULAR, values, variant=variant, method="published")


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


def _measured(smoothed, aligned):
    """Angular accelerometer on the epochs of the manoeuvres, mean of each removed (a bias only adds a constant)."""
    index = np.searchsorted(aligned["time_acc"].values, smoothed["time_acc"].values)
    measured = aligned["angular_b"].values[index].copy()
    manoeuvre = smoothed["acc_manoeuvre"].values
    for one in np.unique(manoeuvre):
        inside = manoeuvre == one
        measured[inside] -= np.nanmean(measured[inside], axis=0)
    return measured


def _relative_sigma(settings):
    """Relative uncertainty (3,) of dipole over inertia about each axis."""
    inertia = np.diag(np.asarray(settings["inertia"]))
    inertia_sigma = np.diag(np.asarray(settings["inertia_sigma"]))
    dipole = np.asarray(settings["dipole_per_current_sigma"]) / np.asarray(settings["dipole_per_current"])
    return np.hypot(inertia_sigma / inertia, np.max(dipole))


def _axis_modes(series, sigma):
    """Scale error of each axis as a mode (3, n, 3)."""
    return np.einsum("a,na,ab->anb", np.where(np.isfinite(sigma), sigma, 0.0), np.nan_to_num(series), np.eye(3))


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

    CoM paper eqs. 3-5; erratum C-12 for the operator, one for reading and columns.

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
    given = [arrays(product) for product in (aligned, smoothed, angular)]
    variant = angular.attrs["variant"]
    driven, modes = int(variant != "mtq"), angular.sizes["mode_index"]
    blocks = [_none(driven, modes)]
    blocks += [_block(*given, i, settings | {"variant": variant}) for i in range(aligned.sizes["manoeuvre"])]
    values = {"grid_manoeuvre": np.repeat(np.arange(-1, len(blocks) - 1), [_size(b) for b in blocks])}
    seen = [b for b in blocks if b is not None]
    values |= {name: np.concatenate([b[name] for b in seen]) for name in ("epoch", "valid", "reading", "still")}
    turning = np.concatenate([b["turning"] for b in seen], axis=1)
    values["rate_dot_b"], values["driven_b"], values["mode"] = np.split(turning, [1, 1 + driven])
    values["rate_dot_b"] = values["rate_dot_b"][0]
    values |= {n: angular[n].values for n in ("mode_shared", "mode_catalogue")} | where(given[0])
    return build(EQUATIONS, values, variant=variant, step_s=settings["step_s"])


def arrays(product: xr.Dataset) -> dict[str, np.ndarray]:
    """Variables of a product as bare arrays, by name."""
    return {name: variable.values for name, variable in product.variables.items()}


def where(aligned) -> dict[str, np.ndarray]:
    """Kind, times (s) and latitude (rad) of every manoeuvre.

    Parameters
    ----------
    aligned : arrays of "align", by name
    """
    start, stop = aligned["start"], aligned["stop"]
    position, time = aligned["position_e"], aligned["time_orbit"]
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"], "start": start, "stop": stop, "latitude": latitude}


def samples(smoothed, index):
    """Samples of one manoeuvre, as a slice where they are in one piece; None where there are too few.

    Parameters
    ----------
    smoothed : arrays of "com_offset.attitude", by name
    index : of the manoeuvre
    """
    inside = np.flatnonzero(smoothed["acc_manoeuvre"] == index)
    if inside.size < 200:
        return None
    whole = slice(inside[0], inside[-1] + 1)
    return whole if whole.stop - whole.start == inside.size else inside


def reading(aligned, time) -> tuple[np.ndarray, np.ndarray]:
    """Linear acceleration (n, 3) m s-2 at epochs of the record, and which of them are not usable (n,).

    Parameters
    ----------
    aligned : arrays of "align", by name
    time : (n,) s
    """
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


def _none(driven, modes):
    """Block without epochs, so that an event without manoeuvre has arrays of the right shape."""
    empty = {"epoch": np.zeros(0), "valid": np.zeros(0), "reading": np.zeros((0, 3))}
    return empty | {"still": np.zeros((0, 3, 3)), "turning": np.zeros((1 + driven + modes, 0, 3))}


def _size(block):
    """Number of epochs of a block."""
    return 0 if block is None else block["epoch"].size


def _block(aligned, smoothed, angular, index, settings):
    """Resampled reading, columns and angular accelerations of one manoeuvre; None without samples.

    The columns are linear in the angular acceleration, so that this is resampled, not its nine columns.
    """
    inside = samples(smoothed, index)
    if inside is None:
        return None
    time = smoothed["time_acc"][inside]
    linear, marked = reading(aligned, time)
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
    resampled = np.moveaxis(operator(np.nan_to_num(series)), 1, 0)
    block = {"epoch": operator.time, "valid": operator.valid, "reading": resampled[0]}
    return block | {"still": still, "turning": resampled[1:]}


def _still(time, good, rate, gradient, filtered):
    """Low-pass and resampling, and the columns without angular acceleration."""
    start, stop, *settings = filtered
    operator = operator_for(time, good, max(start, time[0]), min(stop, time[-1]), *settings)
    return operator, operator(columns(time, rate, np.zeros(3), gradient))


def _filter(aligned, smoothed, index, settings):
    """First and last edge, and what the low-pass and resampling between them needs."""
    return *_ends(aligned, smoothed, index), *(settings[name] for name in ("lowpass_hz", "half_width_s", "step_s"))


def _ends(aligned, smoothed, index):
    """First and last edge as the accelerometer sees them."""
    count = int(np.isfinite(aligned["edge_lower"][index]).sum())
    late = np.nan_to_num(smoothed["acc_shift"][index])
    return aligned["edge_upper"][index, 0] + max(late, 0.0), aligned["edge_lower"][index, count - 1] + min(late, 0.0)
