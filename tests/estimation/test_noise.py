"""Noise: fits, whitening, densities, lines and levels against independent evaluations."""

import functools
import itertools

import numpy as np
import pytest
import seeds
from numpy.testing import assert_allclose
from scipy import linalg, signal

from gravcal.estimation import noise as lines
from gravcal.estimation.least_squares import polynomial, project_out
from gravcal.estimation.noise import (
    NoiseModel,
    beside,
    changing_levels,
    coloured,
    draw,
    fit_detrended,
    fit_noise,
    fit_spectrum,
    from_density,
    in_common,
    levels,
    runs,
    spectra_beside,
    two_levels,
    unwhiten,
    whiten,
    without_lines,
    without_slow_lines,
    without_telegraph,
)

AR = np.array([1.2, -0.8, 0.3])  # x_t = sum_j AR_j x_(t-j) + e_t, stable
VARIANCE = 2.5e-20


def simulate(rng, count, coefficients=AR, variance=VARIANCE):
    """Samples (count,) of the process, started long before."""
    drive = rng.standard_normal(count + 2000) * np.sqrt(variance)
    return signal.lfilter([1.0], np.concatenate([[1.0], -coefficients]), drive)[2000:]


def autocovariance(count, coefficients=AR, variance=VARIANCE):
    """Autocovariance (count,) from the impulse response, summed until it has died out."""
    impulse = signal.lfilter([1.0], np.concatenate([[1.0], -coefficients]), np.eye(1, 6000)[0])
    return variance * np.array([impulse[: 6000 - k] @ impulse[k:] for k in range(count)])


def true_model(step=0.5):
    """NoiseModel of the process through its own autocovariance (Levinson's recursion written out with solves)."""
    c = autocovariance(AR.size + 1)
    reflection, variance = [], [c[0]]
    for k in range(1, AR.size + 1):
        row = np.linalg.solve(linalg.toeplitz(c[:k]), c[1 : k + 1])
        reflection.append(row[-1])
        variance.append(c[0] - row @ c[1 : k + 1])
    return NoiseModel(np.array(reflection), np.array(variance), step)


def test_prediction_rows_and_density_are_those_of_the_process():
    """Analytic: row k is the Yule-Walker solution of order k; density by direct sums, its integral the variance."""
    c, rows = autocovariance(AR.size + 1), true_model().coefficients
    for k in range(1, AR.size + 1):
        assert_allclose(rows[k, :k], np.linalg.solve(linalg.toeplitz(c[:k]), c[1 : k + 1]), rtol=1e-9)  # of solve
        assert_allclose(rows[k, k:], 0.0)
    assert_allclose(rows[-1], AR, rtol=1e-9)
    model, c = true_model(0.5), autocovariance(400)
    frequency = np.array([0.0, 0.01, 0.2, 0.77, 1.0])
    lags = np.arange(1, 400)
    direct = 2 * 0.5 * (c[0] + 2 * np.cos(2 * np.pi * np.outer(frequency, lags) * 0.5) @ c[1:])
    assert_allclose(model.density(frequency), direct, rtol=1e-6)  # lags cut at 400
    assert_allclose(np.mean(model.density((np.arange(20000) + 0.5) / 20000)), c[0], rtol=1e-6)


def test_every_run_of_valid_samples_is_whitened_by_itself_and_comes_back():
    """Analytic: from the first sample of a run on it is L^-1 x with L L^T the dense Toeplitz covariance.

    Rows that are not valid come back as zero, whatever they hold; a round trip with one sample alone between gaps.
    """
    valid = np.ones(80, dtype=bool)
    valid[[0, 20, 21, 22, 50, 79]] = False
    dense = linalg.toeplitz(autocovariance(80))
    columns = np.where(valid[:, None], np.eye(80), np.nan)
    found = whiten(true_model(), columns, valid)
    assert_allclose(found[~valid], 0.0)
    for begin, end in zip(*runs(valid), strict=True):
        block = found[begin:end, begin:end]
        assert_allclose(block @ dense[begin:end, begin:end] @ block.T, np.eye(end - begin), atol=1e-8)
        assert_allclose(np.delete(found[begin:end], np.arange(begin, end), axis=1)[:, valid[:1].size :], 0, atol=1e-12)
    noise = NoiseModel(np.array([0.7, -0.3, 0.2]), np.array([1.0, 0.5, 0.45, 0.43]), 1.0)
    columns = np.cumsum(np.random.default_rng(3).standard_normal((60, 2)), axis=0)
    valid = np.ones(60, dtype=bool)
    valid[[10, 12, 13]] = False
    back = unwhiten(noise, whiten(noise, columns, valid), valid)
    assert_allclose(back[valid], columns[valid], atol=1e-12)  # rounding
    assert np.isnan(back[~valid]).all()
    assert_allclose(unwhiten(noise, whiten(noise, columns[:, 0], valid), valid), back[:, 0])


