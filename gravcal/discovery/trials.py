"""Everything that is tried in a round: candidates, lines, steps and pairs, corrected for their number.

Causes with a shape, such as a frequency, are refined where a grid search finds them; `choice` is `rounds.Choice`.
"""

from __future__ import annotations

import collections
import itertools
from dataclasses import replace
from math import comb
from typing import NamedTuple

import numpy as np

from gravcal.discovery import attribution, scan
from gravcal.discovery.problem import (
    Problem,
    extended,
    halves,
    inverse_of,
    inverse_of_baseline,
    observed_rows,
    prepare,
    residuals_of,
    weighted_rows,
)
from gravcal.estimation import chi2_tail
from gravcal.estimation.least_squares import orthonormal
from gravcal.estimation.noise import two_levels
from gravcal.estimation.records import Candidate, Shape

#: Share of the family-wise level that each kind of trial may spend; lines have theirs twice, in each block by itself
#: and as one wave through all.
SHARES = {"listed": 0.45, "unknown": 0.15, "line": 0.1, "step": 0.1, "excess": 0.1}
#: Share of the largest block's information from which another block can test a cause.
SHARED = 0.02
EVERYWHERE = "every manoeuvre"  # of a step that all blocks share
EXCESS = "unknown:excess"  # cause of power beyond noise that follows nothing
WIDEST = 500  # columns of an excess
PATHS = {"chirp": "chirp", "drift": "drifting line"}
AXES = "xyz"
#: What a parameter costs when causes with different numbers of parameters are compared (Akaike).
COST = 2.0


class Trial(NamedTuple):
    """One thing that was tried; channel, place and at of a line or step as of `scan.Scan`."""

    kind: str  #: key of SHARES
    cause: str
    form: str
    index: int  #: of the candidate; -1 for a line or step that is none yet
    gain: float  #: chi-square reduction
    dof: int  #: of the gain
    log_p: float  #: natural log of the p-value of the gain, not corrected
    significance: float  #: probability of as much by chance anywhere, corrected for everything that was tried
    channel: str = ""
    place: int = -1
    at: float = np.nan
    at_sigma: float = np.nan  #: spacing of the search over the square root of 12
    choice: float = 0.0  #: chi-square that choosing its parameters among more of the cause is worth by chance

    @property
    def score(self) -> float:
        """Gain less COST for each parameter, as in Akaike's criterion, and what choosing these costs."""
        return self.gain - COST * self.dof - self.choice


def tried(problem: Problem, baseline: np.ndarray, choice, used=()) -> list[Trial]:
    """Trials of every candidate but those used, line and step, each by itself added to the baseline columns (p,)."""
    gram = attribution.projected(problem.total, baseline)
    rows = []
    for k, (candidate, place) in enumerate(zip(problem.candidates, problem.places, strict=True)):
        if k in used:
            continue
        gain, dof, _ = attribution.gained(gram, place, problem.size)
        if dof:
            kind, fitted = "listed" if candidate.listed else "unknown", candidate.shape
            dof += 0 if candidate.listed or fitted is None else fitted.value.size  # each constant is a parameter
            rows.append((kind, candidate.cause, candidate.form, k, gain, dof))
    log_p = chi2_tail.log_tail([row[4] for row in rows], [row[5] for row in rows], choice.freedom).tolist()
    rows = [(*row, p) for row, p in zip(rows, log_p, strict=True)] + _along(problem, baseline, choice)
    count = collections.Counter(row[0] for row in rows)  # of a kind, which has its share of the level
    correction = {kind: np.log(number / SHARES[kind]) for kind, number in count.items()}
    chance = np.minimum(1.0, np.exp([row[6] + correction[row[0]] for row in rows])).tolist()
    tested = [Trial(*row[:7], p, *row[7:]) for row, p in zip(rows, chance, strict=True)]
    return [_priced(problem, one, tested) for one in tested]


def _priced(problem, trial, rows):
    """Trial with what choosing its parameters among more costs, but not behind those of rows that have them all."""
    one = problem.candidates[trial.index] if trial.index >= 0 else None
    if one is None or not one.choice:
        return trial
    same = (t for t in rows if t.cause == trial.cause and t.index >= 0)
    wider = [t.score for t in same if set(problem.candidates[t.index].names) > set(one.names)]
    cost = min(one.choice, 0.99 * max(trial.score - max(wider, default=-np.inf), 0.0))
    return trial._replace(choice=cost, significance=min(trial.significance * np.exp(one.choice / 2), 1.0))


