"""The rounds: name the best cause, check it on held-out data, add it, begin again; then look at every name anew.

A second look gives one name a cause, one value for all blocks, and nothing listed where too much is left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.discovery import adequacy, attribution, scan, trials
from gravcal.discovery.problem import (
    Problem,
    baseline_of,
    drawn_noise,
    extended,
    inverse_of,
    inverse_of_baseline,
    prepare,
)
from gravcal.effects import catalogue
from gravcal.estimation import chi2_tail
from gravcal.estimation.noise import Spectrum
from gravcal.estimation.outcome import Imitator, Outlier, Separation
from gravcal.estimation.records import Block, Candidate, Shape, epoch_of, slug_of


@dataclass(frozen=True)
class Choice:
    """Settings of a search."""

    level: float  #: family-wise level
    tie: float  #: expected chi-square below which two causes are tied
    rounds: int  #: at most
    step_cause: str  #: slug of a step
    tone_causes: dict[str, str]  #: {channel: slug of the cause of a line in it}
    segment_s: float = 15.0  #: s, stretch of time that is left out for causes of a single block
    quiet: Mapping[str, float] = field(default_factory=dict)  #: {channel: quiet samples an axis of its noise}
    order: Mapping[str, int] = field(default_factory=dict)  #: {channel: coefficients of its noise model}
    spectra: Mapping[str, Sequence[Spectrum]] = field(default_factory=dict)  #: {channel: of its axes}, with errors
    periods: Mapping[float, int] = field(default_factory=dict)  #: {s: highest harmonic}, at which no line is offered
    floored: bool = False  #: True where the noise is more than what the record shows, so that little power is no alarm
    excess: bool = True  #: True to name power beyond noise that nothing else takes

    @property
    def excess_level(self) -> float:
        """Share of the family-wise level for excess power that follows no regressor."""
        return self.level * trials.SHARES["excess"]

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise as measured, in the channel that is known worst.

        The density of a model of p coefficients from N samples is off by sqrt(2 p / N) of itself (Berk, Ann. Stat. 2,
        1974), as a variance estimated with N / p degrees of freedom is.
        """
        return min((n / self.order[c] for c, n in self.quiet.items() if n and self.order.get(c)), default=np.inf)


@dataclass(frozen=True)
class Finding:
    """One accepted cause, with its fitted parameters and the evidence for it."""

    cause: str
    form: str
    tied: list[str]  #: causes of the catalogue that fit as well
    names: list[str]  #: (q,) of its parameters
    units: list[str]  #: (q,)
    value: np.ndarray  #: (q,) NaN where the data do not determine one
    sigma: np.ndarray  #: (q,) standard deviations
    index: int  #: of the candidate in the baseline, whose form may have fewer parameters
    gain: float  #: of the likelihood ratio with all other findings in the baseline
    dof: int  #: of that
    significance: float  #: probability corrected for everything that was tried
    heldout: float  #: twice the log likelihood gained on data left out
    kind: str  #: "manoeuvres" or "blocks", "prior" where only a prior tells
    at: float = np.nan  #: epoch s or frequency Hz of a step or a line
    at_sigma: float = np.nan
    separation: Sequence[Separation] = ()  #: from each tied cause
    imitators: Sequence[Imitator] = ()  #: drivers that fit as well


@dataclass(frozen=True)
class Result:
    """Findings of a search, with the tests and fits before and after."""

    findings: list[Finding]  #: list of Finding
    before: adequacy.Test  #: of the baseline
    after: adequacy.Test  #: of the extended model
    chi2: tuple[float, float]  #: before, after
    dof: int  #: of chi2 before
    shared: tuple[np.ndarray, np.ndarray]  #: (p,) corrections of the shared parameters before, after
    covariance: tuple[np.ndarray, np.ndarray]  #: (p, p) before, after
    problem: Problem  #: Problem, with everything accepted
    baseline: np.ndarray  #: (p,) indices of columns of the extended model
    first: list[trials.Trial]  #: list of Trial of the first round, best first
    adopted: list[bool] = field(default_factory=list)  #: whether each finding is in the calibration that is delivered
    outliers: Sequence[Outlier] = ()  #: left out before the search
    #: {cause not named: (p,) rms that its unobservable directions add to the error of the parameters after}
    unseen: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def sigma(self) -> tuple[np.ndarray, ...]:
        """(p,) errors of the shared parameters before, after."""
        return tuple(np.sqrt(np.diag(one)) for one in self.covariance)


