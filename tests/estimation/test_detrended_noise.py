"""Noise models from residuals of a fit."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.estimation.least_squares import polynomial, without
from gravcal.estimation.noise import NoiseModel, beside, draw, fit_detrended, fit_noise, from_density

RED = NoiseModel(np.array([0.9, -0.2]), np.array([1.0, 0.19, 0.19 * 0.96]), 1.0)


def cleaned(segment, _):
    """Segment less a parabola."""
    u = np.arange(len(segment), dtype=float)
    return without(polynomial(u, 3, 0, len(u) - 1), segment)


def test_a_spectrum_comes_back_from_its_autocovariance():
    """Analytic: the model of an autoregressive spectrum is the model itself."""
    frequency = (np.arange(4096) + 0.5) / 8192
    again = from_density(RED.density(frequency), 2, 1.0)
    assert_allclose(again.reflection, RED.reflection, atol=1e-9)
    assert_allclose(again.variance[-1] / again.variance[0], RED.variance[-1] / RED.variance[0], rtol=1e-9)


def test_drawn_noise_has_the_spectrum_of_its_model():
    """Recovery: variance of a long draw, expected to 3 %; the model is stationary from the first sample on."""
    rng = np.random.default_rng(4)
    frequency = (np.arange(4096) + 0.5) / 8192
    expected = np.mean(RED.density(frequency)) / 2
    drawn = np.stack([draw(RED, 50, rng) for _ in range(4000)])
    assert_allclose(np.mean(drawn[:, 0] ** 2), expected, rtol=0.12)
    assert_allclose(np.mean(drawn**2), expected, rtol=0.05)


def test_what_a_fit_takes_is_put_back():
    """Recovery: slow power of red noise after a cubic fit of 90 samples, short by 20 % in the plain fit."""
    rng = np.random.default_rng(7)
    segments = [np.stack([draw(RED, 90, rng) for _ in range(3)], axis=1) for _ in range(60)]
    models = fit_detrended(segments, cleaned, 3, 1.0)
    slow = np.linspace(0.002, 0.02, 10)
    ratio = np.mean([m.density(slow) / RED.density(slow) for m in models])
    assert 0.85 < ratio < 1.15


def test_what_may_be_there_is_no_noise():
    """Recovery: slow waves a thousand times the noise in one run with a gap; the spectrum below them as without."""
    rng = np.random.default_rng(9)
    noise = np.stack([draw(RED, 1500, rng) for _ in range(3)], axis=1)
    noise[700:720] = np.nan
    u = np.arange(1500.0)
    waves = [f(2 * np.pi * k * u / 500) for k in (1, 2) for f in (np.cos, np.sin)]
    columns = np.stack([wave[:, None] * np.eye(3)[a] for wave in waves for a in range(3)], axis=2)
    size = 1000 * rng.standard_normal(columns.shape[2])
    made = [noise + columns @ size]
    found = fit_detrended(made, beside(made, [columns]), 3, 1.0)
    slow = np.linspace(0.001, 0.02, 10)
    ratio = np.mean([m.density(slow) / RED.density(slow) for m in found])
    assert 0.75 < ratio < 1.3


def test_simulated_noise_leaves_no_ripple_of_its_own():
    """Analytic: a fit that takes nothing gives the plain model, whatever noise was simulated."""
    segments = [np.random.default_rng(k).standard_normal((320, 2)) for k in range(5)]
    frequency = np.linspace(0.01, 0.49, 30)
    for axis, model in enumerate(fit_detrended(segments, lambda segment, _: segment, 6, 1.0)):
        plain = fit_noise([s[:, axis] for s in segments], 6, 1.0)
        assert_allclose(model.density(frequency), plain.density(frequency), rtol=1e-6)
