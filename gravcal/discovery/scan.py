"""Search along the time and the frequency axis: steps at an epoch, lines at a frequency, power beyond noise in both."""

from __future__ import annotations

import itertools
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
    """Gains of many shapes in one channel."""

    kind: str  #: "step" or "line"
    channel: str  #: name
    place: np.ndarray  #: (k,) block of each step, -1 for all; axis of each line, -1 for all three
    at: np.ndarray  #: (k,) epoch s, or frequency Hz
    gain: np.ndarray  #: (k, d) reduction of chi-square for each column of the residual
    dof: np.ndarray  #: (k,) parameters


def steps(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray]) -> Scan:
    """A step of the linear reading at every epoch that the blocks offer, on all axes, then on each.

    In one block; then in all, where there are several, of one size and as long after the first epoch of each.
    """
    inverse = inverse_of_baseline(problem, baseline)
    place, at, dof, gain = [np.zeros(0, dtype=int)], [np.zeros(0)], [np.zeros(0, dtype=int)], []
    parts = []
    for i, block in enumerate(problem.blocks):
        if block.steps:
            key, count = ("local", i), len(block.steps)
            if key not in problem.memory:  # rows that steps touch, columns (n, k q) of the k epochs, products (k, q, q)
                shapes = np.concatenate(list(block.steps.values()), axis=1)
                rows = np.flatnonzero(np.any(shapes != 0, axis=1))
                shapes = shapes[rows]
                both = _grouped(shapes, count), _grouped(problem.bases[i][rows].T @ shapes, count)
                own, inside = (one.transpose(0, 2, 1) @ one for one in both)
                problem.memory[key] = rows, shapes, own - inside
            rows, shapes, own = problem.memory[key]
            cross = problem.columns[i].of(baseline)[rows].T @ shapes
            parts.append((i, own, _grouped(cross, count), _grouped(rest[i][rows].T @ shapes, count)))
    if len(parts) > 1:
        count = min(len(own) for _, own, _, _ in parts)
        parts.append((-1, *(sum(part[k][:count] for part in parts) for k in (1, 2, 3))))
    for i, own, cross, right in parts:
        inner, right = own - cross.transpose(0, 2, 1) @ (inverse @ cross), right.transpose(0, 2, 1)
        gain.append(np.sum(right * (np.linalg.pinv(inner, 1e-8, hermitian=True) @ right), axis=1))
        alone = np.einsum("kqq->kq", inner)
        valid = alone > 1e-8 * np.max(alone, axis=1, keepdims=True)
        gain += [*np.moveaxis(np.where(valid, 1 / np.where(valid, alone, 1.0), 0.0)[:, :, None] * right**2, 1, 0)]
        free = np.array([inner.shape[1], *[1] * inner.shape[1]])
        dof.append(np.repeat(free, len(own)))
        epochs = list(problem.blocks[i if i >= 0 else parts[0][0]].steps)[: len(own)]
        at.append(np.tile(epochs, free.size))
        place.append(np.full(dof[-1].size, i))
    gain = np.concatenate(gain) if gain else np.zeros((0, rest[0].shape[1]))
    return Scan("step", "linear", *map(np.concatenate, (place, at)), gain, np.concatenate(dof))


