"""Noise of ranging minus orbit: measured in quiet data and in the manoeuvres, and its covariance between epochs.

Quiet data hold the noise of ranging and orbit. In the manoeuvres the star cameras add a pointing error times the lever
arm of the tilted antenna: in routine flight the line of sight lies along x and the lever arm is nil; at 2 deg it is
50 mm, so that 20 urad become 1 um. This part is measured as the excess of the residual's density in the manoeuvres.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np
import xarray as xr
from scipy.linalg import cholesky, solve_triangular, solveh_banded
from scipy.optimize import lsq_linear, nnls

from gravcal.calibrations.kbr_phase_centre.model import SCHEMAS
from gravcal.calibrations.schemas import build
from gravcal.errors import EstimationError
from gravcal.estimation import crn, least_squares
from gravcal.estimation import noise as noises
from gravcal.estimation.resampling import on_even_grid

LEAST_DEGREE = 6  # fewer leave slow orbit errors of a short stretch, which raise the density at 4 mHz up to 80 times
SHORTEST = 60  # least epochs of a stretch from which noise is measured
#: Hz, of the spectrum of the range: orbit errors fall by 1e4 in power from 1 to 6 mHz, the filter ends at 0.1 Hz.
KNOTS_HZ = 1e-3 * np.array([0.5, 0.8, 1.2, 1.7, 2.3, 3, 4, 5.5, 7.5, 10, 14, 20, 30, 50, 70, 80, 90, 100])
CORNERS = np.array([3e-3, 1e-2, 3e-2, 1e3])  # Hz, of first-order low-pass parts of star camera noise; the last is white
BINS = 4096  # frequencies between zero and Nyquist
FITTED_HZ = (2.5e-3, 6e-2)  # where neither the polynomial nor the edge of the filter shapes the residual
FLOOR_HZ = 5e-4  # below it the gain of derivatives is held constant, so that their covariance stays invertible
STEEP = 4  # exponent by which the density is raised above the frequencies of the motion
RESTRICTED_STEPS = 4  # iterations of the Fisher scoring
SEEN_HZ = (1.5e-3, 2.5e-2)  # knots in it are estimated again from the manoeuvres, which add to what quiet data show
BESIDE, DEPENDENT = 1e-4, 1e-2  # least relative norm of a candidate less its projection, least singular value
SMALL = 0.2  # levers below this share of the largest one add less than 4 % to the variance of the pointing part


def noise(equations: xr.Dataset, *, noise_degree: int, quiet_length_s: float, quiet_minimum_s: float) -> xr.Dataset:
    """Product "kbr_phase_centre.noise": spectrum of the range residual in quiet data, else in manoeuvres."""
    time = equations["time_kbr"].values
    step = float(np.median(np.diff(time))) if time.size > 1 else 5.0
    quiet, source = equations["arc"].values == -1, "quiet"
    if quiet.sum() * step < quiet_minimum_s and not quiet.all():
        quiet, source = equations["arc"].values >= 0, "manoeuvres"
    index = np.flatnonzero(quiet)  # of every stretch without a gap or phase break
    steps, breaks = np.diff(time[index]), np.diff(equations["segment"].values[index])
    stretches = np.split(index, np.flatnonzero((steps > 20 * step) | (breaks != 0)) + 1) if index.size else []
    in_manoeuvres, centre = manoeuvre_residuals(equations, noise_degree)
    pieces = _pieces(equations, stretches, centre, noise_degree, quiet_length_s, step)
    if sum(values.size for values, _ in pieces) * step < quiet_length_s / 4:
        lengths = [time[part[-1]] - time[part[0]] for part in stretches]
        where = "quiet data" if source == "quiet" else "the manoeuvres, with less quiet data than quiet_minimum_s"
        raise EstimationError(
            f"{equations.attrs['ranging']}: found {len(lengths)} stretches of ranging with orbits and attitudes in "
            f"{where}, the longest of {max(lengths, default=0):.0f} s, expected {quiet_length_s / 4:.0f} s in "
            f"stretches of at least {SHORTEST * step:.0f} s without a gap of {20 * step:.0f} s or a phase break, to "
            f"measure the noise. Add the files that close the gaps, or lower quiet_length_s.",
            usable=int(time.size),
        )
    ranging = noises.fit_spectrum(pieces, step, KNOTS_HZ[KNOTS_HZ * step < 0.501])
    frequency = np.linspace(0, 0.5 / step, 257)[1:]
    values = {
        "knot": ranging.knot_hz,
        "log_density": ranging.log_density,
        "log_covariance": ranging.covariance,
        "frequency": frequency,
        "density": density([_left(*piece) for piece in pieces], step, frequency),
        "model": ranging.density(frequency),
        "in_manoeuvres": density([piece for piece, _ in in_manoeuvres], step, frequency),
        "seconds": quiet.sum() * step,
        "corner": CORNERS,
        "pointing_power": pointing_power(in_manoeuvres if source == "quiet" else [], ranging, step),
    }
    return build(SCHEMAS["noise"], values, title="Noise of ranging minus orbit", source_data=source, step_s=step)


def spectrum(measured: xr.Dataset) -> noises.Spectrum:
    """Spectrum of the range, m2 Hz-1, of a noise product."""
    return noises.Spectrum(*(measured[name].values for name in ("knot", "log_density", "log_covariance")))


def _pieces(equations, stretches, centre, degree, length, step):
    """Pieces of stretches on even grids, NaN where missing: list of residual (n,) m and nuisance columns (n, k).

    Stretches are row numbers; a known `centre` (6,) m is used: a free one takes up noise at twice the pointing periods.
    """
    time, column = (equations[name].values for name in ("time_kbr", "column"))
    centre_known = np.isfinite(centre).all()
    observed = equations["observed"].values - (column @ centre if centre_known else 0.0)
    column = column[:, [] if centre_known else [1, 2, 4, 5]]
    pieces = []
    for stretch in stretches:
        count = int(np.ceil((time[stretch[-1]] - time[stretch[0]]) / (1.5 * length)))
        for rows in np.array_split(stretch, max(count, 1)):
            span = time[rows[-1]] - time[rows[0]]
            piece_degree = max(int(np.ceil(degree * span / length)), LEAST_DEGREE)
            if rows.size < max(SHORTEST, 4 * piece_degree, 0.7 * span / step):
                continue
            slow = least_squares.polynomial(time[rows], piece_degree, time[rows[0]], time[rows[-1]])
            values = np.column_stack([observed[rows] - observed[rows].mean(), slow, column[rows]])
            values = on_even_grid(time[rows], step, values)
            pieces.append((values[:, 0], values[:, 1:]))
    return pieces


def _left(values, columns):
    """Residual (n,) of values (n,) after least squares for columns (n, k), NaN where a value is missing."""
    good, residual = np.isfinite(values), np.full(values.size, np.nan)
    residual[good] = least_squares.project_out(least_squares.orthonormal(columns[good]), values[good])
    return residual


def density(pieces: list[np.ndarray], step_s: float, frequency_hz: np.ndarray) -> np.ndarray:
    """Mean one-sided periodogram (m,) unit2 Hz-1 of pieces (n_i,), NaN where missing, Hann window, at frequencies."""
    total = np.zeros(frequency_hz.size)
    for piece in pieces:
        window = np.hanning(piece.size + 2)[1:-1] * np.isfinite(piece)
        power = np.abs(np.fft.rfft(np.nan_to_num(piece) * window)) ** 2 * 2 * step_s / max(np.sum(window**2), 1e-300)
        total += np.interp(frequency_hz, np.fft.rfftfreq(piece.size, step_s), power)
    return total / max(len(pieces), 1)


def images(step_s: float) -> np.ndarray:
    """Aliasing pairs (2, m) Hz: BINS + 1 frequencies up to Nyquist, and those beyond that sampling folds onto them."""
    frequency = np.linspace(0, 0.5 / step_s, BINS + 1)
    return np.stack([frequency, 1 / step_s - frequency])


@lru_cache(maxsize=4)
def passed(step_s: float) -> np.ndarray:
    """Power gain of the CRN filter at the frequencies of `images`, (2, m)."""
    return np.stack([crn.gain(crn.Crn(), 0.5, 0, f) ** 2 for f in images(step_s)])


def shapes(step_s: float, smoothed_hz: float = np.inf) -> np.ndarray:
    """Power spectral densities 1 / (1 + (f / corner)^2) after the CRN filter, at `images`, (corner, 2, m).

    The last corner lies beyond all frequencies: white noise, through the low-pass `smoothed` of the lines of sight.
    """
    densities = passed(step_s) / (1 + (images(step_s) / CORNERS[:, None, None]) ** 2)
    # gain of `smoothed`, about 1 / (1 + (f / fc)^8), 0.9 at the frequency it keeps
    sine = np.sin(np.pi * np.minimum(images(step_s), 0.5)) / np.sin(np.pi * min(smoothed_hz, 0.5))
    densities[-1] *= (1 + sine**8 / 9) ** -2
    return densities


def smoothed(values: np.ndarray, smoothed_hz: float) -> np.ndarray:
    """Whittaker smoothing of a series (n, k) of whole seconds, fourth differences penalised; NaN samples are filled.

    Minimum of sum (y - z)^2 + w sum (D^4 z)^2; Whittaker, Proc. Edinburgh Math. Soc. 41 (1923); w as in `shapes`.
    """
    good, weight = np.isfinite(values).all(axis=1), 1 / (9 * (2 * np.sin(np.pi * smoothed_hz)) ** 8)
    if good.sum() < 8:
        return values
    difference, bands = np.array([1.0, -4.0, 6.0, -4.0, 1.0]), np.zeros((5, len(values)))
    for lag in range(5):
        for k in range(5 - lag):
            bands[lag, k : len(values) - 4 + k] += weight * difference[k] * difference[k + lag]
    bands[0] += good
    return solveh_banded(bands, np.where(good[:, None], values, 0.0), lower=True)


def of_star_cameras(measured: xr.Dataset, lever: np.ndarray, highest_hz: float) -> bool:
    """True if above the frequencies of the motion star cameras add more noise to the range than it has itself.

    Levers (n, 4) are m per rad in the manoeuvres.
    """
    step = float(measured.attrs["step_s"])
    power = np.einsum("c,cm->m", measured["pointing_power"].values, shapes(step)[:, 0])
    frequency = images(step)[0]
    in_band = (frequency > highest_hz) & (frequency < FITTED_HZ[1])
    range_power = spectrum(measured).density(frequency[in_band])
    return bool(np.mean(power[in_band] / range_power) * np.mean(lever**2, axis=0).max(initial=0.0) > 1)


def manoeuvre_residuals(equations: xr.Dataset, degree: int) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Residual (n,) m and lever (n, 4) m per rad of each manoeuvre on its even grid, and phase centres (6,) m.

    By ordinary least squares over all manoeuvres together; the phase centres are NaN without manoeuvres.
    """
    time, number, segment = (equations[n].values for n in ("time_kbr", "arc", "segment"))
    observed, column, lever = (equations[n].values for n in ("observed", "column", "lever"))
    step = float(np.median(np.diff(time)))
    indices = [np.flatnonzero(number == k) for k in range(equations.sizes["manoeuvre"])]
    indices = [index for index in indices if index.size > 4 * degree + 20]
    detrended = []
    for index in indices:
        slow = slow_columns(time[index], segment[index], degree, 0)
        detrended.append(least_squares.project_out(slow, np.column_stack([observed[index], column[index]])))
    if not detrended:
        return [], np.full(6, np.nan)
    y, A = np.concatenate([d[:, 0] for d in detrended]), np.concatenate([d[:, 1:] for d in detrended])
    centre = least_squares.stable_inverse(A.T @ A) @ (A.T @ y)
    parts = zip(indices, detrended, strict=True)
    residual = [on_even_grid(time[i], step, d[:, 0] - d[:, 1:] @ centre) for i, d in parts]
    arms = [np.nan_to_num(on_even_grid(time[index], step, lever[index, 0])) for index in indices]
    return list(zip(residual, arms, strict=True)), centre


