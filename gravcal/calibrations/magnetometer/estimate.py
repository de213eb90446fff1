"""Bias, scale, axes and leak of the torquers of a magnetometer against the reference field, and checks."""

import numpy as np
import xarray as xr

from gravcal.calibrations import checks, named_parameters
from gravcal.calibrations.checks import at_most
from gravcal.calibrations.magnetometer import model
from gravcal.calibrations.magnetometer.model import SCHEMAS
from gravcal.calibrations.schemas import build
from gravcal.effects import effect
from gravcal.estimation import least_squares

#: Groups of parameters: first part of their names and the effect; axes out of square are no effect of the catalogue
#: and as plausible as a wrong mounting.
GROUPS = {
    "bias": "magnetometer.bias",
    "scale": "magnetometer.scale",
    "misalignment": "magnetometer.misalignment",
    "nonorthogonality": "magnetometer.misalignment",
    "leak": "magnetometer.current_leak",
    "external_field": "magnetometer.external_field",
    "delay": "timing.magnetometer_delay",
}
NAMES = {
    "misalignment": ("misalignment_x", "misalignment_y", "misalignment_z"),
    "nonorthogonality": ("nonorthogonality_xy", "nonorthogonality_xz", "nonorthogonality_yz"),
    "external_field": ("external_field",),
    "delay": ("delay",),
}
AXES = ("scale", "misalignment", "nonorthogonality")  # of these groups, which a satellite's own fields do not reach
ITERATIONS = 3  # of the noise by the residual of the solution with it


