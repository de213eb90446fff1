"""Attitude of a simulated swing, integrated step by step; shares nothing with the estimator's integration."""

from __future__ import annotations

import numba
import numpy as np


def attitude(step_s: float, rate_b: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Attitude from body rates on an even, fine grid.

    Parameters
    ----------
    step_s : s
    rate_b : (n, 3) rad s-1
    start : (4,) scalar first, at the first epoch

    Returns
    -------
    quaternion : (n, 4) continuous in sign
    """
    return _march(step_s, np.ascontiguousarray(rate_b), np.array(start, dtype=float))


def from_derivative(step_s: float, values: np.ndarray) -> np.ndarray:
    """Integral over an even grid by the trapezoidal rule, zero at the first epoch.

    Parameters
    ----------
    step_s : s; values : (n, m)
    """
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(values, dx=step_s, axis=0, initial=0.0)


@numba.njit(cache=True)
def _march(step, rate, q):
    """Turn by the mean rate of every step, q <- q * exp(w h)."""
    out = np.empty((rate.shape[0], 4))
    out[0] = q
    for t in range(1, rate.shape[0]):
        x, y, z = 0.5 * step * (rate[t - 1] + rate[t])
        angle = np.sqrt(x * x + y * y + z * z)
        c = np.cos(angle / 2)
        s = 0.5 if angle < 1e-12 else np.sin(angle / 2) / angle
        p0, p1, p2, p3 = c, s * x, s * y, s * z
        a0, a1, a2, a3 = q[0], q[1], q[2], q[3]
        q[0] = a0 * p0 - a1 * p1 - a2 * p2 - a3 * p3
        q[1] = a0 * p1 + a1 * p0 + a2 * p3 - a3 * p2
        q[2] = a0 * p2 - a1 * p3 + a2 * p0 + a3 * p1
        q[3] = a0 * p3 + a1 * p2 - a2 * p1 + a3 * p0
        out[t] = q / np.sqrt(np.sum(q * q))
        q[:] = out[t]
    return out
