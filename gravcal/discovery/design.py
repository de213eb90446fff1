"""Which manoeuvres to fly: those of a flown library that make a calibration best known and causes separable.

Manoeuvres share nothing but the global parameters, so that what they tell adds: N = sum n_i N_i, with N_i the products
of the whitened columns of manoeuvre i, its local columns projected out. The design of a given number of manoeuvres with
the least trace of the covariance of the parameters (A-optimal) is found by exchanges (Fedorov 1972, Theory of Optimal
Experiments). What is not known beforehand, such as the orbit, is drawn: several flights are pooled. A design is chosen
by some and judged by others, for the best of many is never as good again.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from gravcal.discovery import attribution
from gravcal.discovery.problem import prepare
from gravcal.errors import refuse
from gravcal.estimation.records import Observations, slug_of

#: Share of the information of the whole library that is added to a design, so that its inverse exists.
LOOSE = 1e-9
#: Weight of a pair of causes that is not separated, against the log trace of the covariance.
INSISTENCE = 10.0


@dataclass(frozen=True)
class Flown:
    """Information of the k manoeuvres of one flight on calibration parameters and causes."""

    information: np.ndarray  #: (k, p, p) of each on the parameters of the calibration as it is estimated
    #: (k, m, m) products of the whitened columns of discovery, local ones projected out: parameters, causes
    gram: np.ndarray
    item: np.ndarray  #: (k,) number of the manoeuvre in the list of what was planned
    parameters: Sequence[str]  #: (p,) names of those of the calibration
    unit: str  #: of these, as reported
    scale: np.ndarray  #: (p,) factor to that unit
    causes: dict[str, slice]  #: {slug: slice of its columns}
    prior: dict[str, np.ndarray]  #: {slug: plausible sizes}
    size: np.ndarray  #: (m,) norm of the columns, the scale of what a fit leaves of them


def flown(observed: Observations, information, times: Sequence, items: Sequence[int], causes=()) -> Flown:
    """Flown: information of each manoeuvre of a flight on the parameters and on some causes, catalogue slugs.

    The blocks of the manoeuvres stand first, in order of time, as their information (k, p, p) in the calibration does;
    times are begin and end, GPS s, of each that was flown, items its number in the plan.
    """
    candidates = _candidates(observed, causes)
    problem = prepare(observed.blocks, candidates)
    middles = [float(np.mean(block.time)) for block in observed.blocks[: len(information)]]
    pairs = [
        (k, item)
        for k, middle in enumerate(middles)
        for item, (begin, end) in zip(items, times, strict=True)
        if begin <= middle <= end
    ]
    used, numbers = np.array(pairs, dtype=int).reshape(-1, 2).T
    width = len(observed.parameters)
    first_cause = 1 + observed.blocks[0].global_columns.shape[1]
    kept = np.concatenate([np.arange(1, 1 + width), np.arange(first_cause, problem.gram.shape[1])])
    slices = [slice(place.start - first_cause + width, place.stop - first_cause + width) for place in problem.places]
    return Flown(
        np.asarray(information)[used],
        problem.gram[np.ix_(used, kept, kept)],
        numbers,
        observed.parameters,
        observed.unit,
        np.asarray(observed.scale, dtype=float),
        dict(zip(causes, slices, strict=True)),
        {slug: np.asarray(one.prior, dtype=float) for slug, one in zip(causes, candidates, strict=True)},
        problem.size[kept],
    )


def _candidates(observed, causes):
    """Candidate with most parameters of each cause, in their order; refuses causes without plausible sizes."""
    share = lambda one: one.shape.value[0] / one.prior[0] if one.shape and one.shape.sized else 1.0  # noqa: E731
    ordered = sorted(observed.candidates, key=lambda one: (len(one.names), -abs(np.log(share(one)))))
    widest = {slug_of(one.cause): one for one in ordered}
    for slug in causes:
        if slug not in widest or not len(widest[slug].prior):
            offered = ", ".join(sorted(name for name, one in widest.items() if len(one.prior)))
            refuse(
                f"cause {slug}", f"that {observed.name} does not look for it", f"one of {offered}", "Correct the name."
            )
    return [widest[slug] for slug in causes]


def apart(observed: Observations, causes: Sequence[str]) -> dict[tuple[str, str], float]:
    """{pair of causes: expected chi-square, lesser of both ways} in a whole session, global parameters free."""
    candidates = _candidates(observed, causes)
    problem = prepare(observed.blocks, candidates)
    gram = attribution.projected(problem.total, np.arange(1, problem.shared.stop))
    prior = {slug: np.asarray(one.prior) for slug, one in zip(causes, candidates, strict=True)}
    places = dict(zip(causes, problem.places, strict=True))
    return _apart(gram, problem.size, prior, places, itertools.combinations(causes, 2))


def _apart(gram, size, prior, places, pairs):
    """{pair: expected chi-square, lesser of both ways} of one acting at its plausible size and the other fitted."""

    def left(true, fitted):  # expected chi-square, summed over the parameters of the true one
        sizes = np.diag(prior[true])
        return sum(max(attribution.misfit(gram, places[true], one, places[fitted], size), 0.0) for one in sizes)

    return {(a, b): float(min(left(a, b), left(b, a))) for a, b in pairs}


def weight(flight: Flown, counts: np.ndarray) -> np.ndarray:
    """Weight (k,) of each flown manoeuvre in a design with counts (n,) of those planned; repeats share theirs."""
    return (counts / np.maximum(np.bincount(flight.item, minlength=counts.size), 1))[flight.item]


def covariance(flight: Flown, counts: np.ndarray) -> np.ndarray:
    """Covariance (p, p) of the parameters in the reported unit for a design with counts (n,), noise alone."""
    loose = LOOSE * np.diag(np.diag(flight.information.sum(axis=0)))
    information = np.tensordot(weight(flight, counts), flight.information, axes=1)
    return np.outer(flight.scale, flight.scale) * np.linalg.inv(information + loose)


def odds(chi2: float, tied: float) -> float:
    """Probability that two causes are separated, from their expected chi-square and that below which they are tied.

    The log-likelihood ratio of the true to the other one has mean chi2 and variance 4 chi2.
    """
    return float(norm.sf(tied, chi2, 2 * np.sqrt(chi2))) if chi2 > 0 else 0.0


def needed(probability: float, tied: float) -> float:
    """Expected chi-square at which two causes are separated with a probability; the inverse of `odds`."""
    quantile = norm.ppf(probability)
    return float((quantile + np.sqrt(quantile**2 + tied)) ** 2)


def pooled(flights: Sequence[Flown]) -> Flown:
    """All flights of a library as one Flown, in which each manoeuvre has the mean information of its flights."""
    first = flights[0]
    join = lambda name: np.concatenate([getattr(one, name) for one in flights])  # noqa: E731
    size = np.sqrt(sum(one.size**2 for one in flights))
    return replace(first, information=join("information"), gram=join("gram"), item=join("item"), size=size)


def judged(flight: Flown, counts: np.ndarray, pairs: Sequence[tuple[str, str]] = ()):
    """Covariance (p, p) of a design with counts (n,), and {pair: expected chi-square, lesser of both ways}."""
    if not pairs:
        return covariance(flight, counts), {}
    gram = np.tensordot(weight(flight, counts), flight.gram, axes=1)
    gram = attribution.projected(gram, np.arange(flight.scale.size))
    return covariance(flight, counts), _apart(gram, flight.size, flight.prior, flight.causes, pairs)


def short(apart: Mapping, chi2: float) -> float:
    """Penalty on a design, in its log trace, for pairs of causes that do not reach an expected chi-square."""
    return INSISTENCE * sum(max(np.log(chi2 / max(expected, 1e-6)), 0.0) for expected in apart.values())


def chosen(flight: Flown, count: int, allowed: np.ndarray, pairs=(), chi2: float = 0.0, fits=None) -> np.ndarray:
    """Number (n,) of each manoeuvre in the best design of so many found, of a library of n, each allowed (n,) times.

    Pairs of causes should reach an expected chi-square; `fits` is True of counts (n,) that may be flown together.
    """

    def loss(counts):  # log trace of the covariance and penalty of pairs
        spread, separations = judged(flight, counts, pairs)
        return np.log(np.trace(spread)) + short(separations, chi2)

    def best(options):  # counts of least loss that are allowed and fit, None if none
        options = [one for one in options if np.all(one <= allowed)]
        return next((one for one in sorted(options, key=loss) if fits is None or fits(one)), None)

    counts = np.zeros(allowed.size, dtype=int)
    step = np.eye(allowed.size, dtype=int)
    for _ in range(count):
        added = best([counts + one for one in step])
        if added is None:
            refuse("design", f"room for {counts.sum()} manoeuvres", f"room for {count}", "Loosen a constraint.")
        counts = added
    while True:
        moved = best([counts - step[i] + one for i in np.flatnonzero(counts) for one in step])
        if loss(moved) >= loss(counts) - 1e-9:
            return counts
        counts = moved
