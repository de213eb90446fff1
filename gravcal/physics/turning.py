"""Attitude from body rates, and what small changes of the rates do to it."""

from __future__ import annotations

import numpy as np

from gravcal.physics import frames


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
    dq/dt = q w / 2; each step turns by h (w0 + w1)/2 - h^2/12 (w0 x w1), the Magnus expansion for linear rates;
    the product of all steps is formed pairwise.
    """
    step = np.diff(time)[:, None]
    turn = step / 2 * (rate_b[:-1] + rate_b[1:]) - step**2 / 12 * np.cross(rate_b[:-1], rate_b[1:])
    product = np.concatenate([np.asarray(start, dtype=float)[None], frames.from_rotation_vector(turn)])
    reach = 1
    while reach < product.shape[0]:
        product[reach:] = frames.quaternion_product(product[:-reach], product[reach:])
        reach *= 2
    return product / np.linalg.norm(product, axis=1, keepdims=True)


def running_integral(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral from the first epoch by the trapezoidal rule.

    Parameters
    ----------
    time : (n,) s
    values : (n, ...) any unit

    Returns
    -------
    integral : (n, ...) unit times s, zero at the first epoch
    """
    values = np.asarray(values, dtype=float)
    step = np.diff(time).reshape(-1, *[1] * (values.ndim - 1))
    pieces = step / 2 * (values[:-1] + values[1:])
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(pieces, axis=0)])


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
    change_i = np.swapaxes(R_bi, 1, 2) @ rate_change_b
    return R_bi @ running_integral(time, change_i)
