"""Two listed causes at once, where one alone explains less than something in no list."""

from __future__ import annotations

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.problem import Problem
from gravcal.discovery.trials import COST, SHARES, Trial
from gravcal.estimation import chi2_tail

#: Candidates, best first, of which all pairs are tried.
PAIRED = 30


def best_pair(problem: Problem, baseline: np.ndarray, rows: list[Trial], level: float) -> tuple[Trial, float] | None:
    """Better half of the best pair of listed causes, and the score of the pair; None if no pair passes.

    Each of the two has to be significant beside the other, corrected for the number of listed trials.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted
    rows : trials of the round
    level : family-wise level
    """
    gram = attribution.projected(problem.total, baseline)
    listed = [t for t in rows if t.kind == "listed"]
    limit = np.log(level * SHARES["listed"] / max(len(listed), 1))
    tops = sorted(listed, key=lambda t: -t.score)[:PAIRED]
    found = None
    for i, one in enumerate(tops):
        for other in tops[i + 1 :]:
            if one.cause == other.cause:
                continue
            places = [problem.places[t.index] for t in (one, other)]
            gain, dof = _joint(gram, np.r_[places[0], places[1]], problem.size)
            alone = [chi2_tail.log_tail(gain - t.gain, max(dof - t.dof, 1)) for t in (one, other)]
            score = gain - COST * dof
            if max(alone) < limit and (found is None or score > found[1]):
                found = (one if one.score > other.score else other, score)
    return found


def _joint(gram, index, size):
    """Gain of several columns, and how many directions they span."""
    scale = np.where(size[index] > 0, size[index], 1.0)
    values, vectors = np.linalg.eigh(gram[np.ix_(index, index)] / np.outer(scale, scale))
    seen = values > attribution.SEEN**2
    part = (vectors[:, seen] / np.sqrt(values[seen])).T @ (gram[index, 0] / scale)
    return float(part @ part), int(seen.sum())
