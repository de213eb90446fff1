"""Phase centres: invented truth in, estimate out; geometry, the steps before, and the choices of the source paper."""

from functools import lru_cache

import numpy as np
import pytest
from kbr_campaign import BENIGN, NOMINAL, STILL, campaign, drawn, process, sigma_mm, simulated, true_mm
from numpy.testing import assert_allclose
from scipy import stats

from benchmarks import kbr_phase_centre as study
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre import align, model, noise
from gravcal.calibrations.kbr_phase_centre.model import SUBSETS, arcs
from gravcal.errors import EstimationError
from gravcal.estimation import crn
from gravcal.physics import frames
from gravcal.simulation import kbr_phase_centre as simulation
from tasks import kbr_phase_centre as kbr_stages

Y_AND_Z = [1, 2, 4, 5]


def estimate_mm(products, subset=0, estimator=0):
    """Phase centres (observable, 6) mm."""
    return 1e3 * products.combined["centre"].values[:, subset, estimator]


def test_without_noise_every_observable_returns_the_truth():
    """Recovery: no noise at all; what is left is a twentieth of the sigma that noise would give."""
    columns, truth = simulated(2, noiseless=True)
    error = estimate_mm(process(columns)) - true_mm(truth)
    assert np.abs(error[:, [0, 3]]).max() < 1e-3
    assert np.abs(error[:, Y_AND_Z]).max() < 5e-5


@pytest.mark.long
def test_errors_are_those_of_the_reported_sigma():
    """Recovery: 8 campaigns x 6 components, both estimators; the observables share their noise. Interval of 48, 1 %."""
    z = []
    for seed in range(20, 28):
        truth, products = drawn(seed)
        z.append([(estimate_mm(products, 0, e)[1] - truth) / sigma_mm(products.combined, 0, e)[1] for e in (0, 1)])
    low, high = stats.chi2.ppf([0.0025, 0.9975], 48) / 48
    for mean_square in np.mean(np.square(z), axis=(0, 2)):
        assert low < mean_square < high


def test_least_squares_comes_within_a_twentieth_of_the_bound_and_is_as_accurate_as_asked():
    """Recovery: exact, without draws: weights under the true noise against the bound; 3 % go to the orbit.

    With 1 um/sqrt(Hz) and millimetres of slow orbit error y, z are below 0.02 mm and x below 0.5 mm, at 5 sigma.
    """
    truth, products = campaign()
    invented = simulation.with_noise(catalog.parameters("simulate_kbr_phase_centre").with_settings(BENIGN))
    degree = catalog.parameters("kbr_phase_centre").orbit_degree
    scatter = study.exact_scatter(products.equations[0], products.noise, invented, degree)
    ratio = scatter / study.bound(products.equations[0], invented)
    assert np.all((ratio > 1.0) & (ratio < 1.05))
    sigma = sigma_mm(products.combined)
    assert_allclose(1e3 * scatter, sigma[0], rtol=0.1)  # sigma as measured on one campaign
    assert 5 * sigma[:, Y_AND_Z].max() < 0.02
    assert 5 * sigma[:, [0, 3]].max() < 0.5
    assert np.abs(estimate_mm(products) - truth)[:, Y_AND_Z].max() < 0.02


def test_noise_as_on_a_measured_day_leaves_tenths_of_a_millimetre():
    """Recovery: noise at 4 mHz as measured, y and z to tenths; x was 15 mm short, 5 sigma, by its pointing."""
    truth, products = drawn(11, noise="measured")
    assert_allclose(np.interp(4e-3, products.noise["frequency"], np.sqrt(products.noise["model"])), 2.3e-4, rtol=0.3)
    sigma = sigma_mm(products.combined)
    assert np.abs((estimate_mm(products) - truth) / sigma).max() < 4.5
    assert 0.03 < sigma[1, [1, 2, 4, 5]].min() < sigma[1, [1, 2, 4, 5]].max() < 0.3
    # and the noise that a design takes from it is that of the simulation; quiet star cameras add to the white part
    usual = catalog.parameters("simulate_kbr_phase_centre")
    found = simulation.measured_noise(usual, None, products.noise)
    share = {name: value / getattr(usual, name) for name, value in found.items()}
    assert share["ranging_noise_m"] == pytest.approx(1.3, abs=0.3)
    assert list(share.values()) == pytest.approx(len(share) * [1.0], abs=0.15), share


