"""Stages drag and combine: drag from two sensors, from one as printed and as corrected; identifiability."""

import numpy as np
import xarray as xr

from gravcal.calibrations.gradient_torque import model
from gravcal.calibrations.gradient_torque.model import METHODS, SCHEMAS, amplitude_spectrum
from gravcal.calibrations.schemas import build, replaced, widened
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import least_squares, noise
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.frames import cross_matrix
from gravcal.physics.sensing import offset_tensor

SOURCES = ("sensor noise", "attitude and rates", "gravity prior", "places")
SAMPLES, LEAST_KNOTS, MOST_KNOTS = 30, 5, 24  # means for each knot of the torque spectrum; least, most knots
NODES, ORDER, DRAWS = 512, 30, 24  # frequencies of a density, order of its autoregressive model; densities drawn


def drag(
    modelled: xr.Dataset,
    *,
    variant: str,
    single_sensor: int,
    elongation: float,
    gravity_sigma_scale: float,
    torque_step_s: float,
    control_hz: float,
    control_damping: float,
    satellite: dict,
) -> xr.Dataset:
    """Product "gradient_torque.drag" of a method, with ".clean" behind for noise-free simulated readings.

    Methods: "two_sensor", "one_sensor", "one_sensor_published". The law of the attitude control is control_hz (0: not
    known, no torque balance) and control_damping.

    Notes
    -----
    Least squares over time. The drag of an epoch appears in that epoch's reading and, weakly, in the torque balance, so
    the joint solution parts: rates from attitude and angular accelerations (stage gradient), drag from the reading
    with the modelled tensor, centre of pressure from the torque balance. What the last would add to the drag is
    `torque_gain`.
    """
    method = variant.removesuffix(".clean")
    sensors = [0, 1] if method == "two_sensor" else [single_sensor - 1]
    if modelled.sizes["sensor"] < len(sensors):
        refuse("two_sensor", "one sensor in the file", "two", "Use the one-sensor method.", EstimationError)
    motion = METHODS.index("two_sensor" if method == "two_sensor" else "one_sensor")
    linear, places = modelled["linear_b"].values[:, sensors], modelled["sensor_position_b"].values[sensors]
    place, reading = places.mean(axis=0), linear.mean(axis=1)
    turning = *(modelled[name].values[motion] for name in ("rate_b", "rate_dot_b")), modelled["gradient_b"].values
    tensor = offset_tensor(*turning)
    step = float(np.median(np.diff(modelled["time"].values)))
    white = np.diag(np.array(satellite["linear_noise_density"]) ** 2) / (2 * step * len(sensors))
    by_motion = modelled["motion_covariance"].values[motion]
    variance = gravity_sigma_scale**2 * modelled["gradient_variance"].values
    by_gravity = gravity_covariance(variance, modelled["up_b"].values, place)
    by_place = np.diag(np.sum(np.array(satellite["sensor_position_sigma"])[sensors] ** 2, axis=0))
    by_place = tensor @ (by_place / len(sensors) ** 2) @ np.swapaxes(tensor, 1, 2)
    parts = [np.broadcast_to(white, by_motion.shape), by_motion, by_gravity, by_place]
    if method == "one_sensor_published":
        parts = parts[:1] + [0 * part for part in parts[1:]]
        if np.any(np.abs(place) < 1e-9):
            expected = "no zero component: the printed H = -I (1/Dx, 1/Dy, 1/Dz) divides by each"
            position, remedy = f"sensor_position {place.tolist()} m", "Use the one-sensor method."
            refuse("one_sensor_published", position, expected, remedy, EstimationError)
        body = satellite["inertia"], model.box_inertia(satellite, elongation), satellite["mass"]
        vectors = model.printed_vectors(*body, satellite["centre_of_pressure"], place)
        drag_b = model.printed_drag(reading, modelled["angular_b"].values[:, single_sensor - 1], *vectors)[0]
    else:
        drag_b = model.drag(linear, *turning, places)
    held = sum(parts[:3])
    values = {
        "time": modelled["time"].values,
        "drag_b": drag_b,
        "bare_b": -reading,
        "covariance": held,
        "covariance_total": held + parts[3],
        "budget": np.stack([np.sqrt(np.mean(np.diagonal(part, axis1=1, axis2=2), axis=0)) for part in parts]),
    }
    if method == "one_sensor" and control_hz > 0:
        inertia, kept = np.array(satellite["inertia"]), model.box_inertia(satellite, elongation)
        held_back = np.nan_to_num(unsmoothed(modelled, method, sensors, kept))
        torque = uncontrolled_torque(modelled, method, inertia, control_hz, control_damping)
        series = torque + np.matvec(inertia, held_back), drag_b - np.cross(held_back, place)
        options = {"width": max(1, round(torque_step_s / step)), "step": torque_step_s}
        value, covariance, rest = balance(*series, place, satellite, **options)
        rows = cross_matrix(value * satellite["mass"]) / np.maximum(rest, 1e-30)[:, None]
        gain = np.linalg.eigvals(held[len(held) // 2] @ rows.T @ rows).real.max()  # with the rest as white noise
        values |= {"pressure": value, "pressure_covariance": covariance, "torque_residual": rest, "torque_gain": gain}
        values["pressure_prior_sigma"] = np.array(satellite["centre_of_pressure_sigma"])
    return build(SCHEMAS["drag"], values, title=f"Drag, {variant}", sources=", ".join(SOURCES))


def gravity_covariance(variance: np.ndarray, up_b: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Covariance (n, 3, 3) m2 s-4 of dG r, r `place` (3,) m, for isotropic errors dG of the gravity gradient.

    Variances (3,) s-4 are those of `gravity.error_covariance`, up_b (n, 3) unit vectors away from the Earth.
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


def uncontrolled_torque(
    modelled: xr.Dataset, method: str, inertia: np.ndarray, control_hz: float, damping: float
) -> np.ndarray:
    """Torque (n, 3) N m of the motion by one of METHODS less gravity gradient, control and modelled torque.

    I_B w' + w x I_B w - vex(I_B G - G I_B) = x_cp x m a_drag + control + rest; S-GRS paper, eq. 12 with the bracket
    where it belongs (erratum S-4). Control is -I_B (W^2 angle + 2 D W angle'): angles are fed back, so gains fitted to
    them would be biased by the rest, which the angles follow.
    """
    W, use = 2 * np.pi * control_hz, METHODS.index(method)
    angle, angle_dot, w, wd = (modelled[name].values[use] for name in ("angle", "angle_dot", "rate_b", "rate_dot_b"))
    fed_back = np.matvec(inertia, W**2 * angle + 2 * damping * W * angle_dot)
    gradient = gravity_gradient_torque(inertia, modelled["gradient_b"].values)
    modelled_torque = gradient + (modelled["torque"].values if "torque" in modelled else 0.0)
    return np.matvec(inertia, wd) + np.cross(w, np.matvec(inertia, w)) - modelled_torque + fed_back


def unsmoothed(modelled: xr.Dataset, method: str, sensors: slice | list, test_mass_inertia: np.ndarray) -> np.ndarray:
    """Angular acceleration (n, 3) rad s-2 as read less the smoothed one, without which torques come out too small.

    A reading is free mass minus body, here the mean of some sensors, from 0; method as of `uncontrolled_torque`.
    """
    w, wd = (modelled[name].values[METHODS.index(method)] for name in ("rate_b", "rate_dot_b"))
    free = model.free_mass_angular_acceleration(test_mass_inertia, modelled["gradient_b"].values, w)
    return free - modelled["angular_b"].values[:, sensors].mean(axis=1) - wd


def balance(torque, drag_b, place, satellite, *, width, step):
    """Centre of pressure (3,) m from the torque balance, its covariance, and the rms (3,) N m of the torque left.

    Torque and drag_b (n, 3) N m, m s-2 are those with the angular acceleration as read by the test mass at `place`;
    means of `width` samples, `step` s, keep the noise of the regressor far below its signal.

    Notes
    -----
    The rest is coloured noise and an unknown constant torque. Its spectrum is the likeliest with all unknowns free;
    what the record leaves open of it is in the covariance, as values and covariances with spectra drawn about it. An
    error d of the angular acceleration changes the drag by r x d and the torque by I_B d; what both have in common is
    taken off the normal equations, or least squares would be biased.
    """
    inertia, mass = np.array(satellite["inertia"]), satellite["mass"]
    whole = len(torque) // width * width
    torque, drag_b = (series[:whole].reshape(-1, width, 3).mean(axis=1) for series in (torque, drag_b))
    prior, prior_sigma = (np.array(satellite[f"centre_of_pressure{tail}"]) for tail in ("", "_sigma"))
    arm = -mass * cross_matrix(drag_b)
    angular = np.sqrt(np.array(satellite["angular_noise_density"]) ** 2 / (2 * step))
    arm_error = np.stack([-mass * cross_matrix(column) for column in (cross_matrix(np.asarray(place)) * angular).T])
    errors = np.concatenate([(inertia * angular).T[:, :, None], arm_error], axis=2)  # of torque and arm, by each d
    common = np.einsum("jki,jkl->kil", arm_error, errors)
    valid = np.isfinite(torque).all(axis=1) & np.isfinite(arm).all(axis=(1, 2))
    columns = [np.nan_to_num(np.column_stack([torque[:, k], arm[:, k], np.ones(whole // width)])) for k in range(3)]
    impulse = np.zeros((2 * ORDER + 1, 1))
    impulse[ORDER] = 1.0

    def solved(models):
        """Centre of pressure (3,) m and its covariance, from equations whitened by a noise model for each axis."""
        normal, right = np.diag(1 / prior_sigma**2), prior / prior_sigma**2
        for k, one in enumerate(models):
            white = noise.whiten(one, columns[k], valid)
            rows = least_squares.project_out(white[:, 4:], white[:, :4])
            power = float(np.sum(noise.whiten(one, impulse, np.ones(len(impulse), dtype=bool)) ** 2))
            biased = np.count_nonzero(valid) * power * common[k]
            products = rows[:, 1:].T @ rows
            normal, right = normal + products[:, 1:] - biased[:, 1:], right + products[:, 0] - biased[:, 0]
        return np.linalg.solve(normal, right), np.linalg.inv(normal)

    rng = np.random.default_rng(0)
    spectra = [_drawn_spectra(np.where(valid, one[:, 0], np.nan), one[:, 1:], step, rng) for one in columns]
    solutions = [solved(models) for models in zip(*spectra, strict=True)]
    value, covariance = solutions[0]
    if len(solutions) > 1:
        deviations = np.array([one - value for one, _ in solutions[1:]])
        covariance = np.mean([one for _, one in solutions[1:]], axis=0) + deviations.T @ deviations / len(deviations)
    residual = np.stack([(one[:, 0] - one[:, 1:4] @ value)[valid] for one in columns], axis=1)
    return value, covariance, residual.std(axis=0)


def _drawn_spectra(series, columns, step, rng):
    """Noise models of a series (n,), columns (n, q) free: the likeliest, then DRAWS by its error; white if short."""
    count = np.count_nonzero(np.isfinite(series))
    if count < 4 * LEAST_KNOTS * columns.shape[1]:
        return [noise.fit_noise([series], 0, step, removed=columns.shape[1])]
    knots = (np.arange(size := max(LEAST_KNOTS, min(count // SAMPLES, MOST_KNOTS))) + 0.5) / (2 * step * size)
    spectrum = noise.fit_spectrum([(series, columns)], step, knots)
    deviations = np.linalg.cholesky(spectrum.covariance) @ rng.standard_normal((size, DRAWS))
    nodes = (np.arange(NODES) + 0.5) / (2 * step * NODES)
    drawn = spectrum.log_density[:, None] + np.column_stack([np.zeros(size), deviations])
    return [noise.from_density(density, ORDER, step) for density in np.exp(spectrum.shares(nodes) @ drawn).T]


def with_model_error(solved: xr.Dataset, *moved: xr.Dataset, added: str = "") -> xr.Dataset:
    """Drag product with the errors of effects taken out before; for the pressure `added` may hold them."""
    new = widened(solved, moved, {"drag_b": ("covariance", "covariance_total")})
    if "pressure" in solved:
        new |= widened(solved, () if added else moved, {"pressure": ("pressure_covariance",)}, added)
    return replaced(solved, new)


def combine(
    *products: xr.Dataset,
    methods: tuple,
    identifiability_epochs: int,
    identifiability_step_s: float,
    single_sensor: int,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Product "gradient_torque.combine": errors (rms by axis), spectra and identifiability of all methods.

    Products are "gradient_torque.gradient", then "gradient_torque.drag" of each of `methods`, then, if there is one,
    "gradient_torque.truth" and the drags from readings without noise in the order of `methods`; "bare" is a reading.
    """
    modelled, drags, rest = products[0], products[1 : 1 + len(methods)], products[1 + len(methods) :]
    truth = rest[0]["drag_b"].values if rest else np.full(drags[0]["drag_b"].shape, np.nan)
    if rest and not np.array_equal(rest[0]["time"].values, drags[0]["time"].values):
        expected, remedy = f"the {drags[0].sizes['time']} of the readings", "Give the truth of this record."
        refuse("truth", f"{len(truth)} epochs", expected, remedy, EstimationError)
    step = float(np.median(np.diff(modelled["time"].values)))
    error = np.stack([one["drag_b"].values - truth for one in drags])
    clean = np.stack([one["drag_b"].values - truth for one in rest[1:]]) if rest[1:] else np.full_like(error, np.nan)
    bare = np.stack([one["bare_b"].values - one["drag_b"].values for one in drags])
    held, total = (
        np.stack([np.diagonal(one[name].values, axis1=1, axis2=2) for one in drags])
        for name in ("covariance", "covariance_total")
    )
    values = {
        "method": np.array(methods),
        "error_rms": _rms(error),
        "clean_error_rms": _rms(clean),
        "bare_error_rms": _rms(bare + error),
        "correction_rms": _rms(bare),
        "sigma_rms": np.sqrt(held.mean(axis=(1, 2))),
        "sigma_total_rms": np.sqrt(total.mean(axis=(1, 2))),
        "error_over_sigma": _rms(error / np.sqrt(held)),
    }
    values["frequency"], drag_amplitude = amplitude_spectrum(drags[0]["drag_b"].values, step)
    values["drag_amplitude"] = drag_amplitude.T
    for name, series in (("error", error), ("clean_error", clean)):
        values[f"{name}_amplitude"] = np.moveaxis(amplitude_spectrum(series, step)[1], 1, 2)
    place, pressure = modelled["sensor_position_b"].values[single_sensor - 1], np.array(satellite["centre_of_pressure"])
    test_mass = model.box_inertia(satellite, elongation)
    sensor = model.Sensor(np.array(satellite["inertia"]), test_mass, satellite["mass"], place, pressure)
    shifted = np.where(np.abs(place) < 1e-9, 1e-3, place)  # the printed form cannot have zeros
    vectors = model.printed_vectors(sensor.inertia, test_mass, sensor.mass, pressure, shifted)
    values["single_rank"], values["null_space"] = model.single_epoch(sensor)
    values["printed_rank"], values["printed_null"] = model.printed_pair(*vectors)
    one_sensor = drags[list(methods).index("one_sensor")]
    arc = _arc(modelled, one_sensor, single_sensor - 1, identifiability_epochs, identifiability_step_s, satellite)
    steps = model.joint(sensor, arc)
    knowledge, ranks, sizes, sigmas = zip(*steps, strict=True)
    values |= {"step": np.array(knowledge), "step_rank": ranks, "step_unknowns": sizes, "step_sigma": sigmas}
    return build(SCHEMAS["combine"], values | {"unknown": np.array(model.UNKNOWNS)}, title="Drag by all methods")


def _rms(values):
    """Root mean square (k,) of the finite values (k, n, 3) of each method, NaN where there are none."""
    finite = np.isfinite(values)
    count = finite.sum(axis=(1, 2))
    return np.sqrt(np.where(count > 0, np.sum(values**2, axis=(1, 2), where=finite), np.nan) / np.maximum(count, 1))


def _arc(modelled, one_sensor, sensor, epochs, spacing, satellite):
    """Motion and deviations of a sensor at epochs at most `spacing` s apart, from a quarter of the record on."""
    time, drag_b = modelled["time"].values, one_sensor["drag_b"].values
    step = float(np.median(np.diff(time)))
    every = max(1, min(round(spacing / step), time.size // (2 * epochs)))
    at = time.size // 4 + every * np.arange(epochs)
    band = 1 / np.sqrt(2 * step)
    place = modelled["sensor_position_b"].values[sensor]
    spread = np.sqrt(np.mean(np.diagonal(modelled["motion_covariance"].values[0], axis1=1, axis2=2)))
    sigma = {
        "linear": np.array(satellite["linear_noise_density"]) * band,
        "angular": np.array(satellite["angular_noise_density"]) * band,
        "place": np.array(satellite["sensor_position_sigma"])[sensor],
        "gradient": float(np.sqrt(modelled["gradient_variance"].values.max())),
        "motion": max(spread / np.linalg.norm(place), 1e-13),
        "pressure": np.array(satellite["centre_of_pressure_sigma"]),
        "torque": float(one_sensor["torque_residual"].values.max() if "torque_residual" in one_sensor else 0.0) or 1e-6,
    }
    rates = (modelled[name].values[0][at] for name in ("rate_b", "rate_dot_b"))
    drag_b = np.where(np.isfinite(drag_b[at]), drag_b[at], np.nanmean(drag_b, axis=0))
    return model.Motion(*rates, drag_b, modelled["gradient_b"].values[at], sigma)
