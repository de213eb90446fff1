"""Records that a calibration hands to discovery."""

from __future__ import annotations

from collections.abc import Callable
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
class Shape:
    """What a cause depends on otherwise than linearly, all positive.

    Attributes
    ----------
    names, units : (s,)
    value : (s,) of the columns
    columns : function of (s,) values -> one (n, q) or None a block; with `inside`, of these numbers as well
    tried : (t, s) values to begin a refinement from; lower, upper : (s,) bounds
    inside : function of (s,) values, the residual and the basis of the own columns of each block -> (b,) a number a
        block that nothing else shares, where it fits best; None without
    sized : whether the first of the values is the size of the cause itself
    covariance : (s, s) once it is refined, None before; chosen : (b,) of `inside` then
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: np.ndarray
    columns: Callable[..., list[np.ndarray | None]]
    tried: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    inside: Callable[..., np.ndarray] | None = None
    sized: bool = False
    covariance: np.ndarray | None = None
    chosen: np.ndarray | None = None


@dataclass(frozen=True)
class Candidate:
    """A cause with its columns in every block.

    Attributes
    ----------
    cause : slug, or "unknown:<driver channel>"
    form : which of several shapes of the cause
    names, units : (q,) parameters
    columns : one (n, q) or None a block
    prior : (q,) plausible sizes, none if empty
    at, at_sigma : epoch s of a step, frequency Hz of a line, and its error
    shape : what it depends on otherwise than linearly, None for most
    spread : (q, q) covariance of the parameters by the error of the shape, None without
    """

    cause: str
    form: str
    names: list[str]
    units: list[str]
    columns: list[np.ndarray | None]
    prior: list[float] = field(default_factory=list)
    at: float = np.nan
    at_sigma: float = np.nan
    shape: Shape | None = None
    spread: np.ndarray | None = None

    @property
    def listed(self) -> bool:
        """Whether the cause is in the catalogue."""
        return not self.cause.startswith("unknown:")

    @property
    def local(self) -> bool:
        """Whether it acts in one block only, so that no other block can test it."""
        return sum(c is not None for c in self.columns) == 1


def basis_of(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, r) of many long columns: eigenvectors of their products, twice for rounding.

    Parameters
    ----------
    columns : (n, k)
    """
    scale = np.linalg.norm(columns, axis=0)
    used = columns[:, scale > 0] / scale[scale > 0]
    for limit in (1e-11, 1e-3):
        if used.shape[1] == 0:
            return np.zeros((columns.shape[0], 0))
        values, vectors = np.linalg.eigh(used.T @ used)
        kept = values > limit * values[-1]
        used = (used @ vectors[:, kept]) / np.sqrt(values[kept])
    return used