def test_wiggles_and_their_star_camera_noise_are_found_and_one_sided_sets_follow_the_tan_law():
    """Recovery: sigma of y, z is tan(2 deg) that of x, and their shifts follow that of x; erratum K-2.

    All eight wiggles, starts and stops within 10 s, angles within 0.1 deg; density of the star cameras at 4 mHz as
    simulated, 20 urad/sqrt(Hz), within 30 % (excess of 8 arcs over the ranging).
    """
    _, products = campaign()
    combined, row = products.combined, SUBSETS.index("positive")
    sigma = sigma_mm(combined, row)
    assert_allclose(sigma[:, [1, 2]].mean(axis=1) / sigma[:, 0], np.tan(np.radians(2)), rtol=0.06)
    assert np.all(sigma_mm(combined)[:, 1] < 0.2 * sigma[:, 1])  # both signs: x no longer leaks
    held = sigma_mm(combined, SUBSETS.index("positive_x_fixed"))  # x of the catalogue repairs a one-sided set
    assert np.isnan(held[:, 0]).all()
    assert held[:, Y_AND_Z].max() < 0.3 * sigma[:, Y_AND_Z].min()
    left = combined["shift"].values[:, row] - combined["predicted_shift"].values[:, row]
    assert np.nanmax(np.abs(left[:, Y_AND_Z])) < 4.5e-6  # m; three sigma of what one side tells beyond x
    truth, pointed = simulated()[1], products.pointed
    letters = [pointed.attrs["satellites"][k] for k in pointed["satellite_index"].values]
    axes = [("pitch", "yaw")[k] for k in pointed["axis_index"].values]
    kinds = [("+" if s > 0 else "-") + a for s, a in zip(pointed["sign"].values, axes, strict=True)]
    assert list(zip(letters, kinds, strict=True)) == [(m["satellite"], m["kind"]) for m in truth["manoeuvres"]]
    for name in ("start", "stop"):
        assert_allclose(pointed[name].values, [m[name] for m in truth["manoeuvres"]], atol=10)
    assert_allclose(np.degrees(pointed["amplitude"].values), 1.0, atol=0.02)
    assert_allclose(np.abs(np.degrees(pointed["offset"].values)), 2.0, atol=0.15)  # mean pointing 0.03 deg, drawn
    found = np.sqrt(products.noise["pointing_power"].values @ (1 / (1 + (4e-3 / noise.CORNERS) ** 2)))
    keep = np.exp(-0.1)
    slow = 2 * (3e-6) ** 2 * (1 - keep**2) / (1 + keep**2 - 2 * keep * np.cos(2 * np.pi * 4e-3))
    assert_allclose(found, np.sqrt(slow + 2 * (1.5e-6) ** 2), rtol=0.3)


def test_a_turned_star_camera_frame_moves_y_and_z():
    """Analytic: 1.444 m times the angle: 100 urad about y move z by +0.144 mm, about z y by -0.144 mm."""
    plain = estimate_mm(process(simulated(5, STILL, True)[0]))
    turned = estimate_mm(process(simulated(5, (*STILL, ("misalignment_urad", "0,100,100")), True)[0]))
    shift = (turned - plain)[1]
    assert_allclose(shift[[1, 4]], -0.1444, rtol=0.01)
    assert_allclose(shift[[2, 5]], 0.1444, rtol=0.01)


def test_a_satellite_without_wiggles_is_not_determined_and_ranging_every_two_seconds_works_too():
    """Recovery: only C moves about one axis, LRI1B in form: x of D is unknown, x and z of C are within 4.5 sigma."""
    settings = (("ranging_step_s", 2.0), ("manoeuvres", "+pitch_a,-pitch_a"))
    columns, truth = simulated(9, settings)
    products = process(columns)
    determined = products.combined["determined"].values[:, 0]
    assert determined[:, [0, 2]].all()
    assert not determined[:, 3].any()
    assert np.abs(((estimate_mm(products) - true_mm(truth)) / sigma_mm(products.combined))[:, [0, 2]]).max() < 4.5
    assert sigma_mm(products.combined)[0, 2] < 3e-3


def test_orbits_as_noisy_as_measured_give_the_accuracy_of_the_paper():
    """Published: 10.3390/rs14143395, Sec. 4.2: y, z 0.138 mm, x 2.5 mm; noise of GRACE on 2014-01-15; factor 2.5."""
    columns, _ = simulated(70, settings=(("orbit_red_m", 2.5e-3), ("orbit_red_slope", 1.73)))
    sigma = sigma_mm(process(columns).combined)
    assert_allclose(np.log(sigma[:, Y_AND_Z] / 0.138), 0, atol=np.log(2.5))
    assert_allclose(np.log(sigma[:, [0, 3]] / 2.5), 0, atol=np.log(2.5))


