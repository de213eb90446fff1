"""Heads of the star camera against each other, from SCA1A: mounting, and noise about each axis."""

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from gravcal.calibrations import named_parameters
from gravcal.calibrations.align import QUATERNION, own_tags, sorted_samples
from gravcal.calibrations.schemas import build
from gravcal.calibrations.thrusters.model import SCHEMAS
from gravcal.estimation import least_squares
from gravcal.physics import frames

BAD = 0b1001  # quality bits of SCA1A: not valid, false stars
#: Densities of noise are means from each frequency to the next, the last one to Nyquist.
BANDS_HZ = {"slow": 0.005, "fast": 0.1}
#: Scatter of the logarithm of variances that are alike: six across the lines of sight of GRACE-C in the catalogue.
SPREAD = 0.9
FULL = 0.8  # share of the epochs of a block that a pair of heads must have
FAR = 8.0  # robust standard deviations: false stars
HELD = 35 / 18  # ordinates under a Hann window that count as one
AROUND = 8  # samples on either side that give the rate by which an attitude is moved to another tag
ITERATIONS = 100


def on_grid(observed: xr.Dataset, mounting) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Even epochs (n,) s, own tags, and {head: (n, 4)} attitude of the SRF by each, NaN where there is none.

    `observed` is "ingest" of SCA1A, mounting (heads, 4) as QSA1B has it. Tags of heads may differ by part of a step: an
    attitude is moved to the epoch by its own rate over some seconds, so that its noise stays as it is.
    """
    mounting, series = np.asarray(mounting), {}
    for head in range(1, len(mounting) + 1):
        own = observed.isel(record=np.flatnonzero(observed["sca_id"].values == head))
        time, values, flag, _ = sorted_samples(own, own_tags(own), QUATERNION, (own["qualflg"].values & BAD) != 0)
        norm = np.linalg.norm(values, axis=1)
        good = (flag == 0) & (np.abs(norm - 1) < 1e-3)
        if good.sum() > 2 * AROUND:
            unit, place = values[good] / norm[good, None], mounting[head - 1] / np.linalg.norm(mounting[head - 1])
            series[head] = time[good], frames.quaternion_product(unit, place)
    if not series:
        return np.zeros(0), {}
    first, last = (fold(time[at] for time, _ in series.values()) for fold, at in ((min, 0), (max, -1)))
    step = max(np.median(np.diff(time)) for time, _ in series.values())
    grid, attitudes = first + step * np.arange(int((last - first) / step) + 1), {}
    for head, (time, quaternion) in series.items():
        at = np.rint((time - time[0]) / step + np.rint((time[0] - first) / step)).astype(int)
        ends = np.clip(np.arange(time.size) + np.array([[-AROUND], [AROUND]]), 0, time.size - 1)
        span = time[ends[1]] - time[ends[0]]
        turned = frames.attitude_error(quaternion[ends[1]], quaternion[ends[0]])
        kept = (at < grid.size) & (span < 4 * AROUND * step)
        late = ((first + step * at - time) / span)[:, None] * turned
        moved = frames.quaternion_product(quaternion, frames.from_rotation_vector(late))
        attitudes[head] = np.full((grid.size, 4), np.nan)
        attitudes[head][at[kept]] = moved[kept]
    return grid, attitudes


def blocks(time: np.ndarray, attitudes: dict[int, np.ndarray], block_s: float) -> list[tuple]:
    """Blocks with two heads or more: first epoch s, heads, mean difference (m,) rad, periodogram of each band.

    Differences are the small rotations, one head after the other, from the attitude by the first of the heads to that
    by each other one. A periodogram is the sum of (m, m) rad2/Hz over a band, and how many ordinates it is of.
    """
    step = time[1] - time[0] if time.size > 1 else 1.0
    count, made = int(block_s / step), []
    edges = [*BANDS_HZ.values(), 0.5 / step - 1e-9]
    window, elapsed = np.hanning(count + 1)[:count], step * (np.arange(count) - (count - 1) / 2)
    frequency = np.fft.rfftfreq(count, step)
    for begin in range(0, time.size - count + 1, count):
        rows = {head: one[begin : begin + count] for head, one in attitudes.items()}
        heads = [head for head, one in rows.items() if np.isfinite(one[:, 0]).mean() >= FULL]
        if len(heads) < 2:
            continue
        valid = np.isfinite([rows[head][:, 0] for head in heads]).all(axis=0)
        apart = np.zeros((count, 3 * len(heads) - 3))
        each = [frames.attitude_error(rows[head][valid], rows[heads[0]][valid]) for head in heads[1:]]
        apart[valid] = np.concatenate(each, axis=1)
        distance = np.abs(apart - np.median(apart[valid], axis=0))
        valid &= (distance < FAR * 1.4826 * np.maximum(np.median(distance[valid], axis=0), 1e-12)).all(axis=1)
        if valid.mean() < FULL:
            continue
        straight = np.stack([np.ones(count), elapsed], axis=1)[valid]
        line = np.linalg.lstsq(straight, apart[valid], rcond=None)[0]
        left, tapered = np.zeros_like(apart), window * valid  # samples that are missing weigh nothing
        left[valid] = apart[valid] - straight @ line
        wave, sums = np.fft.rfft(tapered[:, None] * left, axis=0), []
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            own = wave[(frequency >= low) & (frequency < high)]
            power = np.einsum("fi,fj->ij", own, own.conj()).real * 2 * step / np.sum(tapered**2)
            sums.append((power, len(own)))
        made.append((time[begin], tuple(heads), line[0], sums))
    return made


def against(heads: tuple[int, ...], every: list[int]) -> np.ndarray:
    """Differences (m, 3 h) of some heads by turns of every head in the SRF: each other one less the first."""
    signs = np.array([[(one == head) - (one == heads[0]) for one in every] for head in heads[1:]], dtype=float)
    return np.kron(signs, np.eye(3))


def densities(pieces: list[tuple], band: int, every: list[int], axes_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithm (3 h,) of the density rad2/Hz of each head about its own axes in a band, and its covariance.

    Columns of axes_b (3 h, 3 h) are the axes of every head in the SRF.

    Notes
    -----
    Differences have the spectral matrix S = sum_i d_i a_i a_i', a_i what a turn about axis i does to them; Fisher
    scoring of the Whittle likelihood -n (log det S + tr S^-1 W), W the mean of n periodograms. What S holds of d: of
    three heads all, since the difference of 1 and 2 with that of 1 and 3 has the noise of 1 alone; of two heads all but
    one number: noise that is the same about all axes, taken from one head and given to the other, leaves S as it is,
    because the axes of either add up to sum_i a_i a_i' = 1. Variances across the lines of sight are therefore held to
    be alike, their logarithms within SPREAD of the mean, and so are those about the lines of sight. Of two heads, that
    and S being positive are what separates the small axes, and the errors say so.
    """
    groups = {}
    for _, own, _, sums in pieces:
        power, number = groups.get(own, (0.0, 0))
        groups[own] = power + sums[band][0], number + sums[band][1]
    data = [(against(own, every) @ axes_b, power / max(n, 1), n / HELD) for own, (power, n) in groups.items()]
    size, total = 3 * len(every), sum(n for *_, n in data)
    if not total:
        return np.full(size, np.nan), np.full((size, size), np.nan)
    about = np.tile([0, 0, 1], len(every))
    alike = about[:, None] == about
    prior = (np.eye(size) - alike / alike.sum(axis=0)) / SPREAD**2
    log_density = np.full(size, np.log(sum(n * np.trace(W) / len(W) for _, W, n in data) / total / 2))
    for _ in range(ITERATIONS):
        density, slope, information = np.exp(log_density), -prior @ log_density, prior.copy()
        for axes, measured, n in data:
            solved = np.linalg.solve(axes * density @ axes.T, axes)
            mutual = axes.T @ solved
            slope += n * density * (np.einsum("mi,mk,ki->i", solved, measured, solved) - np.diag(mutual))
            information += n * np.outer(density, density) * mutual**2
        move = np.linalg.solve(information, slope)
        log_density = log_density + move / max(1.0, np.abs(move).max())
        if np.abs(move).max() < 1e-9:
            break
    return log_density, np.linalg.inv(information)


