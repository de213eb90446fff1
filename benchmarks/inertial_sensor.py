"""Recovery study and long roll of inertial_sensor: python -m benchmarks.inertial_sensor [swings] [rolls] [long DIR].

`bound` prints the Cramer-Rao bound of the offset beside the printed errors, and how well a swing shows k_y.

Prints, over simulated swings and rolls in memory: error/sigma with its chi-square interval, bias, scatter against the
Cramer-Rao bound, and the accuracy figures. With `long DIR`, the files of a roll of 1.6e6 s are written to DIR (1.3 GB,
kept) and processed: wall time, processor time and largest memory.
"""

import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import stats

from flows.inertial_sensor import assumed, geometry
from gravcal import catalog
from gravcal.calibrations.inertial_sensor import align, bias
from gravcal.calibrations.inertial_sensor import model as fits
from gravcal.calibrations.inertial_sensor.estimate import fit_offset, offset, record_of, scale, swing_of
from gravcal.estimation.noise import NoiseModel
from gravcal.simulation import inertial_sensor as simulation

START = 706190400.0
SWING = ("beta_x", "beta_y", "delay", "offset_x", "offset_y", "offset_z")
OFFSET_SIGMA = np.array([19e-6, 15e-6, 19e-6])  # m, of the offset that a swing hands to the roll
CALM = 0.05  # share of the noise in the motion from which the bound is computed; its square is what remains


def swing(seed, chosen, settings):
    """Truth, aligned record and products of one swing."""
    rng = np.random.default_rng(seed)
    truth = simulation.draw(catalog.satellite("T").settings(), chosen, rng)
    record = simulation.swing(chosen, START, truth, rng)
    found = align.detect(lambda: record["ATT"], **settings.for_stage("detect"))
    readers = [lambda *_, name=name: record[name] for name in ("IS1", "ATT", "ORB")]
    aligned = align.align(found, *readers, **settings.for_stage("align"))
    scaled = scale(aligned, geometry=geometry(), **settings.for_stage("scale"))
    return truth, aligned, scaled, offset(aligned, scaled, **settings.for_stage("offset"))


def errors(truth, scaled, moved):
    """Errors and sigmas (6,) in the order of SWING."""
    error = np.concatenate(
        [
            scaled.beta.values[:2] - truth.beta[:2],
            [float(scaled.delay) - truth.delay],
            moved.offset.values[0] - truth.offset,
        ]
    )
    sigma = np.sqrt(np.diag(moved.covariance.values[0]))
    return error, np.concatenate([scaled.beta_sigma.values[:2], [float(scaled.delay_sigma)], sigma])


def bound(seed, chosen, settings):
    """Cramer-Rao bound (6,): motion without noise, true noise in the covariance."""
    names = ("voltage_noise_v_rthz", "acceleration_noise_m_s2_rthz", "tracker_noise_rad", "spikes_per_hour")
    calm = {name: CALM * getattr(chosen, name) for name in names}
    truth, aligned, scaled, _ = swing(seed, chosen.with_settings(calm), settings)
    step = settings.bin_s
    volt = chosen.voltage_noise_v_rthz**2 / (2 * step)
    still = swing_of(aligned, step, settings.quiet_margin_s, truth.inertia)
    known = np.array([2.0, 2.0, 6.0]) * volt, np.full(3, chosen.tracker_noise_rad**2)
    fitted = fits.fit(replace(still, voltage_variance=known[0], tracker_variance=known[1]), truth.beta[:2])
    record = record_of(aligned, scaled, settings.quiet_margin_s, settings.drift_degree, 0)
    parasitic = chosen.acceleration_noise_m_s2_rthz**2 / (2 * step) / truth.k**2
    noise = tuple(NoiseModel(np.zeros(0), np.array([v]), step) for v in np.array([6.0, 1.0, 2.0]) * volt + parasitic)
    moved = fit_offset(replace(record, noise=noise), truth.k)
    return np.sqrt(np.concatenate([np.diag(fitted.covariance)[:3], np.diag(moved.covariance)]))


