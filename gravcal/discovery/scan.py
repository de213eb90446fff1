"""Scans of residuals over time and frequency: steps at an epoch, lines at a frequency, excess power in both."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit
from scipy import fft, special

from gravcal.discovery.problem import Problem, inverse_of_baseline, residuals_of, weighted_rows
from gravcal.estimation.records import Block


@dataclass(frozen=True)
class Scan:
    """Chi-square gains of all steps, or of all lines, that were tried in one channel."""

    kind: str  #: "step" or "line"
    channel: str  #: name
    place: np.ndarray  #: (k,) block of each step, -1 for all; axis 0..2 of each line, -1 for all
    at: np.ndarray  #: (k,) epoch s, or frequency Hz
    gain: np.ndarray  #: (k, d) reduction of chi-square for each column of the residual
    dof: np.ndarray  #: (k,) number of parameters


def steps(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray]) -> Scan:
    """Scan of a step in the linear acceleration at every epoch that the blocks offer, on all axes, then on each.

    Each block by itself; then, where there are several, all with one step size at epochs of the same index in each.
    """
    inverse = inverse_of_baseline(problem, baseline)
    place, at, dof, gain = [np.zeros(0, dtype=int)], [np.zeros(0)], [np.zeros(0, dtype=int)], []
    parts = []
    for i, block in enumerate(problem.blocks):
        if block.steps:
            key, count = ("local", i), len(block.steps)
            if key not in problem.memory:  # rows that steps touch, columns (n, k q) of the k epochs, Gram (k, q, q)
                shapes = np.concatenate(list(block.steps.values()), axis=1)
                rows = np.flatnonzero(np.any(shapes != 0, axis=1))
                shapes = shapes[rows]
                groups = _grouped(shapes, count), _grouped(problem.bases[i][rows].T @ shapes, count)
                gram, inside = (one.transpose(0, 2, 1) @ one for one in groups)
                problem.memory[key] = rows, shapes, gram - inside
            rows, shapes, gram = problem.memory[key]
            cross = problem.columns[i].of(baseline)[rows].T @ shapes
            parts.append((i, gram, _grouped(cross, count), _grouped(rest[i][rows].T @ shapes, count)))
    if len(parts) > 1:
        count = min(len(gram) for _, gram, _, _ in parts)
        parts.append((-1, *(sum(part[k][:count] for part in parts) for k in (1, 2, 3))))
    for i, gram, cross, right in parts:
        inner, right = gram - cross.transpose(0, 2, 1) @ (inverse @ cross), right.transpose(0, 2, 1)
        gain.append(np.sum(right * (np.linalg.pinv(inner, 1e-8, hermitian=True) @ right), axis=1))
        diagonal = np.einsum("kqq->kq", inner)
        valid = diagonal > 1e-8 * np.max(diagonal, axis=1, keepdims=True)
        gain += [*np.moveaxis(np.where(valid, 1 / np.where(valid, diagonal, 1.0), 0.0)[:, :, None] * right**2, 1, 0)]
        parameters = np.array([inner.shape[1], *[1] * inner.shape[1]])
        dof.append(np.repeat(parameters, len(gram)))
        epochs = list(problem.blocks[i if i >= 0 else parts[0][0]].steps)[: len(gram)]
        at.append(np.tile(epochs, parameters.size))
        place.append(np.full(dof[-1].size, i))
    gain = np.concatenate(gain) if gain else np.zeros((0, rest[0].shape[1]))
    return Scan("step", "linear", *map(np.concatenate, (place, at)), gain, np.concatenate(dof))


def _grouped(columns, count):
    """Columns (n, count q), the q of one group adjacent, as a stack (count, n, q)."""
    return columns.reshape(columns.shape[0], count, columns.shape[1] // max(count, 1)).transpose(1, 0, 2)


def frequencies(blocks: list[Block], channel: str) -> np.ndarray:
    """Frequency grid (f,) Hz of a channel in steps of 1/(2 T), T its longest block, from 3/T to 3/T below Nyquist."""
    spans, spacing = [], []
    for block in blocks:
        time = block.time[(block.channel == channel) & (block.axis == 0)]
        if time.size > 20 and np.ptp(time) > 0:
            spans.append(np.ptp(time))
            spacing.append(np.median(np.diff(time)))
    if not spans:
        return np.zeros(0)
    spacing = max(spacing)
    step = 1 / (2 * spacing * max(np.rint(max(spans) / spacing), 1))  # a transform of even records has just these
    return step * np.arange(6, np.rint(0.5 / (step * spacing)) - 5)


def offered(spectrum: Scan, periods: Mapping[float, int]) -> np.ndarray:
    """True (k,) for lines that are no harmonic of a period, {period s: highest harmonic}, nor leakage from one.

    A sine leaks to a frequency that is d off by 1 / (pi T d)^2 of its power in a record of T; a line that is no more
    than four times as strong as the leakage of a harmonic is refused. Gains are those of the first residual column.
    """
    at, gain = spectrum.at, spectrum.gain[:, 0]
    width = 2 * float(np.median(np.diff(np.unique(at)))) if np.unique(at).size > 1 else 0.0  # 1 / T
    harmonics = np.concatenate([np.zeros(0), *(np.arange(1, n + 1) / period for period, n in periods.items())])
    harmonics = harmonics[harmonics < at.max(initial=0.0)]
    kept = np.ones(at.size, dtype=bool)
    for place in np.unique(spectrum.place) if harmonics.size else ():
        on_place = spectrum.place == place
        leaking = gain[on_place][np.abs(at[on_place, None] - harmonics).argmin(axis=0)]
        distance = np.abs(at[on_place, None] - harmonics)
        limit = np.max(4 * leaking / np.maximum(distance * np.pi / width, 1.0) ** 2, axis=1)
        kept[on_place] = (distance.min(axis=1) >= width) & (gain[on_place] > limit)
    return kept


def lines(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str) -> Scan:
    """Scan of sines on the frequency grid, phase and amplitude free in each block: on axis x, y, z, then on all three.

    The whitening filter leaves a sine a sine, so that sine and cosine stand for it in the whitened rows.
    """
    grid = frequencies(problem.blocks, channel)
    gain, dof = line_gains(problem, baseline, rest, channel, grid)
    place, at = np.repeat([0, 1, 2, -1], grid.size), np.tile(grid, 4)
    return Scan("line", channel, place, at, gain.reshape(-1, rest[0].shape[1]), dof.ravel())


def line_gains(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str, grid: np.ndarray):
    """Chi-square gain (4, f, d) and number of parameters (4, f) of lines at `grid` (f,) Hz: on x, y, z and all axes."""
    count = rest[0].shape[1]
    inverse = inverse_of_baseline(problem, baseline)
    gain, dof = np.zeros((4, grid.size, count)), np.zeros((4, grid.size), dtype=int)
    for i in range(len(problem.blocks)):
        for axis in range(3):
            rows, waves, gram = _waves(problem, i, channel, axis, grid)
            if waves is None:
                continue
            columns = problem.columns[i].of(baseline)[rows]
            nonzero = np.flatnonzero(columns.any(axis=0))
            cross = waves(columns[:, nonzero])
            part = (cross.reshape(2 * grid.size, nonzero.size) @ inverse[np.ix_(nonzero, nonzero)]).reshape(cross.shape)
            inner, right = gram - part @ cross.swapaxes(1, 2), waves(rest[i][rows])
            gain[axis] += np.sum(right * np.linalg.solve(inner, right), axis=1)
            dof[axis] += 2
    gain[3], dof[3] = gain[:3].sum(axis=0), dof[:3].sum(axis=0)
    return gain, dof


def _waves(problem, index, channel, axis, grid):
    """Rows (n,) of an axis, their `waves_at`, Gram (f, 2, 2) of the waves less local columns; None if under 40."""
    key = ("waves", index, channel, axis, grid.tobytes())
    if key not in problem.memory:
        block = problem.blocks[index]
        rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & weighted_rows(block))
        if rows.size < 40:
            problem.memory[key] = rows, None, None
        else:
            waves = waves_at(block.time[rows], grid)
            inside = waves(problem.bases[index][rows])
            gram = _squares(block.time[rows], grid) - inside @ inside.swapaxes(1, 2) + 1e-9 * rows.size * np.eye(2)
            problem.memory[key] = rows, waves, gram
    return problem.memory[key]


def waves_at(time: np.ndarray, grid: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Function: signals (n, q) -> products (f, 2, q) with cosine and sine of each frequency, phase zero at time[0].

    A day has as many frequencies as records, so that their columns would be many gigabytes: none are kept. Evenly
    spaced records (gaps and jitter below 1/20 of the spacing allowed) take an FFT. Time (n,) s ascends, grid (f,) Hz.
    """
    spacing = float(np.median(np.diff(time)))
    index = np.rint((time - time[0]) / spacing).astype(int)
    length = int(np.rint(1 / (spacing * np.diff(grid).min()))) if grid.size > 1 else 1
    length *= -(-(index[-1] + 1) // max(length, 1))
    bins = grid * length * spacing
    phase_error = np.abs(bins - np.rint(bins)).max(initial=0.0) * np.ptp(time) / (max(length, 1) * spacing)
    evenly = np.abs(time - time[0] - index * spacing).max() < 0.05 * spacing and np.all(np.diff(index) > 0)
    cheaper = length * np.log2(max(length, 2)) < time.size * grid.size  # than products with a few close frequencies
    if evenly and cheaper and grid.size > 1 and length > 0 and phase_error < 0.01:
        return partial(_transformed, index, length, np.rint(bins).astype(int))
    return partial(_multiplied, time - time[0], grid)


def _transformed(index, length, bins, signals):
    """Products as of `waves_at` by FFT: records at grid indices (n,), zero-padded to `length`, at bins (f,)."""
    padded = np.zeros((index[-1] + 1, signals.shape[1]))
    padded[index] = signals
    folded = bins % length
    sign = np.where(folded > length // 2, 1.0, -1.0)[:, None]
    spectrum = fft.rfft(padded, length, axis=0)[np.minimum(folded, length - folded)]
    return np.stack([spectrum.real, sign * spectrum.imag], axis=1)


def _multiplied(time, grid, signals):
    """Products as of `waves_at` by direct sums for any times (n,) s after the first, a few frequencies at once."""
    products = np.empty((grid.size, 2, signals.shape[1]))
    at_once = max(TABLE // time.size, 1)
    for first in range(0, grid.size, at_once):
        part = slice(first, first + at_once)
        phase = 2 * np.pi * np.outer(grid[part], time)
        products[part, 0], products[part, 1] = np.cos(phase) @ signals, np.sin(phase) @ signals
    return products


def _squares(time, grid):
    """Gram matrices (f, 2, 2) of cosine and sine at times (n,) s, phase zero at the first, for frequencies (f,) Hz."""
    cosine, sine = np.moveaxis(waves_at(time, grid * 2)(np.ones((time.size, 1)))[..., 0], 1, 0) / 2
    half = time.size / 2
    return np.stack([np.stack([half + cosine, sine], axis=1), np.stack([sine, half - cosine], axis=1)], axis=2)


def sine_columns(block: Block, channel: str, frequency: float, axes) -> np.ndarray:
    """Cosine and sine (n, 2 a) of a frequency Hz, phase zero at time 0, in the rows of each axis (a,), else zero."""
    columns = np.zeros((block.observed.size, 2 * len(axes)))
    for k, axis in enumerate(axes):
        rows = (block.channel == channel) & (block.axis == axis) & weighted_rows(block)
        phase = 2 * np.pi * frequency * block.time[rows]
        columns[rows, 2 * k], columns[rows, 2 * k + 1] = np.cos(phase), np.sin(phase)
    return columns


def side_by_side(parts: list[np.ndarray], groups) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns (n, q g) of each block, its part (n, q) in the slot of its group, and True (q g,) for nonzero ones."""
    width = parts[0].shape[1]
    columns = [np.zeros((part.shape[0], width * (max(groups) + 1))) for part in parts]
    for matrix, part, group in zip(columns, parts, groups, strict=True):
        matrix[:, width * group : width * (group + 1)] = part
    return columns, np.sum([np.sum(matrix**2, axis=0) for matrix in columns], axis=0) > 0


TABLE = 1 << 21  # cosines that are made at once
NEIGHBOURS, GUARD = 24, 2  # bins to either side that a chirp is set against, and that are left out next to it
SHORTEST, NARROWEST = 32, 2  # samples of a stretch, bins of its spectrum, of the smallest tile of time and frequency
LONGEST = {"tile": 50_000, "slow": 50_000, "chirp": 2048, "drift": 2048}  # samples of a block up to which each is tried
FAST = {"reassoc", "contract", "nnan"}  # floating-point shortcuts that compiled sums may take
FEWEST, MANY = 1.0, 4.0  # degrees of freedom of a tile from which on it is tested, and Wilson and Hilferty hold
TAIL = 6.0  # exponent of a chi-square with fewer from which on its deviate is known; it is zero below


@dataclass(frozen=True)
class Excess:
    """Most significant excess of power of a channel in the time-frequency plane."""

    kind: str  #: "tile", "slow", "chirp", or "drift" of a line through all blocks
    channel: str  #: name
    axis: int  #: 0..2, -1 for all
    block: int  #: index of the block, -1 for all
    span: tuple[float, float]  #: (2,) s from the first row of the block
    band: tuple[float, float]  #: (2,) Hz; of a chirp or a drifting line where it begins and where it ends
    #: (d,) natural log of the p-value, corrected for the number of tiles tried, of each column of the residual
    log_p: np.ndarray
    score: float  #: power less twice its expectation under noise, to choose among several


def excess(problem: Problem, rest: list[np.ndarray], channel: str) -> list[Excess]:
    """Most significant excess over the power of drawn noise after the same fit, of each kind: tile, slow, chirp, drift.

    Tiles are stretches of 1/2^k of a block and bands of 2^k bins of their spectrum; chirps pass through a band at a
    steady rate in the whole of a block. Both on an axis or on all, in a block or in all at the same time from its
    start. A line whose frequency drifts steadily from the first block to the last has a phase of its own in each. The
    slow end of the spectrum of all blocks has weights that fall with the square of frequency from 2^k bins on, as power
    of a random telegraph signal does (Papoulis, Probability, ch. 10). Residuals (n, 1 + d): observed, then d draws.
    """
    numbers, starts, spacing, series = _series(problem.blocks, rest, channel)
    excesses, drifts = [], partial(_drifts, np.array(starts), spacing)
    for kind, regions in (("tile", _tiles), ("slow", _slow), ("chirp", _chirps), ("drift", drifts)):
        best, count = (-np.inf,), 0
        largest = np.full(rest[0].shape[1], -np.inf)
        for spans, bands, of_axes, *raw in regions(series) if numbers and series[0].shape[1] <= LONGEST[kind] else ():
            sets = [*enumerate(of_axes if len(of_axes) > 1 else ()), (-1, sum(of_axes))]  # a channel may have one axis
            for axis, of_blocks in sets:
                by_block = zip(numbers, of_blocks, strict=True) if kind in ("tile", "chirp") else ()
                for block, power in [*by_block, (-1, of_blocks.sum(axis=0))]:
                    score = _deviations(power, largest)
                    count += int(np.sum(np.isfinite(score)))
                    if largest[0] > best[0]:
                        place, rows = int(score.argmax()), slice(None) if block < 0 else numbers.index(block)
                        powers = raw[0] if raw else of_axes
                        chosen = powers if axis < 0 else powers[axis : axis + 1]
                        above = sum(one[rows, place, 0].sum() for one in chosen) - 2 * power[place, 1:].mean()
                        best = largest[0], axis, block, spans[place], bands[place], above
        if count and np.isfinite(best[0]):
            log_p = special.log_ndtr(-largest) + np.log(count)
            span, band = tuple(best[3] * spacing), tuple(best[4] / spacing)
            excesses.append(Excess(kind, channel, *best[1:3], span, band, log_p, float(best[5])))
    return excesses


def level_error(problem: Problem, baseline: np.ndarray, parts: list[np.ndarray], spectra: Mapping) -> float:
    """Standard deviation of the log noise density averaged over the power of signals (n, 1); {channel: spectra}."""
    residuals, variance = residuals_of(problem, baseline, parts), 0.0
    total = sum(float(np.sum(samples**2)) for samples in residuals)
    for channel, axes in spectra.items():
        *_, spacing, series = _series(problem.blocks, residuals, channel)
        for spectrum, samples in zip(axes, series, strict=False):
            power = _power(samples).sum(axis=(0, 2)) / max(total, 1e-300)
            share = spectrum.shares(np.arange(1, power.size + 1) / (samples.shape[1] * spacing)).T @ power
            variance += share @ spectrum.covariance @ share
    return float(np.sqrt(variance))


def _series(blocks, residuals, channel):
    """Indices (b,) of the blocks of a channel, their starts s, spacing s, rows (b, n, d) of each axis on an even grid.

    Zero where a row is missing; only blocks of over 0.9 of the longest, cut to a common length that an FFT likes.
    """
    axes = range(1 + max((int(b.axis[b.channel == channel].max(initial=0)) for b in blocks), default=0))
    rows = [[(b.channel == channel) & (b.axis == axis) for axis in axes] for b in blocks]
    at = {k: [b.time[mask] for mask in rows[k]] for k, b in enumerate(blocks)}
    at = {k: one for k, one in at.items() if min(time.size for time in one) >= SHORTEST}
    if not at:
        return (), (), np.nan, []
    spacing = float(np.median([np.median(np.diff(np.sort(one[0]))) for one in at.values()]))
    starts = {k: min(time.min() for time in one) for k, one in at.items()}
    at = {k: [np.rint((time - starts[k]) / spacing).astype(int) for time in one] for k, one in at.items()}
    size = {k: 1 + max(place.max() for place in one) for k, one in at.items()}
    kept = sorted((k for k in at if size[k] > 0.9 * max(size.values())), key=starts.get)
    length = fft.prev_fast_len(min(size[k] for k in kept))
    series = [np.zeros((len(kept), length, residuals[0].shape[1]), dtype="f4") for _ in axes]
    for (row, k), axis in itertools.product(enumerate(kept), axes):
        inside = at[k][axis] < length
        series[axis][row, at[k][axis][inside]] = residuals[k][rows[k][axis]][inside]
    return tuple(kept), [starts[k] for k in kept], spacing, series


@njit(cache=True, fastmath=FAST)
def _deviations(power, most):
    """Normal deviates (k,) of the first column of power (k, d) under the chi-square that the others, draws, show.

    Each draw is set against all the others, as the first column is. `most` (d,), the largest deviate of each column, is
    updated in place.
    """
    deviates, lowest, draws = np.full(len(power), -np.inf), most.min(), power.shape[1] - 1
    for k in range(len(power)):
        total, square, largest = 0.0, 0.0, 0.0
        for value in power[k, 1:]:
            total += value
            square += value * value
            largest = max(largest, value)
        deviates[k] = _deviate(power[k, 0], total, square, draws)
        of_draws = _deviate(largest, total - largest, square - largest * largest, draws - 1)
        if max(deviates[k], of_draws) > lowest:
            most[0] = max(most[0], deviates[k])
            for j in range(1, draws + 1):
                value = power[k, j]
                most[j] = max(most[j], _deviate(value, total - value, square - value * value, draws - 1))
            lowest = most.min()
    return deviates


@njit(cache=True, fastmath=FAST)
def _deviate(power, total, square, draws):
    """Normal deviate of a power under the chi-square of draws, their sum and sum of squares; -inf if not tested.

    The degrees of freedom are the mean of the draws, fewer where their variance shows weights: by Wilson and Hilferty,
    or of few by the leading terms of both tails (Abramowitz and Stegun, 6.5.32 and 26.2.12).
    """
    mean = total / draws
    freedom = min(mean, 2 * mean**2 / max(square / draws - mean**2, 1e-6))
    if freedom < FEWEST:
        return -np.inf
    if freedom >= MANY:
        spread = 2 / (9 * freedom)
        return (np.cbrt(power / mean) - 1 + spread) / np.sqrt(spread)
    exponent = freedom * power / (2 * mean)
    if exponent < TAIL:
        return 0.0
    log_tail = (freedom / 2 - 1) * np.log(exponent) - exponent - math.lgamma(freedom / 2)
    return np.sqrt(-2 * log_tail - np.log(-4 * np.pi * log_tail))


def _tiles(series):
    """Yield tiles of axis series (b, n, d): spans (k, 2) samples, bands (k, 2) per sample, power (b, k, d) an axis."""
    count, parts = series[0].shape[1], 1
    while count // parts >= SHORTEST:
        size = count // parts
        bins = (size - 1) // 2
        widths = [w for w in NARROWEST * 2 ** np.arange(20) if w <= bins]
        edges = np.array([(lo, lo + w) for w in widths for lo in range(0, bins - w + 1, max(w // 2, 1))])
        stretch, tile = np.divmod(np.arange(parts * len(edges)), len(edges))
        of_axes = []
        for one in series:
            power = _power(one[:, : parts * size].reshape(len(one), parts, size, -1))
            total = np.concatenate([np.zeros_like(power[:, :, :1]), np.cumsum(power, axis=2)], axis=2)
            of_axes.append((total[:, :, edges[:, 1]] - total[:, :, edges[:, 0]]).reshape(len(one), -1, one.shape[2]))
        yield size * np.stack([stretch, stretch + 1], axis=1), (edges[tile] + 1) / size, of_axes
        parts *= 2


def _power(series):
    """Periodogram (..., f, d) of series (..., n, d), mean 2 for unit variance; no zero-frequency and Nyquist bins."""
    size = series.shape[-2]
    spectrum = fft.rfft(series, axis=-2)[..., 1 : 1 + (size - 1) // 2, :]
    return _squared(np.ascontiguousarray(spectrum), 2 / size)


def _slow(series):
    """Yield the slow end of the spectrum as `_tiles` does: power weighted by 1/(1 + (f/corner)^2), k corners."""
    count = series[0].shape[1]
    bins = (count - 1) // 2
    corners = np.array([c for c in 2 ** np.arange(20) if c <= bins / 4])
    if corners.size:
        weights = 1 / (1 + (np.arange(1, bins + 1) / corners[:, None]) ** 2)
        bands = np.stack([np.ones(corners.size), 1 + corners], axis=1) / count
        of_axes = [np.einsum("kf,bfd->bkd", weights, _power(one), optimize=True) for one in series]
        yield np.array([(0, count)] * corners.size), bands, of_axes


def _chirps(series):
    """Yield chirps of every linear rate as `_tiles` does, start and end frequency between zero and Nyquist.

    A real series has the same power at (rate, f) and (-rate, -f): one spectrum gives both signs of the rate, of unit
    variance for each of the two degrees of freedom. What is tested is `_above`; the observed power itself comes last.
    """
    count = series[0].shape[1]
    turns = 0.25 * count  # of a rate of half the band in half the time; ends apart by a quarter of a turn
    for step in range(1, int(turns / 2) + 1):
        rate = 4 * step / count**2
        middle, sweep = np.arange(count) / count, rate * count / 2
        kept = np.flatnonzero((middle > sweep) & (middle < 0.5 - sweep))
        if kept.size:
            both, rising = np.concatenate([kept, -kept]), middle[kept, None] + [-sweep, sweep]
            bands, powers = np.concatenate([rising, rising[:, ::-1]]), [_turned(one, rate) for one in series]
            of_axes = [_above(one, min(NEIGHBOURS, count // 8), GUARD)[:, both] for one in powers]
            yield np.array([(0, count)] * both.size), bands, of_axes, [one[:, both, :1] for one in powers]


def _turned(series, rate):
    """Periodogram (b, n, d) of a series dechirped at a rate, cycles/sample^2."""
    centred = np.arange(series.shape[1]) - series.shape[1] / 2
    turn = np.exp(-1j * np.pi * rate * centred**2).astype("c8")
    return _squared(fft.fft(series * turn[:, None], axis=1, overwrite_x=True), 2 / series.shape[1])


@njit(cache=True, fastmath=FAST)
def _above(power, half, guard):
    """Power (b, n, d) of two degrees of freedom, each bin set against the bins from `guard` to `half` beside it.

    Of noise it is a chi-square of two degrees of freedom again, whatever its level: with s the sum of m such powers,
    P(power / s > t) = (1 + t)^-m; the logarithm by its Pade approximant [2/2]. What a block has less in all than the
    draws is added to s: noise that is overrated makes nothing stand out.
    """
    above, size, count = np.empty_like(power), power.shape[1], 2 * (half - guard)
    for i in range(len(power)):
        mean = power[i].sum(axis=0) / size
        lack = count * np.maximum(mean[1:].mean() - mean, np.float32(1e-9))
        beside = np.zeros(mean.size)
        for k in range(guard + 1, half + 1):
            beside += power[i, k] + power[i, size - k]
        for k in range(size):
            for j in range(power.shape[2]):
                x, s = power[i, k, j], beside[j] + lack[j]
                above[i, k, j] = 2 * count * x * (6 * s + 3 * x) / (6 * s * s + 6 * s * x + x * x)
            beside += power[i, (k + half + 1) % size] - power[i, (k + guard + 1) % size]
            beside += power[i, k - guard] - power[i, k - half]
    return above


@njit(cache=True, fastmath=FAST)
def _squared(spectrum, factor):
    """Squared magnitude of a spectrum (...), times a factor."""
    power, scale = np.empty(spectrum.shape, np.float32), np.float32(factor)
    source, target = spectrum.reshape(-1), power.reshape(-1)
    for k in range(source.size):
        target[k] = scale * (source[k].real ** 2 + source[k].imag ** 2)
    return power


def _drifts(starts, spacing, series):
    """Yield lines whose frequency drifts linearly by two bins or more from first to last block, as `_tiles` does.

    Blocks begin at `begins` (b,) s, samples are `spacing` s apart; each is dechirped by the drift within it.
    """
    count = series[0].shape[1]
    centred = (starts - np.mean([starts.min(), starts.max()])) / spacing if len(starts) > 2 else np.zeros(1)
    half, last, turned = centred.max(), None, []
    for ends in range(-(count // 4), count // 4 + 1) if half > 0 else ():
        shift = np.rint(ends * centred / half).astype(int)
        kept = np.arange(1 + abs(ends), (count - 1) // 2 - abs(ends))
        if abs(ends) > 1 and kept.size:
            step = round(ends / half * count / 4)
            if step != last:
                turned = [_turned(one, 4 * step / count**2) for one in series]
            low, high, last = kept[0], kept[-1] + 1, step
            drift = ends * (1 + count / (2 * half))
            moved = [[row[low + m : high + m] for row, m in zip(one, shift, strict=True)] for one in turned]
            of_axes, bands = [*map(np.stack, moved)], (kept[:, None] + [-drift, drift]) / count
            yield np.array([(0, count)] * kept.size), bands, of_axes
