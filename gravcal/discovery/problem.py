"""All columns of all blocks, and their products with each block's own columns projected out."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.discovery.columns import Columns, columns_of, without_rounding
from gravcal.discovery.linear_algebra import basis_of
from gravcal.estimation.parallel import parallel
from gravcal.estimation.records import Block, Candidate


@dataclass(frozen=True)
class Problem:
    """What the rounds work on.

    Attributes
    ----------
    blocks, candidates : as handed over; causes found along the time or frequency axis are appended to the candidates
    columns : Columns of each block: observed, shared, candidates
    gram : (b, m, m) products of these columns
    places : slice of each candidate; shared : slice
    size : (m,) norm before any projection
    samples : (b,) rows that carry weight, less own columns
    memory : what follows from the blocks alone, made once
    """

    blocks: list[Block]
    candidates: list[Candidate]
    columns: list[Columns]
    gram: np.ndarray
    places: list[slice]
    size: np.ndarray
    samples: np.ndarray
    memory: dict = field(default_factory=dict)

    @property
    def bases(self) -> list[np.ndarray]:
        """Orthonormal basis (n, r) of the own columns of each block."""
        return [columns.basis for columns in self.columns]

    @property
    def shared(self) -> slice:
        """Place of the shared columns."""
        return slice(1, 1 + self.blocks[0].global_columns.shape[1])

    @functools.cached_property
    def total(self) -> np.ndarray:
        """Products (m, m) of the columns, all blocks together."""
        return self.gram.sum(axis=0)


def prepare(blocks: list[Block], candidates: list[Candidate]) -> Problem:
    """Problem of blocks and candidates.

    Parameters
    ----------
    blocks : list of Block
    candidates : list of Candidate
    """
    width = blocks[0].global_columns.shape[1]
    widths = [1, width, *(len(c.names) for c in candidates)]
    ends = np.cumsum(widths)[1:]
    places = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]

    def one(index, block):
        pieces = [block.observed[:, None], block.global_columns, *(c.columns[index] for c in candidates)]
        columns = columns_of(block.channel, basis_of(block.local_columns), pieces, widths)
        return columns, columns.products(), columns.squares, float(_used(block) - columns.basis.shape[1])

    columns, gram, squares, samples = zip(*parallel(one, range(len(blocks)), blocks), strict=True)
    size = np.sqrt(sum(squares))
    return Problem(blocks, list(candidates), list(columns), np.stack(gram), places, size, np.array(samples))


def _used(block):
    return int(np.sum(np.any(np.column_stack([block.observed, block.local_columns]) != 0, axis=1)))


def extended(problem: Problem, candidate: Candidate) -> Problem:
    """Problem with one more candidate.

    Parameters
    ----------
    problem : Problem
    candidate : Candidate
    """
    count = len(candidate.names)
    place = slice(problem.size.size, problem.size.size + count)

    def one(old, products, part):
        new = np.zeros((old.basis.shape[0], count)) if part is None else np.asarray(part, dtype=float)
        both = old.wider(new)
        wider = np.zeros((place.stop, place.stop))
        wider[: place.start, : place.start] = products
        wider[:, place] = both.onto(both.of(np.arange(place.start, place.stop)))
        wider[place] = wider[:, place].T
        squares = np.einsum("nm,nm->m", new, new)
        return both, without_rounding(wider, np.append(np.zeros(place.start), squares)), squares

    columns, gram, squares = zip(*parallel(one, problem.columns, problem.gram, candidate.columns), strict=True)
    size = np.append(problem.size, np.sqrt(sum(squares)))
    more = {"candidates": [*problem.candidates, candidate], "places": [*problem.places, place]}
    return replace(problem, columns=list(columns), gram=np.stack(gram), size=size, **more)


def halves(problem: Problem, index: int, segment_s: float, wanted: np.ndarray) -> np.ndarray:
    """Products of a block's columns in alternate stretches of time, (2, m, m): observed, wanted.

    Own columns are free in each half, as edges and drifts of one half say nothing of the other. A block shorter than
    a stretch is parted row by row.

    Parameters
    ----------
    problem : Problem
    index : of the block
    segment_s : s, length of a stretch
    wanted : (w,) indices of columns
    """
    block = problem.blocks[index]
    columns = problem.columns[index].of(np.append(0, wanted))
    first = np.floor((block.time - block.time.min()) / segment_s) % 2 == 0
    if first.all():  # a block of few numbers, such as edge times
        first = np.arange(block.time.size) % 2 == 0
    parts = []
    for rows in (first, ~first):
        basis = basis_of(block.local_columns[rows])
        part = columns[rows] - basis @ (basis.T @ columns[rows])
        parts.append(part.T @ part)
    return np.stack(parts)


def baseline_of(problem: Problem, indices) -> np.ndarray:
    """Indices of the shared columns and of those of some candidates.

    Parameters
    ----------
    problem : Problem
    indices : of candidates
    """
    shared = np.arange(problem.shared.start, problem.shared.stop)
    parts = [np.arange(problem.places[k].start, problem.places[k].stop) for k in indices]
    return np.concatenate([shared, *parts]).astype(int)