def search(blocks: list[Block], candidates: list[Candidate], choice: Choice, rng) -> Result:
    """Result of all rounds of a search in whitened blocks; rng draws the noise that they are tested against."""
    return concluded(begun(blocks, candidates, choice, rng), choice)


def begun(blocks: list[Block], candidates: list[Candidate], choice: Choice, rng, before=None) -> tuple:
    """State of a search, as `concluded` takes it, before excess power is named; `before`: baseline test if known."""
    problem, outliers = adequacy.without_outliers(prepare(blocks, candidates), choice.order)
    problem = replace(problem, floored=choice.floored)
    noise = drawn_noise(problem, adequacy.DRAWS, choice.quiet, rng, choice.order, choice.spectra)
    before = before or adequacy.test(problem, baseline_of(problem, ()), noise)
    problem, chosen, first = _named(problem, choice)
    chosen, after = settled(problem, chosen, choice, noise, before)
    return problem, outliers, noise, before, chosen, first, after


def concluded(state: tuple, choice: Choice) -> Result:
    """Result of a search from its state as of `begun`, excess power named if choice.excess."""
    problem, outliers, noise, before, chosen, first, after = state
    if choice.excess:
        number = len(chosen)
        problem, chosen = jumping(problem, chosen, choice)
        if len(chosen) < number:
            after = adequacy.test(problem, baseline_of(problem, [k for k, _ in chosen]), noise)
        problem, chosen, after = with_excess(problem, chosen, choice, noise, after)
    baseline = baseline_of(problem, [k for k, _ in chosen])
    findings = [_finding(problem, chosen, k, choice) for k in range(len(chosen))]
    return replace(_result(problem, findings, (before, after), baseline, first), outliers=outliers)


def names(problem: Problem, choice: Choice) -> list[set[str]]:
    """Set of slugs for each cause that the rounds name: itself and the catalogue causes that it is tied with."""
    problem, chosen, _ = _named(problem, choice)
    findings = [_finding(problem, chosen, k, choice) for k in range(len(chosen))]
    return [{slug_of(name) for name in (one.cause, *one.tied)} for one in findings]


def _named(problem, choice):
    """Problem with candidates made on the way, [(index, Trial)] of all names, trials of the first round, best first."""
    chosen, first = [], None
    for _ in range(choice.rounds):
        used = [k for k, _ in chosen]
        rows = trials.tried(problem, baseline_of(problem, used), choice, used)
        wider = trials.widened(problem, rows)
        if wider is not problem:
            problem, rows = wider, trials.tried(wider, baseline_of(wider, used), choice, used)
        first = first or sorted(rows, key=lambda t: (t.log_p, -t.gain))
        problem, winner = _best(problem, [k for k, _ in chosen], rows, choice)
        if winner is None:
            break
        problem, chosen = _revised(problem, [*chosen, winner], choice)
    chosen = merged(problem, chosen, choice)
    for position, (index, _) in enumerate(chosen):  # on whose value the blocks do not agree gives way to one in no list
        others = [k for i, (k, _) in enumerate(chosen) if i != position]
        if problem.candidates[index].listed and not _agreed(problem, others, index):
            chosen = _given_way(problem, chosen, position, choice, -np.inf)
    return problem, pruned(problem, without_shadows(problem, chosen)), first


