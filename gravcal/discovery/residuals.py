"""Residuals of a baseline, measured or drawn as pure noise, through one and the same projection."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.problem import Problem
from gravcal.estimation.noise import fit_noise, whiten


def projected(problem: Problem, baseline: np.ndarray, noise: list[np.ndarray]) -> list[np.ndarray]:
    """Signals (n, d) a block less the best fit of own and baseline columns.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted
    noise : (n, d) a block, whitened
    """
    rest = [e - q @ (q.T @ e) for e, q in zip(noise, problem.bases, strict=True)]
    right = sum(c.of(baseline).T @ r for c, r in zip(problem.columns, rest, strict=True))
    value = inverse_of_baseline(problem, baseline) @ right
    return [r - c.of(baseline) @ value for c, r in zip(problem.columns, rest, strict=True)]


def inverse_of_baseline(problem: Problem, baseline: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the baseline parameters.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns
    """
    return attribution.inverse_of(problem.total[np.ix_(baseline, baseline)])


def measured(problem: Problem) -> list[np.ndarray]:
    """Observed rows (n, 1) of every block.

    Parameters
    ----------
    problem : Problem
    """
    return [c.of(np.zeros(1)) for c in problem.columns]


def source(seed: int, blocks) -> np.random.Generator:
    """Source of the draws of an event: its own, so that the probabilities of several events do not err alike.

    Parameters
    ----------
    seed : of all events
    blocks : list of Block; the second that each begins in
    """
    return np.random.default_rng([seed, *(abs(int(b.time.min())) for b in blocks if b.time.size)])


def drawn(
    problem: Problem,
    count: int,
    quiet: Mapping[str, float],
    rng: np.random.Generator,
    order: Mapping[str, int] | None = None,
) -> list[np.ndarray]:
    """Noise (n, count) of every block, with the error of the noise model that it was whitened with.

    A model from N quiet samples is off by 1/sqrt(2 N) of its size, and each of its coefficients by 1/sqrt(N): whitened
    noise keeps as much of its neighbours (Brockwell and Davis, Time Series, ch. 8). A model that was measured in the
    rows has made them whiter than noise is, and every draw goes through the same fit.

    Parameters
    ----------
    problem : Problem
    count : number of draws
    quiet : {channel: quiet samples an axis that its noise was measured from, elsewhere than here}
    rng : source of randomness
    order : {channel: coefficients of its noise model}, measured in these rows if it has no quiet samples; none where
        its shape was given or the rows are too short to follow it
    """
    channels = sorted({c for b in problem.blocks for c in b.channel})
    error = {c: np.sqrt(2 / quiet[c]) if quiet.get(c) else 0.0 for c in channels}
    known = {c: (order or {}).get(c, 0) if quiet.get(c) else 0 for c in channels}
    both = [(c, a) for c in channels for a in range(3)]
    scale = {place: 1 + error[place[0]] / 2 * rng.standard_normal(count) for place in both}
    shape = {(c, a): error[c] / np.sqrt(2) * rng.standard_normal((known[c], count)) for c, a in both}
    rows = []
    for block in problem.blocks:
        noise = rng.standard_normal((block.observed.size, count), dtype=np.float32)
        noise[~weighted(block)] = 0.0
        for (channel, axis), factor in scale.items():
            here = (block.channel == channel) & (block.axis == axis)
            noise[here] = _neighbouring(noise[here], shape[channel, axis]) * factor.astype(np.float32)
        rows.append(noise)
    for channel, coefficients in (order or {}).items():
        for axis in range(3) if not quiet.get(channel) else ():
            _whitened(problem.blocks, rows, (channel, axis), coefficients)
    return rows


def _whitened(blocks, rows, place, order):
    """Every draw of a channel and axis by the model that is fitted to all its blocks together, in place."""
    here = [weighted(b) & (b.channel == place[0]) & (b.axis == place[1]) for b in blocks]
    here = [(row, at) for row, at in zip(rows, here, strict=True) if at.any()]
    for draw in range(rows[0].shape[1] if here else 0):
        pieces = [row[at, draw].astype(float) for row, at in here]
        model = fit_noise(pieces, order, 1.0)
        for (row, at), piece in zip(here, pieces, strict=True):
            row[at, draw] = whiten(model, piece, np.ones(piece.size, dtype=bool))


def _neighbouring(noise, shares):
    """Noise (n, d) with shares (p, d) of the rows before each."""
    mixed = noise.copy()
    for k, share in enumerate(shares.astype(np.float32), start=1):
        mixed[k:] += share * noise[:-k]
    return mixed


def weighted(block) -> np.ndarray:
    """Rows (n,) that carry weight.

    Parameters
    ----------
    block : Block
    """
    return (block.observed != 0) | np.any(block.local_columns != 0, axis=1) | np.any(block.global_columns != 0, axis=1)
