"""What the calibration parameters become when every named cause is free with all its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution, trials
from gravcal.discovery.attribution import UNSEEN
from gravcal.discovery.problem import baseline_of, inverse_of
from gravcal.discovery.rounds import Result

CLEAR = 5.0  # sigma from which a direction is believed against its prior
UNLIKELY = 12.0  # less of score than the best form: a weight of a quarter of a percent


def widened(result: Result) -> Result:
    """Result whose calibration parameters and covariance after the extension leave named causes all their parameters.

    A cause is often named by one of its parameters; the others move the calibration too, and what the data say of them
    is part of the error. Where the data do not determine them all, the cause stays as it was named. Where causes are
    tied, the error holds how far the calibration would move with each of the others.
    """
    problem, width = result.problem, result.shared[1].size
    total, named = problem.total, [one.index for one in result.findings]
    for position, index in enumerate(named):
        others = baseline_of(problem, [*named[:position], *named[position + 1 :]])
        widest = _widest(problem, index)
        found = attribution.ratio(attribution.projected(total, others), problem.places[widest], problem.size)
        if found.determined.all():
            named[position] = widest
    fixed = baseline_of(problem, named)
    covariance = inverse_of(total[np.ix_(fixed, fixed)])
    return _after(result, (covariance @ total[fixed, 0])[:width], covariance[:width, :width], named)


def with_ties(result: Result) -> Result:
    """Result whose error after the extension holds how far the calibration would move with each tied cause."""
    return _after(result, result.shared[1], result.covariance[1], [one.index for one in result.findings])


def _after(result, value, covariance, named):
    """Result with other calibration parameters after the extension, and the error of its ties."""
    covariance = covariance + sum(_moment(result, named, k, value) for k in range(len(named)))
    ends = {"shared": value, "sigma": np.sqrt(np.diag(covariance)), "covariance": covariance}
    return replace(result, **{name: (getattr(result, name)[0], after) for name, after in ends.items()})


def _moment(result, named, position, value):
    """Second moment (p, p) of the calibration about its value over the forms of the causes that are tied.

    By their likelihood; and what the directions that the data do not see of these causes would do to the calibration.
    """
    problem, width = result.problem, value.size
    others = [*named[:position], *named[position + 1 :]]
    total, baseline = problem.total, baseline_of(problem, others)
    gram = attribution.projected(total, baseline)
    causes, rows = (result.findings[position].cause, *result.findings[position].tied), []
    for k, candidate in enumerate(problem.candidates):
        if candidate.cause in causes and k not in others:
            found = attribution.ratio(gram, problem.places[k], problem.size)
            rows.append((found.gain - trials.COST * found.dof, k))
    rows = [(score, k) for score, k in rows if score > max(rows)[0] - UNLIKELY]
    weight, moment = np.exp(np.array([score for score, _ in rows]) / 2 - max(rows)[0] / 2), np.zeros((width, width))
    for share, (_, k) in zip(weight / weight.sum(), rows, strict=True):
        if k != named[position]:
            moved = _with(problem, total, baseline, k)[:width] - value
            moment += share * np.outer(moved, moved)
    for k, whole in enumerate(problem.candidates):
        if whole.cause not in causes or k in others or "alone" in whole.form or whole.local or not whole.prior:
            continue
        likely = sum(w for w, (_, row) in zip(weight, rows, strict=True) if _is_part(problem.candidates[row], whole))
        if likely:
            moment += likely / weight.sum() * _unseen(problem, gram, baseline, k, width)
    return moment


def _is_part(one, whole):
    """Whether a candidate is a form of a cause, or one parameter of that form alone."""
    alone = "alone" in one.form and one.cause == whole.cause and set(one.names) <= set(whole.names)
    return one is whole or alone


def _unseen(problem, gram, baseline, index, width):
    """Second moment (p, p) of what directions that the data do not see of a form would do to the calibration.

    As large as those that they see, in units of what is plausible of each parameter.
    """
    place, prior = problem.places[index], np.asarray(problem.candidates[index].prior)
    inverse = inverse_of(problem.total[np.ix_(baseline, baseline)])
    known, vectors = np.linalg.eigh(gram[place, place] * np.outer(prior, prior))
    hidden = known < UNSEEN**2
    square = _scale(known[~hidden], (vectors.T @ (prior * gram[place, 0]))[~hidden] ** 2 / known[~hidden])
    shift = (inverse @ problem.total[np.ix_(baseline, np.arange(place.start, place.stop))])[:width] * prior
    bias = shift @ vectors[:, hidden] / np.sqrt(1 / square + np.maximum(known[hidden], 0.0))
    return bias @ bias.T


def _scale(known, gain):
    """Square of the most likely common size of directions, from their information (n,) and gain (n,); 1 of none."""
    square = np.geomspace(1e-6, 1e2, 161)
    width = 1 + np.outer(square, known)
    return float(square[np.argmin(np.sum(np.log(width) + gain / width, axis=1))]) if known.size else 1.0


def _with(problem, total, baseline, index):
    """Values of the baseline beside a candidate whose size is held by its prior."""
    place, prior = problem.places[index], problem.candidates[index].prior
    fixed = np.concatenate([baseline, np.arange(place.start, place.stop)])
    inner = total[np.ix_(fixed, fixed)].copy()
    if len(prior) == place.stop - place.start:
        inner[baseline.size :, baseline.size :] += np.diag(1 / np.square(prior))
    return inverse_of(inner) @ total[fixed, 0]


def named_parameters(result: Result, position: int) -> dict:
    """Parameters of a finding in the form that was named, for the extended model.

    Directions that stay below five sigma and of which the data know less than the catalogue, such as a leak that looks
    like an offset, are held by their prior: they would carry many times what is plausible into the records.

    Returns
    -------
    parameters : {name: {"value", "sigma", "unit"}}; of several also "correlation" {other name: 1}
    """
    problem, index = result.problem, result.findings[position].index
    others = baseline_of(problem, [f.index for k, f in enumerate(result.findings) if k != position])
    gram, place, entry = problem.total, problem.places[index], problem.candidates[index]
    gram = attribution.projected(gram, others)
    found = attribution.ratio(gram, place, problem.size)
    value, covariance = found.value, found.covariance
    if len(entry.prior) == len(entry.names) and found.determined.all():
        value, covariance = _held(gram[place, place], gram[place, 0], np.asarray(entry.prior, dtype=float))
    covariance = covariance if entry.spread is None else covariance + entry.spread
    sigma = np.sqrt(np.diag(covariance))
    rows = zip(entry.names, value.tolist(), sigma.tolist(), entry.units, found.determined, strict=True)
    named = {n: {"value": v if d else np.nan, "sigma": s if d else np.nan, "unit": u} for n, v, s, u, d in rows}
    if len(named) > 1 and found.determined.all():
        for (name, parameter), row in zip(named.items(), covariance / np.outer(sigma, sigma), strict=True):
            parameter["correlation"] = {n: round(r, 6) for n, r in zip(named, row.tolist(), strict=True) if n != name}
    return named


def _held(normal, right, prior):
    """Value and covariance of parameters, directions that are not clearly seen held where the prior knows more."""
    known, vectors = np.linalg.eigh(normal * np.outer(prior, prior))  # information in units of that of the prior
    score = (vectors.T @ (prior * right)) / np.sqrt(np.maximum(known, 1e-300))
    weight = np.maximum(known + ((known < 1) & (np.abs(score) < CLEAR)), 1e-300)
    back = prior[:, None] * vectors
    covariance = (back / weight) @ back.T
    return covariance @ right, covariance


def _widest(problem, index):
    """Form of a cause that holds the parameters of one of its forms and most beside them."""
    mine = problem.candidates[index]
    forms = [k for k, c in enumerate(problem.candidates) if (c.cause, c.local) == (mine.cause, mine.local)]
    forms = [k for k in forms if mine.listed and set(mine.names) < set(problem.candidates[k].names)]
    return max(forms, key=lambda k: len(problem.candidates[k].names), default=index)
