"""A parameter that moves from event to event: constant, slope, steps at known or found epochs, fuel, and a random walk.

Everything is Gaussian, so that a value at any time follows from all events with its error (Rasmussen and Williams 2006,
Gaussian Processes for Machine Learning, eq. 2.25-2.26). What is not known of the walk, its size and that of scatter
beyond the stated errors, is averaged over by the evidence (eq. 2.30).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

YEAR_S = 365.25 * 86400
WALKS, SMALLEST = 12, 0.3  # sizes of the walk; the least, between two events, in median errors
SCATTERS = np.append(0.0, np.geomspace(0.3, 10.0, 6))  # of the median error
#: How likely it is before that nothing walks, and that nothing scatters beyond the stated errors. A walk of the size of
#: an error is not told from none, so that sigma is too large without it or too small beside it: with 0.3 by about the
#: same factor either way (`python -m benchmarks joint --sort motion`).
STILL, HONEST = 0.3, 0.9
FOUND = 9.0  # twice the log evidence, beyond the price of where it is, from which a step is taken for one


@dataclass(frozen=True)
class Moving:
    """How a parameter moves."""

    time: np.ndarray  #: (n,) s
    value: np.ndarray  #: (n,)
    covariance: np.ndarray  #: (n, n) of the values
    steps: Sequence[float]  #: (k,) s, epochs of steps
    discovered: Sequence[float]  #: those of them that were found
    scale: float  #: spread that steps and slope are compared with
    weights: np.ndarray  #: (w, s) of each size of walk and scatter
    follows: Mapping[str, np.ndarray]  #: (n,) quantities of the events that it follows, f of them
    score: float = 0.0  #: twice the logarithm of the evidence

    def basis(self, time: np.ndarray) -> np.ndarray:
        """Constant, slope per year from the first event, steps and quantities, (m, 2 + k + f)."""
        steps, quantities = (time >= s for s in self.steps), (self._at(time, q) for q in self.follows.values())
        return np.column_stack([np.ones(time.size), (time - self.time[0]) / YEAR_S, *steps, *quantities])

    def _at(self, time, values):
        """A quantity less its mean, between events on a line, beyond them on that of all."""
        slope, start = np.polyfit(self.time - self.time[0], values, 1)
        line = lambda t: start + slope * (t - self.time[0])  # noqa: E731
        return line(time) + np.interp(time, self.time, values - line(self.time)) - values.mean()

    @property
    def prior(self) -> np.ndarray:
        """Plausible sizes (2 + k + f,) of these."""
        years = max(np.ptp(self.time) / YEAR_S, 0.1)
        steps, quantities = (self.scale for _ in self.steps), (self.scale / np.ptp(v) for v in self.follows.values())
        return np.array([1e3 * self.scale, self.scale / years, *steps, *quantities])

    def kernel(self, one: np.ndarray, other: np.ndarray, walk: float) -> np.ndarray:
        """Covariance (a, b) of basis and walk at two sets of times."""
        first = self.time[0]
        away = np.abs(one - first)[:, None] + np.abs(other - first) - np.abs(one[:, None] - other)
        basis = (self.basis(one) * self.prior**2) @ self.basis(other).T
        return basis + walk**2 * away / (2 * YEAR_S)

    @property
    def error(self) -> float:
        """Median error of the values."""
        return float(np.median(np.sqrt(np.diag(self.covariance))))

    @property
    def walks(self) -> np.ndarray:
        """Sizes of the walk in a root of a year: none, then from below the error to thrice the spread between steps."""
        parts = np.split(self.value, np.searchsorted(self.time, np.sort(self.steps)))
        spread = max(3 * self.error, *(np.ptp(part) for part in parts if part.size))
        years = np.median(np.diff(self.time)) / YEAR_S
        return np.append(0.0, np.geomspace(SMALLEST * self.error, 3 * spread, WALKS) / np.sqrt(years))

    def options(self):
        """(weight, walk, covariance (n, n) of the values) of each size that matters."""
        for (i, walk), (k, scatter) in itertools.product(enumerate(self.walks), enumerate(SCATTERS)):
            if self.weights[i, k] > 1e-4:
                noise = self.covariance + (scatter * self.error) ** 2 * np.eye(self.time.size)
                yield self.weights[i, k], walk, self.kernel(self.time, self.time, walk) + noise

    def predicted(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value (m,) at times (m,) s, and its standard deviation, what was measured there being of no scatter."""
        time, means, squares, total = np.atleast_1d(time), 0.0, 0.0, 0.0
        for weight, walk, inner in self.options():
            cross = self.kernel(time, self.time, walk)
            factor = cho_factor(inner)
            mean = cross @ cho_solve(factor, self.value)
            own = np.diag(self.kernel(time, time, walk)) - np.sum(cross * cho_solve(factor, cross.T).T, axis=1)
            means, squares, total = means + weight * mean, squares + weight * (own + mean**2), total + weight
        return means / total, np.sqrt(np.maximum(squares / total - (means / total) ** 2, 0.0))

    def terms(self) -> tuple[np.ndarray, np.ndarray]:
        """Value and error (2 + k + f,) of constant, slope, steps and quantities, at the likeliest size of the walk."""
        _, _, inner = max(self.options(), key=lambda row: row[0])
        design = self.basis(self.time) * self.prior**2
        factor = cho_factor(inner)
        value = design.T @ cho_solve(factor, self.value)
        return value, np.sqrt(np.maximum(self.prior**2 - np.sum(design * cho_solve(factor, design), axis=0), 0.0))

    def left_out(self) -> np.ndarray:
        """Each value (n,) less that foretold by all others, over the error of the difference."""
        score = 0.0
        for weight, _, inner in self.options():
            inverse = np.linalg.inv(inner)
            score = score + weight * (inverse @ self.value) / np.sqrt(np.diag(inverse))
        return score


