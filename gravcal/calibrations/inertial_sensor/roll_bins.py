"""A long record of a rolling sensor reduced to bins: readouts, direction cosines, rates. One span at a time."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.inertial_sensor import roll_kernels as kernels
from gravcal.effects import inertial_sensor as electrodes
from gravcal.physics import frames, gravity

SPIKE = 6.0  # standard deviations of a sample about the mean of its bin


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
    readout = sensor["volts"] @ electrodes.READOUT[:3].T
    mean, count = clipped_means(sensor["time"], readout, edges)
    quaternion = mean_attitude(tracker["time"], tracker["quaternion"], edges)
    state = np.concatenate([orbit["position"], orbit["velocity"]], axis=1)
    state = np.stack([np.interp(middle, orbit["time"], column, np.nan, np.nan) for column in state.T], axis=1)
    R_bi = frames.R_bi_from_quaternion(np.where(np.isfinite(quaternion), quaternion, [1.0, 0, 0, 0]))
    R_bi[~np.isfinite(quaternion).all(axis=1)] = np.nan
    usual = np.median(np.diff(sensor["time"][:10000]))
    position = np.where(np.isfinite(state[:, :3]), state[:, :3], 7e6)
    return {
        "time": middle,
        "linear_volt": mean,
        "share": np.minimum(count.min(axis=1) / np.rint(step_s / usual), 1.0),
        "R_bo": R_bi @ np.swapaxes(orbit_frame(state), 1, 2),
        "rate_b": rates(quaternion, step_s),
        "gradient_b": gravity.rotate_tensor(R_bi, gravity.gradient_i(position)),
    }


def clipped_means(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over bins without spikes.

    Parameters
    ----------
    time : (n,) s, increasing; values : (n, m); edges : (b + 1,) s

    Returns
    -------
    mean : (b, m), NaN where empty; count : (b, m) samples used
    """
    some = np.diff(values[: values.shape[0] // 2 * 2].reshape(-1, 2, values.shape[1])[::7], axis=1)
    size = 1.4826 * np.nanmedian(np.abs(some), axis=(0, 1)) / np.sqrt(2)
    half = max(int(time.size * np.median(np.diff(edges)) / (time[-1] - time[0]) / 2), 1) if time.size > 1 else 1
    change = np.nanmedian(
        np.abs(values[half::7] - values[:-half:7]), axis=0
    )  # the motion within a bin, if it is larger
    limit = SPIKE * np.maximum(np.nan_to_num(np.maximum(size, change)), 1e-300)
    return kernels.clipped_means(values, np.searchsorted(time, edges - 1e-6), limit)


def mean_attitude(time: np.ndarray, quaternion: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Attitude in the middle of each bin from the mean of its samples, NaN where more than half are missing (b, 4).

    Parameters
    ----------
    time : (n,) s, increasing; quaternion : (n, 4); edges : (b + 1,) s
    """
    mean, count = kernels.mean_quaternions(
        np.ascontiguousarray(quaternion, dtype=float), np.searchsorted(time, edges - 1e-6)
    )
    mean[count < 0.5 * np.median(count)] = np.nan
    return mean


def orbit_frame(state_i: np.ndarray) -> np.ndarray:
    """R_oi of x radially outward, z along the flight, y = z x x; the pointing of the sensor in normal flight (b, 3, 3).

    Parameters
    ----------
    state_i : (b, 6) m and m s-1
    """
    x = state_i[:, :3] / np.linalg.norm(state_i[:, :3], axis=1, keepdims=True)
    y = np.cross(state_i[:, 3:], state_i[:, :3])
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def rates(quaternion: np.ndarray, step_s: float) -> np.ndarray:
    """Body rates from attitudes one step apart: the turn from the bin before to the bin after (b, 3).

    Parameters
    ----------
    quaternion : (b, 4), NaN where unknown; step_s : s
    """
    good = np.isfinite(quaternion).all(axis=1)
    q = np.where(good[:, None], quaternion, [1.0, 0.0, 0.0, 0.0])
    turn = frames.attitude_error(q[1:], q[:-1]) / step_s
    turn[~(good[1:] & good[:-1])] = np.nan
    out = np.full((q.shape[0], 3), np.nan)
    out[1:-1] = (turn[1:] + turn[:-1]) / 2
    out[0], out[-1] = turn[0], turn[-1]
    return out
