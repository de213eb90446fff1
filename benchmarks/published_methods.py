"""The published processing on invented truth: what it gets wrong. python -m benchmarks.published_methods [--runs 4].

Every number of docs/published_methods.md: each calibration is simulated, processed as printed and as gravcal does it,
and both are compared with the truth behind the records.
"""

import argparse

from flows.engine import single_threaded

single_threaded()

import numpy as np  # noqa: E402

from gravcal import catalog  # noqa: E402

PARTS = ("com_offset", "kbr_phase_centre", "inertial_sensor", "gradient_torque")
DELAY_S = 0.3  # of the accelerometer's tags, a plausible one


def rms(values, axis=0):
    """Root mean square, NaN left out."""
    return np.sqrt(np.nanmean(np.square(values), axis=axis))


def line(name, *parts):
    """One line of a table."""
    print(f"  {name:46} " + "  ".join(parts))


def numbers(values, form="{:9.3g}"):
    """Numbers side by side."""
    return " ".join(form.format(v) for v in np.atleast_1d(values))


def com_offset(runs):
    """C-7, C-9, C-10, C-12: row selection, errors, orbital period, a delay that is not estimated."""
    from benchmarks import events

    effects = {"timing.accelerometer_delay": {"delay": DELAY_S}}
    found = {"published": [], "gravcal": []}
    for seed in range(1, runs + 1):
        event = events.simulated(seed, effects)
        truth = 1e-6 * np.asarray(event.truth["offset_um"])
        for method, kept in found.items():
            extra = {"method": method} | ({"dynamics": "published"} if method == "published" else {})
            made = events.calibrated(event, **extra)
            combined = next(v for k, v in made.items() if k.startswith("com_offset.combine"))
            sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=1, axis2=2))
            kept.append((combined["offset"].values - truth, sigma))
    print(f"com_offset, {runs} events, accelerometer tags {DELAY_S} s late: rms error um, rms error/sigma; x y z")
    summary = {}
    for method, kept in found.items():
        error, sigma = (np.array(part) for part in zip(*kept, strict=True))
        for k, variant in enumerate(("mtq", "acc_calibrated", "acc", "sca")):
            ratio = rms(error[:, k] / sigma[:, k])
            line(f"{method} {variant}", numbers(1e6 * rms(error[:, k])), numbers(ratio))
            summary[method, variant] = (1e6 * rms(error[:, k]), ratio)
    columns = fourier(97.13 * 60)
    line("condition of the Fourier columns in 180 s", f"{np.linalg.cond(columns):.2g}")
    line("condition of constant, linear, quadratic", f"{np.linalg.cond(quadratic()):.2g}")
    return summary | {"condition": (np.linalg.cond(columns), np.linalg.cond(quadratic()))}


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


def kbr_phase_centre(runs, noise=""):
    """K-2, K-3, K-9: one-sided sets, columns not detrended, formal errors of robust weights; without noise both."""
    if not noise:
        return {name: kbr_phase_centre(runs, name) for name in ("measured", "benign")}
    from benchmarks import kbr_phase_centre as study
    from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES
    from gravcal.simulation import kbr_phase_centre as simulation

    settings = {"phase_step_s": 1.0, "noise": noise}
    invented = catalog.parameters("simulate_kbr_phase_centre").with_settings(settings)
    found = {"published": [], "gravcal": []}
    for seed in range(runs):
        columns, truth = simulation.simulate("CD", invented, study.DAY, 20_000 + seed, {})
        true = np.concatenate([truth["phase_centre_mm"][letter] for letter in "CD"])
        for method, kept in found.items():
            chosen = catalog.parameters("kbr_phase_centre").with_settings({"method": method})
            *_, combined = study.process(columns, chosen)
            sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=-2, axis2=-1))
            kept.append((1e3 * combined["centre"].values - true, 1e3 * sigma))
    print(f"kbr_phase_centre, {noise} noise, {runs} campaigns: rms error mm, rms error/sigma; x y z of C and D")
    summary = {}
    for method, kept in found.items():
        error, sigma = (np.array(part) for part in zip(*kept, strict=True))
        for i, observable in enumerate(OBSERVABLES):
            for k, estimator in enumerate(ESTIMATORS):
                for s, subset in enumerate(("all", "positive", "mirror")):
                    e, z = error[:, i, s, k], sigma[:, i, s, k]
                    line(f"{method} {observable} {estimator} {subset}", numbers(rms(e)), numbers(rms(e / z)))
                    summary[method, observable, estimator, subset] = (rms(e), rms(e / z), z.mean(axis=0))
    return summary


def inertial_sensor(runs):
    """T-4: scale factors of the linear axes from angular ones with the factor one half."""
    from benchmarks import inertial_sensor as study

    chosen = catalog.parameters("simulate_inertial_sensor")
    found = {"published": [], "gravcal": []}
    for seed in range(runs):
        for method, kept in found.items():
            settings = catalog.parameters("inertial_sensor").with_settings({"method": method})
            truth, _, scaled, moved = study.swing(3000 + seed, chosen, settings)
            known = np.asarray(truth.k)
            kept.append((scaled["k"].values[1] / known, moved["offset"].values[1] - truth.offset))  # arm 10.45 mm
    print(f"inertial_sensor, {runs} swings: k x y z over truth, mean; rms error of the offset um x y z")
    summary = {}
    for method, kept in found.items():
        k, error = (np.array(part) for part in zip(*kept, strict=True))
        k, offset = k.mean(axis=0), 1e6 * rms(error)
        line(method, numbers(k, "{:7.3f}"), numbers(offset))
        summary[method] = (k, offset)
    return summary


def gradient_torque(runs):
    """S-6, S-8: drag with one sensor by quaternions is the plain reading."""
    exact = _drags(runs, 0.0)
    return exact | {f"{name}, places with their error": value for name, value in _drags(runs, 1.0).items()}


def _drags(runs, scatter):
    """Errors of three methods; places of the sensors exact, or off by their catalogued error."""
    from benchmarks import gradient_torque as study
    from gravcal.calibrations.gradient_torque import estimate, model
    from gravcal.io import icgem
    from gravcal.simulation import gradient_torque as simulation

    satellite, field = catalog.satellite("S").settings(), icgem.read_field(icgem.shipped(), 60)
    chosen, found = catalog.parameters("gradient_torque"), {}
    for seed in range(runs):
        flown = {"step_s": 5.0, "position_scatter": scatter}
        settings = catalog.parameters("simulate_gradient_torque").with_settings(flown)
        columns, truth = simulation.simulate(satellite, settings, field, study.DAY, seed)
        observed = study.as_dataset(columns)
        options = chosen.for_stage("gradient")
        modelled = model.gradient(observed, model.field(field), satellite=satellite, **options)
        for name in ("one_sensor_published", "one_sensor", "two_sensor"):
            one = estimate.drag(modelled, variant=name, satellite=satellite, **chosen.for_stage("drag"))
            found.setdefault(name, []).append(rms(one["drag_b"].values - truth["drag"]))
    print(f"gradient_torque, {runs} days, places off by {scatter:g} sigma: rms error of the drag m s-2; x y z")
    for name, kept in found.items():
        line(name, numbers(rms(np.array(kept))))
    return {name: rms(np.array(kept)) for name, kept in found.items()}


def main():
    """Print every table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="CALIBRATION", help=f"of {', '.join(PARTS)}; all by default")
    parser.add_argument("--runs", type=int, default=4)
    given = parser.parse_args()
    for name in given.parts or PARTS:
        globals()[name](given.runs)


if __name__ == "__main__":
    main()
