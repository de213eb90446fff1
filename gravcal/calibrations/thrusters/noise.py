"""Mounting of the star-camera heads against each other, and noise of each about its own axes, from SCA1A."""

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

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
FAR = 8.0  # robust standard deviations of a difference beyond which an epoch is rejected: false stars
HELD = 35 / 18  # correlated ordinates of a periodogram under a Hann window that count as one independent
AROUND = 8  # samples on either side that give the rate by which an attitude is moved to another tag
ITERATIONS = 100  # most steps of Fisher scoring


def on_grid(observed: xr.Dataset, mounting) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Even epochs (n,) s by the file's tags, and {head: quaternions (n, 4) of the SRF}, NaN where there is none.

    `observed` is "ingest" of SCA1A, mounting (heads, 4) as QSA1B has it. Tags of heads may differ by part of a step: an
    attitude is moved to the epoch by its own rate over some seconds, so that its noise stays as it is.
    """
    mounting, series = np.asarray(mounting), {}
    for head in range(1, len(mounting) + 1):
        sca1a = observed.isel(record=np.flatnonzero(observed["sca_id"].values == head))
        time, values, flag, _ = sorted_samples(sca1a, own_tags(sca1a), QUATERNION, (sca1a["qualflg"].values & BAD) != 0)
        norm = np.linalg.norm(values, axis=1)
        good = (flag == 0) & (np.abs(norm - 1) < 1e-3)
        if good.sum() > 2 * AROUND:
            unit, mount = values[good] / norm[good, None], mounting[head - 1] / np.linalg.norm(mounting[head - 1])
            series[head] = time[good], frames.quaternion_product(unit, mount)
    if not series:
        return np.zeros(0), {}
    first, last = (fold(time[index] for time, _ in series.values()) for fold, index in ((min, 0), (max, -1)))
    step = max(np.median(np.diff(time)) for time, _ in series.values())
    grid, attitudes = first + step * np.arange(int((last - first) / step) + 1), {}
    for head, (time, quaternion) in series.items():
        index = np.rint((time - time[0]) / step + np.rint((time[0] - first) / step)).astype(int)
        ends = np.clip(np.arange(time.size) + np.array([[-AROUND], [AROUND]]), 0, time.size - 1)
        span = time[ends[1]] - time[ends[0]]
        turn_b = frames.attitude_error(quaternion[ends[1]], quaternion[ends[0]])
        kept = (index < grid.size) & (span < 4 * AROUND * step)
        shift_b = ((first + step * index - time) / span)[:, None] * turn_b
        moved = frames.quaternion_product(quaternion, frames.from_rotation_vector(shift_b))
        attitudes[head] = np.full((grid.size, 4), np.nan)
        attitudes[head][index[kept]] = moved[kept]
    return grid, attitudes


def blocks(time: np.ndarray, attitudes: dict[int, np.ndarray], block_s: float) -> list[tuple]:
    """Blocks with two heads or more: (first epoch s, heads, mean difference (m,) rad, [(power, number)] by band) each.

    A difference, m = 3 (heads - 1), holds the small rotations from the attitude by the first of the heads to that by
    each other one; power (m, m) rad2 Hz-1 is the sum of its cross-periodogram over `number` ordinates of a band.
    """
    step = time[1] - time[0] if time.size > 1 else 1.0
    count, pieces = int(block_s / step), []
    edges = [*BANDS_HZ.values(), 0.5 / step - 1e-9]
    window, elapsed = np.hanning(count + 1)[:count], step * (np.arange(count) - (count - 1) / 2)
    frequency = np.fft.rfftfreq(count, step)
    for begin in range(0, time.size - count + 1, count):
        rows = {head: one[begin : begin + count] for head, one in attitudes.items()}
        heads = [head for head, one in rows.items() if np.isfinite(one[:, 0]).mean() >= FULL]
        if len(heads) < 2:
            continue
        valid = np.isfinite([rows[head][:, 0] for head in heads]).all(axis=0)
        difference = np.zeros((count, 3 * len(heads) - 3))
        each = [frames.attitude_error(rows[head][valid], rows[heads[0]][valid]) for head in heads[1:]]
        difference[valid] = np.concatenate(each, axis=1)
        distance = np.abs(difference - np.median(difference[valid], axis=0))
        valid &= (distance < FAR * 1.4826 * np.maximum(np.median(distance[valid], axis=0), 1e-12)).all(axis=1)
        if valid.mean() < FULL:
            continue
        straight = np.stack([np.ones(count), elapsed], axis=1)[valid]
        line = np.linalg.lstsq(straight, difference[valid], rcond=None)[0]
        residual, tapered = np.zeros_like(difference), window * valid  # samples that are missing weigh nothing
        residual[valid] = difference[valid] - straight @ line
        fourier, sums = np.fft.rfft(tapered[:, None] * residual, axis=0), []
        for low, high in zip(edges[:-1], edges[1:], strict=True):
            in_band = fourier[(frequency >= low) & (frequency < high)]
            power = np.einsum("fi,fj->ij", in_band, in_band.conj()).real * 2 * step / np.sum(tapered**2)
            sums.append((power, len(in_band)))
        pieces.append((time[begin], tuple(heads), line[0], sums))
    return pieces


def against(heads: tuple[int, ...], every: list[int]) -> np.ndarray:
    """Matrix (m, 3 h) from small rotations of all h heads, `every`, to differences of `heads` from the first."""
    signs = np.array([[(one == head) - (one == heads[0]) for one in every] for head in heads[1:]], dtype=float)
    return np.kron(signs, np.eye(3))


def densities(pieces: list[tuple], band: int, every: list[int], axes_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithm (3 h,) of the density rad2 Hz-1 of each head about its own axes in a band, and its covariance.

    Pieces are of `blocks`, band its number, every the h heads; columns of axes_b (3 h, 3 h) are their axes in the SRF.

    Notes
    -----
    Differences have the spectral matrix S = sum_i d_i a_i a_i', a_i the difference by a unit turn about axis i; Fisher
    scoring of the Whittle likelihood -n (log det S + tr S^-1 W), W the mean of n periodograms. S determines, of three
    heads, all of d, since the difference of 1 and 2 with that of 1 and 3 has the noise of 1 alone; of two heads all but
    one number: noise that is the same about all axes, taken from one head and given to the other, leaves S as it is,
    because the axes of either add up to sum_i a_i a_i' = 1. Variances across the lines of sight are therefore held to
    be alike, their logarithms within SPREAD of the mean, and so are those about the lines of sight. Of two heads, that
    and S being positive are what separates the small axes, and the errors say so.
    """
    groups = {}
    for _, used, _, sums in pieces:
        power, number = groups.get(used, (0.0, 0))
        groups[used] = power + sums[band][0], number + sums[band][1]
    data = [(against(used, every) @ axes_b, power / max(n, 1), n / HELD) for used, (power, n) in groups.items()]
    size, total = 3 * len(every), sum(n for *_, n in data)
    if not total:
        return np.full(size, np.nan), np.full((size, size), np.nan)
    kind = np.tile([0, 0, 1], len(every))  # axes across the line of sight, and about it
    same_kind = kind[:, None] == kind
    prior = (np.eye(size) - same_kind / same_kind.sum(axis=0)) / SPREAD**2
    log_density = np.full(size, np.log(sum(n * np.trace(W) / len(W) for _, W, n in data) / total / 2))
    for _ in range(ITERATIONS):
        density, gradient, information = np.exp(log_density), -prior @ log_density, prior.copy()
        for axes, measured, n in data:
            solved = np.linalg.solve(axes * density @ axes.T, axes)  # S^-1 a_i
            mutual = axes.T @ solved  # a_i' S^-1 a_k
            gradient += n * density * (np.einsum("mi,mk,ki->i", solved, measured, solved) - np.diag(mutual))
            information += n * np.outer(density, density) * mutual**2
        step = np.linalg.solve(information, gradient)
        log_density = log_density + step / max(1.0, np.abs(step).max())
        if np.abs(step).max() < 1e-9:
            break
    return log_density, np.linalg.inv(information)


