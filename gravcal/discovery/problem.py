"""All columns of all blocks, their products with each block's local columns projected out, and residuals of a baseline.

The baseline is given by the indices (p,) of the columns that are fitted, of the column 0 the observed rows.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.estimation.least_squares import orthonormal
from gravcal.estimation.noise import Spectrum, fit_noise, whiten
from gravcal.estimation.records import Block, Candidate


def inverse_of(inner: np.ndarray) -> np.ndarray:
    """Inverse (p, p) of products of columns of any units, without directions of rounding, singular or below zero."""
    size = np.diag(inner)
    half = root_of(np.where(np.outer(size > 0, size > 0), inner, 0.0), lambda values: 1e-12 * values.max(initial=0.0))
    return half @ half.T


def root_of(inner: np.ndarray, least: Callable | float, size: np.ndarray | None = None) -> np.ndarray:
    """Root (p, r) of the inverse of products (p, p) over sizes (p,), the norms if not given, of what is seen of them.

    Seen are the directions above a least value, or above what a function of all values gives.
    """
    size = np.sqrt(np.maximum(np.diag(inner), 0.0)) if size is None else size
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(inner / np.outer(scale, scale))
    observable = values > (least(values) if callable(least) else least)
    return vectors[:, observable] / np.sqrt(values[observable]) / scale[:, None]


DEPENDENT = 3e-6  # share of the largest singular value: local columns that hardly differ are one
GROUPS = 12  # of rows, at most; a block whose channels alternate is one group
REMEMBERED = 8  # choices of columns
#: Share of the square of a column that is rounding when its part along the local columns is taken off.
ROUNDING = 1e-13
#: Share of a column that its size keeps at least, so that no rounding counts as seen.
LEAST = 0.03


@dataclass(frozen=True)
class Part:
    """Columns that are not zero in a group of rows."""

    rows: slice  #: slice
    index: np.ndarray  #: (k,) of the columns
    values: np.ndarray  #: (n, k) their rows


@dataclass(frozen=True)
class Columns:
    """Columns of a block."""

    count: int  #: number of columns
    groups: list[slice]  #: slices of rows, one a channel
    parts: list[Part]  #: list of Part
    basis: np.ndarray  #: (n, r) orthonormal basis of the block's local columns
    inside: np.ndarray  #: (r, m) products of basis and columns
    memory: dict = field(default_factory=dict)  #: choices of columns without local columns, made once

    def of(self, wanted: np.ndarray) -> np.ndarray:
        """Some columns (n, w), local columns projected out."""
        wanted = np.asarray(wanted, dtype=np.intp)
        key = wanted.tobytes()
        if key not in self.memory:
            if len(self.memory) >= REMEMBERED:
                self.memory.clear()
            self.memory[key] = self.made(wanted)
        return self.memory[key]

    def made(self, wanted: np.ndarray) -> np.ndarray:
        """The same, not remembered; column by column, so that zeros take no memory."""
        made = np.zeros((self.basis.shape[0], wanted.size), order="F")
        if self.basis.shape[1]:
            made = self.basis @ -self.inside[:, wanted]
        for part in self.parts:
            place = np.full(self.count, -1)
            place[part.index] = np.arange(part.index.size)
            here = np.flatnonzero(place[wanted] >= 0)
            made[part.rows, here] += part.values[:, place[wanted[here]]]
        return made

    def row(self, number: int) -> np.ndarray:
        """All columns (m,) in one row, local columns projected out."""
        made = -self.basis[number] @ self.inside
        for part in self.parts:
            if part.rows.start <= number < part.rows.stop:
                made[part.index] += part.values[number - part.rows.start]
        return made

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """Sums of squares (m,) before anything is projected out."""
        total = np.zeros(self.count)
        for part in self.parts:
            total[part.index] += np.einsum("nk,nk->k", part.values, part.values)
        return total

    def products(self, total: np.ndarray | None = None) -> np.ndarray:
        """Products (m, m) with each other, local columns projected out; zero for what lies along local columns."""
        total = np.negative(self.inside.T @ self.inside, out=total)
        for one, other in itertools.product(self.parts, repeat=2):
            if one.rows == other.rows:
                total[np.ix_(one.index, other.index)] += one.values.T @ other.values
        return without_rounding(total, self.squares)

    def onto(self, signals: np.ndarray) -> np.ndarray:
        """Products (m, d) with signals (n, d) that have no local columns left in them."""
        total = np.zeros((self.count, signals.shape[1]))
        for part in self.parts:
            total[part.index] += part.values.T @ signals[part.rows]
        return total

    def wider(self, more: np.ndarray) -> Columns:
        """With more columns (n, q) after these."""
        index = self.count + np.arange(more.shape[1])
        occupied = [(rows, np.flatnonzero(more[rows].any(axis=0))) for rows in self.groups]
        parts = [Part(rows, index[used], more[rows][:, used]) for rows, used in occupied if used.size]
        inside = np.concatenate([self.inside, self.basis.T @ more], axis=1)
        return replace(self, count=self.count + index.size, parts=[*self.parts, *parts], inside=inside, memory={})


def without_rounding(products: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Products (m, m) less local columns, in place, zero where what is left of their squares (m,) is rounding."""
    lost = np.diag(products) <= ROUNDING * squares
    products[lost] = 0.0
    products[:, lost] = 0.0
    return products


