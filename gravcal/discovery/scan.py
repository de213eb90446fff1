"""Search along the time and the frequency axis: steps at an epoch, lines at a frequency."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from gravcal.discovery.blocks import Block, basis_of
from gravcal.methods import estimation


def residuals(blocks: list[Block]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Residual (n,) and orthonormal basis (n, k) of own and shared columns of every block, shared ones free in each.

    Parameters
    ----------
    blocks : list of Block
    """
    found = []
    for block in blocks:
        basis = basis_of(np.concatenate([block.own, block.shared], axis=1))
        found.append((block.observed - basis @ (basis.T @ block.observed), basis))
    return found


def steps(blocks: list[Block], cleaned) -> list[tuple[float, int, float, float]]:
    """Gain of a step in one block at each epoch: (log p, block, epoch, gain), best first.

    Parameters
    ----------
    blocks : list of Block
    cleaned : of `residuals`
    """
    rows = []
    for i, (block, (rest, basis)) in enumerate(zip(blocks, cleaned, strict=True)):
        if not block.local:
            continue
        together = np.concatenate(list(block.local.values()), axis=1)
        inside, rights, begin = basis.T @ together, together.T @ rest, 0
        for epoch, columns in block.local.items():
            part = slice(begin, begin + columns.shape[1])
            inner = columns.T @ columns - inside[:, part].T @ inside[:, part]
            right, begin = rights[part], part.stop
            gain = float(right @ estimation.stable_inverse(inner) @ right)
            rows.append((float(chi2_distribution.logsf(gain, columns.shape[1])), i, epoch, gain))
    return sorted(rows)


def frequencies(blocks: list[Block], channel: str) -> np.ndarray:
    """Frequencies (f,) Hz that a channel can tell apart, up to where its low-pass leaves something."""
    spans, spacing = [], []
    for block in blocks:
        time = block.time[(block.channel == channel) & (block.axis == 0)]
        if time.size > 20:
            spans.append(np.ptp(time))
            spacing.append(np.median(np.diff(time)))
    if not spans:
        return np.zeros(0)
    step = 1 / (2 * max(spans))
    return np.arange(6 * step, 0.45 / max(spacing), step)


def lines(blocks: list[Block], cleaned, channel: str) -> list[tuple[float, float, float, int]]:
    """Gain of a sine of any phase and size in each block and axis: (log p, frequency, gain, dof), best first.

    The whitening filter leaves a sine a sine, so that sine and cosine stand for it in the whitened rows.

    Parameters
    ----------
    blocks : list of Block
    cleaned : of `residuals`
    channel : name
    """
    grid = frequencies(blocks, channel)
    gain, dof = np.zeros(grid.size), np.zeros(grid.size, dtype=int)
    for block, (rest, basis) in zip(blocks, cleaned, strict=True):
        for axis in range(3):
            rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & (block.observed != 0))
            if rows.size < 40:
                continue
            more = _line_gain(block.time[rows], rest[rows], basis[rows], grid)
            gain += more
            dof += 2
    log_p = chi2_distribution.logsf(gain, np.maximum(dof, 1))
    return sorted(zip(log_p.tolist(), grid.tolist(), gain.tolist(), dof.tolist(), strict=True))


def _line_gain(time, rest, basis, grid):
    """Reduction of chi-square by sine and cosine at each frequency, (f,)."""
    phase = 2 * np.pi * np.outer(time - time[0], grid)
    shape = np.stack([np.cos(phase), np.sin(phase)], axis=2)
    inside = np.einsum("nk,nfs->kfs", basis, shape)
    inner = np.einsum("nfs,nft->fst", shape, shape) - np.einsum("kfs,kft->fst", inside, inside)
    right = np.einsum("nfs,n->fs", shape, rest)
    inner = inner + 1e-9 * time.size * np.eye(2)
    return np.einsum("fs,fs->f", right, np.linalg.solve(inner, right[..., None])[..., 0])


def sine_columns(block: Block, channel: str, frequency: float) -> np.ndarray:
    """Sine and cosine in the whitened rows of each axis of a channel, (n, 6).

    Parameters
    ----------
    block : Block
    channel : name
    frequency : Hz
    """
    columns = np.zeros((block.observed.size, 6))
    for axis in range(3):
        rows = (block.channel == channel) & (block.axis == axis) & (block.observed != 0)
        phase = 2 * np.pi * frequency * block.time[rows]
        columns[rows, 2 * axis], columns[rows, 2 * axis + 1] = np.cos(phase), np.sin(phase)
    return columns
