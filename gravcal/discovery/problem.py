"""All columns of all blocks, their Gram matrices with local columns projected out, and residuals of a baseline.

Column 0 is the observed rows; a baseline is the indices (p,) of the columns that are fitted.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.estimation.least_squares import orthonormal, score, stable_inverse
from gravcal.estimation.noise import Spectrum, fit_noise, whiten
from gravcal.estimation.records import Block, Candidate


def inverse_of(inner: np.ndarray) -> np.ndarray:
    """Pseudo-inverse (p, p) of a Gram matrix of columns of any units, directions of rounding or below zero dropped."""
    size = np.diag(inner)
    root = root_of(np.where(np.outer(size > 0, size > 0), inner, 0.0), lambda values: 1e-12 * values.max(initial=0.0))
    return root @ root.T


def root_of(inner: np.ndarray, least: Callable | float, size: np.ndarray | None = None) -> np.ndarray:
    """Root R (p, r), R R' the pseudo-inverse of a Gram matrix (p, p), over its r observable directions.

    Those whose eigenvalue, columns divided by size (p,) or else their norms, exceeds least, or least(eigenvalues).
    """
    size = np.sqrt(np.maximum(np.diag(inner), 0.0)) if size is None else size
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(inner / np.outer(scale, scale))
    observable = values > (least(values) if callable(least) else least)
    return vectors[:, observable] / np.sqrt(values[observable]) / scale[:, None]


DEPENDENT = 3e-6  # share of the largest singular value, below which a direction of local columns is dropped
GROUPS = 12  # of rows in a block, at most; a block whose channels alternate is one group
REMEMBERED = 8  # selections of columns that a block caches
#: Share of the square of a column below which what local columns leave of it is rounding.
ROUNDING = 1e-13
#: Least size of a column as a share of its norm before projection, so that rounding never counts as signal.
LEAST = 0.03


@dataclass(frozen=True)
class Part:
    """Columns that are not zero in a group of rows."""

    rows: slice  #: of the group
    index: np.ndarray  #: (k,) of the columns
    values: np.ndarray  #: (n, k) their rows


@dataclass(frozen=True)
class Columns:
    """Columns (n, m) of a block, kept where they are not zero: observed, shared, those of candidates."""

    count: int  #: number of columns
    groups: list[slice]  #: slices of rows, one a stretch of one channel
    parts: list[Part]  #: list of Part
    basis: np.ndarray  #: (n, r) orthonormal basis of the block's local columns
    inside: np.ndarray  #: (r, m) products of basis and columns
    memory: dict = field(default_factory=dict)  #: cache of `of`

    def of(self, wanted: np.ndarray) -> np.ndarray:
        """Columns (n, w) at indices wanted (w,), local columns projected out; cached."""
        wanted = np.asarray(wanted, dtype=np.intp)
        key = wanted.tobytes()
        if key not in self.memory:
            if len(self.memory) >= REMEMBERED:
                self.memory.clear()
            self.memory[key] = self.made(wanted)
        return self.memory[key]

    def made(self, wanted: np.ndarray) -> np.ndarray:
        """Columns (n, w) as of `of`, not cached; in column order, so that zero columns take no memory."""
        columns = np.zeros((self.basis.shape[0], wanted.size), order="F")
        if self.basis.shape[1]:
            columns = self.basis @ -self.inside[:, wanted]
        for part in self.parts:
            position = np.full(self.count, -1)
            position[part.index] = np.arange(part.index.size)
            present = np.flatnonzero(position[wanted] >= 0)
            columns[part.rows, present] += part.values[:, position[wanted[present]]]
        return columns

    def row(self, number: int) -> np.ndarray:
        """All columns (m,) at one row of the block, local columns projected out."""
        values = -self.basis[number] @ self.inside
        for part in self.parts:
            if part.rows.start <= number < part.rows.stop:
                values[part.index] += part.values[number - part.rows.start]
        return values

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """Sum of squares (m,) of each column before local columns are projected out."""
        total = np.zeros(self.count)
        for part in self.parts:
            total[part.index] += np.einsum("nk,nk->k", part.values, part.values)
        return total

    def products(self, total: np.ndarray | None = None) -> np.ndarray:
        """Gram (m, m) of the columns, local columns projected out, written to total; zero for what lies along these."""
        total = np.negative(self.inside.T @ self.inside, out=total)
        for one, other in itertools.product(self.parts, repeat=2):
            if one.rows == other.rows:
                total[np.ix_(one.index, other.index)] += one.values.T @ other.values
        return without_rounding(total, self.squares)

    def onto(self, signals: np.ndarray) -> np.ndarray:
        """Products (m, d) of the columns with signals (n, d) that have local columns projected out already."""
        total = np.zeros((self.count, signals.shape[1]))
        for part in self.parts:
            total[part.index] += part.values.T @ signals[part.rows]
        return total

    def wider(self, more: np.ndarray) -> Columns:
        """The columns with more (n, q) appended."""
        index = self.count + np.arange(more.shape[1])
        occupied = [(rows, np.flatnonzero(more[rows].any(axis=0))) for rows in self.groups]
        parts = [Part(rows, index[used], more[rows][:, used]) for rows, used in occupied if used.size]
        inside = np.concatenate([self.inside, self.basis.T @ more], axis=1)
        return replace(self, count=self.count + index.size, parts=[*self.parts, *parts], inside=inside, memory={})


def without_rounding(products: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Gram (m, m) less local columns, in place, zero for columns of which only rounding of squares (m,) is left."""
    lost = np.diag(products) <= ROUNDING * squares
    products[lost] = 0.0
    products[:, lost] = 0.0
    return products