def heads(observed: xr.Dataset, *, mounting, block_s: float, parts: int) -> xr.Dataset:
    """Product "thrusters.heads": mounting of each further head against the first, noise of each about its own axes.

    `observed` is "ingest" of SCA1A; the nominal mounting (heads, 4), scalar first, of QSA1B; blocks are of block_s.

    Notes
    -----
    Head k measures q_k = q_k,true * (small turn e_k about its own axes), and QSA1B makes it an attitude of the SRF,
    q_k * m_k. With R_k = R(m_k), which takes components of the head to the SRF, and b_k the turn of the SRF by an
    error of m_k, both about axes of the SRF,

        q_k m_k = q (R_k e_k + b_k),   (q_1 m_1)^-1 (q_k m_k) = (b_k - b_1) + R_k e_k - R_1 e_1

    to first order, whatever the attitude. The bias is b_k - b_1: the heads' common error is not observable, and tags
    of one head late by t look like a bias -w t. Means of blocks are weighted by the noise of the slow band; their
    errors are as much larger as blocks, or parts, scatter more than that.
    """
    time, attitudes = on_grid(observed, mounting)
    pieces, R_bs = blocks(time, attitudes, block_s), frames.R_bi_from_quaternion(np.asarray(mounting))
    every = sorted({head for _, used, *_ in pieces for head in used})
    axes_b = block_diag(*(R_bs[head - 1] for head in every)) if every else np.zeros((0, 0))
    group = np.arange(len(pieces)) * parts // max(len(pieces), 1)
    ranges = [[one for one, g in zip(pieces, group, strict=True) if g == number] for number in np.unique(group)]
    value, covariance, *agreement = _solved(ranges, every, axes_b, block_s)
    by_part = [_solved([part], every, axes_b, block_s) for part in ranges]
    biases, labels = 3 * max(len(every) - 1, 0), [f"{head}_{axis}" for head in every for axis in "xyz"]
    solution = {"parameter": [f"bias_{one}" for one in labels[3:]]}
    solution["parameter"] += [f"noise_{one}_{band}" for band in BANDS_HZ for one in labels]
    solution |= {"unit": ["rad"] * biases + ["rad Hz-1/2"] * (value.size - biases)}
    solution |= {"value": value, "sigma": np.sqrt(np.diag(covariance)), "covariance": covariance}
    solution |= {"part_start": [part[0][0] for part in ranges], "blocks": len(pieces)}
    solution |= {"part_value": np.reshape([one[0] for one in by_part], (len(by_part), value.size))}
    solution |= {"part_sigma": np.reshape([np.sqrt(np.diag(one[1])) for one in by_part], (len(by_part), value.size))}
    solution |= dict(zip(("agreement_chi2", "agreement_dof"), agreement, strict=True))
    turns = {code: _turn(code, value, every, axes_b) for code in range(1, 2 ** len(mounting))}
    turns = {code: one for code, one in turns.items() if one is not None}
    solution |= {"code": list(turns), "turn_b": np.reshape(list(turns.values()), (len(turns), 3))}
    return build(SCHEMAS["heads"], solution)


