"""Detection limits of an event: from which size on each effect of the catalogue would have been named in it.

Effects are added one by one to what is left of the event's own records after the found model, in either sign and each
parameter by itself, at growing sizes, as injections are in searches for gravitational waves (Abbott et al. 2016,
doi:10.1088/0264-9381/33/13/134001). The residual is linear in them, so that every size is scored by products of
columns; the search itself confirms the limit.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution, rounds, scan, trials
from gravcal.discovery.problem import Problem, baseline_of, extended, inverse_of_baseline, prepare
from gravcal.discovery.rounds import Choice
from gravcal.estimation import chi2_tail
from gravcal.estimation.outcome import Limit
from gravcal.estimation.records import Candidate, Observations, slug_of

RATIOS = np.geomspace(3.0, 60.0, 25)  # signal-to-noise ratios that are injected
FORMS = 4  # of a cause that are injected at most, such as epochs or frequencies
LONGER = (1.0, 1.25, 1.6)  # factors on the scored limit at which the search itself is run
LARGEST_SET = 3  # causes that are tied, for a name to count
GONE = 1e-9  # of the noise, below which the residual of a row shows that it had a column of its own


def detection_limits(observed: Observations, left: list, choice: Choice, say: Callable = lambda _: None) -> list[Limit]:
    """Limit of each catalogue cause and parameter: the least size at which this event would have named it.

    `left` (n, 1 + q) of each block: residual of the extended model, and the columns of what was found. Size and ratio
    are None where it would not be named at any S/N up to 60, or is not observable; `say` is called with progress.
    """
    blocks, rng = [], np.random.default_rng(len(observed.candidates))
    for block, part in zip(observed.blocks, left, strict=True):
        alone = np.flatnonzero((np.abs(part[:, 0]) < GONE) & (np.abs(block.observed) > GONE))
        own = (np.arange(block.observed.size)[:, None] == alone).astype(float)
        wider, own = np.column_stack([block.global_columns, part[:, 1:]]), np.column_stack([block.local_columns, own])
        blocks.append(replace(block, observed=part[:, 0], global_columns=wider, local_columns=own))
    problem, tails = _along(prepare(blocks, observed.candidates), choice, rng)
    scored, groups, limits = _Scored(problem, choice, tails), {}, []
    for k, candidate in enumerate(problem.candidates):
        if candidate.listed and "alone" not in candidate.form:
            groups.setdefault(slug_of(candidate.cause), []).append(k)
    drawn = {c: sorted(rng.permutation(rows)[:FORMS]) if len(rows) > FORMS else rows for c, rows in groups.items()}
    pairs = {c: [(k, i) for k in rows for i in range(len(problem.candidates[k].names))] for c, rows in drawn.items()}
    for number, (cause, parts) in enumerate(pairs.items(), start=1):
        rows = [_row(scored, index, column, observed.scale) for index, column in parts]
        relative = [np.inf if r.size is None else r.size / r.prior if r.prior else r.signal_to_noise for r in rows]
        best = int(np.argmin(relative)) if rows else 0
        if rows and rows[best].size is not None:
            rows[best] = _confirmed(problem, choice, rows[best], parts[best], observed.candidates)
        say(f"limits: {number} of {len(pairs)}, {cause}")
        order = sorted(range(len(rows)), key=lambda k: (rows[k].size is not None, -relative[k]))
        limits += {rows[k].parameter: rows[k] for k in order}.values()  # the form named from the least size, or none
    return limits


def _along(problem, choice, rng):
    """Problem with FORMS steps and lines added as candidates, {index: (number of parameters, log p-value to pass)}."""
    tails, steps = {}, [(i, at) for i, block in enumerate(problem.blocks) for at in block.steps]
    most = max(len(block.steps) for block in problem.blocks)  # of those that all blocks share
    for i, at in rng.permutation(steps)[:FORMS] if steps and choice.step_cause else ():
        tails[len(problem.candidates)] = 1, np.log(choice.level * trials.SHARES["step"] / (4 * len(steps) + 4 * most))
        step = trials.Trial("step", choice.step_cause, "", -1, 0.0, 3, 0.0, 1.0, place=int(i), at=at)
        problem, _ = trials.with_candidate(problem, step)
    count = 4 * sum(scan.frequencies(problem.blocks, channel).size for channel in choice.tone_causes)
    for channel, cause in choice.tone_causes.items():
        grid = scan.frequencies(problem.blocks, channel)
        for frequency in rng.permutation(grid)[:FORMS] if not cause.startswith("unknown:") else ():
            phases = rng.uniform(0, 2 * np.pi, len(problem.blocks))
            rotations = [np.kron(np.eye(3), [[np.cos(phase)], [np.sin(phase)]]) for phase in phases]
            waves = [scan.sine_columns(block, channel, frequency, range(3)) for block in problem.blocks]
            signals = [wave @ turn for wave, turn in zip(waves, rotations, strict=True)]
            used = sum(bool(part.any()) for part in signals)
            tails[len(problem.candidates)] = 2 * used, np.log(choice.level * trials.SHARES["line"] / count)
            names = [f"amplitude {axis}" for axis in "xyz"]
            problem = extended(problem, Candidate(cause, f"{frequency:.3f} Hz", names, ["of the noise"] * 3, signals))
    return problem, tails


class _Scored:
    """Chi-square gains of all candidates when an effect of any size is injected, from products of columns."""

    def __init__(self, problem: Problem, choice: Choice, tails: dict):
        self.problem, self.choice = problem, choice
        self.baseline = baseline_of(problem, ())
        self.gram = attribution.projected(problem.total, self.baseline)
        self.covariance = inverse_of_baseline(problem, self.baseline)
        self.shift = self.covariance @ problem.total[self.baseline]  # (p, m) bias by each column at unit size
        factors = [attribution.spread(self.gram, place, problem.size) for place in problem.places]
        self.kept = [k for k, factor in enumerate(factors) if factor.shape[0]]
        self.dof = np.array([factors[k].shape[0] for k in self.kept])
        self.starts = np.cumsum([0, *self.dof])[:-1]
        self.factor = np.zeros((int(self.dof.sum()), problem.size.size))  # `attribution.spread`, stacked
        for k, first, count in zip(self.kept, self.starts, self.dof, strict=True):
            self.factor[first : first + count, problem.places[k]] = factors[k]
        self.causes = np.array([slug_of(problem.candidates[k].cause) for k in self.kept])
        self.listed = np.array([problem.candidates[k].listed for k in self.kept], dtype=bool)
        count = np.where(self.listed, self.listed.sum(), (~self.listed).sum())
        share = np.where(self.listed, trials.SHARES["listed"], trials.SHARES["unknown"])
        self.limit = np.log(choice.level * share / count)  # log p-value that each has to pass
        self.extra_dof = np.zeros(len(self.kept), dtype=int)  # of a line or step in the search, beyond dof
        for position, (dof, limit) in ((self.kept.index(k), tail) for k, tail in tails.items() if k in self.kept):
            self.limit[position], self.extra_dof[position] = limit, max(dof - self.dof[position], 0)

    def gains(self, right):
        """Chi-square gain (k, n) of every candidate from products (m, n) of all columns with n residuals."""
        return np.add.reduceat((self.factor @ right) ** 2, self.starts, axis=0)

    def named(self, own: str, place: int):
        """First round with column `place` injected at S/N of -RATIOS and RATIOS; None if it is not observable.

        True (2, r) where its cause `own` is named right, sets of causes named [2][r], and its size at an S/N of one.
        """
        column = self.gram[:, place]
        power = float(column[place])
        if power <= attribution.ROUNDING * self.problem.total[place, place]:
            return None
        unit = 1 / np.sqrt(power)
        sizes = np.concatenate([-RATIOS, RATIOS]) * unit
        gains = self.gains(self.gram[:, :1] + column[:, None] * sizes)
        score = gains - trials.COST * self.dof[:, None]
        further = self.extra_dof[:, None]
        log_p = chi2_tail.log_tail(gains + further, self.dof[:, None] + further, self.choice.freedom)
        score[log_p > self.limit[:, None]] = -np.inf
        known = np.where(self.listed[:, None], score, -np.inf)
        first = np.where(known.max(axis=0) > score.max(axis=0) - self.choice.tie / 2, known.argmax(0), score.argmax(0))
        misfit = np.maximum(power - self.gains(column[:, None])[:, 0], 0.0)  # left by each where the column is true
        sets, hits = [], []
        for n, winner in enumerate(first):
            similar = misfit * sizes[n] ** 2 < self.choice.tie
            ties = {str(c) for c in self.causes[similar & self.listed]} if np.isfinite(score[winner, n]) else set()
            hit = np.isfinite(score[winner, n]) and (self.causes[winner] == own or similar[winner])
            sets.append(ties | {str(self.causes[winner])} if np.isfinite(score[winner, n]) else set())
            hits.append(bool(hit and self.listed[winner] and len(ties | {own}) <= LARGEST_SET))
        return np.array(hits).reshape(2, -1), [sets[: RATIOS.size], sets[RATIOS.size :]], unit


def _row(scored, index, column, scale):
    """Limit of one parameter, a column of candidate `index`, by the scores; scale (p,): SI to reported unit."""
    candidate, place = scored.problem.candidates[index], scored.problem.places[index].start + column
    prior = candidate.prior[column] if candidate.prior else None
    cause, bias, bias_in_sigma = slug_of(candidate.cause), None, None
    named = scored.named(cause, place)
    hits, sets, unit = named if named else (np.zeros((2, RATIOS.size), dtype=bool), [[set()] * RATIOS.size] * 2, None)
    at = max(_from(each) for each in hits)
    single = [[r and s == {cause} for r, s in zip(*one, strict=True)] for one in zip(hits, sets, strict=True)]
    alone = max(_from(np.array(each)) for each in single)
    near = slice(max(min(at, RATIOS.size) - 2, 0), min(at, RATIOS.size) + 1)
    confused = sorted({c for one in sets for some in one[near] for c in some} - {cause})
    least = float(candidate.shape.value[0]) if candidate.shape and candidate.shape.sized else 0.0  # of a form
    size, untied = (max(float(RATIOS[k] * unit), least) if k < RATIOS.size else None for k in (at, alone))
    missed_size = RATIOS[max(min(at, RATIOS.size) - 1, 0)] * unit if named else prior
    if missed_size is not None and scale.size:
        shift = scored.shift[: scale.size, place] * missed_size
        precision = np.linalg.pinv(scored.covariance[: scale.size, : scale.size], hermitian=True)
        bias, bias_in_sigma = (scale * shift).tolist(), float(np.sqrt(max(shift @ precision @ shift, 0.0)))
    words = cause, candidate.form, candidate.names[column], candidate.units[column]
    return Limit(*words, prior, size, size and size / unit, None, untied, confused, bias, bias_in_sigma)


def _from(right):
    """Index of the ratio from which on all of right (r,) are True, r if the last is False."""
    wrong = np.flatnonzero(~right)
    return int(wrong[-1] + 1) if wrong.size else 0


def _confirmed(problem, choice, row, at, candidates):
    """Limit with the first of LONGER times its size at which the full search names the cause; confirmed if any."""
    (index, column), confused = at, {*row.confused_with}
    for factor in LONGER:
        size = factor * row.size
        parts = zip(problem.blocks, problem.candidates[index].columns, strict=True)
        blocks = [b if c is None else replace(b, observed=b.observed + size * c[:, column]) for b, c in parts]
        named = rounds.names(replace(prepare(blocks, candidates), memory=problem.memory), choice)
        if any(row.cause in one and len(one) <= LARGEST_SET for one in named):
            at = {"size": size, "signal_to_noise": factor * row.signal_to_noise}
            at["alone_from"] = row.alone_from and max(row.alone_from, size)
            at["bias"] = row.bias and [factor * one for one in row.bias]
            at["bias_in_sigma"] = row.bias_in_sigma and factor * row.bias_in_sigma
            return replace(row, confirmed=True, confused_with=sorted(confused), **at)
        confused |= {c for one in named for c in one} - {row.cause}
    return replace(row, confirmed=False, confused_with=sorted(confused))
