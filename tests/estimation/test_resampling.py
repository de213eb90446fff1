"""The operator that low-passes and resamples data and columns alike."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import ProductError
from gravcal.estimation.resampling import lowpass_resampler, operator_for

LOWPASS = {"lowpass_hz": 0.8, "half_width_s": 2.0}  # as the centre-of-mass calibration uses it


def jittered(rng, count=400, step=0.1, jitter=0.02):
    """Sampling times (count,) in s, unevenly spaced as a receiver clock makes them."""
    return np.arange(count) * step + jitter * rng.uniform(-1, 1, count)


def everywhere(time):
    """No sample flagged."""
    return np.ones(time.size, dtype=bool)


def test_a_constant_passes_unchanged_and_the_operator_is_a_matrix():
    """Analytic: weights sum to one at every output, also with jittered input; what no output uses may be missing.

    Columns together, one by one, and combined linearly give the same numbers.
    """
    time = jittered(np.random.default_rng(1))
    good = (time > 0.4) & (time < 39.2)
    operator = lowpass_resampler(time, good, np.arange(2.5, 37.0, 0.37), **LOWPASS)
    assert operator.valid.all()
    with pytest.raises(ProductError, match="at most 1/.2 step_s., 0.5 Hz"):
        operator_for(time, good, 0.0, 40.0, **LOWPASS, step_s=1.0)
    for width in (1, 3, 20):
        columns = np.where(good[:, None], np.full((1, width), -1.3e-6), np.nan)
        assert_allclose(operator(columns), -1.3e-6, rtol=1e-13)  # rounding
    rng = np.random.default_rng(2)
    time = jittered(rng)
    operator = lowpass_resampler(time, everywhere(time), np.arange(3.0, 36.0, 0.5), **LOWPASS)
    columns = rng.standard_normal((time.size, 3, 4))
    both = operator(columns)
    assert_allclose(both, np.stack([operator(columns[:, :, j]) for j in range(4)], axis=2), rtol=0, atol=0)
    mixed = columns @ np.array([1.0, -2.0, 0.5, 3.0])
    assert_allclose(operator(mixed), both @ np.array([1.0, -2.0, 0.5, 3.0]), rtol=1e-13, atol=1e-13)  # rounding


@pytest.mark.parametrize("frequency", [0.05, 1 / 12, 0.4, 0.8, 1.5, 2.5, 4.0])
def test_a_sine_is_weakened_as_the_weights_say(frequency):
    """Analytic: amplitude and phase equal the transform of the kernel, summed directly over the samples."""
    time = np.arange(600) * 0.1
    at = np.array([30.0, 30.05, 30.1])
    operator = lowpass_resampler(time, everywhere(time), at, **LOWPASS)
    lag = time - at[:, None]
    inside = np.abs(lag) <= 2.0
    kernel = np.sinc(1.6 * lag) * np.i0(5 * np.sqrt(np.clip(1 - (lag / 2) ** 2, 0, None))) * inside
    gain = np.sum(kernel * np.exp(2j * np.pi * frequency * lag), axis=1) / kernel.sum(axis=1)
    turning = np.exp(2j * np.pi * frequency * time)
    found = operator(turning.real) + 1j * operator(turning.imag)
    assert_allclose(found, gain * np.exp(2j * np.pi * frequency * at), atol=1e-13)  # rounding


def test_a_gap_marks_every_output_whose_support_it_touches():
    """Contract: no output within half the support of a missing second is valid, others are, with all their weights."""
    time = np.arange(600) * 0.1
    kept = (time < 30.0) | (time > 31.0)
    out = np.arange(5.0, 55.0, 0.25)
    operator = lowpass_resampler(time[kept], everywhere(time[kept]), out, **LOWPASS)
    touched = (out > 30.0 - 0.1 - 2.0) & (out < 31.0 + 0.1 + 2.0)
    sure = (out < 27.9 - 1e-9) | (out > 33.1 + 1e-9)
    assert not operator.valid[touched & (out > 28.05) & (out < 32.95)].any()
    assert operator.valid[sure].all()
    assert np.isnan(operator(time[kept])[~operator.valid]).all()
    out = np.arange(5.0, 55.0, 0.013)
    cut, full = (lowpass_resampler(t, everywhere(t), out, **LOWPASS) for t in (time[kept], time))
    wave = np.sin(2 * np.pi * time / 12)
    assert_allclose(cut(wave[kept])[cut.valid], full(wave)[cut.valid], atol=5e-3)  # a sample of weight 1e-3 is missing


def test_flagged_samples_and_the_ends_spoil_the_outputs_that_use_them_and_no_other():
    """Contract: a flagged value never reaches a valid output; of a record shorter than the support none is valid."""
    time = np.arange(600) * 0.1
    good = everywhere(time)
    good[300] = False
    values = np.sin(time)
    spoiled = np.where(good, values, 1e9)
    operator = lowpass_resampler(time, good, np.arange(5.0, 55.0, 0.25), **LOWPASS)
    assert_allclose(operator.valid, ~(np.abs(operator.time - time[300]) <= 2.0))
    assert_allclose(operator(spoiled)[operator.valid], operator(values)[operator.valid], rtol=0, atol=0)
    time = 100 + np.arange(300) * 0.1
    operator = lowpass_resampler(time, everywhere(time), np.arange(95.0, 135.0, 0.5), **LOWPASS)
    assert not operator.valid[(operator.time < 101.8) | (operator.time > 128.1)].any()
    assert operator.valid[(operator.time >= 102.0) & (operator.time <= 127.9)].all()
    short = lowpass_resampler(time[:12], everywhere(time[:12]), np.array([100.2, 100.5, 100.9]), **LOWPASS)
    assert not short.valid.any()
    assert np.isnan(short(time[:12])).all()
