"""The published processing on invented truth: what it gets wrong.

Every number of docs/published_methods.md: each calibration is simulated, processed as printed and as gravcal does it,
and both are compared with the truth behind the records.
"""

import numpy as np

from benchmarks import gradient_torque as gradient
from benchmarks import inertial_sensor as inertial
from benchmarks import kbr_phase_centre as kbr
from benchmarks import recovery
from benchmarks.tables import Figure, numbers, rms, show, title
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES
from gravcal.simulation import kbr_phase_centre as simulation

DELAY_S = 0.3  # of the accelerometer's tags, a plausible one
METHODS = ("published", "gravcal")
SUBSETS = ("all", "positive", "mirror")


def published_methods(options) -> list[Figure]:
    """A table of each calibration, or of one."""
    parts = {one.__name__: one for one in (com_offset, kbr_phase_centre, inertial_sensor, gradient_torque)}
    for name in [options.calibration] if options.calibration else parts:
        parts[name](options.runs or 4)
    return []


def com_offset(runs) -> dict:
    """C-7, C-9, C-10, C-12: row selection, errors, orbital period, a delay that is not estimated."""
    title(f"com_offset, {runs} events, accelerometer tags {DELAY_S} s late: rms error um, rms error/sigma; x y z")
    found = {method: [] for method in METHODS}
    for seed in range(1, runs + 1):
        observed, truth, _, chosen = recovery.simulated(seed, {"timing.accelerometer_delay": {"delay": DELAY_S}})
        for method, kept in found.items():
            extra = {"dynamics": "published"} if method == "published" else {}
            settings = {"method": method, "igrf_generation": chosen.igrf_generation} | extra
            kept.append(recovery.errors(recovery.chain.chain(observed, **settings)["combine"], truth))
    summary = {}
    for method, kept in found.items():
        error, sigma = (np.array(part) for part in zip(*kept, strict=True))
        for k, variant in enumerate(recovery.VARIANTS):
            summary[method, variant] = 1e6 * rms(error[:, k]), rms(error[:, k] / sigma[:, k])
    conditions = {
        ("condition of the Fourier columns in 180 s",): (np.linalg.cond(fourier(97.13 * 60)),),
        ("condition of constant, linear, quadratic",): (np.linalg.cond(quadratic()),),
    }
    return table(summary | conditions)


def table(summary: dict) -> dict:
    """Print values by their names, and return them."""
    show([Figure(" ".join(names), *(numbers(one, ".4g") for one in values)) for names, values in summary.items()])
    return summary


def fourier(period_s):
    """Constant and orbital harmonics over one manoeuvre, with the signal, eq. 32 (erratum C-7)."""
    time = np.arange(0.0, 180.0, 0.1)
    phase = 2 * np.pi * time / period_s
    wave = np.sign(np.sin(2 * np.pi * time / 12))
    return np.stack([wave, np.ones_like(time), *(f(n * phase) for n in (1, 2) for f in (np.sin, np.cos))], axis=1)


def quadratic():
    """What stands for them: constant, linear and quadratic, with the signal."""
    time = np.linspace(-1, 1, 1800)
    return np.stack([np.sign(np.sin(2 * np.pi * 7.5 * time)), np.ones_like(time), time, 1.5 * time**2 - 0.5], axis=1)


def kbr_phase_centre(runs, noises=("measured", "benign")) -> dict:
    """K-2, K-3, K-9: one-sided sets, columns not detrended, formal errors of robust weights."""
    summary = {}
    for noise in noises:
        title(f"kbr_phase_centre, {noise} noise, {runs} campaigns: rms error mm, rms error/sigma; x y z of C and D")
        settings = {"phase_step_s": 1.0, "noise": noise}
        invented = catalog.parameters("simulate_kbr_phase_centre").with_settings(settings)
        found = {method: [] for method in METHODS}
        for seed in range(runs):
            columns, truth = simulation.simulate("CD", invented, kbr.DAY, 20_000 + seed, {})
            for method, kept in found.items():
                combined = kbr.chain.process(columns, method=method).combined
                sigma = 1e3 * np.sqrt(np.diagonal(combined["covariance"].values, axis1=-2, axis2=-1))
                kept.append((1e3 * combined["centre"].values - kbr.chain.true_mm(truth), sigma))
        made = {}
        for method, kept in found.items():
            error, sigma = (np.array(part) for part in zip(*kept, strict=True))
            for i, s, k in np.ndindex(len(OBSERVABLES), len(SUBSETS), len(ESTIMATORS)):
                name = method, OBSERVABLES[i], ESTIMATORS[k], SUBSETS[s]
                made[name] = rms(error[:, i, s, k]), rms(error[:, i, s, k] / sigma[:, i, s, k])
        table(made)
        summary |= {(noise, *name): values for name, values in made.items()}
    return summary


def inertial_sensor(runs) -> dict:
    """T-4: scale factors of the linear axes from angular ones with the factor one half."""
    title(f"inertial_sensor, {runs} swings: k x y z over truth, mean; rms error of the offset um x y z")
    chosen, summary = inertial.invented("swing"), {}
    for method in METHODS:
        settings = catalog.parameters("inertial_sensor").with_settings({"method": method})
        kept = []
        for seed in range(runs):
            truth, _, scaled, moved = inertial.swing(3000 + seed, chosen, settings)
            known = np.asarray(truth.k)
            kept.append((scaled["k"].values[1] / known, moved["offset"].values[1] - truth.offset))  # arm 10.45 mm
        k, error = (np.array(part) for part in zip(*kept, strict=True))
        summary[(method,)] = k.mean(axis=0), 1e6 * rms(error)
    return table(summary)


def gradient_torque(runs) -> dict:
    """S-6, S-8: drag with one sensor by quaternions is the plain reading; places exact, or off by their error."""
    title(f"gradient_torque, {runs} days: rms error of the drag m s-2; x y z")
    found = {}
    for scatter, places in ((0.0, "places exact"), (1.0, "places with their error")):
        for seed in range(runs):
            modelled, truth = gradient.simulated(seed, position_scatter=scatter)
            for name in gradient.VARIANTS:
                error = gradient.dragged(modelled, name)["drag_b"].values - truth["drag"]
                found.setdefault((name, places), []).append(rms(error))
    return table({name: (rms(kept),) for name, kept in found.items()})
