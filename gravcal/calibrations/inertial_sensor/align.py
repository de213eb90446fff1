"""Detection of swings and rolls, the record round a swing, the bins of a roll, and the cleaning of records."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import xarray as xr
from scipy.ndimage import median_filter, uniform_filter1d

from gravcal.calibrations import schemas
from gravcal.calibrations.align import BRIDGED_S, between
from gravcal.calibrations.schemas import build
from gravcal.effects import inertial_sensor as electrodes
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import timing
from gravcal.estimation.noise import runs
from gravcal.estimation.resampling import bin_means, lines_between
from gravcal.physics import frames, gravity

SCHEMAS = schemas.of("inertial_sensor.toml")

SPIKE = 6.0  # standard deviations of a sample about the mean of its bin
STEP = 2.0  # s, of the attitude looked at
SHOWN = 60.0  # s, of the rates kept
WINDOW = 28.0  # s, of the running rms, about one period of a swing
EARLY = 8.0  # s, by which a running rms shows a swing before it begins
SENSOR_STEP = 0.1  # s
#: Of attitudes against voltages: longest lag s, width s of the correlation about its peak, band of a swing Hz.
APART_S, NEAR_S, TURNING_HZ = 600, 150, (1 / 60, 1 / 8)


def spikes(values: np.ndarray, half_width: int, limit: float) -> np.ndarray:
    """True for samples (n, m) more than `limit` robust sigmas from the running median of 2 half_width + 1 samples."""
    distance = np.abs(values - median_filter(values, size=(2 * half_width + 1, 1), mode="nearest"))
    return distance > limit * 1.4826 * np.maximum(np.median(distance, axis=0), 1e-300)


def repaired(time: np.ndarray, values: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Values (n, m) with bad samples (n, m) replaced by the straight line between their good neighbours."""
    out = np.array(values, dtype=float)
    for column in range(out.shape[1]):
        wrong = bad[:, column] | ~np.isfinite(out[:, column])
        if wrong.any() and not wrong.all():
            out[wrong, column] = np.interp(time[wrong], time[~wrong], out[~wrong, column])
    return out


def scatter_of_third_differences(values: np.ndarray) -> np.ndarray:
    """Variance (m,) of white noise on a smooth motion (n, m), robust against jumps; the squared weights sum to 20."""
    third = np.diff(values, 3, axis=0)
    third = third[np.isfinite(third).all(axis=1)]
    return (1.4826 * np.median(np.abs(third), axis=0)) ** 2 / 20


