"""Torque balance of the satellite: centre of pressure from the torque that gravity gradient and control leave."""

import numpy as np

from gravcal.estimation import least_squares, noise
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.frames import cross_matrix

ROUNDS = 3  # noise model and solution in turn


def balance(modelled, found, choices, satellite, place):
    """Centre of pressure, and what the torque balance would add to the drag.

    Parameters
    ----------
    modelled : Dataset, "gradient_torque.gradient"
    found : drag_b (n, 3) m s-2 and its covariance (n, 3, 3)
    choices : step s, order of the noise model, control Hz, damping 1
    satellite : inertia, mass, centre_of_pressure with sigma, angular_noise_density
    place : (3,) m, of the test mass whose readings gave drag and angular acceleration

    Returns
    -------
    values : dict of the optional variables of DRAG

    Notes
    -----
    I_B w' + w x I_B w - vex(I_B G - G I_B) = x_cp x m a_drag + control + rest; S-GRS paper, eq. 12 with the bracket
    where it belongs (erratum S-4). Control is -I_B (W^2 angle + 2 D W angle'): angles are fed back, so gains fitted to
    them would be biased by the rest, which the angles follow. The rest is coloured noise, measured on the residual,
    beside an unknown constant torque.
    """
    step, order, control, damping = choices
    width = max(1, round(step / float(np.median(np.diff(modelled["time"].values)))))
    W = 2 * np.pi * control
    angle, angle_dot = (modelled[name].values[0] for name in ("angle", "angle_dot"))
    pushed = np.matvec(np.array(satellite["inertia"]), W**2 * angle + 2 * damping * W * angle_dot)
    torque = _means(_torque(modelled, satellite["inertia"]) + pushed, width)
    arm = -satellite["mass"] * cross_matrix(_means(found["drag_b"], width))
    prior = np.array(satellite["centre_of_pressure"]), np.array(satellite["centre_of_pressure_sigma"])
    spread = np.array(satellite["angular_noise_density"]) ** 2 / (2 * step)
    shared = _shared(np.array(satellite["inertia"]), satellite["mass"], np.asarray(place), spread)
    value, covariance, rest = _solve(torque, arm, prior, (step, order), shared)
    return {
        "pressure": value,
        "pressure_covariance": covariance,
        "pressure_prior_sigma": prior[1],
        "torque_residual": rest,
        "torque_gain": _gain(found["covariance"], value * satellite["mass"], rest),
    }


def _means(series, width):
    """Means of so many neighbouring samples each; noise of the regressor must stay far below its signal."""
    whole = len(series) // width * width
    return series[:whole].reshape(-1, width, 3).mean(axis=1)


def _torque(modelled, inertia):
    """Torque beside that of the gravity gradient, (n, 3) N m."""
    J = np.array(inertia)
    w, wd = modelled["rate_b"].values[0], modelled["rate_dot_b"].values[0]
    gradient = gravity_gradient_torque(J, modelled["gradient_b"].values)
    return np.matvec(J, wd) + np.cross(w, np.matvec(J, w)) - gradient


def _shared(inertia, mass, place, variance):
    """Errors that regressor and torque have in common: those of the angular acceleration.

    An error d turns the drag by r x d and the torque by J d, so that least squares would be biased.

    Parameters
    ----------
    inertia : (3, 3) kg m2; mass : kg; place : (3,) m; variance : (3,) rad2 s-4 of a mean

    Returns
    -------
    of_value : callable, centre of pressure (3,) m -> (axis, 3) N2 m, expected regressor times residual of one mean
    """
    drag = cross_matrix(place) * np.sqrt(variance)  # columns: one standard deviation about each axis
    regressor = np.stack([-mass * cross_matrix(column) for column in drag.T])
    turned = (inertia * np.sqrt(variance)).T

    def of_value(value):
        return np.einsum("jki,jk->ki", regressor, turned - regressor @ value)

    return of_value


def _power(model, count):
    """Sum of the squared weights that whitening gives to one sample."""
    impulse = np.zeros((count, 1))
    impulse[count // 2] = 1.0
    return float(np.sum(noise.whiten(model, impulse, np.ones(count, dtype=bool)) ** 2))


def _solve(torque, arm, prior, choices, shared):
    """Centre of pressure with its covariance, and the rms of what is left; whitened axis by axis."""
    value = prior[0]
    columns = [np.column_stack([arm[:, k], np.ones(len(torque))]) for k in range(3)]
    models = [noise.NoiseModel(np.zeros(0), np.array([max(np.var(torque[:, k]), 1e-30)]), choices[0]) for k in range(3)]
    valid = np.isfinite(torque).all(axis=1) & np.isfinite(arm).all(axis=(1, 2))
    for _ in range(ROUNDS):
        normal, right = np.diag(1 / prior[1] ** 2), prior[0] / prior[1] ** 2
        nuisance, common = [], shared(value)
        for k in range(3):
            white = noise.whiten(models[k], np.column_stack([torque[:, k], columns[k]]), valid)
            y, A, N = white[:, 0], white[:, 1:4], white[:, 4:]
            reduced, y_reduced = least_squares.without(N, A), least_squares.without(N, y)
            biased = np.count_nonzero(valid) * _power(models[k], 101) * common[k]
            normal, right = normal + reduced.T @ reduced, right + reduced.T @ y_reduced - biased
            nuisance.append((y, A, N))
        value = np.linalg.solve(normal, right)
        gains = [np.linalg.lstsq(N, y - A @ value, rcond=None)[0] for y, A, N in nuisance]
        left = np.stack([torque[:, k] - columns[k] @ np.append(value, gains[k]) for k in range(3)], axis=1)
        left[~valid] = np.nan
        models = [noise.fit_noise([left[:, k]], choices[1], choices[0], removed=2) for k in range(3)]
    return value, np.linalg.inv(normal), np.sqrt(np.nanmean(left**2, axis=0))


def _gain(covariance, moment, rest):
    """Largest share of information on the drag that the torque would add, with the rest as white noise."""
    rows = cross_matrix(moment) / np.maximum(rest, 1e-30)[:, None]
    middle = covariance[len(covariance) // 2]
    return float(np.linalg.eigvals(middle @ rows.T @ rows).real.max())
