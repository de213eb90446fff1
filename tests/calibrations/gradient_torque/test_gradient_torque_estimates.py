"""S-GRS: drag, rates and what can be told apart; laws, corrected and as printed (S-1 to S-9); the simulated day."""

import functools

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose
from scipy.interpolate import BSpline
from scipy.linalg import null_space

from gravcal import catalog
from gravcal.calibrations.gradient_torque import attitude, estimate, model
from gravcal.errors import EstimationError, ProductError
from gravcal.io import daily, icgem
from gravcal.physics import frames, kinematics
from gravcal.physics.constants import GM
from gravcal.physics.dynamics import gravity_gradient_torque
from gravcal.physics.sensing import offset_tensor
from gravcal.simulation import by_slug
from gravcal.simulation import gradient_torque as simulation


def test_the_covariance_inside_the_band_is_that_of_the_whole_inverse():
    """Analytic: small system against its dense inverse."""
    rng = np.random.default_rng(0)
    table = attitude.basis(np.arange(0.0, 200.0, 2.0), 10.0)
    operator = rng.standard_normal((100, 3, 3, 3)) * np.array([1, 10, 100])[:, None, None]
    band, right = attitude.normal([(operator, np.ones((100, 3)))], table)
    size = band.shape[1]
    dense = sum(np.diag(band[k, : size - k], -k) for k in range(18))
    dense = dense + np.tril(dense, -1).T
    assert_allclose(attitude.solve(band, right), np.linalg.solve(dense, right), rtol=1e-6)
    inverse = np.linalg.inv(dense)
    rows = np.zeros((100, 3, size))
    for k in range(100):
        for d, part in enumerate(table.values):
            for j in range(6):
                at = 3 * (table.start[k] + j)
                rows[k, :, at : at + 3] += operator[k, d] * part[k, j]
    found = attitude.propagate(operator, table, attitude.band_covariance(band))
    assert_allclose(found, rows @ inverse @ np.swapaxes(rows, 1, 2), rtol=1e-6)


def fixed(monkeypatch, corner):
    """Take one corner, over the rate of the knots, for the torque in place of the likeliest."""
    for name in ("CORNERS", "LIMITS"):
        monkeypatch.setattr(attitude, name, np.log([corner, corner]))


def test_the_evidence_is_the_marginal_likelihood():
    """Analytic: 60 angles and second derivatives, dense covariance of what no start can take; two priors, 1e-6."""
    rng, table = np.random.default_rng(4), attitude.basis(np.arange(60.0), 3.0)
    given, A = (1.0, np.zeros(table.count - 5, bool), table.step), np.zeros((2, 60, table.count))
    for k, first in enumerate(table.start):
        A[:, k, first : first + 6] = table.values[::2, k]
    A = A.reshape(120, -1)
    y, start, found, expected = rng.standard_normal(120), rng.standard_normal(table.count), [], []
    data = np.array([np.pad(np.diagonal(A.T @ A, -k), (0, k)) for k in range(6)])
    unknown = np.vander(np.linspace(-1, 1, table.count), 3)  # angle, rate and torque at the start, free
    left = null_space((A @ unknown).T).T
    B, z = left @ A, left @ y
    for corners in np.log([[0.3, 0.1], [0.1, 0.2]]):
        found.append(-attitude.unlikeliness(corners, data, A.T @ (y - A @ start), start, *given))
        band = attitude.torque_prior(corners, *given)[0]
        prior = sum(np.diag(one[: table.count - k], -k) for k, one in enumerate(band))
        prior = prior + np.tril(prior, -1).T + unknown @ unknown.T
        covariance = np.eye(117) + B @ np.linalg.inv(prior) @ B.T
        expected.append(-(np.linalg.slogdet(covariance)[1] + z @ np.linalg.solve(covariance, z)) / 2)
    assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6)


