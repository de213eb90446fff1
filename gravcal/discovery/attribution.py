"""Which cause explains the residual: likelihood ratios with all baseline parameters free, and what data cannot show.

Gram matrices (m, m) hold products of all columns, the observed rows first; `place` are the columns of a candidate,
`size` (m,) the norms of the columns with local columns projected out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gravcal.discovery.problem import Problem, baseline_of, inverse_of, root_of
from gravcal.estimation import chi2_tail
from gravcal.estimation.outcome import Separation
from gravcal.estimation.records import Unobservable

#: Least share of its size that the baseline must leave of a column for it to be observable.
SEEN = 1e-4
#: Share of the information on a direction below which a set of blocks does not see it.
UNSEEN_SHARE = 1e-3


@dataclass(frozen=True)
class Ratio:
    """Generalised likelihood ratio of one candidate."""

    gain: float  #: reduction of chi-square
    dof: int  #: independent parameters
    log_p: float  #: natural logarithm of the probability of a larger gain by chance
    value: np.ndarray  #: (q,) of its parameters
    covariance: np.ndarray  #: (q, q) of its parameters
    determined: np.ndarray  #: True (q,) if the data determine a parameter by itself


def projected(gram: np.ndarray, baseline: np.ndarray) -> np.ndarray:
    """Gram matrix (m, m) with the baseline columns (p,) projected out."""
    cross = gram[:, baseline]
    return gram - cross @ inverse_of(gram[np.ix_(baseline, baseline)]) @ cross.T


def spread(gram: np.ndarray, place: slice | np.ndarray, size: np.ndarray) -> np.ndarray:
    """Matrix W (r, q), gain = |W b|^2 for products b (q,) of a candidate's columns with the residual, r observable."""
    return root_of(gram[place][:, place], SEEN**2, size[place]).T


def gained(gram: np.ndarray, place: slice | np.ndarray, size: np.ndarray) -> tuple[float, int, np.ndarray]:
    """Chi-square gain of a candidate, its number of independent parameters, and the matrix (r, q) of `spread`."""
    factor = spread(gram, place, size)
    part = factor @ gram[place, 0]
    return float(part @ part), factor.shape[0], factor


def ratio(gram: np.ndarray, place: slice, size: np.ndarray) -> Ratio:
    """Likelihood ratio of the columns of a candidate, from a Gram matrix as of `projected`."""
    gain, dof, factor = gained(gram, place, size)
    part = factor @ gram[place, 0]
    log_p = float(chi2_tail.log_tail(gain, dof)) if dof else 0.0
    covariance = factor.T @ factor
    scale = np.where(size[place] > 0, size[place], 1.0)
    resolution = np.linalg.pinv(factor * scale) @ (factor * scale) if dof else np.zeros((scale.size,) * 2)
    return Ratio(gain, dof, log_p, factor.T @ part, covariance, np.diag(resolution) > 1 - 1e-3)


def beside(problem: Problem, others: Sequence[int], index: int) -> Ratio:
    """Likelihood ratio of candidate `index` with the others, candidates by index, in the baseline."""
    columns, baseline = np.r_[0, problem.places[index]], baseline_of(problem, others)
    used = np.concatenate([columns, baseline])
    gram = projected(problem.total[np.ix_(used, used)], np.arange(columns.size, used.size))
    return ratio(gram, slice(1, columns.size), problem.size[columns])


def likely(at: np.ndarray, gain: np.ndarray, spacing: float) -> tuple[float, float]:
    """Mean and sigma of a quantity under the likelihood of chi-square gains (n,) at its values (n,), spacing apart."""
    weight = np.exp((gain - gain.max()) / 2)
    mean = weight @ at / weight.sum()
    return float(mean), float(np.sqrt(weight @ (at - mean) ** 2 / weight.sum() + spacing**2 / 12))


def misfit(gram: np.ndarray, true: slice, value: np.ndarray, other: slice, size: np.ndarray) -> float:
    """Expected chi-square left when columns `true` act with value (q,) and columns `other` are fitted instead."""
    power = float(value @ gram[true, true] @ value)
    part = spread(gram, other, size) @ (gram[other, true] @ value)
    return power - float(part @ part)


def held_out(grams: np.ndarray, baseline: np.ndarray, index: np.ndarray) -> float:
    """Twice the log likelihood gained by a candidate in each block as all others predict it, summed over blocks.

    A prediction has the error of the parameters that it is made with, so that a direction of which the others see
    little neither gains nor costs much. What only this block sees, of baseline or candidate, is fitted in it before
    and after, and gains nothing. Products (b, m, m) less local columns; indices of global columns and the candidate's.
    """
    used = np.concatenate([[0], baseline, index])
    grams = grams[:, used[:, None], used]
    acting = np.einsum("bqq->bq", grams) > 0
    single = acting.sum(axis=0) == 1
    single[[0, *range(1 + baseline.size, used.size)]] = False
    size = np.sqrt(np.einsum("bqq->q", grams)[~single])
    grams = np.stack([projected(one, np.flatnonzero(own & single)) for one, own in zip(grams, acting, strict=True)])
    grams = grams[:, ~single][:, :, ~single]
    total, extended, fixed = grams.sum(axis=0), np.arange(1, size.size), np.arange(1, size.size - index.size)

    def one(block):  # of one Gram matrix (m, m)
        others = total - block
        share, directions = _shares(block, others, extended, size)
        own = np.concatenate([np.zeros((1, np.sum(share < UNSEEN_SHARE))), directions[:, share < UNSEEN_SHARE]])
        crossed = block @ own
        reduced = block - crossed @ inverse_of(own.T @ crossed) @ crossed.T
        return _foretold(reduced, others, extended, size) - _foretold(reduced, others, fixed, size)

    return float(sum(one(block) for block in grams))