def slow_columns(time: np.ndarray, segment: np.ndarray, degree: int, derivative: int) -> np.ndarray:
    """Nuisance columns (n, k): Legendre polynomials of time (n,) s; for the range a bias for every further segment."""
    if time.size < 2:
        return np.zeros((time.size, degree + 1))
    slow = least_squares.polynomial(time, degree, time[0], time[-1])
    if derivative:
        return slow
    return np.column_stack([slow, *(segment == s for s in np.unique(segment)[1:])]).astype(float)


def pointing_power(pieces: list[tuple[np.ndarray, np.ndarray]], quiet: noises.Spectrum, step: float) -> np.ndarray:
    """Densities (corner,) rad2 Hz-1 of the parts of star camera noise below their corners, none negative.

    The covariance of g(t) phi(t) is on average mean(g(t) g(t + tau)) C(tau); its density is fitted to the excess of the
    periodograms of `manoeuvre_residuals` over the noise of the range with weights 1/density.
    """
    excess = np.zeros(CORNERS.size)
    if not pieces:
        return excess
    length = max(piece.size for piece, _ in pieces)
    frequency = np.fft.rfftfreq(2 * length, step)
    power, model = np.zeros(frequency.size), np.zeros((frequency.size, CORNERS.size))
    lags = [np.fft.irfft(shape.sum(axis=0), 2 * BINS)[:length] * 0.5 / step for shape in shapes(step)]
    lags = [np.pad(lag, (0, length - lag.size)) for lag in lags]  # beyond, the noise is not correlated
    for piece, lever in pieces:
        window = np.hanning(piece.size + 2)[1:-1] * np.isfinite(piece)
        energy = np.sum(window**2)
        power += np.abs(np.fft.rfft(np.nan_to_num(piece) * window, 2 * length)) ** 2 * 2 * step / energy
        arm_power = (np.abs(np.fft.rfft(lever * window[:, None], 2 * length, axis=0)) ** 2).sum(axis=1)
        lever_correlation = np.fft.irfft(arm_power, 2 * length)[:length] / energy
        for k, lag in enumerate(lags):
            covariance = lever_correlation * lag
            model[:, k] += np.fft.rfft(np.concatenate([covariance, [0.0], covariance[:0:-1]])).real * 2 * step
    in_band = (frequency >= FITTED_HZ[0]) & (frequency <= FITTED_HZ[1])
    power, model = power[in_band] / len(pieces), model[in_band] / len(pieces)
    quiet_density = quiet.density(frequency[in_band])
    for _ in range(5):
        weight = 1 / (quiet_density + model @ excess)
        column_norm = np.linalg.norm(model * weight[:, None], axis=0)
        excess = nnls(model * weight[:, None] / column_norm, (power - quiet_density) * weight)[0] / column_norm
    return excess


