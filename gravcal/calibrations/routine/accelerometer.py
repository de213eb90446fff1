"""Accelerometer of a routine day: readings by step, and their linear model of firings, torquers and rotation."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline
from scipy.ndimage import binary_dilation

from gravcal.calibrations import checks, named_parameters, schemas
from gravcal.calibrations.align import BRIDGED_S, QUATERNION, STATE, between, gps_tags, sorted_samples, usable
from gravcal.calibrations.causes import listed
from gravcal.calibrations.schemas import build
from gravcal.effects import Context, effect
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import chi2_tail, least_squares, timing
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.estimation.records import Candidate
from gravcal.physics import frames, magnetic

SCHEMAS = schemas.of("routine.toml")

LEAST = 40  # least number of steps with a reading
#: Thrusters k and k + 6 of THR1B fire together, without a net force if they are alike.
PAIRS = ("yaw_minus", "pitch_plus", "yaw_plus", "pitch_minus", "roll_minus", "roll_plus")
COMPONENTS = ("linear_x", "linear_y", "linear_z", "angular_x", "angular_y", "angular_z")
ITERATIONS = 5  # of noise and delay
CALMER = 5  # iterations of noise model and rejection of outliers
MAG_GAP_S = 30.0  # s, longest gap of MAG1B that currents are interpolated over
TOGETHER_S = 8.0  # s, samples beyond noise this close are one transient
LATEST_S = 5.0  # s, half of the range of delays of firings tried, about zero or about a lag that stands out
APART_S = 600  # s, longest lag that is tried
FORCE, TORQUE, DELAY = "unknown:thruster_force", "unknown:thruster_torque", "timing.thruster_delay"


def align(
    acc: xr.Dataset,
    camera: xr.Dataset,
    orbit: xr.Dataset,
    tim1b: xr.Dataset,
    clk1b: xr.Dataset,
    *others: xr.Dataset,
    inertia,
    dipole_per_current,
    position_b,
    force_b,
    step_s: float,
    clock_gap_limit_s: float,
    igrf_generation: int,
) -> xr.Dataset:
    """Product "routine.align": readings averaged over steps of step_s, torquers over the same steps, and firings.

    Given are "ingest" of ACC1A, SCA1B, GNV1B, TIM1B and CLK1B, others those of MAG1B and THR1B, as far as there are.
    Settings have inertia (3, 3), dipole_per_current (3,) A m2 mA-1, position_b and force_b (14, 3) as THR1B has them.
    """
    by_product = {one.attrs["product"]: one for one in others}
    tags = gps_tags(acc, tim1b, clk1b, clock_gap_limit_s)
    names = [f"{kind}_accl_{axis}" for kind in ("lin", "ang") for axis in "xyz"]
    time, values, flag, _ = sorted_samples(acc, tags, tuple(names))
    sca_time, quaternion = usable(camera, QUATERNION)
    orbit_time, state = usable(orbit, STATE)
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    good &= between(time, sca_time, BRIDGED_S) & between(time, orbit_time, BRIDGED_S)
    if not good.any():
        expected, remedy = "some in the same minutes", "Give files of the same minutes."
        refuse("accelerometer", "no reading with attitude and orbit", expected, remedy, EstimationError)
    time, values = time[good], values[good]
    first = np.floor(time[0] / step_s) * step_s
    place = np.floor((time - first) / step_s).astype(int)
    count = np.bincount(place)
    mean = np.stack([np.bincount(place, one) for one in values.T], axis=1) / np.maximum(count, 1)[:, None]
    mean[count < 0.7 * np.median(count[count > 0])] = np.nan  # a mean of half a step is another signal
    middle = first + step_s * (np.arange(count.size) + 0.5)
    # a firing is short, samples are not at whole tenths: a mean belongs to the time that its samples cover
    half = np.median(np.diff(time)) / 2
    occupied = np.flatnonzero(count)
    ends = np.stack([middle - step_s / 2, middle + step_s / 2])
    ends[0, occupied] = np.minimum.reduceat(time, np.searchsorted(place, occupied)) - half
    ends[1, occupied] = np.maximum.reduceat(time, np.searchsorted(place, occupied)) + half
    torquers, known = _torquers(by_product.get("MAG1B"), ends, np.asarray(dipole_per_current))
    mean[~known] = np.nan
    if np.isfinite(mean[:, 0]).sum() < LEAST:
        steps, remedy = f"{np.isfinite(mean[:, 0]).sum()} steps of {step_s:g} s with readings", "Give a longer record."
        refuse("accelerometer", steps, LEAST, remedy, EstimationError)
    aligned = torquers | {"time": middle, "linear_b": mean[:, :3], "angular_b": mean[:, 3:], "step": step_s}
    aligned |= {"begin": ends[0], "end": ends[1]}
    field_at = magnetic.body_field(orbit_time, state[:, :3], sca_time, frames.continuous(quaternion), igrf_generation)
    field_b, _ = field_at(np.clip(middle, sca_time[0], sca_time[-1]))
    torque = np.cross(aligned["dipole_b"], field_b)
    aligned |= {"magnetic_b": np.linalg.solve(inertia, torque.T).T}
    lever = np.cross(np.asarray(position_b)[:12], np.asarray(force_b)[:12])  # N m, each thruster
    aligned |= _firings(by_product.get("THR1B")) | {"nominal_b": np.linalg.solve(inertia, (lever[:6] + lever[6:]).T).T}
    return build(SCHEMAS["align"], aligned)


def _torquers(mag, ends, dipole_per_current):
    """Mean dipole (n, 3) A m2 in steps with ends (2, n) s and its rate (n, 3) A m2 s-1, from MAG1B; zero without it.

    And whether they are known (n,) bool: not beyond the record or in a gap of over `MAG_GAP_S`.
    When a current changes between two records is not known; its expectation, linear in between, does not bias a gain.
    """
    time, current = ((), ()) if mag is None else usable(mag, ("current_b",))
    if not len(time):
        none = np.zeros((ends.shape[1], 3))
        return {"dipole_b": none, "dipole_rate_b": none}, np.ones(ends.shape[1], dtype=bool)
    fine = np.linspace(*ends, 21)[1::2]
    dipole = np.stack([np.interp(fine, time, one).mean(axis=0) for one in current.T], axis=1) * dipole_per_current
    at_ends = np.stack([np.interp(ends, time, one) for one in current.T], axis=2)
    rate = (at_ends[1] - at_ends[0]) / (ends[1] - ends[0])[:, None] * dipole_per_current
    return {"dipole_b": dipole, "dipole_rate_b": rate}, between(ends, time, MAG_GAP_S).all(axis=0)


def _firings(fired):
    """{"firing": begin (k,) s, "on": seconds (k, 6) of each pair} of thrusters in "ingest" of THR1B; empty for None."""
    if fired is None:
        return {"firing": np.zeros(0), "on": np.zeros((0, 6))}
    names = [name for name in fired.data_vars if name.startswith("on_time")][:12]
    time, values = usable(fired, tuple(names))
    on = 5e-4 * (values[:, :6] + values[:, 6:])  # ms in the file, two thrusters a pair
    fires = on.sum(axis=1) > 0
    return {"firing": time[fires], "on": on[fires]}


def duty(aligned: xr.Dataset, delay_s: float) -> np.ndarray:
    """Duty cycle (n, 6) of each pair of thrusters in every step, if tags of firings are late by delay_s."""
    ends = np.stack([aligned["begin"].values, aligned["end"].values])
    seconds = np.zeros((ends.shape[1], len(PAIRS)))
    for pair in range(len(PAIRS)):
        on = aligned["on"].values[:, pair]
        begin, on = aligned["firing"].values[on > 0] - delay_s, on[on > 0]
        if begin.size:
            end = np.minimum(begin + on, np.append(begin[1:], np.inf))
            total = np.repeat(np.cumsum(end - begin), 2)
            nodes = np.stack([begin, end], axis=1).ravel()
            seconds[:, pair] = np.diff(np.interp(ends, nodes, np.append(0.0, total[:-1])), axis=0)[0]
    return seconds / (ends[1] - ends[0])[:, None]


def causes(aligned: xr.Dataset, delay_s: float, amplitude: np.ndarray) -> list[Candidate]:
    """Candidates with columns (n, 6, q) of the readings, tags of firings late by delay_s; forms prefix their names.

    The amplitude (6 pairs, 6) is the reading by each pair while on, which gives the derivative by the delay.

    Notes
    -----
    Of the offset the Euler term alone, reading = -(alpha x p_CoM): CoM paper eq. 5; alpha by firings (as estimated, in
    `amplitude`) and torquers. On a routine day the centrifugal term is slow.
    """
    share, count = duty(aligned, delay_s), aligned.sizes["time"]
    by_pair = np.einsum("np,ca->ncpa", share, np.eye(6))
    force, torque = (by_pair[..., part].reshape(count, 6, 18) for part in (slice(3), slice(3, None)))
    pair_axes = [f"{pair}_{axis}" for pair in PAIRS for axis in "xyz"]
    duty_by_delay = (duty(aligned, delay_s + 0.005) - duty(aligned, delay_s - 0.005)) / 0.01
    alpha = share @ amplitude[:, 3:] + aligned["magnetic_b"].values
    by_offset = np.stack([-np.cross(alpha, unit) for unit in np.eye(3)], axis=2)
    contexts = [Context(aligned["time"].values, dipole_b=aligned[n].values) for n in ("dipole_b", "dipole_rate_b")]
    leak, offset, delay = map(effect, ("accelerometer.current_leak", "accelerometer.offset", DELAY))
    padded = lambda linear: np.concatenate([linear, np.zeros_like(linear)], axis=1)  # noqa: E731
    by_current, by_rate = (padded(leak.columns(context)) for context in contexts)
    pairs = [p.name for p in leak.parameters]
    torquer = np.concatenate([np.zeros((count, 3, 3)), aligned["magnetic_b"].values[:, :, None] * np.eye(3)], axis=1)
    return [
        Candidate(FORCE, "force", pair_axes, ["m s-2"] * 18, [force], [1e-6] * 18),
        Candidate(TORQUE, "torque", pair_axes, ["rad s-2"] * 18, [torque], [1e-4] * 18),
        listed(delay, [(duty_by_delay @ amplitude)[:, :, None]]),
        Candidate("unknown:torquer_torque", "torquer", list("xyz"), ["1"] * 3, [torquer], [1.0] * 3),
        listed(leak, [by_current], "leak"),
        Candidate("unknown:current_rate", "rate_leak", pairs, ["m s-1 A-1 m-2"] * 9, [by_rate], [1e-10] * 9),
        listed(offset, [padded(by_offset)], "offset"),
    ]


def blocks(aligned: xr.Dataset, block_s: float, knot_s: float) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Each block at least half full: steps (m,) int, cubic splines (m, k) of the slow part, valid (m,) bool."""
    time = aligned["time"].values
    valid = np.isfinite(aligned["linear_b"].values).all(axis=1) & np.isfinite(aligned["angular_b"].values).all(axis=1)
    number = np.minimum(np.floor((time - time[0]) / block_s), max(np.ceil(np.ptp(time) / block_s - 0.5) - 1, 0))
    for block in np.unique(number):
        rows = np.flatnonzero(number == block)
        if valid[rows].sum() > max(rows.size / 2, 10):
            start, stop = time[rows[0]], time[rows[-1]] + 1e-6
            inner = np.linspace(start, stop, max(int(np.ceil((stop - start) / knot_s)), 1) + 1)
            knots = np.concatenate([np.full(3, start), inner, np.full(3, stop)])
            yield rows, BSpline.design_matrix(time[rows], knots, 3).toarray(), valid[rows]


