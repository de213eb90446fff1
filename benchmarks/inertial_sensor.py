"""Recovery over simulated swings and rolls of Taiji in memory, the bound of the offset, and a roll of 1.6e6 s."""

import functools
import resource
import time
from dataclasses import replace

import numpy as np

from benchmarks.tables import Figure, at_most, numbers, rms, rms_figure, say, show, study, title
from flows import inertial_sensor as flow
from flows.inertial_sensor import assumed, geometry
from gravcal import catalog
from gravcal.calibrations.inertial_sensor import align, bias
from gravcal.calibrations.inertial_sensor import model as fits
from gravcal.calibrations.inertial_sensor.estimate import fit_offset, offset, record_of, scale, swing_of
from gravcal.estimation.noise import NoiseModel
from gravcal.io import daily
from gravcal.simulation import inertial_sensor as simulation

START = 706190400.0
SWING = ("beta_x", "beta_y", "delay", "offset_x", "offset_y", "offset_z")
OFFSET_SIGMA = np.array([19e-6, 15e-6, 19e-6])  # m, of the offset that a swing hands to the roll
CALM = 0.05  # share of the noise in the motion from which the bound is computed; its square is what remains
BOUNDS = 10  # swings of which the bound is computed
SEGMENTS = 20  # of each roll


def swings(options) -> list[Figure]:
    """Error/sigma of swings with its interval, scatter and sigma over the Cramer-Rao bound, and the accuracy."""
    error, sigma, least, size, apart, _ = study(options, 200, "swings: inertial_sensor, {} simulated swings", one_swing)
    least, mean, figures = rms(least), sigma.mean(axis=0), []
    for i, name in enumerate(SWING):
        accuracy = f" = {100 * mean[i] / size[0, i]:.2f} %" if size[0, i] > 0 else ""
        over = f", scatter/bound {rms(error[:, i]) / least[i]:.3f}, sigma/bound {mean[i] / least[i]:.3f}"
        more = f"{over}, sigma {mean[i]:.3g}{accuracy}"
        figures.append(rms_figure(f"error/sigma {name}", error[:, i] / sigma[:, i], 12, more))
    figures.append(Figure("Kalman filter minus batch at the end, sigma", f"{apart.max():.1e}"))
    return show(figures, "std. error")


def one_swing(seed, bounds=BOUNDS, **noise):
    """Errors, sigmas and bound (6,) in the order of SWING, sizes, filter less batch in sigma; of k_y sigma %, score."""
    chosen, settings = invented("swing", **noise), catalog.parameters("inertial_sensor")
    truth, _, scaled, moved = swing(seed, chosen, settings)
    late = float(scaled.delay) - truth.delay
    error = [*(scaled.beta.values[:2] - truth.beta[:2]), late, *(moved.offset.values[0] - truth.offset)]
    sigma = [*scaled.beta_sigma.values[:2], float(scaled.delay_sigma), *np.sqrt(np.diag(moved.covariance.values[0]))]
    size = np.abs([*truth.beta[:2], np.nan, *1e-6 * np.array(chosen.offset_um)])
    apart = np.abs(scaled.filter_value.values[-1] - scaled.batch_value.values) / scaled.filter_sigma.values[-1]
    least, one = bound(seed, chosen, settings) if seed < bounds else np.full(6, np.nan), float(moved.k_y_sigma)
    factor = 100 * one / truth.k[1], (float(moved.k_y) - truth.k[1]) / one
    return error, sigma, least, size, apart.max(), factor


def invented(manoeuvre, **changes):
    """Parameters of a simulated manoeuvre."""
    return catalog.parameters("simulate_inertial_sensor").with_settings({"manoeuvre": manoeuvre} | changes)


def swing(seed, chosen, settings):
    """Truth, aligned record and products of one swing."""
    rng = np.random.default_rng(seed)
    truth = simulation.draw(catalog.satellite("T").settings(), chosen, rng)
    record = simulation.swing(chosen, START, truth, rng, simulation.Hidden())
    found = align.detect(lambda: record["ATT"], **settings.for_stage("detect"))
    readers = [lambda *_, name=name: record[name] for name in ("IS1", "ATT", "ORB")]
    aligned = align.align(found, *readers, **settings.for_stage("align"))
    scaled = scale(aligned, geometry=geometry(), **settings.for_stage("scale"))
    return truth, aligned, scaled, offset(aligned, scaled, **settings.for_stage("offset"))


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