def _grouped(columns, count):
    """Columns (n, count q) in groups (count, n, q)."""
    return columns.reshape(columns.shape[0], count, columns.shape[1] // max(count, 1)).transpose(1, 0, 2)


def frequencies(blocks: list[Block], channel: str) -> np.ndarray:
    """Frequencies (f,) Hz that a channel can tell apart, from three cycles in the longest block to as near Nyquist."""
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
    """True (k,) for lines that are no harmonic of a period, {s: highest}, as far as the records tell them apart.

    A sine leaks to a frequency that is d off by 1 / (pi T d)^2 of its power in a record of T; a line that is no more
    than four times as strong as what leaks from a harmonic is none. The gain of the first column counts.
    """
    at, gain = spectrum.at, spectrum.gain[:, 0]
    width = 2 * float(np.median(np.diff(np.unique(at)))) if np.unique(at).size > 1 else 0.0  # 1 / T
    harmonics = np.concatenate([np.zeros(0), *(np.arange(1, n + 1) / period for period, n in periods.items())])
    harmonics = harmonics[(harmonics > at.min(initial=0.0)) & (harmonics < at.max(initial=0.0))]
    kept = np.ones(at.size, dtype=bool)
    for place in np.unique(spectrum.place) if harmonics.size else ():
        here = spectrum.place == place
        leaking = gain[here][np.abs(at[here, None] - harmonics).argmin(axis=0)]
        away = np.abs(at[here, None] - harmonics)
        leak = np.max(4 * leaking / np.maximum(away * np.pi / width, 1.0) ** 2, axis=1)
        kept[here] = (away.min(axis=1) >= width) & (gain[here] > leak)
    return kept


def lines(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str) -> Scan:
    """A sine of any phase and size in each block, along one axis or along all.

    The whitening filter leaves a sine a sine, so that sine and cosine stand for it in the whitened rows.
    """
    grid = frequencies(problem.blocks, channel)
    gain, dof = line_gains(problem, baseline, rest, channel, grid)
    place, at = np.repeat([0, 1, 2, -1], grid.size), np.tile(grid, 4)
    return Scan("line", channel, place, at, gain.reshape(-1, rest[0].shape[1]), dof.ravel())


def line_gains(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str, grid: np.ndarray):
    """Gain (4, f, d) and parameters (4, f) of a line at frequencies (f,) Hz: on each axis, then on all together."""
    count = rest[0].shape[1]
    inverse = inverse_of_baseline(problem, baseline)
    gain, dof = np.zeros((4, grid.size, count)), np.zeros((4, grid.size), dtype=int)
    for i in range(len(problem.blocks)):
        for axis in range(3):
            rows, waves, own = _waves(problem, i, channel, axis, grid)
            if waves is None:
                continue
            columns = problem.columns[i].of(baseline)[rows]
            there = np.flatnonzero(columns.any(axis=0))
            cross = waves(columns[:, there])
            part = (cross.reshape(2 * grid.size, there.size) @ inverse[np.ix_(there, there)]).reshape(cross.shape)
            inner, right = own - part @ cross.swapaxes(1, 2), waves(rest[i][rows])
            a, b, c = (inner[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
            both = c * right[:, 0] ** 2 - 2 * b * right[:, 0] * right[:, 1] + a * right[:, 1] ** 2
            gain[axis] += both / (a * c - b**2)
            dof[axis] += 2
    gain[3], dof[3] = gain[:3].sum(axis=0), dof[:3].sum(axis=0)
    return gain, dof


def _waves(problem, index, channel, axis, grid):
    """Rows of an axis in a block, `waves_at` there, products (f, 2, 2) beside local columns; None, None if under 40."""
    key = ("waves", index, channel, axis, grid.tobytes())
    if key not in problem.memory:
        block = problem.blocks[index]
        rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & weighted_rows(block))
        if rows.size < 40:
            problem.memory[key] = rows, None, None
        else:
            waves = waves_at(block.time[rows], grid)
            inside = waves(problem.bases[index][rows])
            own = _squares(block.time[rows], grid) - inside @ inside.swapaxes(1, 2) + 1e-9 * rows.size * np.eye(2)
            problem.memory[key] = rows, waves, own
    return problem.memory[key]


def waves_at(time: np.ndarray, grid: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Function of signals (n, q) -> products (f, 2, q) with cosine and sine of every frequency, from the first time on.

    A day has as many frequencies as records, so that their columns would be many gigabytes: none are kept. Evenly
    spaced records (with gaps; a twentieth of the spacing is not heeded) are transformed. Time (n,) s ascends, grid Hz.
    """
    spacing = float(np.median(np.diff(time)))
    place = np.rint((time - time[0]) / spacing).astype(int)
    length = int(np.rint(1 / (spacing * np.diff(grid).min()))) if grid.size > 1 else 1
    length *= -(-(place[-1] + 1) // max(length, 1))
    number = grid * length * spacing
    shift = np.abs(number - np.rint(number)).max(initial=0.0) * np.ptp(time) / (max(length, 1) * spacing)
    even = np.abs(time - time[0] - place * spacing).max() < 0.05 * spacing and np.all(np.diff(place) > 0)
    shorter = length * np.log2(max(length, 2)) < time.size * grid.size  # than products with a few close frequencies
    if even and shorter and grid.size > 1 and length > 0 and shift < 0.01:
        return partial(_transformed, place, length, np.rint(number).astype(int))
    return partial(_multiplied, time - time[0], grid)


def _transformed(place, length, number, signals):
    """Products (f, 2, q) by a transform of records at even places."""
    spread = np.zeros((place[-1] + 1, signals.shape[1]))
    spread[place] = signals
    folded = number % length
    sign = np.where(folded > length // 2, 1.0, -1.0)[:, None]
    spectrum = fft.rfft(spread, length, axis=0)[np.minimum(folded, length - folded)]
    return np.stack([spectrum.real, sign * spectrum.imag], axis=1)


def _multiplied(time, grid, signals):
    """The same of records at any times, a few frequencies at once."""
    made = np.empty((grid.size, 2, signals.shape[1]))
    at_once = max(TABLE // time.size, 1)
    for first in range(0, grid.size, at_once):
        part = slice(first, first + at_once)
        phase = 2 * np.pi * np.outer(grid[part], time)
        made[part, 0], made[part, 1] = np.cos(phase) @ signals, np.sin(phase) @ signals
    return made


def _squares(time, grid):
    """Products (f, 2, 2) of cosine and sine at the times (n,) with each other."""
    cosine, sine = np.moveaxis(waves_at(time, grid * 2)(np.ones((time.size, 1)))[..., 0], 1, 0) / 2
    half = time.size / 2
    return np.stack([np.stack([half + cosine, sine], axis=1), np.stack([sine, half - cosine], axis=1)], axis=2)


def sine_columns(block: Block, channel: str, frequency: float, axes) -> np.ndarray:
    """Sine and cosine (n, 2 a) of a frequency Hz in the whitened rows of some axes of a channel."""
    columns = np.zeros((block.observed.size, 2 * len(axes)))
    for k, axis in enumerate(axes):
        rows = (block.channel == channel) & (block.axis == axis) & weighted_rows(block)
        phase = 2 * np.pi * frequency * block.time[rows]
        columns[rows, 2 * k], columns[rows, 2 * k + 1] = np.cos(phase), np.sin(phase)
    return columns


def side_by_side(parts: list[np.ndarray], groups) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns (n, q g) of each block with its part (n, q) at the place of its group, and those (q g,) in use."""
    width = parts[0].shape[1]
    columns = [np.zeros((part.shape[0], width * (max(groups) + 1))) for part in parts]
    for whole, part, group in zip(columns, parts, groups, strict=True):
        whole[:, width * group : width * (group + 1)] = part
    return columns, np.sum([np.sum(whole**2, axis=0) for whole in columns], axis=0) > 0


TABLE = 1 << 21  # cosines that are made at once
SHORTEST, NARROWEST = 32, 2  # samples of a stretch, bins of its spectrum, of the smallest tile of time and frequency
LONGEST = {"tile": 50_000, "slow": 50_000, "chirp": 2048, "drift": 2048}  # samples of a block in which they are tried
FAST = {"reassoc", "contract", "nnan"}  # what compiled sums may do
FEWEST = 4.0  # degrees of freedom that the model leaves of a tile, to be looked at


@dataclass(frozen=True)
class Excess:
    """The most unusual place of a channel in time and frequency."""

    kind: str  #: "tile", "slow", "chirp", or "drift" of a line through all blocks
    channel: str  #: name
    axis: int  #: -1 for all
    block: int  #: number; -1 for all
    span: tuple[float, float]  #: (2,) s from the first row of the block
    band: tuple[float, float]  #: (2,) Hz; of a chirp or a drifting line where it begins and where it ends
    #: (d,) log of the probability of so unusual a place, corrected for how many there are, of each residual
    log_p: np.ndarray
    score: float  #: power less twice its degrees of freedom, to choose among several


def excess(problem: Problem, rest: list[np.ndarray], channel: str) -> list[Excess]:
    """Where there is most power beyond that of drawn noise after the same fit: in a tile, at its slow end, on a path.

    Tiles are stretches of 1/2^k of a block and bands of 2^k bins of their spectrum; chirps pass through a band at a
    steady rate in the whole of a block. Both on an axis or on all, in a block or in all at the same time from its
    start. A line whose frequency drifts steadily from the first block to the last has a phase of its own in each. The
    slow end of the spectrum of all blocks has weights that fall with the square of frequency from 2^k bins on, as power
    does of what jumps at random (Papoulis, Probability, ch. 10). Residuals (n, 1 + d) are observed and drawn.
    """
    numbers, begins, spacing, series = _series(problem.blocks, rest, channel)
    excesses, drifts = [], partial(_drifts, np.array(begins), spacing)
    for kind, made in (("tile", _tiles), ("slow", _slow), ("chirp", _chirps), ("drift", drifts)):
        best, count = (-np.inf,), 0
        most = np.full(rest[0].shape[1], -np.inf)
        for spans, bands, of_axes in made(series) if numbers and series[0].shape[1] <= LONGEST[kind] else ():
            named = [*enumerate(of_axes if len(of_axes) > 1 else ()), (-1, sum(of_axes))]  # a channel may have one axis
            for axis, of_blocks in named:
                apart = zip(numbers, of_blocks, strict=True) if kind in ("tile", "chirp") else ()
                for block, each in [*apart, (-1, of_blocks.sum(axis=0))]:
                    score = _deviations(each, most)
                    count += int(np.sum(np.isfinite(score)))
                    if most[0] > best[0]:
                        place = int(score.argmax())
                        above = each[place, 0] - 2 * each[place, 1:].mean()
                        best = most[0], axis, block, spans[place], bands[place], above
        if count and np.isfinite(best[0]):
            log_p = special.log_ndtr(-most) + np.log(count)
            span, band = tuple(best[3] * spacing), tuple(best[4] / spacing)
            excesses.append(Excess(kind, channel, *best[1:3], span, band, log_p, float(best[5])))
    return excesses


def level_error(problem: Problem, baseline: np.ndarray, parts: list[np.ndarray], spectra: Mapping) -> float:
    """Error of the logarithm of the noise where signals (n, 1) have their power, by spectra {channel: of its axes}."""
    rest, variance = residuals_of(problem, baseline, parts), 0.0
    whole = sum(float(np.sum(one**2)) for one in rest)
    for channel, axes in spectra.items():
        *_, spacing, series = _series(problem.blocks, rest, channel)
        for spectrum, one in zip(axes, series, strict=False):
            power = _power(one).sum(axis=(0, 2)) / max(whole, 1e-300)
            share = spectrum.shares(np.arange(1, power.size + 1) / (one.shape[1] * spacing)).T @ power
            variance += share @ spectrum.covariance @ share
    return float(np.sqrt(variance))


def _series(blocks, rest, channel):
    """Blocks that hold a channel, begin s of each, spacing s, and of each axis their rows (b, n, d).

    Rows are at their place in time, nothing where a block has none.
    """
    axes = range(1 + max((int(b.axis[b.channel == channel].max(initial=0)) for b in blocks), default=0))
    rows = [[(b.channel == channel) & (b.axis == axis) for axis in axes] for b in blocks]
    at = {k: [b.time[here] for here in rows[k]] for k, b in enumerate(blocks)}
    at = {k: one for k, one in at.items() if min(time.size for time in one) >= SHORTEST}
    if not at:
        return (), (), np.nan, []
    spacing = float(np.median([np.median(np.diff(np.sort(one[0]))) for one in at.values()]))
    begins = {k: min(time.min() for time in one) for k, one in at.items()}
    at = {k: [np.rint((time - begins[k]) / spacing).astype(int) for time in one] for k, one in at.items()}
    size = {k: 1 + max(place.max() for place in one) for k, one in at.items()}
    kept = sorted((k for k in at if size[k] > 0.9 * max(size.values())), key=begins.get)
    length = fft.prev_fast_len(min(size[k] for k in kept))
    series = [np.zeros((len(kept), length, rest[0].shape[1]), dtype="f4") for _ in axes]
    for (row, k), axis in itertools.product(enumerate(kept), axes):
        inside = at[k][axis] < length
        series[axis][row, at[k][axis][inside]] = rest[k][rows[k][axis]][inside]
    return tuple(kept), [begins[k] for k in kept], spacing, series


@njit(cache=True, fastmath=FAST)
def _deviations(power, most):
    """Standard deviations (k,) by which the first column of power (k, d) is above that of all others.

    By Wilson and Hilferty; the degrees of freedom are the mean of sums of squares of unit variance, less where these
    are weighted. The largest (d,) of every column are raised in place; what cannot raise them needs no cube root.
    """
    first, least = np.full(len(power), -np.inf), most.min()
    for k in range(len(power)):
        total, highest, square = 0.0, power[k, 0], 0.0
        for j in range(1, power.shape[1]):
            total += power[k, j]
            highest = max(highest, power[k, j])
        mean = total / (power.shape[1] - 1)
        for j in range(1, power.shape[1]):
            square += (power[k, j] - mean) ** 2
        square /= power.shape[1] - 1
        freedom = min(mean, 2 * mean**2 / max(square, 1e-6))
        if freedom >= FEWEST:
            spread = 2 / (9 * freedom)
            root = np.sqrt(spread)
            first[k] = (np.cbrt(power[k, 0] / mean) - 1 + spread) / root
            if highest > mean * (1 - spread + least * root) ** 3:
                for j in range(power.shape[1]):
                    if power[k, j] > mean * (1 - spread + most[j] * root) ** 3:
                        most[j] = (np.cbrt(power[k, j] / mean) - 1 + spread) / root
                least = most.min()
    return first


def _tiles(series):
    """Tiles of every length of stretch: spans and bands (k, 2) in samples and their inverse, power of each axis."""
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
    """Power (..., f, d) of a number of unit variance for each degree of freedom, but for the mean and Nyquist."""
    size = series.shape[-2]
    spectrum = fft.rfft(series, axis=-2)[..., 1 : 1 + (size - 1) // 2, :]
    return _squared(np.ascontiguousarray(spectrum), 2 / size, np.empty(spectrum.shape, "f4"))


def _slow(series):
    """The slow end of the spectrum, as tiles."""
    count = series[0].shape[1]
    bins = (count - 1) // 2
    corners = np.array([c for c in 2 ** np.arange(20) if c <= bins / 4])
    if corners.size:
        weights = 1 / (1 + (np.arange(1, bins + 1) / corners[:, None]) ** 2)
        bands = np.stack([np.ones(corners.size), 1 + corners], axis=1) / count
        of_axes = [np.einsum("kf,bfd->bkd", weights, _power(one), optimize=True) for one in series]
        yield np.array([(0, count)] * corners.size), bands, of_axes


def _chirps(series):
    """Chirps of every rate, as tiles; the first and the last frequency are between zero and the largest.

    A real series has the same power along a rate and its opposite at opposite frequencies: one spectrum gives both, of
    a number of unit variance for each of the two degrees of freedom.
    """
    count, room = series[0].shape[1], {}
    turns = 0.25 * count  # of a rate of half the band in half the time; ends apart by a quarter of a turn
    for step in range(1, int(turns / 2) + 1):
        rate = 4 * step / count**2
        middle, sweep = np.arange(count) / count, rate * count / 2
        kept = np.flatnonzero((middle > sweep) & (middle < 0.5 - sweep))
        if kept.size:
            low, high, of_axes = kept[0], kept[-1] + 1, []
            for one in series:
                power = _turned(one, rate, room)
                both = power[:, low:high], power[:, 1 - high : 1 - low or None][:, ::-1]
                of_axes.append(np.concatenate(both, axis=1))
            rising = middle[kept, None] + [-sweep, sweep]
            yield np.array([(0, count)] * 2 * kept.size), np.concatenate([rising, rising[:, ::-1]]), of_axes


def _turned(series, rate, room):
    """Power (b, n, d) of a series turned so that a chirp of this rate is a line; rooms for arrays take long to get."""
    if series.shape not in room:
        room[series.shape] = np.empty(series.shape, "c8"), np.empty(series.shape, "f4")
    turned, power = room[series.shape]
    away = np.arange(series.shape[1]) - series.shape[1] / 2
    _multiply(series, np.exp(-1j * np.pi * rate * away**2).astype("c8"), turned)
    return _squared(fft.fft(turned, axis=1, overwrite_x=True), 2 / series.shape[1], power)


@njit(cache=True, fastmath=FAST)
def _multiply(series, turn, out):
    """Series (b, n, d) times a complex number (n,) at each epoch."""
    for i, k in np.ndindex(series.shape[:2]):
        for j in range(series.shape[2]):
            out[i, k, j] = series[i, k, j] * turn[k]


@njit(cache=True, fastmath=FAST)
def _squared(spectrum, factor, power):
    """Squares (...) of complex numbers times a factor, written to power."""
    source, target, scale = spectrum.reshape(-1), power.reshape(-1), np.float32(factor)
    for k in range(source.size):
        target[k] = scale * (source[k].real ** 2 + source[k].imag ** 2)
    return power


def _drifts(begins, spacing, series):
    """Lines whose frequency drifts by two bins or more between the first and the last block, as tiles.

    Each block is turned as the line drifts there.
    """
    count, rooms = series[0].shape[1], [{} for _ in series]
    away = (begins - np.mean([begins.min(), begins.max()])) / spacing if len(begins) > 2 else np.zeros(1)
    half, last, turned = away.max(), None, []
    for ends in range(-(count // 4), count // 4 + 1) if half > 0 else ():
        shift = np.rint(ends * away / half).astype(int)
        kept = np.arange(1 + abs(ends), (count - 1) // 2 - abs(ends))
        if abs(ends) > 1 and kept.size:
            step = round(ends / half * count / 4)
            if step != last:
                turned = [_turned(one, 4 * step / count**2, room) for one, room in zip(series, rooms, strict=True)]
            low, high, last = kept[0], kept[-1] + 1, step
            far = ends * (1 + count / (2 * half))
            moved = ([row[low + m : high + m] for row, m in zip(one, shift, strict=True)] for one in turned)
            yield np.array([(0, count)] * kept.size), (kept[:, None] + [-far, far]) / count, [*map(np.stack, moved)]