def test_slow_torque_is_smoothed_and_a_jump_is_kept(monkeypatch):
    """Recovery: half the error of free splines, theirs near a jump; error/sigma 0.98 +- 3 of 0.05 (200 values)."""
    rng, time = np.random.default_rng(5), np.arange(7200.0)
    jump = np.where(np.abs(time - 3619.5) < 20, 3e-9 * np.sign(3619.5 - time), 0.0)
    torque = np.stack([1e-8 * simulation.coloured(time, 0.002, rng) for _ in range(3)], axis=1) + jump[:, None]
    angle, true, rate = np.zeros_like(torque), np.zeros_like(torque), np.zeros(3)
    for k in range(time.size - 1):  # control of 1 mHz
        true[k] = torque[k] - 1.4 * CONTROL * rate - CONTROL**2 * angle[k]
        rate = rate + true[k]
        angle[k + 1] = angle[k] + rate
    sigma = {"angle_sigma": np.full(3, 4e-6), "angular_sigma": np.full(3, 3.5e-10)}
    noise = [one * rng.standard_normal(true.shape) for one in sigma.values()]
    still, near, far = np.zeros_like(true), np.abs(time - 3620) < 80, np.abs(np.abs(time - 3620) - 1800) < 1700
    frame = np.tile(np.eye(3), (time.size, 1, 1)), still, still
    quaternion = frames.quaternion_from_R_bi(attitude.R_bo(angle + noise[0]))

    def error():
        found = attitude.smooth(time, quaternion, noise[1] - true, frame, lambda *_: still, knot_step=10.0, **sigma)
        variance = found.covariance_of(*np.zeros((2, 1, 3, 3)), np.eye(3)[None])
        return found.rate_dot_b - true, np.diagonal(variance, axis1=1, axis2=2), found.chi2 / found.dof

    (smoothed, variance, fit), _ = error(), fixed(monkeypatch, 10.0)
    free, _, free_fit = error()
    assert np.std(smoothed[far]) < 0.5 * np.std(free[far])
    assert np.std(smoothed[near]) < 1.05 * np.std(free[near])
    assert 0.83 < np.sqrt(np.mean(smoothed[far] ** 2 / variance[far])) < 1.13
    assert abs(fit - free_fit) < 0.02  # degrees of freedom are those that are used


def test_the_one_sensor_error_is_at_its_bound(monkeypatch):
    """Analytic: Fisher matrix of readings and of slow torque by differences of scipy splines; sigma to 1 %."""
    fixed(monkeypatch, 0.2)
    columns, _ = fly(3, duration_s=600)
    modelled, found = solve(columns, ("one_sensor",))
    time = columns["time"] - columns["time"][0]
    step = (time[-1]) / int(np.ceil(time[-1] / 10.0))
    knots = np.arange(-5, int(round(time[-1] / step)) + 6) * step
    count = knots.size - 6
    frame = attitude.orbit_rates(columns["time"], columns["position"], columns["velocity"])
    start = np.stack([BSpline(knots, np.eye(count)[j], 5)(time) for j in range(count)], axis=1)
    begin = np.linalg.lstsq(start, modelled["angle"].values[0], rcond=None)[0]

    def forward(coefficients):
        angle, first, second = (
            BSpline(knots, coefficients, 5).derivative(k)(time) if k else start @ coefficients for k in range(3)
        )
        rate, rate_dot = attitude.body_rates(angle, first, second, *frame)
        turn = attitude.R_bo(angle) @ np.swapaxes(attitude.R_bo(modelled["angle"].values[0]), 1, 2)
        tensor = offset_tensor(rate, rate_dot, turn @ modelled["gradient_b"].values @ np.swapaxes(turn, 1, 2))
        return angle, rate_dot, tensor @ columns["sensor_position"][0]

    parts = [[], [], []]
    for j in range(count):
        for axis in range(3):
            move = np.zeros((count, 3))
            move[j, axis] = 1e-5
            ahead, behind = forward(begin + move), forward(begin - move)
            for part, a, b in zip(parts, ahead, behind, strict=True):
                part.append(((a - b) / 2e-5).ravel())
    sigma = np.array([4e-6, 5e-10 / np.sqrt(10.0)])
    angle, rate_dot, felt = (np.array(part).T for part in parts)
    fisher = angle.T @ angle / sigma[0] ** 2 + rate_dot.T @ rate_dot / sigma[1] ** 2
    every = np.arange(0.05, time[-1], 0.1)  # s; a corner of 20 mHz
    for k, corner in ((3, (0.4 * np.pi / step) ** 2), (5, (0.4 * np.pi / step) ** 6)):
        slow = BSpline(knots, np.eye(count), 5).derivative(k)(every)
        fisher += np.kron(slow.T @ slow * 0.1 / corner / (sigma[1] ** 2 * 5.0), np.eye(3))
    scale = 1 / np.sqrt(np.diag(fisher))
    inverse = np.linalg.inv(fisher * scale[:, None] * scale) * scale[:, None] * scale
    bound = np.sum((felt @ inverse) * felt, axis=1).reshape(-1, 3) + (7.5e-12**2 / 10)
    reported = np.diagonal(found["one_sensor"]["covariance"].values, axis1=1, axis2=2)
    assert_allclose(np.sqrt(reported.mean(axis=0)), np.sqrt(bound.mean(axis=0)), rtol=0.01)