def roll(seed, chosen, settings):
    """Errors and sigmas of the bias of one roll: of the scatter alone, and with an offset that has its error."""
    rng = np.random.default_rng(seed)
    truth = simulation.draw(catalog.satellite("T").settings(), chosen, rng)
    flown = simulation.draw_roll(chosen, START, rng)
    record = simulation.span(chosen, flown, (flown.start, flown.stop), truth, rng)
    reduced = align.reduced(record["IS1"], record["ATT"], record["ORB"], settings.step_s)
    limits = bias.Limits(settings.step_s, settings.segment_s, settings.uniformity_limit, settings.share_limit)
    model = bias.Model(settings.trend_degree, settings.amplitude_degree, settings.amplitude_harmonics)
    used = truth.offset + OFFSET_SIGMA * rng.standard_normal(3)
    zero, held = np.zeros((3, 3)), np.diag(OFFSET_SIGMA**2)
    out = []
    for place, covariance in ((truth.offset, zero), (used, held)):
        sensor = bias.Sensor(truth.k, 0 * truth.k, place, covariance, covariance)
        solved = bias.solve(reduced, sensor, model, limits)
        found = bias.estimates(solved, sensor)
        inside = solved.time[:, None] + settings.segment_s * np.linspace(-0.5, 0.5, 101)  # of all segments, see sigma
        drift = np.array([np.interp(inside, flown.knot, column).mean() for column in flown.drift.T])
        true = truth.bias + drift - np.array([0.0, chosen.radiation_m_s2, 0.0])
        out.append((found["bias"] - true, found["bias_sigma"], np.abs(truth.bias)))
    return out, int(np.count_nonzero(solved.used))


def line(name, ratio, extra=""):
    """Statistics of error over sigma of one parameter."""
    n = ratio.size
    low, high = (np.sqrt(stats.chi2.ppf(p, n) / n) for p in (0.005 / 12, 1 - 0.005 / 12))
    rms = np.sqrt(np.mean(ratio**2))
    print(
        f"{name:12s} error/sigma rms {rms:.3f} (allowed {low:.3f} to {high:.3f})  mean {ratio.mean():+.3f}{extra}",
        flush=True,
    )
    return rms, (low, high)


def study_swings(count, bounds=10, **changes):
    """Print the study of the swings; the statistics by name."""
    chosen = catalog.parameters("simulate_inertial_sensor").with_settings({"manoeuvre": "swing"} | changes)
    settings = catalog.parameters("inertial_sensor")
    rows = [swing(seed, chosen, settings) for seed in range(count)]
    pairs = np.array([errors(truth, scaled, moved) for truth, _, scaled, moved in rows])
    best = np.array([bound(seed, chosen, settings) for seed in range(min(bounds, count))])
    least = np.sqrt(np.mean(best**2, axis=0))
    size = np.abs([*rows[0][0].beta[:2], np.nan, *1e-6 * np.array(chosen.offset_um)])
    out = {}
    for i, name in enumerate(SWING):
        error, sigma = pairs[:, 0, i], pairs[:, 1, i]
        extra = (
            f"  scatter/bound {np.sqrt(np.mean(error**2)) / least[i]:.3f}  sigma/bound {sigma.mean() / least[i]:.3f}"
        )
        extra += f"  sigma {sigma.mean():.3g}" + (f" = {100 * sigma.mean() / size[i]:.2f} %" if size[i] > 0 else "")
        out[name] = (*line(name, error / sigma, extra), np.sqrt(np.mean(error**2)) / least[i], sigma.mean() / size[i])
    worst = max(agreement(scaled) for _, _, scaled, _ in rows)
    print(f"Kalman filter minus batch least squares at the end: at most {worst:.1e} sigma")
    return out


def agreement(scaled):
    """Largest difference of filter and batch in standard deviations."""
    return float(
        np.max(np.abs(scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1])
    )


