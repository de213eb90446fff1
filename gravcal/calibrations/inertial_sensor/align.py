"""Record round a swing: voltages on an even grid without spikes and gaps, attitude, position."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.inertial_sensor import cleaning, schemas
from gravcal.errors import EstimationError

STEP = 0.1  # s, of the sensor


def align(
    detected: xr.Dataset, sensor: Callable, tracker: Callable, orbit: Callable, *, margin_s, spike_sigma, gap_limit_s
) -> xr.Dataset:
    """Everything about the first swing.

    Parameters
    ----------
    detected : Dataset, "inertial_sensor.detect"
    sensor, tracker, orbit : functions (start, stop) -> records between two epochs
    margin_s : s kept on either side, quiet data for the noise
    spike_sigma : standard deviations of a sample about the running median
    gap_limit_s : s, longest gap in the swing that is bridged

    Returns
    -------
    aligned : Dataset, "inertial_sensor.align"
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
    time = STEP * np.arange(np.ceil(first / STEP), np.floor(last / STEP) + 1)
    recorded = on_grid(volts["time"], volts["volts"], time)
    missing = ~np.isfinite(recorded)
    _check_gaps(time, missing.any(axis=1), (start, stop), gap_limit_s)
    bridged = cleaning.repaired(time, recorded, missing)
    spike = cleaning.spikes(bridged, 5, spike_sigma) & ~missing
    seen = (attitude["time"] >= time[0]) & (attitude["time"] <= time[-1])
    seen &= np.isfinite(attitude["quaternion"]).all(axis=1)
    position = [np.interp(time, path["time"], column) for column in path["position"].T]
    values = {
        "time": time,
        "volts": cleaning.repaired(time, recorded, missing | spike),
        "recorded": recorded,
        "flag": np.where(missing, 2, spike.astype(int)),
        "time_att": attitude["time"][seen],
        "quaternion": attitude["quaternion"][seen],
        "position_i": np.stack(position, axis=1),
        "start": start,
        "stop": stop,
    }
    return build(schemas.ALIGN, values)


def on_grid(time: np.ndarray, values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Values on an even grid by straight lines, NaN where the record has a gap.

    Parameters
    ----------
    time : (n,) s, increasing; values : (n, m); grid : (g,) s
    """
    step = grid[1] - grid[0]
    out = np.stack([np.interp(grid, time, column) for column in values.T], axis=1)
    after = np.clip(np.searchsorted(time, grid - 1e-6), 1, time.size - 1)
    near = np.minimum(np.abs(time[after] - grid), np.abs(time[after - 1] - grid))
    out[(time[after] - time[after - 1] > 1.5 * step) & (near > 0.05 * step)] = np.nan
    return out


def _check_gaps(time, missing, swing, limit):
    """No gap in the swing longer than may be bridged."""
    from gravcal.estimation.noise import runs

    inside = (time >= swing[0] - 5) & (time <= swing[1] + 5)
    begin, end = runs(missing & inside)
    longest = float((end - begin).max(initial=0)) * STEP
    if longest > limit:
        raise EstimationError(
            f"swing from {swing[0]:.0f} to {swing[1]:.0f} s: found a gap of {longest:.1f} s in the voltages, expected "
            f"at most {limit:.1f} s, for they are integrated twice. Use another swing, or raise gap_limit_s.",
            gap_s=longest,
        )