def test_burgs_fit_finds_the_process_in_pieces():
    """Recovery: coefficients and innovation variance from 40 pieces of 360 samples, within five standard errors."""
    rng = seeds.generator("test_burgs_fit_finds_the_process_in_pieces", 3e-6)
    model = fit_noise([simulate(rng, 360) for _ in range(40)], 3, 0.5)
    count = 40 * 360
    error = np.sqrt(np.diag(np.linalg.inv(linalg.toeplitz(autocovariance(3)))) * VARIANCE / count)
    assert np.all(np.abs(model.coefficients[-1] - AR) < 5 * error)
    assert model.variance[-1] / VARIANCE == pytest.approx(1.0, abs=5 * np.sqrt(2 / count))


def test_pieces_are_not_joined_over_their_ends():
    """Recovery: pieces that differ by sign only at random give the same model as if they did not."""
    rng = np.random.default_rng(3)
    pieces = [simulate(rng, 200) for _ in range(20)]
    turned = [p * s for p, s in zip(pieces, rng.choice([-1, 1], 20), strict=True)]
    one, other = fit_noise(pieces, 5, 0.5), fit_noise(turned, 5, 0.5)
    assert_allclose(one.reflection, other.reflection, atol=1e-14)  # rounding
    assert_allclose(one.variance, other.variance, rtol=1e-12)


def test_removed_parameters_raise_the_variance_and_the_order_yields_to_short_data():
    """Recovery: with a straight line taken from each of 1000 pieces of 20 the variance is that of the noise.

    The order is at most a tenth of the samples, every reflection coefficient below one in magnitude.
    """
    rng = seeds.generator("test_removed_parameters_raise_the_variance", 1e-6)
    basis = np.linalg.qr(np.stack([np.ones(20), np.arange(20.0) - 9.5], axis=1))[0]
    pieces = [x - basis @ (basis.T @ x) for x in rng.standard_normal((1000, 20))]
    model = fit_noise(pieces, 0, 1.0, removed=2000)
    assert model.variance[0] == pytest.approx(1.0, abs=5 * np.sqrt(2 / (1000 * 18)))  # half of what was taken
    rng = np.random.default_rng(5)
    assert fit_noise([rng.standard_normal(45)], 20, 1.0).reflection.size == 4
    sine = np.sin(np.arange(400) / 7) + 1e-6 * rng.standard_normal(400)
    model = fit_noise([sine], 20, 1.0)
    assert np.all(np.abs(model.reflection) < 1)
    assert np.all(np.isfinite(model.density(np.linspace(0, 0.5, 100))))


def test_coloured_noise_has_the_density_asked_for():
    """Recovery: averaged periodograms in eight bands equal the density, five standard errors."""
    rng = seeds.generator("test_coloured_noise_has_the_density_asked_for", 5e-6)
    density = lambda f: 1e-18 * (1 + (0.5 / f)) * (1 + (f / 2) ** 2)  # noqa: E731
    frequency, power = signal.welch(coloured(density, 200_000, 0.1, rng), 10.0, nperseg=2000, noverlap=0, detrend=False)
    for low, high in itertools.pairwise(np.geomspace(0.1, 4.9, 9)):
        band = (frequency >= low) & (frequency < high)
        ratio = np.mean(power[band] / density(frequency[band]))
        assert ratio == pytest.approx(1.0, abs=5 / np.sqrt(100 * band.sum()) * 1.3 + 0.01)  # Hann, leakage


