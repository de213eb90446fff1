"""Noise of a roll as discovery sees it: a sum of power laws, beside every form that is tried."""

from collections.abc import Callable

import numpy as np
from scipy.fft import next_fast_len
from scipy.optimize import nnls

from gravcal.estimation import noise

EXPONENTS = (-2, -1, 0, 1)  # of the frequency in the power laws whose sum is the density of the noise
ORDER, NODES = 60, 16384  # coefficients that stand for it, frequencies that they are made of
DRAWS = 400  # segments of simulated noise, for what a fit leaves of each
ROUNDS, HIGHEST = 20, 6.0  # of the fit; power over that of the model, reached by noise in one of 400


def power_laws(values: np.ndarray, clean: Callable, count: np.ndarray, step_s: float) -> noise.NoiseModel:
    """Noise model of a series from what a fit leaves of it: the sum of power laws that its periodogram shows.

    Power laws are drawn and go through the same fit. Sharp lines are no noise, and the power at a frequency counts up
    to a few times that of the model. Values (s, b, 1) are segments, clean takes (s, b, d) to what the fit leaves, runs
    of segments that touch (n, d), count (s, b) are steps since the first sample.
    """
    lowest, rng = 1 / (step_s * count.max()), np.random.default_rng(0)
    draws = max(8, DRAWS // len(count))
    white = rng.standard_normal((next_fast_len(2 * int(count.max()) + 1, real=True), draws))
    frequency = np.maximum(np.fft.rfftfreq(len(white), step_s), lowest)[:, None]
    spectrum, expected = np.fft.rfft(white, axis=0), []
    for exponent in EXPONENTS:
        drawn = np.fft.irfft(spectrum * (frequency * step_s) ** (exponent / 2), len(white), axis=0)
        expected.append(_periodogram(clean(drawn[count])).mean(axis=1))
    expected = np.stack(expected, axis=1)
    power = _periodogram(noise.without_lines(clean(values), step_s)[0])[:, 0]
    model = expected[:, EXPONENTS.index(0)] * power.mean() / expected[:, EXPONENTS.index(0)].mean()
    for _ in range(ROUNDS):
        size = nnls(expected / model[:, None], np.minimum(power / model, HIGHEST))[0]
        model = expected @ size
    at = (np.arange(NODES) + 0.5) / (2 * step_s * NODES)
    density = 2 * step_s * sum(a * (np.maximum(at, lowest) * step_s) ** e for a, e in zip(size, EXPONENTS, strict=True))
    return noise.from_density(density, ORDER, step_s)


def _periodogram(runs):
    """Power over that of a Hann window (f, d) of all runs (n, d), one behind the other, without their means."""
    parts = []
    for run in runs:
        window = np.hanning(len(run) + 2)[1:-1, None]
        parts.append(np.abs(np.fft.rfft(window * (run - run.mean(axis=0)), axis=0)[1:]) ** 2 / np.sum(window**2))
    return np.concatenate(parts)