def study_rolls(count, segments_each=20, **changes):
    """Print the study of the rolls; the statistics by name."""
    base = {"manoeuvre": "roll", "roll_s": 2500.0 * segments_each + 500.0}
    chosen = catalog.parameters("simulate_inertial_sensor").with_settings(base | changes)
    settings = catalog.parameters("inertial_sensor")
    rows = [roll(seed, chosen, settings) for seed in range(count)]
    out = {}
    for number, kind in enumerate(("offset exact", "offset drawn")):
        pairs = np.array([row[0][number] for row in rows])
        for axis, letter in enumerate("xyz"):
            error, sigma, size = pairs[:, :, axis].T
            extra = f"  sigma {sigma.mean():.2e} m s-2 = {100 * np.mean(sigma / size):.5f} %, {kind}"
            out[letter, kind] = (*line(f"bias_{letter}", error / sigma, extra), np.mean(sigma / size))
    print(f"{sum(row[1] for row in rows)} segments used in {count} rolls; y is b - a, not separable")
    return out


def study_long(folder):
    """Write a roll of 1.6e6 s, then detect, reduce and solve it; prints time and memory of the processing alone."""
    from flows import inertial_sensor as flow

    folder = Path(folder)
    if not any(folder.glob("IS1*")):
        flow.CALIBRATION.simulate(
            folder, seed=1, truth=None, effects={}, settings={"manoeuvre": "roll", "roll_s": "1.6e6"}
        )
        print("files written; run again to measure the processing alone")
        return
    process(folder)


def process(folder):
    """Detect, segment and bias of all files of a folder, without the store."""
    from gravcal.io import daily

    settings = catalog.parameters("inertial_sensor")
    days = daily.days(folder)
    started, spent = time.perf_counter(), time.process_time()
    found = align.detect(*(daily.loader(d["ATT"]) for d in days.values()), **settings.for_stage("detect"))
    files = [one for d in days.values() for one in d.values()]
    reduced = align.segment(found, daily.loaders(files), **settings.for_stage("segment"))
    solved = bias.bias(reduced, assumed=assumed(settings), **settings.for_stage("bias"))
    wall, processor = time.perf_counter() - started, time.process_time() - spent
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"1.6e6 s at 10 Hz, {int(solved.used.sum())} of {solved.used.size} segments used:")
    print(f"wall {wall:.1f} s, processor {processor:.1f} s, largest memory {peak:.2f} GB (limits 30 s, 2 GB)")


def study_bound(swings=6):
    """Bound of the offset and error of k_y, with the actuation noise of Table 2 and without."""
    settings = catalog.parameters("inertial_sensor")
    printed = [one.sigma[0] for one in catalog.published("inertial_sensor")["com_offset"]]
    print("offset, um x y z: printed errors", printed)
    for volt in (2e-5, 2e-7):
        chosen = catalog.parameters("simulate_inertial_sensor").with_settings({"voltage_noise_v_rthz": volt})
        bounds = np.sqrt(np.mean([bound(6000 + n, chosen, settings)[3:] ** 2 for n in range(swings)], axis=0))
        factor = []
        for n in range(swings):
            truth, _, _, moved = swing(6000 + n, chosen, settings)
            factor.append(
                [float(moved.k_y_sigma) / truth.k[1], (float(moved.k_y) - truth.k[1]) / float(moved.k_y_sigma)]
            )
        share, ratio = np.sqrt(np.mean(np.square(factor), axis=0))
        print(f"actuation {volt:g} V/sqrt(Hz): bound {np.round(1e6 * bounds, 1)}", end="; ")
        print(f"k_y of a swing {100 * share:.1f} %, error/sigma {ratio:.2f}")


def main(arguments):
    """Run what is asked for."""
    from flows.engine import single_threaded

    single_threaded()
    if "bound" in arguments:
        study_bound()
        return
    if "long" in arguments:
        study_long(arguments[arguments.index("long") + 1])
        return
    numbers = [int(a) for a in arguments if a.isdigit()] or [200, 50]
    study_swings(numbers[0])
    if len(numbers) > 1:
        study_rolls(numbers[1])


if __name__ == "__main__":
    main(sys.argv[1:])
