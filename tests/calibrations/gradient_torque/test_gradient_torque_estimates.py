"""Drag, rates and what can be told apart: bounds and recovery."""

import numpy as np
import pytest
from gradient_torque_days import SATELLITE, STORED, fly, observed, ratio, solve, solved_day
from numpy.testing import assert_allclose
from scipy.interpolate import BSpline

from gravcal import catalog
from gravcal.calibrations.gradient_torque import attitude, estimate, model
from gravcal.errors import EstimationError, ProductError
from gravcal.physics import gravity
from gravcal.physics.sensing import offset_tensor


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


def test_the_one_sensor_error_is_at_its_bound():
    """Analytic: Fisher matrix of angles and angular accelerations by differences of scipy splines; sigma to 1 %."""
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


def test_without_noise_the_methods_return_the_drag():
    """Recovery: what is left is the motion beyond the splines; 1e-12 m s-2, the printed method misses by 1e-9."""
    columns, truth = fly(1, sensor_noise=0, tracker_noise=0, field_error_scale=0)
    _, found = solve(columns)
    error = {name: np.abs(one["drag_b"].values - truth["drag"])[50:-50].max() for name, one in found.items()}
    assert error["two_sensor"] < 2e-14
    assert error["one_sensor"] < 2e-12
    assert error["one_sensor_published"] > 1e-9
    assert_allclose(
        found["one_sensor_published"]["drag_b"], found["one_sensor_published"]["bare_b"], rtol=0, atol=1e-16
    )


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


def test_a_moved_mounting_shows_in_both_methods():
    """Recovery: the effect's contribution is what the drag is off by."""
    methods = "two_sensor", "one_sensor"
    _, truth, _, plain = solved_day()
    found = solve(fly(1, {"gradient.mounting.z": 1e-3})[0], methods)[1]
    tensor = offset_tensor(truth["rate"], truth["rate_dot"], truth["gradient"])
    for name in methods:
        change = found[name]["drag_b"].values - plain[name]["drag_b"].values
        assert_allclose(change, tensor @ [0, 0, 1e-3], rtol=0, atol=1e-15)


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
    """Analytic: erratum S-9; torque is linear in the field; a cube has no part in it."""
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
    field, position = model.field_of(STORED), columns["position"][:5]
    parts = [gravity.gradient_e(gravity.zonal(field, n), position) for n in range(2, 9)]
    cosine = field.cosine[:9, :9] * (np.arange(9) == 0)
    zonals = gravity.Field(field.gm, field.radius, cosine, 0 * field.sine[:9, :9])
    whole = gravity.gradient_e(gravity.truncated(zonals, 2, 8), position)
    assert_allclose(sum(parts), whole, rtol=0, atol=1e-21)
    beyond = chosen.for_stage("torque") | {"highest_degree": field.degree + 1}
    with pytest.raises(ProductError, match=f"highest_degree={field.degree}"):
        model.torque(modelled, observed(columns), STORED, satellite=SATELLITE, **beyond)


def test_a_sine_shows_its_amplitude():
    """Analytic: amplitude 2 in the line of its frequency."""
    time = np.arange(1000.0)
    frequency, amplitude = model.amplitude_spectrum(2 * np.sin(2 * np.pi * 0.05 * time)[:, None], 1.0)
    assert_allclose(amplitude.max(), 2, rtol=1e-3)
    assert_allclose(frequency[np.argmax(amplitude)], 0.05)


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
    """Contract: two sensors need two, the printed algorithm divides by each component of the place."""
    columns, _ = fly(7, duration_s=600, sensors=1)
    with pytest.raises(EstimationError, match="found one sensor"):
        solve(columns, ("two_sensor",))
    with pytest.raises(EstimationError, match="Set it to 1"):
        solve(columns, ("one_sensor",), single_sensor=2)
    columns["sensor_position"] = np.array([[0.1, 0.0, 0.0]])
    with pytest.raises(EstimationError, match="divides by each"):
        solve(columns, ("one_sensor_published",))


def test_readings_of_infinite_size_solve_no_equations():
    """Contract: an error that stages turn into one of the input; a trace of scipy before."""
    with pytest.raises(np.linalg.LinAlgError, match="infinite"):
        attitude.solve(np.ones((18, 6)), np.array([0, 0, np.inf, 0, 0, 0]))
