"""Bayesian average of the calibration after a search: over tied causes, their forms and unobservable directions."""

import itertools
from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution, trials
from gravcal.discovery.attribution import ROUNDING, UNSEEN
from gravcal.discovery.problem import baseline_of, best_fit, inverse_of, inverse_of_baseline
from gravcal.discovery.rounds import Choice, Result
from gravcal.estimation import chi2_tail
from gravcal.estimation.records import Parameter, slug_of

CLEAR = 5.0  # sigma from which a direction is believed against its prior
UNLIKELY = 12.0  # of twice the log evidence below the best form, from which a form is dropped: a weight of 1/400
FAR = 1e-3  # least p-value of the move by its new error, for adoption where the extended model is not adequate
WIDE, SAME = 2.0, 1e-2  # error over that before, and p-value of the move by it, above which the move says nothing
#: Common sizes of a cause that was named, over its prior, and their odds: an order of magnitude more is three times
#: less likely.
BEYOND = np.geomspace(1.0, 1e6, 25)
ODDS = BEYOND**-0.5 / np.sum(BEYOND**-0.5)
SIZES = np.geomspace(1e-6, 1.0, 121)  # squares of the common size of a cause that was not named, over its prior


def delivered(result: Result, choice: Choice, count: int) -> Result:
    """Result with the calibration that is delivered: shared parameters after the search, averaged, with their error.

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
    full, least = (_averaged(result, used) for used in ([True] * len(names), sure))
    if np.any(np.abs(value - least[0])[:count] > result.sigma[0][:count]):
        adopted, (value, covariance) = sure, least
    if not any(adopted):  # of a search in records that a first one has changed that is not what these rows give
        value = before
    kept = [one for one, known in zip(names, adopted, strict=True) if known]
    foretold = all(one.heldout > 0 and one.kind == "manoeuvres" for one in kept)
    move = (value - before)[:count]
    chance = chi2_tail.log_tail(move @ inverse_of(covariance[:count, :count]) @ move, count) if count else 0.0
    ambiguous = any(one.tied or one.imitators for one in kept)
    wide = ambiguous and np.any(np.sqrt(np.diag(covariance)) > WIDE * result.sigma[0]) and chance > np.log(SAME)
    if wide or not (result.after.p >= choice.level or (foretold and chance > np.log(FAR))):
        adopted, kept, value = [False] * len(names), [], before
    open_part = left_open(value - before, covariance, result.sigma[0])
    value, covariance = value - open_part, covariance + np.outer(open_part, open_part)
    if not all(adopted):
        covariance = covariance + np.outer(full[0] - value, full[0] - value)
    if not names and result.before.p < choice.level:
        tried = {one.index for one in result.first if one.index >= 0 and result.problem.candidates[one.index].prior}
        covariance = covariance + _over_forms(result.problem, [], tried, (-1, value))[1]
    unseen = _unnamed(result, [one.index for one in kept], value.size)
    covariance = covariance + sum(unseen.values()) + np.diag(_open_means(result, value.size))
    ends = {"shared": value, "covariance": covariance}
    ends = {name: (getattr(result, name)[0], after) for name, after in ends.items()}
    return replace(result, **ends, adopted=adopted, unseen={c: np.sqrt(np.diag(one)) for c, one in unseen.items()})


def _open_means(result, width):
    """Variance (p,) of the parameters by the unknown means of named waves: one about any mean fits as well.

    Each mean has the size of the wave as standard deviation.
    """
    variance = np.zeros(width)
    for one in result.findings:
        means = result.problem.candidates[one.index].means
        for place, size in zip(itertools.cycle(means), np.nan_to_num(one.value)):  # cosine and sine have the same
            variance[place] += size**2
    return variance


def left_open(move: np.ndarray, covariance: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Part (p,) of a parameter change that carries no information: open parameters and what goes with them.

    A parameter is left open if its error grows beyond twice that before, sigma (p,), and its move is within it. It
    keeps its value, one after the other, and the rest have theirs beside it (Gaussian conditional mean).
    """
    kept, remainder, conditional = [], move, covariance
    while True:
        error = np.sqrt(np.maximum(np.diag(conditional), 1e-300))
        chance = chi2_tail.log_tail(np.square(remainder / error), np.ones(move.size))
        wide = (np.sqrt(np.diag(covariance)) > WIDE * sigma) & (chance > np.log(SAME)) & (remainder != 0)
        wide[kept] = False
        if not wide.any():
            return move - remainder
        kept.append(int(np.argmax(np.where(wide, chance, -np.inf))))
        share = covariance[:, kept] @ inverse_of(covariance[np.ix_(kept, kept)])
        remainder, conditional = move - share @ move[kept], covariance - share @ covariance[kept]
        remainder[kept] = 0.0