def test_errors_equal_their_standard_deviations_over_many_records():
    """Recovery: 6 records of two hours, 25,920 values each way, correlated over 20 s: ratio 0.95 to 1.05."""
    gathered = {"one_sensor": [], "two_sensor": []}
    pressure = []
    for seed in range(6):
        columns, truth = fly(seed)
        found = solve(columns, tuple(gathered))[1]
        for name, values in gathered.items():
            values.append(ratio(found[name], truth))
        one = found["one_sensor"]
        sigma = np.sqrt(np.diag(one["pressure_covariance"].values))
        pressure.append((one["pressure"].values - truth["centre_of_pressure_m"]) / sigma)
    for values in gathered.values():
        assert 0.95 < np.sqrt(np.mean(np.array(values) ** 2)) < 1.05
    assert np.sum(np.square(pressure)) < 39.4  # 99.75 % of chi-square with 18 degrees of freedom


def test_the_centre_of_pressure_has_the_error_of_a_spectrum_that_is_measured_beside_it():
    """Recovery: 5 h, lines of the drag in torque that falls by 1e3 in power; 120 values within 99.9 % of chi-square."""
    satellite, rng = catalog.satellite("S").settings(), np.random.default_rng(11)
    frequency = np.fft.rfftfreq(600, 60.0)
    amplitude = np.sqrt(300 / 60.0) * np.maximum(2e-5 / (1 + (frequency / 2e-3) ** 4), 2e-7)
    autocovariance = np.fft.irfft(amplitude**2 / 300, 600)
    time, found = 60.0 * np.arange(300), []
    lower = np.linalg.cholesky(autocovariance[np.abs(np.subtract.outer(np.arange(300), np.arange(300)))])
    for _ in range(40):
        true, still = np.array([0.1, 0, 0]) + rng.normal(0, [0.1, 0.05, 0.05]), np.zeros(3)
        turn = 2 * np.pi * time[:, None, None] / rng.uniform(250, 1200, (8, 3)) + rng.uniform(0, 6, (8, 3))
        drag = [-1.1e-7, 1e-8, -6e-9] + 3e-9 * np.sum(rng.standard_normal((8, 3)) * np.sin(turn), axis=1)
        torque = lower @ rng.standard_normal((300, 3)) + satellite["mass"] * np.cross(true, drag)
        value, spread, _ = estimate.balance(torque, drag, still, satellite, width=1, step=60.0)
        found.append((value - true) / np.sqrt(np.diag(spread)))
    assert 0.81 < np.sqrt(np.mean(np.square(found))) < 1.22


def test_without_noise_the_methods_return_the_drag():
    """Recovery: what is left is motion above 5 mHz that smoothing holds back; the printed method misses by 1e-9.

    It is less than the error of smoothing, 3e-12 m s-2: of changes of torque that noise would hide no more is taken.
    """
    columns, truth = fly(1, sensor_noise=0, tracker_noise=0, field_error_scale=0)
    _, found = solve(columns)
    error = {name: np.abs(one["drag_b"].values - truth["drag"])[50:-50].max() for name, one in found.items()}
    assert error["two_sensor"] < 2e-14
    assert np.sqrt(np.mean((found["one_sensor"]["drag_b"].values - truth["drag"]) ** 2)) < 2e-12
    assert error["one_sensor_published"] > 1e-9
    printed = found["one_sensor_published"]
    assert_allclose(printed["drag_b"], printed["bare_b"], rtol=0, atol=1e-16)


def test_unknown_places_are_in_the_total_error():
    """Recovery: places drawn from their prior; 8 records, 24 constants: error over total sigma within 0.7 to 1.35."""
    values = []
    for seed in range(8):
        columns, truth = fly(20 + seed, duration_s=1800, position_scatter=1)
        found = solve(columns, ("one_sensor",))[1]["one_sensor"]
        values.append(np.mean(ratio(found, truth, total=True)[:, 1:] ** 2))
    assert 0.7 < np.sqrt(np.mean(values)) < 1.35