#: Log of the probability, not corrected, below which a series in no list comes near, and how many do at once.
CLOSE, AT_ONCE = -9.0, 2


def widened(problem: Problem, rows: list[Trial]) -> Problem:
    """Problem with the further laws (`Wider`) of drivers in no list that come near significance; the same if none."""
    close = sorted((t for t in rows if t.kind == "unknown" and t.log_p < CLOSE), key=lambda t: -t.score)
    laws = {}
    for trial in close:
        wider = problem.candidates[trial.index].wider
        if wider is not None and wider.key not in laws and len(laws) < AT_ONCE:
            laws[wider.key] = wider.made()
    further = [one for group in laws.values() for one in group]
    if not further:
        return problem
    kept = [replace(c, wider=None) if c.wider and c.wider.key in laws else c for c in problem.candidates]
    return replace(prepare(problem.blocks, [*kept, *further]), memory=problem.memory)


def sparse(problem: Problem, baseline: np.ndarray, rows: list[Trial], choice) -> tuple[Problem, list[Trial]]:
    """Problem and trials with those few parameters of a listed cause that describe the data better than one or all.

    Found one after the other, each the best beside those before it, of causes that are significant with all their
    parameters; the number of ways to choose as many counts in the correction. A vector has all of its three components:
    one that is left out because the data hardly see it would leave others better known than they are.
    """
    gram = attribution.projected(problem.total, baseline)
    existing = {(c.cause, c.form) for c in problem.candidates}
    tried = sum(t.kind == "listed" for t in rows)
    for full in [t for t in rows if t.kind == "listed" and t.significance < choice.level and t.dof > len(AXES)]:
        candidate, place = problem.candidates[full.index], problem.places[full.index]
        if candidate.shape is not None or not candidate.prior or candidate.local or "alone" in candidate.form:
            continue
        count, kept, best, most = len(candidate.names), [], full, -np.inf
        columns, few = np.arange(place.start, place.stop), []
        while len(kept) < count - 1:
            left = [k for k in range(count) if k not in kept]
            gains = [attribution.gained(gram, columns[[*kept, k]], problem.size)[:2] for k in left]
            (gain, dof), next_one = max(zip(gains, left, strict=True))
            kept.append(next_one)
            worth = gain - COST * dof - 2 * np.sum(np.log(np.arange(len(left), count + 1)))  # the best of so many, each
            if worth > most:
                best, few, most = full._replace(gain=gain, dof=dof), sorted(kept), worth
        words = ", ".join(candidate.names[k] for k in few)
        if len(few) < 2 or (candidate.cause, f"{words} alone") in existing or best.score < full.score:
            continue
        log_p = float(chi2_tail.log_tail(best.gain, best.dof, choice.freedom))
        chance = float(np.exp(min(log_p + np.log(tried / SHARES["listed"]), 0.0)))
        few_of = replace(candidate.part(few, words), choice=2 * float(np.log(comb(count, len(few)))))
        problem, number = extended(problem, few_of), len(problem.candidates)
        best = best._replace(index=number, form=few_of.form, log_p=log_p, significance=chance)
        rows = [*rows, _priced(problem, best, rows)]
    return problem, rows


def _along(problem, baseline, choice):
    """Fields of `Trial`, but for the significance, of all lines and steps added to the baseline columns (p,)."""
    residuals = residuals_of(problem, baseline, observed_rows(problem))
    scans = [scan.lines(problem, baseline, residuals, c) for c in choice.tone_causes]
    scans.append(scan.steps(problem, baseline, residuals))
    rows = []
    for one in scans:
        gain = one.gain[:, 0] if one.at.size else np.zeros(0)
        log_p = chi2_tail.log_tail(gain, np.maximum(one.dof, 1), choice.freedom)
        spacing = float(np.median(np.abs(np.diff(one.at)))) / np.sqrt(12) if one.at.size > 1 else np.nan
        name = choice.step_cause if one.kind == "step" else choice.tone_causes[one.channel]
        first = (one.kind, name, f"{one.channel} reading", -1)
        numbers = zip(*(v.tolist() for v in (gain, one.dof, log_p, one.place, one.at)), strict=True)
        kept = np.ones(one.at.size, bool) if one.kind == "step" else scan.offered(one, choice.periods)
        numbers = itertools.compress(numbers, kept)
        rows += [(*first, g, d, p, one.channel, where, at, spacing) for g, d, p, where, at in numbers]
    return rows


