"""The one number that stands after a search: over tied causes, their forms and directions that the data do not see."""

import itertools
from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution, trials
from gravcal.discovery.attribution import ROUNDING, SEEN, UNSEEN
from gravcal.discovery.problem import baseline_of, best_fit, inverse_of, inverse_of_baseline
from gravcal.discovery.rounds import Choice, Result
from gravcal.estimation import chi2_tail
from gravcal.estimation.records import Parameter, slug_of

CLEAR = 5.0  # sigma from which a direction is believed against its prior
UNLIKELY = 12.0  # less of twice the logarithm of the evidence than the best form: a weight of a quarter of a percent
FAR = 1e-3  # probability of so large a move by the error that is then given, if the extended model is not adequate
WIDE, SAME = 2.0, 1e-2  # error over that before, and probability of the move by it, beyond which the move says nothing
#: Common sizes of a cause that was named, over its prior, and their odds: an order of magnitude more is three times
#: less likely.
BEYOND = np.geomspace(1.0, 1e6, 25)
ODDS = BEYOND**-0.5 / np.sum(BEYOND**-0.5)
SIZES = np.geomspace(1e-6, 1.0, 121)  # squares of the common size of a cause that was not named, over its prior


def delivered(result: Result, choice: Choice, count: int) -> Result:
    """Result whose calibration after the search is the one number that is delivered, with its whole error.

    The value is the mean over the causes that are tied and their forms, by their evidence with the priors of the
    catalogue; the error holds their spread, and what directions that the data do not see would do: of named causes as
    large as those that are seen, of all others at the price of their prior, one cause in the catalogue being there.

    An extension is adopted only if it leaves no more than noise, or foretells manoeuvres left out and moves the
    calibration, its first `count` parameters, no further than the error it is then given. What has no mechanism, such
    as lines and drivers in no list, may not move it by more than its error before, and causes that are tied and
    disagree not within the error that they leave. Where it is not adopted the value stays, and the move is in its
    error; so does a parameter that the extension leaves open, see `left_open`.
    """
    names, before = result.findings, result.shared[0]
    tones = set(choice.tone_causes.values())
    sure = [one.cause.partition(":")[0] != "unknown" and one.cause not in tones for one in names]
    adopted = [one.cause != trials.EXCESS for one in names]  # which no model takes out
    value, covariance = _averaged(result, adopted)
    whole, least = (_averaged(result, used) for used in ([True] * len(names), sure))
    if np.any(np.abs(value - least[0])[:count] > result.sigma[0][:count]):
        adopted, (value, covariance) = sure, least
    if not any(adopted):  # of a search in records that a first one has changed that is not what these rows give
        value = before
    kept = [one for one, known in zip(names, adopted, strict=True) if known]
    foretold = all(one.heldout > 0 and one.kind == "manoeuvres" for one in kept)
    move = (value - before)[:count]
    chance = chi2_tail.log_tail(move @ inverse_of(covariance[:count, :count]) @ move, count) if count else 0.0
    alike = any(one.tied or one.imitators for one in kept)
    wide = alike and np.any(np.sqrt(np.diag(covariance)) > WIDE * result.sigma[0]) and chance > np.log(SAME)
    if wide or not (result.after.p >= choice.level or (foretold and chance > np.log(FAR))):
        adopted, kept, value = [False] * len(names), [], before
    away = left_open(value - before, covariance, result.sigma[0])
    value, covariance = value - away, covariance + np.outer(away, away)
    if not all(adopted):
        covariance = covariance + np.outer(whole[0] - value, whole[0] - value)
    if not names and result.before.p < choice.level:
        tried = {one.index for one in result.first if one.index >= 0 and result.problem.candidates[one.index].prior}
        covariance = covariance + _over_forms(result.problem, [], tried, (-1, value))[1]
    unseen = _unnamed(result, [one.index for one in kept], value.size)
    covariance = covariance + sum(unseen.values()) + np.diag(_open_means(result, value.size))
    ends = {"shared": value, "covariance": covariance}
    ends = {name: (getattr(result, name)[0], after) for name, after in ends.items()}
    return replace(result, **ends, adopted=adopted, unseen={c: np.sqrt(np.diag(one)) for c, one in unseen.items()})


