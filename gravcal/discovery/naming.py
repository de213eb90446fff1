"""A second look at the names: one name a cause, one value for all blocks, nothing listed where too much is left."""

from __future__ import annotations

import numpy as np

from gravcal.discovery import adequacy, attribution, trials
from gravcal.discovery.problem import Problem, baseline_of

#: Extra chi-square per gained chi-square, and its probability, at which the blocks do not agree on one value.
DISAGREE = (0.15, 1e-4)
#: Share of the gain of a cause in no list that its form may leave.
SHADOW = 0.05


def merged(problem: Problem, chosen: list, choice) -> list:
    """Several forms of one listed cause become the form with all its parameters, of several shapes the best.

    Parameters
    ----------
    problem : Problem
    chosen : list of (index, Trial)
    choice : rounds.Choice
    """
    causes = [problem.candidates[k].cause for k, _ in chosen]
    twice = next((c for c in causes if causes.count(c) > 1 and not c.startswith("unknown:")), None)
    wide = [k for k, c in enumerate(problem.candidates) if c.cause == twice and not c.local]
    if twice is None or not wide:
        return chosen
    most = max(len(problem.candidates[k].names) for k in wide)
    whole = {k for k in wide if len(problem.candidates[k].names) == most}
    kept = [one for one, cause in zip(chosen, causes, strict=True) if cause != twice]
    rows = trials.tried(problem, baseline_of(problem, [k for k, _ in kept]), choice, [k for k, _ in kept])
    found = max((t for t in rows if t.index in whole), key=lambda t: t.gain, default=None)
    return [*kept, (found.index, found)] if found else chosen


def renamed(problem, chosen, choice):
    """A listed cause on whose value the blocks do not agree gives way to the best one in no list.

    Parameters
    ----------
    problem : Problem
    chosen : list of (index, Trial)
    choice : rounds.Choice
    """
    for position, (index, _) in enumerate(chosen):
        others = [k for i, (k, _) in enumerate(chosen) if i != position]
        if problem.candidates[index].listed and not _agreed(problem, others, index):
            chosen = _given_way(problem, chosen, position, choice, -np.inf)
    return chosen


def without_shadows(problem: Problem, chosen: list) -> list:
    """Names without those that gain little beside a cause in no list.

    A regressor made of measured channels follows an unknown effect to some ten percent of its size; what it leaves, a
    percent of its gain, looks like anything. That stays unexplained rather than get a name.

    Parameters
    ----------
    problem : Problem
    chosen : list of (index, Trial)
    """
    gains = []
    for position, (index, _) in enumerate(chosen):
        others = baseline_of(problem, [k for i, (k, _) in enumerate(chosen) if i != position])
        gram = attribution.projected(problem.total, others)
        gains.append(attribution.ratio(gram, problem.places[index], problem.size).gain)
    unknown = [g for g, (k, _) in zip(gains, chosen, strict=True) if not problem.candidates[k].listed]
    least = SHADOW * max(unknown, default=0.0)
    return [one for one, gain in zip(chosen, gains, strict=True) if gain >= least]


def settled(problem, chosen, choice, noise, before):
    """Names and adequacy; where too much is left, listed causes give way to ones in no list that are as good.

    Parameters
    ----------
    problem : Problem
    chosen : list of (index, Trial)
    choice : rounds.Choice
    noise : (n, draws) a block, of `residuals.drawn`
    before : adequacy of the baseline
    """
    if not chosen:
        return chosen, before
    after = adequacy.test(problem, baseline_of(problem, [k for k, _ in chosen]), noise)
    if after.p >= choice.level:
        return chosen, after
    other = chosen
    for position, (index, trial) in enumerate(chosen):
        if problem.candidates[index].listed:
            other = _given_way(problem, other, position, choice, trial.score - choice.tie)
    if other == chosen:
        return chosen, after
    again = adequacy.test(problem, baseline_of(problem, [k for k, _ in other]), noise)
    return (other, again) if again.p > after.p else (chosen, after)


def _given_way(problem, chosen, position, choice, least):
    """Names with one replaced by the best significant cause in no list, if its score is above the least."""
    others = [k for i, (k, _) in enumerate(chosen) if i != position]
    rows = trials.tried(problem, baseline_of(problem, others), choice, others)
    rows = [t for t in rows if t.kind == "unknown" and t.significance < choice.level and t.score > least]
    if not rows:
        return chosen
    best = max(rows, key=lambda t: t.score)
    return [*chosen[:position], (best.index, best), *chosen[position + 1 :]]


def _agreed(problem, others, index):
    """Whether all blocks agree on the value of a cause."""
    from scipy.stats import chi2 as chi2_distribution

    baseline, place = baseline_of(problem, others), problem.places[index]
    extra, dof = attribution.disagreement(problem.gram, baseline, place, problem.size)
    gain = attribution.ratio(attribution.projected(problem.total, baseline), place, problem.size).gain
    share, level = DISAGREE
    return dof <= 0 or extra - dof < share * gain or chi2_distribution.sf(extra, dof) > level
