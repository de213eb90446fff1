"""Is the model adequate: whitened residuals against noise drawn through the same projection.

Families of tests, each corrected for its number: power per channel, block and band; every candidate; every line;
every step; power beyond noise in time and frequency. The smallest of all is set against its own distribution under
noise, so that the probability is uniform on data without error, whatever the tests have in common. Power of all blocks
together that is less than noise has is an alarm of its own: the noise is overrated, and what is small is not seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gravcal.discovery import attribution, scan
from gravcal.discovery.problem import Problem, baseline_of, inverse_of_baseline, observed_rows, prepare, residuals_of
from gravcal.errors import EstimationError
from gravcal.estimation import chi2_tail
from gravcal.estimation.outcome import Band, Outlier
from gravcal.estimation.records import epoch_of

BANDS = 4  # of equal width, of the spectrum of a channel in a block
DRAWS = 199  # of noise
QUIET = 1e-3  # p-value of so little power, below which the noise is overrated
CERTAIN = -10.0  # log p-value below which an excess is certain; of several certain ones the score decides
#: Expected number of rows of noise beyond the limit of an outlier, and what its neighbours have to stay below.
CHANCE, NEAR = 1e-3, 2.5
#: Rows that a bad sample spreads over beyond the coefficients of the noise model, and outliers in a channel of a block.
WIDE, MOST = 4, 3
#: Share of the second of two neighbouring steps in the first below which they are a pulse.
PULSE = -0.3


@dataclass(frozen=True)
class Test:
    """Outcome of the adequacy tests of a baseline."""

    p: float  #: probability that noise alone gives so small a least p-value
    rows: list[Band]  #: power over that of noise by block, channel and band
    scans: list[scan.Scan]  #: list of Scan of the residual
    rest: list[np.ndarray]  #: (n,) residual of each block
    quiet: float = 1.0  #: p-value of so little power in any channel and band
    excess: scan.Excess | None = None  #: the most unlikely of `scan.excess`, None where nothing is long enough
    excess_p: float = 1.0  #: p-value of the most unlikely excess

    def adequate(self, level: float) -> bool:
        """True if the residual is noise at a family-wise level, and has not too little power."""
        return bool(self.p >= level and self.quiet >= QUIET)


def test(problem: Problem, baseline: np.ndarray, noise: list[np.ndarray]) -> Test:
    """Test of a baseline (p,) against noise draws (n, d) a block; EstimationError if the model takes up all data."""
    signals = [np.concatenate([m, n], axis=1) for m, n in zip(observed_rows(problem), noise, strict=True)]
    residuals = residuals_of(problem, baseline, signals, over=True)
    channels = sorted({c for b in problem.blocks for c in b.channel})
    scans = [scan.lines(problem, baseline, residuals, channel) for channel in channels]
    scans = [s for s in [*scans, scan.steps(problem, baseline, residuals)] if s.at.size]
    excesses = [one for channel in channels for one in scan.excess(problem, residuals, channel)]
    rows, smallest, quiet = _bands(problem.blocks, residuals)
    unlikely = [_ranked(one.log_p) for one in excesses]
    lines = [chi2_tail.least_log_tail(s.gain, np.maximum(s.dof, 1)) + np.log(s.at.size) for s in scans]
    gram, gains, dof = attribution.projected(problem.total, baseline), [], []
    right = sum(c.onto(r) for c, r in zip(problem.columns, residuals, strict=True))
    for place in problem.places:
        factor = attribution.spread(gram, place, problem.size)
        if factor.shape[0]:
            gains.append(np.sum((factor @ right[place]) ** 2, axis=0))
            dof.append(factor.shape[0])
    of_causes = chi2_tail.least_log_tail(np.array(gains), np.array(dof)) + np.log(len(dof)) if dof else None
    families = [*(_ranked(one) for one in (smallest, of_causes, *lines) if one is not None), *unlikely]
    if not families:
        count = sum(block.observed.shape[0] for block in problem.blocks)
        raise EstimationError(
            f"discovery: {count} readings in {len(problem.blocks)} blocks leave nothing to test: no channel has "
            f"{8 * BANDS} on one axis, and the model takes up every candidate. Give a longer record.",
            readings=count,
        )
    least = np.exp(_ranked(np.min(families, axis=0))[0])
    kept = [scan.Scan(s.kind, s.channel, s.place, s.at, s.gain[:, :1].copy(), s.dof) for s in scans]  # no views
    order = sorted(zip(unlikely, excesses, strict=True), key=lambda pair: pair[0][0])
    certain = [one for log_p, one in order if log_p[0] < CERTAIN]
    excess = max(certain, key=lambda one: one.score, default=order[0][1] if order else None)
    excess_p = float(np.exp(_ranked(np.min(unlikely, axis=0))[0])) if excesses else 1.0
    quiet = 1.0 if quiet is None or problem.floored else float(np.exp(_ranked(quiet)[0]))
    return Test(float(least), rows, kept, [r[:, 0].copy() for r in residuals], quiet, excess, excess_p)


def without_outliers(problem: Problem, order: Mapping[str, int]) -> tuple[Problem, list[Outlier]]:
    """Problem with isolated outliers removed by local columns of their own, and a list of these outliers.

    A sample that is further from the baseline than noise can be, alone in its channel but for what the whitening makes
    of it (order: coefficients of the noise model), and that no listed cause and no step explains. A column of its own
    for each row leaves it out of every fit.
    """
    from scipy.stats import norm

    baseline, blocks, outliers = baseline_of(problem, ()), list(problem.blocks), []
    residuals = residuals_of(problem, baseline, observed_rows(problem))
    limit = -norm.ppf(CHANCE / (2 * sum(r.shape[0] for r in residuals)))
    for k, (block, values) in enumerate(zip(problem.blocks, residuals, strict=True)):
        far = np.flatnonzero(np.abs(values[:, 0]) > limit)
        rows = []
        for channel, axis in sorted({(str(block.channel[i]), int(block.axis[i])) for i in far}):
            samples = np.flatnonzero((block.channel == channel) & (block.axis == axis))
            groups = [samples[g] for g in _alone(values[samples, 0], limit, order.get(channel, 0) + WIDE)]
            worst_rows = [int(g[np.argmax(np.abs(values[g, 0]))]) for g in groups]
            for group, worst in zip(groups, worst_rows, strict=True):
                if samples.size < 8 * BANDS or _explained(problem, baseline, residuals, k, group, limit, worst_rows):
                    continue
                rows += group.tolist()
                where = block.label, channel, "xyz"[axis]
                outliers.append(Outlier(*where, float(block.time[worst]), float(values[worst, 0])))
        if rows:
            columns = np.zeros((block.observed.size, len(rows)))
            columns[rows, np.arange(len(rows))] = 1.0
            blocks[k] = replace(block, local_columns=np.concatenate([block.local_columns, columns], axis=1))
    return (prepare(blocks, problem.candidates) if outliers else problem), outliers


def _alone(values, limit, width):
    """Index groups about isolated residuals beyond limit, up to width rows away; none if over MOST, a pattern."""
    groups, remaining = [], np.abs(values)
    while remaining.max(initial=0.0) > limit:
        worst = int(np.argmax(remaining))
        neighbours = np.arange(max(worst - width, 0), min(worst + width + 1, remaining.size))
        groups.append(neighbours[remaining[neighbours] > NEAR])
        remaining = remaining.copy()
        remaining[neighbours] = 0.0
    return groups if len(groups) <= MOST and np.sum(remaining > (NEAR + limit) / 2) <= MOST else []


def _explained(problem, baseline, residuals, index, group, limit, near):
    """True if a listed cause, or a step at one of the rows `near`, fits far rows, group (g,), of block `index`."""
    block, columns = problem.blocks[index], problem.columns[index]
    gram, inverse = attribution.projected(problem.total, baseline), inverse_of_baseline(problem, baseline)
    rows = np.stack([columns.row(i) for i in group])
    rows = rows - rows[:, baseline] @ inverse @ problem.total[baseline]
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        if candidate.listed:
            value = attribution.ratio(gram, place, problem.size).value
            if np.abs(residuals[index][group, 0] - rows[:, place] @ value).max() < limit:
                return True

    def fitted(shape):
        """Sizes (q,) of the columns of a step in the residual, and the largest that they leave of the far rows."""
        clean = shape - columns.basis @ (columns.basis.T @ shape)
        value = np.linalg.lstsq(clean, residuals[index][:, 0], rcond=1e-6)[0]
        return value, np.abs(residuals[index][group, 0] - clean[group] @ value).max()

    if any(fitted(shape)[1] < limit for shape in block.steps.values()):
        return True
    epochs = ((one.columns[index], epoch_of(one.cause)) for one in problem.candidates if one.listed)
    steps = dict(block.steps) | {epoch: rows for rows, epoch in epochs if rows is not None and np.isfinite(epoch)}
    for row, shape in ((r, shape) for r in near for shape in _steps_about(block, steps, r)):
        value, remainder = fitted(shape)
        largest = int(np.argmax(np.abs(shape[row] * value)))
        share = value[largest - value.size // 2] / value[largest]  # of the other column; a bad sample has -1
        if remainder < limit and share > PULSE:
            return True
    return False


def _steps_about(block, steps, row):
    """Yield columns (n, 2 q) of steps at two neighbouring samples near a row: the nearest of {epoch: (n, q)}, shifted.

    Both of one sign are a step between the samples, both of opposite sign a pulse.
    """
    samples = np.flatnonzero((block.channel == block.channel[row]) & (block.axis == block.axis[row]))
    for epoch in sorted(steps, key=lambda at: abs(at - block.time[row]))[:1]:
        first = int(np.searchsorted(samples, row) - np.searchsorted(block.time[samples], epoch))
        moved = np.zeros((4, *steps[epoch].shape))
        for k, shift in enumerate(range(first - 2, first + 2)):
            source, target = samples[max(-shift, 0) : samples.size - max(shift, 0)], samples[max(shift, 0) :]
            moved[k, target[: source.size]] = steps[epoch][source]
        yield from (np.concatenate(moved[k : k + 2], axis=1) for k in range(3))


def _ranked(log_p):
    """Natural logs of p-values (1 + d,) of a statistic (1 + d,) among its columns but the first, which are of noise.

    Below a quarter of the draws they fall as their own tail does, at most as a probability should (Hill, Ann. Stat. 3,
    1975).
    """
    log_p = np.maximum(log_p, -1e6)  # a tail may be too small for a number
    draws = np.sort(log_p[1:])
    quarter = draws.size // 4
    slope = min(quarter / max(np.sum(draws[quarter] - draws[:quarter]), 1e-9), 1.0)
    ranks, tail = 1 + np.searchsorted(draws, log_p, "right"), slope * (log_p - draws[quarter])
    return np.where(tail < 0, np.log(quarter / draws.size) + tail, np.log(ranks / log_p.size))


def _bands(blocks, residuals):
    """Band rows of the first column; corrected log p-value (1 + d,) of the most and of the least power in a band."""
    rows, log_p, sums = [], [], {}
    for block, values in zip(blocks, residuals, strict=True):
        for channel in dict.fromkeys(block.channel):
            power, freedom = _power(block, channel, values)
            for band in range(power.shape[0]):
                mean = power[band, 1:].mean()
                if mean <= 0:
                    continue
                shape = mean**2 / freedom[band]
                for place in ((channel, band), channel):  # a band, and all of them
                    total = sums.setdefault(place, np.zeros(power.shape[1] + 1))
                    total += np.append(power[band], freedom[band])
                log_p.append(chi2_tail.log_gamma_tail(power[band], shape, mean))
                numbers = float(np.exp(log_p[-1][0])), float(power[band, 0] / mean)
                rows.append(Band(block.label, str(channel), band, *numbers))
    means = {place: s[1:-1].mean() for place, s in sums.items()}
    shapes = {place: means[place] ** 2 / s[-1] for place, s in sums.items()}
    deficit = [chi2_tail.log_gamma_tail(s[:-1], shapes[n], means[n], smaller=True) for n, s in sums.items()]
    return rows, *(np.min(one, axis=0) + np.log(len(one)) if one else None for one in (log_p, deficit))


def _power(block, channel, values):
    """Power in each band, summed over axes (bands, d), and its variance for unit white noise (bands,)."""
    total, spread = np.zeros((BANDS, values.shape[1])), np.zeros(BANDS)
    for axis in range(3):
        rows = (block.channel == channel) & (block.axis == axis)
        if rows.sum() >= 8 * BANDS:
            spectrum = 2 * np.abs(np.fft.rfft(values[rows], axis=0)) ** 2 / rows.sum()
            parts = np.array_split(spectrum, BANDS)
            total += [p.sum(axis=0) for p in parts]
            spread += [4 * p.shape[0] for p in parts]
    return total, spread