def moving(time: np.ndarray, value: np.ndarray, covariance: np.ndarray, steps: Sequence[float] = (), follows=None):
    """How a parameter (n,) with its covariance moves at increasing times (n,) s, with steps found between the events.

    Steps s are epochs at which it may have jumped, such as trims; `follows` {name: (n,)} holds quantities of the events
    that it may follow, such as fuel: those that pay as a step has to.
    """
    known = [s for s in steps if time[0] < s]  # one before all events is not told from the constant
    scale = max(float(np.ptp(value)), 3 * float(np.median(np.sqrt(np.diag(covariance)))))
    one = _weighed(time, value, covariance, known, [], scale, {})
    for name, quantity in (follows or {}).items():
        if np.ptp(quantity) > 0:
            more = _weighed(time, value, covariance, known, [], scale, one.follows | {name: quantity})
            one = more if more.score > one.score + FOUND else one
    middles = np.array([(a + b) / 2 for a, b in itertools.pairwise(time)])
    while time.size > 3:
        taken = np.searchsorted(time, one.steps)
        free = middles[[k for k in range(middles.size) if k + 1 not in taken]]
        gain = _stepped(one, free) - 2 * np.log(max(free.size, 1))
        if not free.size or gain.max() < FOUND:
            return one
        at = float(free[np.argmax(gain)])
        one = _weighed(time, value, covariance, [*one.steps, at], [*one.discovered, at], scale, one.follows)
    return one


def _stepped(one, epochs):
    """Twice the logarithm of the evidence (m,) for one more step at epochs (m,), over that of none."""
    steps, score = (one.time[:, None] >= epochs) * one.scale, []
    for weight, _, inner in one.options():
        inverse = np.linalg.inv(inner)
        known, right = np.sum(steps * (inverse @ steps), axis=0), steps.T @ (inverse @ one.value)
        score.append(2 * np.log(weight) - np.log1p(known) + right**2 / (1 + known))
    best = np.max(score, axis=0, initial=-np.inf)
    return best + 2 * np.log(np.sum(np.exp((np.array(score) - best) / 2), axis=0))


def _weighed(time, value, covariance, steps, detected, scale, follows):
    """Motion with the evidence of each size of walk and scatter."""
    odds = (np.append(p, np.full(n, (1 - p) / n)) for p, n in ((STILL, WALKS), (HONEST, SCATTERS.size - 1)))
    prior = np.outer(*odds)
    one = Moving(time, value, covariance, steps, detected, scale, np.ones(prior.shape), follows)
    score = [-np.linalg.slogdet(inner)[1] - value @ np.linalg.solve(inner, value) for _, _, inner in one.options()]
    score = np.reshape(score, prior.shape) + 2 * np.log(prior)
    weights = np.exp((score - score.max()) / 2)
    total = score.max() + 2 * np.log(weights.sum())
    return replace(one, weights=weights / weights.sum(), score=float(total))
