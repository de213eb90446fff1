"""Causes with a shape, such as the frequency of a mode: fitted where a search along a grid has found them."""

from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.problem import Problem, extended, inverse_of, inverse_of_baseline, observed_rows, residuals_of
from gravcal.estimation.records import Candidate, Shape

SHARE = 0.2  # of the largest gain of a round, from which a cause of any size may win
NEAR = 1.0  # of chi-square below the best form, within which one that was refined beside other causes will do
EVALUATIONS = 40  # of the search for the largest gain, beyond those that it begins with
STEP = 1e-4  # relative, for derivatives by the shape
#: Of a size under the likelihood: first guess of its relative error, sizes tried on either side, and how often.
FIRST, AROUND, PASSES = 0.02, 6, 3


class _Beside:
    """What stays the same while a shape is fitted: residual and columns of the baseline."""

    def __init__(self, problem, baseline):
        self.problem, self.inverse = problem, inverse_of_baseline(problem, baseline)
        self.rest = residuals_of(problem, baseline, observed_rows(problem))
        self.columns = [c.of(baseline) for c in problem.columns]

    def products(self, parts):
        """Products (q, q) and (q,) of columns with each other and with the residual, baseline projected out.

        Baseline and residual have no own columns left in them; only rows where the columns are not zero count.
        """
        crossed, inner, right = 0.0, 0.0, 0.0
        for basis, rest, known, part in zip(self.problem.bases, self.rest, self.columns, parts, strict=True):
            if part is not None:
                rows = np.flatnonzero(part.any(axis=1))
                used = slice(rows[0], rows[-1] + 1) if rows.size else slice(0)
                own, inside = part[used], basis[used].T @ part[used]
                inner = inner + own.T @ own - inside.T @ inside
                crossed, right = crossed + known[used].T @ own, right + own.T @ rest[used, 0]
        return inner - crossed.T @ self.inverse @ crossed, right

    def gain(self, parts, size=None):
        """Gain of columns, and their values (q,), which are fitted unless given."""
        inner, right = self.products(parts)
        value = inverse_of(inner) @ right if size is None else np.array([size])
        return float(2 * right @ value - value @ inner @ value), value

    def inside(self, shape, value):
        """Numbers of the blocks where they fit best."""
        return () if shape.inside is None else (shape.inside(value, self.rest, self.problem.bases),)

    def gain_of(self, shape, value):
        """Gain of a shape."""
        parts = shape.columns(value, *self.inside(shape, value))
        return self.gain(parts, value[0] if shape.sized else None)[0]


def refined(problem: Problem, baseline: np.ndarray, index: int) -> tuple[Problem, int]:
    """Problem with a candidate in the shape of largest gain, and its index; as it was if it has none or is refined."""
    candidate = problem.candidates[index]
    if candidate.shape is None or candidate.shape.covariance is not None:
        return problem, index
    beside = _Beside(problem, baseline)
    settled = len(candidate.shape.tried) == 1  # at the largest gain
    value = candidate.shape.value if settled else _largest(candidate.shape, beside)
    found = (_with_spread if candidate.shape.sized else _with_errors)(candidate, value, beside)
    return extended(problem, found), len(problem.candidates)


def sized(problem: Problem, baseline: np.ndarray, rows: list) -> tuple[Problem, list]:
    """Problem and trials, with causes whose size is their shape at their largest gain where they may win.

    What is tried of them is far from linear in the size, so that a form of the grid says little of how well they fit.
    Their errors cost twice as much as that and are found when one of them has won.
    """
    most = max((t.gain for t in rows), default=0.0)
    shapes = {t.index: problem.candidates[t.index].shape for t in rows if t.index >= 0}
    found = [t for t in rows if t.index >= 0 and shapes[t.index] is not None and shapes[t.index].sized]
    best = max(found, key=lambda t: t.gain, default=None)
    known = [t for t in found if len(shapes[t.index].tried) == 1]
    if best is None or best.gain < SHARE * most or any(t.gain > best.gain - NEAR for t in known):
        return problem, rows
    candidate, beside, index = problem.candidates[best.index], _Beside(problem, baseline), len(problem.candidates)
    value = _largest(candidate.shape, beside)
    chosen = beside.inside(candidate.shape, value)
    settled = replace(candidate.shape, value=value, tried=value[None], chosen=next(iter(chosen), None))
    parts, form = settled.columns(value, *chosen), _form(settled, value)
    problem = extended(problem, replace(candidate, form=form, columns=parts, shape=settled))
    ratio = attribution.ratio(attribution.projected(problem.total, baseline), problem.places[index], problem.size)
    numbers = {"gain": ratio.gain, "log_p": ratio.log_p, "form": form}
    return problem, [*(t for t in rows if t not in found), best._replace(index=index, **numbers)]