def _open_means(result, width):
    """Variances (p,) by the means of what was named: a wave about any mean describes the data as well.

    Each is taken to be as large as the wave.
    """
    variance = np.zeros(width)
    for one in result.findings:
        means = result.problem.candidates[one.index].means
        for place, size in zip(itertools.cycle(means), np.nan_to_num(one.value)):  # cosine and sine have the same
            variance[place] += size**2
    return variance


def left_open(move: np.ndarray, covariance: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Parts (p,) of a move that say nothing: of parameters left open, and of others what goes with these.

    A parameter is left open if its error grows beyond twice that before, sigma (p,), and its move is within it. It
    keeps its value, one after the other, and the rest have theirs beside it (Gaussian conditional mean).
    """
    kept, rest, left = [], move, covariance
    while True:
        error = np.sqrt(np.maximum(np.diag(left), 1e-300))
        chance = chi2_tail.log_tail(np.square(rest / error), np.ones(move.size))
        wide = (np.sqrt(np.diag(covariance)) > WIDE * sigma) & (chance > np.log(SAME)) & (rest != 0)
        wide[kept] = False
        if not wide.any():
            return move - rest
        kept.append(int(np.argmax(np.where(wide, chance, -np.inf))))
        share = covariance[:, kept] @ inverse_of(covariance[np.ix_(kept, kept)])
        rest, left = move - share @ move[kept], covariance - share @ covariance[kept]
        rest[kept] = 0.0


def _averaged(result, used):
    """Mean (p,) of the calibration over what may be there instead of some of the names, and its covariance (p, p)."""
    problem, width = result.problem, result.shared[1].size
    named = list(itertools.compress([one.index for one in result.findings], used))
    fixed = baseline_of(problem, named)
    inverse = inverse_of_baseline(problem, fixed)
    fitted, covariance = (inverse @ problem.total[fixed, 0])[:width], inverse[:width, :width]
    value, shapes = fitted.copy(), (problem.candidates[k].shape for k in named)
    for slopes in (one.slopes for one in shapes if one is not None and one.slopes is not None):
        moved, left = best_fit(problem, fixed, slopes)  # it fits best there, so that no value moves
        covariance = covariance + moved[:width] @ inverse_of(sum(one.T @ one for one in left)) @ moved[:width].T
    for position, one in enumerate(itertools.compress(result.findings, used)):
        others = [*named[:position], *named[position + 1 :]]
        causes, forms = {one.cause, *one.tied}, {(own.cause, own.form) for own in one.imitators}
        alike = {k for k, c in enumerate(problem.candidates) if c.cause in causes or (c.cause, c.form) in forms}
        tried = {named[position]} | (alike - {*others})  # forms of it and of listed causes tied with it, imitators
        mean, spread = _over_forms(problem, others, tried, (named[position], fitted))
        value, covariance = value + mean, covariance + spread - np.outer(mean, mean)
    return value, covariance


def _over_forms(problem, others, tried, about):
    """Mean (p,) and second moment (p, p) of how far candidates move the calibration, by their evidence.

    With what the directions that the data do not see of them would do to the calibration.
    """
    (named, value), baseline = about, baseline_of(problem, others)
    width, gram = value.size, attribution.projected(problem.total, baseline)
    mean, moment = np.zeros(width), np.zeros((width, width))
    rows = [(*_evidence(problem, gram, k), k) for k in sorted(tried)]
    rows = [(score + _odds(problem, k), size, k) for score, size, k in rows]
    rows = [one for one in rows if one[0] > max(rows)[0] - UNLIKELY]
    weight = np.exp(np.array([score for score, *_ in rows]) / 2 - max(rows, default=(0,))[0] / 2)
    weight = weight / weight.sum()
    for share, (_, size, k) in zip(weight, rows, strict=True):
        if k != named:
            moved = _with(problem, baseline, k, size)[:width] - value
            mean, moment = mean + share * moved, moment + share * np.outer(moved, moved)
    causes, sized = {problem.candidates[k].cause for *_, k in rows}, _scale
    for k, whole in enumerate(problem.candidates):
        if whole.cause in causes and k not in others and _whole(whole):
            parts = [problem.candidates[row] for *_, row in rows]  # forms of the cause, or one parameter of it alone
            alone = [p.cause == whole.cause and "alone" in p.form and {*p.names} <= {*whole.names} for p in parts]
            likely = float(weight @ [part is whole or one for part, one in zip(parts, alone, strict=True)])
            moment = moment + likely * (_unseen(problem, gram, baseline, k, width, sized) if likely else 0.0)
    return mean, moment


def _odds(problem, index):
    """Twice the logarithm of the odds of a candidate beforehand: those in no list share less, and are many."""
    listed = problem.candidates[index].listed
    alike = sum(one.listed == listed for one in problem.candidates)
    return 2 * np.log(trials.SHARES["listed" if listed else "unknown"] / alike)


def _evidence(problem, gram, index):
    """Twice the logarithm of the evidence of a candidate over that of none, and its most likely size over its prior.

    Its parameters are spread as its prior says, times any size of `BEYOND`: a Gaussian of the plausible size would
    exclude a size a hundred times larger whatever else explains the data. Without a prior as wide as they are found,
    the widest that gains.
    """
    place, prior = problem.places[index], np.asarray(problem.candidates[index].prior)
    if prior.size == place.stop - place.start:
        known, vectors, real = _directions(problem, gram, place, prior)
        known, right = known[real], ((vectors.T @ (prior * gram[place, 0])) ** 2)[real]
        more = 1 + np.outer(BEYOND**2, known)
        score = np.sum(BEYOND[:, None] ** 2 * right / more - np.log(more), axis=1) + 2 * np.log(ODDS)
        return float(2 * np.logaddexp.reduce(score / 2)), float(BEYOND[np.argmax(score)])
    gain, dof, _ = attribution.gained(gram, place, problem.size)
    return (gain - dof * (1 + np.log(max(gain / dof, 1.0))) if dof else 0.0), 1.0


def _whole(candidate):
    """Whether a candidate has all parameters of a form whose plausible sizes are known, in more than one block."""
    whole = "alone" not in candidate.form and not candidate.local
    return whole and candidate.listed and len(candidate.prior) == len(candidate.names)


def _unnamed(result, named, width):
    """Second moments {cause: (p, p)} of the error of the result by causes not named, in directions the data do not see.

    Each cause of the catalogue is there with a probability of one in their number; its size is at most its prior, by
    the likelihood of the directions that the data see.
    """
    problem, causes = result.problem, {slug_of(c) for one in result.findings for c in (one.cause, *one.tied)}
    baseline, forms = baseline_of(problem, named), {}
    gram = attribution.projected(problem.total, baseline)
    for k, candidate in enumerate(problem.candidates):
        if _whole(candidate) and not candidate.of_frame:
            forms.setdefault(slug_of(candidate.cause), []).append(k)
    odds, moments = 1 / max(len(forms) - 1, 1), {}

    def weights(known, gain):
        spread = 1 + np.outer(SIZES, known)
        evidence = np.exp(np.minimum(np.sum(gain - np.log(spread) - gain / spread, axis=1) / 2, 300.0))
        return SIZES, odds * evidence / evidence.size / (1 + odds * evidence.mean())

    for cause, rows in forms.items():
        if cause not in causes:
            moments[cause] = sum(_unseen(problem, gram, baseline, k, width, weights) for k in rows) / len(rows)
    return moments


def _unseen(problem, gram, baseline, index, width, sized):
    """Second moment (p, p) of what directions that the data do not see of a form would do to the calibration.

    In units of what is plausible of each parameter; `sized` gives squares of their common size and the weights of
    these, by what is known (n,) of the directions that are seen and the chi-square (n,) that each gains.
    """
    place, prior = problem.places[index], np.asarray(problem.candidates[index].prior)
    inverse = inverse_of_baseline(problem, baseline)
    known, vectors, real = _directions(problem, gram, place, prior, ROUNDING)
    hidden = known < UNSEEN**2
    square, share = sized(known[~hidden], (vectors.T @ (prior * gram[place, 0]))[~hidden] ** 2 / known[~hidden])
    shift = (inverse @ problem.total[np.ix_(baseline, np.arange(place.start, place.stop))])[:width] * prior
    size = np.sum(share / (1 / square + np.where(real, known, 0.0)[hidden, None]), axis=1)
    bias = shift @ vectors[:, hidden] * np.sqrt(size)
    return bias @ bias.T


def _scale(known, gain):
    """Square of the most likely common size of directions, from their information (n,) and gain (n,); 1 of none."""
    square = np.geomspace(1e-6, 1e2, 161)
    width = 1 + np.outer(square, known)
    best = square[np.argmin(np.sum(np.log(width) + gain / width, axis=1))] if known.size else 1.0
    return np.array([best]), np.ones(1)


def _with(problem, baseline, index, size):
    """Values of the baseline beside a candidate held by so many times its prior, its directions of rounding at zero."""
    place, prior = problem.places[index], size * np.asarray(problem.candidates[index].prior)
    fixed = np.concatenate([baseline, np.arange(place.start, place.stop)])
    if len(prior) != place.stop - place.start:
        return inverse_of_baseline(problem, fixed) @ problem.total[fixed, 0]
    gram = attribution.projected(problem.total, baseline)
    known, vectors, real = _directions(problem, gram, place, prior)
    vectors = prior[:, None] * vectors[:, real]
    value = vectors @ ((vectors.T @ gram[place, 0]) / (1 + known[real]))
    right = problem.total[baseline, 0] - problem.total[np.ix_(baseline, fixed[baseline.size :])] @ value
    return inverse_of_baseline(problem, baseline) @ right


def _directions(problem, gram, place, prior, least=SEEN**2):
    """Information (q,) on directions (q, q) of a candidate in units of its prior, and whether a share of it is seen."""
    whole, left = (matrix[place, place] * np.outer(prior, prior) for matrix in (problem.total, gram))
    known, vectors = np.linalg.eigh(left)
    return known, vectors, known > least * np.einsum("qk,qr,rk->k", vectors, whole, vectors)


def named_parameters(result: Result, position: int) -> dict[str, Parameter]:
    """Parameters of a finding by name, for the model, in the form named.

    Directions that stay below five sigma and of which the data know less than the catalogue, such as a leak that looks
    like an offset, are held by their prior: they would carry many times what is plausible into the records.
    """
    problem, index = result.problem, result.findings[position].index
    others = baseline_of(problem, [f.index for k, f in enumerate(result.findings) if k != position])
    gram, place, entry = problem.total, problem.places[index], problem.candidates[index]
    gram = attribution.projected(gram, others)
    ratio = attribution.ratio(gram, place, problem.size)
    value, covariance = ratio.value, ratio.covariance
    if len(entry.prior) == len(entry.names) and ratio.determined.all():
        value, covariance = _held(gram[place, place], gram[place, 0], np.asarray(entry.prior, dtype=float))
    covariance = covariance if entry.spread is None else covariance + entry.spread
    sigma = np.sqrt(np.diag(covariance))
    rows = zip(entry.names, value.tolist(), sigma.tolist(), entry.units, ratio.determined, strict=True)
    named = {n: Parameter(v if d else np.nan, s if d else np.nan, u) for n, v, s, u, d in rows}
    if len(named) > 1 and ratio.determined.all():
        for name, row in zip(entry.names, covariance / np.outer(sigma, sigma), strict=True):
            related = {n: round(r, 6) for n, r in zip(named, row.tolist(), strict=True) if n != name}
            named[name] = replace(named[name], correlation=related)
    return named


def _held(normal, right, prior):
    """Value and covariance of parameters, directions that are not clearly seen held where the prior knows more."""
    known, vectors = np.linalg.eigh(normal * np.outer(prior, prior))  # information in units of that of the prior
    score = (vectors.T @ (prior * right)) / np.sqrt(np.maximum(known, 1e-300))
    weight = np.maximum(known + ((known < 1) & (np.abs(score) < CLEAR)), 1e-300)
    back = prior[:, None] * vectors
    covariance = (back / weight) @ back.T
    return covariance @ right, covariance
