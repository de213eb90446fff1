"""Recovery of an invented centre-of-mass offset, against its error and the Cramer-Rao bound; of star-camera heads."""

import datetime
import functools
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
from scipy import stats
from scipy.linalg import cholesky, solve_triangular, toeplitz

from benchmarks.tables import (
    FALSE_ALARM,
    Figure,
    bias_figure,
    cases,
    of_tests,
    rms_figure,
    say,
    show,
    title,
)
from gravcal import catalog
from gravcal.estimation.least_squares import without
from gravcal.physics import sensing
from gravcal.simulation import com_offset as simulation
from gravcal.simulation import sensors

chain = of_tests("com_offset_chain")
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
HELD_TO_BOUND = VARIANTS[:3]
DELAYS = {"acc": "timing.accelerometer_delay", "sca": "timing.star_camera_delay"}
DELAY_SIGMA_S = 0.1  # of the delays that are drawn for each event, the prior of the effects
FAMILY = 12 + 12 + 2  # rms, scatter, delays
LAGS = 2**17  # samples of the circle on which the spectrum is summed, long against any memory of the noise


def simulated(seed: int, effects: dict, **settings) -> tuple:
    """Records of an invented event, its truth, the true motion of each span with its epochs, and chosen parameters."""
    chosen = catalog.parameters("simulate_com_offset").with_settings(settings)
    day = (datetime.datetime.fromisoformat(chosen.date) - datetime.datetime(2000, 1, 1, 12)).total_seconds()
    motion, read = [], sensors.read_instruments

    def tapped(epochs, moving, *rest):
        motion.append((epochs.acc, moving.at(epochs.acc)))
        return read(epochs, moving, *rest)

    with mock.patch.object(sensors, "read_instruments", tapped):
        columns, truth = simulation.simulate(chain.SATELLITE, chosen, day, seed, effects)
    return {name: chain.ingested(name, columns[name]) for name in chain.ORDER}, truth, motion, chosen


def errors(combined, truth):
    """Errors and sigmas (4, 3) m of all variants."""
    sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=1, axis2=2))
    return combined["offset"].values - 1e-6 * np.asarray(truth["offset_um"]), sigma


def recovery(options) -> list[Figure]:
    """Study of the first simulator, in memory."""
    count = options.runs or (12 if options.quick else 200)
    seeds = range(options.seed, options.seed + count)
    title(f"recovery: com_offset, {count} simulated events, seeds {seeds[0]} to {seeds[-1]}")
    say(f"seven manoeuvres, offset 60 um and delays {DELAY_SIGMA_S} s (sigma) drawn for each event, divisors exact\n")
    rows = list(cases(one, seeds, options.workers))
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    say(f"components not determined: {np.isnan(table['error']).sum()} of {table['error'].size}\n")
    ratio, late = table["error"] / table["sigma"], table["delay"][..., 0] / table["delay"][..., 1]
    each = [(f"{v} {a}", i, j, v in HELD_TO_BOUND) for i, v in enumerate(VARIANTS) for j, a in enumerate("xyz")]
    figures = [rms_figure(f"error/sigma {n}, rms", ratio[:, i, j], FAMILY, judged=held) for n, i, j, held in each]
    figures += [rms_figure(f"error/sigma delay {k}, rms", late[:, i], FAMILY) for i, k in enumerate(DELAYS)]
    figures = show(figures, "std. error")
    bound = table["error"] / table["bound"][:, None, :]
    figures += show([scatter_figure(n, bound[:, i, j], judged=held) for n, i, j, held in each], "std. error")
    bias = [bias_figure(f"bias/sigma {n}", ratio[:, i, j]) for n, i, j, _ in each]
    bias += [bias_figure(f"bias/sigma delay {k}", late[:, i]) for i, k in enumerate(DELAYS)]
    return figures + show(bias, "3 std. errors")


def one(seed: int) -> dict:
    """Errors of one event of the simulator; the delays are drawn from its seed too."""
    delay = DELAY_SIGMA_S * np.random.default_rng([seed, 7]).standard_normal(2)
    effects = {slug: {"delay": float(value)} for slug, value in zip(DELAYS.values(), delay, strict=True)}
    observed, truth, motion, chosen = simulated(seed, effects)
    made = chain.chain(observed, igrf_generation=chosen.igrf_generation)
    combined, smoothed = made["combine"], made["attitude"]
    error, sigma = errors(combined, truth)
    late = [
        [float(smoothed[f"{k}_delay"]) - true, float(smoothed[f"{k}_delay_sigma"])]
        for k, true in zip(DELAYS, delay, strict=True)
    ]
    return {
        "bound": bound(truth, motion, chosen, made["align"].attrs.get("drift_degree", 2)),
        "error": error,
        "sigma": sigma,
        "delay": np.array(late),
    }