def columns_of(channel: np.ndarray, basis: np.ndarray, pieces: Sequence[np.ndarray | None], widths) -> Columns:
    """Columns from pieces (n, q) of these widths side by side, None where all is zero; channels (n,) part the rows."""
    ends = np.cumsum([0, *widths])
    starts = np.concatenate([[0], 1 + np.flatnonzero(channel[1:] != channel[:-1]), [channel.size]]).tolist()
    groups = [slice(*one) for one in itertools.pairwise(starts if len(starts) <= GROUPS + 1 else (0, channel.size))]
    parts, inside = [], np.zeros((basis.shape[1], ends[-1]))
    for rows in groups:
        used = [k for k, piece in enumerate(pieces) if piece is not None and piece[rows].any()]
        if used:
            index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in used])
            parts.append(Part(rows, index, np.concatenate([pieces[k][rows] for k in used], axis=1)))
            inside[:, index] += basis[rows].T @ parts[-1].values
    return Columns(int(ends[-1]), groups, parts, basis, inside)


@dataclass(frozen=True)
class Problem:
    """What the rounds work on."""

    blocks: list[Block]
    candidates: list[Candidate]  #: as handed over, then causes found along the time or frequency axis
    columns: list[Columns]  #: of each block: observed, shared, candidates
    gram: np.ndarray  #: (b, m, m) products of these columns
    places: list[slice]  #: of each candidate
    size: np.ndarray  #: (m,) norm beside local columns, to which what is seen beside a baseline is compared
    samples: np.ndarray  #: (b,) rows that carry weight, less local columns
    memory: dict = field(default_factory=dict)  #: what follows from the blocks alone, made once

    @property
    def bases(self) -> list[np.ndarray]:
        """Orthonormal basis (n, r) of the local columns of each block."""
        return [columns.basis for columns in self.columns]

    @property
    def shared(self) -> slice:
        """Place of the global columns."""
        return slice(1, 1 + self.blocks[0].global_columns.shape[1])

    @functools.cached_property
    def total(self) -> np.ndarray:
        """Products (m, m) of the columns, all blocks together."""
        return self.gram.sum(axis=0)


def prepare(blocks: list[Block], candidates: list[Candidate]) -> Problem:
    """Problem of blocks and candidates."""
    widths = [1, blocks[0].global_columns.shape[1], *(len(c.names) for c in candidates)]
    ends = np.cumsum(widths)[1:]
    places = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    columns, samples, gram = [], [], np.empty((len(blocks), ends[-1], ends[-1]))
    for index, block in enumerate(blocks):
        pieces = [block.observed[:, None], block.global_columns, *(c.columns[index] for c in candidates)]
        columns.append(columns_of(block.channel, orthonormal(block.local_columns, DEPENDENT), pieces, widths))
        used = np.any(np.column_stack([block.observed, block.local_columns]) != 0, axis=1)
        samples.append(float(used.sum() - columns[-1].basis.shape[1]))
        columns[-1].products(gram[index])
    size = _size(gram, [one.squares for one in columns])
    return Problem(blocks, list(candidates), columns, gram, places, size, np.array(samples))


