"""Offset of the centre of mass from plain arrays: motion, gradient and reading of one manoeuvre."""

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
    reading_b: np.ndarray,
    time: np.ndarray,
    noise: Sequence[NoiseModel],
    drift_degree: int = 5,
) -> Estimate:
    """Vector from the proof mass to the centre of mass.

    Parameters
    ----------
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2, of the body with respect to inertial
    gradient_b : (n, 3, 3) s-2, dg/dr
    reading_b : (n, 3) m s-2, linear accelerometer in SRF, NaN where missing
    time : (n,) s, evenly spaced
    noise : three NoiseModel, one an axis, m s-2; `gravcal.estimation.noise.fit_noise` makes them of quiet data
    drift_degree : of the polynomial per axis that stands for bias, drag and radiation pressure

    Returns
    -------
    estimate : Estimate of x, y, z in m, from the proof mass to the centre of mass (SRF)

    Notes
    -----
    f = T p + drift with T = [w' x] + [w x][w x] - G and p = -d; Remote Sens. 2022, 14, 4030, eq. 1 (equations.md, M1).
    Rates and angular accelerations are taken as true: their errors are treated by the pipeline's `com_offset.solve`.

    Examples
    --------
    >>> import numpy as np
    >>> from gravcal import com_offset
    >>> from gravcal.estimation.noise import fit_noise
    >>> from gravcal.physics.sensing import offset_tensor
    >>> rng, time = np.random.default_rng(1), 0.1 * np.arange(1800)
    >>> noise = [fit_noise([1e-10 * rng.standard_normal(3000)], 1, 0.1) for _ in range(3)]
    >>> phase = 2 * np.pi * time / 12
    >>> rate_dot = 2e-6 * np.stack([np.sin(phase), 0.5 * np.cos(phase), np.sin(2 * phase)], axis=1)
    >>> rate, gradient = np.zeros((1800, 3)), np.zeros((1800, 3, 3))
    >>> reading = -offset_tensor(rate, rate_dot, gradient) @ [100e-6, -20e-6, 30e-6] + 3e-7
    >>> reading += 1e-10 * rng.standard_normal(reading.shape)
    >>> found = com_offset.estimate(rate, rate_dot, gradient, reading, time, noise)
    >>> bool(np.all(np.abs(found.value - [100e-6, -20e-6, 30e-6]) < 4 * found.sigma))
    True
    """
    time = np.asarray(time, dtype=float)
    columns = -offset_tensor(np.asarray(rate_b), np.asarray(rate_dot_b), np.asarray(gradient_b))
    drift = polynomial(time, drift_degree, time[0], time[-1])
    return solve(reading_b, columns, noise, drift, ("x", "y", "z"), "m")
