"""The four angular accelerations and what is uncertain in each."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.schemas import ANGULAR
from gravcal.effects import effect

#: Prior of the angular accelerometer's scale (3,).
PRIOR = np.array([one.prior_sigma for one in effect("accelerometer.angular_scale").parameters])
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
        return measured, _axis_modes(measured, PRIOR), 3, 3
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