def _size(gram, squares):
    """Norm (m,) of columns less own ones, from their products (m, m) and squares (m,) in each block."""
    return np.sqrt(np.maximum(sum(np.diag(one) for one in gram), LEAST**2 * sum(squares)))


def extended(problem: Problem, candidate: Candidate) -> Problem:
    """Problem with one more candidate."""
    count = len(candidate.names)
    place = slice(problem.size.size, problem.size.size + count)
    columns, gram, squares = [], np.zeros((len(problem.blocks), place.stop, place.stop)), []
    for old, products, wider, part in zip(problem.columns, problem.gram, gram, candidate.columns, strict=True):
        new = np.zeros((old.basis.shape[0], count), order="F") if part is None else np.asarray(part, dtype=float)
        columns.append(old.wider(new))
        wider[: place.start, : place.start] = products
        wider[:, place] = columns[-1].onto(columns[-1].made(np.arange(place.start, place.stop)))
        wider[place] = wider[:, place].T
        squares.append(np.einsum("nm,nm->m", new, new))
        without_rounding(wider, np.append(np.zeros(place.start), squares[-1]))
    size = np.append(problem.size, _size(gram[:, place, place], squares))
    more = {"candidates": [*problem.candidates, candidate], "places": [*problem.places, place]}
    return replace(problem, columns=columns, gram=gram, size=size, **more)


def halves(problem: Problem, index: int, segment_s: float, wanted: np.ndarray) -> np.ndarray:
    """Products (2, m, m) of the observed and wanted (w,) columns of a block in alternate stretches of so many seconds.

    Local columns are free in each half, as edges and drifts of one half say nothing of the other. A block shorter than
    a stretch is parted row by row.
    """
    block = problem.blocks[index]
    columns = problem.columns[index].of(np.append(0, wanted))
    first = np.floor((block.time - block.time.min()) / segment_s) % 2 == 0
    if first.all():  # a block of few numbers, such as edge times
        first = np.arange(block.time.size) % 2 == 0
    parts = []
    for rows in (first, ~first):
        basis = orthonormal(block.local_columns[rows], DEPENDENT)
        part = columns[rows] - basis @ (basis.T @ columns[rows])
        parts.append(part.T @ part)
    return np.stack(parts)


def baseline_of(problem: Problem, indices) -> np.ndarray:
    """Indices (p,) of the global columns and of those of some candidates, by their indices."""
    shared = np.arange(problem.shared.start, problem.shared.stop)
    parts = [np.arange(problem.places[k].start, problem.places[k].stop) for k in indices]
    return np.concatenate([shared, *parts]).astype(int)


def residuals_of(
    problem: Problem, baseline: np.ndarray, noise: list[np.ndarray], *, over: bool = False
) -> list[np.ndarray]:
    """Signals (n, d) a block less the best fit of own and baseline columns; written over them where that is wanted."""
    return best_fit(problem, baseline, noise, over=over)[1]


def best_fit(problem: Problem, baseline: np.ndarray, noise, *, over: bool = False) -> tuple[np.ndarray, list]:
    """Baseline parameters (p, d) beside local columns in signals (n, d) a block, and what that leaves of these."""
    pairs = zip(noise, problem.bases, strict=True)
    rest = [np.subtract(e, q @ (q.T @ e), out=e if over else None) for e, q in pairs]
    right = sum(c.of(baseline).T @ r for c, r in zip(problem.columns, rest, strict=True))
    value = inverse_of_baseline(problem, baseline) @ right
    return value, [np.subtract(r, c.of(baseline) @ value, out=r) for c, r in zip(problem.columns, rest, strict=True)]