def tuned(problem: Problem, baseline: np.ndarray, trial: Trial) -> tuple[float, float]:
    """Frequency Hz of a line and its sigma, between the frequencies of the search: where the gain is largest."""
    residuals = residuals_of(problem, baseline, observed_rows(problem))
    at, width = trial.at, np.sqrt(12) * trial.at_sigma
    for _ in range(3):
        grid = at + width * np.linspace(-1, 1, 21)
        gain = scan.line_gains(problem, baseline, residuals, trial.channel, grid)[0][trial.place, :, 0]
        best = int(np.clip(np.argmax(gain), 1, grid.size - 2))
        at, width = grid[best], width / 5
    below, middle, above = gain[best - 1 : best + 2]
    curvature = (2 * middle - below - above) / (grid[1] - grid[0]) ** 2
    return float(at), float(np.sqrt(2 / curvature)) if curvature > 0 else float(trial.at_sigma)


def located(trial: Trial, rows: list[Trial]) -> tuple[float, float]:
    """Epoch s of a step and its sigma: mean and spread under the likelihood of the trials at epochs near it."""
    key = (trial.kind, trial.channel, trial.place, trial.dof)
    neighbours = [r for r in rows if (r.kind, r.channel, r.place, r.dof) == key]
    neighbours = [r for r in neighbours if abs(r.at - trial.at) < 20 * np.sqrt(12) * trial.at_sigma] or [trial]
    at, gain = np.array([(r.at, r.gain) for r in neighbours]).T
    return attribution.likely(at, gain, np.sqrt(12) * trial.at_sigma)


def with_candidate(problem: Problem, trial: Trial) -> tuple[Problem, int]:
    """Problem that holds the trial as a candidate, and its index."""
    if trial.index >= 0:
        return problem, trial.index
    names, units = list("xyz"), ["m s-2"] * 3
    if trial.kind != "step":
        axes = [trial.place] if trial.place >= 0 else [0, 1, 2]
        parts = [scan.sine_columns(block, trial.channel, trial.at, axes) for block in problem.blocks]
        columns, used = scan.side_by_side(parts, range(len(parts)))
        names = [f"{p}_{'xyz'[a]}_{i}" for i in range(len(parts)) for a in axes for p in ("cosine", "sine")]
        names, columns = list(itertools.compress(names, used)), [c[:, used] for c in columns]
        units, form = ["1"] * len(names), f"{trial.channel} reading, {trial.at:.4f} Hz"
    elif trial.place >= 0:
        columns = [b.steps[trial.at] if i == trial.place else None for i, b in enumerate(problem.blocks)]
        form = f"{problem.blocks[trial.place].label}, time {trial.at:.0f} s"
    else:
        place = list(next(b.steps for b in problem.blocks if b.steps)).index(trial.at)
        columns = [list(b.steps.values())[place] if b.steps else None for b in problem.blocks]
        form = f"{EVERYWHERE}, in the first at time {trial.at:.0f} s"
    candidate = Candidate(trial.cause, form, names, units, columns, apart=trial.kind == "step" and trial.place < 0)
    return extended(problem, replace(candidate, at=trial.at, at_sigma=trial.at_sigma)), len(problem.candidates)


