"""Parts of the inertial-sensor calibration: integration, cleaning, means, bias."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.calibrations.inertial_sensor import align, bias, responses
from gravcal.calibrations.inertial_sensor.estimate import Record, factor_y, published_offset_matrix
from gravcal.calibrations.inertial_sensor.noise import cubic, spectra_of
from gravcal.effects import inertial_sensor as electrodes
from gravcal.estimation import noise
from gravcal.estimation.noise import coloured
from gravcal.physics import frames, kinematics, sensing
from gravcal.simulation import by_slug
from gravcal.simulation import inertial_sensor as simulation


def test_a_small_change_of_rates_moves_the_attitude_to_first_order():
    """Analytic: linear response against two integrations."""
    time = np.arange(0, 200, 0.1)
    rate = np.stack([1e-4 * np.sin(time / 4), -1e-3 + 0 * time, 1e-4 * np.cos(time / 5)], axis=1)
    change = 1e-7 * np.stack([np.cos(time / 7), np.sin(time / 3), 1 + 0 * time], axis=1)
    q, moved = (kinematics.attitude_from_rates(time, w, [1.0, 0, 0, 0]) for w in (rate, rate + change))
    linear = kinematics.angle_from_rate_change(time, frames.R_bi_from_quaternion(q), change[:, :, None])[:, :, 0]
    assert_allclose(frames.attitude_error(moved, q), linear, atol=2e-9)  # square of 2e-5 rad


def test_a_spike_is_found_and_white_noise_measured_on_a_smooth_motion():
    """Analytic: one sample of forty sigma on a ramp; standard deviation of 1e-5 on a swing of 3e-4, to 5 %."""
    time = np.arange(200) * 0.01
    values = np.stack([time, -time], axis=1) * 0.1 + 0.01 * np.random.default_rng(1).standard_normal((200, 2))
    values[77, 0] += 0.4
    spike = align.spikes(values, 5, 8.0)
    assert np.flatnonzero(spike.any(axis=1)).tolist() == [77]
    assert abs(align.repaired(time, values, spike)[77, 0] - 0.1 * time[77]) < 0.04  # four sigma of a sample
    time = np.arange(4000) * 0.25
    noise = 1e-5 * np.random.default_rng(2).standard_normal((4000, 3))
    variance = align.scatter_of_third_differences(3e-4 * np.sin(0.23 * time)[:, None] + noise)
    assert_allclose(np.sqrt(variance), 1e-5, rtol=0.05)  # three standard errors


def test_gaps_stay_and_end_segments_and_means_leave_spikes_out():
    """Analytic: three samples missing; a bin with a spike and a NaN has the mean of the rest; 30 and 25 bins of 10."""
    time = np.delete(np.arange(100) * 0.1, [40, 41, 42])
    out = align.on_grid(time, time[:, None], np.arange(100) * 0.1)
    assert np.flatnonzero(~np.isfinite(out[:, 0])).tolist() == [40, 41, 42]
    assert_allclose(out[50, 0], 5.0, atol=1e-12)
    time = np.arange(1000) * 0.1
    values = np.random.default_rng(3).standard_normal((1000, 2))
    expected = values[100:200].copy()
    values[150, 0], values[160, 1] = 1e3, np.nan
    mean, count = align.clipped_means(time, values, np.arange(0, 101, 10.0))
    assert_allclose(mean[1, 0], np.delete(expected[:, 0], 50).mean(), rtol=1e-9)
    assert_allclose(mean[1, 1], np.delete(expected[:, 1], 60).mean(), rtol=1e-9)
    assert count[1].tolist() == [99, 99]
    time = np.concatenate([np.arange(30), 100 + np.arange(25)]) * 10.0
    assert [part.start for part in bias.cut(time, 100.0)[1]] == [0, 10, 20, 30, 40]


def test_the_orbit_frame_is_that_of_the_sensor_in_normal_pointing():
    """Analytic: x outward, z along the flight, y = z x x."""
    R_oi = frames.flight_frame(np.array([[7e6, 0, 0, 0, 7.5e3, 0]]))[0]
    assert_allclose(R_oi @ [1, 0, 0], [1, 0, 0], atol=1e-15)
    assert_allclose(R_oi @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    assert_allclose(np.cross(R_oi[2], R_oi[0]), R_oi[1], atol=1e-15)


def test_rolling_leaves_a_constant_offset_term_and_the_printed_matrix_differs_in_one():
    """Published: T-10 with Table 5: 1.1e-8 and 6.8e-8 m s-2 for 724 s; of eq. 13 element (3,1) is misprinted (T-1)."""
    rate = np.broadcast_to([0.0, 2 * np.pi / 724, 0.0], (100, 3))
    tensor = bias.offset_terms(rate, np.zeros((100, 3, 3)), 10.0)
    felt = np.abs(tensor.mean(axis=0) @ [-140.02e-6, 627.75e-6, -896.46e-6])
    assert_allclose(felt, [1.1e-8, 0.0, 6.8e-8], atol=0.06e-8)  # printed digits
    w, wd = np.array([1e-4, -1e-3, 2e-4]), np.array([1e-5, 2e-5, 3e-6])
    difference = published_offset_matrix(w, wd, None) - sensing.rotation_tensor(w, wd)
    expected = np.zeros((3, 3))
    expected[2, 0] = 2 * wd[1]
    assert_allclose(difference, expected, atol=1e-20)


def test_a_mean_of_wandering_values_contains_the_wander():
    """Recovery: 300 series of 100, a Markov wander of 2.3 times the noise: the mean is that of the wander."""
    from scipy.signal import lfilter

    rng, keep = np.random.default_rng(5), np.exp(-2500 / 21600)
    slow = lfilter([2.3 * np.sqrt(1 - keep**2)], [1.0, -keep], rng.standard_normal((300, 140)), axis=1)[:, 40:]
    found = [bias.robust_mean(one + rng.standard_normal(100), np.ones(100)) for one in slow]
    ratio = [(mean - one.mean()) / sigma for (mean, sigma, _), one in zip(found, slow, strict=True)]
    assert 0.87 < np.sqrt(np.mean(np.square(ratio))) < 1.13  # 3 standard errors; 1.16 with weights about the mean


def test_a_mean_knows_no_outlier_no_wander_in_its_holes_and_no_error_of_two_values():
    """Analytic: runs of 6 and 8 of 44 values left out of a wander add its size times 10 / 44."""
    many = np.random.default_rng(4).standard_normal(400)
    plain, sigma, _ = bias.robust_mean(many, np.ones(400))
    moved, *_ = bias.robust_mean(np.append(many, 1e3), np.append(np.ones(400), 1e3))
    assert abs(moved - plain) < 0.5 / np.sqrt(400)
    assert_allclose(sigma, 1 / np.sqrt(400), rtol=1e-12)  # the errors given
    assert all(np.isnan(bias.robust_mean(np.ones(size), np.ones(size))[1]) for size in (0, 2))
    values = 2 * np.random.default_rng(4).standard_normal(30)
    _, sigma, wander = bias.robust_mean(values, np.full(30, 1e-3), missing=(6, 8))
    assert_allclose(sigma, wander * 10 / 44, rtol=1e-4)  # noise 1e-3 beside it
    assert 1.2 < wander < 2.8  # scatter of the median deviation of thirty


def test_correlated_noise_widens_the_error_of_a_segment():
    """Recovery: first-order noise of coefficient 0.5 has (1 - 0.25) / 0.25 = 3 times the density at zero."""
    from scipy.signal import lfilter

    white = np.random.default_rng(7).standard_normal((40, 250, 3))
    red = lfilter([1.0], [1.0, -0.5], white, axis=1)
    assert_allclose(bias.redness(red, 10.0), np.sqrt(3), rtol=0.05)  # two per cent scatter of 10,000 samples
    assert_allclose(bias.redness(white, 10.0), 1.0, atol=0.05)


def test_the_error_of_a_model_is_in_the_bias_of_a_roll():
    """Analytic: moves add in squares; what one of them leaves undetermined does not move."""

    def biased(value):
        values = {"bias": value, "bias_sigma": [3.0, 1.0, 2.0], "bias_sigma_total": [0.0, 5.0, np.nan]}
        return xr.Dataset({name: ("axis", np.array(given)) for name, given in values.items()})

    moved = biased([4.0, 2.0, 1.0]), biased([0.0, 2.0, np.nan])
    found = bias.with_model_error(biased([0.0, 2.0, 1.0]), *moved, kind="inertial_sensor.bias")
    assert_allclose(found["bias_sigma"], [5.0, 1.0, 2.0])
    assert_allclose(found["bias_sigma_total"], [4.0, 5.0, np.nan])


def test_power_laws_go_on_below_what_a_fit_leaves():
    """Recovery: flicker below 3 mHz beside white noise, lines of segments fitted: to a third in amplitude."""
    count, frequency = np.arange(2000).reshape(8, 250), np.array([4e-4, 1e-3, 4e-3, 2e-2])
    truth = lambda f: 4.0 * (1 + 3e-3 / f)  # noqa: E731
    drawn = coloured(truth, 2000, 10.0, np.random.default_rng(8)).reshape(8, 250, 1)
    line = np.linalg.qr(np.vander(np.linspace(-1, 1, 250), 2))[0]

    def clean(values):
        return list(values - np.einsum("bq,cq,scd->sbd", line, line, values))

    found = noise.power_laws(drawn, clean, count, 10.0).density(frequency)
    assert_allclose(np.log(found / truth(frequency)), 0.0, atol=2 * np.log(4 / 3))
    short = noise.fit_noise([one[:, 0] for one in clean(drawn)], 3, 10.0).density(frequency)
    assert abs(np.log(short[0] / truth(frequency[0]))) > 2 * np.log(4 / 3)  # a short memory stops at 4 mHz


def test_what_changes_along_y_with_the_revolution_is_no_residual():
    """Analytic: the constant about y is the mean of the reading, and a wave of one revolution leaves nothing."""
    phase = 1.1e-3 * 10.0 * np.arange(250)
    reading = 1e-7 + 5e-9 * np.cos(phase + 0.3)[:, None]
    constant, _, residual, _ = bias.solve_axis(1, reading, np.zeros((250, 3, 3)), bias.Model(2, 1, 2), phase)
    assert_allclose(residual, 0, atol=1e-20)
    assert_allclose(constant, reading.mean(), atol=1e-11)  # Legendre polynomials of samples hold a mean of 1/n


@pytest.mark.parametrize("exponent", [0, -2])
def test_a_step_is_told_from_noise_and_noise_is_no_step(exponent):
    """Recovery: a jump of twenty times the scatter of white noise or of the steps of a random walk, within two bins."""
    series = np.random.default_rng(46).standard_normal((40, 1500))
    series = np.cumsum(series, axis=1) if exponent else series
    assert sum(noise.jump(one) is not None for one in series) <= 1
    assert sum(abs((noise.jump(one) or 0) - 700) <= 2 for one in series + 20.0 * (np.arange(1500) > 700)) >= 38


def test_a_turned_tracker_turns_the_tensor_of_a_roll():
    """Analytic: a tracker turned by a small e sees T' = R(e)' T R(e); readings hold T p - T' p beyond its model."""
    rng, angle = np.random.default_rng(47), np.array([2e-6, -1e-6, 3e-6])
    tensor, place = rng.standard_normal((1, 4, 3, 3)), rng.standard_normal(3)
    view = SimpleNamespace(tensor=tensor, start=np.append(np.zeros(3), place))
    R = frames.R_bi_from_quaternion(frames.from_rotation_vector(-angle))  # of sensor from tracker components
    expected = np.matvec(tensor - R.T @ tensor @ R, place)
    assert_allclose(responses.turned(view) @ angle, expected, atol=1e-10)  # second order


