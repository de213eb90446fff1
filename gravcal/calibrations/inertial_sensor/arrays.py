"""Offset of a Taiji test mass from plain arrays: motion and common-mode voltages of a swing."""

from collections.abc import Sequence

import numpy as np

from gravcal.estimation.estimate import Estimate
from gravcal.estimation.estimate import estimate as solve
from gravcal.estimation.least_squares import polynomial
from gravcal.estimation.noise import NoiseModel
from gravcal.physics.sensing import offset_tensor


def estimate(
    rate_b: np.ndarray,
    rate_dot_b: np.ndarray,
    gradient_b: np.ndarray,
    linear_volt: np.ndarray,
    time: np.ndarray,
    noise: Sequence[NoiseModel],
    scale: Sequence[float],
    drift_degree: int = 3,
) -> Estimate:
    """Vector from the centre of mass to the test mass, scale factors held.

    Parameters
    ----------
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2
    gradient_b : (n, 3, 3) s-2, dg/dr
    linear_volt : (n, 3) V, linear readouts (`gravcal.effects.inertial_sensor.readouts`), NaN where missing
    time : (n,) s, evenly spaced
    noise : three NoiseModel of the readouts, V
    scale : (3,) m s-2 V-1, k of f = b + k V
    drift_degree : of the polynomial per axis that stands for bias, drag and radiation pressure

    Returns
    -------
    estimate : Estimate of x, y, z in m; the errors of the scale factors are not in it

    Notes
    -----
    k V = -b + a_ng + (M - G) p; Remote Sens. 2023, 15, 3817, eq. 12 with the gravity gradient it drops.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import inertial_sensor
    >>> from gravcal.estimation.noise import fit_noise
    >>> from gravcal.physics.sensing import offset_tensor
    >>> rng, time = np.random.default_rng(3), 0.1 * np.arange(2000)
    >>> noise = [fit_noise([1e-6 * rng.standard_normal(3000)], 1, 0.1) for _ in range(3)]
    >>> phase = 2 * np.pi * time / 27
    >>> rate_dot = 1e-4 * np.stack([np.sin(phase), np.cos(phase), np.sin(phase)], axis=1)
    >>> still, gradient = np.zeros((2000, 3)), np.zeros((2000, 3, 3))
    >>> scale = np.array([5.4e-4, 2.7e-4, 1.1e-4])
    >>> volt = offset_tensor(still, rate_dot, gradient) @ [-140e-6, 628e-6, -896e-6] / scale
    >>> volt += 0.1 + 1e-6 * rng.standard_normal(volt.shape)
    >>> found = inertial_sensor.estimate(still, rate_dot, gradient, volt, time, noise, scale)
    >>> bool(np.all(np.abs(found.value - [-140e-6, 628e-6, -896e-6]) < 4 * found.sigma))
    True
    """
    time = np.asarray(time, dtype=float)
    tensor = offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    columns = tensor / np.asarray(scale, dtype=float)[:, None]
    drift = polynomial(time, drift_degree, time[0], time[-1])
    return solve(linear_volt, columns, noise, drift, ("x", "y", "z"), "m")
