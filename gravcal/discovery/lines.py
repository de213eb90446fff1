"""Lines as candidates: sines of one frequency with a phase of their own in every manoeuvre, from a joint fit.

The scan of `scan.lines` takes block by block; where a line lies near the frequency of the manoeuvre it has much in
common with the shared parameters, and only a fit of all blocks at once says what it gains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravcal.discovery import residuals
from gravcal.discovery.rounds import Result
from gravcal.discovery.trials import SHARES
from gravcal.estimation import chi2_tail
from gravcal.estimation.records import Candidate

AXES = "xyz"
PEAKS = 4
#: Frequencies tried round a peak, in steps of the scan.
FINE = np.arange(-1.0, 1.01, 1 / 16)


@dataclass(frozen=True)
class Line:
    """A line with its frequency.

    Attributes
    ----------
    candidate : Candidate; its parameters have the unit of the channel
    frequency, sigma : Hz
    """

    candidate: Candidate
    frequency: float
    sigma: float


def lines(result: Result, where: tuple[str, int], shape: Callable, groups: list[int], about: tuple) -> list[Line]:
    """Lines in what a search has left, those that are significant by themselves.

    Parameters
    ----------
    result : Result of a search without lines
    where : channel, and axis or -1 for all
    shape : (block, Hz) -> whitened cosine and sine (n, 2) of that block
    groups : number of the manoeuvre of each block
    about : cause, unit and family-wise level
    """
    channel, axis = where
    found = [s for s in result.after.scans if s.kind == "line" and s.channel == channel]
    if not found:
        return []
    joint = np.flatnonzero(found[0].place == axis)
    at, score = found[0].at[joint], (found[0].gain[:, 0] - 2 * found[0].dof)[joint]
    step, kept = float(np.median(np.diff(at))), []
    for peak in _peaks(at, score, step):
        grid = peak + step * FINE
        gains = [_gain(result, _columns(shape, f, groups)) for f in grid]
        gain, dof = max(gains)
        chance = chi2_tail.log_tail(gain, dof) + np.log(at.size / SHARES["line"])
        if chance < np.log(about[2]):
            kept.append(_line(grid, np.array([g for g, _ in gains]), (shape, groups), (where, *about)))
    return kept


def _peaks(at, score, step):
    """Frequencies of the best scores, apart from each other by more than a few steps."""
    found = []
    for k in np.argsort(-score):
        if all(abs(at[k] - other) > 4 * step for other in found):
            found.append(float(at[k]))
        if len(found) == PEAKS:
            break
    return found


def _columns(shape, frequency, groups):
    """Whitened columns (n, 2 g) of every block."""
    width, found = 2 * (max(groups) + 1), []
    for k, group in enumerate(groups):
        part = shape(k, frequency)
        columns = np.zeros((part.shape[0], width))
        columns[:, 2 * group : 2 * group + 2] = part
        found.append(columns)
    return found


def _gain(result, columns):
    """Chi-square gained, and how many parameters gain it, with own and baseline columns free."""
    problem, baseline = result.problem, result.baseline
    clean = [c - q @ (q.T @ c) for c, q in zip(columns, problem.bases, strict=True)]
    cross = sum(b.of(baseline).T @ c for b, c in zip(problem.columns, clean, strict=True))
    inner = sum(c.T @ c for c in clean) - cross.T @ residuals.inverse_of_baseline(problem, baseline) @ cross
    right = sum(c.T @ r for c, r in zip(clean, result.after.rest, strict=True))
    values, vectors = np.linalg.eigh(inner)
    seen = values > 1e-6 * max(values[-1], 1e-300)
    return float(np.sum((vectors[:, seen].T @ right) ** 2 / values[seen])), int(seen.sum())


def _line(grid, gains, made_of, about):
    """Line at the mean frequency under the likelihood of the grid."""
    (shape, groups), ((channel, axis), cause, unit, _) = made_of, about
    weight = np.exp((gains - gains.max()) / 2)
    weight = weight / weight.sum()
    frequency = float(weight @ grid)
    sigma = float(np.sqrt(weight @ (grid - frequency) ** 2 + (grid[1] - grid[0]) ** 2 / 12))
    columns = _columns(shape, frequency, groups)
    names = [f"{part}_{k}" for k in range(max(groups) + 1) for part in ("cosine", "sine")]
    used = np.sum([np.sum(c**2, axis=0) for c in columns], axis=0) > 0
    names = [n for n, u in zip(names, used, strict=True) if u]
    form = f"{channel} reading{f' {AXES[axis]}' if axis >= 0 else ''}, {frequency:.5f} Hz"
    candidate = Candidate(cause, form, names, [unit] * len(names), [c[:, used] for c in columns])
    return Line(candidate, frequency, sigma)


def amplitude(line: Line, parameters: dict, name: str = "amplitude") -> dict:
    """Frequency and amplitude, rms over the manoeuvres less what noise adds, {name: {"value", "sigma", "unit"}}.

    Parameters
    ----------
    line : Line
    parameters : cosines and sines as a finding has them
    name : of the amplitude
    """
    rows = [p for p in parameters.values() if np.isfinite(p["value"])]
    squares, errors = (np.array([p[n] for p in rows]) ** 2 for n in ("value", "sigma"))
    size = np.sqrt(max(2 * np.mean(squares - errors), 0.0))
    sigma = np.sqrt(np.mean(errors) / max(len(rows) / 2, 1))
    found = {"frequency": {"value": line.frequency, "sigma": line.sigma, "unit": "Hz"}}
    return found | {name: {"value": float(size), "sigma": float(sigma), "unit": line.candidate.units[0]}}