def excess_of(problem: Problem, excess: scan.Excess) -> Candidate | None:
    """Candidate of sines of free amplitude in a tile or along a chirp, in each block and axis; None if over WIDEST."""
    times = {k: b.time[b.channel == excess.channel] for k, b in enumerate(problem.blocks) if excess.block in (-1, k)}
    begins = {k: time.min() for k, time in times.items() if time.size}
    axes = [excess.axis] if excess.axis >= 0 else [0, 1, 2]
    places = [(k, a) for k in sorted(begins) for a in axes if np.any(_rows(problem.blocks[k], excess, a, begins[k]))]
    length, lowest, path = excess.span[1] - excess.span[0], excess.band[0], excess.kind in PATHS
    bins = lowest + np.arange(max(round((excess.band[1] - lowest) * length), 1)) / length
    count = 2 * len(places) * (1 if path else bins.size)
    if count > WIDEST:
        return None
    started = begins
    first, duration = min(begins.values()), length  # of a drifting line the first block, and all of them
    if excess.kind == "drift":
        begins, duration = dict.fromkeys(begins, first), length + max(begins.values()) - first

    def columns(value):  # (n, count) of each block; value: first and last frequency Hz of a path
        begin, change = (value[:1], np.diff(value) / (2 * duration)) if path else (bins, 0.0)
        sines = [np.zeros((block.observed.size, count)) for block in problem.blocks]
        for (k, axis), part in zip(places, np.split(np.arange(count), len(places)), strict=True):
            rows = _rows(problem.blocks[k], excess, axis, started[k])
            since = (problem.blocks[k].time[rows] - begins[k] - excess.span[0])[:, None]
            phase = 2 * np.pi * (begin + change * since) * since
            sines[k][np.ix_(rows, part)] = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
        return sines

    words = f"{excess.channel} reading{f' {AXES[excess.axis]}' if excess.axis >= 0 else ''}"
    label = problem.blocks[excess.block].label if excess.block >= 0 else excess.channel
    words += f", {label}" if label != excess.channel else ""
    if path:
        value, near = np.array(excess.band), np.array([(a, b) for a in (0, -1, 1) for b in (0, -1, 1)]) / (2 * length)
        lower, upper = np.maximum(value - 3 / length, 0.1 / length), value + 3 / length
        about = np.clip(value + near, lower, upper), lower, upper
        shape = Shape(("begin", "end"), ("Hz", "Hz"), value, columns, *about, words=f"{words}, {PATHS[excess.kind]}")
    else:
        value, names = np.array([*excess.span, *excess.band]), ("from", "to", "lowest", "highest")
        units, fixed = ("s", "s", "Hz", "Hz"), np.zeros((4, 4))
        shape = Shape(names, units, value, columns, value[None], value, value, covariance=fixed, words=words)
    low, high = sorted(1e3 * np.array(excess.band))
    form = f"{words}, {excess.span[0]:.0f} to {excess.span[1]:.0f} s, {low:.4g} to {high:.4g} mHz"
    names = [f"part_{k}" for k in range(count)]
    return Candidate(EXCESS, form, names, ["1"] * count, columns(value), shape=shape)


def telegraph_of(problem: Problem, baseline: np.ndarray, channel: str) -> Candidate | None:
    """Candidate of jumps between two levels in a channel, None where autoregressive noise is as likely.

    It acts on the axis of a block where its likelihood gains most over such noise, the baseline columns fitted too.
    """
    best, blocks = (0.0,), problem.blocks
    for (k, block), axis in itertools.product(enumerate(blocks), range(3)):
        rows = np.flatnonzero((block.channel == channel) & (block.axis == axis) & weighted_rows(block))
        if rows.size >= scan.SHORTEST:
            rows = rows[np.argsort(block.time[rows])]
            columns_there = problem.columns[k].of(np.append(0, baseline))[rows]
            slow = orthonormal(np.concatenate([columns_there[:, 1:], problem.bases[k][rows]], axis=1), 1e-6)
            _, (state,), gain = two_levels([columns_there[:, 0]], [slow])
            if gain > best[0]:
                best = gain, k, axis, rows, state
    if len(best) == 1:
        return None
    _, k, axis, rows, state = best
    columns, time = [None] * len(blocks), blocks[k].time[rows]
    columns[k] = np.zeros((blocks[k].observed.size, 1))
    columns[k][rows, 0] = state
    jumps = np.count_nonzero(np.diff(state > 0))
    span, form = time[[0, -1]] - time[0], f"{channel} reading {AXES[axis]}, {jumps} jumps between two levels"
    fixed = span[None], span, span
    shape = Shape(("from", "to"), ("s", "s"), span, lambda _: columns, *fixed, words=form, covariance=np.zeros((2, 2)))
    return Candidate(EXCESS, form, ["size"], ["1"], columns, shape=shape)


