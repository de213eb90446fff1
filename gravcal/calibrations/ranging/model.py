"""Routine pointing of a pair: range minus orbit in means of a minute, blocks of a revolution, phase centres.

Each block has its own bias and slow orbit error; the noise of one half of the day is measured in the other. Routine
pointing turns the line of sight by milliradians: y and z move the range by micrometres of millimetres of orbit error,
and x by the square of that, so that x is not determined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import checks, named_parameters
from gravcal.calibrations.building import build
from gravcal.calibrations.ranging.schemas import ALIGN, ESTIMATE
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.physics import orbit_environment

MEAN_S = 60.0  # the length of the filter of the ranging
LEAST = 7  # readings of a minute
NAMES = tuple(f"{axis}_{letter}" for letter in "ab" for axis in "xyz")
REVOLUTION_SHARE = 60  # of the day's positions between two that span the plane of the orbit


def align(aligned: xr.Dataset, equations: xr.Dataset) -> xr.Dataset:
    """Means of a minute of quiet ranging minus orbit, and what effects of the ranging look at.

    Parameters
    ----------
    aligned : Dataset, "kbr_phase_centre.align"
    equations : Dataset, "kbr_phase_centre.observable" of the range

    Returns
    -------
    minutes : Dataset, "ranging.align"
    """
    quiet = equations["arc"].values == -1
    at, segment = equations["time_kbr"].values[quiet], equations["segment"].values[quiet]
    all_at, distance = aligned["time_kbr"].values, aligned["reading_range"].values
    rate, known = np.gradient(distance, all_at), np.isin(all_at, at)
    if at.size < 2:
        raise EstimationError(f"{equations.attrs['ranging']}: found no routine pointing. Give a day with orbits.")
    _, index, count = np.unique(
        (np.floor((at - at[0]) / MEAN_S) * 8 + segment).astype(int), return_inverse=True, return_counts=True
    )

    def mean(values):
        return (np.bincount(index, values - values[0]) / count + values[0])[count >= LEAST]

    time = mean(at)
    position = aligned["position_i"].values[0]
    kept = np.isfinite(position).all(axis=1)
    orbit, position = aligned["time"].values[kept][::10], position[kept][::10]
    normal = np.cross(position[0], position[len(position) // REVOLUTION_SHARE])
    argument = np.unwrap(orbit_environment.argument_of_latitude(position, normal))
    values = {
        "time": time,
        "observed": mean(equations["observed"].values[quiet]),
        "column": np.stack([mean(column) for column in equations["column"].values[quiet].T], axis=1),
        "segment": np.rint(mean(segment.astype(float))),
        "range": mean(distance[known]),
        "range_rate": mean(rate[known]),
        "argument": np.interp(time, orbit, argument),
        "warmth": orbit_environment.warmth(time, orbit, position),
    }
    return build(ALIGN, values, satellites=equations.attrs["satellites"], ranging=equations.attrs["ranging"])


@dataclass(frozen=True)
class Block:
    """One revolution without a change of bias."""

    #: rows, place: (n,) int, places in the minutes, and on the even grid of the block
    rows: np.ndarray
    place: np.ndarray
    slow: np.ndarray  #: (n, k) columns of bias and slow orbit error
    noise: NoiseModel  #: of the other half of the day

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, q) m, whitened, on the even grid (m, q); zero where there is no minute."""
        grid, valid = np.zeros((self.place[-1] + 1, columns.shape[1])), np.zeros(self.place[-1] + 1, dtype=bool)
        grid[self.place], valid[self.place] = columns, True
        return whiten(self.noise, grid, valid)


def blocks(minutes: xr.Dataset, *, range_block_s: float, range_degree: int, noise_order: int) -> list[Block]:
    """Blocks of a day, each at least half full.

    Parameters
    ----------
    minutes : Dataset, "ranging.align"
    range_block_s : s, length of a block
    range_degree : of the polynomial of a block
    noise_order : coefficients of the noise model
    """
    time, segment, observed = (minutes[name].values for name in ("time", "segment", "observed"))
    number = np.floor((time - time[0]) / range_block_s).astype(int) * 8 + segment
    parts = [np.flatnonzero(number == one) for one in np.unique(number)]
    parts = [part for part in parts if part.size * MEAN_S > range_block_s / 2]
    if len(parts) < 2:
        raise EstimationError(
            f"{minutes.attrs['ranging']}: found {len(parts)} blocks of {range_block_s:.0f} s that are at least half "
            f"full, expected two or more, so that the noise of one can be measured in others. Give a longer record."
        )
    places = [np.rint((time[part] - time[part[0]]) / MEAN_S).astype(int) for part in parts]
    slow = [least_squares.polynomial(time[part], range_degree, time[part[0]], time[part[-1]]) for part in parts]
    series = []
    for part, place, columns in zip(parts, places, slow, strict=True):
        series.append(np.full(place[-1] + 1, np.nan))
        series[-1][place] = least_squares.without(columns, observed[part])
    middle, made = len(parts) // 2, []
    for half, others in ((slice(middle), series[middle:]), (slice(middle, None), series[:middle])):
        noise = fit_noise(others, noise_order, MEAN_S, len(others) * (range_degree + 1))
        rows = zip(parts[half], places[half], slow[half], strict=True)
        made += [Block(part, place, columns, noise) for part, place, columns in rows]
    return made


def estimate(
    minutes: xr.Dataset, *, range_block_s: float, range_degree: int, noise_order: int, determined_limit_mm: float
) -> xr.Dataset:
    """Phase centres from routine pointing, bias and slow orbit error of every block free.

    Parameters
    ----------
    minutes : Dataset, "ranging.align"
    range_block_s, range_degree, noise_order : as of `blocks`
    determined_limit_mm : mm, a component with a larger sigma is not determined

    Returns
    -------
    found : Dataset, "ranging.estimate"

    Notes
    -----
    rho_KBR - rho_COM = b - l_A . c_A - l_B . c_B; Remote Sens. 2022, 14, 3395, eq. 13 (erratum K-1).
    """
    parts = blocks(minutes, range_block_s=range_block_s, range_degree=range_degree, noise_order=noise_order)
    observed, column = minutes["observed"].values, 1e-3 * minutes["column"].values  # of phase centres in mm
    information, right, residual = [], [], []
    for part in parts:
        data = np.column_stack([observed[part.rows] - observed[part.rows].mean(), column[part.rows]])
        white = least_squares.without(part.white(part.slow), part.white(data))
        information.append(white[:, 1:].T @ white[:, 1:])
        right.append(white[:, 1:].T @ white[:, 0])
        residual.append(least_squares.without(part.slow, data))
    limit, starts = np.full(6, determined_limit_mm), [minutes["time"].values[part.rows[0]] for part in parts]
    found = named_parameters.estimated(NAMES, ["mm"] * 6, limit, np.stack(information), np.stack(right), starts)
    series = np.concatenate(residual)
    fitted = series[:, 1:] @ np.nan_to_num(found["value"])
    time = minutes["time"].values[np.concatenate([part.rows for part in parts])]
    return build(ESTIMATE, found | {"time": time, "residual": series[:, 0], "fitted": fitted})


def check(pair: xr.Dataset, found: xr.Dataset, *, agreement_limit: float) -> xr.Dataset:
    """Checks of the inputs against each other and of the result.

    Parameters
    ----------
    pair : Dataset, "kbr_phase_centre.checks"
    found : Dataset, "ranging.estimate"
    agreement_limit : smallest probability of the disagreement of the parts
    """
    return checks.product([*checks.of_product(pair), *named_parameters.checks(found, agreement_limit)])