def test_an_elongated_test_mass_is_modelled():
    """Recovery: elongation 2 gives angular readings of 1e-6 rad s-2; with the setting the rates stay at their error."""
    columns, truth = fly(2, elongation=2.0)
    modelled, found = solve(columns, ("one_sensor",), elongation=2.0)
    assert 0.9 < np.sqrt(np.mean(ratio(found["one_sensor"], truth) ** 2)) < 1.1
    assert 0.9 < float(modelled["attitude_chi2"][0] / modelled["attitude_dof"][0]) < 1.1
    wrong, _ = solve(columns, ("one_sensor",))
    assert float(wrong["attitude_chi2"][0] / wrong["attitude_dof"][0]) > 1.5


def test_the_gravity_prior_is_what_the_elements_say():
    """Recovery: 40,000 tensors drawn element by element; covariance of dG r to 3 % of its largest element."""
    rng = np.random.default_rng(5)
    rr, rt, tt = 1.0, 0.6, 0.3
    up = rng.standard_normal(3)
    up /= np.linalg.norm(up)
    one = np.cross(up, [1.0, 0, 0])
    one /= np.linalg.norm(one)
    frame = np.stack([up, one, np.cross(up, one)])
    a, b, c, d, e = rng.standard_normal((5, 40000)) * np.sqrt([rr, rt, rt, tt, tt])[:, None]
    G = np.array([[a, b, c], [b, -a / 2 + d, e], [c, e, -a / 2 - d]]).transpose(2, 0, 1)
    place = np.array([0.3, -0.2, 0.5])
    drawn = (frame.T @ G @ frame) @ place
    found = estimate.gravity_covariance((rr, rt, tt), up[None], place)[0]
    assert_allclose(found, np.cov(drawn.T), atol=0.03 * np.abs(found).max())


def test_priors_determine_the_drag_one_after_the_other():
    """Contract: the gravity field is what makes the drag determined; the torque adds next to nothing."""
    columns, truth, modelled, found = solved_day()
    known = model.truth(observed(columns).assign(drag=(("time", "axis"), truth["drag"])))
    chosen = catalog.parameters("gradient_torque").for_stage("combine")
    settings = {"single_sensor": 1, "elongation": 1.0, "satellite": SATELLITE, "methods": list(found)} | chosen
    combined = estimate.combine(modelled, *found.values(), known, *found.values(), **settings)
    sigma, rank = combined["step_sigma"].values, combined["step_rank"].values
    names = [str(name) for name in combined["step"].values]
    assert np.isnan(sigma[names.index("place of the test mass")]).all()
    assert np.isfinite(sigma[names.index("gravity field")]).all()
    assert np.all(np.diff(rank) >= 0)
    assert rank[-1] == combined["step_unknowns"].values[-1]
    before, after = (sigma[names.index(name)] for name in ("smooth rotation, star camera", "slow torque"))
    assert_allclose(after, before, rtol=1e-3)
    assert_allclose(combined["error_over_sigma"].values[[0, 2]], 1, atol=0.07)


def test_degree_one_is_empty_and_a_cube_has_no_part():
    """Analytic: erratum S-9; a cube has no part in the torque; degrees beyond are refused; a sine is its line."""
    time = np.arange(1000.0)
    frequency, amplitude = model.amplitude_spectrum(2 * np.sin(2 * np.pi * 0.05 * time)[:, None], 1.0)
    assert_allclose([amplitude.max(), frequency[np.argmax(amplitude)]], [2, 0.05], rtol=1e-3)
    columns, _, modelled, _ = solved_day()
    chosen = catalog.parameters("gradient_torque").with_settings({"highest_degree": 8})
    spectra = {}
    for elongation in (1.0, 2.0):
        settings = chosen.with_settings({"elongation": elongation}).for_stage("torque")
        spectra[elongation] = model.torque(modelled, observed(columns), STORED, satellite=SATELLITE, **settings)
    assert np.all(spectra[1.0]["amplitude"].values[0] == 0)
    assert np.all(spectra[1.0]["test_mass_rms"].values == 0)
    assert np.all(spectra[1.0]["rms"].values[1:] > 0)
    assert np.all(spectra[2.0]["test_mass_rms"].values[1:, 1] > 0)
    beyond = chosen.for_stage("torque") | {"highest_degree": 21}
    with pytest.raises(ProductError, match="highest_degree=20"):
        model.torque(modelled, observed(columns), STORED, satellite=SATELLITE, **beyond)


