"""Stage drag: non-gravitational acceleration from two sensors, from one as printed, and from one as it should be."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque import laws
from gravcal.calibrations.gradient_torque.gradient import METHODS, cube_side
from gravcal.calibrations.gradient_torque.schemas import DRAG
from gravcal.calibrations.gradient_torque.torque_balance import balance
from gravcal.errors import EstimationError
from gravcal.physics.sensing import offset_tensor

VARIANTS = ("two_sensor", "one_sensor_published", "one_sensor")
SOURCES = ("sensor noise", "attitude and rates", "gravity prior", "places")


def drag(
    modelled: xr.Dataset,
    *,
    variant: str,
    single_sensor: int,
    elongation: float,
    gravity_sigma_scale: float,
    torque_step_s: float,
    torque_noise_order: int,
    control_hz: float,
    control_damping: float,
    satellite: dict,
) -> xr.Dataset:
    """Drag by one of the three methods.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient"
    variant : one of VARIANTS, with ".clean" behind for the readings of a simulation without noise
    single_sensor : 1 or 2
    elongation : 1
    gravity_sigma_scale : 1, times the standard deviations of the field
    torque_step_s : s; torque_noise_order : 1; for the torque balance
    control_hz, control_damping : Hz, 1, law of the attitude control; 0 Hz: not known, no torque balance
    satellite : numbers of the catalogue

    Returns
    -------
    drag : Dataset, "gradient_torque.drag"

    Notes
    -----
    Least squares over time. The drag of an epoch appears in that epoch's reading and, weakly, in the torque balance, so
    the joint solution parts: rates from attitude and angular accelerations (stage gradient), drag from the reading
    with the modelled tensor, centre of pressure from the torque balance. What the last would add to the drag is
    `torque_gain`.
    """
    method = variant.removesuffix(".clean")
    place, reading, count = used(modelled, method, single_sensor)
    tensor = _tensor(modelled, "two_sensor" if method == "two_sensor" else "one_sensor")
    parts = _covariances(modelled, (place, tensor, count, gravity_sigma_scale), satellite)
    if method == "one_sensor_published":
        values = _published(modelled, (place, reading), (single_sensor, elongation, satellite))
        parts = parts[:1] + [0 * part for part in parts[1:]]
    else:
        values = {"drag_b": laws.drag_from_one(reading, tensor, place)}
    held = sum(parts[:3])
    values |= {
        "time": modelled["time"].values,
        "bare_b": -reading,
        "covariance": held,
        "covariance_total": held + parts[3],
        "budget": np.stack([np.sqrt(np.mean(np.diagonal(part, axis1=1, axis2=2), axis=0)) for part in parts]),
    }
    if method == "one_sensor" and control_hz > 0:
        choices = (torque_step_s, torque_noise_order, control_hz, control_damping)
        values |= balance(modelled, values, choices, satellite, place)
    return build(DRAG, values, title=f"Drag, {variant}", sources=", ".join(SOURCES))


def used(modelled, method, single_sensor):
    """Place, reading and number of the sensors that a method uses; two are one in the middle.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient"
    method : one of VARIANTS
    single_sensor : 1 or 2
    """
    linear, places = modelled["linear_b"].values, modelled["sensor_position_b"].values
    if method == "two_sensor":
        if len(places) < 2:
            raise EstimationError("two_sensor: found one sensor in the file, expected two. Use the one-sensor method.")
        return places.mean(axis=0), linear.mean(axis=1), 2
    return places[single_sensor - 1], linear[:, single_sensor - 1], 1


def _tensor(modelled, method):
    """T = M - G with the rates of a method."""
    index = METHODS.index(method)
    rates = (modelled[name].values[index] for name in ("rate_b", "rate_dot_b"))
    return offset_tensor(*rates, modelled["gradient_b"].values)


def _covariances(modelled, use, satellite):
    """Covariance of the drag from each source, (n, 3, 3) each."""
    place, tensor, count, scale = use
    step = float(np.median(np.diff(modelled["time"].values)))
    white = np.diag(np.array(satellite["linear_noise_density"]) ** 2) / (2 * step * count)
    motion = modelled["motion_covariance"].values[METHODS.index("two_sensor" if count == 2 else "one_sensor")]
    variance = scale**2 * modelled["gradient_variance"].values
    gravity = gravity_covariance(variance, modelled["up_b"].values, place)
    sigma = np.array(satellite["sensor_position_sigma"])
    places = np.diag(np.sum(sigma[:count] ** 2, axis=0)) / count**2
    return [np.broadcast_to(white, motion.shape), motion, gravity, tensor @ places @ np.swapaxes(tensor, 1, 2)]


def gravity_covariance(variance, up_b, place):
    """Covariance of dG r for errors of the field that are alike in all directions.

    Parameters
    ----------
    variance : (3,) s-4, of radial-radial, radial-tangential and tangential shear (gravity_field.error_covariance)
    up_b : (n, 3) unit vectors away from the Earth
    place : (3,) m

    Returns
    -------
    covariance : (n, 3, 3) m2 s-4
    """
    rr, rt, tt = variance
    along = (up_b @ place)[:, None, None]
    level = place - (up_b @ place)[:, None] * up_b
    square = np.sum(level**2, axis=1)[:, None, None]
    up_up = up_b[:, :, None] * up_b[:, None, :]
    mixed = up_b[:, :, None] * level[:, None, :]
    radial = (along**2 * rr + square * rt) * up_up
    plane = (along**2 * rt + square * tt) * (np.eye(3) - up_up) + rr / 4 * level[:, :, None] * level[:, None, :]
    return radial + plane + along * (rt - rr / 2) * (mixed + np.swapaxes(mixed, 1, 2))


def _published(modelled, use, choices):
    """The printed algorithm, with the catalogue's centre of pressure."""
    place, reading = use
    single_sensor, elongation, satellite = choices
    if np.any(np.abs(place) < 1e-9):
        raise EstimationError(
            f"one_sensor_published: found sensor_position {place.tolist()} m, expected no zero component: the printed "
            f"H = -I (1/Dx, 1/Dy, 1/Dz) divides by each. Use the one-sensor method."
        )
    test_mass = laws.box_inertia(satellite["test_mass"], cube_side(satellite), elongation)
    h, q_d = laws.printed_vectors(
        satellite["inertia"], test_mass, satellite["mass"], satellite["centre_of_pressure"], place
    )
    return {"drag_b": laws.printed_drag(reading, modelled["angular_b"].values[:, single_sensor - 1], h, q_d)[0]}