@pytest.mark.parametrize("moving", [True, False])
def test_a_swing_shows_the_factor_of_y(moving):
    """Analytic: a_x gives p_z, a_y = -w'_x p_z its factor, 30 % from where it starts; without w'_x it is unknown."""
    time, k, place = np.arange(0, 200, 0.5), np.array([5.6e-4, 3.5e-4, 1.14e-4]), np.array([-140e-6, 628e-6, -896e-6])
    rate = 1e-4 * np.stack([moving * np.sin(time / 4), np.cos(time / 5), 0.0 * time], axis=1)
    rate_dot = np.gradient(rate, time, axis=0)
    gradient = np.zeros((time.size, 3, 3))
    reading = np.matvec(sensing.offset_tensor(rate, rate_dot, gradient), place) / k
    volts = reading + 1e-7 * np.random.default_rng(3).standard_normal(reading.shape)
    model = noise.NoiseModel(np.zeros(0), np.array([1e-14]), 0.5)
    record = Record(time, volts, rate, rate_dot, gradient, (model,) * 3, 2)
    found, sigma, total = factor_y(record, k * [1, 0.7, 1], np.array([0.01, 0.02, 0.03, 0.03]))
    if moving:
        assert abs(found - k[1]) < 5 * sigma < 0.05 * k[1]
        assert total == pytest.approx(np.hypot(sigma, found * np.hypot(0.01, 0.03)), rel=0.1)  # of beta_x and ratio_y
    else:
        assert not 0 < total < found / 3