def readings(aligned: xr.Dataset) -> np.ndarray:
    """Linear and angular reading (n, 6) less their means, so that a large bias costs no digits; 0 where missing."""
    values = np.concatenate([aligned["linear_b"].values, aligned["angular_b"].values], axis=1)
    return np.nan_to_num(values - np.nanmean(values, axis=0))


def estimate(
    aligned: xr.Dataset,
    *,
    block_s: float,
    knot_s: float,
    noise_order: int,
    parts: int,
    determined_ratio: float,
    transient_sigma: float,
) -> xr.Dataset:
    """Product "routine.estimate": all causes in one least-squares fit to "routine.align", whitened by its residual."""
    pieces, observed, models = list(blocks(aligned, block_s, knot_s)), readings(aligned), [None] * 6
    if not pieces:
        refuse("ACC1A", "no block that is half full", f"readings of {block_s / 2:g} s", "Give more.", EstimationError)
    delay = _first_delay(aligned, pieces, observed)
    amplitude = np.concatenate([np.zeros((6, 3)), aligned["nominal_b"].values], axis=1)
    value, kept = None, pieces  # the slow part of each block is free; outliers are left out of the fit
    for number in range(ITERATIONS):
        candidates = causes(aligned, delay, amplitude)
        prior = np.concatenate([candidate.prior for candidate in candidates])
        design = np.concatenate([candidate.columns[0] for candidate in candidates], axis=2) * prior  # in prior sigmas
        if value is not None:
            residuals = _left(pieces, observed - design @ (value / prior))
            models, cleaned = noises(aligned, pieces, residuals, noise_order, design.shape[2] // 6, transient_sigma)
            kept = cleaned if number > 2 else pieces  # before, it may be a delay that is not yet known
        information, right = _normal(kept, observed, design, models)
        scaled = least_squares.stable_inverse(information.sum(axis=0)) @ right.sum(axis=0)
        delay_step = float(scaled[36] * prior[36])  # s; parameter 36 is the delay, after 18 forces and 18 torques
        amplitude = np.concatenate([(scaled * prior)[k : k + 18].reshape(6, 3) for k in (0, 18)], axis=1)
        amplitude[:, 3:] += 0.0 if observed[:, 3:].any() else aligned["nominal_b"].values  # no angular reading
        amplitude[:, :3] -= np.cross(amplitude[:, 3:], (scaled * prior)[-3:])  # the offset may undo most of a force
        value = np.where(np.arange(prior.size) == 36, 0.0, scaled * prior)
        delay += delay_step
    names = ["_".join(filter(None, (candidate.form, name))) for candidate in candidates for name in candidate.names]
    total = np.where(np.arange(prior.size) == 36, delay, value) / prior
    gains = _gains(candidates, information.sum(axis=0), total)
    units = [unit for candidate in candidates for unit in candidate.units]
    right += information[:, :, 36] * (delay - delay_step) / prior[36]  # the last step of the delay was about this one
    group = np.arange(len(pieces)) * parts // len(pieces)
    groups = [group == number for number in np.unique(group)]
    both = [np.stack([each[g].sum(axis=0) for g in groups]) for each in (information, right)]
    starts = [aligned["time"].values[pieces[np.flatnonzero(g)[0]][0][0]] for g in groups]
    solution = named_parameters.estimated(names, units, np.full(prior.size, determined_ratio), *both, starts, prior)
    fitted = design @ (value / prior)
    solution |= {"cause": [candidate.cause for candidate in candidates], "gain": gains[0], "chance": gains[1]}
    residuals, rows = _left(pieces, observed - fitted), np.concatenate([rows for rows, *_ in pieces])
    residual = np.concatenate(residuals)
    solution |= {"time": aligned["time"].values[rows], "measured": residual + fitted[rows], "fitted": fitted[rows]}
    return build(SCHEMAS["estimate"], solution | _transients(aligned, pieces, residuals, models, transient_sigma))


def noises(
    aligned: xr.Dataset, pieces, left: list[np.ndarray], noise_order: int, parameters: int, limit: float
) -> tuple[list[NoiseModel | None], list[tuple]]:
    """Noise model of each component from residuals `left`, (m, 6) of every block, and the blocks without outliers.

    None for a component without a reading. Outliers are beyond `limit` sigma; samples near one are left out of noise
    too, for an oscillation fades slowly; each time the noise is smaller. `parameters` were fitted to each component.
    """
    removed = parameters + sum(slow.shape[1] for _, slow, _ in pieces)  # of each component
    order = max(min(noise_order, sum(valid.sum() for *_, valid in pieces) // 40), 1)
    retained, step = [valid for *_, valid in pieces], float(aligned["step"])
    wide = np.ones(2 * int(TOGETHER_S / step) + 1, dtype=bool)
    for _ in range(CALMER):
        masked = [np.where(still[:, None], one, np.nan) for still, one in zip(retained, left, strict=True)]
        fits = (fit_noise([one[:, c] for one in masked], order, step, removed) for c in range(6))
        models = [one if read else None for one, read in zip(fits, readings(aligned).any(axis=0), strict=True)]
        outlying = [np.abs(one).max(axis=1) >= limit for one in _white(pieces, left, models)]
        retained = [valid & ~binary_dilation(one, wide) for (*_, valid), one in zip(pieces, outlying, strict=True)]
    return models, [(rows, slow, valid & ~one) for (rows, slow, valid), one in zip(pieces, outlying, strict=True)]


def _first_delay(aligned, pieces, observed):
    """Delay s of the tags of firings with the largest gain in the angular reading, by grid: start of the linear fit.

    In the linear reading where there is no angular one. A firing is shorter than a delay may be: no linearisation.
    """
    residuals = [one[:, slice(3, None) if observed[:, 3:].any() else slice(3)] for one in _left(pieces, observed)]
    rows, series = np.concatenate([rows for rows, *_ in pieces]), np.nan_to_num(np.concatenate(residuals))
    series = series / np.maximum(series.std(axis=0), 1e-300)
    # whole steps by which firings are late, where a lag beyond LATEST_S stands out of readings by shares of pairs
    step, share = float(aligned["step"]), duty(aligned, 0.0)
    read = np.zeros((len(share), series.shape[1]))
    read[rows] = series
    duty_fft, read_fft = (np.fft.rfft(one, 2 * len(share), axis=0) for one in (share, read))
    duty_fft, read_fft = np.repeat(duty_fft, read_fft.shape[1], axis=1), np.tile(read_fft, len(PAIRS))
    longest, near = min(int(APART_S / step), len(share) // 2), max(int(LATEST_S / step), 1)
    late = -timing.lag(read_fft, duty_fft, longest, near, either=True)
    fine = step / 20
    delays = fine * np.arange(-int(LATEST_S / fine), int(LATEST_S / fine) + 1) + step * late * (abs(late) > near)
    share = [duty(aligned, delay)[rows] for delay in delays]
    gains = [np.sum((least_squares.orthonormal(one).T @ series) ** 2) for one in share]
    return float(delays[int(np.argmax(gains))]) if np.max(gains) > 0 else 0.0


def _gains(candidates, information, value):
    """Chi-square (c,) that each candidate gains beside all others, and its chance probability, Bonferroni-corrected."""
    inverse, gains, dof = least_squares.stable_inverse(information), [], []
    for place in np.split(np.arange(value.size), np.cumsum([len(one.names) for one in candidates])[:-1]):
        rows = place[np.diag(information)[place] > 0]
        gains.append(value[rows] @ least_squares.stable_inverse(inverse[np.ix_(rows, rows)]) @ value[rows])
        dof.append(rows.size)
    return gains, np.minimum(len(candidates) * np.exp(chi2_tail.log_tail(gains, np.maximum(dof, 1))), 1.0)


def _normal(pieces, observed, design, models):
    """Information (b, p, p) and right side (b, p) of whitened rows of every block, its slow part projected out."""
    information, right = [], []
    for rows, slow, valid in pieces:
        normal, side = 0.0, 0.0
        for c in np.flatnonzero(observed.any(axis=0)):
            columns = np.column_stack([observed[rows, c], design[rows, c], slow]) * valid[:, None]
            if models[c] is None:
                sigma = least_squares.project_out(columns[valid, design.shape[2] + 1 :], columns[valid, 0]).std()
                white = columns / max(sigma, 1e-300)
            else:
                white = whiten(models[c], columns, valid)
            reduced = least_squares.project_out(white[:, design.shape[2] + 1 :], white[:, : design.shape[2] + 1])
            normal, side = normal + reduced[:, 1:].T @ reduced[:, 1:], side + reduced[:, 1:].T @ reduced[:, 0]
        information.append(normal)
        right.append(side)
    return np.stack(information), np.stack(right)


def _left(pieces, series):
    """Residual (m, 6) of a series (n, 6) less its slow part in every block, NaN where there is no reading."""
    residuals = []
    for rows, slow, valid in pieces:
        residual = np.full((rows.size, 6), np.nan)
        residual[valid] = least_squares.project_out(least_squares.orthonormal(slow[valid]), series[rows][valid])
        residuals.append(residual)
    return residuals


def _white(pieces, residuals, models):
    """Whitened residual (m, 6) of every block, zero for a component without a noise model."""

    def white(model, series, there):
        return np.zeros(series.size) if model is None else whiten(model, np.nan_to_num(series), there)

    each = zip(pieces, residuals, strict=True)
    return [np.stack([white(n, one[:, c], there) for c, n in enumerate(models)], axis=1) for (*_, there), one in each]


def _transients(aligned, pieces, residuals, models, limit):
    """Variables of the product: peak epoch s of each group of samples beyond `limit` sigma, and its sign changes."""
    time = np.concatenate([aligned["time"].values[rows] for rows, *_ in pieces])
    white = np.concatenate(_white(pieces, residuals, models))
    outlying = np.flatnonzero(np.abs(white).max(axis=1) > limit)
    transients = []
    for group in np.split(outlying, np.flatnonzero(np.diff(time[outlying]) > TOGETHER_S) + 1) if outlying.size else ():
        component = int(np.abs(white[group]).max(axis=0).argmax())
        peak = group[np.abs(white[group, component]).argmax()]
        near = white[np.abs(time - time[peak]) < TOGETHER_S, component]
        transients.append((time[peak], np.sum(np.diff(np.sign(near[np.abs(near) > limit / 2])) != 0)))
    return dict(zip(("transient", "transient_swings"), np.reshape(transients, (-1, 2)).T, strict=True))


def check(solution: xr.Dataset, *, agreement_limit: float, delay_limit_s: float) -> xr.Dataset:
    """Checks of the result: probability that its parts disagree so much, delay of the tags of firings."""
    delay = float(solution["value"].sel(parameter="delay"))
    made = [checks.at_most("tags of firings against readings", abs(delay), delay_limit_s, "s")]
    return checks.product([*made[: int(np.isfinite(delay))], *named_parameters.checks(solution, agreement_limit)])