@dataclass(frozen=True)
class Lags:
    """Autocovariances by lag of the noise of range, range rate or range acceleration."""

    ranging: np.ndarray  #: (n,) m2 s**(-2 derivative), of ranging and orbit
    #: {(a, b): (2 n - 1,)} between derivatives a and b of the pointing noise, lags -(n - 1) .. n - 1
    pointing: dict[tuple[int, int], np.ndarray]
    derivative: int  #: 0, 1 or 2


def lags(measured: xr.Dataset, derivative: int, count: int, highest_hz: float = np.inf) -> Lags:
    """Autocovariances of the noise of the range or a derivative (0, 1 or 2) of it, at `count` lags of one step.

    Above `highest_hz`, where the lines of sight as measured are noise of the star cameras, no motion, the density is
    raised steeply: columns with errors would else be weighted by them, and what is estimated comes out too small.
    """
    step = float(measured.attrs["step_s"])
    frequency = np.linspace(0, 0.5 / step, BINS + 1)
    ranging = spectrum(measured).density(frequency)
    above = frequency > highest_hz
    ranging[above] = ranging[~above].min() * (frequency[above] / highest_hz) ** STEEP
    component_densities = shapes(step, measured.attrs.get("smoothed_hz", np.inf))
    pointing = np.einsum("c,cim->im", measured["pointing_power"].values, component_densities)
    return lags_of_densities(ranging, pointing, step, derivative, count)


