"""Phase centres from routine pointing of a pair: range minus orbit in blocks of a revolution, smoothed pointing.

Each block has its own bias and slow orbit error; its noise has the spectrum of the day, and levels of its own of orbit
errors and of ranging. Where orbit errors are large readings weigh little. Routine pointing turns the line of sight by
milliradians, x moves the range by the square of that and is lost. Above 10 mHz pointing as measured is noise of the
star cameras, and a regressor with noise gives phase centres that are too small, or, with x held, those along the mean
pointing: the regressor is the pointing expected from its measurement (Wiener filter).
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.linalg import cholesky, solve_triangular

from gravcal.calibrations import checks, named_parameters, schemas
from gravcal.calibrations.align import late_of_pair, late_orbit
from gravcal.calibrations.schemas import build
from gravcal.effects.ranging import BANDS_HZ
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import crn, least_squares
from gravcal.estimation.noise import filtered, fit_noise, in_bands, log_linear
from gravcal.estimation.resampling import on_even_grid
from gravcal.physics import orbit_environment

SCHEMAS = schemas.of("ranging.toml")

NAMES = tuple(f"{axis}_{letter}" for letter in "ab" for axis in "xyz")
REVOLUTION_SHARE = 60  # of the day's positions between two that span the plane of the orbit
EDGES_HZ = (BANDS_HZ[0] / 2, *BANDS_HZ)  # an octave below, where orbit errors are larger, is shown as well
#: Hz, of the spectrum of the day, and of the levels of a block: orbit errors below, ranging above.
KNOTS_HZ = 1e-3 * np.array([0.3, 0.5, 0.8, 1.2, 1.7, 2.3, 3, 4, 5.5, 7.5, 10, 14, 20, 30, 50, 70, 80, 90, 100])
LEVELS_HZ = (5e-3, 2e-2)
KEPT = 0.3  # least share of a periodogram ordinate outside all columns, for it to count in the spectrum
LOOSE = 1e-4  # prior information of the log density at knots; 1 of a level of a block, alike to a factor of e
BINS = 4096  # frequencies between zero and Nyquist
ROUNDING = 1e-12  # of the variance: late tags leave hundreds of metres
ROUNDS, SCORINGS = 4, 4  # iterations of the spectrum: whitening anew, and steps of Fisher scoring in each
WHITE_HZ = 0.08  # up to which the filters of the star cameras and of the ranging leave white noise white
LEAST_GAIN = 0.5  # of the Wiener filter of the pointing, from which on motion exceeds noise


def align(aligned: xr.Dataset, pointed: xr.Dataset, equations: xr.Dataset, *, nominal_m, noise_hz: float) -> xr.Dataset:
    """Product "ranging.align": quiet ranging minus orbit, its derivatives by the phase centres, drivers of effects.

    Products are "align", "pointing" and "observable" of kbr_phase_centre; nominal_m (2, 3) are the phase centres of the
    catalogue; above noise_hz pointing is all noise.
    """
    late = late_of_pair(aligned, pointed)
    orbit_lag = late_orbit(aligned, pointed, late)
    quiet = (equations["arc"].values == -1) | (orbit_lag is not None)  # by a late orbit all may look like wiggles
    at = equations["time_kbr"].values[quiet]
    if at.size < 2:
        refuse(equations.attrs["ranging"], "no routine pointing", "a day with orbits", "Give one.", EstimationError)
    second, line = pointed["time"].values, pointed["line_of_sight_b"].values
    known = np.isfinite(line).all(axis=(0, 2))
    line = np.stack([[np.interp(second, second[known], v[known]) for v in one.T] for one in line]).swapaxes(1, 2)
    frequency, density, gain = pointing_gain(line, noise_hz)
    smooth = smoothed(line, frequency, gain)
    correction, motion = (np.einsum("kna,ka->n", one, np.reshape(nominal_m, (2, 3))) for one in (line, smooth))
    bands = [in_bands(one, 1.0, EDGES_HZ) for one in (correction, motion)]
    column = -np.concatenate(list(smooth), axis=1)
    crn_filter = crn.operator(crn.Crn(), 0, known, (second[0], 1.0), at)
    parts = crn_filter(np.column_stack([column, correction, *bands]))
    column, correction, *bands = np.split(parts, np.cumsum([6, 1, len(EDGES_HZ) - 1]), axis=1)
    here = np.isin(aligned["time_kbr"].values, at)
    position = aligned["position_i"].values[0]
    kept = np.isfinite(position).all(axis=1)
    orbit, position = aligned["time"].values[kept][::10], position[kept][::10]
    normal = np.cross(position[0], position[len(position) // REVOLUTION_SHARE])
    argument = np.unwrap(orbit_environment.argument_of_latitude(position, normal))
    values = {
        "time": at,
        "observed": equations["observed"].values[quiet],
        "column": column,
        "correction": correction[:, 0],
        "correction_band": bands[0],
        "smoothed_band": bands[1],
        "edge": EDGES_HZ,
        "segment": equations["segment"].values[quiet],
        "range": aligned["reading_range"].values[here],
        "range_rate": aligned["reading_range_rate"].values[here],
        "argument": np.interp(at, orbit, argument),
        "warmth": orbit_environment.warmth(at, orbit, position),
        "late": late,
        "frequency": frequency,
        "pointing_density": density,
        "pointing_gain": gain,
    }
    values |= {f"rate_{name}": orbit_lag[name] for name in ("time", "left", "change")} if orbit_lag else {}
    return build(SCHEMAS["align"], values, satellites=equations.attrs["satellites"], ranging=equations.attrs["ranging"])


def pointing_gain(line_b: np.ndarray, noise_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wiener filter of the measured pointing: frequency (m,) Hz, density (2, 2, m) rad2 Hz-1, gain (2, 2, m) 0 to 1.

    From the one-sided spectrum of y and z of the lines of sight (2, n, 3) at whole seconds, with no motion above
    `noise_hz`: G = S_t / (S_t + S_n) of a motion S_t in white noise S_n, zero where noise exceeds motion.
    """
    count = line_b.shape[1]
    edges = np.append(np.geomspace(1e-3, noise_hz, 16), np.geomspace(noise_hz, WHITE_HZ, 6)[1:])
    window, frequency = np.hanning(count), np.fft.rfftfreq(count, 1.0)
    trend = least_squares.polynomial(np.arange(count), 2, 0, count)
    detrended = least_squares.project_out(trend, np.moveaxis(line_b[..., 1:], 1, 0).reshape(count, 4))
    power = np.abs(np.fft.rfft(detrended * window[:, None], axis=0)) ** 2 * 2 / np.sum(window**2)
    bins = np.digitize(frequency, edges)
    density = np.stack([power[bins == k].mean(axis=0) for k in range(1, edges.size)], axis=-1).reshape(2, 2, -1)
    noise = power[(frequency >= noise_hz) & (frequency < edges[-1])].mean(axis=0).reshape(2, 2, 1)
    gain = 1 - noise / density
    gain[(np.cumsum(gain < LEAST_GAIN, axis=-1) > 0) | (edges[1:] > noise_hz * 1.001)] = 0.0
    return np.sqrt(edges[1:] * edges[:-1]), density, gain