def heads(observed: xr.Dataset, *, mounting, block_s: float, parts: int) -> xr.Dataset:
    """Mounting of each further head against the first, and noise of each about its own axes, of "ingest" of SCA1A.

    The nominal mounting (heads, 4), scalar first, is that of QSA1B; means and periodograms are of blocks of block_s.

    Notes
    -----
    Head k measures q_k = q_k,true * (small turn e_k about its own axes), and QSA1B makes it an attitude of the SRF,
    q_k * m_k. With R_k = R(m_k), which takes components of the head to the SRF, and b_k the turn of the SRF by an
    error of m_k, both about axes of the SRF,

        q_k m_k = q (R_k e_k + b_k),   (q_1 m_1)^-1 (q_k m_k) = (b_k - b_1) + R_k e_k - R_1 e_1

    to first order, whatever the attitude. The bias is b_k - b_1: of the heads' common error nothing is seen, and tags
    of one head late by t look like a bias -w t. Means of blocks are weighed by the noise of the slow band; their
    errors are as much larger as blocks, or parts, scatter more than that.
    """
    time, attitudes = on_grid(observed, mounting)
    pieces, R_bs = blocks(time, attitudes, block_s), frames.R_bi_from_quaternion(np.asarray(mounting))
    every = sorted({head for _, own, *_ in pieces for head in own})
    axes_b = block_diag(*(R_bs[head - 1] for head in every)) if every else np.zeros((0, 0))
    group = np.arange(len(pieces)) * parts // max(len(pieces), 1)
    ranges = [[one for one, g in zip(pieces, group, strict=True) if g == number] for number in np.unique(group)]
    value, covariance, *agreement = _solved(ranges, every, axes_b, block_s)
    each = [_solved([part], every, axes_b, block_s) for part in ranges]
    biases, labels = 3 * max(len(every) - 1, 0), [f"{head}_{axis}" for head in every for axis in "xyz"]
    solution = {"parameter": [f"bias_{one}" for one in labels[3:]]}
    solution["parameter"] += [f"noise_{one}_{band}" for band in BANDS_HZ for one in labels]
    solution |= {"unit": ["rad"] * biases + ["rad Hz-1/2"] * (value.size - biases)}
    solution |= {"value": value, "sigma": np.sqrt(np.diag(covariance)), "covariance": covariance}
    solution |= {"part_start": [part[0][0] for part in ranges], "blocks": len(pieces)}
    solution |= {"part_value": np.reshape([one[0] for one in each], (len(each), value.size))}
    solution |= {"part_sigma": np.reshape([np.sqrt(np.diag(one[1])) for one in each], (len(each), value.size))}
    solution |= dict(zip(("agreement_chi2", "agreement_dof"), agreement, strict=True))
    turns = {code: _turn(code, value, every, axes_b) for code in range(1, 2 ** len(mounting))}
    turns = {code: one for code, one in turns.items() if one is not None}
    solution |= {"code": list(turns), "turn_b": np.reshape(list(turns.values()), (len(turns), 3))}
    return build(SCHEMAS["heads"], solution)


