"""Manoeuvres: square waves in the sampled torquer currents, and the axis that each of them turns."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.align import own_tags, sorted_samples
from gravcal.calibrations.building import build

SCHEMAS = schemas.of("com_offset.toml")


@dataclass(frozen=True)
class Wave:
    """One square wave of one rod."""

    rod: int  #: 0, 1, 2 for x, y, z
    #: lower, upper: (m + 1,) s, last sample before and first sample after each edge
    lower: np.ndarray
    upper: np.ndarray
    level: np.ndarray  #: (m,) mA, mean current of each half period


def plateaus(time: np.ndarray, current: np.ndarray, threshold: float, longest_step: float) -> list[tuple]:
    """Runs of samples of one sign beyond the threshold (mA): (first index, last index, mean mA).

    A jump of more than half of the size ends a run: a control current of the same sign that follows the wave at once is
    not part of its last half period. So does a step between samples longer than `longest_step` (s).
    """
    size = np.abs(np.nan_to_num(current))
    sign = np.where(size > threshold, np.sign(np.nan_to_num(current)), 0)
    jump = np.abs(np.diff(size)) > np.maximum(size[1:], size[:-1]) / 2
    change = (np.diff(sign) != 0) | (np.diff(time) > longest_step) | jump
    first = np.concatenate([[0], np.flatnonzero(change) + 1])
    last = np.concatenate([np.flatnonzero(change), [sign.size - 1]])
    return [(a, b, float(current[a : b + 1].mean())) for a, b in zip(first, last, strict=True) if sign[a] != 0]


def find_waves(time: np.ndarray, current: np.ndarray, rod: int, settings: dict) -> list[Wave]:
    """Square waves of one rod.

    Neighbouring runs belong to one wave if their signs alternate, their sizes agree within 30 % and their lengths are
    half a period within the tolerance and the sampling.

    Parameters
    ----------
    time : (n,) s, increasing
    current : (n,) mA
    rod : 0, 1, 2
    settings : period_s, period_tolerance_s, minimum_half_periods, current_threshold_ma
    """
    if time.size < 3:
        return []
    step = float(np.median(np.diff(time)))
    half = settings["period_s"] / 2
    slack = settings["period_tolerance_s"] + step
    waves, group = [], []
    for run in plateaus(time, current, settings["current_threshold_ma"], 3 * step):
        length = time[run[1]] - time[run[0]] + step
        fits = abs(length - half) <= slack
        follows = (
            bool(group)
            and group[-1][2] * run[2] < 0
            and abs(abs(run[2]) - abs(group[-1][2])) < 0.3 * abs(group[-1][2])
            and abs(time[run[0]] - time[group[-1][0]] - half) <= slack
        )
        if not (fits and follows):
            waves.append(group)
            group = []
        group = [*group, run] if fits else []
    waves.append(group)
    return [_wave(time, rod, g, step) for g in waves if len(g) >= settings["minimum_half_periods"]]


def _wave(time, rod, group, step):
    """Edges of a group of runs: between the last sample of one and the first of the next."""
    first = np.array([run[0] for run in group])
    last = np.array([run[1] for run in group])
    before = np.append(np.maximum(first - 1, 0), last[-1])
    after = np.append(first, np.minimum(last[-1] + 1, time.size - 1))
    before[1:-1] = last[:-1]
    lower, upper = time[before].astype(float), time[after].astype(float)
    at_end = before == after  # the data begin or end with the wave
    lower = np.where(at_end & (np.arange(lower.size) == 0), lower - step, lower)
    upper = np.where(at_end & (np.arange(upper.size) > 0), upper + step, upper)
    lower[0] = max(lower[0], upper[0] - 3 * step)
    upper[-1] = min(upper[-1], lower[-1] + 3 * step)
    return Wave(rod, lower, upper, np.array([run[2] for run in group]))


def regular_edges(wave: Wave, period: float) -> tuple[float, float] | None:
    """Interval of the first edge if all edges are whole half periods apart."""
    shift = np.arange(wave.lower.size) * period / 2
    lower, upper = float(np.max(wave.lower - shift)), float(np.min(wave.upper - shift))
    return (lower, upper) if upper - lower > 1e-4 else None


def detect(magnetometer: xr.Dataset, **settings: float) -> xr.Dataset:
    """Square waves of the torquers, one manoeuvre each.

    The kind is the body axis about which the current turns the satellite in the measured field, m x B.

    Parameters
    ----------
    magnetometer : Dataset, "ingest" of MAG1B
    settings : period_s, period_tolerance_s, minimum_half_periods, current_threshold_ma
    """
    names = [f"Mfv{a}_RAW" if f"Mfv{a}_RAW" in magnetometer else f"Mfv{a}" for a in "XYZ"]
    time, values, flag, _ = sorted_samples(magnetometer, own_tags(magnetometer), ("current_b", *names))
    time, current, field_b = time[flag == 0], values[flag == 0, :3], values[flag == 0, 3:]
    waves = [w for rod in range(3) for w in find_waves(time, current[:, rod], rod, settings)]
    kept: list[Wave] = []
    for wave in sorted(waves, key=lambda w: -np.mean(np.abs(w.level))):  # of those that overlap the strongest
        if all(wave.upper[-1] < other.lower[0] or wave.lower[0] > other.upper[-1] for other in kept):
            kept.append(wave)
    return _as_dataset(sorted(kept, key=lambda w: w.lower[0]), time, field_b, settings["period_s"])


def _kind(wave: Wave, time, field_b) -> int:
    """Axis of the largest torque m x B over the wave."""
    inside = (time >= wave.lower[0]) & (time <= wave.upper[-1])
    dipole = np.zeros(3)
    dipole[wave.rod] = 1.0
    return int(np.argmax(np.sum(np.cross(dipole, field_b[inside]) ** 2, axis=0)))


def _as_dataset(waves, time, field_b, period):
    count = max((w.level.size for w in waves), default=0)
    filled = lambda values, size: np.append(values, np.full(size - values.size, np.nan))  # noqa: E731
    values = {
        "edge_lower": np.array([filled(w.lower, count + 1) for w in waves]).reshape(-1, count + 1),
        "edge_upper": np.array([filled(w.upper, count + 1) for w in waves]).reshape(-1, count + 1),
        "level": np.array([filled(w.level, count) for w in waves]).reshape(len(waves), count),
        "regular": [regular_edges(w, period) is not None for w in waves],
        "start": [(w.lower[0] + w.upper[0]) / 2 for w in waves],
        "stop": [(w.lower[-1] + w.upper[-1]) / 2 for w in waves],
        "kind": [_kind(w, time, field_b) for w in waves],
        "rod": [w.rod for w in waves],
        "record_start": time[0] if time.size else np.nan,
        "record_stop": time[-1] if time.size else np.nan,
    }
    return build(SCHEMAS["detect"], values, title="Manoeuvres found in the torquer currents")