def _averaged(result, used):
    """Mean (p,), covariance (p, p) of the shared parameters over alternatives to the findings that used selects."""
    problem, width = result.problem, result.shared[1].size
    named = list(itertools.compress([one.index for one in result.findings], used))
    fixed = baseline_of(problem, named)
    inverse = inverse_of_baseline(problem, fixed)
    fitted, covariance = (inverse @ problem.total[fixed, 0])[:width], inverse[:width, :width]
    value, shapes = fitted.copy(), (problem.candidates[k].shape for k in named)
    for slopes in (one.slopes for one in shapes if one is not None and one.slopes is not None):
        moved, residuals = best_fit(problem, fixed, slopes)  # it fits best there, so that no value moves
        covariance = covariance + moved[:width] @ inverse_of(sum(one.T @ one for one in residuals)) @ moved[:width].T
    for position, one in enumerate(itertools.compress(result.findings, used)):
        others = [*named[:position], *named[position + 1 :]]
        causes, forms = {one.cause, *one.tied}, {(imitator.cause, imitator.form) for imitator in one.imitators}
        equal = {k for k, c in enumerate(problem.candidates) if c.cause in causes or (c.cause, c.form) in forms}
        tried = {named[position]} | (equal - {*others})  # forms of it and of listed causes tied with it, imitators
        mean, spread = _over_forms(problem, others, tried, (named[position], fitted))
        value, covariance = value + mean, covariance + spread - np.outer(mean, mean)
    return value, covariance