def reduced(sensor: dict, tracker: dict, orbit: dict, step_s: float) -> dict[str, np.ndarray]:
    """Bin means of one span, for example of one day's files; bins begin at multiples of their length step_s.

    Arguments are {"time", "volts" (n, 6) V}, {"time", "quaternion" (m, 4)}, {"time", "position", "velocity" (r, 3), i}.
    Bins {"time" (b,), "linear_volt" (b, 3) V, "share" (b,) of the samples present and used, "R_bo" (b, 3, 3), o with
    x radial and z along the flight, "rate_b" (b, 3) rad s-1} are NaN where unknown; "gradient_b" (b, 3, 3) s-2 is not.
    """
    first = np.ceil(sensor["time"][0] / step_s - 1e-9)
    edges = step_s * np.arange(first, np.floor((sensor["time"][-1] + 1e-6) / step_s + 0.05) + 1)
    middle = edges[:-1] + step_s / 2
    mean, count = clipped_means(sensor["time"], sensor["volts"] @ electrodes.READOUT[:3].T, edges)
    quaternion = mean_attitude(tracker["time"], tracker["quaternion"], edges)
    state = np.concatenate([orbit["position"], orbit["velocity"]], axis=1)
    state = np.stack([np.interp(middle, orbit["time"], column, np.nan, np.nan) for column in state.T], axis=1)
    state[~between(middle, orbit["time"], BRIDGED_S)] = np.nan
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
    """Means (b, m) of samples (n, m) over bins without spikes, NaN where empty, and numbers (b, m) of samples used.

    A spike is SPIKE standard deviations of the noise away, or of the motion within a bin if that is larger.
    """
    pairs = np.diff(values[: values.shape[0] // 2 * 2].reshape(-1, 2, values.shape[1])[::7], axis=1)
    noise = 1.4826 * np.nanmedian(np.abs(pairs), axis=(0, 1)) / np.sqrt(2)
    half = max(int(time.size * np.median(np.diff(edges)) / (time[-1] - time[0]) / 2), 1) if time.size > 1 else 1
    change = np.nanmedian(np.abs(values[half::7] - values[:-half:7]), axis=0)
    limit = SPIKE * np.maximum(np.nan_to_num(np.maximum(noise, change)), 1e-300)
    number, bounds = np.zeros((edges.size - 1, values.shape[1])), np.searchsorted(time, edges - 1e-6)
    mean, index = np.full(number.shape, np.nan), np.repeat(np.arange(edges.size - 1), np.diff(bounds))
    for c, column in enumerate(values[bounds[0] : bounds[-1]].T):
        known = np.isfinite(column)
        bins, samples = index[known], column[known]
        number[:, c] = np.bincount(bins, minlength=len(number))
        mean[:, c] = np.bincount(bins, samples, len(number)) / np.where(number[:, c] > 0, number[:, c], np.nan)
        for b in np.unique(bins[np.abs(samples - mean[bins, c]) > limit[c]]):
            bin_samples = samples[slice(*np.searchsorted(bins, [b, b + 1]))]
            distance = bin_samples - np.median(bin_samples)  # a spike does not move it
            near = np.abs(distance) <= limit[c]
            mean[b, c] = np.median(bin_samples) + distance[near].sum() / max(near.sum(), 1)
            number[b, c] = near.sum() or bin_samples.size
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
    turn = np.pad(turn, ((1, 1), (0, 0)), mode="edge")
    return (turn[1:] + turn[:-1]) / 2


def detect(
    *attitudes: Callable, swing_rate_dot_rad_s2: float, swing_minimum_s: float, roll_rate_rad_s: float, segment_s: float
) -> xr.Dataset:
    """Product of the times of swings and rolls about y, from readers of {"time", "quaternion"} of one day each."""
    parts = [_motion(read()) for read in attitudes]
    time, rate_dot_rms, rate = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(time)
    time, rate_dot_rms, rate = time[order], rate_dot_rms[order], rate[order]
    swings = _spans(time, rate_dot_rms > swing_rate_dot_rad_s2, swing_minimum_s) + [EARLY, -EARLY]
    rolls = _spans(time, np.abs(rate[:, 1]) > roll_rate_rad_s, segment_s)
    every = slice(None, None, int(SHOWN / STEP))
    values = {
        "time": time[every],
        "rate_b": rate[every],
        "swing_start": swings[:, 0],
        "swing_stop": swings[:, 1],
        "roll_start": rolls[:, 0],
        "roll_stop": rolls[:, 1],
    }
    return build(SCHEMAS["detect"], values)


def _motion(attitude):
    """Epochs (n,) s, largest running rms (n,) rad s-2 of angular acceleration, mean rate (n, 3) rad s-1 of one day."""
    time = attitude["time"]
    edges = STEP * np.arange(np.floor(time[0] / STEP), np.ceil(time[-1] / STEP) + 1)
    rate = rates(mean_attitude(time, attitude["quaternion"], edges), STEP)
    rate = repaired(edges[:-1], np.where(np.isfinite(rate).any(), rate, 0.0), np.isnan(rate))
    rate_dot = np.zeros_like(rate)
    rate_dot[2:-2] = (rate[4:] - rate[:-4]) / (4 * STEP)
    square, mean = (
        uniform_filter1d(values, min(int(span / STEP), len(rate)), axis=0, mode="nearest")
        for values, span in ((rate_dot**2, WINDOW), (rate, SHOWN))
    )
    return (edges[1:] + edges[:-1]) / 2, np.sqrt(square.max(axis=1)), mean


def _spans(time, inside, shortest):
    """Begin and end (k, 2) s of runs of `inside` (n,) at least `shortest` s long; a step of over 60 s ends one."""
    breaks = np.flatnonzero(np.diff(time) > 60.0) + 1
    spans = []
    for part in np.split(np.arange(time.size), breaks):
        begin, end = runs(inside[part])
        spans += [(time[part[a]], time[part[b - 1]]) for a, b in zip(begin, end, strict=True)]
    return np.array([one for one in spans if one[1] - one[0] >= shortest], dtype=float).reshape(-1, 2)


def align(
    detected: xr.Dataset, sensor: Callable, tracker: Callable, orbit: Callable, *, margin_s, spike_sigma, gap_limit_s
) -> xr.Dataset:
    """Product "inertial_sensor.align" of the first swing: even voltages without spikes and gaps, attitude, position.

    Sensor, tracker and orbit are functions (start, stop) -> records between two epochs. An EstimationError for a longer
    gap than gap_limit_s, or a record that does not reach over the swing.
    """
    start, stop = float(detected.swing_start[0]), float(detected.swing_stop[0])
    volts, attitude, path = (read(start - margin_s, stop + margin_s) for read in (sensor, tracker, orbit))
    where = f"swing from {start:.0f} to {stop:.0f} s"
    for name, record in (("voltages", volts), ("attitudes", attitude), ("positions", path)):
        if record["time"].size < 2 or record["time"][0] > start or record["time"][-1] < stop:
            remedy = "Check the time tags of the files, or give the missing ones."
            refuse(where, f"{name} that do not reach over it", "them all the time", remedy, EstimationError)
    first = max(start - margin_s, volts["time"][0], path["time"][0])
    last = min(stop + margin_s, volts["time"][-1], path["time"][-1])
    time = SENSOR_STEP * np.arange(np.ceil(first / SENSOR_STEP), np.floor(last / SENSOR_STEP) + 1)
    recorded = on_grid(volts["time"], volts["volts"], time)
    missing = ~np.isfinite(recorded)
    begin, end = runs(missing.any(axis=1) & (time >= start - 5) & (time <= stop + 5))
    longest = float((end - begin).max(initial=0)) * SENSOR_STEP
    if longest > gap_limit_s:
        gap, remedy = f"a gap of {longest:.1f} s in the voltages", "Use another swing, or raise gap_limit_s."
        expected = f"at most {gap_limit_s:.1f} s, for they are integrated twice"
        refuse(where, gap, expected, remedy, EstimationError, gap_s=longest)
    spike = spikes(repaired(time, recorded, missing), 5, spike_sigma) & ~missing
    used = (attitude["time"] >= time[0]) & (attitude["time"] <= time[-1])
    used &= np.linalg.norm(attitude["quaternion"], axis=1) > 0.5
    values = {
        "time": time,
        "volts": repaired(time, recorded, missing | spike),
        "recorded": recorded,
        "flag": np.where(missing, 2, spike.astype(int)),
        "time_att": attitude["time"][used],
        "quaternion": attitude["quaternion"][used],
        "position_i": lines_between(time, path["time"], path["position"]),
        "start": start,
        "stop": stop,
    }
    return build(SCHEMAS["align"], values)


def late(aligned: xr.Dataset) -> int:
    """Whole seconds by which tags of the attitude are late against the voltages of a swing, 0 where no lag stands out.

    By the cross-correlation of angular acceleration and angular readouts of "inertial_sensor.align".
    """
    time = aligned["time"].values
    edges = np.arange(np.ceil(time[0]), np.floor(time[-1]) + 1)
    volt, _ = bin_means(time, electrodes.readouts(aligned["volts"].values)[:, 3:], edges)
    attitude = mean_attitude(aligned["time_att"].values, aligned["quaternion"].values, edges)
    series = np.gradient(rates(attitude, 1.0), axis=0), volt
    rate_dot, readout = (np.nan_to_num(one - np.nanmean(one, axis=0)) for one in series)
    frequency = np.fft.rfftfreq(2 * len(readout), 1.0)
    weight = ((frequency > TURNING_HZ[0]) & (frequency < TURNING_HZ[1]))[:, None]
    spectra = (np.fft.rfft(one, 2 * len(readout), axis=0) for one in (rate_dot, readout))
    return timing.lag(*spectra, min(APART_S, len(readout) - 1), NEAR_S, weight)


def on_grid(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Values (n, m) on an even grid (g,) by straight lines, NaN where the record has a gap."""
    step = grid[1] - grid[0]
    out = lines_between(grid, time, values)
    after = np.clip(np.searchsorted(time, grid - 1e-6), 1, time.size - 1)
    near = np.minimum(np.abs(time[after] - grid), np.abs(time[after - 1] - grid))
    out[(time[after] - time[after - 1] > 1.5 * step) & (near > 0.05 * step)] = np.nan
    return out


def segment(detected: xr.Dataset, days: Sequence[Sequence[Callable]], *, step_s, workers) -> xr.Dataset:
    """Product "inertial_sensor.segment": bins of all rolls, as of `reduced`, day by day, not all in memory at once.

    The days are functions that read sensor, tracker and orbit of each, of which so many `workers` are held at a time.
    """
    spans = np.stack([detected.roll_start.values, detected.roll_stop.values], axis=1)
    with ThreadPoolExecutor(workers) as pool:
        parts = list(pool.map(lambda day: reduced(*(read() for read in day), step_s), days))
    parts.sort(key=lambda part: part["time"][0] if part["time"].size else np.inf)
    bins = {name: np.concatenate([part[name] for part in parts]) for name in SCHEMAS["segment"]}
    time = bins["time"][:, None]
    inside = np.any((time >= spans[:, 0]) & (time <= spans[:, 1]), axis=1)
    return build(SCHEMAS["segment"], {name: values[inside] for name, values in bins.items()})
