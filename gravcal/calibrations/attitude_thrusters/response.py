"""How the attitude answers an angular impulse, and what a smooth torque can do."""

from __future__ import annotations

import numpy as np

from gravcal.physics import frames

DEGREE = 5  # of the attitude: two integrations of a torque that is a cubic spline


def reference(time: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Small rotation from a steady turn to the attitude, and the rate of that turn.

    Parameters
    ----------
    time : (n,) s, increasing
    quaternion : (n, 4) scalar first, continuous in sign

    Returns
    -------
    angle_b : (n, 3) rad
    rate_b : (3,) rad s-1
    """
    steps = frames.rotation_vector(frames.quaternion_product(frames.conjugate(quaternion[:-1]), quaternion[1:]))
    rate = steps.sum(axis=0) / (time[-1] - time[0])
    middle = time.size // 2
    turn = frames.from_rotation_vector(rate * (time - time[middle])[:, None])
    steady = frames.quaternion_product(quaternion[middle], turn)
    return frames.rotation_vector(frames.quaternion_product(frames.conjugate(steady), quaternion)), rate


def smooth_torque(time: np.ndarray, knot_s: float) -> np.ndarray:
    """Attitudes (n, k) that torques with a knot every so many seconds can make, start and rate included.

    Parameters
    ----------
    time : (n,) s
    knot_s : s, spacing of the knots of the cubic torque; the attitude is a spline of degree 5 on them
    """
    from scipy.interpolate import BSpline

    start, stop = time[0], time[-1] + 1e-3
    count = max(int(np.ceil((stop - start) / knot_s)), 1)
    inner = np.linspace(start, stop, count + 1)
    knots = np.concatenate([np.full(DEGREE, start), inner, np.full(DEGREE, stop)])
    return BSpline.design_matrix(time, knots, DEGREE).toarray()


def impulse_response(inertia_b: np.ndarray, rate_b: np.ndarray, lag_s: np.ndarray) -> np.ndarray:
    """Small rotation (n, 3, 3) rad per N m s, lags after an impulse, about a steady turn.

    Parameters
    ----------
    inertia_b : (3, 3) kg m2
    rate_b : (3,) rad s-1, of the turn
    lag_s : (n,) s, evenly spaced from 0

    Notes
    -----
    angle' = -w x angle + dw, J dw' = -(w x J dw) - (dw x J w): equations.md M2, first order about a constant rate.
    """
    from scipy.linalg import expm

    turn = frames.cross_matrix(rate_b)
    free = np.zeros((6, 6))
    free[:3, :3], free[:3, 3:] = -turn, np.eye(3)
    free[3:, 3:] = -np.linalg.solve(inertia_b, turn @ inertia_b - frames.cross_matrix(inertia_b @ rate_b))
    step, inverse = expm(free * (lag_s[1] - lag_s[0])), np.linalg.inv(inertia_b)
    response, state = np.zeros((lag_s.size, 3, 3)), np.eye(6)
    for k in range(lag_s.size):
        response[k] = state[:3, 3:] @ inverse
        state = step @ state
    return response


def table(inertia_b: np.ndarray, rate_b: np.ndarray, span_s: float):
    """Impulse response at any lag up to a span: callable, (...,) s -> (..., 3, 3) rad per N m s.

    Parameters
    ----------
    inertia_b : (3, 3) kg m2
    rate_b : (3,) rad s-1
    span_s : s
    """
    from scipy.interpolate import CubicSpline

    lags = np.arange(0.0, span_s + 40.0, 10.0)  # the turn is slow: 1e-3 rad s-1
    return CubicSpline(lags, impulse_response(inertia_b, rate_b, lags))


def after_impulses(time: np.ndarray, epochs: np.ndarray, impulse_b: np.ndarray, answer) -> np.ndarray:
    """Attitude (n, 3, q) rad after impulses.

    Parameters
    ----------
    time : (n,) s
    epochs : (k,) s, of the impulses; those outside the span of `time` are left out
    impulse_b : (k, 3, q) N m s
    answer : of `table`
    """
    inside = (epochs > time[0]) & (epochs < time[-1])
    lag = time[:, None] - epochs[inside]
    kernel = np.where((lag > 0)[..., None, None], answer(np.maximum(lag, 0.0)), 0.0)
    count = int(inside.sum())
    flat = kernel.transpose(0, 2, 1, 3).reshape(3 * time.size, 3 * count)
    width = impulse_b.shape[2]
    return (flat @ impulse_b[inside].reshape(3 * count, width)).reshape(time.size, 3, width)