def _shares(block, others, index, size):
    """Share (k,) of the information of block + others (m, m) that others have along k independent directions (i, k)."""
    whitening = root_of((block + others)[np.ix_(index, index)], 1e-9, size[index])
    share, rotated = np.linalg.eigh(whitening.T @ others[np.ix_(index, index)] @ whitening)
    return np.clip(share, 0.0, 1.0), whitening @ rotated


def _foretold(block, others, index, size):
    """Twice the log likelihood of one block predicted by the others, both Gram, beyond that of a prediction of zero.

    Along a direction in which the others have the share m of the information, block and others estimate
    b / (1 - m) and p, with the variances 1 / (1 - m) and 1 / m.
    """
    share, directions = _shares(block, others, index, size)
    common = (share > UNSEEN_SHARE) & (share < 1 - 1e-9)
    m, directions = share[common], directions[:, common]
    b, p = directions.T @ block[index, 0], directions.T @ others[index, 0] / m
    return float(np.sum((b**2 - m * (b - (1 - m) * p) ** 2) / (1 - m) + np.log(m)))


def disagreement(grams: np.ndarray, baseline: np.ndarray, place: slice, size: np.ndarray) -> tuple[float, int]:
    """Chi-square gain and extra dof of a cause with separate values in all blocks (b, m, m) over one value for all."""
    index = np.arange(place.start, place.stop)
    acting = [g for g in grams if np.any(np.diag(g)[index] > 0)]
    width, first = index.size, 1 + baseline.size
    joined = np.zeros((first + width * len(acting),) * 2)
    fixed = np.append(0, baseline)
    joined[:first, :first] = grams.sum(axis=0)[np.ix_(fixed, fixed)]
    for k, one in enumerate(acting):
        own = slice(first + k * width, first + (k + 1) * width)
        joined[own, own] = one[np.ix_(index, index)]
        joined[:first, own] = one[np.ix_(fixed, index)]
        joined[own, :first] = joined[:first, own].T
    scale = np.concatenate([np.ones(first), *(np.sqrt(np.diag(g)[index]) for g in acting)])
    separate = ratio(projected(joined, np.arange(1, first)), slice(first, joined.shape[0]), scale)
    common = ratio(projected(grams.sum(axis=0), baseline), place, size)
    return separate.gain - common.gain, separate.dof - common.dof


#: Signal-to-noise ratio at a plausible size below which a direction counts as not seen.
UNSEEN = 3.0
#: Bias at a plausible size, in standard deviations of the calibration, from which it is reported.
BIAS = 0.5
#: Share of the power of a signature below which what the calibration parameters leave of it is rounding.
ROUNDING = 1e-7


def beside_calibration(problem: Problem, baseline: np.ndarray, scale: np.ndarray) -> list[Unobservable]:
    """Directions of listed causes that the calibration parameters absorb, with the bias that they could cause.

    The bias is that of the first (s,) global columns, times scale (s,) to the reported unit.
    """
    total, width = problem.total, scale.size
    inverse, gram, rows = inverse_of(total[np.ix_(baseline, baseline)]), projected(total, baseline), []
    precision = inverse_of(inverse[:width, :width])  # rows may say nothing of a parameter
    for candidate, place in zip(problem.candidates, problem.places, strict=True):
        if not candidate.listed or "alone" in candidate.form or candidate.local or not candidate.prior:
            continue
        prior = np.asarray(candidate.prior)
        known, vectors, real = directions(problem, gram, place, prior, ROUNDING)
        shift = (inverse @ total[np.ix_(baseline, np.arange(place.start, place.stop))])[:width] * prior
        for information, vector in zip(np.where(real, known, 0.0), vectors.T, strict=True):
            bias = shift @ vector
            ratio, size = float(np.sqrt(information)), float(np.sqrt(bias @ precision @ bias))
            if ratio < UNSEEN and size > BIAS:
                shares = zip(candidate.names, vector.tolist(), strict=True)
                direction = {n: round(v, 4) for n, v in shares if abs(v) > 0.05}
                rows.append(Unobservable(candidate.cause, direction, ratio, (scale * bias).tolist(), size))
    return rows


def directions(problem: Problem, gram: np.ndarray, place: slice, prior: np.ndarray, least: float = SEEN**2):
    """Information (q,) along directions (q, q) of a candidate over its prior; True (q,) if over `least` is left."""
    full, remaining = (matrix[place, place] * np.outer(prior, prior) for matrix in (problem.total, gram))
    information, vectors = np.linalg.eigh(remaining)
    return information, vectors, information > least * np.einsum("qk,qr,rk->k", vectors, full, vectors)


def separation(problem: Problem, baseline: np.ndarray, index: int, other: int, tie: float) -> Separation:
    """Separation of a cause, true at its fitted value, from another by these data: reached at a chi-square of tie."""
    total = problem.total
    gram = projected(total, baseline)
    true, place = problem.places[index], problem.places[other]
    fitted = ratio(gram, true, problem.size)
    value = fitted.value
    fixed = np.concatenate([baseline, np.arange(place.start, place.stop)])
    signature = total[fixed][:, true] @ value
    combination = np.zeros(total.shape[0])
    combination[true] = value
    combination[fixed] -= inverse_of(total[np.ix_(fixed, fixed)]) @ signature
    parts = np.einsum("m,bmk,k->b", combination, problem.gram, combination)
    expected = float(max(parts.sum() - fitted.dof, 0.0))  # less the noise that the value holds
    needed = int(np.ceil(tie / expected)) if expected > 1e-3 * tie else None
    best = problem.blocks[int(np.argmax(parts))].label if expected > 1e-6 else None
    return Separation(problem.candidates[other].cause, expected, best, needed)