def test_gaps_and_missing_attitudes_are_bridged_and_long_gaps_refused():
    """Recovery: 5 % of attitudes and a gap of 25 s missing; a gap of 60 s is refused with its length."""
    columns, truth = fly(6)
    columns["q"][::20] = np.nan

    def without(lost):
        kept = np.delete(np.arange(columns["time"].size), lost)
        return kept, {name: one if name == "sensor_position" else one[kept] for name, one in columns.items()}

    kept, cut = without(slice(400, 404))
    found = solve(cut, ("one_sensor",))[1]["one_sensor"]
    assert 0.9 < np.sqrt(np.mean(ratio(found, {"drag": truth["drag"][kept]}) ** 2)) < 1.1
    with pytest.raises(EstimationError, match="gap of 65 s"):
        solve(without(slice(400, 412))[1])


def test_what_a_method_cannot_do_is_refused():
    """Contract: two sensors need two, the printed algorithm divides by each component, infinite readings solve none."""
    columns, _ = fly(7, duration_s=600, sensors=1)
    with pytest.raises(EstimationError, match="found one sensor"):
        solve(columns, ("two_sensor",))
    with pytest.raises(EstimationError, match="Set it to 1"):
        solve(columns, ("one_sensor",), single_sensor=2)
    columns["sensor_position"] = np.array([[0.1, 0.0, 0.0]])
    with pytest.raises(EstimationError, match="divides by each"):
        solve(columns, ("one_sensor_published",))
    with pytest.raises(np.linalg.LinAlgError, match="infinite"):
        attitude.solve(np.ones((18, 6)), np.array([0, 0, np.inf, 0, 0, 0]))


SATELLITE = catalog.satellite("S").settings()
FIELD = icgem.read_field(icgem.shipped(), 20)
STORED = model.field(FIELD)
DAY = 633830400.0
SHORT = {"duration_s": 7200, "step_s": 5, "field_degree": 20}


def observed(columns):
    """Dataset as the reader of SGRS files gives it."""
    known = {name: (dims, columns[name]) for name, (dims, _, _) in daily.LAYOUTS["SGRS"].items()}
    return xr.Dataset(known, {"time": columns["time"]})


def fly(seed, effects=None, nongravitational=None, **settings):
    """Columns and truth of an invented record."""
    chosen = catalog.parameters("simulate_gradient_torque").with_settings(SHORT | settings)
    return simulation.simulate(SATELLITE, chosen, FIELD, DAY, seed, by_slug(effects or {}), nongravitational)


def solve(columns, methods=("two_sensor", "one_sensor_published", "one_sensor"), **settings):
    """Products gradient and drag, by the stages' own functions."""
    chosen = catalog.parameters("gradient_torque").with_settings({"field_degree": 20} | settings)
    modelled = model.gradient(observed(columns), STORED, satellite=SATELLITE, **chosen.for_stage("gradient"))
    given = {"satellite": SATELLITE, **chosen.for_stage("drag")}
    return modelled, {name: estimate.drag(modelled, variant=name, **given) for name in methods}


@functools.cache
def solved_day():
    """Columns, truth and products of one record, by all methods."""
    columns, truth = fly(1)
    return columns, truth, *solve(columns)


def ratio(found, truth, total=False):
    """Errors over standard deviations, (n, 3)."""
    covariance = found["covariance_total" if total else "covariance"].values
    return (found["drag_b"].values - truth["drag"]) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


CONTROL = 2 * np.pi * 1e-3  # rad s-1
BODY, CUBE = np.diag([110.0, 580.0, 650.0]), 7.5e-5 * np.eye(3)
MEAN_MOTION = 1.11e-3