def _best(problem, used, rows, choice):
    """Problem and (index, Trial) of the best of rows that passes every test and gains on held-out data, else None."""
    problem, everything = trials.sparse(problem, baseline_of(problem, used), rows, choice)
    rows = [t for t in everything if t.significance < choice.level]
    problem, rows = trials.sized(problem, baseline_of(problem, used), rows)
    ranked = _ranked(problem, used, rows, choice)
    if ranked and ranked[0].kind == "unknown":
        pair = trials.best_pair(problem, baseline_of(problem, used), everything, choice)
        if pair and pair[1] > ranked[0].score - choice.tie:
            ranked = [pair[0], *ranked]
    for trial in ranked[:12]:
        if trial.kind == "line":  # between two frequencies of the search
            at, at_sigma = trials.tuned(problem, baseline_of(problem, used), trial)
            trial = trial._replace(at=at, at_sigma=at_sigma)
        grown, index = trials.with_candidate(problem, trial)
        grown, index = trials.refined(grown, baseline_of(grown, used), index)
        if trial.kind == "step" and trial.place < 0 and not _agreed(grown, used, index):
            continue
        ratio = attribution.beside(grown, used, index)
        trial = _with_noise_error(grown, used, index, trial, ratio.value, choice) if choice.spectra else trial
        if not trial.significance < choice.level or not _possible(grown.candidates[index], ratio):
            continue
        gain, kind = trials.held_out(grown, baseline_of(grown, used), index, choice.segment_s)
        if gain > 0 or kind == "prior":
            if trial.kind == "step":
                at, at_sigma = trials.located(trial, everything)
                trial = trial._replace(at=at, at_sigma=at_sigma)
            return grown, (index, trial)
    return problem, None


def _possible(candidate, ratio):
    """True if the fitted size of a listed cause is meaningful: no parameter is CLEAR sigma below its lower bound."""
    effect = catalogue().get(slug_of(candidate.cause))
    lower = {one.name: one.lower for one in effect.parameters} if effect else {}
    least = [lower.get(name, -np.inf) for name in candidate.names]
    return bool(np.all(ratio.value + CLEAR * np.sqrt(np.diag(ratio.covariance)) > least))


def _with_noise_error(problem, used, index, trial, value, choice):
    """Trial, its significance with the error of the noise density where a candidate of value (q,) has its power."""
    place = problem.places[index]
    signal = [one.of(np.arange(place.start, place.stop)) @ value[:, None] for one in problem.columns]
    error = scan.level_error(problem, baseline_of(problem, used), signal, choice.spectra)
    log_p = chi2_tail.log_tail_of_level(trial.gain, trial.dof, choice.freedom, error) if error else trial.log_p
    return trial._replace(significance=float(np.exp(min(log_p + _times(trial), 0.0))))


def _times(trial):
    """Natural log of the number of trials by which a trial's p-value was corrected, MANY if that is not known."""
    valid = trial.significance > 0 and np.isfinite(trial.log_p)
    return np.log(trial.significance) - trial.log_p if valid else MANY


def _ranked(problem, used, rows, choice):
    """Trials best first; catalogue causes before drivers in no list unless clearly worse, time as driver last."""
    rows, tie = sorted(rows, key=lambda t: -t.score), choice.tie
    if rows and rows[0].cause == TIME:  # what was measured says why, time says when
        rivals = [t for t in rows if t.score > rows[0].score - tie / 2 and t.cause != TIME and t.kind == "unknown"]
        rows = [*rivals, *(t for t in rows if t not in rivals)]
    listed = [t for t in rows if not t.cause.startswith("unknown:")]
    rivals = [t for t in listed if t.score > rows[0].score - tie]
    close = bool(rivals) and rivals[0].score > rows[0].score - tie / 2
    first = close or any(_stands(problem, used, t, rows[0], choice) for t in rivals)
    return listed + [t for t in rows if t.cause.startswith("unknown:")] if first else rows


def _stands(problem, used, trial, best, choice):
    """True if a trial may be true though `best`, in no list, gained more, by Cox's test of non-nested models.

    If it is true, the score of the other is lower by the expected misfit, with twice its root as standard deviation.
    """
    if trial.index < 0 or best.index < 0:
        return False
    if _needless(problem, used, trial.index, best.index, choice):
        return True
    gram, tie = attribution.projected(problem.total, baseline_of(problem, used)), choice.tie
    place, other = problem.places[trial.index], problem.places[best.index]
    value = attribution.ratio(gram, place, problem.size).value
    expected = max(attribution.misfit(gram, place, value, other, problem.size), 0.0)
    return best.score - trial.score < 2 * np.sqrt(tie * expected) - expected


def _needless(problem, used, index, wider, choice):
    """True if a driver in no list, `wider`, contains cause `index` and its further parameters are not significant.

    The wider of two nested models fits the narrower whatever is true, so that only its further gain counts.
    """
    if problem.candidates[wider].listed or attribution.beside(problem, [*used, wider], index).dof:
        return False
    further = attribution.beside(problem, [*used, index], wider)
    times = sum(not one.listed for one in problem.candidates) / trials.SHARES["unknown"]
    chance = chi2_tail.log_tail(further.gain, max(further.dof, 1), choice.freedom) + np.log(times)
    return further.dof > 0 and chance >= np.log(choice.level)


