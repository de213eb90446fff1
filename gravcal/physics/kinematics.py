"""Rates from attitude, attitude from rates."""

import numpy as np
from scipy.integrate import cumulative_trapezoid

from gravcal.physics import check_increasing, check_shape, frames, refuse


def rates_from_attitude(time, quaternion, half_width=2, degree=4):
    """Rate and angular acceleration from a local polynomial through the attitude.

    Parameters
    ----------
    time : (n,) s, strictly increasing, any steps
    quaternion : (n, 4) scalar first, any signs
    half_width : int, epochs on either side of each; windows at the ends are shifted inwards
    degree : int, of the polynomial, 2 to 2 half_width; 2 half_width passes through every attitude

    Returns
    -------
    rate_b : (n, 3) rad s-1, body with respect to inertial
    rate_dot_b : (n, 3) rad s-2

    Raises
    ------
    GravcalError : fewer epochs than a window, impossible degree

    Notes
    -----
    R_ib^T dR_ib/dt = [w x] (Remote Sens. 2022, 14, 4030, eq. 14 corrected, erratum C-4). With phi the rotation vector
    from the attitude of an epoch to its neighbours, in b, w = phi' and w' = phi'' at that epoch, without approximation.
    """
    time, q = check_increasing("rates_from_attitude: time", time), check_shape("quaternion", quaternion, (None, 4))
    width = 2 * half_width + 1
    if not (2 <= degree < width <= time.size == len(q)):
        sizes = f"{time.size} epochs, {len(q)} attitudes, half_width {half_width}, degree {degree}"
        refuse("rates_from_attitude", sizes, "2 <= degree < 2 half_width + 1 <= epochs", "Widen the arc.")
    window = np.clip(np.arange(time.size) - half_width, 0, time.size - width)[:, None] + np.arange(width)
    angle = frames.rotation_vector(frames.quaternion_product(frames.conjugate(q)[:, None], q[window]))
    lag = time[window] - time[:, None]
    scale = np.abs(lag).max(axis=1)[:, None]
    powers = (lag / scale)[..., None] ** np.arange(degree + 1)
    normal = np.swapaxes(powers, -1, -2)
    coefficients = np.linalg.solve(normal @ powers, normal @ angle)
    return coefficients[:, 1] / scale, 2 * coefficients[:, 2] / scale**2


def published_rates_from_attitude(time, quaternion):
    """Rate and angular acceleration by the central differences of the CoM paper.

    Parameters
    ----------
    time : (n,) s, strictly increasing
    quaternion : (n, 4) scalar first, any signs

    Returns
    -------
    rate_b : (n, 3) rad s-1, NaN at the first and last epoch
    rate_dot_b : (n, 3) rad s-2, NaN at the first and last two epochs

    Notes
    -----
    R = (R+ + R-)/2, R' = (R+ - R-)/(t+ - t-), w_x = sum_k R'_k2 R_k3 and cyclic; Remote Sens. 2022, 14, 4030, eq. 15
    with R_jk the elements of R_ib (erratum C-4: as labelled in print it is -(R_ib w)). The gain on a wave of angular
    frequency W sampled at h is sin(W h)/(W h), and its square for w'.
    """
    time = check_increasing("published_rates_from_attitude: time", time)
    R_ib = np.swapaxes(frames.R_bi_from_quaternion(check_shape("quaternion", quaternion, (time.size, 4))), -1, -2)
    R, R_dot = (R_ib[2:] + R_ib[:-2]) / 2, _central(time, R_ib)
    rate, rate_dot = np.full((2, time.size, 3), np.nan)
    rate[1:-1] = np.einsum("nki,nki->ni", R_dot[:, :, [1, 2, 0]], R[:, :, [2, 0, 1]])
    rate_dot[1:-1] = _central(time, rate)
    return rate, rate_dot


def attitude_from_rates(time: np.ndarray, rate_b: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Attitude reached by turning with given body rates.

    Parameters
    ----------
    time : (n,) s, steps short against the change of the rates
    rate_b : (n, 3) rad s-1, body with respect to inertial
    start : (4,) attitude at the first epoch

    Returns
    -------
    quaternion : (n, 4) scalar first, continuous in sign

    Notes
    -----
    dq/dt = q w / 2; each step turns by h (w0 + w1)/2 + h^2/12 (w0 x w1), the Magnus expansion for linear rates;
    the product of all steps is formed pairwise.
    """
    step = np.diff(time)[:, None]
    turn = step / 2 * (rate_b[:-1] + rate_b[1:]) + step**2 / 12 * np.cross(rate_b[:-1], rate_b[1:])
    product = np.concatenate([np.asarray(start, dtype=float)[None], frames.from_rotation_vector(turn)])
    reach = 1
    while reach < product.shape[0]:
        product[reach:] = frames.quaternion_product(product[:-reach], product[reach:])
        reach *= 2
    return product / np.linalg.norm(product, axis=1, keepdims=True)


def running_integral(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral (n, ...) from the first epoch of values (n, ...) at times (n,) s, by the trapezoidal rule."""
    return cumulative_trapezoid(np.asarray(values, dtype=float), time, axis=0, initial=0.0)


def angle_from_rate_change(time: np.ndarray, R_bi: np.ndarray, rate_change_b: np.ndarray) -> np.ndarray:
    """Small rotation of the attitude caused by a small change of the body rates, to first order.

    Parameters
    ----------
    time : (n,) s
    R_bi : (n, 3, 3)
    rate_change_b : (n, 3, m) rad s-1 per unit of m parameters

    Returns
    -------
    angle_b : (n, 3, m) rad per unit

    Notes
    -----
    d(angle)/dt = dw - w x angle, so angle_i is the integral of R_ib dw.
    """
    return R_bi @ running_integral(time, np.swapaxes(R_bi, 1, 2) @ rate_change_b)


def _central(time, values):
    """(values after - values before) / (time after - time before) at the inner epochs."""
    return (values[2:] - values[:-2]) / (time[2:] - time[:-2]).reshape(-1, *[1] * (values.ndim - 1))