def test_the_printed_algorithm_returns_its_closed_form_which_is_the_bare_reading():
    """Published: erratum S-6, a_16 = a_drag + p (h.Dg - q_d.a_drag)/|p|^2 with eq. 13 as truth, to 1e-15.

    Erratum S-8, cube, 1 mm, drag 2e-7: |a_16 + a_rel| 5e-18 m s-2, error |G r| 3e-9.
    """
    rng = np.random.default_rng(0)
    h, q_d = rng.standard_normal((2, 3))
    difference, drag = rng.standard_normal((2, 20, 3))
    linear, angular = difference - drag, np.cross(h, difference) - np.cross(q_d, drag)
    found, scalar = model.printed_drag(linear, angular, h, q_d)
    p = q_d - h
    wrong = (difference @ h - drag @ q_d)[:, None] * p / (p @ p)
    assert_allclose(found, drag + wrong, rtol=0, atol=2e-14)  # rounding of numbers of size one
    assert_allclose(scalar, 0, atol=2e-14)
    assert np.median(np.linalg.norm(wrong, axis=1) / np.linalg.norm(drag, axis=1)) > 0.1
    place, drag = np.full(3, 1e-3), np.array([[-2e-7, 1e-8, 5e-9]])
    tensor = MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0])
    linear = tensor @ place - drag
    angular = model.gradient_angular_acceleration(CUBE, BODY, tensor)[None]
    h, q_d = model.printed_vectors(BODY, CUBE, 600.0, np.array([0.1, 0.0, 0.0]), place)
    found, _ = model.printed_drag(linear, angular, h, q_d)
    assert np.abs(found + linear).max() < 1e-17
    assert_allclose(np.linalg.norm(found - drag), np.linalg.norm(tensor @ place), rtol=1e-6)
    assert_allclose(np.linalg.norm(found - drag), 3.0e-9, rtol=0.05)
    assert_allclose(model.drag(linear[:, None], np.zeros(3), np.zeros(3), tensor, [place]), drag, atol=1e-22)


def test_the_bracket_of_the_drag_torque_matters_and_two_sensors_cancel_only_in_the_middle():
    """Published: S-4: (I^-1 x) x a is not I^-1 (x x a); S-3: 1 mm of middle leaves 3 n^2 x 1 mm, 3.7e-9 m s-2."""
    x, a = np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, -1.0])
    assert not np.allclose(np.linalg.solve(BODY, np.cross(x, a)), np.cross(np.linalg.solve(BODY, x), a))
    _, q_d = model.printed_vectors(BODY, CUBE, 600.0, x, np.ones(3))
    assert_allclose(q_d, 600 * x / np.diag(BODY))
    turning = np.array([0, -MEAN_MOTION, 0]), np.zeros(3), MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0])
    places, drag = np.array([[0.1, 0, 1e-3], [-0.1, 0, 1e-3]]), np.array([-1e-7, 0, 0])
    linear = np.stack([-offset_tensor(*turning) @ p - drag for p in places])
    assert_allclose(model.drag(linear, *turning, places), drag, atol=1e-22)
    assert_allclose(np.linalg.norm(-linear.mean(axis=0) - drag), 3.7e-9, rtol=0.01)


def test_a_cube_feels_no_gravity_gradient_torque_and_a_long_mass_does():
    """Analytic: erratum S-5; a rod's torque is 3 mu/r^3 e x (J e)."""
    e = np.array([0.6, 0.0, 0.8])
    tensor = GM / 6.87e6**3 * (3 * np.outer(e, e) - np.eye(3))
    satellite = {"test_mass": 0.54, "test_mass_inertia": 0.54 * 0.03**2 / 6 * np.eye(3)}
    cube, long = (model.box_inertia(satellite, k) for k in (1.0, 2.0))
    assert_allclose(model.free_mass_angular_acceleration(cube, tensor, np.zeros(3)), 0, atol=1e-22)
    expected = np.linalg.solve(long, 3 * GM / 6.87e6**3 * np.cross(e, long @ e))
    assert_allclose(model.free_mass_angular_acceleration(long, tensor, np.zeros(3)), expected, rtol=1e-12)
    assert_allclose(np.diag(cube), 0.54 * 0.03**2 / 6)
    assert long[0, 0] < long[1, 1]


def test_the_printed_torque_is_that_of_a_tensor_of_rank_one():
    """Published: erratum S-1: dg x (I q), q = (1/Dx, 1/Dy, 1/Dz), is right for G = dg q^T alone.

    Along the orbit axes the true torque is zero, the printed one (-2.2, 1.1, -0.6) mN m and another one elsewhere.
    """
    gradient = MEAN_MOTION**2 * np.diag([-1.0, -1.0, 2.0])
    printed = functools.partial(model.printed_torque, BODY)
    places, dg = np.array([1e-3, 2e-3, -5e-4]), np.array([3e-9, -2e-9, 1e-9])
    twice = BODY @ np.outer(1 / places, dg) - np.outer(dg, 1 / places) @ BODY  # (G I)^T - G I, eq. 1
    assert_allclose(printed(np.outer(dg, 1 / places) / 3, places), [twice[2, 1], twice[0, 2], twice[1, 0]], rtol=1e-12)
    assert_allclose(gravity_gradient_torque(BODY, gradient), 0)
    one = np.full(3, 1e-3)
    assert_allclose(printed(gradient, one), [-2.2e-3, 1.1e-3, -0.6e-3], atol=6e-5)
    assert np.abs(printed(gradient, one * [1, -1, 1]) - printed(gradient, one)).max() > 1e-3


