"""Stage gradient: gravity gradient along the orbit in the body frame, and the rates, for both ways of using sensors."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque import attitude, laws, pointing, spline
from gravcal.calibrations.gradient_torque.schemas import GRADIENT
from gravcal.errors import EstimationError
from gravcal.physics import earth, gravity, gravity_field

METHODS = ("one_sensor", "two_sensor")


def field_of(stored: xr.Dataset) -> gravity_field.Field:
    """Gravity field of a product.

    Parameters
    ----------
    stored : Dataset, "gradient_torque.field"
    """
    parts = (stored[name].values for name in ("cosine", "sine", "cosine_sigma", "sine_sigma"))
    return gravity_field.Field(float(stored["gm"]), float(stored["radius"]), *parts, name=stored.attrs.get("field", ""))


def gradient(
    observed: xr.Dataset,
    stored: xr.Dataset,
    *,
    field_degree: int,
    knot_step_s: float,
    gap_limit_s: float,
    single_sensor: int,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Tensor of the gravity gradient in b, rates and their errors.

    Parameters
    ----------
    observed : Dataset, "ingest" of an SGRS file
    stored : Dataset, "gradient_torque.field"
    field_degree : highest degree of the field
    knot_step_s, gap_limit_s : s
    single_sensor : 1 or 2, the one that the one-sensor methods use
    elongation : 1, of the test masses
    satellite : attitude_noise, angular_noise_density, test_mass, test_mass_inertia of the catalogue

    Returns
    -------
    gradient : Dataset, "gradient_torque.gradient"
    """
    _check(observed, single_sensor, gap_limit_s)
    field = gravity_field.truncated(field_of(stored), 0, field_degree)
    time = observed["time"].values
    position, velocity = (bridged(time, observed[name].values, gap_limit_s) for name in ("position", "velocity"))
    gradient_i = _gradient_i(field, time, position)
    frame = attitude.Frame(
        pointing.orbit_frame(position, velocity),
        pointing.orbit_rates(time, position, velocity),
    )
    places = observed["sensor_position"].values
    uses = {"one_sensor": [min(single_sensor, len(places)) - 1], "two_sensor": list(range(len(places)))}
    inertia = laws.box_inertia(satellite["test_mass"], cube_side(satellite), elongation)
    solved = {
        name: _smoothed(observed, frame, gradient_i, used, knot_step_s, (satellite, inertia))
        for name, used in uses.items()
    }
    values = {
        "time": time,
        "linear_b": observed["linear"].values,
        "angular_b": observed["angular"].values,
        "sensor_position_b": places,
        "gradient_variance": gravity_field.error_covariance(field, np.linalg.norm(position, axis=1).mean()),
        "motion_covariance": np.stack(
            [_motion_covariance(solved[name], gradient_i, places[uses[name]].mean(axis=0)) for name in METHODS]
        ),
    }
    values |= _of_motion(solved, gradient_i, position)
    return build(GRADIENT, values, title="Gravity gradient and rates along the orbit", field=field.name)


def _gradient_i(field, time, position):
    """Gravity gradient (n, 3, 3) s-2 in i."""
    R_ei = earth.R_ei(time)
    return gravity.rotate_tensor(np.swapaxes(R_ei, 1, 2), gravity_field.gradient_e(field, np.matvec(R_ei, position)))


def bridged(time: np.ndarray, values: np.ndarray, gap_limit_s: float) -> np.ndarray:
    """Orbit with missing rows filled by a cubic spline.

    Parameters
    ----------
    time : (n,) s; values : (n, 3), m or m s-1, NaN where missing; gap_limit_s : s, longest gap filled
    """
    good = np.isfinite(values).all(axis=1)
    if good.all():
        return values
    known = time[good]
    worst = max(np.diff(known).max(), known[0] - time[0], time[-1] - known[-1]) if known.size > 3 else np.inf
    if worst > gap_limit_s:
        raise EstimationError(
            f"SGRS file: found {worst:.0f} s without position or velocity, expected at most {gap_limit_s:g} s. "
            f"Cut the record there, or raise gap_limit_s.",
            gap=float(worst),
        )
    return CubicSpline(known - time[0], values[good])(time - time[0])


def _of_motion(solved, gradient_i, position):
    """Variables that follow from the smoothed attitudes; the tensor from that of all sensors."""
    best = solved["two_sensor"]
    values = {
        "gradient_b": gravity.rotate_tensor(best.R_bi, gradient_i),
        "up_b": np.matvec(best.R_bi, position / np.linalg.norm(position, axis=1, keepdims=True)),
    }
    for name in ("angle", "angle_dot", "rate_b", "rate_dot_b"):
        values[name] = np.stack([getattr(solved[method], name) for method in METHODS])
    for name in ("chi2", "dof"):
        values[f"attitude_{name}"] = np.stack([getattr(solved[method], name) for method in METHODS])
    return values


def cube_side(satellite: dict) -> float:
    """Side of the cube that has the catalogued mass and inertia, m."""
    return float(np.sqrt(6 * np.trace(np.array(satellite["test_mass_inertia"])) / 3 / satellite["test_mass"]))


def _smoothed(observed, frame, gradient_i, used, knot_step, numbers):
    """Attitude from the star camera and the mean angular acceleration of the sensors used."""
    satellite, inertia = numbers
    time = observed["time"].values
    step = float(np.median(np.diff(time)))
    density = np.array(satellite["angular_noise_density"])
    quaternion = observed["q"].values
    measured = attitude.Measured(
        time,
        np.where(np.linalg.norm(quaternion, axis=1, keepdims=True) > 0.5, quaternion, np.nan),
        observed["angular"].values[:, used].mean(axis=1),
        np.array(satellite["attitude_noise"]),
        np.broadcast_to(density / np.sqrt(2 * step * len(used)), (time.size, 3)),
    )

    def free(R_bi, rate_b):
        return laws.free_mass_angular_acceleration(inertia, gravity.rotate_tensor(R_bi, gradient_i), rate_b)

    return attitude.smooth(measured, frame, knot_step, free)


def _motion_covariance(solved, gradient_i, place):
    """Covariance of T r from the errors of attitude, rate and angular acceleration."""
    gradient_b = gravity.rotate_tensor(solved.R_bi, gradient_i)
    parts = laws.offset_tensor_error(solved.rate_b, gradient_b, place)
    operator = sum(part[:, None] @ by for part, by in zip(parts, solved.operators, strict=True))
    return spline.propagate(operator, solved.table, solved.covariance)


def _check(observed, single_sensor, gap_limit):
    """Enough data, without gaps that part it."""
    time, sensors = observed["time"].values, observed.sizes["sensor"]
    if single_sensor > sensors:
        raise EstimationError(
            f"single_sensor {single_sensor}: found {sensors} sensor, expected that many. Set it to 1."
        )
    if time.size < 60:
        raise EstimationError(f"SGRS file: found {time.size} epochs, expected at least 60. Give a longer record.")
    worst = float(np.diff(time).max())
    if worst > gap_limit:
        raise EstimationError(
            f"SGRS file: found a gap of {worst:.0f} s, expected none above {gap_limit:g} s. "
            f"Cut the record there, or raise gap_limit_s (errors grow in the gap).",
            gap=worst,
        )