def test_a_spectrum_of_short_pieces_is_that_of_steep_noise():
    """Recovery: orbit noise that falls by 1e4 in power from 1 to 6 mHz beside polynomials: each knot within 5 sigma."""
    rng = seeds.generator("steep noise", 10 * 6e-7)
    knots = 1e-3 * np.array([0.5, 0.8, 1.2, 1.7, 2.3, 3, 4, 5.5, 7.5, 10, 20, 50, 100])
    density = lambda f: 1e-12 + (2e-4 * (1e-3 / f) ** 2 / (1 + (f / 3e-3) ** 4)) ** 2  # noqa: E731
    pieces = []
    for count in (1000, 240, 240, 240, 240, 240, 240, 240, 1000):
        values, time = coloured(density, count, 5.0, rng), 5.0 * np.arange(count)
        values[count // 2 : count // 2 + 4] = np.nan if count == 1000 else values[count // 2 : count // 2 + 4]
        pieces.append((values, polynomial(time, count // 48 + 1, 0.0, time[-1])))
    found = fit_spectrum(pieces, 5.0, knots)
    at = knots[3:]  # slower ones are taken by the polynomials
    error, sigma = np.log(found.density(at) / density(at)), np.log(found.density(at, 1.0) / found.density(at))
    assert np.abs(error / sigma).max() < 5
    assert sigma.max() < 0.4
    assert np.abs(error).max() < 1.0
    gappy = np.where(np.arange(400) % 2, rng.standard_normal(400), np.nan)  # no wave is left of it: a level alone
    assert_allclose(fit_spectrum([(gappy, np.ones((400, 1)))], 1.0, knots).log_density, np.log(2), atol=0.5)


#: Of three axes, white.
WHITE = [NoiseModel(np.zeros(0), np.ones(1), 1.0)] * 3


def test_levels_of_noise_that_changes_have_their_errors_and_others_none():
    """Recovery: parts 0.4 apart in log power, pieces 0.2: scatter as the error says; stationary noise: one level."""
    rng, off = np.random.default_rng(4), []
    part = np.repeat(np.arange(7), 2)
    for _ in range(60):
        common = rng.normal(0, 0.4, (7, 3))
        size = np.exp((common[part] + rng.normal(0, 0.2, (14, 3))) / 2)
        found = levels(WHITE, [rng.standard_normal((360, 3)) * one for one in size], [3] * 14, part, 7)
        error = np.log(found.value) - (common + rng.normal(0, 0.2, (7, 3))) / 2
        off.append((error - error.mean(axis=0)) / found.error / np.sqrt(6 / 7))
    assert 0.9 < np.std(off) < 1.1  # one standard error is 0.02
    found = [levels(WHITE, [rng.standard_normal((300, 3)) for _ in part], [3] * 14, part, 7) for _ in range(100)]
    assert sum(bool(np.any(one.error > 0)) for one in found) <= 5  # chance of one percent each, binomial tail 5e-4


def test_a_level_that_changes_along_a_record_is_followed_and_a_burst_is_not():
    """Recovery: error over sigma of 40 records is 0.9 to 1.1 (one standard error 0.03); a burst stays one."""
    rng, along, off = np.random.default_rng(6), np.linspace(-1, 1, 5500)[:, None], []
    for _ in range(40):
        truth = np.exp(0.3 * rng.standard_normal() + 0.2 * along * rng.choice([-1, 1], 3) + 0.1 * along**2)
        found = changing_levels(rng.standard_normal((5500, 3)) * truth, 100)
        ratio = np.log(found.value / truth * np.sqrt(np.mean(truth**2, axis=0)))
        off.append(ratio[::500] / found.error[::500])
    assert 0.85 < np.std(off) < 1.15
    still = rng.standard_normal((5500, 3))
    assert np.all(changing_levels(still, 100).value == 1)
    still[4000:4200, 0] *= 3
    assert np.all(changing_levels(still, 100).value == 1)


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
    """Recovery: a tone ten times the noise density leaves no power behind; other axes and clean draws stay so."""
    rng = np.random.default_rng(6)
    pieces = quiet(rng, 3.0)
    cleaned, found = without_lines(pieces, 0.5)
    assert [axis for axis, _ in found] == [1]
    assert abs(found[0][1] - 0.187) < 5e-4
    wave = np.exp(-2j * np.pi * 0.187 * 0.5 * np.arange(360))
    assert np.mean([np.abs(wave @ c[:, 1]) ** 2 / 360 for c in cleaned]) < 3.0
    assert all(np.array_equal(c[:, [0, 2]], p[:, [0, 2]]) for c, p in zip(cleaned, pieces, strict=True))
    assert not any(without_lines(quiet(rng, 0.0), 0.5)[1] for _ in range(10))  # one in ten thousand axes is allowed


def test_spectrum_is_the_sum_over_waves_of_each_frequency():
    """Reference: Fourier sums written out, with gaps and a segment longer than the period of the lowest frequency."""
    rng = np.random.default_rng(6)
    segments = [rng.standard_normal((n, 2)) for n in (300, 90, 170)]
    segments[1][[3, 40, 41], 1] = np.nan
    parts, expected = 200, 0.0
    for values in (one[:, 1] for one in segments):
        index = np.flatnonzero(np.isfinite(values))
        window = np.hanning(index.size + 2)[1:-1]
        left = window * (values[index] - np.polynomial.Polynomial.fit(index, values[index], 2)(index))
        waves = np.exp(-2j * np.pi * np.outer(np.arange(3, 90) / parts, index))
        expected += np.abs(waves @ left) ** 2 / np.sum(window**2) / len(segments)
    assert_allclose(lines._spectrum(segments, 1, parts)[3:90], expected, rtol=1e-9)


RED = NoiseModel(np.array([0.9, -0.2]), np.array([1.0, 0.19, 0.19 * 0.96]), 1.0)


def test_a_spectrum_comes_back_from_its_autocovariance_and_from_drawn_noise():
    """Analytic: the model of an autoregressive spectrum is itself; a draw is stationary from the first sample on."""
    rng, frequency = np.random.default_rng(4), (np.arange(4096) + 0.5) / 8192
    again = from_density(RED.density(frequency), 2, 1.0)
    assert_allclose(again.reflection, RED.reflection, atol=1e-9)
    assert_allclose(again.variance[-1] / again.variance[0], RED.variance[-1] / RED.variance[0], rtol=1e-9)
    expected = np.mean(RED.density(frequency)) / 2
    drawn = np.stack([draw(RED, 50, rng) for _ in range(4000)])
    assert_allclose(np.mean(drawn[:, 0] ** 2), expected, rtol=0.12)
    assert_allclose(np.mean(drawn**2), expected, rtol=0.05)


def test_what_a_fit_takes_is_put_back_and_what_may_be_there_is_no_noise():
    """Recovery: slow power of red noise after a cubic fit of 90 samples, short by 20 % in the plain fit.

    Slow waves a thousand times the noise in one run with a gap: the spectrum below them as without. Of a quiet axis
    beside loud ones, where columns on all take most of the slow end, it comes back with its error, larger there. A fit
    that takes nothing gives the plain model, whatever noise was simulated.
    """
    rng = np.random.default_rng(7)
    cleaned = lambda segment, _: project_out(polynomial(np.arange(90.0), 3, 0, 89), segment)  # noqa: E731
    segments = [np.stack([draw(RED, 90, rng) for _ in range(3)], axis=1) for _ in range(60)]
    models = fit_detrended(segments, cleaned, 3, 1.0)
    slow = np.linspace(0.002, 0.02, 10)
    assert 0.85 < np.mean([m.density(slow) / RED.density(slow) for m in models]) < 1.15
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
    assert 0.75 < np.mean([m.density(slow) / RED.density(slow) for m in found]) < 1.3
    off, slow = [], np.stack([f(2 * np.pi * k * np.arange(600) / 600) for k in range(1, 7) for f in (np.cos, np.sin)])
    for rng in map(np.random.default_rng, range(8)):
        columns = np.einsum("qn,qar->naqr", slow, rng.standard_normal((12, 3, 2)) + 1).reshape(600, 3, 24)
        spectra, *_ = spectra_beside(rng.standard_normal((600, 3)) * [1, 10, 10], columns, 8, 1.0)
        sigma = np.sqrt([np.diag(one.covariance) for one in spectra])
        off.append(([one.log_density for one in spectra] - np.log([[2], [200], [200]])) / sigma)
        assert np.all(sigma[:, 0] > 1.5 * sigma[:, 6])
    assert np.abs(np.mean(off, axis=0)[:, :5]).max() < 0.8
    assert 0.7 < np.sqrt(np.mean(np.square(off))) < 1.1
    segments = [np.random.default_rng(k).standard_normal((320, 2)) for k in range(5)]
    frequency = np.linspace(0.01, 0.49, 30)
    for axis, model in enumerate(fit_detrended(segments, lambda segment, _: segment, 6, 1.0)):
        plain = fit_noise([s[:, axis] for s in segments], 6, 1.0)
        assert_allclose(model.density(frequency), plain.density(frequency), rtol=1e-6)


def test_a_slow_line_and_jumps_between_two_levels_are_no_noise_and_red_noise_is_neither():
    """Recovery: a wave of 300 samples in pieces of 400, and levels that last 17; white noise beside them is left."""
    rng, count = np.random.default_rng(3), np.arange(400)[:, None]
    slow = [np.polynomial.legendre.legvander(np.linspace(-1, 1, 400), 3)] * 2
    white, flips = rng.standard_normal((2, 400, 1)), np.where(rng.random((2, 400, 1)) < 0.06, -1, 1)
    density = 4 / (1 + (np.arange(1024) / 80) ** 2) + 1
    red = [draw(from_density(density, 2, 1.0), 400, rng)[:, None] for _ in range(2)]
    waves = [one + 3 * np.sin(2 * np.pi * (count - first) / 300) for one, first in zip(white, (100, 350), strict=True)]
    for made, loud, jumps in ((white, 0, 0), (red, 0, 0), (waves, 1, 0), (white + 2 * np.cumprod(flips, axis=1), 0, 1)):
        pieces = [project_out(c, one) for c, one in zip(slow, made, strict=True)]
        for left, expected in ((without_slow_lines(pieces, 3, 1.0), loud), (without_telegraph(pieces, slow), jumps)):
            assert (np.var(left) < 0.7 * np.var(pieces)) == expected
            assert not expected or np.var(left) == pytest.approx(1.0, abs=0.15)


def test_noise_beside_many_slow_columns_has_no_levels():
    """Recovery: of ten series none beside 60 columns of 200 samples, which bend to levels if every sample counts."""
    for rng in map(np.random.default_rng, range(10)):
        columns = np.linalg.qr(rng.standard_normal((200, 60)))[0]
        assert two_levels([rng.standard_normal(200)], [columns])[2] < 0


@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_an_error_that_two_axes_share_is_taken_out_of_the_weaker_one_and_comes_back(rate):
    """Recovery: an error of a rate in x and its derivative in z, beside white noise; next to none of independent axes.

    The cross spectrum falls below 0.4 of itself on average, and what was taken out comes back exactly.
    """
    rng, count, left = np.random.default_rng(11), [], []
    for _ in range(20):
        error, series = signal.lfilter([1.0], [1.0, -0.9], rng.standard_normal(641)), rng.standard_normal((640, 3))
        series += rate * np.stack([error[1:], 0 * error[1:], 4 * np.diff(error)], axis=1)
        found = in_common(series, [fit_noise([one], 8, 1.0) for one in series.T])
        clean = functools.reduce(lambda values, one: one.taken_out(values), found, series)
        again = functools.reduce(lambda values, one: one.taken_out(values, 1.0), reversed(found), clean)
        assert_allclose(again, series, atol=1e-12)
        crossed = [abs(signal.csd(v[:, 0], v[:, 2], nperseg=64)[1][1:16]).sum() for v in (series, clean)]
        count, left = [*count, len(found)], [*left, crossed[1] / crossed[0]]
    assert min(count) >= 1 and np.mean(left) < 0.4 if rate else sum(count) <= 1
