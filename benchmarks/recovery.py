"""Recovery of an invented centre-of-mass offset, against its error and the Cramer-Rao bound; of star-camera heads."""

import functools
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

from benchmarks.tables import Figure, bias_figure, of_tests, rms_figure, say, scatter_figure, show, study
from gravcal import catalog
from gravcal.estimation.least_squares import project_out
from gravcal.physics import sensing
from gravcal.simulation import sensors

chain = of_tests("com_offset_chain")
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
HELD = VARIANTS[:3]  # to the bound
DELAYS = {"acc": "timing.accelerometer_delay", "sca": "timing.star_camera_delay"}
DELAY_SIGMA_S = 0.1  # of the delays that are drawn for each event, the prior of the effects
FAMILY = 12 + 12 + 2  # rms, scatter, delays
DAY = 636292800.0  # s, 2020-03-01
LAGS = 2**17  # samples of the circle on which the spectrum is summed, long against any memory of the noise


def simulated(seed: int, effects: dict) -> tuple:
    """Records of an invented event, its truth, and the true motion of each span with its epochs."""
    motion, read = [], sensors.read_instruments

    def tapped(epochs, moving, *rest):
        motion.append((epochs.acc, moving.at(epochs.acc)))
        return read(epochs, moving, *rest)

    with mock.patch.object(sensors, "read_instruments", tapped), mock.patch.object(chain, "DAY", DAY):
        return *chain.event(seed, effects), motion


def recovery(options) -> list[Figure]:
    """Study of the first simulator, in memory."""
    words = f"recovery: com_offset, {{}} simulated events, offset 60 um and delays {DELAY_SIGMA_S} s (sigma) drawn"
    error, ratio, bound, late = study(options, 12 if options.quick else 200, words, one, options.seed)
    say(f"components not determined: {np.isnan(error).sum()} of {error.size}\n")
    each = [(f"{v} {a}", (slice(None), i, j), v in HELD) for i, v in enumerate(VARIANTS) for j, a in enumerate("xyz")]
    of_bound, delays = error / bound[:, None, :], [(f"delay {k}", late[:, i]) for i, k in enumerate(DELAYS)]
    figures = [rms_figure(f"error/sigma {name}, rms", ratio[at], FAMILY, judged=held) for name, at, held in each]
    figures = show(figures + [rms_figure(f"error/sigma {n}, rms", score, FAMILY) for n, score in delays], "std. error")
    scatter = [scatter_figure(name, of_bound[at], FAMILY, judged=held) for name, at, held in each]
    bias = [bias_figure(f"bias/sigma {n}", score) for n, score in [(n, ratio[at]) for n, at, _ in each] + delays]
    return figures + show(scatter, "std. error") + show(bias, "3 std. errors")


def one(seed: int) -> tuple:
    """Errors m, over sigma, bound and delays over sigma of an event; the delays are drawn from its seed too."""
    delay = DELAY_SIGMA_S * np.random.default_rng([seed, 7]).standard_normal(2)
    effects = {slug: {"delay": float(value)} for slug, value in zip(DELAYS.values(), delay, strict=True)}
    observed, truth, motion = simulated(seed, effects)
    made = chain.chain(observed)
    ratio, error = chain.errors(made["combine"], truth)
    late, sigma = ([float(made["attitude"][f"{k}_delay{name}"]) for k in DELAYS] for name in ("", "_sigma"))
    least = bound(truth, motion, made["align"].attrs.get("drift_degree", 2))
    return error, ratio, least, (late - delay) / sigma


def bound(truth: dict, motion: list, drift_degree: int) -> np.ndarray:
    """Smallest standard deviations (3,) m that an unbiased estimate of the offset of an event can have.

    From true motion at the true epochs, noise densities of the simulator and quantisation; nothing of the estimator is
    used. Unknown beside it: a polynomial of time per axis and manoeuvre, of the degree that the estimator takes.
    """
    chosen = catalog.parameters("simulate_com_offset")
    amplitudes = tuple(tuple(chosen.noise_scale * a for a in getattr(chosen, f"linear_noise_{x}")) for x in "xyz")
    rounding = tuple(step**2 / 12 for step in chain.SATELLITE["accelerometer_step"])
    interval = chain.SATELLITE["accelerometer_interval"]
    factors = _factors(tuple(chosen.noise_frequency_hz), amplitudes, rounding, interval)
    information = np.zeros((3, 3))
    for wave in truth["manoeuvres"]:
        inside = [(time >= wave["start"]) & (time < wave["stop"]) for time, _ in motion]
        (_, true), inside = max(zip(motion, inside, strict=True), key=lambda part: part[1].sum())
        design = -sensing.offset_tensor(true.rate_b[inside], true.rate_dot_b[inside], true.gradient_b[inside])
        count = len(design)
        drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), drift_degree)
        for axis in range(3):
            columns = np.concatenate([drift, design[:, axis]], axis=1)
            white = solve_triangular(factors[axis][:count, :count], columns, lower=True, check_finite=False)
            clean = project_out(white[:, : drift_degree + 1], white[:, drift_degree + 1 :])
            information += clean.T @ clean
    return np.sqrt(np.diag(np.linalg.inv(information)))


@functools.cache
def _factors(nodes, amplitudes, rounding, step, count=1850):
    """Cholesky factor of the covariance of samples, one an axis: amplitudes at nodes in Hz, rounding as a variance."""
    frequency = np.fft.rfftfreq(LAGS, step)
    factors = []
    for amplitude, variance in zip(amplitudes, rounding, strict=True):
        log = np.interp(np.log(np.maximum(frequency, nodes[0])), np.log(nodes), np.log(amplitude))
        correlation = np.fft.irfft(np.exp(2 * log))[:count] / (2 * step)
        correlation[0] += variance
        factors.append(cholesky(toeplitz(correlation), lower=True))
    return factors


def heads(options) -> list[Figure]:
    """Errors over sigma of bias and noise of star-camera heads; noise as measured, or drawn anew for two of them."""
    invented, figures = of_tests("calibrations.invented_heads"), []
    known = np.array(catalog.satellite("C").settings()["star_camera_head_noise"])
    for own in ((1, 2, 3), (1, 2), (1, 3), (2, 3)):
        every, rng = [], np.random.default_rng(options.seed)
        for seed in range(options.seed, options.seed + (options.runs or 30)):
            sigma = known.copy()
            if len(own) == 2:  # as those of the catalogue scatter
                sigma[:, :2] = np.exp(np.log(known[:, :2]).mean() + 0.45 * rng.standard_normal((3, 2)))
            with tempfile.TemporaryDirectory() as folder:
                every.append(invented.errors(Path(folder), own, seed, sigma))
        (names, *_), score, share = (np.array(part) for part in zip(*every, strict=True))
        bias, line = np.char.startswith(names, "bias"), np.char.find(names, "_z_") > 0
        kinds = {"bias": bias, "about the line of sight": line, "across": ~bias & ~line}
        for kind, which in kinds.items():
            low, high = (1e6 if kind == "bias" else 100) * np.quantile(np.median(share[:, which], axis=0), (0, 1))
            size = f", sigma {low:.2g} to {high:.2g} {'urad' if kind == 'bias' else '%'}"
            alone = kind != "across" or len(own) == 3  # of two heads one number is common to all
            figures.append(rms_figure(f"heads {own}, {kind}", score[:, which].ravel(), 12, size, judged=alone))
    return show(figures)