def _rows(block, excess, axis, begin):
    """True (n,) for weighted rows of an axis in the time span of an excess; the record begins at time `begin` s."""
    on_axis, since = (block.channel == excess.channel) & (block.axis == axis), block.time - begin
    return on_axis & weighted_rows(block) & (since >= excess.span[0]) & (since <= excess.span[1])


def held_out(problem: Problem, baseline: np.ndarray, index: int, segment_s: float) -> tuple[float, str]:
    """Twice the log likelihood gained on held-out data by candidate index, and which: "manoeuvres" or "blocks" of time.

    What every block has in common is fitted without one block and tested on it; what belongs to single blocks is
    fitted in every second stretch of so many seconds and tested on the others. Of a cause with parameters of both kinds
    the better of the two counts. A turned frame that only a prior tells from a parameter cannot be tested: 0, "prior".
    """
    place = problem.places[index]
    where = np.arange(place.start, place.stop)
    size = np.einsum("bqq->bq", problem.gram[:, where][:, :, where])
    together = np.sum(size > SHARED * size.max(axis=0), axis=0)
    across = attribution.held_out(problem.gram, baseline, where) if np.any(together > 1) else -np.inf
    if np.all(together > 1):
        if problem.candidates[index].of_frame:
            measured = np.array([np.any(one.channel != "prior") for one in problem.blocks])
            totals = problem.total, problem.gram[measured].sum(axis=0)
            known, by_data = (np.diag(attribution.projected(one, baseline))[where] for one in totals)
            if np.all(by_data < SHARED * known):
                return 0.0, "prior"
        return across, "manoeuvres"
    gain = 0.0
    for i in np.flatnonzero(size.max(axis=1) > 0):
        acting = where[size[i] > 0]
        parts = halves(problem, int(i), segment_s, np.concatenate([baseline, acting]))
        fixed = 1 + np.arange(baseline.size)
        gain += attribution.held_out(parts, fixed, 1 + baseline.size + np.arange(acting.size))
    return (float(across), "manoeuvres") if across > gain else (float(gain), "blocks")


#: Candidates, best first, of which all pairs are tried.
PAIRED = 30


def best_pair(problem: Problem, baseline: np.ndarray, rows: list[Trial], choice) -> tuple[Trial, float] | None:
    """Trial with the better score of the best pair of listed causes, and the pair's score; None if none passes.

    Each of the two has to be significant beside the other, corrected for the number of listed trials.
    """
    gram = attribution.projected(problem.total, baseline)
    listed = [t for t in rows if t.kind == "listed"]
    limit = np.log(choice.level * SHARES["listed"] / max(len(listed), 1))
    tops = sorted(listed, key=lambda t: -t.score)[:PAIRED]
    best = None
    for i, one in enumerate(tops):
        for other in tops[i + 1 :]:
            if one.cause == other.cause:
                continue
            places = [problem.places[t.index] for t in (one, other)]
            gain, dof, _ = attribution.gained(gram, np.r_[places[0], places[1]], problem.size)
            lost = [(gain - t.gain, max(dof - t.dof, 1)) for t in (one, other)]
            alone = [chi2_tail.log_tail(*change, choice.freedom) for change in lost]
            score = gain - COST * dof
            if max(alone) < limit and (best is None or score > best[1]):
                best = (one if one.score > other.score else other, score)
    return best


SHARE = 0.2  # of the largest gain of a round, from which a cause of any size may win
NEAR = 1.0  # of chi-square below the best form, within which one that was refined beside other causes will do
EVALUATIONS = 40  # of the gain at most in the search for its maximum, beyond the starting values
STEP = 1e-4  # relative, for numerical derivatives by the shape values
#: Of a size under the likelihood: first guess of its relative error, sizes tried on either side, and how often.
FIRST, AROUND, PASSES = 0.02, 6, 3