def _revised(problem, chosen, choice):
    """Problem and names, each tried again with all others in the baseline and dropped if it no longer passes."""
    if len(chosen) < 2:
        return problem, chosen
    for _ in range(2):
        before = [k for k, _ in chosen]
        for position in range(len(chosen)):
            others = [k for i, (k, _) in enumerate(chosen) if i != position]
            rows = trials.tried(problem, baseline_of(problem, others), choice, others)
            problem, winner = _best(problem, others, rows, choice)
            chosen = [*chosen[:position], winner, *chosen[position + 1 :]]
            chosen = [c for c in chosen if c is not None]
            if winner is None:
                break
        if [k for k, _ in chosen] == before:
            break
    return problem, chosen


def _finding(problem, chosen, position, choice):
    """Finding of the name at a position of chosen, with all other names in the baseline."""
    index, trial = chosen[position]
    others = [k for i, (k, _) in enumerate(chosen) if i != position]
    baseline, candidate = baseline_of(problem, others), problem.candidates[index]
    gram = attribution.projected(problem.total, baseline)
    ratio = attribution.ratio(gram, problem.places[index], problem.size)
    gain, kind = trials.held_out(problem, baseline, index, choice.segment_s)
    near = _near(problem, gram, index, ratio, choice.tie) if candidate.listed else {}
    near = {n: one for n, one in near.items() if not _needless(problem, others, index, one[1], choice)}
    tied = {cause: k for cause, (_, k) in near.items() if problem.candidates[k].listed}
    separations = [attribution.separation(problem, baseline, index, k, choice.tie) for k in tied.values()]
    wide = [_widest(problem, k) if "," in problem.candidates[k].form else k for k in others]  # with what was left out
    refit = attribution.beside(problem, wide, _widest(problem, index))  # NaN where the data determine no parameter
    determined, entry = np.where(refit.determined, 1.0, np.nan), problem.candidates[_widest(problem, index)]
    spread = refit.covariance if entry.spread is None else refit.covariance + entry.spread
    value, sigma = refit.value * determined, np.sqrt(np.diag(spread)) * determined
    as_good = _as_good(problem, gram, index, ratio, choice.tie) if candidate.listed else {}
    as_good = {n: one for n, one in as_good.items() if not _needless(problem, others, index, one[1], choice)} | near
    rows = [(expected, problem.candidates[k]) for expected, k in sorted(as_good.values())]
    drivers = [Imitator(c.cause, c.form, max(float(e), 0.0)) for e, c in rows if not c.listed]
    where = trial if np.isfinite(trial.at) else candidate  # that was made of the trial that located it
    return Finding(
        cause=candidate.cause,
        form=candidate.form,
        tied=sorted(tied),
        names=entry.names,
        units=entry.units,
        value=value,
        sigma=sigma,
        index=index,
        gain=ratio.gain,
        dof=ratio.dof,
        significance=trial.significance,
        heldout=gain,
        kind=kind,
        at=where.at,
        at_sigma=where.at_sigma,
        separation=separations,
        imitators=drivers,
    )


def _widest(problem, index):
    """Index of the form of a candidate's cause with most parameters that has all of the candidate's, else itself."""
    candidate = problem.candidates[index]
    forms = [k for k, c in enumerate(problem.candidates) if c.cause == candidate.cause and c.listed and not c.apart]
    wide = [k for k in forms if set(candidate.names) < set(problem.candidates[k].names) and candidate.shape is None]
    wide = [k for k in wide if problem.candidates[k].local == candidate.local] or [index]
    return max(wide, key=lambda k: len(problem.candidates[k].names))


def _near(problem, gram, index, ratio, tie):
    """{other cause: (expected chi-square left, index)} of possible ones that, fitted to the true one, leave < tie."""
    true, near = problem.places[index], {}
    for k, (candidate, place) in enumerate(zip(problem.candidates, problem.places, strict=True)):
        if candidate.cause == problem.candidates[index].cause:
            continue
        expected = attribution.misfit(gram, true, ratio.value, place, problem.size) - ratio.dof
        least = min(tie, near.get(candidate.cause, (np.inf, -1))[0])
        if expected < least and _possible(candidate, attribution.ratio(gram, place, problem.size)):
            near[candidate.cause] = (expected, k)
    return near


