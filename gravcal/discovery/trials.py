"""Everything that is tried in a round: candidates, lines, steps and pairs, corrected for their number."""

from __future__ import annotations

import collections
import itertools
from dataclasses import replace
from math import comb
from typing import NamedTuple

import numpy as np

from gravcal.discovery import attribution, scan
from gravcal.discovery.problem import Problem, extended, halves, observed_rows, prepare, residuals_of, weighted_rows
from gravcal.estimation import chi2_tail
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
    gain: float  #: of its likelihood ratio
    dof: int  #: of that
    log_p: float  #: of that
    significance: float  #: probability of as much by chance anywhere, corrected for everything that was tried
    channel: str = ""
    place: int = -1
    at: float = np.nan
    at_sigma: float = np.nan  #: spacing of the search over the square root of 12

    @property
    def score(self) -> float:
        """Gain less what the parameters cost."""
        return self.gain - COST * self.dof


def tried(problem: Problem, baseline: np.ndarray, choice, used=()) -> list[Trial]:
    """Trials beside a baseline."""
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
    times = {kind: np.log(number / SHARES[kind]) for kind, number in count.items()}
    chance = np.minimum(1.0, np.exp([row[6] + times[row[0]] for row in rows])).tolist()
    return [Trial(*row[:7], p, *row[7:]) for row, p in zip(rows, chance, strict=True)]


#: Log of the probability, not corrected, below which a series in no list comes near, and how many do at once.
CLOSE, AT_ONCE = -9.0, 2


def widened(problem: Problem, rows: list[Trial]) -> Problem:
    """Problem with the laws of those series in no list that come near, once each; as it was where none does."""
    near = sorted((t for t in rows if t.kind == "unknown" and t.log_p < CLOSE), key=lambda t: -t.score)
    made = {}
    for trial in near:
        wider = problem.candidates[trial.index].wider
        if wider is not None and wider.key not in made and len(made) < AT_ONCE:
            made[wider.key] = wider()
    more = [one for some in made.values() for one in some]
    if not more:
        return problem
    kept = [replace(c, wider=None) if c.wider and c.wider.key in made else c for c in problem.candidates]
    return replace(prepare(problem.blocks, [*kept, *more]), memory=problem.memory)


def sparse(problem: Problem, baseline: np.ndarray, rows: list[Trial], choice) -> tuple[Problem, list[Trial]]:
    """Problem and trials with those few parameters of a listed cause that describe the data better than one or all do.

    Found one after the other, each the best beside those before it, of causes that are significant with all their
    parameters; the number of ways to choose as many counts in the correction. A vector has all of its three components:
    one that is left out because the data hardly see it would leave others better known than they are.
    """
    gram = attribution.projected(problem.total, baseline)
    known = {(c.cause, c.form) for c in problem.candidates}
    tried = sum(t.kind == "listed" for t in rows)
    for whole in [t for t in rows if t.kind == "listed" and t.significance < choice.level and t.dof > len(AXES)]:
        candidate, place = problem.candidates[whole.index], problem.places[whole.index]
        if candidate.shape is not None or not candidate.prior or candidate.local or "alone" in candidate.form:
            continue
        count, kept, best, most = len(candidate.names), [], whole, -np.inf
        columns, few = np.arange(place.start, place.stop), []
        while len(kept) < count - 1:
            left = [k for k in range(count) if k not in kept]
            gains = [attribution.gained(gram, columns[[*kept, k]], problem.size)[:2] for k in left]
            (gain, dof), next_one = max(zip(gains, left, strict=True))
            kept.append(next_one)
            worth = gain - COST * dof - 2 * np.sum(np.log(np.arange(len(left), count + 1)))  # the best of so many, each
            if worth > most:
                best, few, most = whole._replace(gain=gain, dof=dof), sorted(kept), worth
        words = ", ".join(candidate.names[k] for k in few)
        if len(few) < 2 or (candidate.cause, f"{words} alone") in known or best.score < whole.score:
            continue
        log_p = float(chi2_tail.log_tail(best.gain, best.dof, choice.freedom))
        chance = float(np.exp(min(log_p + np.log(tried * comb(count, len(few)) / SHARES["listed"]), 0.0)))
        index, form = len(problem.candidates), f"{words} alone"
        problem = extended(problem, candidate.part(few, words))
        rows = [*rows, best._replace(index=index, form=form, log_p=log_p, significance=chance)]
    return problem, rows


