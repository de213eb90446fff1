"""Coloured noise as measured: autoregressive models from quiet data, whitening, spectra, levels that change."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy import fft
from scipy.fft import next_fast_len
from scipy.ndimage import correlate1d, maximum_filter1d, median_filter
from scipy.optimize import nnls
from scipy.signal import lfilter
from scipy.special import chdtrc

from gravcal.estimation.least_squares import orthonormal, polynomial, project_out


@dataclass(frozen=True)
class NoiseModel:
    """Autoregressive noise of evenly spaced samples."""

    reflection: np.ndarray  #: (p,) 1, reflection coefficients, each of magnitude below one
    variance: np.ndarray  #: (p + 1,) squared unit, prediction-error variance of the orders 0..p
    step_s: float  #: s, spacing of the samples

    @functools.cached_property
    def coefficients(self) -> np.ndarray:
        """(p + 1, p) prediction coefficients: row k predicts from k previous samples, most recent first."""
        reflection, order = self.reflection, len(self.reflection)
        rows = np.zeros((order + 1, order))
        for k in range(1, order + 1):
            rows[k, : k - 1] = rows[k - 1, : k - 1] - reflection[k - 1] * rows[k - 1, : k - 1][::-1]
            rows[k, k - 1] = reflection[k - 1]
        return rows

    def louder(self, level: float) -> "NoiseModel":
        """The model with `level` times the amplitude."""
        return replace(self, variance=self.variance * level**2)

    def density(self, frequency_hz: np.ndarray) -> np.ndarray:
        """One-sided power spectral density (m,), squared unit per Hz, at frequencies (m,) Hz."""
        last = self.coefficients[-1]
        lags = np.arange(1, last.size + 1)
        transfer = 1 - np.exp(-2j * np.pi * np.outer(frequency_hz, lags) * self.step_s) @ last
        return 2 * self.step_s * self.variance[-1] / np.abs(transfer) ** 2


def _burg(values, begin, end, order):
    """Burg's reflection coefficients (p,), prediction-error variances (p + 1,) of runs begin to end in values (n,).

    Pairs (t, t - 1) that no run holds are zero: the first k + 1 of a run at order k.
    """
    ahead, behind = values.copy(), np.concatenate([values[:1], values[:-1]])  # forward, backward errors
    reflection, variance = np.zeros(order), np.full(order + 1, ahead @ ahead / values.size if values.size else np.nan)
    for k in range(order):
        ahead[(begin + k)[begin + k < end]] = behind[begin] = 0.0
        power = ahead @ ahead + behind @ behind
        reflection[k] = 2 * (ahead @ behind) / power if power > 0 else 0.0
        updated = behind - reflection[k] * ahead
        ahead -= reflection[k] * behind
        behind[1:] = updated[:-1]
        variance[k + 1] = variance[k] * (1 - reflection[k] ** 2)
    return reflection, variance


def runs(valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First index and one past the last index of every run of valid samples (n,) bool."""
    padded = np.concatenate([[False], np.asarray(valid, dtype=bool), [False]]).astype(np.int8)
    change = np.diff(padded)
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def fit_noise(segments: list[np.ndarray], order: int, step_s: float, removed: int = 0) -> NoiseModel:
    """Autoregressive model of quiet segments by Burg's recursion over all of them together.

    Parameters
    ----------
    segments : list of (n_i,) any unit, evenly spaced, NaN where missing, slow part already removed
    order : highest order; lowered to a tenth of the samples
    step_s : s
    removed : parameters that detrending took from the samples; the variance is scaled by n/(n - removed)
    """
    values = np.concatenate([np.append(segment, np.nan) for segment in segments]).astype(float)
    valid = np.isfinite(values)
    begin, end = runs(valid)
    last = np.cumsum(end - begin)
    count = int(last[-1]) if last.size else 0
    order = max(min(order, count // 10), 0)
    reflection, variance = _burg(values[valid], last - (end - begin), last, order)
    return NoiseModel(reflection, variance * count / max(count - removed, 1), step_s)


def whiten(noise: NoiseModel, columns: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Whitened columns: noise of the model has unit variance and no correlation in them.

    Exact for a stationary autoregressive process: the first samples of every run are predicted by the lower orders.
    Columns (n,) or (n, m) have the unit of the noise; rows that are not valid (n,) come back as zero, without weight.
    """
    flat = np.nan_to_num(np.asarray(columns, dtype=float).reshape(len(columns), -1), posinf=np.inf, neginf=-np.inf)
    out = np.zeros(flat.shape)
    if flat.any():
        _run_by_run(noise.coefficients, np.sqrt(noise.variance), flat, np.asarray(valid, dtype=bool), out, back=False)
    return out.reshape(columns.shape)


def whitened(noise: Sequence[NoiseModel], values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Whitened rows (3 n, q), axis after axis, of values (n, 3, q) with a noise model for each axis."""
    return np.concatenate([whiten(model, np.ascontiguousarray(values[:, a]), valid) for a, model in enumerate(noise)])


def unwhiten(noise: NoiseModel, rows: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Columns (n,) or (n, m) from their whitened rows, NaN where not valid: the inverse of `whiten`."""
    flat = np.ascontiguousarray(rows, dtype=float).reshape(len(rows), -1)
    out = np.full(flat.shape, np.nan)
    _run_by_run(noise.coefficients, np.sqrt(noise.variance), flat, np.asarray(valid, dtype=bool), out, back=True)
    return out.reshape(rows.shape)


@njit(cache=True)
def _run_by_run(coefficients, sigma, columns, valid, out, back):
    """Write innovations of columns (n, m) over sigma (p + 1,), or their inverse if back, to out, run by run."""
    age = -1
    for t in range(len(columns)):
        age = age + 1 if valid[t] else -1
        if age >= 0:
            order = min(age, len(sigma) - 1)
            out[t] = columns[t] * (sigma[order] if back else 1.0)
            for k in range(order):
                previous = out[t - 1 - k] if back else columns[t - 1 - k]
                for j in range(columns.shape[1]):
                    out[t, j] += coefficients[order, k] * previous[j] * (1.0 if back else -1.0)
            if not back:
                out[t] /= sigma[order]


def coloured(density, count: int, step_s: float, rng: np.random.Generator) -> np.ndarray:
    """Gaussian noise (count,) of a given one-sided density, evenly spaced.

    The density is a callable, (m,) Hz -> (m,) squared unit per Hz.
    """
    length = fft.next_fast_len(count + int(200 / step_s), real=True)  # the wrap of the circle is cut off
    frequency = fft.rfftfreq(length, step_s)
    amplitude = np.zeros(frequency.size)
    amplitude[1:] = np.sqrt(density(frequency[1:]) * length / (2 * step_s) / 2)
    spectrum = amplitude * (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size))
    return fft.irfft(spectrum, length)[:count]


def filtered(values: np.ndarray, step_s: float, gain: Callable) -> np.ndarray:
    """Evenly spaced series (n, ...) times a gain, callable (m,) Hz -> (m,), mirrored at the end; zero phase."""
    count = len(values)
    spectrum = np.fft.rfft(np.concatenate([values, values[::-1]]), axis=0)
    factor = np.asarray(gain(np.fft.rfftfreq(2 * count, step_s)), dtype=float)
    return np.fft.irfft(spectrum * factor.reshape(-1, *[1] * (values.ndim - 1)), 2 * count, axis=0)[:count]


def in_bands(values: np.ndarray, step_s: float, edges_hz) -> np.ndarray:
    """Band-passed parts (n, b) of an even series (n,) between b + 1 edges; the last one has all above as well."""
    pairs = zip(edges_hz, (*edges_hz[1:-1], np.inf), strict=False)
    return np.stack([filtered(values, step_s, lambda f, a=a, b=b: (f >= a) & (f < b)) for a, b in pairs], axis=1)


TAPERS = 3  # sine tapers, at frequencies as many bins apart: as many ordinates as samples
LEFT = 0.5  # least share of a tapered wave that the columns must leave for it to be used
BEND, STEADY = 3.0, 2.0  # prior sigma of the change of log-log slope at a knot, of many pieces and of one series
KNOTS, REWEIGHTED = 17, 4  # of the spectra of one series, rounds of reweighting
SCORINGS = 60  # Fisher scoring steps at most


@dataclass(frozen=True)
class Spectrum:
    """Density of noise, log density linear between knots over the log of the frequency, constant beyond them."""

    knot_hz: np.ndarray  #: (k,) Hz
    log_density: np.ndarray  #: (k,) natural logarithm of the one-sided density, squared unit per Hz
    covariance: np.ndarray | None = None  #: (k, k) of these, None of a guess

    def density(self, frequency_hz: np.ndarray, sigmas: float = 0.0) -> np.ndarray:
        """One-sided density (m,), squared unit per Hz, at frequencies (m,) Hz, `sigmas` standard deviations above."""
        shares = self.shares(frequency_hz)
        sigma = np.sqrt(np.einsum("mk,kl,ml->m", shares, self.covariance, shares)) if sigmas else 0.0
        return np.exp(shares @ self.log_density + sigmas * sigma)

    def model(self, order: int, step_s: float) -> NoiseModel:
        """Autoregressive model of an order for samples step_s s apart."""
        return from_density(self.density((np.arange(NODES) + 0.5) / (2 * step_s * NODES)), order, step_s)

    def shares(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Interpolation weights (m, k) of the knots in the log density at frequencies (m,) Hz."""
        return log_linear(self.knot_hz, frequency_hz)


def log_linear(knot_hz: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
    """Interpolation weights (m, k) of knots (k,) Hz at frequencies (m,) Hz: linear in log f, constant beyond them."""
    at = np.log(np.clip(frequency_hz, knot_hz[0], knot_hz[-1]))
    return np.stack([np.interp(at, np.log(knot_hz), row) for row in np.eye(len(knot_hz))], axis=-1)


def fit_spectrum(pieces: Sequence[tuple], step_s: float, knot_hz: np.ndarray, bend: float = BEND) -> Spectrum:
    """Density of noise from all quiet pieces, long or short, with gaps, columns of any amplitude in them also fitted.

    Pieces are (n_i,) even values, NaN where missing, and (n_i, q_i) columns; knots (k,) Hz; the response of each wave
    is known at `NODES` parts of the band up to Nyquist, as many as a piece has samples.

    Notes
    -----
    Waves under sine tapers (Riedel and Sidorenko, IEEE Trans. Signal Process. 43, 1995) are made orthogonal to the
    columns. The square q of the product of one with the values is exponential about m, the integral of S abs(B)^2,
    whatever the columns took from it: Fisher scoring of -sum(log m + q / m), with a weak prior on the bends of log S.
    """
    knots, frequency = np.asarray(knot_hz, dtype=float), np.linspace(0, 0.5 / step_s, NODES + 1)
    rows = zip(*(_waves(*group, step_s) for group in _alike(pieces)), strict=True)
    square, response, times = (np.concatenate(one) for one in rows)
    if not square.size:  # pieces that are short, or have more gaps than samples, tell a level alone
        residual = np.concatenate([project_out(c[g], y[g]) for y, c, g in ((y, c, np.isfinite(y)) for y, c in pieces)])
        free = max(residual.size - sum(c.shape[1] for _, c in pieces), 1)
        level = np.full(knots.size, np.log(max(2 * step_s * (residual @ residual) / free, 1e-300)))
        return Spectrum(knots, level, np.full((knots.size, knots.size), 2 / free))
    integral, log_knots = response.sum(axis=1), np.log(knots)
    centre, raw = np.log(response @ frequency / integral), square / times / integral
    nearest = [np.argsort(np.abs(centre - one))[: 5 * TAPERS] for one in log_knots]
    value = np.log([max(np.median(raw[one]), 1e-300) for one in nearest])
    return _scored(Spectrum(knots, value), frequency, (square, times, response), bend)


def _scored(start, frequency, waves, bend):
    """Spectrum by Fisher scoring of waves: squares (m,) of `times` (m,) pieces, responses (m, f); bend: prior sigma."""
    square, times, response = waves
    knots, value, shares = start.knot_hz, start.log_density, start.shares(frequency)
    bends = np.diff(np.diff(np.eye(knots.size), axis=0) / np.diff(np.log(knots))[:, None], axis=0)
    prior = bends.T @ bends / bend**2 + 1e-9 * np.eye(knots.size)

    def loss(value):  # negative log posterior of the log densities (k,)
        mean = response @ np.exp(shares @ value)
        return np.sum(times * np.log(mean) + square / mean) + value @ prior @ value / 2

    best = loss(value)
    for _ in range(SCORINGS):
        density = np.exp(shares @ value)
        mean = response @ density
        jacobian = (response * density) @ shares / mean[:, None]
        information = (jacobian.T * times) @ jacobian + prior
        step = np.linalg.solve(information, jacobian.T @ (square / mean - times) - prior @ value)
        step *= min(1.0, 2 / np.abs(step).max())
        while (new := loss(value + step)) > best + 1e-9 and np.abs(step).max() > 1e-6:
            step = step / 2
        value, gained, best = value + step, best - new, new
        if gained < 1e-3:
            break
    return Spectrum(knots, value, np.linalg.inv(information))


def spectra_beside(series: np.ndarray, columns: np.ndarray, order: int, step_s: float) -> tuple:
    """Spectrum and NoiseModel of each axis of a series, columns also fitted, and its whitened residual (n, 3).

    Series (n, 3) are even, NaN where missing; columns (n, 3, q) are fitted to all axes together.

    Notes
    -----
    Restricted maximum likelihood: series and columns are whitened by the spectra found before, so that a loud axis
    leaves nothing in a quiet one, and the square of a wave is compared with the share of it that the columns leave.
    Where that is little, the error of the spectrum is large.
    """
    good, count = np.isfinite(series).all(axis=1), len(series)
    knots, wave = np.geomspace(4 / (count * step_s), 0.5 / step_s, KNOTS), np.fft.rfftfreq(count, step_s)[1:]
    white_density = np.nanvar(beside([series], [columns])(series, 0), axis=0) * 2 * step_s
    spectra = [Spectrum(knots, np.full(KNOTS, np.log(max(one, 1e-300)))) for one in white_density]
    for _ in range(REWEIGHTED):
        models = [one.model(order, step_s) for one in spectra]
        rows = whitened(models, np.concatenate([columns, series[:, :, None]], axis=2), good)
        basis = orthonormal(rows[:, :-1], DEPENDENT)
        residual = (rows[:, -1] - basis @ (basis.T @ rows[:, -1])).reshape(3, count)
        parts = residual, basis.reshape(3, count, -1)
        square, leverage = (np.abs(np.fft.rfft(one, axis=1)[:, 1:]) ** 2 / count for one in parts)
        times = np.maximum(good.mean() - leverage.sum(axis=2), 0.0)
        response = [np.diag(1 / model.density(wave)) for model in models]
        axes = zip(spectra, zip(square, times, response, strict=True), strict=True)
        spectra = [_scored(one, wave, waves, STEADY) for one, waves in axes]
    return spectra, models, residual.T


def _alike(pieces):
    """[(values (g, n), columns (n, q))] of pieces, those without gaps and with equal columns together."""
    groups: list[tuple[list, np.ndarray]] = []
    for values, columns in pieces:
        for group, group_columns in groups:
            complete = np.isfinite([values, group[0]]).all() if group[0].shape == values.shape else False
            if complete and group_columns.shape == columns.shape and np.allclose(group_columns, columns):
                group.append(values)
                break
        else:
            groups.append(([values], columns))
    return [(np.array(values), columns) for values, columns in groups]


def _waves(values, columns, step_s):
    """Sine-multitaper ordinates of pieces (g, n) less columns: power (m,), its response (m, NODES + 1), g (m,).

    Power is that of all pieces together; the response, of one piece, is that to the density at each node.
    """
    good, count = np.isfinite(values[0]), values.shape[1]
    index, order = np.arange(count), np.arange(1, TAPERS + 1)
    tapers = np.sqrt(2 / (count + 1)) * np.sin(np.pi * np.outer(order, index + 1) / (count + 1))
    carriers = np.exp(-2j * np.pi * np.outer(np.arange(TAPERS, count // 2, TAPERS) / count, index))
    waves = (tapers[:, None] * carriers).reshape(-1, count) * good
    basis = orthonormal(columns[good])
    waves[:, good] -= (waves[:, good] @ basis) @ basis.T
    waves = waves[np.sum(np.abs(waves) ** 2, axis=1) > LEFT]
    square = np.sum(np.abs(waves[:, good] @ values[:, good].T) ** 2, axis=1)
    power = np.abs(np.fft.fft(waves, 2 * NODES, axis=1)) ** 2
    power = (power[:, : NODES + 1] + power[:, -np.arange(NODES + 1)]) / 2
    power[:, [0, -1]] /= 2
    return square, power * (0.5 / step_s / NODES), np.full(square.size, len(values))


@dataclass(frozen=True)
class Levels:
    """Amplitude of the noise in parts of a record over that of one model for all of them."""

    value: np.ndarray  #: (g, a) 1, of each part and axis
    error: np.ndarray  #: (g, a) 1, relative error for data of the part that were not used


STATIONARY = 1e-2  # probability of so much scatter of the powers of quiet pieces, from which on they have one level


def levels(
    models: list[NoiseModel], pieces: list[np.ndarray], lost: list[float], part: np.ndarray, parts: int
) -> Levels:
    """Levels of noise that is not stationary, from quiet pieces in or near each part.

    One everywhere unless the powers of the pieces deny one level, see `STATIONARY`. Pieces (n_i, a) are detrended, NaN
    where missing, which took `lost` parameters from each axis of each; `part` (k,) is the part that each belongs to, of
    so many parts; one without pieces has the level of all.

    Notes
    -----
    The logarithm of the power of a piece of n samples is off by sqrt(2 / n). What it scatters more is the sum of
    what a part has in common and of what changes from piece to piece (DerSimonian and Laird, Control. Clin. Trials 7,
    1986, for both), the same variance on all axes; levels are drawn towards their mean accordingly.
    """
    axes, valid = len(models), [np.isfinite(one).all(axis=1) for one in pieces]
    count = np.array([max(np.sum(v) - gone, 1) for v, gone in zip(valid, lost, strict=True)], dtype=float)
    white = [[whiten(m, one[:, a], v) for a, m in enumerate(models)] for one, v in zip(pieces, valid, strict=True)]
    power = np.array([np.sum(np.square(one), axis=1) for one in white]) / count[:, None]
    log_power, sampling = np.log(np.maximum(power, 1e-300)) + 1 / count[:, None], 2 / count
    mean = np.sum(log_power / sampling[:, None], axis=0) / np.sum(1 / sampling)
    scatter = np.sum((log_power - mean) ** 2 / sampling[:, None])
    if np.any(power <= 0) or not chdtrc(axes * (len(pieces) - 1), scatter) <= STATIONARY:  # one piece denies nothing
        return Levels(np.ones((parts, axes)), np.zeros((parts, axes)))
    member = (part == np.arange(parts)[:, None]).astype(float)
    within = _scatter(log_power, sampling, member, axes)
    share = member / (sampling + within)
    precision = share.sum(axis=1)
    part_mean = share @ log_power / np.maximum(precision, 1e-300)[:, None]
    measured = precision > 0
    between = _scatter(part_mean[measured], 1 / precision[measured], np.ones((1, int(measured.sum()))), axes)
    variance = 1 / np.maximum(precision, 1e-300)
    weight = np.where(measured, 1 / (variance + between), 0.0)
    mean = weight @ part_mean / weight.sum()
    shrinkage = between / (between + variance)
    power = np.exp(mean + shrinkage[:, None] * (part_mean - mean))
    weight = np.where(measured, member @ count, 0.0)
    error = np.sqrt(between * (1 - shrinkage) + within) / 2
    return Levels(np.sqrt(power * weight.sum() / (weight @ power)), np.repeat(error[:, None], axes, axis=1))


STRETCHES = 24  # of a record, whose powers say how its noise changes along it


def changing_levels(white: np.ndarray, lost: float) -> Levels:
    """Levels of noise whose amplitude changes slowly along a record, from what a fit leaves of the record itself.

    One everywhere unless the powers of its stretches deny it, see `STATIONARY`. A level of each stretch by itself would
    take a burst for noise; what is left of a polynomial says how far its errors are to be trusted. White (n, a) is
    whitened by the models of the axes, evenly spaced, NaN where missing; the fit took `lost` parameters from each axis;
    the logarithm of the amplitude follows a parabola. Each sample is a part of the levels.
    """
    parts, degree = np.array_split(np.arange(len(white)), min(STRETCHES, len(white) // 16)), 2
    count = np.array([np.isfinite(white[part]).all(axis=1).sum() for part in parts]) * (1 - lost / max(len(white), 1))
    parts = [part for part, number in zip(parts, count, strict=True) if number > 8]
    count = count[count > 8]
    along = np.polynomial.legendre.legvander(np.linspace(-1, 1, len(white)), degree)
    plain = Levels(np.ones(white.shape), np.zeros(white.shape))
    if len(parts) < 2 * degree + 2:
        return plain
    power = np.array([np.nansum(white[part] ** 2, axis=0) for part in parts]) / count[:, None]
    if np.any(power <= 0):
        return plain
    log_power, root = np.log(power) + 1 / count[:, None], np.sqrt(count / 2)[:, None]
    design = root * np.array([along[part].mean(axis=0) for part in parts])
    coefficients = np.linalg.lstsq(design, root * log_power, rcond=None)[0]
    misfit = np.sum((root * log_power - design @ coefficients) ** 2)
    mean = np.sum(root**2 * log_power, axis=0) / np.sum(root**2)
    axes, freedom = white.shape[1], len(parts) - degree - 1
    scatter = max(misfit / (axes * freedom), 1.0)
    if not chdtrc(axes * degree, (np.sum((root * (log_power - mean)) ** 2) - misfit) / scatter) <= STATIONARY:
        return plain
    amplitude = np.exp(along @ coefficients / 2)
    spread = scatter * np.linalg.inv(design.T @ design)
    centred = along - along.mean(axis=0)  # the level of all is that of the models
    error = np.sqrt(np.einsum("nk,kl,nl->n", centred, spread, centred)) / 2
    return Levels(amplitude / np.sqrt(np.mean(amplitude**2, axis=0)), np.repeat(error[:, None], axes, axis=1))


def _scatter(value, variance, member, axes):
    """DerSimonian-Laird variance of values (k, a) about group means beyond variance (k,); member (g, k) is 0 or 1."""
    weight = member / variance
    total = np.maximum(weight.sum(axis=1), 1e-300)
    mean = (weight @ value) / total[:, None]
    excess = np.sum(weight @ value**2) - np.sum(total[:, None] * mean**2)
    excess -= axes * (member.sum() - np.sum(member.any(axis=1)))
    denominator = axes * np.sum(total - np.sum(weight**2, axis=1) / total)
    return max(float(excess / denominator), 0.0) if denominator > 1e-6 * total.sum() else 0.0


PIECES = 150  # of simulated noise
ROUNDS = 2  # of the correction for the fit
DEPENDENT = 1e-5  # of the largest singular value, below which a direction of columns is dropped
NODES = 1024  # parts of the band from 0 to Nyquist


def fit_detrended(segments: list[np.ndarray], clean: Callable, order: int, step_s: float) -> list[NoiseModel]:
    """Autoregressive model of each axis of segments (n_i, 3), even, NaN where missing, from what a fit leaves.

    `clean` (segment, index) -> residual of the fit, linear; what it takes of the density is simulated and restored.
    """
    rng = np.random.default_rng(0)
    axes = range(segments[0].shape[1])
    residual = [clean(s, i) for i, s in enumerate(segments)]
    detrended = [fit_noise([r[:, a] for r in residual], order, step_s) for a in axes]
    frequency = (np.arange(NODES) + 0.5) / (2 * step_s * NODES)
    fitted = [m.density(frequency) for m in detrended]
    density = list(fitted)
    for _ in range(ROUNDS):
        models = [from_density(d, order, step_s) for d in density]
        density = [w / k for w, k in zip(fitted, _kept(models, segments, clean, rng, frequency), strict=True)]
    return [from_density(d, order, step_s) for d in density]


def beside(segments: list[np.ndarray], columns: list[np.ndarray]) -> Callable:
    """Function (segment, index) -> segment less the best fit of its columns: ``clean`` of `fit_detrended`.

    Segments (n_i, 3) are evenly spaced, NaN where missing; columns (n_i, 3, q_i), finite, are fitted to all axes
    together.
    """
    good = [np.isfinite(one).all(axis=1) for one in segments]
    parts = zip(columns, good, strict=True)
    bases = [orthonormal(one[valid].reshape(-1, one.shape[2]), DEPENDENT) for one, valid in parts]

    def clean(segment, index):  # residual (n, 3) of a segment (n, 3) by its index
        flat = segment[good[index]].ravel()
        cleaned = np.full_like(segment, np.nan)
        cleaned[good[index]] = (flat - bases[index] @ (bases[index].T @ flat)).reshape(-1, 3)
        return cleaned

    return clean


def _kept(models, segments, clean, rng, frequency):
    """Ratio (m,) of the density after clean to that before, of each model, at frequency (m,) Hz, by the same draws."""
    before, after = [], []
    lengths = [len(s) for s in segments]
    times = -(-PIECES // len(segments))
    counts = [n + _led_in(m) for n in lengths for m in models]
    white = np.split(rng.standard_normal((times, sum(counts))), np.cumsum(counts)[:-1], axis=1)
    made = [_filtered(models[k % len(models)], one, lengths[k // len(models)]) for k, one in enumerate(white)]
    by_segment = [np.stack(made[k : k + len(models)], axis=2) for k in range(0, len(made), len(models))]
    for made in zip(*by_segment, strict=True):
        for i, (segment, noise) in enumerate(zip(segments, made, strict=True)):
            before.append(np.where(np.isfinite(segment), noise, np.nan))
            after.append(clean(before[-1], i))
    order, step = models[0].reflection.size, models[0].step_s
    density = lambda made, a: fit_noise([m[:, a] for m in made], order, step).density(frequency)  # noqa: E731
    return [density(after, a) / density(before, a) for a in range(len(models))]


def draw(model: NoiseModel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary noise of a model, (count,) in its unit."""
    return _filtered(model, rng.standard_normal(count + _led_in(model)), count)


def _led_in(model):
    """Number of samples after which a model's filter has forgotten its start."""
    return 60 * (model.reflection.size + 1)


def _filtered(model, white, count):
    """Last samples (..., count) of unit white noise through the model's autoregressive filter, along the last axis."""
    last = model.coefficients[-1]
    return lfilter([1.0], np.concatenate([[1.0], -last]), np.sqrt(model.variance[-1]) * white)[..., -count:]


def from_density(density: np.ndarray, order: int, step_s: float) -> NoiseModel:
    """Autoregressive model with the autocovariance of a spectrum up to its order (Levinson).

    Density (m,) is one-sided, squared unit per Hz, at the middles of m equal parts of 0 to the Nyquist frequency.
    """
    phase = np.pi * (np.arange(density.size) + 0.5) / density.size
    autocovariance = np.cos(np.outer(np.arange(order + 1), phase)) @ density / (2 * step_s * density.size)
    row, variance, reflection = np.zeros(0), [autocovariance[0]], []
    for k in range(1, order + 1):
        partial = (autocovariance[k] - row @ autocovariance[k - 1 : 0 : -1]) / variance[-1]
        row = np.append(row - partial * row[::-1], partial)
        reflection.append(partial)
        variance.append(variance[-1] * (1 - partial**2))
    return NoiseModel(np.array(reflection), np.array(variance), step_s)


BACKGROUND, FINE = 31, 20  # frequencies over which the background is the median; parts between them for a line
LOWEST_HZ = 0.015
LINE_LIMIT = 12  # lines at most
LINE_LEVEL = 1e-4  # false-alarm probability of a line on each axis


def without_lines(segments: list[np.ndarray], step_s: float) -> tuple[list[np.ndarray], list[tuple[int, float]]]:
    """Segments less sines, of free phase and amplitude in each, at frequencies where all together show a line.

    Segments (n_i, axes) are even, NaN where missing; with them come axis and frequency in Hz of every line.
    """
    cleaned, lines = [s.copy() for s in segments], []
    length = next_fast_len(2 * int(np.median([np.isfinite(s[:, 0]).sum() for s in segments])), real=True)
    lowest, highest = int(np.ceil(LOWEST_HZ * length * step_s)), int(0.48 * length)
    for axis in range(segments[0].shape[1]):
        for _ in range(LINE_LIMIT):
            fine = _spectrum(cleaned, axis, FINE * length)
            power = fine[FINE * lowest : FINE * highest : FINE]
            ratio = power / median_filter(power, BACKGROUND, mode="nearest")
            best = int(np.argmax(ratio))
            if chdtrc(2 * len(cleaned), 2 * len(cleaned) * ratio[best]) * ratio.size > LINE_LEVEL:
                break
            first = FINE * (lowest + best - 1)
            frequency = float(first + np.argmax(fine[first : first + 2 * FINE + 1])) / (FINE * length * step_s)
            for segment in cleaned:
                segment[:, axis] -= _sine(segment[:, axis], frequency * step_s, 2)[0]
            lines.append((axis, frequency))
    return cleaned, lines


def without_slow_lines(segments: list[np.ndarray], order: int, step_s: float) -> list[np.ndarray]:
    """Segments less slow sines, free in each, that autoregressive noise of an order does not explain.

    Segments (n_i, axes) are even, NaN where missing, less a cubic each. Such a line is slower than `LOWEST_HZ`, where
    a segment has no background to set it against: the likelihood ratio of the noise models with and without it decides.
    """
    cleaned, longest = [s.copy() for s in segments], max((len(s) for s in segments), default=0) * step_s
    grid = np.arange(0.5 / longest, LOWEST_HZ, 0.125 / longest) if longest else ()
    count = [np.isfinite(segment).sum(axis=0) for segment in cleaned]
    for axis in range(segments[0].shape[1] if len(grid) else 0):
        size = sum(one[axis] for one in count)
        series = [segment[:, axis] for segment in cleaned]
        variance = fit_noise(series, order, step_s).variance[-1]
        for _ in range(LINE_LIMIT):
            tried = [[one - _sine(one, frequency * step_s, 3)[1] for one in series] for frequency in grid]
            variances = [fit_noise(one, order, step_s).variance[-1] for one in tried]
            best = int(np.argmin(variances))
            gain = size * np.log(variance / variances[best])
            if chdtrc(2 * len(series), gain) * len(grid) > LINE_LEVEL:
                break
            series, variance = tried[best], variances[best]
        for segment, values in zip(cleaned, series, strict=True):
            segment[:, axis] = values
    return cleaned


def _sine(values, cycles, degree):
    """Fitted sine (n,) of `cycles` per sample in values (n,), a polynomial also fitted, and the sum of both (n,)."""
    good, phase = np.isfinite(values), 2 * np.pi * cycles * np.arange(values.size)
    slow = polynomial(np.arange(values.size), degree, 0, values.size - 1)
    columns = np.column_stack([np.cos(phase), np.sin(phase), slow])
    value = np.linalg.lstsq(columns[good], values[good], rcond=None)[0]
    return columns[:, :2] @ value[:2], columns @ value


FLIPS = 12  # highest order of the autoregressive noise that a telegraph signal has to be likelier than
CLIMBS = 40  # expectation-maximisation steps at most


def without_telegraph(segments: list[np.ndarray], slow: list[np.ndarray]) -> list[np.ndarray]:
    """Segments less random telegraph signals, jumps between two levels, where these are likelier than any noise.

    Segments (n_i, axes) are even, NaN where missing, less slow columns (n_i, q) of each.
    """
    cleaned = [segment.copy() for segment in segments]
    for axis in range(segments[0].shape[1] if segments else 0):
        fitted, _, gain = two_levels([segment[:, axis] for segment in segments], slow)
        for segment, level in zip(cleaned, fitted, strict=True):
            segment[:, axis] -= level if gain > 0 else 0.0
    return cleaned


def two_levels(series: list[np.ndarray], slow: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray], float]:
    """Random telegraph signal (n_i,), with fitted slow columns (n_i, q), of even series (n_i,); its states; its gain.

    The gain is twice the log likelihood over that of any noise, less Schwarz's penalty and chance. NaN where missing.

    Notes
    -----
    A telegraph signal has the spectrum of noise, not its distribution: two levels with white noise are set against
    autoregressive noise by Schwarz's criterion, both with the samples that the slow columns leave. The hidden states,
    1 or -1, are their mean over all paths, by Baum and Welch (Rabiner, Proc. IEEE 77, 1989), flips of both ways alike.
    """
    parts = [(y, c, np.isfinite(y)) for y, c in zip(series, slow, strict=True)]
    residual = [y - c @ np.linalg.lstsq(c[g], y[g], rcond=None)[0] for y, c, g in parts]
    count, removed = sum(int(g.sum()) for _, _, g in parts), sum(c.shape[1] for c in slow)
    whole, free = np.concatenate(residual), count - removed
    if free < 10 * FLIPS or not np.nanstd(whole) > 0:
        return [0 * y for y in series], [0 * y for y in series], -np.inf
    models = (fit_noise(residual, k, 1.0, removed).variance for k in range(FLIPS + 1))
    least = min(free * (np.log(2 * np.pi * one[-1]) + 1) + (one.size - 1) * np.log(count) for one in models)
    size, variance, flip, best = 0.8 * np.nanstd(whole), np.nanvar(whole) / 4, 0.05, -np.inf
    mean, whole = [y - r for (y, *_), r in zip(parts, residual, strict=True)], np.concatenate(series)
    for _ in range(CLIMBS):
        fields = [size * (y - m) / variance for y, m in zip(series, mean, strict=True)]
        expected = [_states(np.clip(np.nan_to_num(one), -300, 300), flip) for one in fields]
        states, sums, flips = zip(*expected, strict=True)
        square = np.nansum((whole - np.concatenate(mean)) ** 2) + count * size**2
        likelihood = sum(sums) - square / (2 * variance) - free / 2 * np.log(2 * np.pi * variance)
        if likelihood < best + 1e-3:
            break
        best = likelihood
        solved = ((c, (y - size * s)[g], g) for (y, c, g), s in zip(parts, states, strict=True))
        mean = [c @ np.linalg.lstsq(c[g], level, rcond=None)[0] for c, level, g in solved]
        state, level = np.concatenate(states), whole - np.concatenate(mean)
        size = abs(np.nansum(state * level)) / count
        variance = np.nansum(level**2 - 2 * size * state * level + size**2) / free
        flip = np.clip(sum(flips) / count, 1e-3, 0.5)
    gain = 2 * best - 3 * np.log(count) + least + 2 * np.log(LINE_LEVEL)
    return [m + size * s for m, s in zip(mean, states, strict=True)], list(states), float(gain)


@njit(cache=True)
def _states(field, flip):
    """Posterior mean of states 1 or -1 (n,) with half log odds field (n,), log likelihood, expected number of flips."""
    up, down, forward = np.exp(field), np.exp(-field), np.empty(field.size)
    log_sum, prior = 0.0, 0.5
    for k in range(field.size):
        total = prior * up[k] + (1 - prior) * down[k]
        log_sum += np.log(total)
        forward[k] = prior * up[k] / total
        prior = forward[k] + flip * (1 - 2 * forward[k])
    states, flips, one, other = np.empty(field.size), 0.0, 1.0, 1.0  # one, other: backward probabilities, up and down
    for k in range(field.size - 1, -1, -1):
        states[k] = (forward[k] * one - (1 - forward[k]) * other) / (forward[k] * one + (1 - forward[k]) * other)
        one, other, prior = up[k] * one, down[k] * other, forward[k - 1]
        flipped, kept = flip * (prior * other + (1 - prior) * one), (1 - flip) * (prior * one + (1 - prior) * other)
        flips += flipped / (flipped + kept) if k else 0.0
        one, other = one + flip * (other - one), other + flip * (one - other)
        one, other = one / (one + other), other / (one + other)
    return states, log_sum, flips


def _spectrum(segments, axis, parts):
    """Mean Hann periodogram of an axis of the segments less a parabola, at multiples of the sampling over ``parts``."""
    total = np.zeros(parts // 2 + 1)
    for values in (one[:, axis] for one in segments if np.isfinite(one[:, axis]).sum() > 3):
        index = np.flatnonzero(np.isfinite(values))
        window = np.hanning(index.size + 2)[1:-1]
        tapered = window * (values[index] - np.polynomial.Polynomial.fit(index, values[index], 2)(index))
        folded = np.bincount(index % parts, weights=tapered, minlength=parts)  # longer segments come round again
        total += np.abs(np.fft.rfft(folded)) ** 2 / np.sum(window**2)
    return total / len(segments)


JUMPS = 24  # in a series that are no noise, at most
SIDES = (2, 4, 8, 16)  # samples on either side of a jump that are compared
CLEAR = 5.0  # robust standard deviations of what noise makes of that
#: Longest lag, decays in samples of filters between axes, short as fits leave little slow noise; p-value of shared.
REACH, DECAYS, SHARED = 30, (1.0, 3.0), 1e-4


@dataclass(frozen=True)
class Common:
    """Noise that an axis has in common with another, as a filter of the other: an error of a rate is in both."""

    axis: int
    other: int
    weights: np.ndarray  #: (2 REACH + 1,) 1

    def taken_out(self, values: np.ndarray, sign: float = -1.0) -> np.ndarray:
        """Values (n, 3, ...), zero where missing, less the common noise, or with it again for sign 1."""
        shared, values = correlate1d(values[:, self.other], self.weights, axis=0, mode="constant"), values.copy()
        values[:, self.axis] += sign * shared
        return values


def in_common(left: np.ndarray, models: Sequence[NoiseModel]) -> list[Common]:
    """Common noise of weaker with stronger axes of a series (n, 3), in the order in which it is taken out.

    Filters that decay over a few samples, even and odd in time, fitted to the weaker axis, whitened by its model.
    """
    lag = np.arange(-REACH, REACH + 1.0)
    decays = [np.exp(-np.abs(lag) / decay) for decay in DECAYS]
    filters = np.stack([*decays, *(np.sign(lag) * one for one in decays)])
    axes, good, common = np.argsort(-np.nanvar(left, axis=0)), np.isfinite(left).all(axis=1), []
    left = np.where(good[:, None], left, 0.0)
    for weaker, other in ((a, b) for k, a in enumerate(axes) for b in axes[:k]):
        filtered = [correlate1d(left[:, other], one, mode="constant") for one in filters]
        columns, observed = (whiten(models[weaker], one, good) for one in (np.stack(filtered, axis=1), left[:, weaker]))
        coefficients = np.linalg.lstsq(columns, observed, rcond=1e-8)[0]
        if chdtrc(len(filters), np.sum((columns @ coefficients) ** 2)) < SHARED:
            common.append(Common(int(weaker), int(other), coefficients @ filters))
            left = common[-1].taken_out(left)
    return common


QUARTILE = 0.3186  # of the size of a normal deviate: a quarter of all differences has no jump, where half may have one


def jumps(left: Callable[[list[int]], np.ndarray]) -> list[int]:
    """Indices of clear jumps in the residual of a series, found one by one, those before fitted.

    `left` takes indices to the residual (n,) of the series with `jump_columns` of them fitted.
    """
    places: list[int] = []
    while len(places) < JUMPS:
        place = jump(left(places), places)
        if place is None:
            break
        places.append(place)
    return places


def jump_columns(count: int, places: Sequence[int]) -> np.ndarray:
    """Columns (n, 2 k) of a step after each place (k,) and an impulse at it, so that a step may lie within a sample."""
    at = np.arange(count)[:, None]
    return np.concatenate([at > np.array(places, dtype=int), at == np.array(places, dtype=int)], axis=1).astype(float)


def jump(series: np.ndarray, known: Sequence[int] = ()) -> int | None:
    """Index of the clearest jump in a series (n,) that is not near a known one, None where there is none.

    Mean of the bins after one less that of those before, compared with the lower quartile of all such differences: a
    robust measure of red noise, which jumps hardly move. The narrowest window with a jump places it best.
    """
    cumulative = np.cumsum(np.append(0.0, series))
    for side in (one for one in SIDES if series.size > 4 * one):
        means = (cumulative[side:] - cumulative[:-side]) / side
        difference = np.abs(means[side + 1 :] - means[: -side - 1])
        limit = CLEAR * np.quantile(difference, 0.25) / QUARTILE
        for one in known:
            difference[max(one - 2 * side, 0) : max(one + 1, 0)] = 0.0
        place = int(difference.argmax())
        if difference[place] > limit:
            return place + side
    return None


def isolated(values: np.ndarray, reach: int, limit: float, weights=None, least: float = 0.0) -> np.ndarray:
    """True (n,) for samples that stand apart from their neighbours on both sides, in runs no longer than reach.

    The distance from the median of the neighbours, which follows steps and slow changes, is compared with what nine
    tenths of such distances keep to, so that what happens all the time sets the scale and is none. Even values (n, k)
    of any units; the limit in robust standard deviations, which are at least so large. Weights (2 reach + 1,) predict a
    value by its neighbours, for series that bend more than they scatter; the largest distance within the reach is then
    the outlier.
    """
    size = 2 * reach + 1
    if len(values) < 10 * size:
        return np.zeros(len(values), dtype=bool)
    middle = median_filter(values, (size, 1)) if weights is None else correlate1d(values, weights, axis=0)
    distance = np.abs(values - middle)
    distance[:reach] = distance[-reach:] = 0.0
    scale = np.maximum(np.quantile(distance, 0.9, axis=0) / 1.645, least)
    outlying = distance > limit * np.where(scale > 0, scale, np.inf)
    if weights is not None:
        outlying &= distance >= maximum_filter1d(distance, size, axis=0)
    return outlying.any(axis=1)


EXPONENTS = (-2, -1, 0, 1)  # of the frequency in the power laws whose sum is the density of the noise
POWER_ORDER, POWER_NODES = 60, 16384  # order of its autoregressive model, number of frequencies of the density
DRAWS = 400  # segments of simulated noise, for what a fit leaves of each
FITS, HIGHEST = 20, 6.0  # of the sum; power over that of the model, reached by noise in one of 400


def power_laws(values: np.ndarray, clean: Callable, count: np.ndarray, step_s: float) -> NoiseModel:
    """Noise model of a series from the residual of a fit: the sum of power laws that its periodogram shows.

    Power laws are drawn and go through the same fit. Sharp lines are no noise, and the power at a frequency counts up
    to a few times that of the model. Values (s, b, 1) are segments, clean takes (s, b, d) to what the fit leaves, runs
    of segments that touch (n, d), count (s, b) are steps since the first sample.
    """
    lowest, rng = 1 / (step_s * count.max()), np.random.default_rng(0)
    draws = max(8, DRAWS // len(count))
    noise = rng.standard_normal((next_fast_len(2 * int(count.max()) + 1, real=True), draws))
    frequency = np.maximum(np.fft.rfftfreq(len(noise), step_s), lowest)[:, None]
    spectrum, expected = np.fft.rfft(noise, axis=0), []
    for exponent in EXPONENTS:
        coloured_noise = np.fft.irfft(spectrum * (frequency * step_s) ** (exponent / 2), len(noise), axis=0)
        expected.append(_power(clean(coloured_noise[count])).mean(axis=1))
    expected = np.stack(expected, axis=1)
    power = _power(without_lines(clean(values), step_s)[0])[:, 0]
    model = expected[:, EXPONENTS.index(0)] * power.mean() / expected[:, EXPONENTS.index(0)].mean()
    for _ in range(FITS):
        size = nnls(expected / model[:, None], np.minimum(power / model, HIGHEST))[0]
        model = expected @ size
    at = (np.arange(POWER_NODES) + 0.5) / (2 * step_s * POWER_NODES)
    density = 2 * step_s * sum(a * (np.maximum(at, lowest) * step_s) ** e for a, e in zip(size, EXPONENTS, strict=True))
    return from_density(density, POWER_ORDER, step_s)


def _power(runs):
    """Hann periodograms (f, d) of all runs (n, d), less their means, concatenated; one for unit white noise."""
    parts = []
    for run in runs:
        window = np.hanning(len(run) + 2)[1:-1, None]
        parts.append(np.abs(np.fft.rfft(window * (run - run.mean(axis=0)), axis=0)[1:]) ** 2 / np.sum(window**2))
    return np.concatenate(parts)
