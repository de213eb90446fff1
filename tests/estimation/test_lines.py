"""Lines in quiet data."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.estimation import noise as lines
from gravcal.estimation.noise import without_lines


def quiet(rng, amplitude):
    """Twenty pieces of three minutes of red noise at 2 Hz, a tone of 0.187 Hz in y."""
    pieces = []
    for _ in range(20):
        noise = rng.standard_normal((360, 3))
        noise[1:] += 0.6 * noise[:-1]
        wave = np.sin(2 * np.pi * 0.187 * 0.5 * np.arange(360) + rng.uniform(0, 6.28))
        pieces.append(noise + amplitude * np.outer(wave, [0, 1, 0]))
    return pieces


def test_a_tone_is_found_and_taken_out():
    """Recovery: a tone ten times the noise density leaves no power behind, the other axes stay as they are."""
    rng = np.random.default_rng(6)
    pieces = quiet(rng, 3.0)
    cleaned, found = without_lines(pieces, 0.5)
    assert [axis for axis, _ in found] == [1]
    assert abs(found[0][1] - 0.187) < 5e-4
    wave = np.exp(-2j * np.pi * 0.187 * 0.5 * np.arange(360))
    left = np.mean([np.abs(wave @ c[:, 1]) ** 2 / 360 for c in cleaned])
    assert left < 3.0
    assert all(np.array_equal(c[:, [0, 2]], p[:, [0, 2]]) for c, p in zip(cleaned, pieces, strict=True))


def test_noise_without_lines_stays_as_it_is():
    """Recovery: ten draws of red noise; one line in ten thousand axes is allowed."""
    rng = np.random.default_rng(8)
    assert not any(without_lines(quiet(rng, 0.0), 0.5)[1] for _ in range(10))


def test_spectrum_is_the_sum_over_waves_of_each_frequency():
    """Reference: Fourier sums written out, with gaps and a segment longer than the period of the lowest frequency."""
    rng = np.random.default_rng(6)
    segments = [rng.standard_normal((n, 2)) for n in (300, 90, 170)]
    segments[1][[3, 40, 41], 1] = np.nan
    parts, step = 200, 0.25
    frequency = np.arange(3, 90) / (parts * step)
    assert_allclose(lines._spectrum(segments, 1, parts)[3:90], lines._power(segments, 1, frequency, step), rtol=1e-9)
