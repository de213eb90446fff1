"""Search along the time and the frequency axis: steps at an epoch, lines at a frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.discovery import residuals
from gravcal.discovery.blocks import Block
from gravcal.discovery.problem import Problem


@dataclass(frozen=True)
class Scan:
    """Gains of many shapes in one channel.

    Attributes
    ----------
    kind : "step" or "line"
    channel : name
    place : (k,) block of each step, or axis of each line, -1 for all three
    at : (k,) epoch s, or frequency Hz
    gain : (k, d) reduction of chi-square for each column of the residual
    dof : (k,) parameters
    """

    kind: str
    channel: str
    place: np.ndarray
    at: np.ndarray
    gain: np.ndarray
    dof: np.ndarray


def steps(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray]) -> Scan:
    """A step of the linear reading in one block, at every epoch that the block offers.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted
    rest : (n, d) a block, of `residuals.projected`
    """
    inverse = residuals.inverse_of_baseline(problem, baseline)
    place, at, gain = [], [], []
    for i, block in enumerate(problem.blocks):
        if not block.local:
            continue
        shapes = np.concatenate(list(block.local.values()), axis=1)
        width = shapes.shape[1] // len(block.local)
        inner = _inner(problem, i, shapes, baseline, inverse)
        right = shapes.T @ rest[i]
        for k, epoch in enumerate(block.local):
            part = slice(width * k, width * (k + 1))
            place, at = [*place, i], [*at, epoch]
            gain.append(_gain(inner[part, part], right[part]))
    count = rest[0].shape[1]
    gain = np.array(gain).reshape(-1, count)
    return Scan("step", "linear", np.array(place, dtype=int), np.array(at), gain, np.full(len(at), 3))


def _inner(problem, index, shapes, baseline, inverse):
    """Products of shapes with own and baseline columns projected out."""
    inside = problem.bases[index].T @ shapes
    cross = problem.columns[index][:, baseline].T @ shapes
    return shapes.T @ shapes - inside.T @ inside - cross.T @ inverse @ cross


def _gain(inner, right):
    values, vectors = np.linalg.eigh(inner)
    seen = values > 1e-8 * max(values[-1], 1e-300)
    part = (vectors[:, seen] / np.sqrt(values[seen])).T @ right
    return np.sum(part**2, axis=0)


def frequencies(blocks: list[Block], channel: str) -> np.ndarray:
    """Frequencies (f,) Hz that a channel can tell apart, up to where its low-pass leaves something.

    Parameters
    ----------
    blocks : list of Block
    channel : name
    """
    spans, spacing = [], []
    for block in blocks:
        time = block.time[(block.channel == channel) & (block.axis == 0)]
        if time.size > 20 and np.ptp(time) > 0:
            spans.append(np.ptp(time))
            spacing.append(np.median(np.diff(time)))
    if not spans:
        return np.zeros(0)
    step = 1 / (2 * max(spans))
    return np.arange(6 * step, 0.45 / max(spacing), step)


def lines(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str) -> Scan:
    """A sine of any phase and size in each block, along one axis or along all.

    The whitening filter leaves a sine a sine, so that sine and cosine stand for it in the whitened rows.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted
    rest : (n, d) a block, of `residuals.projected`
    channel : name
    """
    grid = frequencies(problem.blocks, channel)
    gain, dof = _gains(problem, baseline, rest, channel, grid)
    place, at = np.repeat([0, 1, 2, -1], grid.size), np.tile(grid, 4)
    return Scan("line", channel, place, at, gain.reshape(-1, rest[0].shape[1]), dof.ravel())


def line_gain(
    problem: Problem, baseline: np.ndarray, rest: list[np.ndarray], channel: str, axis: int, grid
) -> np.ndarray:
    """Gain (f,) of a line at given frequencies.

    Parameters
    ----------
    problem, baseline, rest, channel : as of `lines`
    axis : of the line, -1 for all three
    grid : (f,) Hz
    """
    return _gains(problem, baseline, rest, channel, np.asarray(grid))[0][axis, :, 0]


def _gains(problem, baseline, rest, channel, grid):
    """Gain (4, f, d) and parameters (4, f): each axis, then all together."""
    count = rest[0].shape[1]
    inverse = residuals.inverse_of_baseline(problem, baseline)
    gain, dof = np.zeros((4, grid.size, count)), np.zeros((4, grid.size), dtype=int)
    for i, block in enumerate(problem.blocks):
        weight = residuals.weighted(block)
        for axis in range(3):
            rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & weight)
            if rows.size < 40:
                continue
            fixed = problem.columns[i][rows][:, baseline]
            gain[axis] += _line_gain(block.time[rows], rest[i][rows], problem.bases[i][rows], fixed, inverse, grid)
            dof[axis] += 2
    gain[3], dof[3] = gain[:3].sum(axis=0), dof[:3].sum(axis=0)
    return gain, dof


def _line_gain(time, rest, basis, fixed, inverse, grid):
    """Reduction of chi-square by sine and cosine at each frequency, (f, d)."""
    phase = 2 * np.pi * np.outer(time - time[0], grid)
    shape = np.stack([np.cos(phase), np.sin(phase)], axis=2)
    flat = shape.reshape(time.size, -1)
    inside = (basis.T @ flat).reshape(-1, grid.size, 2)
    cross = (fixed.T @ flat).reshape(-1, grid.size, 2)
    lost = np.einsum("kfs,kft->fst", inside, inside)
    lost += np.einsum("kfs,kft->fst", cross, np.einsum("kj,jft->kft", inverse, cross))
    inner = np.einsum("nfs,nft->fst", shape, shape) - lost + 1e-9 * time.size * np.eye(2)
    right = (flat.T @ rest).reshape(grid.size, 2, -1)
    a, b, c = (inner[:, i, j, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    cosine, sine = right[:, 0], right[:, 1]
    return (c * cosine**2 - 2 * b * cosine * sine + a * sine**2) / (a * c - b**2)


def sine_columns(block: Block, channel: str, frequency: float, axes) -> np.ndarray:
    """Sine and cosine in the whitened rows of some axes of a channel, (n, 2 a).

    Parameters
    ----------
    block : Block
    channel : name
    frequency : Hz
    axes : indices of axes
    """
    columns = np.zeros((block.observed.size, 2 * len(axes)))
    for k, axis in enumerate(axes):
        rows = (block.channel == channel) & (block.axis == axis) & residuals.weighted(block)
        phase = 2 * np.pi * frequency * block.time[rows]
        columns[rows, 2 * k], columns[rows, 2 * k + 1] = np.cos(phase), np.sin(phase)
    return columns
