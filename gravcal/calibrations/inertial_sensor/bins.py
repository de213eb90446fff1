"""Means over bins, spikes and noise levels of evenly sampled records; a long roll reduced to bins, span by span."""

import math

import numba
import numpy as np

from gravcal.effects import inertial_sensor as electrodes
from gravcal.physics import frames, gravity

SPIKE = 6.0  # standard deviations of a sample about the mean of its bin


def spikes(values: np.ndarray, half_width: int, limit: float) -> np.ndarray:
    """Samples (n, m) farther than a limit, in standard deviations, from the running median of so many neighbours."""
    from scipy.ndimage import median_filter

    away = np.abs(values - median_filter(values, size=(2 * half_width + 1, 1), mode="nearest"))
    return away > limit * 1.4826 * np.maximum(np.median(away, axis=0), 1e-300)


def repaired(time: np.ndarray, values: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Values (n, m) with bad samples (n, m) replaced by the straight line between their good neighbours."""
    out = np.array(values, dtype=float)
    for column in range(out.shape[1]):
        wrong = bad[:, column] | ~np.isfinite(out[:, column])
        if wrong.any() and not wrong.all():
            out[wrong, column] = np.interp(time[wrong], time[~wrong], out[~wrong, column])
    return out


def lines_between(at: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Straight lines between samples (n, m) at other epochs (k,), column by column."""
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)


