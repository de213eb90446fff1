"""Bias, scale, axes and leak of the torquers of a magnetometer against the reference field, and checks."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations import checks, named_parameters
from gravcal.calibrations.align import BRIDGED_S, QUATERNION, STATE, between, usable
from gravcal.calibrations.checks import at_most
from gravcal.calibrations.magnetometer import model
from gravcal.calibrations.magnetometer.model import SCHEMAS
from gravcal.calibrations.schemas import build
from gravcal.effects import effect
from gravcal.errors import refuse
from gravcal.estimation import estimate as estimating
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel
from gravcal.physics import earth, frames, magnetic

#: Groups of parameters: first part of their names and the effect; axes i and j stand at 90 deg - 2 e_ij.
GROUPS = {
    "bias": "magnetometer.bias",
    "scale": "magnetometer.scale",
    "misalignment": "magnetometer.misalignment",
    "nonorthogonality": "magnetometer.nonorthogonality",
    "leak": "magnetometer.current_leak",
    "external_field": "magnetometer.external_field",
    "delay": "timing.magnetometer_delay",
}
NAMES = {
    "misalignment": ("misalignment_x", "misalignment_y", "misalignment_z"),
    "external_field": ("external_field",),
    "delay": ("delay",),
}
AXES = ("scale", "misalignment", "nonorthogonality")  # of these groups, which a satellite's own fields do not reach
#: Of others' records: longest time between two, in which the field bends by less than 0.04 nT, and farthest place
#: from the orbit: a second is 7.6 km, GPS time taken for UTC 137 km.
GAP_S, PLACE_M = 2.5, 10e3
ITERATIONS = 3  # of the noise by the residual of the solution with it


def estimated(held: Sequence[str]) -> list[str]:
    """Slugs of the effects that `estimate` fits, without the groups in `held`; a turned camera is a misalignment."""
    slugs = [slug for group, slug in GROUPS.items() if group not in held]
    return slugs + ["attitude.star_camera_misalignment"] * ("misalignment" not in held)


def estimate(
    aligned: xr.Dataset, *, noise_order: int, field_noise_nt: float, parts: int, determined_ratio: float, held: tuple
) -> xr.Dataset:
    """Product "magnetometer.estimate": parameters fitted to "magnetometer.align", with errors by the residual noise.

    Settings are those of the stage; groups of parameters in `held` are left out, as zero.

    Notes
    -----
    measured - B = b + (diag(s) + E) B + B x a + L m + h k - delay dB/dt: bias b, scale s, shear E, misalignment a, leak
    L of the dipoles m, uniform external field h along the moment k of the main field.
    """
    field, used = model.field(aligned), [group for group in GROUPS if group not in held]
    names, units, sizes = zip(*(one for group in used for one in _parameters(group)), strict=True)
    blocks = [model.columns(field, GROUPS[group]) for group in used]
    size = np.array(sizes)
    design = np.concatenate(blocks, axis=2) * size  # in units of the plausible sizes, so that nothing is small
    step, floor = float(aligned["step"]), 1e-9 * field_noise_nt
    place, both = model.placed(field.time, step), np.concatenate([design, field.difference[..., None]], axis=2)
    noise, order = model.noise(field, step, blocks, 0, floor), 0
    rows = _rows(noise, place, both)
    for _ in range(ITERATIONS):
        residual = field.difference - design @ _solved(rows)
        noise = [model.noise_of(residual[:, a], place, noise_order, floor, size.size // 3) for a in range(3)]
        order = noise[0].reflection.size
        if not order:
            break
        rows = _rows(noise, place, both)
    fitted = design @ _solved(rows)
    group = np.arange(field.time.size) * parts // field.time.size
    groups = [group == number for number in range(parts)]
    information = np.stack([sum(c[g].T @ c[g] for c, _ in rows) for g in groups])
    right = np.stack([sum(c[g].T @ y[g] for c, y in rows) for g in groups])
    limit, starts = np.full(size.size, determined_ratio), [field.time[g][0] for g in groups]
    solution = named_parameters.estimated(names, units, limit, information, right, starts, size)
    solution |= {"noise": (field.difference - fitted).std(axis=0), "noise_order": order, "time": field.time}
    return build(SCHEMAS["estimate"], solution | {"residual_b": field.difference, "fitted_b": fitted})


def of_fields(
    measured_b: np.ndarray,
    model_b: np.ndarray,
    time: np.ndarray,
    noise: Sequence[NoiseModel],
    dipole_b: np.ndarray | None = None,
) -> estimating.Estimate:
    """Bias, scale, axes and leak of the torquers of a magnetometer against a reference field.

    Parameters
    ----------
    measured_b, model_b : (n, 3) T, reading and reference field in the body, NaN where missing
    time : (n,) s, evenly spaced
    noise : three NoiseModel of the readings, T
    dipole_b : (n, 3) A m2, of the torquers; None for none

    Returns
    -------
    estimate : Estimate of bias T, scale 1, turn rad, non-orthogonality rad and leak T A-1 m-2, each named

    Notes
    -----
    measured - B = b + (diag(s) + E) B + B x a + L m, with the terms of the product `estimate`.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import magnetometer
    >>> from gravcal.estimation.noise import fit_noise
    >>> rng, time = np.random.default_rng(3), np.arange(900.0)
    >>> noise = [fit_noise([1e-9 * rng.standard_normal(3000)], 1, 1.0) for _ in range(3)]
    >>> model = 3e-5 * np.stack([np.cos(time / 100), np.sin(time / 170), np.cos(time / 250)], axis=1)
    >>> measured = 1.001 * model + [1e-7, 0, -2e-7] + 1e-9 * rng.standard_normal(model.shape)
    >>> found = magnetometer.estimate(measured, model, time, noise)
    >>> bool(np.all(np.abs(found.value[:4] - [1e-7, 0, -2e-7, 1e-3]) < 4 * found.sigma[:4]))
    True
    """
    still = np.zeros_like(model_b)
    field = model.Field(time, measured_b, model_b, still, still if dipole_b is None else dipole_b, still, still[:, 0])
    groups = [*GROUPS][: 4 + (dipole_b is not None)]
    names, units, _ = zip(*(one for group in groups for one in _parameters(group)), strict=True)
    design = np.concatenate([model.columns(field, GROUPS[group]) for group in groups], axis=2)
    return estimating.estimate(field.difference, design, noise, np.zeros((time.size, 0)), names, ",".join(units))


def _parameters(group):
    """Name, unit and plausible size of each parameter of a group."""
    known = effect(GROUPS[group]).parameters
    names = NAMES.get(group, [f"{group}_{one.name}" for one in known])
    return [(name, one.unit, one.prior_sigma) for name, one in zip(names, known, strict=True)]


def _solved(rows):
    """Least-squares solution (p,) of the rows of all axes together, the shortest where it is not unique."""
    return least_squares.stable_inverse(sum(c.T @ c for c, _ in rows)) @ sum(c.T @ y for c, y in rows)


def _rows(noise, place, values):
    """Whitened design (n, p) and observations (n,) of each axis, from values (n, 3, p + 1) that hold both."""
    rows = [model.whitened(one, place, values[:, axis]) for axis, one in enumerate(noise)]
    return [(one[:, :-1], one[:, -1]) for one in rows]


def check(aligned: xr.Dataset, solution: xr.Dataset, **limits: float) -> xr.Dataset:
    """Checks of the inputs and of the result, "magnetometer.align" and "magnetometer.estimate".

    A star camera late by minutes reads as a magnetometer that is turned by tenths of a radian, which is why scale and
    axes are held against their plausible size, beyond twice their standard deviation.
    """
    field = model.field(aligned)
    strength = [np.linalg.norm(one, axis=1) for one in (field.measured_b, field.model_b)]
    across = np.linalg.norm(np.cross(field.measured_b, field.model_b), axis=1)
    angle = np.arctan2(across, np.sum(field.measured_b * field.model_b, axis=1))
    off_strength, off_angle = (float(np.sqrt(np.mean(one**2))) for one in (strength[0] / strength[1] - 1, angle))
    constant, error = checks.longest_constant(field.time, field.measured_b), aligned["velocity_error"]
    rows = [
        at_most("jump of the attitude", aligned["attitude_jump"], limits["jump_limit_rad"], "rad"),
        at_most("velocity against change of position", error, limits["velocity_limit_m_s"], "m s-1"),
        at_most("longest time of a constant reading", constant, limits["constant_limit_s"], "s"),
        at_most("strength of the field against the reference", off_strength, limits["strength_limit"], "1"),
        at_most("direction of the field against the reference", off_angle, limits["direction_limit_rad"], "rad"),
    ]
    size = {name: one for group in AXES for name, _, one in _parameters(group)}
    known = solution[["value", "sigma"]].sel(parameter=[name for name in solution["parameter"].values if name in size])
    beyond = np.abs(known["value"].values) - 2 * known["sigma"].values
    ratio = beyond / [size[name] for name in known["parameter"].values]
    largest = np.max(ratio, where=np.isfinite(ratio), initial=0.0)
    values = dict(zip(map(str, solution["parameter"].values), solution["value"].values, strict=True))
    delays = model.late(aligned, limits["camera_limit_s"], limits["delay_limit_s"])
    lag = float(np.fmax(abs(values.get("delay", np.nan)), abs(delays.get("timing.magnetometer_delay", (np.nan,))[0])))
    rows.append(at_most("tags of the attitude", abs(aligned["camera_late"]), limits["camera_limit_s"], "s"))
    rows += [at_most("tags of the magnetometer", lag, limits["delay_limit_s"], "s")] if np.isfinite(lag) else []
    rows.append(at_most("scale or axes over their plausible size", largest, limits["plausible_limit"], "1"))
    return checks.product([*rows, *named_parameters.checks(solution, limits["agreement_limit"])])


def compare(
    aligned: xr.Dataset, solution: xr.Dataset, camera: xr.Dataset, orbit: xr.Dataset, theirs: xr.Dataset, **settings
) -> xr.Dataset:
    """Product "magnetometer.beside": another calibrated field less ours, and parameters with it as the reference.

    Products are "magnetometer.align" and "magnetometer.estimate", "ingest" of SCA1B and GNV1B, "magnetometer.theirs";
    settings those of `estimate`.

    Notes
    -----
    Ours is the reading less what the instrument adds, with the uniform external field left in. Theirs is turned from
    north, east and centre into the body by our orbit and attitude; less the reference field there, it is interpolated.
    """
    sca_time, quaternion = usable(camera, QUATERNION)
    orbit_time, state = usable(orbit, STATE)
    time, field = theirs["time"].values, model.field(aligned)
    inside = between(time, sca_time, BRIDGED_S) & between(time, orbit_time, BRIDGED_S)
    time, position_e, field_n = time[inside], *(theirs[n].values[inside] for n in ("position_e", "field_n"))
    matched = between(field.time, time, GAP_S)
    if matched.sum() < model.LEAST:
        expected = f"at least {model.LEAST} records of the same minutes"
        refuse("calibrated field of others", f"{matched.sum()}", expected, "Give the file of the day.")
    position_i, _ = earth.state_to_inertial(orbit_time, state[:, :3], state[:, 3:])
    R_ei = earth.R_ei(time)
    ours_e = np.matvec(R_ei, CubicSpline(orbit_time, position_i)(time))
    distance = float(np.median(np.linalg.norm(position_e - ours_e, axis=1)))
    if distance > PLACE_M:
        remedy = "Their tags are of another time scale, or the file is of another satellite: it is not compared."
        refuse("calibrated field of others", f"places {distance / 1e3:.0f} km from the orbit", "the same orbit", remedy)
    field_e = np.matvec(earth.R_en_from_position(ours_e, geocentric_down=True), field_n)
    quaternion = frames.continuous(quaternion)
    R_bi = frames.R_bi_from_quaternion(frames.interpolate(sca_time, quaternion, time))
    theirs_b = np.matvec(R_bi, np.matvec(np.swapaxes(R_ei, 1, 2), field_e))
    reference = magnetic.body_field(orbit_time, state[:, :3], sca_time, quaternion, settings.pop("igrf_generation"))
    anomaly_b = theirs_b - reference(time)[0]
    anomaly_b = np.stack([np.interp(field.time, time, one) for one in anomaly_b.T], axis=1)[matched]
    known = dict(zip(solution["parameter"].values.tolist(), np.nan_to_num(solution["value"].values), strict=True))
    external_b = known.get("external_field", 0.0) * field.axis_b
    ours = (solution["residual_b"].values - solution["fitted_b"].values + external_b)[matched]
    by_theirs = aligned.isel(time=np.flatnonzero(matched))
    by_theirs = by_theirs.assign(model_b=by_theirs["model_b"] + anomaly_b)
    held = tuple({*settings.pop("held"), "external_field"})  # theirs holds it
    implied = estimate(by_theirs, held=held, **settings)
    our = solution[["value", "sigma"]].sel(parameter=implied["parameter"].values.tolist())
    values = {name: implied[name].values for name in ("parameter", "unit", "value", "sigma")}
    values |= {"own_value": our["value"].values, "own_sigma": our["sigma"].values}
    values |= {"time": field.time[matched], "difference_b": anomaly_b - ours, "theirs_b": anomaly_b, "apart": distance}
    values["flagged"] = theirs["flagged"].values
    return build(SCHEMAS["beside"], values)
