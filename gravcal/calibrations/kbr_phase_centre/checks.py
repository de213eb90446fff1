"""Checks of the records of a pair against each other, and of its phase centres."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations import checks
from gravcal.calibrations.align import STATE, in_windows, late_of_pair, usable
from gravcal.calibrations.checks import Check, at_least, at_most
from gravcal.calibrations.kbr_phase_centre import align, model
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES
from gravcal.physics import constants, frames

BRIDGED = 1800.0  # s, stretches of ranging at least this long are held against the orbit with a bias of their own
NEAR = 300.0  # s on either side of a manoeuvre that do not count as routine pointing


def of_inputs(
    aligned: xr.Dataset,
    pointed: xr.Dataset,
    ranges: xr.Dataset,
    rates: xr.Dataset,
    *orbits: xr.Dataset,
    nominal_m,
    **limits: float,
) -> xr.Dataset:
    """Checks of orbits, attitudes and ranging against each other.

    Ranges and rates are "kbr_phase_centre.observable" of range and range rate; orbits are files of both satellites, of
    every product, those not used included; nominal_m (2, 3) m are the phase centres of the catalogue.
    """
    nominal = np.asarray(nominal_m, dtype=float).reshape(2, 3)
    height = np.linalg.norm(aligned["position_i"].values, axis=-1) - constants.EARTH_RADIUS
    separation = pointed["range_com"].values
    tests = []  # positions against velocities of every file, and the products of a satellite against each other
    for letter in sorted({one.attrs["satellite"] for one in orbits}):
        own = [one for one in orbits if one.attrs["satellite"] == letter]
        off = max(checks.velocity_error(t, s[:, :3], s[:, 3:]) for t, s in (usable(one, STATE) for one in own))
        tests.append(at_most(f"orbit {letter}, position against velocity", off, limits["velocity_limit_m_s"], "m s-1"))
        names = list(dict.fromkeys(one.attrs["product"] for one in own))
        if len(names) > 1:
            states = [[align.states(one) for one in own if one.attrs["product"] == name] for name in names]
            difference, name = orbit_difference(*states), f"orbit {letter}, {' against '.join(names)}"
            tests.append(at_most(name, difference, limits["orbit_difference_limit_m"], "m"))
    tests += [
        at_least("separation, smallest", 1e-3 * np.nanmin(separation), limits["separation_minimum_km"], "km"),
        at_most("separation, largest", 1e-3 * np.nanmax(separation), limits["separation_maximum_km"], "km"),
        at_least("height, smallest", 1e-3 * np.nanmin(height), limits["height_minimum_km"], "km"),
        at_most("height, largest", 1e-3 * np.nanmax(height), limits["height_maximum_km"], "km"),
    ]
    tags = [f"{one} {letter}" for one in ("star camera", "orbit") for letter in pointed.attrs["satellites"]]
    late = zip(["ranging", *tags], np.abs(late_of_pair(aligned, pointed)), strict=True)
    tests += [at_most(f"tags of {name}, late", size, limits["late_limit_s"], "s") for name, size in late]
    tests += _of_pointing(aligned, pointed, limits) + _of_ranging(ranges, rates, nominal, limits)
    correction = aligned["antenna_correction"].values
    if np.nanmax(np.abs(correction), initial=0.0) > 0.1:  # m: the file holds one, not zeros
        second = np.clip(np.rint(aligned["time_kbr"].values - pointed["time"].values[0]), 0, pointed.sizes["time"] - 1)
        own = model.antenna_correction(pointed["line_of_sight_b"].values[:, second.astype(int)], nominal)
        misfit = float(np.nanmedian(np.abs(correction - own)))
        tests.append(at_most("antenna correction of the file", 1e3 * misfit, limits["correction_limit_mm"], "mm"))
    return checks.product(tests)


def orbit_difference(first, second) -> float:
    """Largest distance (m) of two orbits at their common epochs, infinite where they share none.

    Each is a list of time (n,) s and inertial position (n, 3) m, one for each file.
    """
    times, positions = [[np.concatenate([one[k] for one in files]) for files in (first, second)] for k in (0, 1)]
    _, a, b = np.intersect1d(*(np.round(time, 3) for time in times), return_indices=True)
    return float(np.linalg.norm(positions[0][a] - positions[1][b], axis=1).max()) if a.size else np.inf


def _of_pointing(aligned, pointed, limits):
    """Checks that both satellites look at each other with z down, and turn from second to second below the limit."""
    time, angle = pointed["time"].values, pointed["angle"].values
    routine = ~in_windows(time, np.stack([pointed["start"].values, pointed["stop"].values], axis=1), NEAR)
    tests = []
    for k, letter in enumerate(pointed.attrs["satellites"]):
        line = pointed["line_of_sight_b"].values[k]
        own = np.column_stack([angle[k], roll(aligned["position_i"].values[k], aligned["quaternion"].values[k], line)])
        off_axis = np.arccos(np.clip(line[:, 0], -1, 1))
        step = (own[1:] - own[:-1] + np.pi) % (2 * np.pi) - np.pi
        for name, values, limit, unit in (
            ("routine pointing", off_axis[routine], "pointing_limit_deg", "deg"),
            ("largest angle", off_axis, "largest_angle_deg", "deg"),
            ("roll", own[:, 2], "roll_limit_deg", "deg"),
            ("pointing rate", step, "pointing_rate_limit_deg_s", "deg s-1"),
        ):
            largest = np.degrees(np.nanmax(np.abs(values), initial=0.0))
            tests.append(at_most(f"{name} {letter}", largest, limits[limit], unit))
    return tests


def roll(position_i: np.ndarray, quaternion: np.ndarray, line_of_sight_b: np.ndarray) -> np.ndarray:
    """Roll angle (n,) rad about the line of sight between z of the body and down, NaN where unknown."""
    result = np.full(len(position_i), np.nan)
    known = np.isfinite(quaternion).all(axis=1) & np.isfinite(position_i).all(axis=1)
    down = np.matvec(frames.R_bi_from_quaternion(quaternion[known]), -position_i[known])
    line = line_of_sight_b[known]
    down = down - line * np.einsum("ni,ni->n", down, line)[:, None]
    result[known] = np.arctan2(-down[:, 1], down[:, 2])
    return result


def _of_ranging(ranges, rates, nominal, limits):
    """Checks of ranging against orbits, less catalogued phase centres (2, 3) m and a bias for each segment."""
    time, segment = ranges["time_kbr"].values, ranges["segment"].values
    residual = ranges["observed"].values - ranges["column"].values @ nominal.ravel()
    kept = np.zeros(residual.size, dtype=bool)
    for number in np.unique(segment):
        inside = segment == number
        if np.ptp(time[inside]) >= BRIDGED:
            residual[inside] -= np.median(residual[inside])
            kept |= inside
    rate = rates["observed"].values - rates["column"].values @ nominal.ravel()
    rms = lambda values: np.sqrt(np.mean(values**2)) if values.size else np.inf  # noqa: E731
    largest = np.abs(rate).max(initial=0.0) if rate.size else np.inf
    return [
        at_most("range against orbits, rms", 1e3 * rms(residual[kept]), limits["range_limit_mm"], "mm"),
        at_most("range rate against orbits, rms", 1e6 * rms(rate), limits["range_rate_limit_um_s"], "um s-1"),
        at_most("range rate against orbits, largest", 1e6 * largest, limits["range_rate_largest_um_s"], "um s-1"),
        at_least("ranging in long stretches", kept.mean() if kept.size else 0.0, limits["ranging_minimum"], "1"),
    ]


def of_result(
    combined: xr.Dataset, probabilities: Mapping[str, float | None], nominal_m, limits: Mapping
) -> list[Check]:
    """Checks of the phase centres: fit, wiggles, observables, robust weights, size; none where none is determined.

    The probabilities are that the wiggles agree, by observable, None with too few of them; nominal_m (2, 3) m.
    """
    row = OBSERVABLES.index(combined.attrs["adopted_observable"])
    column = ESTIMATORS.index(combined.attrs["adopted_estimator"])
    determined = combined["determined"].values[row, 0] != 0
    if not determined.any():
        return []
    centre, covariance = combined["centre"].values[:, 0], combined["covariance"].values[:, 0]
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    name = f"noise over noise assumed, {OBSERVABLES[row]}"  # of what is delivered; the others only have to agree
    tests = [at_most(name, combined["sigma0"].values[row, 0, 0], limits["sigma0_limit"], "1")]
    tests += [
        at_least(f"probability that wiggles agree, {name}", p, limits["agreement_limit"], "1")
        for name, p in probabilities.items()
        if p is not None
    ]
    deviation = (np.abs(centre - centre[row, column]) / np.maximum(sigma, sigma[row, column]))[..., determined]
    tests.append(at_most("observables apart", deviation[:, column].max(), limits["observables_limit"], "sigma"))
    tests.append(at_most("robust apart from ls", deviation[row].max(), limits["robust_limit"], "sigma"))
    distance = 1e3 * (np.abs(centre[row, column] - np.ravel(nominal_m)) - 3 * sigma[row, column])
    for k, letter in enumerate(combined.attrs["satellites"]):
        for axes, place, limit in (("x", [0], "plausible_x_mm"), ("y and z", [1, 2], "plausible_yz_mm")):
            own = [distance[3 * k + i] for i in place if determined[3 * k + i]]
            name = f"{axes} of {letter} from the catalogue, less 3 sigma"
            tests += [at_most(name, max([*own, 0.0]), limits[limit], "mm")] * bool(own)
    return tests