def _along(problem, baseline, choice):
    """Lines and steps: fields of `Trial` without their significance."""
    rest = residuals_of(problem, baseline, observed_rows(problem))
    found = [scan.lines(problem, baseline, rest, c) for c in choice.tone_causes]
    found.append(scan.steps(problem, baseline, rest))
    rows = []
    for one in found:
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
    """Frequency of a line with its error, between the frequencies of the search: where the gain is largest."""
    rest = residuals_of(problem, baseline, observed_rows(problem))
    at, width = trial.at, np.sqrt(12) * trial.at_sigma
    for _ in range(3):
        grid = at + width * np.linspace(-1, 1, 21)
        gain = scan.line_gains(problem, baseline, rest, trial.channel, grid)[0][trial.place, :, 0]
        best = int(np.clip(np.argmax(gain), 1, grid.size - 2))
        at, width = grid[best], width / 5
    below, middle, above = gain[best - 1 : best + 2]
    bend = (2 * middle - below - above) / (grid[1] - grid[0]) ** 2
    return float(at), float(np.sqrt(2 / bend)) if bend > 0 else float(trial.at_sigma)


def located(trial: Trial, rows: list[Trial]) -> tuple[float, float]:
    """Epoch of a step with its error: mean and spread under the likelihood of its neighbours."""
    like = (trial.kind, trial.channel, trial.place, trial.dof)
    near = [r for r in rows if (r.kind, r.channel, r.place, r.dof) == like]
    near = [r for r in near if abs(r.at - trial.at) < 20 * np.sqrt(12) * trial.at_sigma] or [trial]
    at, gain = np.array([(r.at, r.gain) for r in near]).T
    return attribution.likely(at, gain, np.sqrt(12) * trial.at_sigma)


def with_candidate(problem: Problem, trial: Trial) -> tuple[Problem, int]:
    """Problem that holds the trial as a candidate, and its index."""
    if trial.index >= 0:
        return problem, trial.index
    make = _step if trial.kind == "step" else _line
    return extended(problem, make(problem, trial)), len(problem.candidates)


def _step(problem, trial):
    if trial.place >= 0:
        columns = [b.steps[trial.at] if i == trial.place else None for i, b in enumerate(problem.blocks)]
        form = f"{problem.blocks[trial.place].label}, time {trial.at:.0f} s"
    else:
        index = list(next(b.steps for b in problem.blocks if b.steps)).index(trial.at)
        columns = [list(b.steps.values())[index] if b.steps else None for b in problem.blocks]
        form = f"{EVERYWHERE}, in the first at time {trial.at:.0f} s"
    where = {"at": trial.at, "at_sigma": trial.at_sigma, "apart": trial.place < 0}
    return Candidate(trial.cause, form, ["x", "y", "z"], ["m s-2"] * 3, columns, **where)


def _line(problem, trial):
    axes = [trial.place] if trial.place >= 0 else [0, 1, 2]
    parts = [scan.sine_columns(block, trial.channel, trial.at, axes) for block in problem.blocks]
    columns, used = scan.side_by_side(parts, range(len(parts)))
    names = [f"{p}_{'xyz'[a]}_{i}" for i in range(len(parts)) for a in axes for p in ("cosine", "sine")]
    names, merged = list(itertools.compress(names, used)), [c[:, used] for c in columns]
    form, where = f"{trial.channel} reading, {trial.at:.4f} Hz", {"at": trial.at, "at_sigma": trial.at_sigma}
    return Candidate(trial.cause, form, names, ["1"] * len(names), merged, **where)