def _solved(ranges, every, axes_b, block_s):
    """Bias rad and noise rad Hz-1/2 (p,) of lists of pieces, covariance (p, p), agreement of the lists: chi2, dof."""
    if not ranges:
        return np.zeros(0), np.zeros((0, 0)), 0.0, 0
    pieces = [piece for part in ranges for piece in part]
    (slow, slow_covariance), (fast, fast_covariance) = (densities(pieces, band, every, axes_b) for band in (0, 1))
    count, chi2_sum, redundancy = 3 * len(every) - 3, 0.0, -3 * len(every) + 3
    information, right = np.zeros((len(ranges), count, count)), np.zeros((len(ranges), count))
    for k, part in enumerate(ranges):
        for _, used, mean, _ in part:
            axes = against(used, every) @ axes_b
            columns = np.column_stack([against(used, every)[:, 3:], mean])
            gram = columns.T @ np.linalg.solve(axes * np.exp(slow) @ axes.T / (2 * block_s), columns)
            information[k], right[k] = information[k] + gram[:-1, :-1], right[k] + gram[:-1, -1]
            chi2_sum, redundancy = chi2_sum + gram[-1, -1], redundancy + mean.size
    normal, side = information.sum(axis=0), right.sum(axis=0)
    bias = least_squares.stable_inverse(normal) @ side
    chi2, dof = least_squares.disagreement(right, information)
    factor = max(1.0, (chi2_sum - bias @ side) / max(redundancy, 1), chi2 / max(dof, 1))  # of variances
    amplitude = np.exp(np.concatenate([slow, fast]) / 2)
    noise_covariance = block_diag(slow_covariance, fast_covariance) * np.outer(amplitude, amplitude) / 4
    covariance = block_diag(least_squares.covariance(normal) * factor, noise_covariance)
    return np.concatenate([bias, amplitude]), covariance, chi2, dof


def _turn(code, value, every, axes_b):
    """Rotation (3,) rad from the attitude by the first head to that by the heads of a sca_id; None if one unknown."""
    places = [place for place, head in enumerate(every) if code >> (head - 1) & 1]  # heads of the bits
    if len(places) != code.bit_count():
        return None
    bias = np.append(np.zeros(3), value[: 3 * len(every) - 3]).reshape(-1, 3)
    slow = value[3 * len(every) - 3 :][: 3 * len(every)]
    weights = np.linalg.inv(axes_b * slow**2 @ axes_b.T).reshape(len(every), 3, len(every), 3)
    weights = [weights[place, :, place] for place in places]
    return np.linalg.solve(sum(weights), sum(w @ bias[p] for w, p in zip(weights, places, strict=True)))