def lags_of_densities(ranging: np.ndarray, pointing: np.ndarray, step_s: float, derivative: int, count: int) -> Lags:
    """Autocovariances at `count` lags from the densities of the range and of the pointing error.

    Ranging (m,) m2 Hz-1 is one-sided, as sampled, pointing (2, m) rad2 Hz-1 one-sided, not folded, at `images`. The
    power of a derivative over that of the range is that of the same white phase through the CRN filter, as sampled.
    """

    def transformed(spectrum):  # covariance by lag, negative lags at the end
        return np.fft.irfft(spectrum, 2 * BINS) * (0.5 / step_s)

    omega, power_gain = 2 * np.pi * images(step_s), passed(step_s) + 1e-12
    omega_held = np.maximum(omega, 2 * np.pi * FLOOR_HZ)
    gain = (power_gain * omega_held ** (2 * derivative)).sum(axis=0) / power_gain.sum(axis=0)
    pairs = {}
    if np.any(pointing):
        for a in range(derivative + 1):
            for b in range(derivative + 1):
                direct, folded = pointing * omega ** (a + b)
                full = transformed(direct * 1j ** (a - b) + folded * (-1j) ** (a - b))
                pairs[a, b] = np.concatenate([full[-count + 1 :], full[:count]])
    return Lags(transformed(ranging * gain)[:count], pairs, derivative)