def _solved(ranges, every, axes_b, block_s):
    """Bias, then noise, of all blocks of some ranges, their covariance; disagreement of the ranges about the bias."""
    if not ranges:
        return np.zeros(0), np.zeros((0, 0)), 0.0, 0
    whole = [one for part in ranges for one in part]
    (slow, slow_covariance), (fast, fast_covariance) = (densities(whole, band, every, axes_b) for band in (0, 1))
    count, square, freedom = 3 * len(every) - 3, 0.0, -3 * len(every) + 3
    information, right = np.zeros((len(ranges), count, count)), np.zeros((len(ranges), count))
    for k, part in enumerate(ranges):
        for _, own, mean, _ in part:
            axes = against(own, every) @ axes_b
            both = np.column_stack([against(own, every)[:, 3:], mean])
            product = both.T @ np.linalg.solve(axes * np.exp(slow) @ axes.T / (2 * block_s), both)
            information[k], right[k] = information[k] + product[:-1, :-1], right[k] + product[:-1, -1]
            square, freedom = square + product[-1, -1], freedom + mean.size
    normal, side = information.sum(axis=0), right.sum(axis=0)
    bias = least_squares.stable_inverse(normal) @ side
    chi2, dof = named_parameters.agreement(information, right)
    factor = max(1.0, (square - bias @ side) / max(freedom, 1), chi2 / max(dof, 1))
    sizes = np.exp(np.concatenate([slow, fast]) / 2)
    of_noise = block_diag(slow_covariance, fast_covariance) * np.outer(sizes, sizes) / 4
    covariance = block_diag(least_squares.covariance(normal) * factor, of_noise)
    return np.concatenate([bias, sizes]), covariance, chi2, dof


def _turn(code, value, every, axes_b):
    """Attitude (3,) rad by the heads of a code of SCA1B against that by the first head, by the noise of each."""
    held = [place for place, head in enumerate(every) if code >> (head - 1) & 1]
    if len(held) != code.bit_count():
        return None
    bias = np.append(np.zeros(3), value[: 3 * len(every) - 3]).reshape(-1, 3)
    slow = value[3 * len(every) - 3 :][: 3 * len(every)]
    weights = np.linalg.inv(axes_b * slow**2 @ axes_b.T).reshape(len(every), 3, len(every), 3)
    weights = [weights[place, :, place] for place in held]
    return np.linalg.solve(sum(weights), sum(w @ bias[p] for w, p in zip(weights, held, strict=True)))
