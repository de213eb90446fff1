"""Checks that a calibration makes of its own inputs and results: each is a number, its limit, and whether it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gravcal.calibrations import schemas

if TYPE_CHECKING:  # a plan looks at the schema alone
    import xarray as xr


@dataclass(frozen=True)
class Check:
    """Outcome of one check of a value against a limit."""

    name: str  #: quantity that is checked
    value: float
    limit: float  #: upper or lower, as of `at_most` and `at_least`
    unit: str  #: of both
    passed: bool


def at_most(name: str, value: float, limit: float, unit: str) -> Check:
    """Check that holds where a value is at most its limit; a value that is not finite fails."""
    return Check(name, float(value), float(limit), unit, bool(value <= limit))


def at_least(name: str, value: float, limit: float, unit: str) -> Check:
    """Check that holds where a value is at least its limit, such as the probability of a fit."""
    return Check(name, float(value), float(limit), unit, bool(value >= limit))


def largest(values: np.ndarray) -> float:
    """Largest of the finite values, NaN without one."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else np.nan


def product(checks: Sequence[Check]) -> xr.Dataset:
    """Product "checks", a Dataset with name, value, limit, unit and outcome of each check."""
    columns = {name: [getattr(check, name) for check in checks] for name in ("value", "limit", "unit", "passed")}
    return schemas.build(schemas.of("shared.toml")["checks"], {"check": [check.name for check in checks]} | columns)


def of_product(dataset: xr.Dataset) -> list[Check]:
    """Checks that a product "checks" holds, the inverse of `product`."""
    columns = (dataset[name].values.tolist() for name in ("check", "value", "limit", "unit", "passed"))
    return [Check(*row[:4], bool(row[4])) for row in zip(*columns, strict=True)]


def longest_constant(time: np.ndarray, values: np.ndarray, longest_step: float = np.inf) -> float:
    """Longest time (s) over which a column of values (n, m) at (n,) s is constant: frozen, zero or saturated.

    Missing values (NaN) are left out, a column of these alone gives inf; a step above `longest_step` (s) ends a run.
    """
    longest = 0.0
    for series in values.T:
        known = np.isfinite(series)
        epoch, reading = time[known], series[known]
        changed = (reading[1:] != reading[:-1]) | (np.diff(epoch) > longest_step)
        edge = np.flatnonzero(np.concatenate([[True], changed, [True]])) if epoch.size else []
        longest = max(longest, np.max(epoch[edge[1:] - 1] - epoch[edge[:-1]], initial=0.0) if epoch.size else np.inf)
    return float(longest)


def velocity_error(time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> float:
    """Largest error (m s-1) of velocities (n, 3) against the change of positions (n, 3) m in a step; inf if too few.

    Notes
    -----
    r_1 - r_0 = h (v_0 + v_1)/2 - h^2 (a_1 - a_0)/12, a from differences of v; rows that are not finite and steps over
    a gap are left out.
    """
    known = np.isfinite(position).all(axis=1) & np.isfinite(velocity).all(axis=1)
    time, position, velocity = time[known], position[known], velocity[known]
    if time.size < 3:
        return np.inf
    step = np.diff(time)
    change = np.diff(np.gradient(velocity, time, axis=0, edge_order=2), axis=0)
    error = np.diff(position, axis=0) / step[:, None] - (velocity[1:] + velocity[:-1]) / 2 + step[:, None] * change / 12
    return float(np.linalg.norm(error, axis=1)[step < 1.5 * np.median(step)].max())


def attitude_jump(time: np.ndarray, quaternion: np.ndarray) -> float:
    """Largest change (rad) between successive rotations of attitudes (n, 4) at (n,) s, zero norm and gaps left out."""
    from gravcal.physics import frames

    norm = np.linalg.norm(quaternion, axis=1)
    time, quaternion = time[norm > 0.5], quaternion[norm > 0.5] / norm[norm > 0.5, None]
    if time.size < 3:
        return np.inf
    turn, step = frames.attitude_error(quaternion[1:], quaternion[:-1]), np.diff(time)
    even = step < 1.5 * np.median(step)
    return float(np.linalg.norm(np.diff(turn, axis=0), axis=1).max(where=even[1:] & even[:-1], initial=0.0))