def rolls(options) -> list[Figure]:
    """Error/sigma of the bias of rolls with its interval: of the scatter alone, and with an offset with its error."""
    words = f"rolls: inertial_sensor, {{}} simulated rolls of {SEGMENTS} segments; y is b - a, not separable"
    (pairs, used), figures = study(options, 50, words, one_roll), []
    for number, kind in enumerate(("offset exact", "offset drawn")):
        for axis, letter in enumerate("xyz"):
            error, sigma, size = pairs[:, number, :, axis].T
            more = f", sigma {sigma.mean():.2e} m s-2 = {100 * np.mean(sigma / size):.5f} %"
            figures.append(rms_figure(f"error/sigma bias_{letter}, {kind}", error / sigma, 12, more))
    figures.append(Figure("segments used", f"{used.sum()}"))
    return show(figures, "std. error")


def one_roll(seed, segments=SEGMENTS):
    """Errors, sigmas and sizes of the bias (3, 3) with the offset exact and with its error; segments used."""
    settings, rng = catalog.parameters("inertial_sensor"), np.random.default_rng(seed)
    chosen = invented("roll", roll_s=2500.0 * segments + 500.0)
    truth = simulation.draw(catalog.satellite("T").settings(), chosen, rng)
    flown = simulation.draw_roll(chosen, START, rng)
    record = simulation.span(chosen, flown, (flown.start, flown.stop), truth, rng, simulation.Hidden())
    reduced = align.reduced(record["IS1"], record["ATT"], record["ORB"], settings.step_s)
    limits = settings.uniformity_limit, settings.share_limit
    model = bias.Model(settings.trend_degree, settings.amplitude_degree, settings.amplitude_harmonics)
    used = truth.offset + OFFSET_SIGMA * rng.standard_normal(3)
    out = []
    for place, covariance in ((truth.offset, np.zeros((3, 3))), (used, np.diag(OFFSET_SIGMA**2))):
        sensor = bias.Sensor(truth.k, 0 * truth.k, place, covariance, covariance)
        solved = bias.solve(reduced, sensor, model, settings.segment_s, limits)
        found = bias.estimates(solved, sensor)
        inside = solved.time[:, None] + settings.segment_s * np.linspace(-0.5, 0.5, 101)  # of all segments, see sigma
        drift = np.array([np.interp(inside, flown.knot, column).mean() for column in flown.drift.T])
        true = truth.bias + drift - np.array([0.0, chosen.radiation_m_s2, 0.0])
        out.append((found["bias"] - true, found["bias_sigma"], np.abs(truth.bias)))
    return out, int(np.count_nonzero(solved.used))


def swing_bound(options) -> list[Figure]:
    """Bound of the offset and error of k_y, with the actuation noise of Table 2 and without, beside printed errors."""
    printed, figures = [one.sigma[0] for one in catalog.published("inertial_sensor")["com_offset"]], []
    for volt in (2e-5, 2e-7):
        words = f"swing_bound: Cramer-Rao bound of the offset x, y, z in um, {{}} swings, {volt:g} V/sqrt(Hz)"
        one = functools.partial(one_swing, bounds=np.inf, voltage_noise_v_rthz=volt)
        *_, least, _, _, factor = study(options, 6, words, one, 6000)
        share, ratio = rms(factor)
        said = f"actuation {volt:g} V/sqrt(Hz)", numbers(1e6 * rms(least)[3:], ".1f"), f"printed {numbers(printed)}"
        figures += [Figure(*said), Figure("  k_y of a swing", f"{share:.1f} %", f"error/sigma {ratio:.2f}")]
    return show(figures)


def long_roll(options) -> list[Figure]:
    """Write a roll of 1.6e6 s (1.3 GB, kept) into --data, or detect, reduce and solve it: time and memory of that."""
    title("long_roll: 1.6e6 s at 10 Hz")
    if not any(options.data.glob("IS1*")):
        settings = {"manoeuvre": "roll", "roll_s": "1.6e6"}
        flow.CALIBRATION.simulate(options.data, seed=1, truth=None, effects={}, settings=settings)
        say("files written; run again to measure the processing alone")
        return []
    settings = catalog.parameters("inertial_sensor")
    days = daily.days(options.data)
    started, spent = time.perf_counter(), time.process_time()
    found = align.detect(*(daily.loader(d["ATT"]) for d in days.values()), **settings.for_stage("detect"))
    files = [one for d in days.values() for one in d.values()]
    reduced = align.segment(found, daily.loaders(files), **settings.for_stage("segment"))
    solved = bias.bias(reduced, assumed=assumed(settings), **settings.for_stage("bias"))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return show(
        [
            Figure("segments used", f"{int(solved.used.sum())} of {solved.used.size}"),
            at_most("wall time", time.perf_counter() - started, 30, " s"),
            Figure("processor time", f"{time.process_time() - spent:.1f} s"),
            at_most("largest memory", peak, 2, " GB"),
        ]
    )