class _Beside:
    """Residuals, columns and covariance of a baseline, which stay the same while a shape is fitted."""

    def __init__(self, problem, baseline):
        self.problem, self.inverse = problem, inverse_of_baseline(problem, baseline)
        self.rest = residuals_of(problem, baseline, observed_rows(problem))
        self.columns = [c.of(baseline) for c in problem.columns]

    def products(self, parts):
        """Gram (q, q) of columns, (n, q) or None a block, and products (q,) with the residual, baseline projected out.

        Baseline and residual have no local columns left in them; only rows where the columns are not zero count.
        """
        crossed, inner, right = 0.0, 0.0, 0.0
        for basis, residual, fitted, part in zip(self.problem.bases, self.rest, self.columns, parts, strict=True):
            if part is not None:
                rows = np.flatnonzero(part.any(axis=1))
                used = slice(rows[0], rows[-1] + 1) if rows.size else slice(0)
                columns, inside = part[used], basis[used].T @ part[used]
                inner = inner + columns.T @ columns - inside.T @ inside
                crossed, right = crossed + fitted[used].T @ columns, right + columns.T @ residual[used, 0]
        return inner - crossed.T @ self.inverse @ crossed, right

    def gain(self, parts, size=None):
        """Chi-square gain of columns, (n, q) or None a block, and their values (q,): fitted, or size of one column."""
        inner, right = self.products(parts)
        value = inverse_of(inner) @ right if size is None else np.array([size])
        return float(2 * right @ value - value @ inner @ value), value

    def inside(self, shape, value):
        """Tuple with the numbers (b,) of the blocks, fitted at shape values (s,); empty if the shape has none."""
        return () if shape.inside is None else (shape.inside(value, self.rest, self.problem.bases),)

    def gain_of(self, shape, value):
        """Chi-square gain of a shape at values (s,)."""
        parts = shape.columns(value, *self.inside(shape, value))
        return self.gain(parts, value[0] if shape.sized else None)[0]


def refined(problem: Problem, baseline: np.ndarray, index: int) -> tuple[Problem, int]:
    """Problem with a candidate in its best shape beside baseline columns (p,) int, and its index; or as it was."""
    candidate = problem.candidates[index]
    if candidate.shape is None or candidate.shape.covariance is not None:
        return problem, index
    beside = _Beside(problem, baseline)
    settled = len(candidate.shape.tried) == 1  # at the largest gain
    value = candidate.shape.value if settled else _largest(candidate.shape, beside)
    fitted = (_with_spread if candidate.shape.sized else _with_errors)(candidate, value, beside)
    return extended(problem, fitted), len(problem.candidates)


def sized(problem: Problem, baseline: np.ndarray, rows: list) -> tuple[Problem, list]:
    """Problem and trials, the best cause whose size is a shape value moved to its largest gain if it may win.

    What is tried of them is far from linear in the size, so that a form of the grid says little of how well they fit.
    Their errors cost twice as much and are computed when one of them has won.
    """
    most = max((t.gain for t in rows), default=0.0)
    shapes = {t.index: problem.candidates[t.index].shape for t in rows if t.index >= 0}
    sized_trials = [t for t in rows if t.index >= 0 and shapes[t.index] is not None and shapes[t.index].sized]
    best = max(sized_trials, key=lambda t: t.gain, default=None)
    settled_trials = [t for t in sized_trials if len(shapes[t.index].tried) == 1]
    if best is None or best.gain < SHARE * most or any(t.gain > best.gain - NEAR for t in settled_trials):
        return problem, rows
    candidate, beside, index = problem.candidates[best.index], _Beside(problem, baseline), len(problem.candidates)
    value = _largest(candidate.shape, beside)
    chosen = beside.inside(candidate.shape, value)
    settled = replace(candidate.shape, value=value, tried=value[None], chosen=next(iter(chosen), None))
    parts, form = settled.columns(value, *chosen), _form(settled, value)
    problem = extended(problem, replace(candidate, form=form, columns=parts, shape=settled))
    ratio = attribution.ratio(attribution.projected(problem.total, baseline), problem.places[index], problem.size)
    numbers = {"gain": ratio.gain, "form": form}
    return problem, [*(t for t in rows if t not in sized_trials), best._replace(index=index, **numbers)]