def excess_of(problem: Problem, found: scan.Excess) -> Candidate | None:
    """Candidate of sines of any size in a tile, or on a path, in each block and axis; None of too many to fit."""
    blocks = range(len(problem.blocks)) if found.block < 0 else [found.block]
    axes = [found.axis] if found.axis >= 0 else [0, 1, 2]
    places = [(k, a) for k in blocks for a in axes if np.any(_rows(problem.blocks[k], found, a))]
    length, lowest, path = found.span[1] - found.span[0], found.band[0], found.kind in PATHS
    bins = lowest + np.arange(max(round((found.band[1] - lowest) * length), 1)) / length
    count = 2 * len(places) * (1 if path else bins.size)
    if count > WIDEST:
        return None
    begins = {k: problem.blocks[k].time[problem.blocks[k].channel == found.channel].min() for k, _ in places}
    first, whole = min(begins.values()), length  # of a drifting line the first block, and all of them
    if found.kind == "drift":
        begins, whole = dict.fromkeys(begins, first), length + max(begins.values()) - first

    def columns(value):
        begin, change = (value[:1], np.diff(value) / (2 * whole)) if path else (bins, 0.0)
        made = [np.zeros((block.observed.size, count)) for block in problem.blocks]
        for (k, axis), part in zip(places, np.split(np.arange(count), len(places)), strict=True):
            rows = _rows(problem.blocks[k], found, axis)
            since = (problem.blocks[k].time[rows] - begins[k] - found.span[0])[:, None]
            phase = 2 * np.pi * (begin + change * since) * since
            made[k][np.ix_(rows, part)] = np.concatenate([np.cos(phase), np.sin(phase)], axis=1)
        return made

    words = f"{found.channel} reading{f' {AXES[found.axis]}' if found.axis >= 0 else ''}"
    words += f", {problem.blocks[found.block].label}" if found.block >= 0 else ""
    if path:
        value, near = np.array(found.band), np.array([(a, b) for a in (0, -1, 1) for b in (0, -1, 1)]) / (2 * length)
        lower, upper = np.maximum(value - 3 / length, 0.1 / length), value + 3 / length
        about = np.clip(value + near, lower, upper), lower, upper
        shape = Shape(("begin", "end"), ("Hz", "Hz"), value, columns, *about, words=f"{words}, {PATHS[found.kind]}")
    else:
        value = np.array([*found.span, *found.band])
        known = {"covariance": np.zeros((4, 4)), "words": words}
        names, units = ("from", "to", "lowest", "highest"), ("s", "s", "Hz", "Hz")
        shape = Shape(names, units, value, columns, value[None], value, value, **known)
    low, high = sorted(1e3 * np.array(found.band))
    form = f"{words}, {found.span[0]:.0f} to {found.span[1]:.0f} s, {low:.0f} to {high:.0f} mHz"
    names = [f"part_{k}" for k in range(count)]
    return Candidate(EXCESS, form, names, ["1"] * count, columns(value), shape=shape)


def _rows(block, found, axis):
    """Rows (n,) of an axis in the stretch of an excess."""
    here = block.channel == found.channel
    since = block.time - block.time[here].min() if here.any() else block.time
    return here & (block.axis == axis) & weighted_rows(block) & (since >= found.span[0]) & (since <= found.span[1])


def held_out(problem: Problem, baseline: np.ndarray, index: int, segment_s: float) -> tuple[float, str]:
    """Twice the log likelihood gained on data left out, and which: "manoeuvres" or "blocks" of time.

    What every block has in common is fitted without one block and tested on it; what belongs to single blocks is
    fitted in every second stretch of so many seconds and tested on the others. Of a cause with parameters of both kinds
    the better of the two counts.
    """
    place = problem.places[index]
    where = np.arange(place.start, place.stop)
    size = np.einsum("bqq->bq", problem.gram[:, where][:, :, where])
    together = np.sum(size > SHARED * size.max(axis=0), axis=0)
    across = attribution.held_out(problem.gram, baseline, where) if np.any(together > 1) else -np.inf
    if np.all(together > 1):
        return across, "manoeuvres"
    gain = 0.0
    for i in np.flatnonzero(size.max(axis=1) > 0):
        mine = where[size[i] > 0]
        parts = halves(problem, int(i), segment_s, np.concatenate([baseline, mine]))
        fixed = 1 + np.arange(baseline.size)
        gain += attribution.held_out(parts, fixed, 1 + baseline.size + np.arange(mine.size))
    return (float(across), "manoeuvres") if across > gain else (float(gain), "blocks")


#: Candidates, best first, of which all pairs are tried.
PAIRED = 30


def best_pair(problem: Problem, baseline: np.ndarray, rows: list[Trial], choice) -> tuple[Trial, float] | None:
    """Better half of the best pair of listed causes, and the score of the pair; None if no pair passes.

    Each of the two has to be significant beside the other, corrected for the number of listed trials.
    """
    gram = attribution.projected(problem.total, baseline)
    listed = [t for t in rows if t.kind == "listed"]
    limit = np.log(choice.level * SHARES["listed"] / max(len(listed), 1))
    tops = sorted(listed, key=lambda t: -t.score)[:PAIRED]
    found = None
    for i, one in enumerate(tops):
        for other in tops[i + 1 :]:
            if one.cause == other.cause:
                continue
            places = [problem.places[t.index] for t in (one, other)]
            gain, dof, _ = attribution.gained(gram, np.r_[places[0], places[1]], problem.size)
            lost = [(gain - t.gain, max(dof - t.dof, 1)) for t in (one, other)]
            alone = [chi2_tail.log_tail(*each, choice.freedom) for each in lost]
            score = gain - COST * dof
            if max(alone) < limit and (found is None or score > found[1]):
                found = (one if one.score > other.score else other, score)
    return found