def _as_good(problem, gram, index, ratio, tie):
    """{driver in no list: (expected chi-square left, index)} of those whose score is within tie/2 of the named one."""
    near = {}
    for k, (candidate, place) in enumerate(zip(problem.candidates, problem.places, strict=True)):
        other = None if candidate.listed else attribution.ratio(gram, place, problem.size)
        if other is None or not other.dof:
            continue
        loss = ratio.gain - other.gain - trials.COST * (ratio.dof - other.dof)
        if loss < min(tie / 2, near.get(candidate.cause, (np.inf, -1))[0]):
            near[candidate.cause] = (loss, k)
    true = problem.places[index]
    left = {k: attribution.misfit(gram, true, ratio.value, problem.places[k], problem.size) for _, k in near.values()}
    return {cause: (left[k] - ratio.dof, k) for cause, (_, k) in near.items()}


def _result(problem, findings, tests, baseline, first):
    """Result with chi-square, shared parameters (p,) and covariance (p, p) of the fits before and after."""
    total, width, ends = problem.total, problem.shared.stop - 1, []
    for fixed in (baseline_of(problem, ()), baseline):
        covariance = inverse_of_baseline(problem, fixed)
        chi2 = float(attribution.projected(total, fixed)[0, 0])
        ends.append((chi2, (covariance @ total[fixed, 0])[:width], covariance[:width, :width]))
    chi2, value, covariance = zip(*ends, strict=True)
    dof = int(problem.samples.sum()) - width
    return Result(findings, *tests, chi2, dof, value, covariance, problem, baseline, first or [])


#: Extra chi-square per gained chi-square, and its probability, at which the blocks do not agree on one value.
DISAGREE = (0.15, 1e-4)
SHADOW = 0.05  # share of the gain of a cause in no list that its form may leave
CANCELLED = 0.1  # share of the power of the smaller of two contributions that their sum keeps where they cancel
EXCESSES = 3  # that are named at most
TIME = "unknown:time"
JUMPS = 3  # of one size, from which on they are one signal
SAME = 0.05  # of their mean, by which sizes of steps may differ beyond their errors where signs do not alternate
CLEAR = 3.0  # sigma by which a size lies beyond what has a meaning
MANY = 10.0  # log of what a probability that is zero to rounding was corrected by


def merged(problem: Problem, chosen: list, choice) -> list:
    """Names [(index, Trial)] with several forms of a listed cause replaced by its best form with all parameters."""
    causes = [problem.candidates[k].cause for k, _ in chosen]
    several = {c.cause for c in problem.candidates if c.apart}
    twice = next((c for c in causes if causes.count(c) > 1 and c not in several and not c.startswith("unknown:")), None)
    wide = [k for k, c in enumerate(problem.candidates) if c.cause == twice and not c.local]
    if twice is None or not wide:
        return chosen
    most = max(len(problem.candidates[k].names) for k in wide)
    widest = {k for k in wide if len(problem.candidates[k].names) == most}
    kept = [one for one, cause in zip(chosen, causes, strict=True) if cause != twice]
    rows = trials.tried(problem, baseline_of(problem, [k for k, _ in kept]), choice, [k for k, _ in kept])
    best = max((t for t in rows if t.index in widest), key=lambda t: t.gain, default=None)
    return [*kept, (best.index, best)] if best else chosen


def without_shadows(problem: Problem, chosen: list) -> list:
    """Names [(index, Trial)] without those that gain under SHADOW of the largest gain of a cause in no list.

    A regressor made of measured channels follows an unknown effect to some ten percent of its size; what it leaves, a
    percent of its gain, looks like anything. That stays unexplained rather than get a name.
    """
    used = [k for k, _ in chosen]
    gains = [attribution.beside(problem, [*used[:n], *used[n + 1 :]], k).gain for n, k in enumerate(used)]
    unknown = [g for g, (k, _) in zip(gains, chosen, strict=True) if not problem.candidates[k].listed]
    least = SHADOW * max(unknown, default=0.0)
    return [one for one, gain in zip(chosen, gains, strict=True) if gain >= least]


