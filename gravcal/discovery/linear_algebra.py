"""Orthonormal bases of many long columns."""

from __future__ import annotations

import numpy as np


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