def test_one_epoch_has_rank_six_of_eight_and_the_printed_pair_five():
    """Published: errata S-8, S-6: at the centre of mass translation alone sees the drag; null along p = q_d - h."""
    cube = 8e-5 * np.eye(3)
    for place, drag_seen in (([1e-3, 2e-3, -1e-3], False), ([0.0, 0.0, 0.0], True)):
        sensor = model.Sensor(BODY, cube, 600.0, np.array(place), np.array([0.1, 0.02, 0.03]))
        rank, null = model.single_epoch(sensor)
        assert (rank, len(null)) == (6, 2)
        assert np.abs(null[:, 5:]).max() < 1e-12 if drag_seen else np.abs(null[:, 5:]).max() > 1e-3
        assert drag_seen or np.abs(null[:, 2:5]).max() < 0.01 * np.abs(null[:, :2]).max()
    h, q_d = model.printed_vectors(BODY, cube, 600.0, np.array([0.1, 0, 0]), np.array([1e-3, 2e-3, 1e-3]))
    rank, null = model.printed_pair(h, q_d)
    p = (q_d - h) / np.linalg.norm(q_d - h) / np.sqrt(2)
    assert rank == 5
    assert_allclose(np.abs(null @ np.concatenate([p, p])), 1, rtol=1e-9)


def test_errors_of_motion_reach_the_drag_as_differences_say():
    """Analytic: derivatives of T r by attitude, rate and angular acceleration against central differences."""
    rng = np.random.default_rng(1)
    w, wd, place = 1e-3 * rng.standard_normal(3), 1e-6 * rng.standard_normal(3), 0.1 * rng.standard_normal(3)
    tensor = 1e-6 * rng.standard_normal((3, 3))
    tensor = tensor + tensor.T
    parts = model.offset_tensor_error(w, tensor, place)

    def felt(angle, rate, rate_dot):
        R = frames.R_bi_from_quaternion(frames.from_rotation_vector(angle))
        return offset_tensor(w + rate, wd + rate_dot, R @ tensor @ R.T) @ place

    for k, size in enumerate((1e-4, 1e-5, 1e-8)):
        for axis in range(3):
            moves = np.zeros((3, 3))
            moves[k, axis] = size
            assert_allclose(parts[k][:, axis], (felt(*moves) - felt(*-moves)) / (2 * size), rtol=1e-6, atol=1e-14)


def test_rates_from_angles_agree_with_the_attitude():
    """Analytic: angles of 0.1 rad on a turning frame; rates of the composed attitude by seven-point differences."""
    time = np.arange(-10.0, 11.0)
    w = 2 * np.pi / 300
    size, phase = np.array([0.1, -0.05, 0.08]), np.array([0.0, 1.0, 2.0])
    u = w * time[:, None] + phase
    angle, first, second = size * np.sin(u), size * w * np.cos(u), -size * w**2 * np.sin(u)
    rate_o = np.tile([2e-4, -1.1e-3, 3e-4], (time.size, 1))
    R_oi = frames.R_bi_from_quaternion(frames.from_rotation_vector(time[:, None] * rate_o))
    R_bi = attitude.R_bo(angle) @ R_oi
    found = attitude.body_rates(angle, first, second, rate_o, np.zeros_like(rate_o))
    q = frames.continuous(frames.quaternion_from_R_bi(R_bi))
    expected = kinematics.rates_from_attitude(time, q, half_width=3, degree=6)
    assert_allclose(found[0][5:-5], expected[0][5:-5], rtol=0, atol=1e-11)
    assert_allclose(found[1][5:-5], expected[1][5:-5], rtol=0, atol=1e-11)
    assert_allclose(attitude.angles(q, R_oi), angle, atol=1e-14)