def covariance_matrix(by_lag: Lags, place: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of the noise at some epochs of an even grid.

    Place (n,) holds the numbers of the epochs, lever (n, derivative + 1, 4) m s**-order the range per radian of
    pointing and its derivatives. The pointing part of the range is sum_j g_j phi_j; by Leibniz its d-th derivative has
    the covariance sum_ab (d a)(d b) sum_j g_j^(d-a)(t) g_j^(d-b)(t') K_ab(t - t').
    """
    d, n = by_lag.derivative, by_lag.ranging.size
    strength = np.sqrt(np.mean(lever[:, 0] ** 2, axis=0))
    strong = lever[:, ::-1][:, :, strength > SMALL * strength.max()]
    lag = place[:, None] - place
    covariance = by_lag.ranging[np.abs(lag)]
    for (a, b), values in by_lag.pointing.items():
        covariance += comb(d, a) * comb(d, b) * (strong[:, a] @ strong[:, b].T) * values[n - 1 + lag]
    return covariance


def factor(by_lag: Lags, place: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Lower Cholesky factor (n, n) of `covariance_matrix`."""
    return cholesky(covariance_matrix(by_lag, place, lever), lower=True, overwrite_a=True, check_finite=False)


def factors(measured: xr.Dataset, stretches: list) -> list[np.ndarray]:
    """Lower Cholesky factor (n, n) m of the noise of the range in each stretch.

    Each stretch has `place` (n,), the numbers of its epochs on an even grid, and `lever` (n, 1, 4) m per radian.
    """
    by_lag = lags(measured, 0, max((int(one.place[-1]) for one in stretches), default=0) + 3)
    return [factor(by_lag, one.place, one.lever) for one in stretches]


def white(lower: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Whitened columns L^-1 A (n, q), with the lower Cholesky factor L (n, n) of their covariance."""
    return solve_triangular(lower, columns, lower=True, check_finite=False)


def with_restricted(
    measured: xr.Dataset, stretches: list, residuals: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> xr.Dataset:
    """Noise product estimated again from the manoeuvres by restricted maximum likelihood, all candidates free.

    Slow orbit error, phase centres and all candidates are free in every stretch, so that nothing they explain counts as
    noise. Star camera noise is estimated from the manoeuvres; the spectrum of the range, which quiet data leave
    uncertain by some ten percent at the frequency of the wiggle, from both. Residuals of each stretch are (n,) m
    observed, (n, k) baseline and (n, q) candidates.

    Notes
    -----
    Fisher scoring of l = -1/2 (log|V| + log|X' V^-1 X| + y' P y + d' C^-1 d), V = R(d) + sum_c s_c K_c, d what the
    knots of the spectrum differ from those of quiet data and C their covariance: score (y' P K P y - tr P K) / 2,
    information tr(P K P K') / 2; Patterson and Thompson, Biometrika 58 (1971).
    """
    if measured.attrs["source_data"] != "quiet" or not stretches:
        return measured
    step, quiet = float(measured.attrs["step_s"]), spectrum(measured)
    frequency, count = np.linspace(0, 0.5 / step, BINS + 1), CORNERS.size
    free = np.flatnonzero((quiet.knot_hz > SEEN_HZ[0]) & (quiet.knot_hz < SEEN_HZ[1]))
    knot_shares = quiet.shares(frequency)[:, free].T
    longest = max(int(one.place[-1]) for one in stretches) + 1
    component_densities = shapes(step, measured.attrs.get("smoothed_hz", np.inf))
    units = [lags_of_densities(np.zeros(BINS + 1), s, step, 0, longest) for s in component_densities]
    kernels = [[covariance_matrix(by_lag, one.place, one.lever) for by_lag in units] for one in stretches]
    value, prior = np.append(measured["pointing_power"].values, np.zeros(free.size)), np.zeros((count + free.size,) * 2)
    prior[count:, count:] = np.linalg.inv(quiet.covariance[np.ix_(free, free)])
    for _ in range(RESTRICTED_STEPS):
        score, information = np.zeros(value.size), np.zeros((value.size, value.size))
        parts = knot_shares * spectrum(measured).density(frequency)
        lags_ = [lags_of_densities(one, np.zeros(2), step, 0, longest).ranging for one in parts]
        by_stretch = zip(factors(measured, stretches), stretches, kernels, residuals, strict=True)
        for L, one, stretch_kernels, (observed, baseline, tried) in by_stretch:
            basis = _basis_beside(white(L, baseline), white(L, tried))
            complement = np.linalg.qr(basis, mode="complete")[0][:, basis.shape[1] :]
            unwhitened = solve_triangular(L, complement, lower=True, trans="T", check_finite=False)
            lag, P = np.abs(one.place[:, None] - one.place), unwhitened @ unwhitened.T
            K, Py = np.stack([*stretch_kernels, *(row[lag] for row in lags_)]), P @ observed
            PK = P @ K
            score += (K @ Py @ Py - np.trace(PK, axis1=1, axis2=2)) / 2
            information += PK.reshape(len(PK), -1) @ PK.swapaxes(1, 2).reshape(len(PK), -1).T / 2
        total = information + prior
        root = np.sqrt(np.diag(total))
        scaled = np.linalg.cholesky(total / np.outer(root, root) + 1e-9 * np.eye(root.size))
        right = np.linalg.solve(scaled, (information @ value + score) / root)
        updated = lsq_linear(scaled.T, right, (np.repeat([0.0, -np.inf], [count, root.size - count]), np.inf)).x / root
        updated[count:] = value[count:] + np.clip(updated[count:] - value[count:], -1.0, 1.0)
        value, density, covariance = updated, quiet.log_density.copy(), quiet.covariance.copy()
        density[free] += value[count:]
        covariance[np.ix_(free, free)] = np.linalg.inv(total)[count:, count:]
        new = {"pointing_power": value[:count], "log_density": density, "log_covariance": covariance}
        measured = measured.assign({name: measured[name].copy(data=data) for name, data in new.items()})
    return measured


def _basis_beside(baseline, tried):
    """Orthonormal basis (n, r) of baseline columns (n, k) and of what candidates (n, q) add to their space."""
    basis = least_squares.orthonormal(baseline)
    remainder = tried - basis @ (basis.T @ tried)
    remainder = remainder[:, np.linalg.norm(remainder, axis=0) > BESIDE * np.linalg.norm(tried, axis=0)]
    modes, values, _ = np.linalg.svd(remainder / np.linalg.norm(remainder, axis=0), full_matrices=False)
    return least_squares.orthonormal(np.column_stack([basis, modes[:, values > DEPENDENT * values.max(initial=0.0)]]))
