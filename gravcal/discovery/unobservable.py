"""What the data cannot show: causes that look like the calibration parameters, and causes that look like each other."""

from __future__ import annotations

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.problem import Problem

#: Signal-to-noise ratio at a plausible size below which a direction counts as not seen.
UNSEEN = 3.0
#: Bias at a plausible size, in standard deviations of the calibration, from which it is worth a word.
BIAS = 0.5
#: Share of the power of a signature that is rounding when its part along the calibration parameters is taken off.
ROUNDING = 1e-7


def beside_calibration(problem: Problem, baseline: np.ndarray, scale: np.ndarray) -> list[dict]:
    """Directions of listed causes that vanish beside the calibration parameters, with the bias they could cause.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted, the shared ones first
    scale : (s,) factor from the shared parameters to the numbers that are reported

    Returns
    -------
    rows : {"cause", "direction": {parameter: share of its plausible size}, "signal_to_noise", "bias": [s],
        "bias_in_sigma"} at the plausible size
    """
    total, width = problem.total, scale.size
    inverse = attribution.inverse_of(total[np.ix_(baseline, baseline)])
    gram = attribution.projected(total, baseline)
    rows = []
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        if not candidate.listed or "alone" in candidate.form or candidate.local or not candidate.prior:
            continue
        prior = np.asarray(candidate.prior)
        whole, seen = (matrix[place, place] * np.outer(prior, prior) for matrix in (total, gram))
        shift = (inverse @ total[np.ix_(baseline, np.arange(place.start, place.stop))])[:width] * prior
        rows += _directions(candidate, (whole, seen), shift, inverse[:width, :width], scale)
    return rows


def _directions(candidate, grams, shift, covariance, scale):
    whole, seen = grams
    values, vectors = np.linalg.eigh(seen)
    precision = np.linalg.inv(covariance)
    rows = []
    for value, vector in zip(values, vectors.T, strict=True):
        bias = shift @ vector
        left = value if value > ROUNDING * (vector @ whole @ vector) else 0.0
        ratio, size = float(np.sqrt(left)), float(np.sqrt(bias @ precision @ bias))
        if ratio < UNSEEN and size > BIAS:
            shares = zip(candidate.names, vector.tolist(), strict=True)
            direction = {n: round(v, 4) for n, v in shares if abs(v) > 0.05}
            one = {"cause": candidate.cause, "direction": direction, "signal_to_noise": ratio}
            rows.append(one | {"bias": (scale * bias).tolist(), "bias_in_sigma": size})
    return rows


def separation(problem: Problem, baseline: np.ndarray, index: int, other: int, tie: float) -> dict:
    """How well this data tells two causes apart, where it does so best, and how much data would do.

    Parameters
    ----------
    problem : Problem
    baseline : (p,) indices of columns that are fitted beside both
    index : of the candidate that is taken for true, at its fitted value
    other : of the candidate that is fitted instead
    tie : expected chi-square from which two causes are told apart

    Returns
    -------
    row : {"cause", "expected_chi2", "best_block", "events_needed"}, None for events that cannot tell them apart
    """
    total = problem.total
    gram = attribution.projected(total, baseline)
    true, place = problem.places[index], problem.places[other]
    value = attribution.ratio(gram, true, problem.size).value
    fixed = np.concatenate([baseline, np.arange(place.start, place.stop)])
    signature = total[fixed][:, true] @ value
    whole = np.zeros(total.shape[0])
    whole[true] = value
    whole[fixed] -= attribution.inverse_of(total[np.ix_(fixed, fixed)]) @ signature
    parts = np.einsum("m,bmk,k->b", whole, problem.gram, whole)
    expected = float(max(parts.sum(), 0.0))
    needed = int(np.ceil(tie / expected)) if expected > 1e-3 * tie else None
    best = problem.blocks[int(np.argmax(parts))].label if expected > 1e-6 else None
    cause = problem.candidates[other].cause
    return {"cause": cause, "expected_chi2": expected, "best_block": best, "events_needed": needed}