RHO, X = 220e3, 1.444  # m
POSITION = np.array([[[7e6, 0, 0]], [[7e6, RHO, 0]]], dtype=float)


def facing(angle_a, angle_b=(0.0, 0.0, 0.0)):
    """Attitudes (2, 1, 4) of a pair with roll, pitch and yaw (rad) against the line of sight."""
    states = [np.concatenate([p, np.zeros((1, 3))], axis=1) for p in POSITION]
    return np.stack(
        [
            frames.quaternion_product(frames.quaternion_from_R_bi(R), simulation.turned(np.array([angle])))
            for R, angle in zip(simulation.nominal(*states), (angle_a, angle_b), strict=True)
        ]
    )


def exact(quaternion, centre):
    """Range of the phase centres minus that of the centres of mass, m."""
    u = POSITION[1] - POSITION[0]
    R = frames.R_bi_from_quaternion(quaternion)
    v = np.einsum("nji,j->ni", R[1], centre[1]) - np.einsum("nji,j->ni", R[0], centre[0])
    return np.linalg.norm(u + v, axis=1) - np.linalg.norm(u, axis=1)


def test_angles_and_columns_have_the_signs_of_the_exact_range_and_the_tan_law():
    """Analytic: at 3 deg the range of 220 km is 2.886 m shorter; eq. 13 as printed makes it longer (K-1).

    What first order leaves is 13 nm there, |v_perp|^2 / (2 rho) (equations.md M3). Turned by -pitch, -yaw it sees +;
    columns -cos, +sin for pitch (x, z), -cos, -sin for yaw (K-2). NaN in, NaN out, without a warning.
    """
    quaternion = facing([0, np.radians(3), 0])
    centre = np.array([[X, 0, 0], [X, 0, 0]])
    line = model.lines_of_sight(POSITION, quaternion)
    first_order = -model.antenna_correction(line, centre)
    assert_allclose(first_order, -2.88602, atol=1e-5)  # -X (1 + cos 3 deg), to the last digit given
    remainder = model.second_order(POSITION, quaternion, centre)
    assert_allclose(remainder, 13e-9, atol=0.5e-9)
    assert_allclose(first_order + remainder, exact(quaternion, centre), atol=3e-11)  # rounding of 2e5 m
    c, s = np.cos(np.radians(2)), np.sin(np.radians(2))
    for angle, column in (((1, 0), [-c, 0, s]), ((0, 1), [-c, -s, 0]), ((-1, 0), [-c, 0, -s])):
        line = model.lines_of_sight(POSITION, facing(*2 * [[0, *np.radians(2) * np.array(angle)]]))
        assert_allclose(model.angles(line)[:, 0], 2 * [np.radians(2) * np.array(angle)], atol=1e-14)
        assert_allclose(-line[0, 0], column, atol=1e-14)
    quaternion = facing([0, 0, 0])
    quaternion[1] = np.nan
    line = model.lines_of_sight(POSITION, quaternion)
    assert np.isfinite(line[0]).all()
    assert np.isnan(line[1]).all()
    assert np.isnan(model.second_order(POSITION, quaternion, np.ones((2, 3)))).all()


def test_samples_off_the_grid_are_interpolated_and_steps_and_long_gaps_begin_a_segment():
    """Analytic: a wave of 250 s to 1e-9; 1 mm against the rate is seen, no curvature of an orbit, no gap of 20 s."""
    time = np.arange(0.0, 1000.0, 5.0)
    kept = (time < 400) | (time > 460)
    wave = lambda t: np.column_stack([np.sin(2 * np.pi * t / 250), t])  # noqa: E731
    at = np.arange(50.0, 950.0)
    found = align.interpolated(time[kept], wave(time[kept]), at, 10.0)
    missing = (at > 395) & (at < 465)
    assert np.isnan(found[missing]).all()
    near = (at > 300) & (at < 560) & ~missing  # ends of a stretch: the spline has one side only
    assert_allclose(found[~missing & ~near], wave(at[~missing & ~near]), atol=1e-9)
    assert_allclose(found[near], wave(at[near]), atol=1e-6)
    noise = np.random.default_rng(1).standard_normal((192, 4))  # of an attitude; a gap of 9 s does not amplify it
    bridged = align.interpolated(np.delete(np.arange(200.0), range(100, 108)), noise, np.arange(200.0), 10.0)
    assert np.abs(bridged).max() < 10
    time = np.delete(np.arange(0.0, 1000.0, 5.0), [*range(60, 63), *range(120, 140)])
    w = 2.2e-3  # rad s-1, twice per revolution
    values = [1e3 * np.sin(w * time), 1e3 * w * np.cos(w * time), -1e3 * w**2 * np.sin(w * time)]
    values[0] = values[0] + np.where(time > 200, 1e-3, 0.0)
    for gone in (900.0, 200.0):  # a record that is not finite hides no step
        values[0][time == gone] = np.nan
        assert time[align.breaks(time, *values, 1e-4)].tolist() == [205.0, 700.0]


