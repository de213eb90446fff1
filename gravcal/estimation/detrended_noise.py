"""Noise of data from which a fit was taken: what the fit took with it is put back.

A fit lowers the spectrum of its own residuals at the frequencies that it can follow. The model of the residuals is
therefore compared with that of simulated noise after the same fit, and moved until both agree (indirect inference).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gravcal.estimation.least_squares import orthonormal
from gravcal.estimation.noise import NoiseModel, fit_noise

PIECES = 150  # of simulated noise
ROUNDS = 2
DEPENDENT = 1e-5  # of the largest: columns that hardly differ are one
NODES = 1024


def fit_detrended(
    segments: list[np.ndarray], clean: Callable, order: int, step_s: float, seed: int = 0
) -> list[NoiseModel]:
    """Autoregressive model of each axis from residuals.

    Parameters
    ----------
    segments : list of (n_i, 3) any unit, evenly spaced, NaN where missing
    clean : (segment, index of it) -> segment after the fit, (n_i, 3); linear in the segment
    order : of the models
    step_s : s
    seed : of the simulated noise

    Returns
    -------
    models : one an axis
    """
    rng = np.random.default_rng(seed)
    axes = range(segments[0].shape[1])
    residual = [clean(s, i) for i, s in enumerate(segments)]
    seen = [fit_noise([r[:, a] for r in residual], order, step_s) for a in axes]
    frequency = (np.arange(NODES) + 0.5) / (2 * step_s * NODES)
    wanted = [m.density(frequency) for m in seen]
    density = list(wanted)
    for _ in range(ROUNDS):
        models = [from_density(d, order, step_s) for d in density]
        kept = _kept(models, segments, clean, rng, frequency)
        density = [w / k for w, k in zip(wanted, kept, strict=True)]
    return [from_density(d, order, step_s) for d in density]


def fit_beside(segments: list[np.ndarray], columns: list[np.ndarray], order: int, step_s: float) -> list[NoiseModel]:
    """Autoregressive model of each axis beside columns of which any size may be in the segments.

    Parameters
    ----------
    segments : list of (n_i, 3) any unit, evenly spaced, NaN where missing
    columns : list of (n_i, 3, q_i), finite, fitted to all axes of a segment together
    order : of the models
    step_s : s

    Returns
    -------
    models : one an axis
    """
    good = [np.isfinite(one).all(axis=1) for one in segments]
    bases = [
        orthonormal(one[there].reshape(-1, one.shape[2]), DEPENDENT) for one, there in zip(columns, good, strict=True)
    ]

    def clean(segment, index):
        flat = segment[good[index]].ravel()
        cleaned = np.full_like(segment, np.nan)
        cleaned[good[index]] = (flat - bases[index] @ (bases[index].T @ flat)).reshape(-1, 3)
        return cleaned

    return fit_detrended(segments, clean, order, step_s)


def _kept(models, segments, clean, rng, frequency):
    """Share of the density of each model that is left after the fit; both from the same draws, so that it is sharp."""
    before, after = [], []
    for made in _noises(models, [len(s) for s in segments], -(-PIECES // len(segments)), rng):
        for i, (segment, noise) in enumerate(zip(segments, made, strict=True)):
            before.append(np.where(np.isfinite(segment), noise, np.nan))
            after.append(clean(before[-1], i))
    order, step = models[0].reflection.size, models[0].step_s
    density = lambda made, a: fit_noise([m[:, a] for m in made], order, step).density(frequency)  # noqa: E731
    return [density(after, a) / density(before, a) for a in range(len(models))]


def _noises(models, lengths, times, rng):
    """Noise (n_i, axes) of every segment, `times` times."""
    counts = [n + _led_in(m) for n in lengths for m in models]
    white = np.split(rng.standard_normal((times, sum(counts))), np.cumsum(counts)[:-1], axis=1)
    made = [_filtered(models[k % len(models)], one, lengths[k // len(models)]) for k, one in enumerate(white)]
    each = [np.stack(made[k : k + len(models)], axis=2) for k in range(0, len(made), len(models))]
    return zip(*each, strict=True)


def draw(model: NoiseModel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary noise of a model, (count,) in its unit.

    Parameters
    ----------
    model : NoiseModel
    count : number of samples
    rng : source of randomness
    """
    return _filtered(model, rng.standard_normal(count + _led_in(model)), count)


def _led_in(model):
    """Samples after which the beginning is forgotten."""
    return 60 * (model.reflection.size + 1)


def _filtered(model, white, count):
    """The last samples (..., count) of white noise of unit variance, filtered along its last axis."""
    from scipy.signal import lfilter

    last = model.coefficients[-1]
    return lfilter([1.0], np.concatenate([[1.0], -last]), np.sqrt(model.variance[-1]) * white)[..., -count:]


def from_density(density: np.ndarray, order: int, step_s: float) -> NoiseModel:
    """Autoregressive model with the autocovariance of a spectrum up to its order (Levinson).

    Parameters
    ----------
    density : (m,) one-sided, squared unit per Hz, at the middles of m equal parts of 0 to the Nyquist frequency
    order : of the model
    step_s : s
    """
    phase = np.pi * (np.arange(density.size) + 0.5) / density.size
    covariance = np.cos(np.outer(np.arange(order + 1), phase)) @ density / (2 * step_s * density.size)
    row, variance, reflection = np.zeros(0), [covariance[0]], []
    for k in range(1, order + 1):
        one = (covariance[k] - row @ covariance[k - 1 : 0 : -1]) / variance[-1]
        row = np.append(row - one * row[::-1], one)
        reflection.append(one)
        variance.append(variance[-1] * (1 - one**2))
    return NoiseModel(np.array(reflection), np.array(variance), step_s)