def columns_of(channel: np.ndarray, basis: np.ndarray, pieces: Sequence[np.ndarray | None], widths) -> Columns:
    """Columns of a block from pieces (n, q_i), None if zero, of widths (i,); runs of channel (n,) group the rows."""
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
    """Blocks and candidates of a search, with all columns and their Gram matrices."""

    blocks: list[Block]
    candidates: list[Candidate]  #: as handed over, then causes found along the time or frequency axis
    columns: list[Columns]  #: of each block; index 0 observed, then shared, then candidates
    gram: np.ndarray  #: (b, m, m) products of these columns, local ones projected out
    places: list[slice]  #: columns of each candidate
    size: np.ndarray  #: (m,) norm less local columns, the scale of what a baseline leaves of a column
    samples: np.ndarray  #: (b,) number of rows that carry weight, less that of local columns
    memory: dict = field(default_factory=dict)  #: what follows from the blocks alone, made once
    floored: bool = False  #: as in `Choice`

    @property
    def bases(self) -> list[np.ndarray]:
        """Orthonormal basis (n, r) of the local columns of each block."""
        return [columns.basis for columns in self.columns]

    @property
    def shared(self) -> slice:
        """Slice of the global columns."""
        return slice(1, 1 + self.blocks[0].global_columns.shape[1])

    @functools.cached_property
    def total(self) -> np.ndarray:
        """Products (m, m) of the columns, all blocks together."""
        return self.gram.sum(axis=0)


def less_calibration(blocks: Sequence[Block]) -> tuple[list[Block], np.ndarray]:
    """Blocks less what their global columns explain by least squares, and the parameters (p,) of these.

    Beside the whole motion the products of columns lose by rounding what an effect of nearly its shape leaves.
    """
    scores = [score(block.observed, block.global_columns, block.local_columns) for block in blocks]
    explained = stable_inverse(sum(one.normal for one in scores)) @ sum(one.right for one in scores)
    return [replace(b, observed=b.observed - b.global_columns @ explained) for b in blocks], explained


def prepare(blocks: list[Block], candidates: list[Candidate]) -> Problem:
    """Problem of blocks and candidates, with the Gram matrices of all columns."""
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
    """Norm (m,) of columns less local ones over all blocks, from Gram (b, m, m) and whole squares [(m,)]."""
    return np.sqrt(np.maximum(sum(np.diag(one) for one in gram), LEAST**2 * sum(squares)))


def extended(problem: Problem, candidate: Candidate) -> Problem:
    """Problem with one more candidate, its columns after all others."""
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
    lists = {"candidates": [*problem.candidates, candidate], "places": [*problem.places, place]}
    return replace(problem, columns=columns, gram=gram, size=size, **lists)


def halves(problem: Problem, index: int, segment_s: float, wanted: np.ndarray) -> np.ndarray:
    """Gram (2, 1 + w, 1 + w) of observed and wanted (w,) columns of a block, even and odd stretches of segment_s s.

    Local columns are free in each half, as edges and drifts of one half say nothing of the other. A block shorter than
    a stretch is split into even and odd rows.
    """
    block = problem.blocks[index]
    columns = problem.columns[index].of(np.append(0, wanted))
    even = np.floor((block.time - block.time.min()) / segment_s) % 2 == 0
    if even.all():  # a block of few numbers, such as edge times
        even = np.arange(block.time.size) % 2 == 0
    parts = []
    for rows in (even, ~even):
        basis = orthonormal(block.local_columns[rows], DEPENDENT)
        part = columns[rows] - basis @ (basis.T @ columns[rows])
        parts.append(part.T @ part)
    return np.stack(parts)


def baseline_of(problem: Problem, indices) -> np.ndarray:
    """Indices (p,) of the global columns and of the columns of some candidates, which indices name."""
    shared = np.arange(problem.shared.start, problem.shared.stop)
    parts = [np.arange(problem.places[k].start, problem.places[k].stop) for k in indices]
    return np.concatenate([shared, *parts]).astype(int)


def residuals_of(
    problem: Problem, baseline: np.ndarray, noise: list[np.ndarray], *, over: bool = False
) -> list[np.ndarray]:
    """Residuals (n, d) of any signals, noise (n, d) a block, after local and baseline columns; in place if over."""
    return best_fit(problem, baseline, noise, over=over)[1]