@pytest.mark.parametrize("amplitude", [1.0, 1.5, 1.7])
def test_wiggles_of_grace_are_found_too(amplitude):
    """Recovery: amplitudes of 1.5 and 1.7 deg about 2 deg come close to zero; the wiggle stays one."""
    time = np.arange(0.0, 8000.0)
    inside = (time >= 2000) & (time < 5750)
    angle = np.where(inside, -2 - amplitude * np.sin(2 * np.pi * (time - 2000) / 250), 0.02 * np.sin(time / 300))
    found = model.wiggles(time, np.radians(angle), 1, 0, 250.0, *np.radians([0.5, 0.4]))
    assert len(found) == 1
    assert (found[0].satellite_index, found[0].axis_index, found[0].sign) == (1, 0, -1)
    assert_allclose([found[0].start, found[0].stop], [2000, 5750], atol=60)  # a quarter of a period
    routine = 2e-3 * np.sin(2 * np.pi * time / 250) + 1e-3 * np.sin(time / 900)
    for kept in (time.size, 500):  # slow motion is no wiggle, nor is a record shorter than three periods
        assert model.wiggles(time[:kept], routine[:kept], 0, 0, 250.0, *np.radians([0.5, 0.4])) == []


def test_a_manoeuvre_of_the_catalogue_is_measured_and_quiet_data_keep_their_distance():
    """Analytic: times and sign stay, offset and amplitude are the angle's; 0 inside, -1 beyond the margin, else -2."""
    time = np.arange(0.0, 6000.0)
    angle = np.zeros((2, 6000, 2))
    angle[1, :, 0] = np.radians(2 + np.sin(2 * np.pi * time / 250))
    found = model.measured(time, angle, 1, 0, 1, 1000.0, 4750.0, 250.0)
    assert found == model.Wiggle(1, 0, 1, 1000.0, 4750.0, found.offset, found.amplitude)
    assert_allclose(np.degrees([found.offset, found.amplitude]), [2, 1], rtol=1e-3)
    time = np.array([0.0, 69.0, 71.0, 99.0, 151.0, 180.0, 249.0, 251.0, 331.0])
    found = arcs(time, np.array([[100.0, 230.0]]), 50.0, 30.0)
    assert found.tolist() == [-1, -1, -2, -2, 0, 0, -2, -2, -1]


def test_how_loud_the_noise_is_at_the_wiggle_quiet_data_say_as_far_as_they_know():
    """Recovery: a spectrum that is half of it there: errors follow it where known to 3 %, else what wiggles say."""
    _, products = campaign()
    knot, settings = products.noise["knot"].values, catalog.parameters("kbr_phase_centre").for_stage("solve")
    lower = products.noise["log_density"] - np.log(2) * np.exp(-((np.log(knot / 4e-3) / 0.25) ** 2))
    for sd, low, high in ((0.03, 0.7, 0.85), (1.0, 0.85, 1.25)):  # of the variance; the band is louder beside
        quiet = products.noise.assign(log_density=lower, log_covariance=(("knot", "knot_2"), sd**2 * np.eye(knot.size)))
        solved = kbr_stages.solve(products.equations[1], quiet, variant="range_rate", nominal_m=NOMINAL, **settings)
        ratio = solved["covariance"].values[0, 0] / products.solved[1]["covariance"].values[0, 0]
        assert np.all((np.diag(ratio) > low) & (np.diag(ratio) < high))


