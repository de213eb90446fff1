"""Columns of one block, of which most touch few of its channels; its own columns are projected out where it matters."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

GROUPS = 12  # of rows, at most; a block whose channels alternate is one group
REMEMBERED = 8  # choices of columns
#: Share of the square of a column that is rounding when its part along the own columns is taken off.
ROUNDING = 1e-13


@dataclass(frozen=True)
class Part:
    """Columns that are not zero in a group of rows.

    Attributes
    ----------
    rows : slice
    index : (k,) of the columns
    values : (n, k) their rows
    """

    rows: slice
    index: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Columns:
    """Columns of a block.

    Attributes
    ----------
    count : number of columns
    groups : slices of rows, one a channel
    parts : list of Part
    basis : (n, r) orthonormal basis of the block's own columns
    inside : (r, m) products of basis and columns
    memory : choices of columns without own columns, made once
    """

    count: int
    groups: list[slice]
    parts: list[Part]
    basis: np.ndarray
    inside: np.ndarray
    memory: dict = field(default_factory=dict)

    def of(self, wanted: np.ndarray) -> np.ndarray:
        """Some columns (n, w), own columns projected out.

        Parameters
        ----------
        wanted : (w,) indices
        """
        wanted = np.asarray(wanted, dtype=np.intp)
        made = self.memory.get(wanted.tobytes())
        if made is None:
            made = self._made(wanted)
            if len(self.memory) >= REMEMBERED:
                self.memory.clear()
            self.memory[wanted.tobytes()] = made
        return made

    def _made(self, wanted):
        made = self.basis @ -self.inside[:, wanted]
        for part in self.parts:
            place = np.full(self.count, -1)
            place[part.index] = np.arange(part.index.size)
            here = np.flatnonzero(place[wanted] >= 0)
            made[part.rows, here] += part.values[:, place[wanted[here]]]
        return made

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """Sums of squares (m,) before anything is projected out."""
        total = np.zeros(self.count)
        for part in self.parts:
            total[part.index] += np.einsum("nk,nk->k", part.values, part.values)
        return total

    def products(self) -> np.ndarray:
        """Products (m, m) with each other, own columns projected out; zero for what lies along own columns."""
        total = -(self.inside.T @ self.inside)
        for one, other in itertools.product(self.parts, repeat=2):
            if one.rows == other.rows:
                total[np.ix_(one.index, other.index)] += one.values.T @ other.values
        return without_rounding(total, self.squares)

    def onto(self, signals: np.ndarray) -> np.ndarray:
        """Products (m, d) with signals (n, d) that have no own columns left in them."""
        total = np.zeros((self.count, signals.shape[1]))
        for part in self.parts:
            total[part.index] += part.values.T @ signals[part.rows]
        return total

    def wider(self, more: np.ndarray) -> Columns:
        """With more columns (n, q) after these."""
        index = self.count + np.arange(more.shape[1])
        found = [Part(rows, index, more[rows]) for rows in self.groups if more[rows].any()]
        inside = np.concatenate([self.inside, self.basis.T @ more], axis=1)
        return replace(self, count=self.count + index.size, parts=[*self.parts, *found], inside=inside, memory={})


def without_rounding(products: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Products of columns, in place, with zeros for columns of which nothing but rounding is left.

    Parameters
    ----------
    products : (m, m), own columns projected out
    squares : (m,) of the columns before that; 0 for those looked at before
    """
    lost = np.diag(products) <= ROUNDING * squares
    products[lost] = 0.0
    products[:, lost] = 0.0
    return products


def columns_of(channel: np.ndarray, basis: np.ndarray, pieces: Sequence[np.ndarray | None], widths) -> Columns:
    """Columns from pieces that stand side by side.

    Parameters
    ----------
    channel : (n,) of each row
    basis : (n, r) orthonormal, of the own columns
    pieces : (n, q) each, None where all of it is zero
    widths : q of each piece
    """
    ends = np.cumsum([0, *widths])
    groups = _groups(channel)
    parts, inside = [], np.zeros((basis.shape[1], ends[-1]))
    for rows in groups:
        used = [k for k, piece in enumerate(pieces) if piece is not None and piece[rows].any()]
        if used:
            index = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in used])
            parts.append(Part(rows, index, np.concatenate([pieces[k][rows] for k in used], axis=1)))
            inside[:, index] += basis[rows].T @ parts[-1].values
    return Columns(int(ends[-1]), groups, parts, basis, inside)


def _groups(channel):
    """Slices of rows of one channel each, or all rows."""
    starts = np.concatenate([[0], 1 + np.flatnonzero(channel[1:] != channel[:-1]), [channel.size]])
    if starts.size - 1 > GROUPS:
        return [slice(0, channel.size)]
    return [slice(int(a), int(b)) for a, b in zip(starts[:-1], starts[1:], strict=True)]
