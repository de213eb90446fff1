"""What a calibration works on: swings and rolls found in the attitude, the record round a swing, the bins of a roll."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import bins
from gravcal.errors import EstimationError
from gravcal.estimation.noise import runs

SCHEMAS = schemas.of("inertial_sensor.toml")

STEP = 2.0  # s, of the attitude looked at
SHOWN = 60.0  # s, of the rates kept
WINDOW = 28.0  # s, of the running rms, about one period of a swing
EARLY = 8.0  # s, by which a running rms shows a swing before it begins
SENSOR_STEP = 0.1  # s


def detect(
    *attitudes: Callable, swing_rate_dot_rad_s2: float, swing_minimum_s: float, roll_rate_rad_s: float, segment_s: float
) -> xr.Dataset:
    """Times of swings and rolls about y.

    Parameters
    ----------
    attitudes : functions that read {"time", "quaternion"} of one day each
    swing_rate_dot_rad_s2 : rms angular acceleration over half a minute above which the satellite swings
    swing_minimum_s : s, shortest swing
    roll_rate_rad_s : mean rate about y above which the satellite rolls
    segment_s : s, shortest roll
    """
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
    """Epochs, running rms of the angular acceleration and running mean rate of one day."""
    from scipy.ndimage import uniform_filter1d

    time = attitude["time"]
    edges = STEP * np.arange(np.floor(time[0] / STEP), np.ceil(time[-1] / STEP) + 1)
    rate = bins.rates(bins.mean_attitude(time, attitude["quaternion"], edges), STEP)
    rate = bins.repaired(edges[:-1], np.where(np.isfinite(rate).any(), rate, 0.0), np.isnan(rate))
    rate_dot = np.zeros_like(rate)
    rate_dot[2:-2] = (rate[4:] - rate[:-4]) / (4 * STEP)
    square, mean = (
        uniform_filter1d(values, min(int(span / STEP), len(rate)), axis=0, mode="nearest")
        for values, span in ((rate_dot**2, WINDOW), (rate, SHOWN))
    )
    return (edges[1:] + edges[:-1]) / 2, np.sqrt(square.max(axis=1)), mean


def _spans(time, inside, shortest):
    """Begin and end of long enough spans (s, 2); a step of the epochs over a minute ends one."""
    breaks = np.flatnonzero(np.diff(time) > 60.0) + 1
    spans = []
    for part in np.split(np.arange(time.size), breaks):
        begin, end = runs(inside[part])
        spans += [(time[part[a]], time[part[b - 1]]) for a, b in zip(begin, end, strict=True)]
    long = [span for span in spans if span[1] - span[0] >= shortest]
    return np.array(long, dtype=float).reshape(-1, 2)


def align(
    detected: xr.Dataset, sensor: Callable, tracker: Callable, orbit: Callable, *, margin_s, spike_sigma, gap_limit_s
) -> xr.Dataset:
    """Everything about the first swing: voltages on an even grid without spikes and gaps, attitude, position.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    sensor, tracker, orbit : functions (start, stop) -> records between two epochs
    margin_s : s kept on either side, quiet data for the noise
    spike_sigma : standard deviations of a sample about the running median
    gap_limit_s : s, longest gap in the swing that is bridged

    Raises
    ------
    EstimationError : a longer gap, or a record that does not reach over the swing
    """
    start, stop = float(detected.swing_start[0]), float(detected.swing_stop[0])
    volts, attitude, path = (read(start - margin_s, stop + margin_s) for read in (sensor, tracker, orbit))
    for name, record in (("voltages", volts), ("attitudes", attitude), ("positions", path)):
        if record["time"].size < 2 or record["time"][0] > start or record["time"][-1] < stop:
            raise EstimationError(
                f"swing from {start:.0f} to {stop:.0f} s: found {name} that do not reach over it, "
                f"expected them all the time. Check the time tags of the files, or give the missing ones.",
                samples=int(record["time"].size),
            )
    first = max(start - margin_s, volts["time"][0], path["time"][0])
    last = min(stop + margin_s, volts["time"][-1], path["time"][-1])
    time = SENSOR_STEP * np.arange(np.ceil(first / SENSOR_STEP), np.floor(last / SENSOR_STEP) + 1)
    recorded = on_grid(volts["time"], volts["volts"], time)
    missing = ~np.isfinite(recorded)
    begin, end = runs(missing.any(axis=1) & (time >= start - 5) & (time <= stop + 5))
    longest = float((end - begin).max(initial=0)) * SENSOR_STEP
    if longest > gap_limit_s:
        raise EstimationError(
            f"swing from {start:.0f} to {stop:.0f} s: found a gap of {longest:.1f} s in the voltages, expected "
            f"at most {gap_limit_s:.1f} s, for they are integrated twice. Use another swing, or raise gap_limit_s.",
            gap_s=longest,
        )
    spike = bins.spikes(bins.repaired(time, recorded, missing), 5, spike_sigma) & ~missing
    used = (attitude["time"] >= time[0]) & (attitude["time"] <= time[-1])
    used &= np.isfinite(attitude["quaternion"]).all(axis=1)
    values = {
        "time": time,
        "volts": bins.repaired(time, recorded, missing | spike),
        "recorded": recorded,
        "flag": np.where(missing, 2, spike.astype(int)),
        "time_att": attitude["time"][used],
        "quaternion": attitude["quaternion"][used],
        "position_i": bins.lines_between(time, path["time"], path["position"]),
        "start": start,
        "stop": stop,
    }
    return build(SCHEMAS["align"], values)


def on_grid(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Values (n, m) on an even grid (g,) by straight lines, NaN where the record has a gap."""
    step = grid[1] - grid[0]
    out = bins.lines_between(grid, time, values)
    after = np.clip(np.searchsorted(time, grid - 1e-6), 1, time.size - 1)
    near = np.minimum(np.abs(time[after] - grid), np.abs(time[after - 1] - grid))
    out[(time[after] - time[after - 1] > 1.5 * step) & (near > 0.05 * step)] = np.nan
    return out


def segment(
    detected: xr.Dataset, days: Sequence[tuple[Callable, Callable, Callable]], *, step_s, workers
) -> xr.Dataset:
    """Bins of all rolls, day by day, never all of the record in memory.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    days : functions that read sensor, tracker and orbit of each day
    step_s : s, of the bins
    workers : days held in memory at a time
    """
    from concurrent.futures import ThreadPoolExecutor

    spans = np.stack([detected.roll_start.values, detected.roll_stop.values], axis=1)
    with ThreadPoolExecutor(workers) as pool:
        parts = list(pool.map(lambda day: bins.reduced(*(read() for read in day), step_s), days))
    parts.sort(key=lambda part: part["time"][0] if part["time"].size else np.inf)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in SCHEMAS["segment"]}
    time = whole["time"][:, None]
    inside = np.any((time >= spans[:, 0]) & (time <= spans[:, 1]), axis=1)
    return build(SCHEMAS["segment"], {name: values[inside] for name, values in whole.items()})
