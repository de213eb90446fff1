"""Observations of each manoeuvre: star camera, accelerometer samples, and the torques that act."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.align import SURVEY_S
from gravcal.calibrations.com_offset import motion
from gravcal.calibrations.com_offset.motion import Arc
from gravcal.physics import frames, gravity


@dataclass(frozen=True)
class Window:
    """Observations of one manoeuvre.

    Attributes
    ----------
    arc : Arc
    rod : excited torquer, -1 if none
    time : (n,) s, star-camera grid with the origin in front; quaternion : (n, 4); good : (n,) bool
    acc : slice of the accelerometer samples inside the arc
    lower, upper : s, interval of the first edge
    """

    arc: Arc
    rod: int
    time: np.ndarray
    quaternion: np.ndarray
    good: np.ndarray
    acc: slice
    lower: float
    upper: float


def windows(aligned: xr.Dataset, field: xr.Dataset, inertia, per_current, full: bool) -> list[Window]:
    """Observations and torques of every manoeuvre; no star camera where a gap forbids to use it.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    inertia : (3, 3) kg m2
    per_current : (3,) A m2 mA-1
    full : bool, with gravity-gradient torque
    """
    parts = _manoeuvres(aligned) or _survey(aligned)
    found = [_window(aligned, field, part, np.asarray(inertia), per_current, full) for part in parts]
    gap = aligned["gap"].values
    return [replace(w, good=w.good & (gap[i] == 0)) for i, w in enumerate(found)]


def _manoeuvres(aligned):
    """Rod, edges with their intervals and currents of every manoeuvre."""
    parts = []
    for i in range(aligned.sizes["manoeuvre"]):
        count = int(np.isfinite(aligned["edge_lower"].values[i]).sum())
        lower, upper = aligned["edge_lower"].values[i, :count], aligned["edge_upper"].values[i, :count]
        edges = _regular_edges(lower, upper) if aligned["regular"][i] else _single_edges(lower, upper, aligned)
        parts.append((int(aligned["rod"][i]), lower, upper, edges, aligned["level"].values[i, : count - 1]))
    return parts


def _survey(aligned):
    """One arc at the beginning of a record without manoeuvre, no rod excited."""
    start = float(aligned["window_start"][0])
    stop = min(start + SURVEY_S, float(aligned["time_sca"].values[-1]), float(aligned["time_orbit"].values[-1]))
    ends = np.array([start, stop])
    return [(-1, ends, ends, None, np.zeros(0))]


def _window(aligned, field, part, inertia, per_current, full):
    rod, lower, upper, edges, level = part
    origin, stop = float(lower[0]), float(upper[-1])
    mag_time = aligned["time_mag"].values
    near = (mag_time > origin - 2) & (mag_time < stop + 2)
    current = np.nan_to_num(aligned["current_b"].values[near])
    breaks, dipole = motion.dipole_history(edges, level, rod, mag_time[near], current, per_current)
    orbit_time = field["time_orbit"].values
    nodes = (orbit_time > origin - 6) & (orbit_time < stop + 6)
    gradient = gravity.gradient_i(field["position_i"].values[nodes]) if full else None
    arc = Arc(origin, stop, breaks, dipole, orbit_time[nodes], field["field_i"].values[nodes], gradient, inertia)
    ends = (float(lower[0] - edges[0]), float(upper[0] - edges[0])) if rod >= 0 else (0.0, 0.0)
    acc_time = aligned["time_acc"].values
    acc = slice(*np.searchsorted(acc_time, [origin + 0.1, stop - 0.1]))
    return Window(arc, rod, *_star_camera(aligned, origin, stop), acc, *ends)


def _regular_edges(lower, upper):
    """Edges in the middle of their common interval, whole half periods apart."""
    half = np.round(np.median(np.diff(lower)) * 2) / 2
    shift = half * np.arange(lower.size)
    return (np.max(lower - shift) + np.min(upper - shift)) / 2 + shift


def _single_edges(lower, upper, aligned):
    """Each edge of an irregular wave where the angular accelerometer sees it; mid interval where it sees nothing.

    With levels a before and b after, the integral over (s, e) is a (t - s) + b (e - t), which gives t.
    """
    time, angular = aligned["time_acc"].values, aligned["angular_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(angular).all(axis=1)
    time, angular = time[good], angular[good]
    edges = (lower + upper) / 2
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        before, after = (time > low - 2) & (time < low), (time > high) & (time < high + 2)
        inside = (time > low - 2) & (time < high + 2)
        if min(before.sum(), after.sum()) < 10 or np.any(np.diff(time[inside]) > 0.2):
            continue
        a, b = angular[before].mean(axis=0), angular[after].mean(axis=0)
        axis = int(np.argmax(np.abs(b - a)))
        step = np.diff(time[inside]).mean()
        start, stop = time[inside][0] - step / 2, time[inside][-1] + step / 2
        total = angular[inside, axis].sum() * step
        edge = (b[axis] * stop - a[axis] * start - total) / (b[axis] - a[axis]) if a[axis] != b[axis] else edges[k]
        edges[k] = np.clip(edge, low - 0.1, high + 0.1)
    return edges


def _star_camera(aligned, origin, stop):
    """Star-camera samples on their 1 Hz grid, wherever in the second it lies, the origin in front, gaps marked."""
    time, quaternion = aligned["time_sca"].values, aligned["quaternion"].values
    good = (aligned["sca_flag"].values == 0) & np.isfinite(quaternion).all(axis=1)
    inside = good & (time > origin) & (time < stop)
    if inside.sum() < 8:
        return np.array([origin]), np.zeros((1, 4)), np.zeros(1, dtype=bool)
    phase = float(np.median((time[inside] - np.floor(time[inside][0]) + 0.5) % 1.0)) - 0.5
    phase = 0.0 if abs(phase) < 1e-3 else phase
    grid = np.arange(np.ceil(origin - phase + 1e-6), stop - phase, 1.0) + phase
    index = np.clip(np.searchsorted(time, grid - 1e-6), 0, time.size - 1)
    present = inside[index] & (np.abs(time[index] - grid) < 1e-3)
    values = frames.continuous(np.where(present[:, None], quaternion[index], _first(quaternion[inside])))
    return (
        np.concatenate([[origin], grid]),
        np.concatenate([values[:1], values]),
        np.concatenate([[False], present]),
    )


def _first(quaternion):
    return quaternion[0]


def field_at(window: Window, fit, time: np.ndarray) -> np.ndarray:
    """Field in the body (n, 3) T along the fitted attitude."""
    from scipy.interpolate import CubicSpline

    at = np.clip(time, window.arc.origin, None)
    quaternion, _, _ = motion.evaluate(window.arc, fit.solution, at, 1.0)
    field_i = CubicSpline(window.arc.field_time, window.arc.field_i)(at)
    return np.matvec(frames.R_bi_from_quaternion(quaternion), field_i)
