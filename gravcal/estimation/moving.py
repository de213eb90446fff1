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
    """Gaussian process model of a parameter over time: constant, slope, k steps, f quantities, walk and scatter."""

    time: np.ndarray  #: (n,) s
    value: np.ndarray  #: (n,)
    covariance: np.ndarray  #: (n, n) of the values
    steps: Sequence[float]  #: (k,) s, epochs of steps
    discovered: Sequence[float]  #: epochs s of those steps that were not known but found
    scale: float  #: prior sigma of a step, of the size of the spread of the values
    weights: np.ndarray  #: (w, s) posterior probability of each size of walk and scatter
    follows: Mapping[str, np.ndarray]  #: {name: (n,)} quantities of the events that it follows, f of them
    score: float = 0.0  #: twice the logarithm of the evidence

    def basis(self, time: np.ndarray) -> np.ndarray:
        """Design matrix (m, 2 + k + f) at times (m,) s: constant, slope per year, steps and quantities."""
        steps, quantities = (time >= s for s in self.steps), (self._at(time, q) for q in self.follows.values())
        return np.column_stack([np.ones(time.size), (time - self.time[0]) / YEAR_S, *steps, *quantities])

    def _at(self, time, values):
        """Quantity less its mean at times (m,) s: linear between events, parallel to the line of all beyond them."""
        slope, start = np.polyfit(self.time - self.time[0], values, 1)
        line = lambda t: start + slope * (t - self.time[0])  # noqa: E731
        return line(time) + np.interp(time, self.time, values - line(self.time)) - values.mean()

    @property
    def prior(self) -> np.ndarray:
        """Prior sigma (2 + k + f,) of the coefficients of `basis`."""
        years = max(np.ptp(self.time) / YEAR_S, 0.1)
        steps, quantities = (self.scale for _ in self.steps), (self.scale / np.ptp(v) for v in self.follows.values())
        return np.array([1e3 * self.scale, self.scale / years, *steps, *quantities])

    def kernel(self, one: np.ndarray, other: np.ndarray, walk: float) -> np.ndarray:
        """Prior covariance (a, b) between two sets of times s, of basis and random walk, `walk` per root of a year."""
        first = self.time[0]
        shared = np.abs(one - first)[:, None] + np.abs(other - first) - np.abs(one[:, None] - other)
        terms = (self.basis(one) * self.prior**2) @ self.basis(other).T
        return terms + walk**2 * shared / (2 * YEAR_S)

    @property
    def error(self) -> float:
        """Median standard deviation of the values."""
        return float(np.median(np.sqrt(np.diag(self.covariance))))

    @property
    def walks(self) -> np.ndarray:
        """Sizes (w,) of the walk per root of a year: 0, and below the error up to thrice the spread between steps."""
        parts = np.split(self.value, np.searchsorted(self.time, np.sort(self.steps)))
        spread = max(3 * self.error, *(np.ptp(part) for part in parts if part.size))
        years = max(np.median(np.diff(self.time)) / YEAR_S, 1e-6)  # of events at one time
        return np.append(0.0, np.geomspace(SMALLEST * self.error, 3 * spread, WALKS) / np.sqrt(years))

    def options(self):
        """Yield (weight, walk, covariance (n, n) of the values) of each size of walk and scatter of any weight."""
        for (i, walk), (k, scatter) in itertools.product(enumerate(self.walks), enumerate(SCATTERS)):
            if self.weights[i, k] > 1e-4:
                noise = self.covariance + (scatter * self.error) ** 2 * np.eye(self.time.size)
                yield self.weights[i, k], walk, self.kernel(self.time, self.time, walk) + noise

    def predicted(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Value (m,) at times (m,) s and its standard deviation, without the scatter of single measurements."""
        time, means, squares, total = np.atleast_1d(time), 0.0, 0.0, 0.0
        for weight, walk, covariance in self.options():
            cross = self.kernel(time, self.time, walk)
            factor = cho_factor(covariance)
            mean = cross @ cho_solve(factor, self.value)
            variance = np.diag(self.kernel(time, time, walk)) - np.sum(cross * cho_solve(factor, cross.T).T, axis=1)
            means, squares, total = means + weight * mean, squares + weight * (variance + mean**2), total + weight
        return means / total, np.sqrt(np.maximum(squares / total - (means / total) ** 2, 0.0))

    def terms(self) -> tuple[np.ndarray, np.ndarray]:
        """Value and sigma (2 + k + f,) of the coefficients of `basis`, at the likeliest walk and scatter."""
        _, _, covariance = max(self.options(), key=lambda row: row[0])
        design = self.basis(self.time) * self.prior**2
        factor = cho_factor(covariance)
        value = design.T @ cho_solve(factor, self.value)
        return value, np.sqrt(np.maximum(self.prior**2 - np.sum(design * cho_solve(factor, design), axis=0), 0.0))

    def left_out(self) -> np.ndarray:
        """Leave-one-out residual (n,): each value less its prediction by all others, over the error of that."""
        score = 0.0
        for weight, _, covariance in self.options():
            precision = np.linalg.inv(covariance)
            score = score + weight * (precision @ self.value) / np.sqrt(np.diag(precision))
        return score


def moving(time: np.ndarray, value: np.ndarray, covariance: np.ndarray, steps: Sequence[float] = (), follows=None):
    """Moving model of a parameter (n,) with covariance at increasing times (n,) s; finds steps between events.

    Steps s are epochs at which it may have jumped, such as trims; `follows` {name: (n,)} holds quantities of the events
    that it may follow, such as fuel: it does where the evidence gains as for a step.
    """
    later = [s for s in steps if time[0] < s]  # one before all events is not told from the constant
    scale = max(float(np.ptp(value)), 3 * float(np.median(np.sqrt(np.diag(covariance)))))
    model = _weighed(time, value, covariance, later, [], scale, {})
    for name, quantity in (follows or {}).items():
        if np.ptp(quantity) > 0:
            wider = _weighed(time, value, covariance, later, [], scale, model.follows | {name: quantity})
            model = wider if wider.score > model.score + FOUND else model
    middles = np.array([(a + b) / 2 for a, b in itertools.pairwise(time)])
    while time.size > 3:
        taken = np.searchsorted(time, model.steps)
        free = middles[[k for k in range(middles.size) if k + 1 not in taken]]
        gain = _stepped(model, free) - 2 * np.log(max(free.size, 1))
        if not free.size or gain.max() < FOUND:
            return model
        at = float(free[np.argmax(gain)])
        model = _weighed(time, value, covariance, [*model.steps, at], [*model.discovered, at], scale, model.follows)
    return model


def _stepped(model, epochs):
    """Twice the log Bayes factor (m,) of one more step at each of epochs (m,) s in a Moving model."""
    steps, score = (model.time[:, None] >= epochs) * model.scale, []
    for weight, _, covariance in model.options():
        precision = np.linalg.inv(covariance)
        information, right = np.sum(steps * (precision @ steps), axis=0), steps.T @ (precision @ model.value)
        score.append(2 * np.log(weight) - np.log1p(information) + right**2 / (1 + information))
    best = np.max(score, axis=0, initial=-np.inf)
    return best + 2 * np.log(np.sum(np.exp((np.array(score) - best) / 2), axis=0))


def _weighed(time, value, covariance, steps, detected, scale, follows):
    """Moving model with the posterior probability of each size of walk and scatter, and its evidence."""
    parts = (np.append(p, np.full(n, (1 - p) / n)) for p, n in ((STILL, WALKS), (HONEST, SCATTERS.size - 1)))
    prior = np.outer(*parts)
    model = Moving(time, value, covariance, steps, detected, scale, np.ones(prior.shape), follows)
    score = [-np.linalg.slogdet(kernel)[1] - value @ np.linalg.solve(kernel, value) for _, _, kernel in model.options()]
    score = np.reshape(score, prior.shape) + 2 * np.log(prior)
    weights = np.exp((score - score.max()) / 2)
    total = score.max() + 2 * np.log(weights.sum())
    return replace(model, weights=weights / weights.sum(), score=float(total))
