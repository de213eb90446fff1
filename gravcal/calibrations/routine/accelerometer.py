"""Readings of an accelerometer on a routine day, and what firings, torquers and turns of the satellite make of them."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline
from scipy.ndimage import binary_dilation

from gravcal.calibrations import checks, named_parameters, schemas
from gravcal.calibrations.align import QUATERNION, STATE, gps_tags, sorted_samples, usable
from gravcal.calibrations.causes import listed
from gravcal.calibrations.schemas import build
from gravcal.effects import Context, effect
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import chi2_tail, least_squares, timing
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.estimation.records import Candidate
from gravcal.physics import frames, magnetic

SCHEMAS = schemas.of("routine.toml")

LEAST = 40  # steps with a reading
#: Thrusters k and k + 6 of THR1B fire together, without a net force if they are alike.
PAIRS = ("yaw_minus", "pitch_plus", "yaw_plus", "pitch_minus", "roll_minus", "roll_plus")
COMPONENTS = ("linear_x", "linear_y", "linear_z", "angular_x", "angular_y", "angular_z")
ITERATIONS = 5  # of noise and delay
CALMER = 5  # times that samples beyond noise are left out of it
TOGETHER_S = 8.0  # of the samples of a transient
LATEST_S = 5.0  # by which tags of firings are late or early, about a lag that stands out
APART_S = 600  # longest lag that is looked for
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
    """Readings averaged over steps, with torquers and firings beside them.

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
    for covered in (sca_time, orbit_time):
        good &= (time >= covered[0]) & (time <= covered[-1]) if covered.size > 3 else False
    if not good.any():
        expected, remedy = "some in the same minutes", "Give files of the same minutes."
        refuse("accelerometer", "no reading with attitude and orbit", expected, remedy, EstimationError)
    time, values = time[good], values[good]
    first = np.floor(time[0] / step_s) * step_s
    place = np.floor((time - first) / step_s).astype(int)
    count = np.bincount(place)
    mean = np.stack([np.bincount(place, one) for one in values.T], axis=1) / np.maximum(count, 1)[:, None]
    mean[count < 0.7 * np.median(count[count > 0])] = np.nan  # a mean of half a step is another signal
    if np.isfinite(mean[:, 0]).sum() < LEAST:
        steps, remedy = f"{np.isfinite(mean[:, 0]).sum()} steps of {step_s:g} s with readings", "Give a longer record."
        refuse("accelerometer", steps, LEAST, remedy, EstimationError)
    middle = first + step_s * (np.arange(count.size) + 0.5)
    # a firing is short, samples are not at whole tenths: a mean belongs to the time that its samples cover
    half = np.median(np.diff(time)) / 2
    held = np.flatnonzero(count)
    ends = np.stack([middle - step_s / 2, middle + step_s / 2])
    ends[0, held] = np.minimum.reduceat(time, np.searchsorted(place, held)) - half
    ends[1, held] = np.maximum.reduceat(time, np.searchsorted(place, held)) + half
    aligned = {"time": middle, "linear_b": mean[:, :3], "angular_b": mean[:, 3:], "step": step_s}
    aligned |= {"begin": ends[0], "end": ends[1]}
    aligned |= _torquers(by_product.get("MAG1B"), ends, np.asarray(dipole_per_current))
    field_at = magnetic.body_field(orbit_time, state[:, :3], sca_time, frames.continuous(quaternion), igrf_generation)
    field_b, _ = field_at(np.clip(middle, sca_time[0], sca_time[-1]))
    torque = np.cross(aligned["dipole_b"], field_b)
    aligned |= {"magnetic_b": np.linalg.solve(inertia, torque.T).T}
    lever = np.cross(np.asarray(position_b)[:12], np.asarray(force_b)[:12])
    aligned |= _firings(by_product.get("THR1B")) | {"nominal_b": np.linalg.solve(inertia, (lever[:6] + lever[6:]).T).T}
    return build(SCHEMAS["align"], aligned)


def _torquers(mag, ends, dipole_per_current):
    """Mean dipole of every step and its rate.

    When a current changes between two records is not known; the mean of what it can be there keeps a gain undiluted.
    """
    if mag is None:
        return {name: np.zeros((ends.shape[1], 3)) for name in ("dipole_b", "dipole_rate_b")}
    time, current = usable(mag, ("current_b",))
    fine = np.linspace(*ends, 21)[1::2]
    dipole = np.stack([np.interp(fine, time, one).mean(axis=0) for one in current.T], axis=1) * dipole_per_current
    between = np.stack([np.interp(ends, time, one) for one in current.T], axis=2)
    rate = (between[1] - between[0]) / (ends[1] - ends[0])[:, None] * dipole_per_current
    outside = (ends[0] < time[0]) | (ends[1] > time[-1])
    dipole[outside] = rate[outside] = 0.0
    return {"dipole_b": dipole, "dipole_rate_b": rate}