def estimate(
    aligned: xr.Dataset, *, noise_order: int, field_noise_nt: float, parts: int, determined_ratio: float, held: tuple
) -> xr.Dataset:
    """Parameters of the magnetometer, with errors by the noise that they leave.

    Parameters
    ----------
    aligned : Dataset, "magnetometer.align"
    noise_order : coefficients of the noise model of each axis, fewer in a short record
    field_noise_nt : nT, smallest standard deviation of a record
    parts : of the record that are also solved alone
    determined_ratio : largest sigma of a parameter over the plausible size in the catalogue of effects
    held : groups that are held at nought: the result is then that of an instrument without them

    Notes
    -----
    measured - B = b + (diag(s) + E) B + B x a + L m + h k - delay dB/dt: bias b, scale s, shear E, misalignment a, leak
    L of the dipoles m, uniform external field h along the moment k of the main field.
    """
    field, used = model.field(aligned), [group for group in GROUPS if group not in held]
    names, units, sizes = zip(*(one for group in used for one in _parameters(group)), strict=True)
    blocks = [model.shear(field) if g == "nonorthogonality" else model.columns(field, GROUPS[g]) for g in used]
    size = np.array(sizes)
    design = np.concatenate(blocks, axis=2) * size  # in units of the plausible sizes, so that nothing is small
    step, floor = float(aligned["step"]), 1e-9 * field_noise_nt
    place, both = model.placed(field.time, step), np.concatenate([design, field.difference[..., None]], axis=2)
    noise, order = model.noise(field, step, blocks, 0, floor), 0
    rows = _rows(noise, place, both)
    for _ in range(ITERATIONS):
        rest = field.difference - design @ _solved(rows)
        noise = [model.noise_of(rest[:, a], place, noise_order, floor, size.size // 3) for a in range(3)]
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
    found = named_parameters.estimated(names, units, limit, information, right, starts, size)
    found |= {"noise": (field.difference - fitted).std(axis=0), "noise_order": order, "time": field.time}
    return build(SCHEMAS["estimate"], found | {"residual_b": field.difference, "fitted_b": fitted})


def _parameters(group):
    """Name, unit and plausible size of the parameters of a group."""
    known = effect(GROUPS[group]).parameters
    names = NAMES.get(group, [f"{group}_{one.name}" for one in known])
    return [(name, one.unit, one.prior_sigma) for name, one in zip(names, known, strict=True)]


def _solved(rows):
    """Solution of all axes together, the smallest where it is not unique."""
    information = sum(c.T @ c for c, _ in rows)
    return least_squares.stable_inverse(information) @ sum(c.T @ y for c, y in rows)


def _rows(noise, place, values):
    """Whitened design (n, p) and observations (n,) of each axis, from both (n, 3, p + 1)."""
    rows = [model.whitened(one, place, values[:, axis]) for axis, one in enumerate(noise)]
    return [(one[:, :-1], one[:, -1]) for one in rows]


def check(
    aligned: xr.Dataset,
    found: xr.Dataset,
    *,
    jump_limit_rad: float,
    velocity_limit_m_s: float,
    constant_limit_s: float,
    strength_limit: float,
    direction_limit_rad: float,
    agreement_limit: float,
    plausible_limit: float,
    camera_limit_s: float,
    delay_limit_s: float,
) -> xr.Dataset:
    """Checks of the inputs against each other and of the result.

    Parameters
    ----------
    aligned : Dataset, "magnetometer.align"; found : Dataset, "magnetometer.estimate"
    jump_limit_rad : rad, change of the turn from one attitude to the next
    velocity_limit_m_s : m s-1, mean velocity against change of position
    constant_limit_s : s, longest time over which an axis reads the same
    strength_limit : share by which the strengths of the two fields differ, rms
    direction_limit_rad : rad, angle between them, rms
    agreement_limit : smallest probability of the disagreement of the parts
    plausible_limit : largest error of scale or axes over its plausible size, beyond twice its standard deviation; a
        star camera late by minutes reads as a magnetometer that is turned by tenths of a radian
    camera_limit_s, delay_limit_s : s, attitudes late against the orbit, readings against both
    """
    field = model.field(aligned)
    strength = [np.linalg.norm(one, axis=1) for one in (field.measured_b, field.model_b)]
    across = np.linalg.norm(np.cross(field.measured_b, field.model_b), axis=1)
    angle = np.arctan2(across, np.sum(field.measured_b * field.model_b, axis=1))
    apart, turned = (float(np.sqrt(np.mean(one**2))) for one in (strength[0] / strength[1] - 1, angle))
    velocity, constant = float(aligned["velocity_error"]), checks.longest_constant(field.time, field.measured_b)
    made = [
        at_most("jump of the attitude", float(aligned["attitude_jump"]), jump_limit_rad, "rad"),
        at_most("velocity against change of position", velocity, velocity_limit_m_s, "m s-1"),
        at_most("longest time of a constant reading", constant, constant_limit_s, "s"),
        at_most("strength of the field against the reference", apart, strength_limit, "1"),
        at_most("direction of the field against the reference", turned, direction_limit_rad, "rad"),
    ]
    size = {name: one for group in AXES for name, _, one in _parameters(group)}
    known = found[["value", "sigma"]].sel(parameter=[name for name in found["parameter"].values if name in size])
    beyond = np.abs(known["value"].values) - 2 * known["sigma"].values
    ratio = beyond / [size[name] for name in known["parameter"].values]
    largest = np.max(ratio, where=np.isfinite(ratio), initial=0.0)
    delay = dict(zip(map(str, found["parameter"].values), found["value"].values, strict=True)).get("delay", 0.0)
    apart_s = model.late(aligned, camera_limit_s, delay_limit_s).get("timing.magnetometer_delay", (0.0,))[0]
    lag = max(abs(float(np.nan_to_num(delay))), abs(apart_s))
    made.append(at_most("tags of the attitude", abs(float(aligned["camera_late"])), camera_limit_s, "s"))
    made.append(at_most("tags of the magnetometer", lag, delay_limit_s, "s"))
    made.append(at_most("scale or axes over their plausible size", largest, plausible_limit, "1"))
    return checks.product([*made, *named_parameters.checks(found, agreement_limit)])
