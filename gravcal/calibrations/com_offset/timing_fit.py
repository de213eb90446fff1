"""When the edges appear in each instrument, and what that says about the delays of their tags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.estimation.least_squares import polynomial, stable_inverse, without
from gravcal.estimation.noise import NoiseModel, whiten
from gravcal.estimation.resampling import Resampler


@dataclass(frozen=True)
class WaveFit:
    """Square wave seen in a measured angular acceleration.

    Attributes
    ----------
    shift, shift_sigma : s, by which the wave appears later than assumed
    scale, scale_sigma : (3,) measured over modelled, sigma infinite for an axis that is not turned
    residual : (n, 3) rad s-2, resampled, drift removed
    """

    shift: float
    shift_sigma: float
    scale: np.ndarray
    scale_sigma: np.ndarray
    residual: np.ndarray


def fit_wave(measured, wave, operator: Resampler, noise: list[NoiseModel], degree: int, iterations: int = 8) -> WaveFit:
    """Scale per axis and common shift of a modelled wave in a measured angular acceleration.

    The model is noise-free and stands on the right-hand side, so the scale has no attenuation.

    Parameters
    ----------
    measured : (n, 3) rad s-2
    wave : callable, shift s -> (n, 3) rad s-2
    operator : applied to the measurement and to the model alike
    noise : noise model of each axis on the operator's grid
    degree : of the drift
    iterations : Gauss-Newton steps
    """
    drift = polynomial(operator.time, degree, operator.time[0], operator.time[-1])
    y = operator(measured - measured[len(measured) // 2])
    shift, scale = coarse_shift(y, operator(wave(0.0)), operator, drift, noise), np.ones(3)
    for _ in range(iterations):
        model = operator(wave(shift))
        slope = (operator(wave(shift + 0.01)) - operator(wave(shift - 0.01))) / 0.02
        rows = [_axis(y, model, slope, scale, drift, operator.valid, noise, axis) for axis in range(3)]
        values, design = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
        inverse = stable_inverse(design.T @ design)
        unknown = inverse @ design.T @ values
        scale = unknown[:3]
        shift = float(np.clip(shift + unknown[3], -4.0, 4.0))
        if abs(unknown[3]) < 1e-5:
            break
    size = np.linalg.norm(design[:, :3], axis=0)
    seen = size > 1e-6 * size.max(initial=1e-300)
    sigma = np.sqrt(np.clip(np.diag(inverse), 0.0, None))
    residual = y - model * scale
    used = np.nan_to_num(residual[operator.valid])
    residual = np.full_like(y, np.nan)
    residual[operator.valid] = without(drift[operator.valid], used)
    return WaveFit(shift, float(sigma[3]), np.where(seen, scale, 1.0), np.where(seen, sigma[:3], np.inf), residual)


def coarse_shift(y, model, operator: Resampler, drift, noise: list[NoiseModel], longest: float = 3.0) -> float:
    """Shift in steps of the grid at which measurement and model agree best, the start of the Gauss-Newton steps.

    Parameters
    ----------
    y, model : (n, 3) rad s-2, resampled
    operator : Resampler
    drift : (n, k)
    noise : noise model of each axis
    longest : s, beyond which it is not looked for
    """
    valid = operator.valid
    weight = np.array([1 / n.variance[0] if n.variance[0] > 0 else 0.0 for n in noise])
    clean = np.zeros((2, *y.shape))
    for k, series in enumerate((y, model)):
        clean[k][valid] = without(drift[valid], series[valid])
    step = float(operator.time[1] - operator.time[0])
    count = int(longest / step)
    lags = np.arange(-count, count + 1)
    inner = slice(count, len(y) - count)
    agreement = [
        np.sum(weight * np.sum(clean[0][inner] * np.roll(clean[1], lag, axis=0)[inner], axis=0)) for lag in lags
    ]
    return float(lags[int(np.argmax(agreement))] * step)


def _axis(y, model, slope, scale, drift, valid, noise, axis):
    """Whitened observation and columns (three scales, shift) of one axis, drift removed."""
    columns = np.zeros((y.shape[0], 5))
    columns[:, 0] = y[:, axis]
    columns[:, 1 + axis] = model[:, axis]
    columns[:, 4] = scale[axis] * slope[:, axis]
    both = whiten(noise[axis], np.concatenate([columns, drift], axis=1), valid)
    clean = without(both[:, 5:], both[:, :5])
    return clean[:, 0], clean[:, 1:]


def delay_from_brackets(shift, sigma, lower, upper) -> tuple[float, float]:
    """Delay of an instrument's tags against the torquer telemetry.

    Telemetry at 2 Hz only says between which samples the first edge lies. The edge seen by the instrument, less the
    delay, has to lie there in every manoeuvre; a flat prior gives mean and standard deviation of what is left.

    Parameters
    ----------
    shift, sigma : (k,) s, apparent first edge and its error
    lower, upper : (k,) s, interval that telemetry leaves, on the same origin

    Returns
    -------
    delay, delay_sigma : s
    """
    from scipy.special import log_ndtr, ndtr

    half = (np.max(upper - lower) + np.max(np.abs(shift))) + 5 * float(np.max(sigma))
    grid = np.linspace(-half, half, 8001)
    true = shift[:, None] - grid
    with np.errstate(divide="ignore"):
        inside = ndtr((upper[:, None] - true) / sigma[:, None]) - ndtr((lower[:, None] - true) / sigma[:, None])
        log = np.where(inside > 1e-280, np.log(np.maximum(inside, 1e-300)), 0.0)
    far = np.minimum(
        log_ndtr((upper[:, None] - true) / sigma[:, None]), log_ndtr((true - lower[:, None]) / sigma[:, None])
    )
    log = np.sum(np.where(inside > 1e-280, log, far), axis=0)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    return mean, float(np.sqrt(weight @ (grid - mean) ** 2))