def best_fit(problem: Problem, baseline: np.ndarray, noise, *, over: bool = False) -> tuple[np.ndarray, list]:
    """Baseline parameters (p, d) fitted to signals, noise (n, d) a block, local columns free; residuals [(n, d)]."""
    pairs = zip(noise, problem.bases, strict=True)
    rest = [np.subtract(e, q @ (q.T @ e), out=e if over else None) for e, q in pairs]
    right = sum(c.of(baseline).T @ r for c, r in zip(problem.columns, rest, strict=True))
    value = inverse_of_baseline(problem, baseline) @ right
    return value, [np.subtract(r, c.of(baseline) @ value, out=r) for c, r in zip(problem.columns, rest, strict=True)]


def inverse_of_baseline(problem: Problem, baseline: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the baseline parameters for noise of unit variance, local columns free."""
    return inverse_of(problem.total[np.ix_(baseline, baseline)])


def observed_rows(problem: Problem) -> list[np.ndarray]:
    """Observed rows (n, 1) of every block, local columns projected out."""
    return [c.of(np.zeros(1)) for c in problem.columns]


def random_source(seed: int, blocks) -> np.random.Generator:
    """Random generator of an event: its own, so that the probabilities of several events do not err alike."""
    return np.random.default_rng([seed, *(abs(int(b.time.min())) for b in blocks if b.time.size)])


def drawn_noise(
    problem: Problem,
    count: int,
    quiet: Mapping[str, float],
    rng: np.random.Generator,
    order: Mapping[str, int] | None = None,
    spectra: Mapping[str, Sequence[Spectrum]] | None = None,
) -> list[np.ndarray]:
    """Draws (n, count) of the whitened noise of every block, with the error of the model that whitened it.

    A model from N quiet samples is off by 1/sqrt(2 N) of its size, and each of its coefficients by 1/sqrt(N): whitened
    noise keeps as much of its neighbours (Brockwell and Davis, Time Series, ch. 8). Spectra are off by
    their covariance, a block's amplitude by `Block.level_error`. A model that was measured in the rows, in a
    channel without quiet samples, has made them whiter than noise is, and every draw is whitened by such a fit, of so
    many coefficients (order).
    """
    channels, spectra = sorted({c for b in problem.blocks for c in b.channel}), spectra or {}
    error = {c: np.sqrt(2 / quiet[c]) if quiet.get(c) and c not in spectra else 0.0 for c in channels}
    orders = {c: (order or {}).get(c, 0) if error[c] else 0 for c in channels}
    pairs = [(c, a) for c in channels for a in range(3)]
    scale = {place: 1 + error[place[0]] / 2 * rng.standard_normal(count) for place in pairs}
    shape = {(c, a): error[c] / np.sqrt(2) * rng.standard_normal((orders[c], count)) for c, a in pairs}
    axes = [((c, a), one) for c in spectra for a, one in enumerate(spectra[c])]
    off = {at: rng.multivariate_normal(one.log_density, one.covariance, count) - one.log_density for at, one in axes}
    rows = []
    for block in problem.blocks:
        noise = rng.standard_normal((block.observed.size, count), dtype=np.float32)
        noise[~weighted_rows(block)] = 0.0
        for (channel, axis), factor in scale.items():
            picked = (block.channel == channel) & (block.axis == axis)
            level = block.level_error.get((channel, axis), 0.0)
            factor = factor * np.exp(level * rng.standard_normal(count)) if level else factor
            coloured = noise[picked]
            for k, share in enumerate(shape[channel, axis].astype(np.float32), start=1):
                coloured[k:] += share * noise[picked][:-k]
            if (channel, axis) in off and coloured.size:
                frequency = np.fft.rfftfreq(len(coloured), float(np.median(np.diff(block.time[picked]))))
                gain = np.exp(spectra[channel][axis].shares(frequency) @ off[channel, axis].T / 2)
                coloured = np.fft.irfft(np.fft.rfft(coloured, axis=0) * gain, len(coloured), axis=0)
            noise[picked] = coloured * factor.astype(np.float32)
        rows.append(noise)
    for channel, coefficients in (order or {}).items():
        for axis in range(3) if not quiet.get(channel) else ():
            _whitened(problem.blocks, rows, (channel, axis), coefficients)
    return rows


def _whitened(blocks, rows, place, order):
    """Whiten in place all draws of a place (channel, axis), each by an AR model fitted to all its blocks together."""
    picked = [weighted_rows(b) & (b.channel == place[0]) & (b.axis == place[1]) for b in blocks]
    picked = [(row, at) for row, at in zip(rows, picked, strict=True) if at.any()]
    for draw in range(rows[0].shape[1] if picked else 0):
        pieces = [row[at, draw].astype(float) for row, at in picked]
        model = fit_noise(pieces, order, 1.0)
        for (row, at), piece in zip(picked, pieces, strict=True):
            row[at, draw] = whiten(model, piece, np.ones(piece.size, dtype=bool))


def weighted_rows(block) -> np.ndarray:
    """True (n,) for the rows of a block that carry weight: observed or any column is not zero."""
    return (block.observed != 0) | np.any(block.local_columns != 0, axis=1) | np.any(block.global_columns != 0, axis=1)
