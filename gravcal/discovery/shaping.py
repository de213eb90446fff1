"""Causes with a shape, such as the frequency of a mode: fitted where a search along a grid has found them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gravcal.discovery import attribution, residuals
from gravcal.discovery.blocks import Candidate, Shape
from gravcal.discovery.problem import Problem, extended

EVALUATIONS = 40  # of the search for the largest gain, beyond those that it begins with
STEP = 1e-4  # relative, for derivatives by the shape


@dataclass(frozen=True)
class _Beside:
    """What stays the same while a shape is fitted: residual and columns of the baseline."""

    problem: Problem
    rest: list[np.ndarray]
    columns: list[np.ndarray]
    inverse: np.ndarray

    def products(self, parts):
        """Products (q, q) and (q,) of columns with each other and with the residual, baseline projected out."""
        crossed, inner, right = 0.0, 0.0, 0.0
        rows = zip(self.problem.bases, self.rest, self.columns, parts, strict=True)
        for basis, rest, known, part in rows:
            if part is not None:
                new = part - basis @ (basis.T @ part)
                crossed, inner, right = crossed + known.T @ new, inner + new.T @ new, right + new.T @ rest[:, 0]
        return inner - crossed.T @ self.inverse @ crossed, right

    def gain(self, parts):
        """Gain of columns, and their values (q,)."""
        inner, right = self.products(parts)
        value = attribution.inverse_of(inner) @ right
        return float(right @ value), value


def refined(problem: Problem, baseline: np.ndarray, index: int) -> tuple[Problem, int]:
    """Problem with a candidate in the shape of largest gain, and its index; as it was if it has none or is refined.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted
    index : of the candidate
    """
    candidate = problem.candidates[index]
    if candidate.shape is None or candidate.shape.covariance is not None:
        return problem, index
    rest = residuals.projected(problem, baseline, residuals.measured(problem))
    inverse = residuals.inverse_of_baseline(problem, baseline)
    beside = _Beside(problem, rest, [c[:, baseline] for c in problem.columns], inverse)
    found = _with_errors(candidate, _largest(candidate.shape, beside), beside)
    return extended(problem, found), len(problem.candidates)


def _largest(shape: Shape, beside):
    """Shape of largest gain: the best of those to begin with, then a simplex in their logarithms."""
    from scipy.optimize import minimize

    loss = lambda u: -beside.gain(shape.columns(np.exp(u)))[0]  # noqa: E731
    begun = np.log(shape.tried)
    first = begun[int(np.argmin([loss(u) for u in begun]))]
    steps = np.abs(begun - first)
    width = np.array([np.min(column[column > 0], initial=0.1) / 2 for column in steps.T])
    simplex = first + np.concatenate([np.zeros((1, width.size)), np.diag(width)])
    limits = list(zip(np.log(shape.lower), np.log(shape.upper), strict=True))
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 1e-4, "fatol": 0.01}
    return np.exp(minimize(loss, first, method="Nelder-Mead", bounds=limits, options=options).x)


def _with_errors(candidate: Candidate, value, beside):
    """Candidate in a shape, with the errors of the shape and of the parameters by it, from the joint fit of both."""
    shape, parts = candidate.shape, candidate.shape.columns(value)
    _, size = beside.gain(parts)
    slopes = [_slope(shape, value, k, size) for k in range(value.size)]
    both = [None if p is None else np.column_stack([p, *(s[i] for s in slopes)]) for i, p in enumerate(parts)]
    inner, _ = beside.products(both)
    joint, count = attribution.inverse_of(inner), size.size
    alone = attribution.inverse_of(inner[:count, :count])
    known = replace(shape, value=value, covariance=joint[count:, count:])
    words = [f"{n} {v:.4g} {u}".removesuffix(" 1") for n, v, u in zip(shape.names, value, shape.units, strict=True)]
    return replace(candidate, form=", ".join(words), columns=parts, shape=known, spread=joint[:count, :count] - alone)


def _slope(shape, value, k, size):
    """Derivative of what the cause adds by one number of its shape, (n,) or None a block."""
    step = np.zeros(value.size)
    step[k] = STEP * value[k]
    ends = zip(shape.columns(value + step), shape.columns(value - step), strict=True)
    return [None if a is None else (a - b) @ size / (2 * step[k]) for a, b in ends]
