"""Recovery of the phase centres over simulated campaigns in memory, against their errors and the Cramer-Rao bound."""

import functools

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from benchmarks.tables import Figure, at_most, bias_figure, grid, of_tests, rms, rms_figure, show, study
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre.estimate import of_manoeuvres
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, PARAMETERS
from gravcal.estimation.least_squares import project_out
from gravcal.simulation import kbr_phase_centre as simulation

chain = of_tests("calibrations.kbr_campaign")
DAY = 653011200.0 - 43200.0
ORBIT_HZ, STEP_S = 1 / 5670.0, 5.0
ASKED_MM = {"x": 0.5, "y": 0.02, "z": 0.02}  # with benign noise
STATISTICS = OBSERVABLES, ESTIMATORS, PARAMETERS


def recovery(options) -> list[Figure]:
    """Errors, scatter and bias of all observables and estimators, accuracy."""
    words = f"kbr_phase_centre: {{}} campaigns, {options.settings.get('noise', 'default')} noise"
    found = study(options, 200, words, functools.partial(one, options.settings))
    (errors, sigmas, bounds), figures = found, []
    ratio = errors / sigmas
    rows = [("observable, estimator, parameter", "scatter um", "sigma um", "scatter/bound")]
    for at in np.ndindex(ratio[0].shape):
        name, own = " ".join(axis[k] for axis, k in zip(STATISTICS, at, strict=True)), (slice(None), *at)
        scatter, sigma = np.std(errors[own], ddof=1), sigmas[own].mean()
        least = bounds[:, at[2]].mean()
        rows.append((name, f"{1e3 * scatter:.3f}", f"{1e3 * sigma:.3f}", f"{scatter / least:.3f}"))
        figures.append(rms_figure(f"error/sigma {name}", ratio[own], ratio[0].size))
    grid(rows)
    every = ratio.reshape(len(ratio), -1)
    robust = np.mean(errors[:, :, 1].std(0) / errors[:, :, 0].std(0))
    figures += [
        bias_figure("largest bias/sigma", every[:, np.argmax(np.abs(every.mean(axis=0)))]),
        Figure("largest error/sigma", f"{np.abs(ratio).max():.1f}"),
        Figure("scatter of robust over least squares, mean", f"{robust:.3f}"),
    ]
    asked = ASKED_MM if options.settings.get("noise") == "benign" else dict.fromkeys(ASKED_MM)
    axes = rms(errors[:, :, 0]).max(axis=0).reshape(2, 3).max(axis=0)
    for (axis, limit), value in zip(asked.items(), axes, strict=True):
        figures.append(at_most(f"rms error {axis}, worst observable", value, limit, " mm"))
    return show(figures, "std. error")


def one(settings: dict, seed: int) -> tuple:
    """Errors and sigmas (observable, estimator, parameter), bound (parameter), mm."""
    invented = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0} | settings)
    invented = simulation.with_noise(invented)
    columns, truth = simulation.simulate("CD", invented, DAY, 10_000 + seed, {})
    made = chain.process(columns)
    error = 1e3 * made.combined["centre"].values[:, 0] - chain.true_mm(truth)
    variance = np.diagonal(made.combined["covariance"].values[:, 0], axis1=-2, axis2=-1)
    return error, 1e3 * np.sqrt(variance), 1e3 * bound(made.equations[0], invented)


def true_lags(invented, step):
    """Covariances by lag of the simulated noise: ranging with orbit, and pointing."""
    frequency = noises.images(step)
    ranging = invented.ranging_noise_m**2 * noises.passed(step).sum(axis=0)
    if invented.orbit_red_m > 0:
        steep = np.maximum(frequency / 1e-3, 0.3) ** -invented.orbit_red_slope
        ranging = ranging + (2 * (invented.orbit_red_m * steep) ** 2 * noises.passed(step)).sum(axis=0)
    keep = np.exp(-1 / invented.star_camera_slow_s)
    slow = 2 * (1 - keep**2) / (1 + keep**2 - 2 * keep * np.cos(2 * np.pi * frequency))
    pointing = slow * invented.star_camera_slow_rad**2 + 2 * invented.star_camera_white_rad**2
    pointing = invented.noise_scale**2 * pointing * noises.passed(step)
    return noises.lags_of_densities(ranging, pointing, step, 0, 800)


def bound(equations, invented):
    """Cramer-Rao bound (6,) m: true noise, and per wiggle a bias, 1 and 2 cycles per revolution."""
    true = true_lags(invented, STEP_S)

    def slow(time_, _):
        phase = 2 * np.pi * ORBIT_HZ * (time_ - time_[0])
        return np.column_stack([np.ones_like(phase), *(f(n * phase) for n in (1, 2) for f in (np.cos, np.sin))])

    return scatter(equations, true, true, slow)


def exact_scatter(equations, measured, invented, degree):
    """Scatter (6,) m of the least-squares estimate from the range, without draws: its weights under the true noise."""
    slow = functools.partial(noises.slow_columns, degree=degree, derivative=0)
    return scatter(equations, noises.lags(measured, 0, 800), true_lags(invented, STEP_S), slow)


def scatter(equations, assumed, true, slow):
    """Scatter (6,) m of least squares weighted by assumed covariances by lag, under true ones; slow columns free."""
    time_, lever, segment = (equations[n].values for n in ("time_kbr", "lever", "segment"))
    normal, spread = np.zeros((6, 6)), np.zeros((6, 6))
    for index in of_manoeuvres(equations):
        place = np.rint((time_[index] - time_[index[0]]) / STEP_S).astype(int)
        matrix = noises.covariance_matrix(assumed, place, lever[index])
        factor = cholesky(matrix, lower=True)
        columns = np.column_stack([equations["column"].values[index], slow(time_[index], segment[index])])
        white = solve_triangular(factor, columns, lower=True)
        clean = project_out(white[:, 6:], white[:, :6])
        weights = solve_triangular(factor, clean, lower=True, trans=1)
        noise = noises.covariance_matrix(true, place, lever[index])
        normal += clean.T @ clean
        spread += weights.T @ (np.tril(noise) + np.tril(noise, -1).T) @ weights
    inverse = np.linalg.inv(normal)
    return np.sqrt(np.diag(inverse @ spread @ inverse))
