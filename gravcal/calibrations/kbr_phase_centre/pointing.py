"""Pointing of both satellites and the wiggles in it."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.kbr_phase_centre import geometry
from gravcal.calibrations.kbr_phase_centre.schemas import POINTING

FOUND = ("satellite_index", "axis_index", "sign", "start", "stop", "offset", "amplitude")


def pointing(
    aligned: xr.Dataset, *, nominal_m, given, period_s: float, offset_limit_deg: float, amplitude_limit_deg: float
) -> xr.Dataset:
    """Observation geometry on whole seconds, and the sub-manoeuvres found in the pointing angles.

    Parameters
    ----------
    aligned : Dataset, "kbr_phase_centre.align"
    nominal_m : (2, 3) m, phase centres of the catalogue, for the part square in them
    given : (k, 5) satellite, axis, sign, start and stop of the catalogue's manoeuvres; empty: look for them
    period_s : s, of the wiggle
    offset_limit_deg : deg, smallest mean angle that has a sign
    amplitude_limit_deg : deg, smallest amplitude of a wiggle

    Returns
    -------
    pointed : Dataset, "kbr_phase_centre.pointing"
    """
    time, position, quaternion = (aligned[n].values for n in ("time", "position_i", "quaternion"))
    nominal = np.asarray(nominal_m, dtype=float).reshape(2, 3)
    line = geometry.lines_of_sight(position, quaternion)
    angle = geometry.angles(line)
    limits = (np.radians(offset_limit_deg), np.radians(amplitude_limit_deg))
    found = [described(time, angle, one, period_s) for one in given]
    for k, axis in () if found else ((0, 0), (0, 1), (1, 0), (1, 1)):
        found += wiggles(time, angle[k, :, axis], period_s, limits, (k, axis))
    found.sort(key=lambda w: w[3])
    columns = dict(zip(FOUND, np.array(found).reshape(-1, len(FOUND)).T, strict=True))
    values = columns | {
        "time": time,
        "range_com": geometry.distance(position),
        "second_order": geometry.second_order(position, quaternion, nominal),
        "line_of_sight_b": line,
        "angle": angle,
        "usable": np.isfinite(line).all(axis=(0, 2)),
    }
    kept = {n: aligned.attrs[n] for n in ("satellites", "ranging", "orbit")}
    return build(POINTING, values, title="Pointing against the line of sight, and the wiggles in it", **kept)


def described(time: np.ndarray, angle: np.ndarray, one, period: float) -> tuple:
    """A manoeuvre of the catalogue with its offset and amplitude as measured.

    Parameters
    ----------
    time : (n,) s
    angle : (2, n, 2) rad, pitch and yaw of both satellites
    one : satellite, axis, sign, start and stop
    period : s
    """
    satellite, axis, sign, start, stop = one
    own = angle[int(satellite), :, int(axis)]
    inside = (time > start + period / 2) & (time < stop - period / 2) & np.isfinite(own)
    if not inside.any():
        return (satellite, axis, sign, start, stop, np.nan, np.nan)
    wave = np.exp(-2j * np.pi * (time[inside] - start) / period)
    offset = float(own[inside].mean())
    return (satellite, axis, sign, start, stop, offset, float(2 * abs(np.mean((own[inside] - offset) * wave))))


def wiggles(time, angle, period, limits, which):
    """Sub-manoeuvres about one axis of one satellite.

    The angle is split over one period into its mean and its amplitude; where the amplitude stays above its limit there
    is a wiggle, and the slews are where the mean passes half its offset.

    Parameters
    ----------
    time : (n,) s, every second
    angle : (n,) rad, NaN where unknown
    period : s
    limits : rad and rad, smallest offset and amplitude
    which : satellite and axis

    Returns
    -------
    found : list of (satellite, axis, sign, start, stop, offset, amplitude)
    """
    if time.size < 3 * period:
        return []
    filled = (
        np.interp(time, time[np.isfinite(angle)], angle[np.isfinite(angle)]) if np.isfinite(angle).any() else 0 * time
    )
    count = int(round(period))
    phase = np.exp(-2j * np.pi * (time - time[0]) / period)
    mean, amplitude = _running(filled, count), 2 * np.abs(_running((filled - np.median(filled)) * phase, count))
    strong = np.concatenate([[False], amplitude > limits[1], [False]]).astype(int)
    edges = np.flatnonzero(np.diff(strong)).reshape(-1, 2)
    return [
        (*which, *_described(time, filled, (mean, amplitude), (begin, end - 1), limits))
        for begin, end in edges
        if end - begin > 2 * count
    ]


def _running(values, count):
    """Mean over one period centred on each sample, shorter at the ends."""
    total = np.concatenate([[0], np.cumsum(values)])
    index = np.arange(values.size)
    low, high = np.clip(index - count // 2, 0, None), np.clip(index + count - count // 2, None, values.size)
    return (total[high] - total[low]) / (high - low)


def _described(time, angle, smoothed, span, limits):
    """Sign of a wiggle, where its slews are, its offset and amplitude."""
    mean, amplitude = smoothed
    inside = slice(span[0] + (span[1] - span[0]) // 8, span[1] - (span[1] - span[0]) // 8)
    rest = np.median(
        np.concatenate([angle[max(span[0] - 1000, 0) : max(span[0] - 200, 1)], angle[span[1] + 200 : span[1] + 1000]])
    )
    offset, size = float(mean[inside].mean()), float(np.median(amplitude[inside]))
    sign = int(np.sign(offset)) if abs(offset) > limits[0] else 0
    start, stop = time[span[0]], time[span[1]]
    if sign:
        level = rest + (offset - sign * size - rest) / 2
        outside = sign * (angle - level) < 0
        middle = (span[0] + span[1]) // 2
        before, after = np.flatnonzero(outside[:middle]), np.flatnonzero(outside[middle:])
        start = time[before[-1] + 1] if before.size else time[0]
        stop = time[middle + after[0] - 1] if after.size else time[-1]
    return (sign, start, stop, offset, size)