def _over_forms(problem, others, tried, about):
    """Evidence-weighted mean (p,) and second moment (p, p) of the change of the parameters by candidates tried.

    The change is from about, (index named, its parameters (p,)); the moment includes unobservable directions.
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
    causes, likeliest = {problem.candidates[k].cause for *_, k in rows}, _scale
    for k, form in enumerate(problem.candidates):
        if form.cause in causes and k not in others and _whole(form):
            parts = [problem.candidates[row] for *_, row in rows]  # forms of the cause, or one parameter of it alone
            alone = [p.cause == form.cause and "alone" in p.form and {*p.names} <= {*form.names} for p in parts]
            likely = float(weight @ [part is form or one for part, one in zip(parts, alone, strict=True)])
            moment = moment + likely * (_unseen(problem, gram, baseline, k, width, likeliest) if likely else 0.0)
    return mean, moment


def _odds(problem, index):
    """Twice the log prior odds of a candidate: the share of the level of its kind over the number of that kind."""
    listed = problem.candidates[index].listed
    number = sum(one.listed == listed for one in problem.candidates)
    return 2 * np.log(trials.SHARES["listed" if listed else "unknown"] / number)


def _evidence(problem, gram, index):
    """Twice the log Bayes factor of a candidate against none, and its likeliest size over its prior.

    Its parameters are spread as its prior says, times any size of `BEYOND`: a Gaussian of the plausible size would
    exclude a size a hundred times larger whatever else explains the data. Without a prior, that of the width with the
    largest evidence.
    """
    place, prior = problem.places[index], np.asarray(problem.candidates[index].prior)
    if prior.size == place.stop - place.start:
        information, vectors, real = attribution.directions(problem, gram, place, prior)
        information, right = information[real], ((vectors.T @ (prior * gram[place, 0])) ** 2)[real]
        widened = 1 + np.outer(BEYOND**2, information)
        score = np.sum(BEYOND[:, None] ** 2 * right / widened - np.log(widened), axis=1) + 2 * np.log(ODDS)
        return float(2 * np.logaddexp.reduce(score / 2)), float(BEYOND[np.argmax(score)])
    gain, dof, _ = attribution.gained(gram, place, problem.size)
    return (gain - dof * (1 + np.log(max(gain / dof, 1.0))) if dof else 0.0), 1.0


def _whole(candidate):
    """True if a listed candidate has all parameters of its form, each with a prior, in more than one block."""
    whole = "alone" not in candidate.form and not candidate.local
    return whole and candidate.listed and len(candidate.prior) == len(candidate.names)


def _unnamed(result, named, width):
    """{cause: (p, p)} second moment of the parameter error by each cause not named, unobservable directions only.

    Each cause of the catalogue is there with a probability of one in their number; its size is at most its prior, by
    the likelihood of its observable directions.
    """
    problem, causes = result.problem, {slug_of(c) for one in result.findings for c in (one.cause, *one.tied)}
    baseline, forms = baseline_of(problem, named), {}
    gram = attribution.projected(problem.total, baseline)
    for k, candidate in enumerate(problem.candidates):
        if _whole(candidate) and not candidate.of_frame:
            forms.setdefault(slug_of(candidate.cause), []).append(k)
    odds = 1 / max(len(forms) - 1, 1)

    def weights(known, gain):  # squared sizes (s,) and their probability, that of the cause included
        spread = 1 + np.outer(SIZES, known)
        evidence = np.exp(np.minimum(np.sum(gain - np.log(spread) - gain / spread, axis=1) / 2, 300.0))
        return SIZES, odds * evidence / evidence.size / (1 + odds * evidence.mean())

    moment = lambda rows: sum(_unseen(problem, gram, baseline, k, width, weights) for k in rows)  # noqa: E731
    return {cause: moment(rows) / len(rows) for cause, rows in forms.items() if cause not in causes}


def _unseen(problem, gram, baseline, index, width, sized):
    """Second moment (p, p) of the bias of the parameters by the unobservable directions of a candidate.

    In units of the prior sigma of each parameter; `sized` takes the information (n,) and the chi-square gain (n,) of
    the observable directions to squares (s,) of the common size of all directions and the weights (s,) of these.
    """
    place, prior = problem.places[index], np.asarray(problem.candidates[index].prior)
    inverse = inverse_of_baseline(problem, baseline)
    known, vectors, real = attribution.directions(problem, gram, place, prior, ROUNDING)
    hidden = known < UNSEEN**2
    square, share = sized(known[~hidden], (vectors.T @ (prior * gram[place, 0]))[~hidden] ** 2 / known[~hidden])
    sensitivity = (inverse @ problem.total[np.ix_(baseline, np.arange(place.start, place.stop))])[:width] * prior
    variance = np.sum(share / (1 / square + np.where(real, known, 0.0)[hidden, None]), axis=1)
    bias = sensitivity @ vectors[:, hidden] * np.sqrt(variance)
    return bias @ bias.T


def _scale(known, gain):
    """Square (1,) of the likeliest common size of directions from information and gain (n,), 1 if none; weight."""
    square = np.geomspace(1e-6, 1e2, 161)
    variance = 1 + np.outer(square, known)
    best = square[np.argmin(np.sum(np.log(variance) + gain / variance, axis=1))] if known.size else 1.0
    return np.array([best]), np.ones(1)


def _with(problem, baseline, index, size):
    """Baseline parameters (p,) with a candidate fitted under size times its prior, directions of rounding at 0."""
    place, prior = problem.places[index], size * np.asarray(problem.candidates[index].prior)
    fixed = np.concatenate([baseline, np.arange(place.start, place.stop)])
    if len(prior) != place.stop - place.start:
        return inverse_of_baseline(problem, fixed) @ problem.total[fixed, 0]
    gram = attribution.projected(problem.total, baseline)
    information, vectors, real = attribution.directions(problem, gram, place, prior)
    vectors = prior[:, None] * vectors[:, real]
    value = vectors @ ((vectors.T @ gram[place, 0]) / (1 + information[real]))
    right = problem.total[baseline, 0] - problem.total[np.ix_(baseline, fixed[baseline.size :])] @ value
    return inverse_of_baseline(problem, baseline) @ right


def named_parameters(result: Result, position: int) -> dict[str, Parameter]:
    """{name: Parameter} of a finding in the form named, as a model takes it out of the records.

    Directions below five sigma on which the data hold less information than the prior, such as a leak that looks like
    an offset, are held by their prior: they would carry many times what is plausible into the records.
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
            correlation = {n: round(r, 6) for n, r in zip(named, row.tolist(), strict=True) if n != name}
            named[name] = replace(named[name], correlation=correlation)
    return named


def _held(normal, right, prior):
    """Value (q,), covariance (q, q) of normal equations, directions under CLEAR sigma held if the prior knows more."""
    information, vectors = np.linalg.eigh(normal * np.outer(prior, prior))  # information in units of that of the prior
    score = (vectors.T @ (prior * right)) / np.sqrt(np.maximum(information, 1e-300))
    weight = np.maximum(information + ((information < 1) & (np.abs(score) < CLEAR)), 1e-300)
    directions = prior[:, None] * vectors
    covariance = (directions / weight) @ directions.T
    return covariance @ right, covariance
