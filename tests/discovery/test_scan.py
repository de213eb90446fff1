"""The search along the time axis on invented linear algebra."""

import numpy as np
import pytest

from gravcal.discovery import scan
from gravcal.discovery.problem import observed_rows, prepare, residuals_of
from gravcal.estimation.records import Block


def blocks_of(rng):
    """Two blocks of 3 axes x 80 rows: a drift of each axis, one shared column, a step at each of four epochs."""
    blocks, time = [], np.tile(np.arange(80.0), 3)
    axis = np.repeat([0, 1, 2], 80)
    for k in range(2):
        drift = np.stack([np.where(axis == a, time**n, 0.0) for a in range(3) for n in (0, 1)], axis=1)
        shapes = {}
        for at in (20.0, 33.0, 47.0, 60.0):
            shapes[at + 100 * k] = np.stack([np.where(axis == a, time > at, False) for a in range(3)], axis=1) * 1.0
        rows = rng.standard_normal(240), rng.standard_normal((240, 1)), drift, np.array(["linear"] * 240), axis, time
        blocks.append(Block(f"block {k}", *rows, steps=shapes))
    return blocks


def test_gain_of_a_step_is_that_of_least_squares():
    """Analytic: on all axes and on each, chi-square that a step takes beside drifts and the shared column."""
    blocks = blocks_of(np.random.default_rng(3))
    problem = prepare(blocks, [])
    baseline = np.array([1])
    rest = residuals_of(problem, baseline, observed_rows(problem))
    found = scan.steps(problem, baseline, rest)
    assert found.at.size == 2 * 4 * 4
    assert sorted(set(found.dof)) == [1, 3]
    own = [np.concatenate([b.local_columns, np.zeros_like(b.local_columns)], axis=1) for b in blocks]
    own[1] = np.roll(own[1], own[1].shape[1] // 2, axis=1)
    plain = np.concatenate([np.concatenate([o, b.global_columns], axis=1) for o, b in zip(own, blocks, strict=True)])
    right = np.concatenate([b.observed for b in blocks])
    for k, (place, at, gain, dof) in enumerate(zip(found.place, found.at, found.gain[:, 0], found.dof, strict=True)):
        columns = np.concatenate([b.steps[at] if i == place else np.zeros((240, 3)) for i, b in enumerate(blocks)])
        one = columns if dof == 3 else columns[:, [k % 16 // 4 - 1]]
        left = [np.linalg.lstsq(m, right)[1][0] for m in (plain, np.concatenate([plain, one], axis=1))]
        assert gain == pytest.approx(left[0] - left[1], rel=1e-9)