def _largest(shape: Shape, beside):
    """Shape of largest gain: the best of those to begin with, then a simplex in their logarithms."""
    from scipy.optimize import minimize

    loss = lambda u: -beside.gain_of(shape, np.exp(u))  # noqa: E731
    limits = list(zip(np.log(shape.lower), np.log(shape.upper), strict=True))
    begun = np.clip(np.log(shape.tried), *np.transpose(limits))
    losses = [loss(u) for u in begun]
    first = begun[int(np.argmin(losses))]
    if shape.sized and first.size == 1:  # its spread is looked at anew
        return np.exp(_between(loss, begun[:, 0], int(np.argmin(losses))))
    steps = np.abs(begun - first)
    width = np.array([np.min(column[column > 0], initial=0.1) / 2 for column in steps.T])
    simplex = first + np.concatenate([np.zeros((1, width.size)), np.diag(width)])
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 1e-4, "fatol": 0.01}
    return np.exp(minimize(loss, first, method="Nelder-Mead", bounds=limits, options=options).x)


def _between(loss, tried, best):
    """Smallest loss between the neighbours of the best of increasing numbers, (1,)."""
    from scipy.optimize import minimize_scalar

    ends = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
    options = {"xatol": FIRST / 4, "maxiter": EVALUATIONS}
    found = minimize_scalar(lambda u: loss(np.array([u])), bounds=ends, method="bounded", options=options)
    return np.array([found.x])


def _with_errors(candidate: Candidate, value, beside):
    """Candidate in a shape, with the errors of the shape and of the parameters by it, from the joint fit of both."""
    shape, parts = candidate.shape, candidate.shape.columns(value)
    _, size = beside.gain(parts)
    slopes = [_slope(shape, value, k, size) for k in range(value.size)]
    both = [None if p is None else np.column_stack([p, *(s[i] for s in slopes)]) for i, p in enumerate(parts)]
    inner, _ = beside.products(both)
    joint, count = inverse_of(inner), size.size
    alone = inverse_of(inner[:count, :count])
    known = replace(shape, value=value, covariance=joint[count:, count:])
    spread = joint[:count, :count] - alone
    return replace(candidate, form=_form(shape, value), columns=parts, shape=known, spread=spread)


def _with_spread(candidate: Candidate, value, beside):
    """Candidate whose size is its shape: mean and standard deviation of its logarithm under the likelihood.

    Where the numbers of the blocks fit best changes with the size, by leaps, so that the gain is bent differently to
    either side.
    """
    shape, about, width = candidate.shape, np.log(value), FIRST
    for _ in range(PASSES):
        tried = about + width * np.linspace(-4, 4, 2 * AROUND + 1)[:, None]
        gain = np.array([beside.gain_of(shape, np.exp(u)) for u in tried])
        weight = np.exp((gain - gain.max()) / 2)[:, None] / np.sum(np.exp((gain - gain.max()) / 2))
        about = np.sum(weight * tried, axis=0)
        width = np.sqrt(np.sum(weight * (tried - about) ** 2, axis=0) + (width / AROUND) ** 2)
    value, variance = np.exp(about), (np.exp(about) * width) ** 2
    chosen = beside.inside(shape, value)
    parts = shape.columns(value, *chosen)
    alone = inverse_of(beside.products(parts)[0])
    held = {"covariance": np.diag(variance), "chosen": next(iter(chosen), None)}
    known = replace(shape, value=value, tried=value[None], **held)
    spread = np.maximum(np.diag(variance) - alone, 0.0)
    return replace(candidate, form=_form(shape, value), columns=parts, shape=known, spread=spread)


def _form(shape, value):
    """Shape in words."""
    rows = zip(shape.names, value, shape.units, strict=True)
    words = [shape.words] if shape.words else []
    return ", ".join(words + [f"{n} {v:.4g} {u}".removesuffix(" 1") for n, v, u in rows])


def _slope(shape, value, k, size):
    """Derivative of what the cause adds by one number of its shape, (n,) or None a block."""
    step = np.zeros(value.size)
    step[k] = STEP * value[k]
    ends = zip(shape.columns(value + step), shape.columns(value - step), strict=True)
    return [None if a is None else (a - b) @ size / (2 * step[k]) for a, b in ends]