def _largest(shape: Shape, beside):
    """Shape values (s,) of largest gain: the best of the starting values, then a simplex in their logarithms."""
    from scipy.optimize import minimize, minimize_scalar

    loss = lambda u: -beside.gain_of(shape, np.exp(u))  # noqa: E731
    limits = list(zip(np.log(shape.lower), np.log(shape.upper), strict=True))
    begun = np.clip(np.log(shape.tried), *np.transpose(limits))
    losses = [loss(u) for u in begun]
    first = begun[int(np.argmin(losses))]
    if shape.sized and first.size == 1:  # between the neighbours of the best; `_with_spread` adds its error
        tried, best = begun[:, 0], int(np.argmin(losses))
        ends = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
        options = {"xatol": FIRST / 4, "maxiter": EVALUATIONS}
        optimum = minimize_scalar(lambda u: loss(np.array([u])), bounds=ends, method="bounded", options=options)
        return np.exp(np.array([optimum.x]))
    steps = np.abs(begun - first)
    width = np.array([np.min(column[column > 0], initial=0.1) / 2 for column in steps.T])
    simplex = first + np.concatenate([np.zeros((1, width.size)), np.diag(width)])
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 1e-4, "fatol": 0.01}
    return np.exp(minimize(loss, first, method="Nelder-Mead", bounds=limits, options=options).x)


def _with_errors(candidate: Candidate, value, beside):
    """Candidate at shape values (s,), with covariances of these and of the parameters from a joint fit of both."""
    shape, parts = candidate.shape, candidate.shape.columns(value)
    _, sizes = beside.gain(parts)
    slopes = [_slope(shape, value, k, sizes) for k in range(value.size)]
    jacobian = [np.column_stack([0 * r if s[i] is None else s[i] for s in slopes]) for i, r in enumerate(beside.rest)]
    inner, _ = beside.products([None if p is None else np.hstack([p, b]) for p, b in zip(parts, jacobian, strict=True)])
    joint, count = inverse_of(inner), sizes.size
    alone = inverse_of(inner[:count, :count])
    refined_shape = replace(shape, value=value, covariance=joint[count:, count:], slopes=jacobian)
    spread = joint[:count, :count] - alone
    return replace(candidate, form=_form(shape, value), columns=parts, shape=refined_shape, spread=spread)


def _with_spread(candidate: Candidate, value, beside):
    """Candidate whose size is its shape value: mean and standard deviation of its log under the likelihood.

    The best numbers of the blocks (`Shape.inside`) change with the size by leaps, so that the gain is curved
    differently on either side.
    """
    shape, about, width = candidate.shape, np.log(value), FIRST
    for _ in range(PASSES):
        tried = about + width * np.linspace(-4, 4, 2 * AROUND + 1)[:, None]
        gain = np.array([beside.gain_of(shape, np.exp(u)) for u in tried])
        weight = np.exp((gain - gain.max()) / 2)[:, None] / np.sum(np.exp((gain - gain.max()) / 2))
        about = np.sum(weight * tried, axis=0)
        width = np.sqrt(np.sum(weight * (tried - about) ** 2, axis=0) + (width / AROUND) ** 2)
    value, variance = np.exp(about), (np.exp(about) * width) ** 2
    chosen = beside.inside(shape, value)
    parts = shape.columns(value, *chosen)
    alone = inverse_of(beside.products(parts)[0])
    fields = {"covariance": np.diag(variance), "chosen": next(iter(chosen), None)}
    refined_shape = replace(shape, value=value, tried=value[None], **fields)
    spread = np.maximum(np.diag(variance) - alone, 0.0)
    return replace(candidate, form=_form(shape, value), columns=parts, shape=refined_shape, spread=spread)


def _form(shape, value):
    """Form of a candidate in words: those of its shape, then name, value and unit of each shape value."""
    rows = zip(shape.names, value, shape.units, strict=True)
    words = [shape.words] if shape.words else []
    return ", ".join(words + [f"{n} {v:.4g} {u}".removesuffix(" 1") for n, v, u in rows])


def _slope(shape, value, k, size):
    """Partial derivative by shape value k of the signal of parameters size (q,), (n,) or None a block."""
    step = np.zeros(value.size)
    step[k] = STEP * value[k]
    ends = zip(shape.columns(value + step), shape.columns(value - step), strict=True)
    return [None if a is None else (a - b) @ size / (2 * step[k]) for a, b in ends]