def smoothed(line_b: np.ndarray, frequency: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Lines of sight (2, n, 3) expected from those measured (Wiener filter); arguments as of `pointing_gain`."""
    smooth = line_b.copy()
    for k, axis in np.ndindex(2, 2):
        share = lambda f, own=gain[k, axis]: np.interp(f, frequency, own, left=1)  # noqa: E731
        smooth[k, :, 1 + axis] = filtered(line_b[k, :, 1 + axis], 1.0, share)
    smooth[..., 0] = np.sqrt(1 - np.sum(smooth[..., 1:] ** 2, axis=-1))
    return smooth


@dataclass(frozen=True)
class Block:
    """One revolution without a change of bias."""

    rows: np.ndarray  #: (n,) int, places in the rows of the day
    place: np.ndarray  #: (n,) int, index of each reading on the even grid of the block
    slow: np.ndarray  #: (n, k) columns of bias and slow orbit error
    density: np.ndarray  #: (BINS + 1,) m2 Hz-1 of its noise, one-sided, from zero to the Nyquist frequency
    lower: np.ndarray  #: (n, n) m, Cholesky factor of the covariance of its noise

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Whitened columns on the even grid (m, q) of columns (n, q) m; zero where there is no reading."""
        grid = np.zeros((self.place[-1] + 1, columns.shape[1]))
        grid[self.place] = solve_triangular(self.lower, columns, lower=True, check_finite=False)
        return grid

    def coloured(self, white: np.ndarray) -> np.ndarray:
        """Columns (m, q) m on the even grid from whitened ones (m, q), NaN where no reading: inverse of `white`."""
        grid = np.full(white.shape, np.nan)
        grid[self.place] = self.lower @ white[self.place]
        return grid


def blocks(
    rows: xr.Dataset, *, range_block_s: float, range_degree: int, noise_order: int, added=0.0, beside=None
) -> list[Block]:
    """Blocks of a day ("ranging.align"), each at least half full, with the correction `added` (n,) m to the range.

    Whittle likelihood: the periodogram of whitened residuals less columns of any size, `beside` (n, q), is exponential
    about r(f) exp(x(f)), r the share of white noise outside the columns; x, of knots of the day and levels of blocks,
    by Fisher scoring until rows are white, from an autoregressive model of `noise_order` on. Its variance v enlarges
    the density by 1 + v: a reading whose variance is only known so well has that of Student's t.
    """
    time, segment, observed = rows["time"].values, rows["segment"].values, rows["observed"].values + added
    step, number = step_of(rows), np.floor((time - time[0]) / range_block_s).astype(int) * 8 + segment
    parts = [np.flatnonzero(number == one) for one in np.unique(number)]  # of one block and segment each
    parts = [part for part in parts if part.size * step > range_block_s / 2]
    if len(parts) < 2:
        revolutions = f"{len(parts)} blocks of {range_block_s:.0f} s that are at least half full"
        expected = "two or more, so that noise can be told from what they show"
        refuse(rows.attrs["ranging"], revolutions, expected, "Give a longer record.", EstimationError)
    places = [np.rint((time[part] - time[part[0]]) / step).astype(int) for part in parts]
    slow = [least_squares.polynomial(time[part], range_degree, time[part[0]], time[part[-1]]) for part in parts]
    series = [least_squares.project_out(s, observed[p] - observed[p[0]]) for p, s in zip(parts, slow, strict=True)]
    series = [on_even_grid(time[part], step, one) for part, one in zip(parts, series, strict=True)]
    frequency = np.linspace(0, 0.5 / step, BINS + 1)
    removed = sum(one.shape[1] for one in slow)  # parameters
    density = [fit_noise(series, noise_order, step, removed).density(frequency)] * len(parts)
    data = np.column_stack([observed, *([] if beside is None else beside.T)])
    knots = log_linear(KNOTS_HZ[KNOTS_HZ * step < 0.501], frequency), log_linear(LEVELS_HZ, frequency)
    level = np.zeros((len(parts), len(LEVELS_HZ)))
    for _ in range(ROUNDS):
        made = [_block(*one, step) for one in zip(parts, places, slow, density, strict=True)]
        day, change, variance = _scored(made, data, knots, level)
        level = level + change
        density = [one * np.exp(day + own @ knots[1].T) for one, own in zip(density, change, strict=True)]
    density = [one * (1 + own) for one, own in zip(density, variance, strict=True)]
    return [_block(*one, step) for one in zip(parts, places, slow, density, strict=True)]


def _block(rows, place, slow, density, step):
    """Block whose covariance is the autocovariance of a density (BINS + 1,) m2 Hz-1; step s."""
    autocovariance = np.fft.irfft(density, 2 * BINS) * (0.5 / step)
    autocovariance[0] *= 1 + ROUNDING
    return Block(rows, place, slow, density, cholesky(autocovariance[np.abs(place[:, None] - place)], lower=True))


def _scored(parts, data, knots, level):
    """Changes of the log density of the day (m,) and of levels (k, 2) by Fisher scoring, variance (k, m) of both."""
    slow = [least_squares.orthonormal(one.white(one.slow)) for one in parts]
    clean = [one.white(data[one.rows] - data[one.rows[0]]) for one in parts]
    clean = np.concatenate([own - basis @ (basis.T @ own) for own, basis in zip(clean, slow, strict=True)])
    common = least_squares.orthonormal(clean[:, 1:])  # directions of the columns of any size
    residual = np.column_stack([clean[:, 0] - common @ (common.T @ clean[:, 0]), common])
    cuts, count, width = np.cumsum([len(one) for one in slow])[:-1], knots[0].shape[1], level.shape[1]
    powers, all_weights = [], []
    for k, (one, basis, rest) in enumerate(zip(parts, slow, np.split(residual, cuts), strict=True)):
        ordinate = np.arange(1, len(rest) // 2)
        power = np.abs(np.fft.rfft(np.column_stack([rest, basis]), axis=0)[ordinate]) ** 2 / one.place.size
        outside, place = 1 - power[:, 1:].sum(axis=1), np.rint(2 * BINS * ordinate / len(rest)).astype(int)
        weights = np.zeros((ordinate.size, count + level.size))
        weights[:, :count], weights[:, count + k * width : count + (k + 1) * width] = (one[place] for one in knots)
        powers.append((power[:, 0] / outside)[outside > KEPT])
        all_weights.append(weights[outside > KEPT])
    power, weights = np.concatenate(powers), np.concatenate(all_weights)
    begin = np.concatenate([np.zeros(count), level.ravel()])
    value, prior = begin, np.repeat([LOOSE, 1.0], [count, level.size])
    for _ in range(SCORINGS):
        right = weights.T @ (power * np.exp(-weights @ (value - begin)) - 1) - prior * value  # gradient
        value = value + np.clip(np.linalg.solve(weights.T @ weights + np.diag(prior), right), -1, 1)
    covariance, knot_shares = np.linalg.inv(weights.T @ weights + np.diag(prior)), np.column_stack(knots)
    own = [np.r_[:count, count + k * width : count + (k + 1) * width] for k in range(len(parts))]
    variance = [np.sum(knot_shares @ covariance[np.ix_(one, one)] * knot_shares, axis=1) for one in own]
    return knots[0] @ value[:count], value[count:].reshape(level.shape) - level, variance


def angles(rows: xr.Dataset) -> np.ndarray:
    """Pitch and yaw (n, 2, 2) rad of the line of sight in the body, by satellite."""
    x, y, z = np.moveaxis(-rows["column"].values.reshape(-1, 2, 3), -1, 0)
    return np.stack([np.arctan2(-z, x), np.arctan2(y, x)], axis=-1)


def step_of(rows: xr.Dataset) -> float:
    """Median spacing s of the readings."""
    return float(np.median(np.diff(rows["time"].values)))


def estimate(rows: xr.Dataset, *, determined_limit_mm: float, **settings) -> xr.Dataset:
    """Product "ranging.estimate": phase centres, and share of the antenna correction that the range shows by band.

    Of "ranging.align"; a component with a larger sigma than the limit is not determined; settings as of `blocks`.

    Notes
    -----
    rho_KBR - rho_COM = b - l_A . c_A - l_B . c_B; Remote Sens. 2022, 14, 3395, eq. 13 (erratum K-1). With
    E[l | measured] in place of l the estimate is not diluted; the rest of l, times the lever, is in the measured noise.
    """
    observed, band, smooth, time = (rows[n].values for n in ("observed", "correction_band", "smoothed_band", "time"))
    by_centre, by_share = 1e-3 * rows["column"].values, -band
    parts = blocks(rows, **settings, beside=np.column_stack([by_centre, by_share]))
    information, right, excess = equations_of(parts, rows, observed, by_centre)
    limit, starts = np.full(6, determined_limit_mm), [time[part.rows[0]] for part in parts]
    solution = named_parameters.estimated(NAMES, ["mm"] * 6, limit, information, right, starts)
    of_share, share_right, share_excess = equations_of(parts, rows, observed, by_share)
    covariance = least_squares.covariance(of_share.sum(axis=0))
    data = np.column_stack([observed - observed[0], by_centre])
    series = np.concatenate([least_squares.project_out(part.slow, data[part.rows]) for part in parts])
    motion_information, motion_right, _ = equations_of(parts, rows, -smooth.sum(axis=1), by_share)
    solution |= {
        "time": time[np.concatenate([part.rows for part in parts])],
        "residual": series[:, 0],
        "fitted": series[:, 1:] @ np.nan_to_num(solution["value"]),
        "edge": rows["edge"].values,
        "share": covariance @ share_right.sum(axis=0),
        "share_covariance": covariance,
        "expected": least_squares.stable_inverse(motion_information.sum(axis=0)) @ motion_right.sum(axis=0),
        "excess": [excess, share_excess],
        "density": [_densities(rows, parts, observed + more) for more in (0.0, band.sum(axis=1), smooth.sum(axis=1))],
    }
    return build(SCHEMAS["estimate"], solution)


def equations_of(
    parts: list[Block], rows: xr.Dataset, observed: np.ndarray, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Normal equations (k, p, p), (k, p) of columns (n, p) in k blocks, over a variance inflation factor; the factor.

    Orbit errors and pointing both follow the orbit. Columns moved by whole revolutions cannot be there: where they
    gain more than one each in chi-square, on average, variances are larger by this excess.
    """
    time, argument = rows["time"].values, rows["argument"].values
    span, turns = time[-1] - time[0], abs(argument[-1] - argument[0]) / (2 * np.pi)
    lags = np.arange(max(int(turns), 1) + 1) * span / turns
    at = [np.abs((time - time[0] + lag + span) % (2 * span) - span) for lag in lags]  # back from the end
    moved = [np.stack([np.interp(one, time - time[0], v) for v in column.T], axis=1) for one in at]
    data = np.column_stack([observed, *moved])
    sums = []
    for part in parts:
        white = least_squares.project_out(part.white(part.slow), part.white(data[part.rows] - data[part.rows[0]]))
        lagged = white[:, 1:].reshape(len(white), lags.size, -1)
        sums.append((np.einsum("nli,nlj->lij", lagged, lagged), np.einsum("nli,n->li", lagged, white[:, 0])))
    information, right = (np.stack(one, axis=1) for one in zip(*sums, strict=True))
    wrong = zip(information[1:].sum(axis=1), right[1:].sum(axis=1), strict=True)
    gain_of_lag = [side @ least_squares.stable_inverse(normal) @ side for normal, side in wrong]
    excess = max(float(np.mean(gain_of_lag)) / column.shape[1], 1.0)
    return information[0] / excess, right[0] / excess, excess


def whitened_power(part: Block, observed: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (m,) Hz and power (m,) of whitened readings of a range (n,) m in a block; 1 where all is noise."""
    values = observed[part.rows, None] - observed[part.rows[0]]
    rest = least_squares.project_out(part.white(part.slow), part.white(values))[:, 0]
    return np.fft.rfftfreq(rest.size, step_s), np.abs(np.fft.rfft(rest)) ** 2 / part.place.size


def _densities(rows, parts, observed):
    """Mean over blocks of the one-sided density (b,) m2 Hz-1, by band, of a range (n,) m."""
    edges, step, means = rows["edge"].values, step_of(rows), []
    for part in parts:
        frequency, power = whitened_power(part, observed, step)
        density = power * np.interp(frequency, np.linspace(0, 0.5 / step, BINS + 1), part.density)
        bands = zip(edges, edges[1:], strict=False)
        means.append([density[(frequency >= low) & (frequency < high)].mean() for low, high in bands])
    return np.mean(means, axis=0)


def check(pair: xr.Dataset, solution: xr.Dataset, *, agreement_limit: float) -> xr.Dataset:
    """Checks of the pair ("kbr_phase_centre.checks") and of the result ("ranging.estimate")."""
    return checks.product([*checks.of_product(pair), *named_parameters.checks(solution, agreement_limit)])
