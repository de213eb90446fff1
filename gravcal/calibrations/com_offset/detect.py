"""Manoeuvres found in the torquer currents, and what each of them turns."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.align import sorted_samples
from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import DETECT
from gravcal.calibrations.com_offset.waves import Wave, find_waves, regular_edges
from gravcal.estimation.timing import normalised

KINDS = ("roll", "pitch", "yaw")


def detect(
    magnetometer: xr.Dataset,
    *,
    period_s: float,
    period_tolerance_s: float,
    minimum_half_periods: int,
    current_threshold_ma: float,
) -> xr.Dataset:
    """Square waves of the torquers, one manoeuvre each.

    The kind is the body axis about which the current turns the satellite in the measured field, m x B.

    Parameters
    ----------
    magnetometer : Dataset, "ingest" of MAG1B
    period_s, period_tolerance_s : s
    minimum_half_periods : shortest wave
    current_threshold_ma : mA

    Returns
    -------
    manoeuvres : Dataset, "com_offset.detect"
    """
    settings = {
        "period_s": period_s,
        "period_tolerance_s": period_tolerance_s,
        "minimum_half_periods": minimum_half_periods,
        "current_threshold_ma": current_threshold_ma,
    }
    magnetometer = magnetometer.assign({f"current_{a}": magnetometer["current_b"][:, i] for i, a in enumerate("xyz")})
    names = [f"Mfv{a}_RAW" if f"Mfv{a}_RAW" in magnetometer else f"Mfv{a}" for a in "XYZ"]
    tags = normalised(magnetometer["time_second"].values, magnetometer["time_fraction"].values)
    time, values, flag, _ = sorted_samples(magnetometer, tags, (*(f"current_{a}" for a in "xyz"), *names))
    time, current, field_b = time[flag == 0], values[flag == 0, :3], values[flag == 0, 3:]
    waves = [w for rod in range(3) for w in find_waves(time, current[:, rod], rod, settings)]
    waves = sorted(_strongest(waves), key=lambda w: w.lower[0])
    return _as_dataset(waves, time, field_b, period_s)


def _strongest(waves: list[Wave]) -> list[Wave]:
    """Of waves that overlap in time the one with the largest current."""
    kept: list[Wave] = []
    for wave in sorted(waves, key=lambda w: -np.mean(np.abs(w.level))):
        if all(wave.upper[-1] < other.lower[0] or wave.lower[0] > other.upper[-1] for other in kept):
            kept.append(wave)
    return kept


def _kind(wave: Wave, time, field_b) -> int:
    """Axis of the largest torque m x B over the wave."""
    inside = (time >= wave.lower[0]) & (time <= wave.upper[-1])
    dipole = np.zeros(3)
    dipole[wave.rod] = 1.0
    return int(np.argmax(np.sum(np.cross(dipole, field_b[inside]) ** 2, axis=0)))


def _as_dataset(waves, time, field_b, period):
    count = max((w.level.size for w in waves), default=0)
    table = {name: np.full((len(waves), count + 1), np.nan) for name in ("edge_lower", "edge_upper")}
    level = np.full((len(waves), count), np.nan)
    regular = np.zeros(len(waves), dtype=np.int8)
    for i, wave in enumerate(waves):
        table["edge_lower"][i, : wave.lower.size] = wave.lower
        table["edge_upper"][i, : wave.upper.size] = wave.upper
        level[i, : wave.level.size] = wave.level
        regular[i] = regular_edges(wave, period) is not None
    values = table | {
        "start": [(w.lower[0] + w.upper[0]) / 2 for w in waves],
        "stop": [(w.lower[-1] + w.upper[-1]) / 2 for w in waves],
        "kind": [_kind(w, time, field_b) for w in waves],
        "rod": [w.rod for w in waves],
        "level": level,
        "regular": regular,
        "record_start": time[0] if time.size else np.nan,
        "record_stop": time[-1] if time.size else np.nan,
    }
    return build(DETECT, values, title="Manoeuvres found in the torquer currents")
