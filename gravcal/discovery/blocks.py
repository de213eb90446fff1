"""Records that a calibration hands to discovery, and their reduction to small matrices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Block:
    """Whitened observations that share nothing but the shared parameters with other blocks.

    Attributes
    ----------
    label : what it is
    observed : (n,) 1, residual of the baseline, noise of unit variance
    shared : (n, p) columns of parameters common to all blocks
    own : (n, k) columns of this block alone
    channel, axis, time : (n,) of each row
    local : {epoch: (n, q)} columns of something that happens once in this block, at an epoch
    """

    label: str
    observed: np.ndarray
    shared: np.ndarray
    own: np.ndarray
    channel: np.ndarray
    axis: np.ndarray
    time: np.ndarray
    local: dict[float, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Candidate:
    """A cause with its columns in every block.

    Attributes
    ----------
    cause : slug, or "unknown:<driver channel>"
    form : which of several shapes of the cause
    names, units : (q,) parameters
    columns : one (n, q) or None a block
    """

    cause: str
    form: str
    names: list[str]
    units: list[str]
    columns: list[np.ndarray | None]

    @property
    def listed(self) -> bool:
        """Whether the cause is in the catalogue."""
        return not self.cause.startswith("unknown:")


@dataclass(frozen=True)
class Reduced:
    """Products of all columns with own columns projected out.

    Attributes
    ----------
    gram : (b, m, m), columns ordered observed, shared, candidates; one matrix a block
    shared : slice of the shared columns
    places : slice of each candidate
    size : (m,) norm before own columns were projected out
    samples : (b,) rows that carry weight, less own columns
    """

    gram: np.ndarray
    shared: slice
    places: list[slice]
    size: np.ndarray
    samples: np.ndarray


def reduce(blocks: list[Block], candidates: list[Candidate]) -> Reduced:
    """Gram matrices of everything, each block's own columns projected out.

    Parameters
    ----------
    blocks : list of Block
    candidates : list of Candidate
    """
    width = blocks[0].shared.shape[1]
    ends = np.cumsum([1 + width, *(len(c.names) for c in candidates)])
    places = [slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    gram = np.zeros((len(blocks), ends[-1], ends[-1]))
    size, samples = np.zeros(ends[-1]), np.zeros(len(blocks))
    for i, block in enumerate(blocks):
        parts = [block.observed[:, None], block.shared]
        blank = np.zeros((block.observed.size, 1))
        parts += [blank.repeat(len(c.names), 1) if c.columns[i] is None else c.columns[i] for c in candidates]
        columns = np.concatenate(parts, axis=1)
        size += np.sum(columns**2, axis=0)
        basis = basis_of(block.own)
        columns -= basis @ (basis.T @ columns)
        gram[i] = columns.T @ columns
        samples[i] = np.sum(np.any(np.column_stack([block.observed, block.own]) != 0, axis=1)) - basis.shape[1]
    return Reduced(gram, slice(1, 1 + width), places, np.sqrt(size), samples)


def basis_of(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, r) of many long columns: eigenvectors of their products, then one QR for rounding.

    Parameters
    ----------
    columns : (n, k)
    """
    scale = np.linalg.norm(columns, axis=0)
    used = columns[:, scale > 0] / scale[scale > 0]
    if used.shape[1] == 0:
        return np.zeros((columns.shape[0], 0))
    values, vectors = np.linalg.eigh(used.T @ used)
    kept = values > 1e-11 * values[-1]
    return np.linalg.qr((used @ vectors[:, kept]) / np.sqrt(values[kept]))[0]