def test_covariance_is_that_of_drawn_noise():
    """Recovery: pointing noise times a lever, differentiated by the CRN filter; 600 draws, elements within 6 sigma."""
    rng, step = np.random.default_rng(5), 5.0
    fine = np.arange(0.0, 400.0)
    lever = 0.05 + 0.025 * np.sin(2 * np.pi * fine / 250)
    at = np.arange(100.0, 300.0, step)
    error = 1e-5 * rng.standard_normal((400, 600))
    through = [crn.operator(crn.Crn(), d, np.ones(400, bool), (0.0, 1.0), at) for d in range(3)]
    arms = np.stack([through[d](lever) for d in range(3)], axis=1)[:, :, None] * np.array([1.0, 0, 0, 0])
    grid = np.zeros(noise.BINS + 1)
    lags = noise.lags_of_densities(grid, 2 * 1e-10 * noise.passed(step), step, 2, 60)
    found = noise.covariance_matrix(lags, np.arange(at.size), arms)
    sampled = np.cov(through[2](lever[:, None] * error))
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs((found - sampled) / scale)[np.tril_indices(at.size)].max() < 6 * np.sqrt(2 / 600)


def test_noise_comes_from_the_wiggles_without_quiet_and_files_that_do_not_fit_are_refused():
    """Contract: the source is said; of other days what they share, without a usable record the file, and what to do."""
    columns, _ = simulated()
    bits = np.zeros(columns["KBR1B", "Y"]["gps_time"].size, np.uint8)
    bits[[10, 20]] = 1 << 7, 1 << 6  # filled within 5 s of the middle of the filter, and further off
    products = process(columns | {("KBR1B", "Y"): columns["KBR1B", "Y"] | {"qualflg": bits}}, quiet_minimum_s=86400)
    assert products.aligned["kbr_flag"].values[[10, 20]].tolist() == [1, 0]
    assert products.noise.attrs["source_data"] == "manoeuvres"
    assert np.all(products.noise["pointing_power"].values == 0)
    camera = dict(columns["SCA1B", "D"])
    moved = camera | {"gps_time": camera["gps_time"] + 86400}
    with pytest.raises(EstimationError, match="found 0 s in common.*at least 600 s.*one pair and one day"):
        process({**columns, ("SCA1B", "D"): moved})
    with pytest.raises(EstimationError, match="SCA1B of D: found 0 usable records"):
        process({**columns, ("SCA1B", "D"): camera | {"quatangle": camera["quatangle"] * np.nan}})


TRUE = np.array([1444.4, -0.170, 0.448])


@lru_cache(maxsize=1)
def published():
    """The paper's own campaign without noise, and its treatment."""
    return process(simulated(3, STILL, True)[0], method="published").combined


def test_undetrended_columns_shorten_x_and_shrink_y_and_z():
    """Published: erratum K-3, range, noise-free: X 1340.9, Y -0.018, Z 0.046 mm for 1444.4, -0.170, 0.448."""
    found = 1e3 * published()["centre"].values[0, 0, 0, :3]
    assert_allclose(found[0], 1340.9, atol=0.5)  # trims to 5 s
    assert_allclose(found[1:], [-0.018, 0.046], atol=1e-3)  # printed rounding and the same
    assert_allclose(TRUE[0] - found[0], 103, atol=1)
    by_acceleration = 1e3 * published()["centre"].values[2, 0, 0, :3]  # carries no level, nothing is removed from it
    assert_allclose(by_acceleration[0], TRUE[0], atol=0.3)
    assert_allclose(by_acceleration[1:], TRUE[1:], atol=1e-3)


def test_the_bias_makes_the_design_nearly_singular_and_marks_the_formal_errors():
    """Published: erratum K-3: condition 9.8e3, 21 when detrended; sigma_Y / sigma_X 0.017-0.021, 0.050 for the rate."""
    assert_allclose(published()["condition"].values[0, 0], 9.8e3, rtol=0.01)
    detrended = process(simulated(3, STILL, True)[0]).combined
    # weighed with what rounding leaves of a record without noise, which differs from machine to machine
    assert_allclose(detrended["condition"].values[:, 0], 21, atol=0.5)
    assert_allclose(1e3 * detrended["centre"].values[0, 0, 0, :3], TRUE, atol=1e-3)
    sigma = published()["formal_sigma"].values[:, 0, 0]
    assert 0.017 < sigma[0, 1] / sigma[0, 0] < 0.021
    assert_allclose(sigma[1, 1] / sigma[1, 0], 0.050, atol=2e-3)