def _firings(fired):
    """Begin of every firing of attitude thrusters, and time on of each pair."""
    if fired is None:
        return {"firing": np.zeros(0), "on": np.zeros((0, 6))}
    names = [name for name in fired.data_vars if name.startswith("on_time")][:12]
    time, values = usable(fired, tuple(names))
    on = 5e-4 * (values[:, :6] + values[:, 6:])  # ms in the file, two thrusters a pair
    used = on.sum(axis=1) > 0
    return {"firing": time[used], "on": on[used]}


def duty(aligned: xr.Dataset, delay_s: float) -> np.ndarray:
    """Share (n, 6) of every step in which each pair is on, if tags of firings are late by so many seconds."""
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
    """What the readings (n, 6) may follow, tags of firings late by so many seconds; the form begins parameters' names.

    The amplitude (6 pairs, 6) is the reading by each pair while on, which says what a further delay does.

    Notes
    -----
    Of the offset the Euler term alone, reading = -(alpha x p_CoM): CoM paper eq. 5; alpha by firings (what they did, in
    `amplitude`) and torquers. On a routine day the centrifugal term is slow.
    """
    share, count = duty(aligned, delay_s), aligned.sizes["time"]
    by_pair = np.einsum("np,ca->ncpa", share, np.eye(6))
    force, torque = (by_pair[..., part].reshape(count, 6, 18) for part in (slice(3), slice(3, None)))
    named = [f"{pair}_{axis}" for pair in PAIRS for axis in "xyz"]
    ahead = (duty(aligned, delay_s + 0.005) - duty(aligned, delay_s - 0.005)) / 0.01
    alpha = share @ amplitude[:, 3:] + aligned["magnetic_b"].values
    turned = np.stack([-np.cross(alpha, unit) for unit in np.eye(3)], axis=2)
    contexts = [Context(aligned["time"].values, dipole_b=aligned[n].values) for n in ("dipole_b", "dipole_rate_b")]
    leak, offset, late = map(effect, ("accelerometer.current_leak", "accelerometer.offset", DELAY))
    padded = lambda linear: np.concatenate([linear, np.zeros_like(linear)], axis=1)  # noqa: E731
    by_current, by_rate = (padded(leak.columns(one)) for one in contexts)
    pairs = [p.name for p in leak.parameters]
    magnetic = np.concatenate([np.zeros((count, 3, 3)), aligned["magnetic_b"].values[:, :, None] * np.eye(3)], axis=1)
    return [
        Candidate(FORCE, "force", named, ["m s-2"] * 18, [force], [1e-6] * 18),
        Candidate(TORQUE, "torque", named, ["rad s-2"] * 18, [torque], [1e-4] * 18),
        listed(late, [(ahead @ amplitude)[:, :, None]]),
        Candidate("unknown:torquer_torque", "torquer", list("xyz"), ["1"] * 3, [magnetic], [1.0] * 3),
        listed(leak, [by_current], "leak"),
        Candidate("unknown:current_rate", "rate_leak", pairs, ["m s-1 A-1 m-2"] * 9, [by_rate], [1e-10] * 9),
        listed(offset, [padded(turned)], "offset"),
    ]


