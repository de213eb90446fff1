"""Recovery study and speed of kbr_phase_centre: python -m benchmarks.kbr_phase_centre [campaigns] [key=value ...].

Prints, over simulated campaigns in memory: error/sigma with its chi-square interval, bias, scatter against the
Cramer-Rao bound and the accuracy figures; then the time of one campaign. Beside the drawn scatter stands the exact
one of least squares: the covariance of its weights under the true noise, which needs no draws.
"""

import sys
import time

import numpy as np
from scipy import stats
from scipy.linalg import cholesky, solve_triangular

from flows.engine import one_thread
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre.estimate import of_manoeuvres
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, PARAMETERS
from gravcal.simulation import kbr_phase_centre as simulation
from tasks import kbr_phase_centre as stages

DAY = 653011200.0 - 43200.0
FILES = (("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D"))
ORBIT_HZ = 1 / 5670.0


def process(columns, chosen):
    """All products of one campaign in memory."""
    observed = simulation.ingested(columns)
    nominal = {"nominal_m": tuple(tuple(catalog.satellite(letter).com_to_antenna.value) for letter in "CD")}
    aligned = stages.align(*(observed[name] for name in FILES), **chosen.for_stage("align"))
    pointed = stages.pointing(aligned, **chosen.for_stage("pointing"), **nominal, given=())
    settings = chosen.for_stage("observable") | nominal
    equations = [stages.observable(aligned, pointed, variant=name, **settings) for name in OBSERVABLES]
    quiet = stages.noise(equations[0], **chosen.for_stage("noise"))
    settings = chosen.for_stage("solve") | nominal
    solved = [
        stages.solve(one, quiet, variant=name, **settings) for name, one in zip(OBSERVABLES, equations, strict=True)
    ]
    return equations, quiet, stages.combine(*solved, **chosen.for_stage("combine"))


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
    step, lags = 5.0, true_lags(invented, 5.0)
    time_, lever = equations["time_kbr"].values, equations["lever"].values
    total = np.zeros((6, 6))
    for index in of_manoeuvres(equations):
        t = time_[index] - time_[index[0]]
        phase = 2 * np.pi * ORBIT_HZ * t
        slow = [np.ones_like(t), np.cos(phase), np.sin(phase), np.cos(2 * phase), np.sin(2 * phase)]
        matrix = noises.covariance_matrix(lags, np.rint(t / step).astype(int), lever[index])
        clean, _ = projected(equations["column"].values[index], np.column_stack(slow), matrix)
        total += clean.T @ clean
    return np.sqrt(np.diag(np.linalg.inv(total)))


def exact_scatter(equations, measured, invented, degree):
    """Scatter (6,) m of the least-squares estimate from the range: its weights under the true noise."""
    step = 5.0
    assumed, true = noises.lags(measured, 0, 800), true_lags(invented, step)
    time_, lever, segment = (equations[n].values for n in ("time_kbr", "lever", "segment"))
    normal, spread = np.zeros((6, 6)), np.zeros((6, 6))
    for index in of_manoeuvres(equations):
        place = np.rint((time_[index] - time_[index[0]]) / step).astype(int)
        slow = noises.slow_columns(time_[index], segment[index], degree, 0)
        matrix = noises.covariance_matrix(assumed, place, lever[index])
        clean, factor = projected(equations["column"].values[index], slow, matrix)
        weights = solve_triangular(factor, clean, lower=True, trans=1)
        noise = noises.covariance_matrix(true, place, lever[index])
        normal += clean.T @ clean
        spread += weights.T @ (np.tril(noise) + np.tril(noise, -1).T) @ weights
    inverse = np.linalg.inv(normal)
    return np.sqrt(np.diag(inverse @ spread @ inverse))


def projected(column, slow, matrix):
    """Columns whitened by a covariance, the slow part projected out, and the Cholesky factor."""
    factor = cholesky(matrix, lower=True)
    white = solve_triangular(factor, np.column_stack([column, slow]), lower=True)
    basis = np.linalg.qr(white[:, 6:])[0]
    return white[:, :6] - basis @ (basis.T @ white[:, :6]), factor


def study(count, settings):
    """Errors, sigmas (count, observable, estimator, parameter), bounds, exact scatters (parameter), mm; seconds."""
    chosen = catalog.parameters("kbr_phase_centre")
    invented = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0} | settings)
    invented = simulation.with_noise(invented)
    errors, sigmas, bounds, exact, seconds = [], [], [], [], []
    for seed in range(count):
        columns, truth = simulation.simulate("CD", invented, DAY, 10_000 + seed, {})
        begin = time.perf_counter()
        equations, measured, combined = process(columns, chosen)
        seconds.append(time.perf_counter() - begin)
        true = np.concatenate([truth["phase_centre_mm"][letter] for letter in "CD"])
        errors.append(1e3 * combined["centre"].values[:, 0] - true)
        variance = np.diagonal(combined["covariance"].values[:, 0], axis1=-2, axis2=-1)
        sigmas.append(1e3 * np.sqrt(variance))
        bounds.append(1e3 * bound(equations[0], invented))
        if seed < 10:
            exact.append(1e3 * exact_scatter(equations[0], measured, invented, chosen.orbit_degree))
    return tuple(np.array(one) for one in (errors, sigmas, bounds, exact, seconds))


def main():
    """Run the study and print its tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    settings = dict(text.split("=", 1) for text in sys.argv[2:])
    with one_thread():
        errors, sigmas, bounds, exact, seconds = study(count, settings)
    z = errors / sigmas
    tests = z[0].size
    low, high = np.sqrt(stats.chi2.ppf([0.005 / tests, 1 - 0.005 / tests], count) / count)
    print(f"{count} campaigns, {settings or 'default noise'}; error/sigma rms has to lie in {low:.3f} .. {high:.3f}")
    print("observable          estimator  parameter  z rms   bias/sigma  scatter um  sigma um  scatter/bound")
    for i, observable in enumerate(OBSERVABLES):
        for k, estimator in enumerate(ESTIMATORS):
            for p, name in enumerate(PARAMETERS):
                own = errors[:, i, k, p]
                scatter, mean = np.std(own, ddof=1), np.mean(z[:, i, k, p])
                print(
                    f"{observable:19} {estimator:10} {name:10} {np.sqrt(np.mean(z[:, i, k, p] ** 2)):.3f}   "
                    f"{mean:+.3f}      {1e3 * scatter:8.3f}   {1e3 * sigmas[:, i, k, p].mean():8.3f}  "
                    f"{scatter / bounds[:, p].mean():.3f}"
                )
    ratio = exact / bounds[: len(exact)]
    print(
        f"exact scatter/bound of least squares, range: {ratio.min():.3f} to {ratio.max():.3f}, mean {ratio.mean():.3f}"
    )
    print(f"scatter of robust over least squares, mean {np.mean(errors[:, :, 1].std(0) / errors[:, :, 0].std(0)):.3f}")
    print(f"largest |bias/sigma| {np.abs(z.mean(axis=0)).max():.3f}; allowed 0.2 + {3 / np.sqrt(count):.3f}")
    rms = np.sqrt((errors[:, :, 0] ** 2).mean(axis=0)).max(axis=0).reshape(2, 3).max(axis=0)
    print(f"rms error, worst observable, least squares: x {rms[0]:.4f} mm, y {rms[1]:.5f} mm, z {rms[2]:.5f} mm")
    print(f"seconds for one campaign in memory: median {np.median(seconds):.2f}, worst {seconds.max():.2f}")


if __name__ == "__main__":
    main()
