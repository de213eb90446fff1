"""One search over many events: from products of whitened columns of each event to causes with a scope, and offsets.

An event is its Gram matrix of whitened columns: observed rows, parameters of the calibration, causes of the catalogue,
local columns projected out (`evidence`). Events share causes, not a calibration's parameters: they are free in each, so
that no model of how they move can make a cause. A cause goes from event to event by a law: constant, one
value in each range of epochs, linear in a measured quantity, in one event alone, or different in each. All laws of all
causes are tried in every round; what is significant among all of them is named, the law by its evidence with the
priors of the catalogue, as in a single event (`model_average`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.evidence import QUANTITIES, Event
from gravcal.discovery.problem import inverse_of, root_of
from gravcal.estimation import chi2_tail

PARTED = 4  # events that the others predict worst, each tried with separate values
ALONE = " alone"  # suffix of the label of an event with separate values
SHARED = "shared"  # scope of an error that all events share
CUTS = 4  # change points of a cause at most
#: Common sizes of a cause over its prior, and their odds. Many events see a hundredth of what is plausible, so that any
#: smaller size is as likely; an order of magnitude more is three times less likely, as in a single event.
SIZES = np.geomspace(1e-4, 1e6, 41)
ODDS = np.minimum(SIZES**-0.5, 1.0) / np.sum(np.minimum(SIZES**-0.5, 1.0))
ALIKE = 0.8  # share of the gain of a cause that another must leave unexplained to count as clearly different


@dataclass(frozen=True)
class Law:
    """How the values of a cause vary over n events: weights (n, k) times k sets of its q parameters."""

    cause: int  #: index in `Search.causes`
    scope: str  #: "constant", "epochs", "event", "each", a quantity that it follows, "shared": error of all events
    weights: np.ndarray  #: (n, k); (n, 0) of "each"
    labels: Sequence[str]  #: (k,) events, or unit of the quantity, that each set of values holds for
    odds: float = 0.0  #: twice the log prior odds of the law among those of its scope


@dataclass(frozen=True)
class Tie:
    """How well all events together separate a cause that was found from another one."""

    cause: str  #: slug of the other
    expected_chi2: float  #: left if the found one is true and the other is fitted, less dof
    observed: float  #: twice the logarithm of the odds against the other
    single: float  #: chi-square expected of the best single event
    event: str  #: name of the event that prefers the found one most
    tied: bool


@dataclass(frozen=True)
class Contradiction:
    """An event that disagrees with the prediction from all others."""

    event: str
    chi2: float
    dof: int
    p: float  #: probability of as much in any event by chance


@dataclass(frozen=True)
class Named:
    """A cause that was found, with its law and its values, k sets of q parameters."""

    law: Law
    gain: float  #: chi-square gained with the other named causes also fitted
    dof: int
    significance: float  #: probability of as much by chance anywhere, corrected for all that was tried
    score: float  #: twice the logarithm of the evidence over that of no such cause
    heldout: float  #: twice the log likelihood gained in each event as all others predict it; NaN of one event
    value: np.ndarray  #: (k, q)
    sigma: np.ndarray  #: (k, q)
    ties: Sequence[Tie] = ()  #: with other causes
    #: (n, q, 2) value and sigma in each event, NaN if undetermined; chi-square and dof of one value for all events
    apart: tuple[np.ndarray, float, int] | None = None


@dataclass(frozen=True)
class Result:
    """Named causes and calibration parameters of a joint search over n events."""

    named: Sequence[Named]
    covariance: np.ndarray  #: (r, r) of all values of the laws with sets of values, in their order
    offset: np.ndarray  #: (n, p) SI, parameters of the calibration in each event
    spread: np.ndarray  #: (n, p, n, p) SI, covariance of these
    alone: np.ndarray  #: (n, p, 2) SI, value and error without any cause
    contradicting: Sequence[Contradiction]
    tried: int  #: laws tried in a round


class Search:
    """Joint search: Gram of all events with the calibration's parameters projected out, and the laws of causes."""

    def __init__(self, events: Sequence[Event], level: float, tie: float, rounds: int):
        self.events, self.level, self.tie, self.rounds = events, level, tie, rounds
        self.causes, self.count = events[0].causes, events[0].start.size  # p parameters of the calibration
        ends = 1 + np.cumsum([0, *(len(one.names) for one in self.causes)])
        self.places = [np.arange(a, b) for a, b in itertools.pairwise(ends)]
        self.kept = np.r_[0, np.arange(1 + self.count, events[0].gram.shape[0])]  # observed rows and causes
        self.slugs = [one.slug for one in self.causes]
        quantities = set.intersection(*(set(one.measured) for one in events)) if len(events) > 3 else ()
        self.followed = [name for name in sorted(quantities) if np.ptp([one.measured[name] for one in events]) > 0]
        self.not_followed = [name for name in QUANTITIES if name not in self.followed]
        number = len(events)  # at most so many contradict the others; where more do, the cause differs in each
        self.strange = max(1, min(number // 4, max(10, number // 10)))
        self.whole = np.stack([one.gram for one in events])
        self.grams = self.projected(())

    def local(self, named: Sequence[tuple[Law, float]]) -> np.ndarray:
        """Gram (n, 1 + p + q, ...), named (law, size) of scope "each" projected out, held by size times the prior."""
        gram = self.whole
        for law, size in named:
            if law.scope == "each":
                gram = _taken(gram, self.count + self.places[law.cause], size * self.causes[law.cause].prior)
        return gram

    def projected(self, named: Sequence[tuple[Law, float]]) -> np.ndarray:
        """Gram (n, m, m) of observed rows and causes: `local` with the calibration's parameters projected out."""
        fitted = np.arange(1, 1 + self.count)
        return np.stack([attribution.projected(one, fitted)[np.ix_(self.kept, self.kept)] for one in self.local(named)])

    def constant(self, cause: int) -> Law:
        """Law of a cause with one set of values in all events."""
        return Law(cause, "constant", np.ones((len(self.events), 1)), ["all"])

    def beside(self, laws: Sequence[Law], *causes: int) -> list[Law]:
        """Laws and, of scope SHARED, the stated common error of each cause that is in neither laws nor causes."""
        laws = [law for law in laws if law.scope != SHARED]
        included = {self.slugs[k] for k in (*causes, *(law.cause for law in laws))}
        errors = [k for k, one in enumerate(self.causes) if one.shared and one.slug not in included]
        return laws + [replace(self.constant(k), scope=SHARED) for k in errors]

    def laws(self, cause: int) -> list[Law]:
        """All laws that are tried for a cause, with their prior odds."""
        number, names = len(self.events), [one.name for one in self.events]
        form_odds = -2 * np.log(self.slugs.count(self.slugs[cause]))
        laws = [self.constant(cause)]
        if number > 3:
            cut_odds = -2 * np.log(number - 1)
            laws += [self.ranges(cause, (k,), cut_odds) for k in range(2, number - 1)]
        eye = np.eye(number)
        laws += [Law(cause, "event", eye[:, k : k + 1], [names[k]], -2 * np.log(number)) for k in range(number)]
        laws += [self.apart(laws[0], k) for k in range(number) if number > 3]
        for name in self.followed:
            values = np.array([one.measured[name] for one in self.events])
            centred = (values - values.mean()) / values.std()
            labels = [f"at {name} {values.mean():.6g}", f"per {values.std():.6g} of {name}"]
            weights = np.column_stack([np.ones(number), centred])
            laws.append(Law(cause, name, weights, labels, -2 * np.log(len(self.followed))))
        laws.append(Law(cause, "each", np.zeros((number, 0)), []))
        return [replace(law, odds=law.odds + form_odds) for law in laws]

    def ranges(self, cause: int, cuts: Sequence[int], odds: float) -> Law:
        """Law with a set of values in each range of events; cuts are the indices of first events of ranges."""
        ends = [0, *sorted(cuts), len(self.events)]
        weights = np.zeros((len(self.events), len(ends) - 1))
        for k, (a, b) in enumerate(itertools.pairwise(ends)):
            weights[a:b, k] = 1.0
        labels = [f"{self.events[a].name} to {self.events[b - 1].name}" for a, b in itertools.pairwise(ends)]
        return Law(cause, "epochs", weights, labels, odds)

    def apart(self, law: Law, event: int) -> Law:
        """The law with a separate set of values for one event, an index, that contradicts the others."""
        alone = np.eye(len(self.events))[:, event : event + 1]
        weights = np.column_stack([law.weights * (1 - alone), alone])
        labels = [*law.labels, self.events[event].name + ALONE]
        return replace(law, weights=weights, labels=labels, odds=law.odds - 2 * np.log(len(self.events)))

    def columns(self, laws: Sequence[Law]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Index in the Gram (c,), weight (n, c), prior sigma (c,) of the values of laws; first the observed rows."""
        index, weight, prior = [np.zeros(1, int)], [np.ones((len(self.events), 1))], [np.zeros(1)]
        for law in laws:
            place, sets = self.places[law.cause], law.weights.shape[1]
            index.append(np.tile(place, sets))
            weight.append(np.repeat(law.weights, place.size, axis=1))
            cause = self.causes[law.cause]
            prior.append([cause.shared / np.sqrt(3)] if law.scope == SHARED else np.tile(cause.prior, sets))
        return np.concatenate(index), np.concatenate(weight, axis=1), np.concatenate(prior)

    def products(self, laws: Sequence[Law], grams: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """Gram (n, c, c) of the values of laws, 1/n of the prior of shared errors in each; priors, norms (c,)."""
        index, weight, prior = self.columns(laws)
        grams = self.grams if grams is None else grams
        weighted = grams[:, index[:, None], index] * weight[:, :, None] * weight[:, None, :]
        of_errors = np.flatnonzero(np.isin(index, [self.places[law.cause][0] for law in laws if law.scope == SHARED]))
        weighted[:, of_errors, of_errors] += 1 / prior[of_errors] ** 2 / len(self.events)
        norms = np.stack([one.size[self.kept][index] for one in self.events])
        return weighted, prior, np.sqrt(np.sum((norms * weight) ** 2, axis=0))

    def judged(self, laws: Sequence[Law], beside: Sequence[Law]) -> list[tuple]:
        """[(chi-square gain, dof, score, likeliest size over prior, law)] of laws of one cause, `beside` fitted too."""
        cause, judgements = laws[0].cause, {}
        beside = self.beside(beside, cause)
        grams, place = self._less_shared(cause, beside), self.places[cause]
        index, weight, _ = self.columns(beside)
        cross = grams[:, index[:, None], place] * weight[:, :, None]
        total = self.products(beside, grams)[0].sum(axis=0)
        inverse = inverse_of(total[1:, 1:]) if total.shape[0] > 1 else np.zeros((0, 0))
        squares = np.stack([one.size[self.kept][place] ** 2 for one in self.events])
        frame = grams[:, place[:, None], place], cross, inverse, total[0, 1:] @ inverse, squares
        for sets in {law.weights.shape[1] for law in laws}:
            equal = [k for k, law in enumerate(laws) if law.weights.shape[1] == sets]
            if sets:
                rows = self._judged(np.stack([laws[k].weights for k in equal]), self.causes[cause].prior, frame)
            else:
                rows = zip(*(self._judged_each(cause, beside) for _ in equal), strict=True)
            for k, gain, dof, score in zip(equal, *rows, strict=True):
                score = score + 2 * np.log(ODDS)  # over all common sizes, and the most likely of these
                evidence = float(2 * np.logaddexp.reduce(score / 2) + laws[k].odds)
                judgements[k] = float(gain), int(dof), evidence, float(SIZES[np.argmax(score)]), laws[k]
        return [judgements[k] for k in range(len(laws))]

    @staticmethod
    def _judged(weights, prior, frame):
        """Gain, dof (l,), score (l, s) of laws with weights (l, n, k) at SIZES (s,); frame: Gram parts."""
        inner, cross, inverse, right, squares = frame
        count, events, sets = weights.shape
        width = sets * prior.size
        crossed = np.einsum("lnm,ncq->lcmq", weights, cross).reshape(count, -1, width)
        pairs = np.einsum("lni,lnj->lijn", weights, weights).reshape(-1, events)
        total = (pairs @ inner.reshape(events, -1)).reshape(count, sets, sets, prior.size, prior.size)
        total = total.transpose(0, 1, 3, 2, 4).reshape(count, width, width)
        gram = total - np.swapaxes(crossed[:, 1:], 1, 2) @ inverse @ crossed[:, 1:]
        products = crossed[:, 0] - right @ crossed[:, 1:]
        size = np.sqrt(np.einsum("lnm,nq->lmq", weights**2, squares)).reshape(count, width)
        size = np.where(size > 0, size, 1.0)
        known, vectors = np.linalg.eigh(gram / (size[:, :, None] * size[:, None, :]))
        observable, part = known > attribution.SEEN**2, np.einsum("lab,la->lb", vectors, products / size)
        gain = np.sum(np.where(observable, part**2 / np.where(observable, known, 1.0), 0.0), axis=1)
        prior = np.tile(prior, sets)
        known, vectors = np.linalg.eigh(gram * np.outer(prior, prior))
        known, part = np.maximum(known, 0.0)[:, None], np.einsum("lab,la->lb", vectors, prior * products)[:, None]
        square = SIZES[:, None] ** 2
        widened = 1 + square * known
        return gain, observable.sum(axis=1), np.sum(square * part**2 / widened - np.log(widened), axis=2)

    def _less_shared(self, cause, beside):
        """Gram (n, m, m), observed rows less the fitted constant of a cause, at most its largest shared error."""
        largest, place = self.causes[cause].shared, self.places[cause][0]
        if not largest:
            return self.grams
        total = self.products([*beside, self.constant(cause)])[0].sum(axis=0)
        total = attribution.projected(total, np.arange(1, total.shape[0] - 1))
        constant = float(np.clip(total[0, -1] / max(total[-1, -1], 1e-300), -largest, largest))
        gram = self.grams.copy()
        gram[:, 0] -= constant * gram[:, place]
        gram[:, :, 0] -= constant * gram[:, :, place]
        return gram

    def _judged_each(self, cause, beside):
        """Gain, dof and score (s,) at SIZES (s,) of a cause with values of its own in each event."""
        place, prior = self.places[cause], self.causes[cause].prior
        gram = self.products([*beside, self.constant(cause)], self._less_shared(cause, beside))[0]
        last, known = np.arange(gram.shape[1] - place.size, gram.shape[1]), zip(self.grams, self.events, strict=True)
        spreads = [attribution.spread(event_gram, place, event.size[self.kept]) for event_gram, event in known]
        roots = [spread @ one[last] for spread, one in zip(spreads, gram, strict=True)]

        def left(grams):  # chi-square after the fit of the laws beside
            total = grams.sum(axis=0)[: last[0], : last[0]]
            return float(attribution.projected(total, np.arange(1, last[0]))[0, 0])

        chi2, rest = left(gram), left(np.stack([one - r.T @ r for one, r in zip(gram, roots, strict=True)]))
        inner = gram[:, last[:, None], last] * np.outer(prior, prior)
        penalty = np.log1p(np.multiply.outer(SIZES**2, np.maximum(np.linalg.eigvalsh(inner), 0.0))).sum(axis=(1, 2))
        score = chi2 - np.array([left(_taken(gram, last, size * prior)) for size in SIZES]) - penalty
        return chi2 - rest, sum(map(len, roots)), score

    def best(self, cause: int, beside: Sequence[Law]) -> list[tuple]:
        """Rows of `judged` for all laws of a cause; ranges split, events set apart while the score gains `tie`."""
        rows = self.judged(self.laws(cause), beside)
        growths = (self._split, lambda law: law.scope == "epochs"), (self._parted, lambda law: len(_alone(law)) > 0)
        for widen, eligible in growths:
            last = max((r for r in rows if eligible(r[4])), default=None, key=lambda r: r[2])
            while last and (options := widen(last[4], beside)):
                row = max(self.judged(options, beside), key=lambda r: r[2])
                if row[2] <= last[2] + self.tie:
                    break
                rows.append(row)
                last = row
        return rows

    def _split(self, law: Law, _) -> list[Law]:
        """Laws of ranges with one more change point than the law, at each place that makes no range of one event."""
        count, cuts = len(self.events), np.flatnonzero(np.any(np.diff(law.weights, axis=0), axis=1)) + 1
        near = {j + k for j in (0, *cuts, count) for k in (-1, 0, 1)}  # a range of one event contradicts, see below
        places = [k for k in range(count) if k not in near] if cuts.size < CUTS else []
        return [self.ranges(law.cause, (*cuts, k), law.odds - 2 * np.log(count - 1)) for k in places]

    def _parted(self, law: Law, beside: Sequence[Law]) -> list[Law]:
        """Laws with a separate set of values for one more event, of the PARTED that the others predict worst."""
        misfits = self.foretold([*beside, self.plain(law)], _alone(law))
        ranked = sorted((row[2], k) for k, row in enumerate(misfits) if self.events[k].name not in _alone(law))
        return [self.apart(law, k) for _, k in ranked[:PARTED]] * (len(_alone(law)) < self.strange)

    def run(self) -> Result:
        """Result of rounds, each naming the best significant law of any cause, until there is none."""
        named, chance = [], {}  # (law, size over its prior), {cause: (p-value, gain, dof, score)}
        for _ in range(self.rounds):
            beside = [law for law, _ in named if law.scope != "each"]
            done = {self.slugs[law.cause] for law, _ in named}
            rows = {k: self.best(k, beside) for k, slug in enumerate(self.slugs) if slug not in done}
            tried = sum(map(len, rows.values()))
            tested = [row for some in rows.values() for row in some if row[1]]
            log_p = chi2_tail.log_tail([r[0] for r in tested], [r[1] for r in tested]) + np.log(max(tried, 1))
            passed = [(row, p) for row, p in zip(tested, log_p, strict=True) if p < np.log(self.level) and row[2] > 0]
            if not passed:
                break
            row, p = max(passed, key=lambda one: one[0][2])
            named.append((row[4], row[3]))
            chance[row[4].cause] = float(np.exp(p)), *row[:3]
            if len(named) > 1:  # laws of those before, beside the new one
                named = self._settled(named)
            self.grams = self.projected(named)
        return self._result(named, chance, len(self.causes) * len(self.laws(0)))

    def _settled(self, named):
        """Named (law, size), in place, with the law of each chosen again while all others are fitted."""
        for k, (law, _) in enumerate(named):
            others = [one for j, one in enumerate(named) if j != k]
            self.grams = self.projected(others)
            row = max(self.best(law.cause, [one for one, _ in others if one.scope != "each"]), key=lambda r: r[2])
            named[k] = row[4], row[3]
        return named

    def _result(self, named, chance, tried):
        """Result of named (law, size) with chance {cause: (p-value, gain, dof, score)} after so many tried laws."""
        joint = [law for law, _ in named if law.scope != "each"]
        scales = [size for law, size in named if law.scope != "each"]
        joint, contradicting = self._contradictions(joint)
        for law in joint if contradicting else ():  # what was named for an event that now has its own values
            others = [one for one in joint if one is not law]
            if self.judged([law], others)[0][2] <= 0:
                scales = [size for one, size in zip(joint, scales, strict=True) if one is not law]
                joint, named = others, [row for row in named if row[0].cause != law.cause]
        with_errors = self.beside(joint)
        value, covariance = self._values(with_errors, [*scales, *[np.inf] * (len(with_errors) - len(joint))])
        ends, findings = np.cumsum([0, *(law.weights.shape[1] * self.places[law.cause].size for law in joint)]), []
        order = {law.cause: k for k, law in enumerate(joint)}
        for law, _size in named:
            self.grams = self.projected(named)
            k = order.get(law.cause)
            mine = law if k is None else joint[k]
            others = self.beside([one for one in joint if one is not mine], law.cause)
            gain, dof, score = chance[law.cause][1:] if k is None else self.judged([mine], others)[0][:3]
            part = slice(0, 0) if k is None else slice(ends[k], ends[k + 1])
            shape = mine.weights.shape[1], self.places[law.cause].size
            gram = self.products([*others, mine])[0]
            parts = np.split(np.arange(1, gram.shape[1]), [gram.shape[1] - 1 - int(np.prod(shape))])
            heldout = attribution.held_out(gram, *parts) if k is not None else np.nan
            size, error = value[part].reshape(shape), np.sqrt(np.diag(covariance)[part]).reshape(shape)
            apart = self._apart(law.cause, others, [row for row in named if row[0].cause != law.cause])
            one = Named(mine, gain, dof, chance[law.cause][0], score, heldout, size, error, apart=apart)
            findings.append(replace(one, ties=self._ties(one, others)) if k is not None else one)
        offset, spread = self._offsets(with_errors, value, covariance, named)
        covariance = covariance[: ends[-1], : ends[-1]]
        alone = self._offsets([], np.zeros(0), np.zeros((0, 0)), ())
        error = np.sqrt(np.einsum("ipip->ip", alone[1]))
        return Result(findings, covariance, offset, spread, np.stack([alone[0], error], axis=2), contradicting, tried)

    def _values(self, laws, scales):
        """Values (r,) and covariance (r, r) of laws, priors times scales, one a law; with errors that all share."""
        gram, prior, _ = self.products(laws)
        total = gram.sum(axis=0)
        widths = [law.weights.shape[1] * self.places[law.cause].size for law in laws]
        inner = total[1:, 1:] + np.diag(1 / (np.repeat(scales, widths) * prior[1:]) ** 2)
        scale = np.outer(*[np.sqrt(np.diag(inner))] * 2)  # of parameters of any units
        covariance = np.linalg.inv(inner / scale) / scale
        value, ends = covariance @ total[1:, 0], np.cumsum([0, *widths])
        for law, start, stop in zip(laws, ends[:-1], ends[1:], strict=True):
            largest = self.causes[law.cause].shared
            if largest and law.scope != SHARED:  # a constant of all events, as likely at any size up to there
                constant = np.linalg.lstsq(law.weights, np.ones(len(self.events)))[0]
                covariance[start:stop, start:stop] += largest**2 / 3 * np.outer(constant, constant)
        return value, covariance

    def _apart(self, cause, others, named):
        """(n, q, 2) value and sigma of a cause by event; chi-square, dof of one value for all, others also fitted."""
        self.grams = self.projected(named)
        grams, _, size = self.products([*others, self.constant(cause)])
        last = slice(size.size - self.places[cause].size, size.size)
        fixed, total = np.arange(1, last.start), grams.sum(axis=0)
        value = inverse_of(total[1:, 1:]) @ total[1:, 0]
        values, gain, dof = np.full((len(grams), last.stop - last.start, 2), np.nan), 0.0, 0
        for gram, row in zip(grams, values, strict=True):
            reduced = gram.copy()
            reduced[:, 0] -= gram[:, fixed] @ value[: fixed.size]
            ratio = attribution.ratio(reduced, last, size)
            sigma = np.sqrt(np.diag(ratio.covariance))
            row[ratio.determined] = np.stack([ratio.value, sigma], axis=1)[ratio.determined]
            difference = ratio.value - value[fixed.size :]
            deviation = attribution.spread(gram, last, size) @ gram[last, last] @ difference
            gain, dof = gain + float(deviation @ deviation), dof + ratio.dof
        return values, gain, max(dof - attribution.ratio(total, last, size).dof, 0)

    def foretold(self, laws: Sequence[Law], out: Sequence[str] = ()) -> list[tuple[float, int, float]]:
        """[(chi2, dof, log p)] of each event against the values that the others predict, without events `out`."""
        grams, prior, size = self.products(laws)
        used, misfits, width = [one.name not in out for one in self.events], [], 1e2 * prior[1:]
        total = grams[used].sum(axis=0)
        for one, included in zip(grams, used, strict=True):
            normal, others = one[1:, 1:], total - one * included
            inverse = np.linalg.inv(others[1:, 1:] + np.diag(1 / width**2))
            deviation = one[1:, 0] - normal @ (inverse @ others[1:, 0])
            variance = normal + normal @ inverse @ normal
            root = root_of(variance, lambda values: 1e-8 * max(values.max(initial=0.0), 1e-300), size[1:])
            chi2, dof = float(np.sum((root.T @ deviation) ** 2)), root.shape[1]
            misfits.append((chi2, dof, float(chi2_tail.log_tail(chi2, max(dof, 1)))))
        return misfits

    def _contradictions(self, laws):
        """Laws with separate values for each event that the others do not predict, [Contradiction] of these."""
        shared, count = [law for law in laws if law.scope != "event"], len(self.events)
        names, plain, rows = {name for law in shared for name in _alone(law)}, [self.plain(law) for law in shared], []
        while shared:
            rows = [(one.name, *row) for one, row in zip(self.events, self.foretold(plain, names), strict=True)]
            worst = min((row for row in rows if row[0] not in names), key=lambda row: row[3])
            if len(names) >= self.strange or worst[3] + np.log(count) > np.log(self.level):
                break
            names.add(worst[0])
        for k, one in enumerate(self.events):
            if one.name in names:
                laws = [law if law.scope == "event" or one.name in _alone(law) else self.apart(law, k) for law in laws]
        return laws, [
            Contradiction(name, chi2, dof, min(1.0, float(np.exp(log_p)) * count))
            for name, chi2, dof, log_p in rows
            if name in names
        ]

    def plain(self, law: Law) -> Law:
        """The law without separate values of single events, which take those of the nearest other event instead."""
        kept = [k for k, label in enumerate(law.labels) if not label.endswith(ALONE)]
        others = np.flatnonzero([one.name not in _alone(law) for one in self.events])
        nearest = others[np.abs(np.arange(len(self.events))[:, None] - others).argmin(axis=1)]
        return replace(law, weights=law.weights[nearest][:, kept], labels=[law.labels[k] for k in kept])

    def _ties(self, one: Named, others):
        """[Tie] of a named cause with the others that are not clearly different, least expected chi-square first."""
        ties, excluded = [], {self.slugs[law.cause] for law in (*others, one.law) if law.scope != SHARED}
        for k, cause in enumerate(self.causes):
            if cause.slug in excluded:
                continue
            swapped, fixed = replace(one.law, cause=k), [law for law in others if self.slugs[law.cause] != cause.slug]
            gram, _, size = self.products([*fixed, one.law, swapped])
            start = size.size - swapped.weights.shape[1] * self.places[k].size
            mine, theirs, first = slice(start - one.value.size, start), slice(start, size.size), start - one.value.size
            reduced = attribution.projected(gram.sum(axis=0), np.arange(1, first))
            expected = attribution.misfit(reduced, mine, one.value.ravel(), theirs, size) - one.dof
            observed = one.score - max(row[2] for row in (*self.best(k, others), *self.judged([swapped], others)))
            if expected > ALIKE * (one.gain - one.dof) and observed >= self.tie:
                continue
            single = [attribution.misfit(b, mine, one.value.ravel(), theirs, size) for b in gram]
            share = self._share(gram, np.arange(1, first), mine, theirs)
            decides, tied = self.events[int(np.argmax(share))].name, bool(expected < self.tie or observed < self.tie)
            ties.append(Tie(cause.slug, max(expected, 0.0), float(observed), float(max(single)), decides, tied))
        ties.sort(key=lambda row: min(row.expected_chi2, row.observed), reverse=True)
        return sorted({row.cause: row for row in ties}.values(), key=lambda row: row.expected_chi2)

    @staticmethod
    def _share(grams, baseline, mine, theirs):
        """Chi-square (n,) by which each event of grams (n, c, c) prefers columns mine to theirs, fitted to all."""
        total, chi2 = grams.sum(axis=0), []
        for place in (theirs, mine):
            index = np.r_[baseline, np.arange(place.start, place.stop)]
            combination = np.zeros(total.shape[0])
            combination[0], combination[index] = 1.0, -inverse_of(total[np.ix_(index, index)]) @ total[index, 0]
            chi2.append(np.einsum("m,bmk,k->b", combination, grams, combination))
        return chi2[0] - chi2[1]

    def _offsets(self, laws, value, covariance, named):
        """Parameters (n, p) of the calibration in each event beside values (r,) of laws, covariance (n, p, n, p)."""
        count, parameters = self.count, np.arange(1, 1 + self.count)
        index, weight, _ = self.columns(laws)
        offset, sensitivity, noise = [], [], []
        for k, gram in enumerate(self.local(named)):
            noise.append(inverse_of(gram[np.ix_(parameters, parameters)]))
            sensitivity.append(noise[-1] @ (gram[np.ix_(parameters, count + index[1:])] * weight[k, 1:]))
            offset.append(self.events[k].start + noise[-1] @ gram[parameters, 0] - sensitivity[-1] @ value)
        sensitivity = np.stack(sensitivity)
        spread = np.einsum("ipr,rs,jqs->ipjq", sensitivity, covariance, sensitivity)
        for k, one in enumerate(noise):
            spread[k, :, k] += one
        return np.stack(offset), spread


def _alone(law):
    """Names of the events for which a law has separate values."""
    return [label.removesuffix(ALONE) for label in law.labels if label.endswith(ALONE)]


def _taken(grams, place, prior):
    """Gram (n, m, m) with the columns `place` (q,) projected out in each event, held by prior sigmas (q,)."""
    inner = np.eye(prior.size) + grams[:, place[:, None], place] * np.outer(prior, prior)
    cross = grams[:, :, place] * prior
    return grams - cross @ np.linalg.solve(inner, np.swapaxes(cross, 1, 2))