def blocks(aligned: xr.Dataset, block_s: float, knot_s: float) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows (m,) of each block that is at least half full, the slow part (m, k) of a reading, and where one is (m,)."""
    time = aligned["time"].values
    there = np.isfinite(aligned["linear_b"].values).all(axis=1) & np.isfinite(aligned["angular_b"].values).all(axis=1)
    number = np.minimum(np.floor((time - time[0]) / block_s), max(np.ceil(np.ptp(time) / block_s - 0.5) - 1, 0))
    for one in np.unique(number):
        rows = np.flatnonzero(number == one)
        if there[rows].sum() > max(rows.size / 2, 10):
            start, stop = time[rows[0]], time[rows[-1]] + 1e-6
            inner = np.linspace(start, stop, max(int(np.ceil((stop - start) / knot_s)), 1) + 1)
            knots = np.concatenate([np.full(3, start), inner, np.full(3, stop)])
            yield rows, BSpline.design_matrix(time[rows], knots, 3).toarray(), there[rows]


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
    """All causes together ("routine.align"), by the noise that they leave; the slow part of every block free."""
    pieces, observed, by_component = list(blocks(aligned, block_s, knot_s)), readings(aligned), [None] * 6
    delay = _first_delay(aligned, pieces, observed)
    amplitude = np.concatenate([np.zeros((6, 3)), aligned["nominal_b"].values], axis=1)
    value, kept = None, pieces  # what is beyond noise is left out of the fit
    for number in range(ITERATIONS):
        known = causes(aligned, delay, amplitude)
        size = np.concatenate([one.prior for one in known])
        design = np.concatenate([one.columns[0] for one in known], axis=2) * size
        if value is not None:
            left = _left(pieces, observed - design @ (value / size))
            by_component, calm = noises(aligned, pieces, left, noise_order, design.shape[2] // 6, transient_sigma)
            kept = calm if number > 2 else pieces  # before, it may be a delay that is not yet known
        information, right = _normal(kept, observed, design, by_component)
        scaled = least_squares.stable_inverse(information.sum(axis=0)) @ right.sum(axis=0)
        moved = float(scaled[36] * size[36])
        amplitude = np.concatenate([(scaled * size)[k : k + 18].reshape(6, 3) for k in (0, 18)], axis=1)
        amplitude[:, 3:] += 0.0 if observed[:, 3:].any() else aligned["nominal_b"].values  # of a transplant
        amplitude[:, :3] -= np.cross(amplitude[:, 3:], (scaled * size)[-3:])  # the offset may undo most of a force
        value = np.where(np.arange(size.size) == 36, 0.0, scaled * size)
        delay += moved
    names = ["_".join(filter(None, (one.form, name))) for one in known for name in one.names]
    whole = np.where(np.arange(size.size) == 36, delay, value) / size
    gains = _gains(known, information.sum(axis=0), whole)
    units = [unit for one in known for unit in one.units]
    right += information[:, :, 36] * (delay - moved) / size[36]  # the last step of the delay was about this one
    group = np.arange(len(pieces)) * parts // len(pieces)
    groups = [group == number for number in np.unique(group)]
    both = [np.stack([each[g].sum(axis=0) for g in groups]) for each in (information, right)]
    starts = [aligned["time"].values[pieces[np.flatnonzero(g)[0]][0][0]] for g in groups]
    solution = named_parameters.estimated(names, units, np.full(size.size, determined_ratio), *both, starts, size)
    fitted = design @ (value / size)
    solution |= {"cause": [one.cause for one in known], "gain": gains[0], "chance": gains[1]}
    left, rows = _left(pieces, observed - fitted), np.concatenate([rows for rows, *_ in pieces])
    rest = np.concatenate(left)
    solution |= {"time": aligned["time"].values[rows], "measured": rest + fitted[rows], "fitted": fitted[rows]}
    return build(SCHEMAS["estimate"], solution | _transients(aligned, pieces, left, by_component, transient_sigma))


def noises(
    aligned: xr.Dataset, pieces, left: list[np.ndarray], noise_order: int, parameters: int, limit: float
) -> tuple[list[NoiseModel | None], list[tuple]]:
    """Noise of each component by what is left (m, 6) of every block, and the blocks without samples so far beyond it.

    Of a component without a reading it is None. What is near such a sample is left out of the noise as well, for what
    swings fades slowly; each time the noise is smaller.
    """
    removed = parameters + sum(slow.shape[1] for _, slow, _ in pieces)
    order = max(min(noise_order, sum(there.sum() for *_, there in pieces) // 40), 1)
    quiet, step = [there for *_, there in pieces], float(aligned["step"])
    wide = np.ones(2 * int(TOGETHER_S / step) + 1, dtype=bool)
    for _ in range(CALMER):
        calm = [np.where(still[:, None], one, np.nan) for still, one in zip(quiet, left, strict=True)]
        made = (fit_noise([one[:, c] for one in calm], order, step, removed) for c in range(6))
        models = [one if read else None for one, read in zip(made, readings(aligned).any(axis=0), strict=True)]
        far = [np.abs(one).max(axis=1) >= limit for one in _white(pieces, left, models)]
        quiet = [there & ~binary_dilation(one, wide) for (*_, there), one in zip(pieces, far, strict=True)]
    return models, [(rows, slow, there & ~one) for (rows, slow, there), one in zip(pieces, far, strict=True)]


def _first_delay(aligned, pieces, observed):
    """Delay s of the tags of firings at which they explain most of the angular reading: a firing is short beside it.

    Of the linear one where there is no other.
    """
    left = [one[:, slice(3, None) if observed[:, 3:].any() else slice(3)] for one in _left(pieces, observed)]
    rows, series = np.concatenate([rows for rows, *_ in pieces]), np.nan_to_num(np.concatenate(left))
    series = series / np.maximum(series.std(axis=0), 1e-300)
    # whole steps by which firings are late, where a lag beyond LATEST_S stands out of readings by shares of pairs
    step, share = float(aligned["step"]), duty(aligned, 0.0)
    read = np.zeros((len(share), series.shape[1]))
    read[rows] = series
    moved, reading = (np.fft.rfft(one, 2 * len(share), axis=0) for one in (share, read))
    moved, reading = np.repeat(moved, reading.shape[1], axis=1), np.tile(reading, len(PAIRS))
    most, near = min(int(APART_S / step), len(share) // 2), max(int(LATEST_S / step), 1)
    late = -timing.lag(reading, moved, most, near, either=True)
    fine = step / 20
    tried = fine * np.arange(-int(LATEST_S / fine), int(LATEST_S / fine) + 1) + step * late * (abs(late) > near)
    share = [duty(aligned, delay)[rows] for delay in tried]
    gains = [np.sum((least_squares.orthonormal(one).T @ series) ** 2) for one in share]
    return float(tried[int(np.argmax(gains))]) if np.max(gains) > 0 else 0.0


def _gains(known, information, value):
    """Chi-square that each cause takes beside all others, which are free, and the chance of it, corrected."""
    inverse, gains, freedom, first = least_squares.stable_inverse(information), [], [], 0
    for one in known:
        rows = np.arange(first, first + len(one.names))
        rows, first = rows[np.diag(information)[rows] > 0], first + len(one.names)
        gains.append(value[rows] @ least_squares.stable_inverse(inverse[np.ix_(rows, rows)]) @ value[rows])
        freedom.append(rows.size)
    return gains, np.minimum(len(known) * np.exp(chi2_tail.log_tail(gains, np.maximum(freedom, 1))), 1.0)


def _normal(pieces, observed, design, noises):
    """Information (b, p, p) and right side (b, p) of every block, its slow part projected out."""
    information, right = [], []
    for rows, slow, there in pieces:
        normal, side = 0.0, 0.0
        for c in np.flatnonzero(observed.any(axis=0)):
            whole = np.column_stack([observed[rows, c], design[rows, c], slow]) * there[:, None]
            if noises[c] is None:
                spread = least_squares.project_out(whole[there, design.shape[2] + 1 :], whole[there, 0]).std()
                white = whole / max(spread, 1e-300)
            else:
                white = whiten(noises[c], whole, there)
            clean = least_squares.project_out(white[:, design.shape[2] + 1 :], white[:, : design.shape[2] + 1])
            normal, side = normal + clean[:, 1:].T @ clean[:, 1:], side + clean[:, 1:].T @ clean[:, 0]
        information.append(normal)
        right.append(side)
    return np.stack(information), np.stack(right)


def _left(pieces, series):
    """Series (m, 6) of every block less its slow part, NaN where there is no reading."""
    made = []
    for rows, slow, there in pieces:
        rest = np.full((rows.size, 6), np.nan)
        rest[there] = least_squares.project_out(least_squares.orthonormal(slow[there]), series[rows][there])
        made.append(rest)
    return made


def _white(pieces, left, noises):
    """Whitened residual (m, 6) of every block."""

    def white(noise, series, there):
        return np.zeros(series.size) if noise is None else whiten(noise, np.nan_to_num(series), there)

    each = zip(pieces, left, strict=True)
    return [np.stack([white(n, one[:, c], there) for c, n in enumerate(noises)], axis=1) for (*_, there), one in each]


def _transients(aligned, pieces, left, noises, limit):
    """Samples beyond noise, those within seconds of each other together."""
    time = np.concatenate([aligned["time"].values[rows] for rows, *_ in pieces])
    white = np.concatenate(_white(pieces, left, noises))
    far = np.flatnonzero(np.abs(white).max(axis=1) > limit)
    transients = []
    for group in np.split(far, np.flatnonzero(np.diff(time[far]) > TOGETHER_S) + 1) if far.size else ():
        component = int(np.abs(white[group]).max(axis=0).argmax())
        peak = group[np.abs(white[group, component]).argmax()]
        near = white[np.abs(time - time[peak]) < TOGETHER_S, component]
        transients.append((time[peak], np.sum(np.diff(np.sign(near[np.abs(near) > limit / 2])) != 0)))
    return dict(zip(("transient", "transient_swings"), np.reshape(transients, (-1, 2)).T, strict=True))


def check(solution: xr.Dataset, *, agreement_limit: float, delay_limit_s: float) -> xr.Dataset:
    """Checks of the result: its parts by the probability that they disagree so much, tags of firings by their delay."""
    delay = solution["value"].values[list(map(str, solution["parameter"].values)).index("delay")]
    made = [checks.at_most("tags of firings against readings", abs(float(delay)), delay_limit_s, "s")]
    return checks.product([*made[: int(np.isfinite(delay))], *named_parameters.checks(solution, agreement_limit)])