def test_a_quadratic_effect_stands_in_the_voltages():
    """Analytic: with the same noise q V^2 of four electrodes, with V of bias over four k."""
    settings = {"manoeuvre": "swing", "quiet_s": 60.0, "swing_s": 60.0}
    how = catalog.satellite("T").settings(), catalog.parameters("simulate_inertial_sensor").with_settings(settings)
    hidden = [by_slug(one) for one in ({}, {"inertial_sensor.quadratic.x": 2e-4})]
    made = [simulation.simulate(*how, 706104000.0, 3, effects) for effects in hidden]
    before, after = (electrodes.readouts(next(spans)["IS1"]["volts"])[:, 0] for spans, _ in made)
    moved, truth = after - before, made[0][1]
    assert_allclose(moved, 2e-4 * truth["bias"][0] ** 2 / truth["k"][0] ** 2 / 4, rtol=1e-2)  # modulation


def test_the_noise_beside_a_swing_is_as_red_as_it_is():
    """Recovery: 40 times two quiet pieces less a cubic each, with a knee at 3 mHz; its logarithm within its error."""
    rng, frequency = np.random.default_rng(6), np.array([5e-3, 1e-2, 2e-2, 5e-2, 0.2])
    density, slow, error, sigma = (lambda f: 1 + (3e-3 / f) ** 2), cubic(385), [], []
    for _ in range(40):
        pieces = [np.stack([coloured(density, 385, 1.0, rng) for _ in range(3)], axis=1) for _ in range(2)]
        for one in spectra_of([piece - slow @ (np.linalg.pinv(slow) @ piece) for piece in pieces], 1.0):
            error.append(np.log(one.model(60, 1.0).density(frequency) / density(frequency)))
            sigma.append(np.log(one.density(frequency, sigmas=1.0) / one.density(frequency)))
    assert np.abs(np.mean(error, axis=0)).max() < 0.2
    assert np.all(np.abs(np.sqrt(np.mean(np.divide(error, sigma) ** 2, axis=0)) - 1.05) < 0.3)