def bin_means(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over bins, NaN samples left out.

    Parameters
    ----------
    time : (n,) s, increasing
    values : (n, ...) any unit
    edges : (b + 1,) s

    Returns
    -------
    mean : (b, ...) unit, NaN where a bin is empty
    count : (b,) samples in each bin
    """
    inside = (time >= edges[0]) & (time < edges[-1])
    flat = np.asarray(values, dtype=float).reshape(time.size, math.prod(np.shape(values)[1:]))
    use = inside & np.isfinite(flat).all(axis=1)
    index = np.searchsorted(edges, time[use], side="right") - 1
    count = np.bincount(index, minlength=edges.size - 1)
    total = np.stack([np.bincount(index, column, edges.size - 1) for column in flat[use].T], axis=1)
    mean = total / np.where(count > 0, count, np.nan)[:, None]
    return mean.reshape(edges.size - 1, *np.shape(values)[1:]), count


def scatter_of_third_differences(values: np.ndarray) -> np.ndarray:
    """Variance (m,) of white noise on a smooth motion (n, m), robust against jumps; the squared weights sum to 20."""
    third = np.diff(values, 3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    return (1.4826 * np.median(np.abs(third), axis=0)) ** 2 / 20


def reduced(sensor: dict, tracker: dict, orbit: dict, step_s: float) -> dict[str, np.ndarray]:
    """Bins of one span, for example of one day's files.

    Parameters
    ----------
    sensor : {"time": (n,) s, "volts": (n, 6) V}; tracker : {"time", "quaternion" (m, 4)}
    orbit : {"time", "position" (r, 3) m, "velocity" (r, 3) m s-1}, inertial
    step_s : s, length of a bin; bins begin at multiples of it

    Returns
    -------
    bins : {"time" (b,) s; "linear_volt" (b, 3) V; "share" (b,) of the samples present and used;
        "R_bo" (b, 3, 3), o: x radial, z along the flight; "rate_b" (b, 3); "gradient_b" (b, 3, 3)}, NaN where unknown
    """
    first = np.ceil(sensor["time"][0] / step_s - 1e-9)
    last = np.floor((sensor["time"][-1] + 1e-6) / step_s + 0.05)
    edges = step_s * np.arange(first, last + 1)
    middle = edges[:-1] + step_s / 2
    mean, count = clipped_means(sensor["time"], sensor["volts"] @ electrodes.READOUT[:3].T, edges)
    quaternion = mean_attitude(tracker["time"], tracker["quaternion"], edges)
    state = np.concatenate([orbit["position"], orbit["velocity"]], axis=1)
    state = np.stack([np.interp(middle, orbit["time"], column, np.nan, np.nan) for column in state.T], axis=1)
    R_bi = frames.R_bi_from_quaternion(np.where(np.isfinite(quaternion), quaternion, [1.0, 0, 0, 0]))
    R_bi[~np.isfinite(quaternion).all(axis=1)] = np.nan
    sampling = np.median(np.diff(sensor["time"][:10000]))
    position = np.where(np.isfinite(state[:, :3]), state[:, :3], 7e6)
    return {
        "time": middle,
        "linear_volt": mean,
        "share": np.minimum(count.min(axis=1) / np.rint(step_s / sampling), 1.0),
        "R_bo": R_bi @ np.swapaxes(frames.flight_frame(state), 1, 2),
        "rate_b": rates(quaternion, step_s),
        "gradient_b": gravity.rotate_tensor(R_bi, gravity.gradient_i(position)),
    }


def clipped_means(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (b, m) of samples (n, m) over bins without spikes, NaN where empty, and how many samples were used.

    The limit is that of the noise, or of the motion within a bin if it is larger.
    """
    pairs = np.diff(values[: values.shape[0] // 2 * 2].reshape(-1, 2, values.shape[1])[::7], axis=1)
    noise = 1.4826 * np.nanmedian(np.abs(pairs), axis=(0, 1)) / np.sqrt(2)
    half = max(int(time.size * np.median(np.diff(edges)) / (time[-1] - time[0]) / 2), 1) if time.size > 1 else 1
    change = np.nanmedian(np.abs(values[half::7] - values[:-half:7]), axis=0)
    limit = SPIKE * np.maximum(np.nan_to_num(np.maximum(noise, change)), 1e-300)
    return _clipped_means(values, np.searchsorted(time, edges - 1e-6), limit)


@numba.njit(cache=True, nogil=True)
def _clipped_means(values, bounds, limit):
    """Means (b, m) of the samples (n, m) between bounds (b + 1,), none farther than the limit (m,); counts (b, m).

    Compiled: a day at 10 Hz in one pass, of a spike the bin is averaged again about its median.
    """
    bins, width = bounds.size - 1, values.shape[1]
    mean, number = np.full((bins, width), np.nan), np.zeros((bins, width))
    for b in range(bins):
        for c in range(width):
            samples = values[bounds[b] : bounds[b + 1], c]
            total, count = 0.0, 0
            for value in samples:
                if np.isfinite(value):
                    total += value
                    count += 1
            if count == 0:
                continue
            mean[b, c], number[b, c] = total / count, count
            far = 0.0
            for value in samples:
                if abs(value - mean[b, c]) > far:
                    far = abs(value - mean[b, c])
            if far <= limit[c]:
                continue
            middle = np.nanmedian(samples)  # a spike does not move it
            shift, near = 0.0, 0
            for value in samples:
                if abs(value - middle) <= limit[c]:
                    shift += value - middle
                    near += 1
            mean[b, c] = middle + shift / max(near, 1)
            number[b, c] = near if near else count
    return mean, number


def mean_attitude(time: np.ndarray, quaternion: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Attitude (b, 4) in the middle of each bin from the mean of its samples, NaN where more than half are missing."""
    good = np.linalg.norm(quaternion, axis=1) > 0.5  # False of NaN
    mean, count = bin_means(time[good], frames.continuous(quaternion[good]), edges - 1e-6)
    mean[count < 0.5 * np.median(count)] = np.nan
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def rates(quaternion: np.ndarray, step_s: float) -> np.ndarray:
    """Body rates (b, 3) rad s-1 from attitudes (b, 4) one step apart: the turn from the bin before to the bin after."""
    good = np.isfinite(quaternion).all(axis=1)
    q = np.where(good[:, None], quaternion, [1.0, 0.0, 0.0, 0.0])
    turn = frames.attitude_error(q[1:], q[:-1]) / step_s
    turn[~(good[1:] & good[:-1])] = np.nan
    out = np.full((q.shape[0], 3), np.nan)
    out[1:-1] = (turn[1:] + turn[:-1]) / 2
    out[0], out[-1] = turn[0], turn[-1]
    return out