def pruned(problem: Problem, chosen: list) -> list:
    """Names without those that cancel: of two contributions whose sum is small, the one of less gain is dropped.

    Each is far larger than what both explain, so that the data support neither.
    """
    while len(chosen) > 1:
        indices = [k for k, _ in chosen]
        baseline = baseline_of(problem, indices)
        value = inverse_of_baseline(problem, baseline) @ problem.total[baseline, 0]
        gram, width = attribution.projected(problem.total, baseline_of(problem, ())), problem.shared.stop - 1
        coefficients = np.zeros((problem.size.size, len(indices)))
        for column, k in enumerate(indices):
            columns = np.isin(baseline, np.arange(problem.places[k].start, problem.places[k].stop))
            columns[:width] = False
            coefficients[baseline[columns], column] = value[columns]
        power = coefficients.T @ gram @ coefficients
        size = np.diag(power)
        joint = (size[:, None] + size + 2 * power) / np.maximum(np.minimum(size[:, None], size), 1e-300)
        np.fill_diagonal(joint, np.inf)
        if joint.min() > CANCELLED:
            break
        pair = np.unravel_index(np.argmin(joint), joint.shape)
        others = np.delete(indices, pair)
        gains = [(attribution.beside(problem, others, indices[one]).gain, one) for one in pair]
        chosen = [one for k, one in enumerate(chosen) if k != min(gains)[1]]
    return chosen


def settled(problem, chosen, choice, noise, before):
    """Names and adequacy Test; where the fit is not adequate, listed causes yield to equal drivers in no list."""
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


def jumping(problem: Problem, chosen: list, choice: Choice) -> tuple[Problem, list]:
    """Problem and names, JUMPS or more steps to and fro of one size replaced by one signal between two levels.

    The relative sign of blocks with separate origins is not observable, so that a step may go either way in each.
    """
    candidates = [(k, problem.candidates[k]) for k, _ in chosen]
    candidates = [(k, one) for k, one in candidates if slug_of(one.cause) == choice.step_cause and not one.apart]
    if len(candidates) < JUMPS or len({len(one.names) for _, one in candidates}) > 1:
        return problem, chosen
    epoch = {k: one.at if np.isfinite(one.at) else epoch_of(one.cause) for k, one in candidates}
    steps, first = sorted(epoch, key=epoch.get), candidates[0][1]
    width = len(first.names)
    others = [one for one in chosen if one[0] not in epoch]
    indices = [k for k, _ in others]
    gram = attribution.projected(problem.total, baseline_of(problem, indices))
    columns = np.concatenate([np.arange(problem.places[k].start, problem.places[k].stop) for k in steps])
    normal, right = gram[np.ix_(columns, columns)], gram[columns, 0]
    covariance = inverse_of(normal)
    sizes = (covariance @ right).reshape(-1, width)
    projection = np.kron(np.eye(len(steps)), np.linalg.svd(sizes)[2][0])
    size, error = projection @ sizes.ravel(), np.sqrt(np.diag(projection @ covariance @ projection.T))
    signs, mean = np.sign(size), np.mean(np.abs(size))
    common = np.kron(signs[:, None], np.eye(width))
    free, one = (m.T @ right @ inverse_of(m.T @ normal @ m) @ (m.T @ right) for m in (np.eye(columns.size), common))
    equal = np.all(np.abs(np.abs(size) - mean) < SAME * mean + 2 * error) or np.all(signs[1:] != signs[:-1])
    if not equal or free - one - columns.size + width > SHADOW * one:
        return problem, chosen
    parts = list(zip(*(problem.candidates[k].columns for k in steps), strict=True))
    made = [sum(t * np.zeros(1) if c is None else t * c for t, c in zip(signs, row, strict=True)) for row in parts]
    made = [None if all(c is None for c in row) else m for row, m in zip(parts, made, strict=True)]
    touched = [block for block, m in zip(problem.blocks, made, strict=True) if m is not None]
    earliest = min(touched, key=lambda block: block.time.min())
    span = np.array([epoch[steps[0]], epoch[steps[-1]]]) - earliest.time.min()
    about = span, lambda _: made, span[None], span, span
    shape = Shape(("from", "to"), ("s", "s"), *about, covariance=np.zeros((2, 2)))
    where = f"{span[0]:.0f} to {span[1]:.0f} s after {earliest.label} begins"
    form = f"excess in the {touched[0].channel[0]} reading, {len(steps)} jumps between two levels, {where}"
    candidate = Candidate(trials.EXCESS, form, first.names, first.units, made, shape=shape)
    grown, index = extended(problem, candidate), len(problem.candidates)
    ratio = attribution.beside(grown, indices, index)
    worst = max(trial.significance for k, trial in chosen if k in epoch)
    trial = trials.Trial("excess", trials.EXCESS, form, index, ratio.gain, ratio.dof, ratio.log_p, worst)
    return grown, [*others, (index, trial)]


