"""Search along the time and the frequency axis: steps at an epoch, lines at a frequency."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from gravcal.discovery.problem import Problem, inverse_of_baseline, weighted_rows
from gravcal.estimation.parallel import parallel
from gravcal.estimation.records import Block


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


def looked_at(problem: Problem, channels) -> None:
    """Make what all scans of a problem have in common, where it is not yet made."""
    grids = {channel: frequencies(problem.blocks, channel) for channel in channels}

    def one(index):
        if problem.blocks[index].steps:
            _local(problem, index)
        for channel, axis in itertools.product(grids, range(3)):
            _waves(problem, index, channel, axis, grids[channel])

    parallel(one, range(len(problem.blocks)))


def steps(problem: Problem, baseline: np.ndarray, rest: list[np.ndarray]) -> Scan:
    """A step of the linear reading in one block, at every epoch that the block offers: on all axes, then on each."""
    inverse = inverse_of_baseline(problem, baseline)
    place, at, dof, gain = [np.zeros(0, dtype=int)], [np.zeros(0)], [np.zeros(0, dtype=int)], []
    for i, block in enumerate(problem.blocks):
        if block.steps:
            rows, shapes, own = _local(problem, i)
            cross = problem.columns[i].of(baseline)[rows].T @ shapes
            inner = own - _paired(cross, inverse @ cross, len(block.steps))
            right = (shapes.T @ rest[i][rows]).reshape(*inner.shape[:2], -1)
            gain += [_step_gain(inner, right), *_axis_gains(inner, right)]
            free = np.array([inner.shape[1], *[1] * inner.shape[1]])
            dof.append(np.repeat(free, len(block.steps)))
            at.append(np.tile(list(block.steps), free.size))
            place.append(np.full(dof[-1].size, i))
    gain = np.concatenate(gain) if gain else np.zeros((0, rest[0].shape[1]))
    return Scan("step", "linear", *map(np.concatenate, (place, at)), gain, np.concatenate(dof))


def _local(problem, index):
    """Rows that steps touch, columns (n, k q) of the k epochs there, products (k, q, q) beside own columns."""
    key = ("local", index)
    if key not in problem.memory:
        block = problem.blocks[index]
        shapes = np.concatenate(list(block.steps.values()), axis=1)
        rows = np.flatnonzero(np.any(shapes != 0, axis=1))
        shapes, count = shapes[rows], len(block.steps)
        inside = problem.bases[index][rows].T @ shapes
        problem.memory[key] = rows, shapes, _paired(shapes, shapes, count) - _paired(inside, inside, count)
    return problem.memory[key]


def _paired(one, other, count):
    """Products (count, q, q) of columns (n, count q) with those of the same group only."""
    width = one.shape[1] // max(count, 1)
    one, other = (m.reshape(m.shape[0], count, width).transpose(1, 0, 2) for m in (one, other))
    return one.transpose(0, 2, 1) @ other


def _step_gain(inner, right):
    """Reduction of chi-square (k, d) by columns with products (k, q, q), and (k, q, d) with the residual."""
    values, vectors = np.linalg.eigh(inner)
    seen = values > 1e-8 * np.maximum(values[:, -1:], 1e-300)
    size = np.where(seen, 1 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
    part = (vectors * size[:, None]).transpose(0, 2, 1) @ right
    return np.sum(part**2, axis=1)


def _axis_gains(inner, right):
    """The same (q, k, d) for each of the q columns alone."""
    own = np.einsum("kqq->kq", inner)
    seen = own > 1e-8 * np.max(own, axis=1, keepdims=True)
    size = np.where(seen, 1 / np.sqrt(np.where(seen, own, 1.0)), 0.0)
    return np.moveaxis((size[:, :, None] * right) ** 2, 1, 0)


def frequencies(blocks: list[Block], channel: str) -> np.ndarray:
    """Frequencies (f,) Hz that a channel can tell apart, up to where its low-pass leaves something."""
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
    inverse = inverse_of_baseline(problem, baseline)
    gain, dof = np.zeros((4, grid.size, count)), np.zeros((4, grid.size), dtype=int)
    for i in range(len(problem.blocks)):
        for axis in range(3):
            rows, flat, own = _waves(problem, i, channel, axis, grid)
            if flat is None:
                continue
            cross = problem.columns[i].of(baseline)[rows].T @ flat
            inner = own - _paired(cross, inverse @ cross, grid.size)
            gain[axis] += _line_gain(inner, flat.T @ rest[i][rows])
            dof[axis] += 2
    gain[3], dof[3] = gain[:3].sum(axis=0), dof[:3].sum(axis=0)
    return gain, dof


def _waves(problem, index, channel, axis, grid):
    """Rows of an axis in a block; cosine and sine (n, f 2) there, and their products (f, 2, 2) beside own columns.

    The columns are None where the block has less than 40 rows.
    """
    key = ("waves", index, channel, axis, grid.tobytes())
    if key not in problem.memory:
        block = problem.blocks[index]
        rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & weighted_rows(block))
        problem.memory[key] = (rows, None, None) if rows.size < 40 else (rows, *_seen(problem, index, rows, grid))
    return problem.memory[key]


def _seen(problem, index, rows, grid):
    """Cosine and sine (n, f 2) in some rows of a block, and their products (f, 2, 2) beside own columns."""
    time = problem.blocks[index].time[rows]
    key = ("table", (time - time[0]).tobytes(), grid.tobytes())
    if key not in problem.memory:
        phase = 2 * np.pi * np.outer(time - time[0], grid)
        flat = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(time.size, -1)
        problem.memory[key] = flat, _paired(flat, flat, grid.size)
    flat, own = problem.memory[key]
    inside = problem.bases[index][rows].T @ flat
    return flat, own - _paired(inside, inside, grid.size) + 1e-9 * time.size * np.eye(2)


def _line_gain(inner, right):
    """Reduction of chi-square (f, d) by columns with products (f, 2, 2), and (f 2, d) with the residual."""
    right = right.reshape(inner.shape[0], 2, right.shape[1])
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
        rows = (block.channel == channel) & (block.axis == axis) & weighted_rows(block)
        phase = 2 * np.pi * frequency * block.time[rows]
        columns[rows, 2 * k], columns[rows, 2 * k + 1] = np.cos(phase), np.sin(phase)
    return columns