def inverse_of_baseline(problem: Problem, baseline: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the baseline parameters."""
    return inverse_of(problem.total[np.ix_(baseline, baseline)])


def observed_rows(problem: Problem) -> list[np.ndarray]:
    """Observed rows (n, 1) of every block."""
    return [c.of(np.zeros(1)) for c in problem.columns]


def random_source(seed: int, blocks) -> np.random.Generator:
    """Source of the draws of an event: its own, so that the probabilities of several events do not err alike."""
    return np.random.default_rng([seed, *(abs(int(b.time.min())) for b in blocks if b.time.size)])


def drawn_noise(
    problem: Problem,
    count: int,
    quiet: Mapping[str, float],
    rng: np.random.Generator,
    order: Mapping[str, int] | None = None,
    spectra: Mapping[str, Sequence[Spectrum]] | None = None,
) -> list[np.ndarray]:
    """Noise (n, count) of every block, with the error of the noise model that it was whitened with.

    A model from N quiet samples is off by 1/sqrt(2 N) of its size, and each of its coefficients by 1/sqrt(N): whitened
    noise keeps as much of its neighbours (Brockwell and Davis, Time Series, ch. 8); spectra say for each frequency how
    far they are off; the amplitude in each block is off as that block says. A model that was measured in the rows, a
    channel without quiet samples, has made them whiter than noise is, and every draw goes through the same fit of so
    many coefficients (order).
    """
    channels, spectra = sorted({c for b in problem.blocks for c in b.channel}), spectra or {}
    error = {c: np.sqrt(2 / quiet[c]) if quiet.get(c) and c not in spectra else 0.0 for c in channels}
    known = {c: (order or {}).get(c, 0) if error[c] else 0 for c in channels}
    both = [(c, a) for c in channels for a in range(3)]
    scale = {place: 1 + error[place[0]] / 2 * rng.standard_normal(count) for place in both}
    shape = {(c, a): error[c] / np.sqrt(2) * rng.standard_normal((known[c], count)) for c, a in both}
    axes = [((c, a), one) for c in spectra for a, one in enumerate(spectra[c])]
    off = {at: rng.multivariate_normal(one.log_density, one.covariance, count) - one.log_density for at, one in axes}
    rows = []
    for block in problem.blocks:
        noise = rng.standard_normal((block.observed.size, count), dtype=np.float32)
        noise[~weighted_rows(block)] = 0.0
        for (channel, axis), factor in scale.items():
            here = (block.channel == channel) & (block.axis == axis)
            own = block.level_error.get((channel, axis), 0.0)
            factor = factor * np.exp(own * rng.standard_normal(count)) if own else factor
            mixed = noise[here]
            for k, share in enumerate(shape[channel, axis].astype(np.float32), start=1):
                mixed[k:] += share * noise[here][:-k]
            if (channel, axis) in off and mixed.size:
                wave = np.fft.rfftfreq(len(mixed), float(np.median(np.diff(block.time[here]))))
                gain = np.exp(spectra[channel][axis].shares(wave) @ off[channel, axis].T / 2)
                mixed = np.fft.irfft(np.fft.rfft(mixed, axis=0) * gain, len(mixed), axis=0)
            noise[here] = mixed * factor.astype(np.float32)
        rows.append(noise)
    for channel, coefficients in (order or {}).items():
        for axis in range(3) if not quiet.get(channel) else ():
            _whitened(problem.blocks, rows, (channel, axis), coefficients)
    return rows


def _whitened(blocks, rows, place, order):
    """Every draw of a channel and axis by the model that is fitted to all its blocks together, in place."""
    here = [weighted_rows(b) & (b.channel == place[0]) & (b.axis == place[1]) for b in blocks]
    here = [(row, at) for row, at in zip(rows, here, strict=True) if at.any()]
    for draw in range(rows[0].shape[1] if here else 0):
        pieces = [row[at, draw].astype(float) for row, at in here]
        model = fit_noise(pieces, order, 1.0)
        for (row, at), piece in zip(here, pieces, strict=True):
            row[at, draw] = whiten(model, piece, np.ones(piece.size, dtype=bool))


def weighted_rows(block) -> np.ndarray:
    """Rows (n,) that carry weight."""
    return (block.observed != 0) | np.any(block.local_columns != 0, axis=1) | np.any(block.global_columns != 0, axis=1)
