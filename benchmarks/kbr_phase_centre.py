"""Recovery of the phase centres over simulated campaigns in memory, against their errors and the Cramer-Rao bound.

Beside the drawn scatter stands the exact one of least squares: the covariance of its weights under the true noise,
which needs no draws.
"""

import functools
import time

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from benchmarks.tables import Figure, at_most, bias_figure, cases, grid, of_tests, rms, rms_figure, show, title
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre.estimate import of_manoeuvres
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, PARAMETERS
from gravcal.estimation.least_squares import without
from gravcal.simulation import kbr_phase_centre as simulation

chain = of_tests("calibrations.kbr_campaign")
DAY = 653011200.0 - 43200.0
ORBIT_HZ, STEP_S = 1 / 5670.0, 5.0
ASKED_MM = {"x": 0.5, "y": 0.02, "z": 0.02}  # with benign noise
EXACT = 10  # campaigns of which the exact scatter is computed


def recovery(options) -> list[Figure]:
    """Errors, scatter and bias of all observables and estimators, accuracy, time of one campaign."""
    count = options.runs or 200
    title(f"kbr_phase_centre: {count} campaigns, {options.settings or 'default noise'}")
    found = list(zip(*cases(functools.partial(one, options.settings), range(count), options.workers), strict=True))
    errors, sigmas, bounds, exact, seconds = (np.array(part) for part in found)
    ratio, figures = errors / sigmas, []
    rows = [("observable, estimator, parameter", "scatter um", "sigma um", "scatter/bound")]
    for (i, k, p), name in np.ndenumerate(names()):
        scatter, sigma = np.std(errors[:, i, k, p], ddof=1), sigmas[:, i, k, p].mean()
        rows.append((name, f"{1e3 * scatter:.3f}", f"{1e3 * sigma:.3f}", f"{scatter / bounds[:, p].mean():.3f}"))
        figures.append(rms_figure(f"error/sigma {name}", ratio[:, i, k, p], ratio[0].size))
    grid(rows)
    worst = max(range(ratio[0].size), key=lambda n: abs(ratio.reshape(count, -1)[:, n].mean()))
    over = (exact / bounds)[:EXACT]
    robust = np.mean(errors[:, :, 1].std(0) / errors[:, :, 0].std(0))
    axes = rms(errors[:, :, 0]).max(axis=0).reshape(2, 3).max(axis=0)
    benign = options.settings.get("noise") == "benign"
    accuracy = at_most if benign else lambda name, value, _, unit: Figure(name, f"{value:.3g}{unit}")
    return show(
        [
            *figures,
            bias_figure("largest bias/sigma", ratio.reshape(count, -1)[:, worst]),
            Figure("largest error/sigma", f"{np.abs(ratio).max():.1f}"),
            Figure("exact scatter/bound of range", f"{over.mean():.3f}", f"{over.min():.3f} .. {over.max():.3f}"),
            Figure("scatter of robust over least squares, mean", f"{robust:.3f}"),
            *(
                accuracy(f"rms error {a}, worst observable", v, ASKED_MM[a], " mm")
                for a, v in zip("xyz", axes, strict=True)
            ),
            Figure("one campaign in memory", f"{np.median(seconds):.2f} s", f"worst {seconds.max():.2f} s"),
        ],
        "std. error",
    )


def names() -> np.ndarray:
    """Names (observable, estimator, parameter) of the statistics."""
    return np.array([[[f"{o} {e} {p}" for p in PARAMETERS] for e in ESTIMATORS] for o in OBSERVABLES])


def one(settings: dict, seed: int) -> tuple:
    """Errors and sigmas (observable, estimator, parameter), bound and exact scatter (parameter), mm; seconds."""
    invented = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0} | settings)
    invented = simulation.with_noise(invented)
    columns, truth = simulation.simulate("CD", invented, DAY, 10_000 + seed, {})
    begin = time.perf_counter()
    made = chain.process(columns)
    seconds = time.perf_counter() - begin
    error = 1e3 * made.combined["centre"].values[:, 0] - chain.true_mm(truth)
    variance = np.diagonal(made.combined["covariance"].values[:, 0], axis1=-2, axis2=-1)
    degree = catalog.parameters("kbr_phase_centre").orbit_degree
    exact = exact_scatter(made.equations[0], made.noise, invented, degree) if seed < EXACT else np.full(6, np.nan)
    return error, 1e3 * np.sqrt(variance), 1e3 * bound(made.equations[0], invented), 1e3 * exact, seconds


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
    """Scatter (6,) m of the least-squares estimate from the range: its weights under the true noise."""
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
        clean = without(white[:, 6:], white[:, :6])
        weights = solve_triangular(factor, clean, lower=True, trans=1)
        noise = noises.covariance_matrix(true, place, lever[index])
        normal += clean.T @ clean
        spread += weights.T @ (np.tril(noise) + np.tril(noise, -1).T) @ weights
    inverse = np.linalg.inv(normal)
    return np.sqrt(np.diag(inverse @ spread @ inverse))
