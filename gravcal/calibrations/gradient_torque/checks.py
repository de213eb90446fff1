"""What readings, attitude and orbit of a day must satisfy against each other, and what the drag must."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations import checks
from gravcal.calibrations.checks import Check, at_least, at_most
from gravcal.calibrations.gradient_torque.pointing import orbit_frame
from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS
from gravcal.physics.sensing import offset_tensor

SEEN = 5.0  # standard deviations of a reading that the change of a difference must have; places are not known better
TOLD = 20.0  # inverse of the error of a factor that is looked at


def inputs(modelled: xr.Dataset, observed: xr.Dataset, *, satellite: Mapping, **limits: float) -> xr.Dataset:
    """Checks of one day of readings.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient"
    observed : Dataset, "ingest" of the same file
    satellite : orbit_height, sensor_position, linear_noise_density, angular_noise_density of the catalogue
    limits : settings of the stage "checks"

    Returns
    -------
    checked : Dataset, schema `checks.CHECKS`
    """
    time, seen = observed["time"].values, np.isfinite(observed["q"].values).all(axis=1)
    position, velocity, quaternion = (observed[name].values for name in ("position", "velocity", "q"))
    norm = np.linalg.norm(quaternion[seen], axis=1)
    flat = [observed[name].values.reshape(time.size, -1) for name in ("linear", "angular", "position", "velocity")]
    constant = [checks.longest_constant(time, one) for one in flat]
    constant.append(checks.longest_constant(time[seen], quaternion[seen]))
    height = np.nanmax(np.abs(np.linalg.norm(position, axis=1) - EARTH_RADIUS - satellite["orbit_height"]))
    moved, pointed = checks.velocity_error(time, position, velocity), _pointing(position, velocity, quaternion)
    jump = checks.attitude_jump(time[seen], quaternion[seen])
    found = [
        at_most("constant readings", max(constant), limits["constant_limit_s"], "s"),
        at_most("quaternion norm", np.abs(norm - 1).max(initial=0.0), limits["norm_limit"], "1"),
        at_most("attitude jump", jump, limits["jump_limit_rad"], "rad"),
        at_most("orbit velocity against position", moved, limits["velocity_limit_m_s"], "m s-1"),
        at_most("orbit height against the catalogue", height, limits["height_limit_m"], "m"),
        at_most("attitude against orbit", pointed, limits["pointing_limit_rad"], "rad"),
    ]
    places = modelled["sensor_position_b"].values
    moved = np.abs(places - np.array(satellite["sensor_position"])[: len(places)]).max()
    found.append(at_most("places of the sensors against the catalogue", moved, limits["place_limit_m"], "m"))
    found += _angular(modelled, satellite, limits)
    return checks.product(found + (_linear(modelled, satellite, limits) if modelled.sizes["sensor"] == 2 else []))


def _pointing(position, velocity, quaternion):
    """Largest angle from the orbit frame (rad)."""
    known = (np.linalg.norm(np.cross(position, velocity), axis=1) > 0) & (np.linalg.norm(quaternion, axis=1) > 0.5)
    if not known.any():
        return np.nan
    R_bi = frames.R_bi_from_quaternion(quaternion[known])
    cosine = np.einsum("nij,nij->n", R_bi, orbit_frame(position[known], velocity[known])) / 2 - 0.5
    return np.arccos(np.clip(cosine, -1, 1)).max()


def _angular(modelled, satellite, limits):
    """Angular readings of every sensor against the motion; the star camera tells its slow part."""
    motion, angular = -modelled["rate_dot_b"].values[1], modelled["angular_b"].values
    sigma = np.array(satellite["angular_noise_density"]) / np.sqrt(2 * _step(modelled))
    told = motion.std(axis=0) * np.sqrt(len(motion)) > TOLD * sigma
    off = [_off(motion, angular[:, k])[told].max() for k in range(angular.shape[1])] if told.any() else []
    return [at_most("angular readings over motion, from one", max(off), limits["share_limit"], "1")] if off else []


def _linear(modelled, satellite, limits):
    """Linear readings of two sensors apart, and the change of that against gradient and motion."""
    linear, place = modelled["linear_b"].values, modelled["sensor_position_b"].values
    rates = (modelled[name].values[1] for name in ("rate_b", "rate_dot_b"))
    model = -offset_tensor(*rates, modelled["gradient_b"].values) @ (place[0] - place[1])
    apart = linear[:, 0] - linear[:, 1]
    left = np.sqrt(np.nanmean((apart - model) ** 2, axis=0)).max()
    sigma = np.array(satellite["linear_noise_density"]) / np.sqrt(_step(modelled))
    found = [at_most("linear readings apart, not modelled", left, limits["apart_limit_m_s2"], "m s-2")]
    told = model.std(axis=0) > SEEN * sigma
    if told.any():
        off = _off(model, apart)[told].max()
        found.append(at_most("linear readings apart over model, from one", off, limits["share_limit"], "1"))
    return found


def _step(modelled):
    """Seconds from one epoch to the next."""
    return float(np.median(np.diff(modelled["time"].values)))


def _off(model, reading):
    """How far from one the factor between the changes of model and reading is, each axis (3,)."""
    good = np.isfinite(reading).all(axis=1)
    model, reading = (one[good] - one[good].mean(axis=0) for one in (model, reading))
    return np.abs(np.sum(model * reading, axis=0) / np.maximum(np.sum(model**2, axis=0), 1e-300) - 1)


def result(modelled: xr.Dataset, drags: Mapping[str, xr.Dataset], limits: Mapping[str, float]) -> list[Check]:
    """Checks of the drag: fit of the attitude, methods against each other, plausible size and direction.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient"
    drags : {method: Dataset, "gradient_torque.drag"}
    limits : all settings
    """
    one = drags["one_sensor"]
    drag = one["drag_b"].values
    drag = drag[np.isfinite(drag).all(axis=1)]
    size, mean = np.sqrt(np.mean(np.sum(drag**2, axis=1))), drag.mean(axis=0)
    ratio = (modelled["attitude_chi2"] / modelled["attitude_dof"]).values.max()
    found = [
        at_most("chi2 per degree of freedom, attitude", ratio, limits["fit_limit"], "1"),
        at_most("drag", size, limits["drag_limit_m_s2"], "m s-2"),
        at_least("drag, least axis", np.sqrt(np.mean(drag**2, axis=0)).min(), limits["drag_least_m_s2"], "m s-2"),
        at_least("mean drag against the flight, share", -mean[0] / np.linalg.norm(mean), limits["against_flight"], "1"),
    ]
    if "two_sensor" in drags:
        away = one["drag_b"].values - drags["two_sensor"]["drag_b"].values
        total = np.diagonal(one["covariance_total"].values, axis1=1, axis2=2)
        value = np.sqrt(np.nanmean(away**2, axis=0) / total.mean(axis=0)).max()
        found.append(at_most("one sensor against two", value, limits["agreement_limit"], "sigma"))
    return found