def bound(truth: dict, motion: list, chosen, drift_degree: int) -> np.ndarray:
    """Smallest standard deviations (3,) m that an unbiased estimate of the offset of an event can have.

    From true motion and true noise; nothing of the estimator is used. Known: rates, angular accelerations and gravity
    gradient as the simulator flew them, at the true epochs of the readings, inertia and dipole with them, the noise
    densities of the simulator and the quantisation. Every sample of the square wave counts (10 Hz, 180 s). Unknown
    beside the offset: a polynomial of time per axis and manoeuvre, of the degree that the estimator takes for the
    non-gravitational acceleration.
    """
    amplitudes = tuple(tuple(chosen.noise_scale * a for a in getattr(chosen, f"linear_noise_{x}")) for x in "xyz")
    rounding = tuple(step**2 / 12 for step in chain.SATELLITE["accelerometer_step"])
    interval = chain.SATELLITE["accelerometer_interval"]
    factors = _factors(tuple(chosen.noise_frequency_hz), amplitudes, rounding, interval)
    information = np.zeros((3, 3))
    for wave in truth["manoeuvres"]:
        design = _during(motion, wave["start"], wave["stop"])
        count = len(design)
        drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), drift_degree)
        for axis in range(3):
            columns = np.concatenate([drift, design[:, axis]], axis=1)
            white = solve_triangular(factors[axis][:count, :count], columns, lower=True, check_finite=False)
            clean = without(white[:, : drift_degree + 1], white[:, drift_degree + 1 :])
            information += clean.T @ clean
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _during(motion, start, stop):
    """Readings per metre of offset (n, 3, 3) between the first and the last edge."""
    inside = [(time >= start) & (time < stop) for time, _ in motion]
    (_, true), inside = max(zip(motion, inside, strict=True), key=lambda part: part[1].sum())
    return -sensing.offset_tensor(true.rate_b[inside], true.rate_dot_b[inside], true.gradient_b[inside])


@functools.cache
def _factors(nodes, amplitudes, rounding, step, count=1850):
    """Cholesky factor of the covariance of `count` samples, one an axis; its leading part serves fewer samples.

    Densities are given by amplitudes at nodes in Hz, for each axis; rounding is a variance.
    """
    frequency = np.fft.rfftfreq(LAGS, step)
    factors = []
    for amplitude, variance in zip(amplitudes, rounding, strict=True):
        log = np.interp(np.log(np.maximum(frequency, nodes[0])), np.log(nodes), np.log(amplitude))
        correlation = np.fft.irfft(np.exp(2 * log))[:count] / (2 * step)
        correlation[0] += variance
        factors.append(cholesky(toeplitz(correlation), lower=True))
    return factors


def scatter_figure(name: str, ratio: np.ndarray, *, judged: bool) -> Figure:
    """Scatter of errors over their lower bound (n,): at most 1.1, chance allowed for."""
    ratio = ratio[np.isfinite(ratio)]
    dof, value = ratio.size - 1, float(ratio.std(ddof=1))
    limit = 1.1 * np.sqrt(stats.chi2.ppf(1 - FALSE_ALARM / FAMILY, dof) / dof)
    error, name = f"+- {value / np.sqrt(2 * dof):.3f}", f"scatter/Cramer-Rao {name}"
    return Figure(name, f"{value:.3f}", error, *((f"<= 1.10 ({limit:.2f})", bool(value <= limit)) if judged else ()))


def heads(options) -> list[Figure]:
    """Errors over sigma of bias and noise of star-camera heads; noise as measured, or drawn anew for two of them."""
    study, figures = of_tests("calibrations.invented_heads"), []
    known = np.array(catalog.satellite("C").settings()["star_camera_head_noise"])
    across = slice(0, 2)
    for own in ((1, 2, 3), (1, 2), (1, 3), (2, 3)):
        every, rng = [], np.random.default_rng(options.seed)
        for seed in range(options.seed, options.seed + (options.runs or 30)):
            sigma = known.copy()
            if len(own) == 2:  # as those of the catalogue scatter
                sigma[:, across] = np.exp(np.log(known[:, across]).mean() + 0.45 * rng.standard_normal((3, 2)))
            with tempfile.TemporaryDirectory() as folder:
                every.append(study.errors(Path(folder), own, seed, sigma))
        names = np.array(every[0][0])
        score, share = (np.array([one[k] for one in every]) for k in (1, 2))
        bias, line = np.char.startswith(names, "bias"), np.char.find(names, "_z_") > 0
        kinds = {"bias": bias, "about the line of sight": line, "across": ~bias & ~line}
        for kind, which in kinds.items():
            low, high = (1e6 if kind == "bias" else 100) * np.quantile(np.median(share[:, which], axis=0), (0, 1))
            size = f", sigma {low:.2g} to {high:.2g} {'urad' if kind == 'bias' else '%'}"
            alone = kind != "across" or len(own) == 3  # of two heads one number is common to all
            figures.append(rms_figure(f"heads {own}, {kind}", score[:, which].ravel(), 12, size, judged=alone))
    return show(figures)
