"""Checks of readings, attitude and orbit of a day against each other, and of the drag."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations import checks
from gravcal.calibrations.checks import Check, at_least, at_most
from gravcal.calibrations.gradient_torque.attitude import orbit_frame
from gravcal.physics import frames
from gravcal.physics.constants import EARTH_RADIUS
from gravcal.physics.sensing import offset_tensor

DIFFERENCE = 5.0  # standard deviations of a reading by which a difference must change; places are not known better
DETERMINED = 20.0  # inverse of the error of a factor that is tested


def inputs(modelled: xr.Dataset, observed: xr.Dataset, *, satellite: Mapping, **limits: float) -> xr.Dataset:
    """Checks of one day of readings, from "gradient_torque.gradient" and the file itself."""
    time, step = observed["time"].values, float(np.median(np.diff(modelled["time"].values)))
    position, velocity, quaternion = (observed[name].values for name in ("position", "velocity", "q"))
    usable = np.isfinite(quaternion).all(axis=1)
    norm = np.linalg.norm(quaternion[usable], axis=1)
    series = [observed[name].values.reshape(time.size, -1) for name in ("linear", "angular", "position", "velocity")]
    constant = [checks.longest_constant(time, one) for one in series]
    constant.append(checks.longest_constant(time[usable], quaternion[usable]))
    height = np.nanmax(np.abs(np.linalg.norm(position, axis=1) - EARTH_RADIUS - satellite["orbit_height"]))
    velocity_error = checks.velocity_error(time, position, velocity)
    jump = checks.attitude_jump(time[usable], quaternion[usable])
    places = modelled["sensor_position_b"].values
    displaced = np.abs(places - np.array(satellite["sensor_position"])[: len(places)]).max()
    pointing = _pointing(position, velocity, quaternion)
    tests = [
        at_most("constant readings", max(constant), limits["constant_limit_s"], "s"),
        at_most("quaternion norm", np.abs(norm - 1).max(initial=0.0), limits["norm_limit"], "1"),
        at_most("attitude jump", jump, limits["jump_limit_rad"], "rad"),
        at_most("orbit velocity against position", velocity_error, limits["velocity_limit_m_s"], "m s-1"),
        at_most("orbit height against the catalogue", height, limits["height_limit_m"], "m"),
        at_most("attitude against orbit", pointing, limits["pointing_limit_rad"], "rad"),
        at_most("places of the sensors against the catalogue", displaced, limits["place_limit_m"], "m"),
    ]
    rate_b, rate_dot_b = (modelled[name].values[1] for name in ("rate_b", "rate_dot_b"))
    angular, sigma = modelled["angular_b"].values, np.array(satellite["angular_noise_density"]) / np.sqrt(2 * step)
    determined = rate_dot_b.std(axis=0) * np.sqrt(len(rate_dot_b)) > DETERMINED * sigma
    if determined.any():  # by the star camera, which shows the slow part
        factor = max(_from_one(-rate_dot_b, angular[:, k])[determined].max() for k in range(angular.shape[1]))
        tests.append(at_most("angular readings over motion, from one", factor, limits["share_limit"], "1"))
    if modelled.sizes["sensor"] == 2:
        linear = modelled["linear_b"].values
        model = -offset_tensor(rate_b, rate_dot_b, modelled["gradient_b"].values) @ (places[0] - places[1])
        difference, sigma = linear[:, 0] - linear[:, 1], np.array(satellite["linear_noise_density"]) / np.sqrt(step)
        residual = difference - model
        rms, jump = np.sqrt(np.nanmean(residual**2, axis=0)).max(), np.nanmax(np.abs(np.diff(residual, axis=0)))
        tests.append(at_most("linear readings apart, not modelled", rms, limits["apart_limit_m_s2"], "m s-2"))
        tests.append(at_most("jump of linear readings apart", jump, limits["apart_jump_limit_m_s2"], "m s-2"))
        determined = model.std(axis=0) > DIFFERENCE * sigma
        if determined.any():
            factor = _from_one(model, difference)[determined].max()
            tests.append(at_most("linear readings apart over model, from one", factor, limits["share_limit"], "1"))
    return checks.product(tests)


def _pointing(position, velocity, quaternion):
    """Largest angle rad of attitudes (n, 4) from the orbit frame of positions m and velocities m s-1 (n, 3)."""
    norm = np.linalg.norm(quaternion, axis=1)
    known = (np.linalg.norm(np.cross(position, velocity), axis=1) > 0) & (norm > 0.5)
    if not known.any():
        return np.nan
    R_bi = frames.R_bi_from_quaternion(quaternion[known] / norm[known, None])
    cosine = np.einsum("nij,nij->n", R_bi, orbit_frame(position[known], velocity[known])) / 2 - 0.5
    return np.arccos(np.clip(cosine, -1, 1)).max()


def _from_one(model, reading):
    """Departure from one, (3,), of the factor that takes changes of a model (n, 3) to those of readings (n, 3)."""
    good = np.isfinite(reading).all(axis=1)
    model, reading = (one[good] - one[good].mean(axis=0) for one in (model, reading))
    return np.abs(np.sum(model * reading, axis=0) / np.maximum(np.sum(model**2, axis=0), 1e-300) - 1)


def result(modelled: xr.Dataset, drags: Mapping[str, xr.Dataset], limits: Mapping[str, float]) -> list[Check]:
    """Checks of the drag, {method: Dataset}: attitude fit, methods against each other, plausible size and direction."""
    one_sensor = drags["one_sensor"]
    drag = one_sensor["drag_b"].values
    drag = drag[np.isfinite(drag).all(axis=1)]
    rms, mean = np.sqrt(np.mean(np.sum(drag**2, axis=1))), drag.mean(axis=0)
    ratio = (modelled["attitude_chi2"] / modelled["attitude_dof"]).values.max()
    least = np.sqrt(np.mean(drag**2, axis=0)).min()
    tests = [
        at_most("chi2 per degree of freedom, attitude", ratio, limits["fit_limit"], "1"),
        at_most("drag", rms, limits["drag_limit_m_s2"], "m s-2"),
        at_least("drag, least axis", least, limits["drag_least_m_s2"], "m s-2"),
        at_least("mean drag against the flight, share", -mean[0] / np.linalg.norm(mean), limits["against_flight"], "1"),
    ]
    if "two_sensor" in drags:
        difference = one_sensor["drag_b"].values - drags["two_sensor"]["drag_b"].values
        total = np.diagonal(one_sensor["covariance_total"].values, axis1=1, axis2=2)
        sigmas = np.sqrt(np.nanmean(difference**2, axis=0) / total.mean(axis=0)).max()
        tests.append(at_most("one sensor against two", sigmas, limits["agreement_limit"], "sigma"))
    return tests