def with_excess(problem: Problem, chosen: list, choice, noise, after) -> tuple:
    """Problem, names and adequacy Test with up to EXCESSES excesses of power that follow no regressor named.

    Names no longer significant with it are dropped, and lines in its band, parts of a chirp or a telegraph signal.
    An excess much smaller than the names is what their form leaves and is not named. Two levels are sought until found.
    """
    jumps = None
    for _ in range(EXCESSES):
        if after.excess_p >= choice.excess_level:
            break
        baseline = baseline_of(problem, [k for k, one in chosen if one.cause == trials.EXCESS])
        telegraph = None if jumps else trials.telegraph_of(problem, baseline, after.excess.channel)
        candidate, jumps = telegraph or trials.excess_of(problem, after.excess), jumps or telegraph
        if candidate is None:
            break
        used = [k for k, _ in chosen]
        grown, index = extended(problem, candidate), len(problem.candidates)
        grown, index = trials.refined(grown, baseline_of(grown, used), index)
        ratio = attribution.beside(grown, used, index)
        about = ratio.gain, ratio.dof, ratio.log_p, after.excess_p
        trial = trials.Trial("excess", candidate.cause, candidate.form, index, *about)
        low, high = (0.0, np.inf) if telegraph else sorted(after.excess.band)
        lines = [one for one in chosen if one[1].kind == "line" and one[1].channel == after.excess.channel]
        lines = [one for one in lines if low <= one[1].at <= high]
        others = [one for one in chosen if one not in lines]
        indices = [k for k, _ in others]
        alone = {k: attribution.beside(grown, indices, k).log_p for k in (index, *(k for k, _ in lines))}
        gains = [attribution.beside(problem, [j for j in used if j != k], k).gain for k in used]
        minor = ratio.gain - ratio.dof < SHADOW * max(gains, default=0.0)
        if minor or min(alone, key=alone.get) != index:  # it is what a line leaves that is less likely by chance
            if telegraph:  # two levels are not all there is: the place itself
                continue
            break
        kept = []
        for k, one in others:  # what is significant beside it, corrected as when it was named
            beside = attribution.beside(grown, [j for j, _ in others if j != k] + [index], k)
            log_p = float(chi2_tail.log_tail(beside.gain, max(beside.dof, 1), choice.freedom))
            kept += [(k, one)] if log_p + _times(one) < np.log(choice.level) else []
        problem, chosen = grown, [*kept, (index, trial)]
        after = adequacy.test(problem, baseline_of(problem, [k for k, _ in chosen]), noise)
    return problem, chosen, after


def _given_way(problem, chosen, position, choice, least):
    """Names with that at a position replaced by the best significant driver in no list of score above least."""
    others = [k for i, (k, _) in enumerate(chosen) if i != position]
    rows = trials.tried(problem, baseline_of(problem, others), choice, others)
    rows = [t for t in rows if t.kind == "unknown" and t.significance < choice.level and t.score > least]
    for best in sorted(rows, key=lambda t: -t.score):
        if not _needless(problem, others, chosen[position][0], best.index, choice):
            return [*chosen[:position], (best.index, best), *chosen[position + 1 :]]
    return chosen


def _agreed(problem, others, index):
    """True if all blocks agree on one value of candidate `index`, with others, indices, in the baseline."""
    baseline, place = baseline_of(problem, others), problem.places[index]
    extra, dof = attribution.disagreement(problem.gram, baseline, place, problem.size)
    gain = attribution.beside(problem, others, index).gain
    share, level = DISAGREE
    return dof <= 0 or extra - dof < share * gain or chi2_tail.log_tail(extra, dof) > np.log(level)
