"""Square waves in sampled currents; attitude, edge times and angular accelerations of single manoeuvres."""

from dataclasses import replace

import com_offset_chain as tools
import numpy as np
import pytest
import seeds
import xarray as xr
from numpy.testing import assert_allclose
from scipy import stats

from gravcal.calibrations.com_offset import attitude
from gravcal.calibrations.com_offset.align import OUTLIER, detect, find_waves
from gravcal.estimation.noise import NoiseModel
from gravcal.estimation.resampling import operator_for
from gravcal.physics import dynamics, frames

SMALL = {"manoeuvres": ("pitch_high",), "quiet_s": 60.0}
CHOICE = attitude.Choice(torque_degree=1, scale_sigma=0.1, shift_sigma=2.0, step_s=1.0, iterations=10)
SIGMA = 3e-6  # rad, white


@pytest.fixture(scope="module")
def window():
    """Window of one pitch manoeuvre with an exact star camera, and its exact motion as fitted."""
    observed, truth = tools.event(31, star_camera_white_rad=0.0, star_camera_slow_rad=0.0, **SMALL)
    made, _ = tools.smoothed(observed)
    satellite = tools.SATELLITE
    inertia, per_current = np.array(satellite["inertia"]), np.array(satellite["dipole_per_current"])
    (one,) = attitude.windows(made["align"], made["field"], inertia, per_current, True)
    white = [NoiseModel(np.zeros(0), np.array([SIGMA**2]), 1.0)] * 3
    return one, attitude.fit_attitude(one, white, CHOICE), white, truth


def turned(arc, solution, time):
    """Attitudes of a solution."""
    return dynamics.integrate(time, solution.state, attitude.torque_of(arc, solution), max_step=1.0)[0]


def drawn(window, solution, rng, good):
    """Motion of a solution with white noise, about half of the signs flipped, nonsense where not good."""
    modelled = turned(window.arc, solution, window.time)
    noisy = frames.quaternion_product(
        modelled, frames.from_rotation_vector(SIGMA * rng.standard_normal((window.time.size, 3)))
    )
    noisy = noisy * rng.choice([-1.0, 1.0], window.time.size)[:, None]
    return np.where(good[:, None], frames.continuous(noisy), np.array([1.0, 0, 0, 0]))


def unknowns(s):
    """Rate and parameters of a solution as one vector."""
    return np.concatenate([s.state.rate_b, s.torque_coefficients.ravel(), s.scale_b, [s.shift]])


def test_the_noise_free_fit_is_exact(window):
    """Recovery: quaternions without noise are met to the linear field between orbit nodes; scale and edges too."""
    one, fit, _, truth = window
    assert np.abs(fit.residual[one.good]).max() < 2e-7  # rad
    assert_allclose(fit.solution.scale_b[1], 1.0, atol=2e-3)
    assert (one.arc.edges[0] + fit.solution.shift) == pytest.approx(truth["manoeuvres"][0]["start"], abs=5e-3)


@pytest.mark.parametrize("lost", [(), (40, 55), (0, 6), (150, 181)])
def test_the_fit_returns_the_truth_within_its_covariance(window, lost):
    """Recovery: 20 draws with sign flips and a gap, scales of their prior; chi-square of all unknowns, 1e-4."""
    one, fit, white, _ = window
    rng, good, chi2 = seeds.generator("test_the_fit_returns_the_truth_within_its_covariance", 4e-4), one.good.copy(), []
    good[slice(*lost) if lost else slice(0, 0)] = False
    early = replace(fit.solution, shift=0.1)  # the first edge well after the origin, where the state is defined
    for _ in range(20):
        true = replace(early, scale_b=1 + CHOICE.scale_sigma * rng.standard_normal(3))
        quaternion = drawn(one, true, rng, good)
        again = attitude.fit_attitude(replace(one, quaternion=quaternion, good=good), white, CHOICE)
        found = again.solution
        turned = frames.quaternion_product(frames.conjugate(true.state.quaternion), found.state.quaternion)
        error = np.concatenate([frames.rotation_vector(turned), unknowns(found) - unknowns(true)])
        chi2.append(error @ np.linalg.solve(again.covariance, error))
    low, high = stats.chi2.interval(1 - 1e-4, 20 * len(again.names))
    assert low < sum(chi2) < high


def test_published_dynamics_leave_the_gradient_torque_out(window):
    """Published: eq. 18 as printed leaves up to 1 mrad in 180 s (issue 2, point 5); 0.1 mrad for 0.2 mrad of pitch."""
    one, fit, _, _ = window
    without = turned(replace(one.arc, gradient_i=None), fit.solution, one.time)
    modelled = turned(one.arc, fit.solution, one.time)
    missed = frames.rotation_vector(frames.quaternion_product(frames.conjugate(modelled), without))[-1]
    assert 3e-5 < np.linalg.norm(missed) < 1e-3
    observed, _ = tools.event(32, manoeuvres=("roll_high", "pitch_high"), quiet_s=60.0)
    full, printed = (tools.smoothed(observed, dynamics=d)[0]["attitude"] for d in ("full", "published"))
    assert full["residual_rms"].values.max() < 6e-6
    assert printed["residual_rms"].values.max() > 2e-5


def test_isolated_outliers_are_left_out():
    """Recovery: wild samples of both instruments that no flag marks; they alone are left out, the motion stays."""
    observed, truth = tools.event(41, **SMALL)
    whole, _ = tools.smoothed(observed)
    assert not any((whole["align"][name] == OUTLIER).any() for name in ("acc_flag", "sca_flag"))
    wild = dict(observed)
    for product, column, size, after in (
        ("ACC1A", "lin_accl_z", 1e-7, 33.0),
        ("ACC1A", "ang_accl_y", -1e-5, 60.2),
        ("SCA1B", "quaticoeff", 3e-4, 77.0),
    ):
        at = np.searchsorted(wild[product]["time_tag"].values, truth["manoeuvres"][0]["start"] + after)
        values = wild[product][column].values.copy()
        values[at] += size
        wild[product] = wild[product].assign({column: ("record", values)})
    left, _ = tools.smoothed(wild)
    assert [int((left["align"][name] == OUTLIER).sum()) for name in ("acc_flag", "sca_flag")] == [2, 1]
    difference = left["attitude"]["rate_b"].values - whole["attitude"]["rate_b"].values
    assert np.abs(difference).max() < 3e-7  # rad s-1, one attitude of 300 less


def test_momentary_readings_place_edges_that_change_sides():
    """Recovery: tags of 0.09998 s, so that edges fall after a sample first and before it later; residuals are noise."""
    edges, dipole = 100.033 + 6.0 * np.arange(31), np.zeros((30, 3))
    dipole[:, 1] = 27.5 * (-1.0) ** np.arange(30)
    body, none = np.diag([110.0, 580.0, 650.0]), (np.zeros(0), np.zeros((0, 3)))
    arc = attitude.Arc(body, edges, dipole, *none, origin=100.0, stop=281.0)
    time, field_b = 95 + 0.09998 * np.arange(1910), np.tile([5e-6, 1e-6, -4e-5], (1910, 1))
    noise = 1e-8 * np.random.default_rng(7).standard_normal((1910, 3))

    def wave(later, momentary=False):
        return attitude.magnetic_acceleration(arc, 0.2 + later, time, field_b, 0.0 if momentary else 0.09998)

    measured = attitude.magnetic_acceleration(arc, 0.25, time, field_b, 0.0) + noise
    operator = operator_for(time, np.ones(1910, dtype=bool), 100.0, 280.0, 0.8, 2.0, 0.5)
    white = [NoiseModel(np.zeros(0), np.array([1e-16]), 0.5)] * 3
    late = lambda near: attitude.shifts_between_samples(arc, time, 0.2 + near, 0.1) - 0.2  # noqa: E731
    found, smooth = (attitude.fit_wave(measured, wave, operator, white, 2, of) for of in (late, None))
    assert found.momentary
    assert found.shift == pytest.approx(0.05, abs=2e-3)
    expected = np.nanstd(operator(noise)[:, 0])
    assert np.nanstd(found.residual[:, 0]) == pytest.approx(expected, rel=0.1)
    assert np.nanstd(smooth.residual[:, 0]) > 3 * expected


def test_delays_from_brackets_cover_the_truth():
    """Recovery: 200 events of seven edges, rms of a flat prior's exact posterior; one edge alone says half a step."""
    rng, found = seeds.generator("test_delays_from_brackets_cover_the_truth", 2e-5), []
    for _ in range(200):
        edge, delay, sigma = rng.uniform(0, 0.5, 7), rng.uniform(-0.4, 0.4), 0.03
        middle, lower, upper = 0.25, np.zeros(7) - 0.25, np.zeros(7) + 0.25
        shift = edge - middle + delay + sigma * rng.standard_normal(7)
        value, error = attitude.delay_from_brackets(shift, np.full(7, sigma), lower, upper)
        found.append((value - delay) / error)
    kurtosis = stats.kurtosis(found, fisher=False)
    assert np.mean(np.square(found)) == pytest.approx(1.0, abs=4.5 * np.sqrt((kurtosis - 1) / 200))
    assert abs(np.mean(found)) < 4.5 / np.sqrt(200)
    value, sigma = attitude.delay_from_brackets(np.array([0.3]), np.array([1e-3]), np.array([-0.25]), np.array([0.25]))
    assert (value, sigma) == (pytest.approx(0.3, abs=1e-3), pytest.approx(0.5 / np.sqrt(12), rel=0.01))


STEP_MA = 0.0537369  # of the telemetry
SETTINGS = {"period_s": 12.0, "period_tolerance_s": 0.6, "minimum_half_periods": 10, "current_threshold_ma": 20.0}
START, HALF_PERIODS = 200.0, 30


def edges_of(start):
    """True edges (31,) s."""
    return start + 6.0 * np.arange(HALF_PERIODS + 1)


def square(time, start, count=HALF_PERIODS, amplitude=110.0, polarity=1):
    """Current (n,) mA of a wave of half periods of 6 s."""
    phase = np.floor((time - start) / 6.0)
    inside = (time >= start) & (time < start + 6 * count)
    return np.where(inside, polarity * amplitude * np.where(phase % 2 == 0, 1, -1), 0.0)


def record(start, length=600.0, rng=None, **wave):
    """Telemetry times and currents (n,), with control noise of 2 mA outside and dither inside if rng is given."""
    time = 0.083329 + np.arange(0, length, 0.5)
    current = square(time, start, **wave)
    if rng is not None:
        current = current + np.where(current == 0, 2.0, 0.1) * rng.standard_normal(time.size)
    return time, np.round(current / STEP_MA) * STEP_MA


def brackets(wave, true):
    """Whether each true edge lies between the samples that bracket it."""
    return (wave.lower <= true + 1e-9) & (true <= wave.upper + 1e-9)


@pytest.mark.parametrize("polarity", [1, -1])
@pytest.mark.parametrize("amplitude", [25.0, 60.0, 110.05])
def test_waves_are_found_at_any_fraction_and_every_edge_is_bracketed(amplitude, polarity):
    """Recovery: 25 random fractions; one wave each, edges and common start within half a second, levels as flown."""
    rng = seeds.generator("test_waves_are_found_at_any_fraction_and_every_edge_is_bracketed", 0)
    for start in START + rng.uniform(0, 1, 25):
        time, current = record(start, rng=rng, amplitude=amplitude, polarity=polarity)
        (wave,) = find_waves(time, current, 1, SETTINGS)
        assert wave.level.size == HALF_PERIODS
        assert brackets(wave, edges_of(start)).all()
        assert np.all(wave.upper - wave.lower < 0.5 + 1e-6)
        assert np.allclose(np.abs(wave.level), amplitude, atol=0.5)
        assert np.sign(wave.level[0]) == polarity
        assert wave.rod == 1
        shift = 6.0 * np.arange(wave.lower.size)
        lower, upper = np.max(wave.lower - shift), np.min(wave.upper - shift)
        assert lower - 1e-9 <= start <= upper + 1e-9
        assert upper - lower <= 0.5 + 1e-9


@pytest.mark.parametrize(("begin", "end"), [(0, 250.3), (271.2, 600), (230.6, 330.1)])
def test_a_wave_cut_by_the_record_is_found_where_it_is_recorded(begin, end):
    """Contract: a part of at least ten half periods is found; inner edges are bracketed."""
    start = START + 0.4
    time, current = record(start, 600.0) if begin else record(start - 90.0, 600.0)
    true = edges_of(start) if begin else edges_of(start - 90.0)
    kept = (time >= begin) & (time <= end)
    waves = find_waves(time[kept], current[kept], 0, SETTINGS)
    assert len(waves) == 1
    inner = (waves[0].lower[1:-1] + waves[0].upper[1:-1]) / 2
    assert np.abs(inner[:, None] - true).min(axis=1).max() <= 0.25 + 1e-6
    assert waves[0].level.size >= 10
    assert waves[0].lower[0] >= time[kept][0] - 1.6
    assert waves[0].upper[-1] <= time[kept][-1] + 1.6


def test_missing_telemetry_widens_an_edge_and_control_of_the_same_sign_moves_none():
    """Contract: the interval of an edge contains the truth, the wave stays one; 20 mA that follow are no wave."""
    start = START + 0.3
    time, current = record(start)
    at = np.searchsorted(time, edges_of(start)[7])
    time, current = np.delete(time, at), np.delete(current, at)
    (wave,) = find_waves(time, current, 0, SETTINGS)
    assert brackets(wave, edges_of(start)).all()
    assert wave.upper[7] - wave.lower[7] == pytest.approx(1.0)
    time = np.arange(0, 600, 0.5) + 0.083
    current = square(time, 100.0)
    stop = np.flatnonzero(current)[-1]
    current[stop + 1 :] = 20.0 * np.sign(current[stop])
    (wave,) = find_waves(time, current, 2, SETTINGS)
    np.testing.assert_allclose(np.abs(wave.level), 110.0)
    assert wave.lower[-1] == time[stop]
    assert wave.upper[-1] == time[stop + 1]


def of_period(period):
    """A square wave of another period."""
    time = np.arange(0, 600, 0.5) + 0.083
    return time, 110 * np.sign(np.sin(2 * np.pi * (time - 100.1) / period)) * ((time > 100) & (time < 300))


TIME = np.arange(0, 600, 0.5)
NO_WAVE = {
    "8 s": lambda: of_period(8.0),
    "15 s": lambda: of_period(15.0),
    "one-sided": lambda: (TIME, np.maximum(square(TIME, 100.0), 0.0)),
    "unequal": lambda: (TIME, np.where(square(TIME, 100.0) < 0, 0.5, 1.0) * square(TIME, 100.0)),
}


@pytest.mark.parametrize("name", NO_WAVE)
def test_what_is_no_wave_is_not_found(name):
    """Contract: signs alternate, sizes agree, the period is a setting; control currents: the measured day has none."""
    assert find_waves(*NO_WAVE[name](), 0, SETTINGS) == []


def magnetometer(time, currents, field_ut):
    """MAG1B as the reader returns it."""
    second, zero = np.floor(time).astype(np.int64), np.zeros(time.size, np.uint8)
    columns = {f"Mfv{a}_RAW": np.full(time.size, field_ut[i]) for i, a in enumerate("XYZ")}
    columns |= {"time_second": second, "time_fraction": time - second, "time_tag": time, "flag": zero, "qualflg": zero}
    return xr.Dataset(
        {n: ("record", v) for n, v in columns.items()} | {"current_b": (("record", "axis"), currents)},
        attrs={"product": "MAG1B"},
    )


FIELDS = {  # rod, field (uT) -> kind: m x B by hand
    (0, (5.0, 1.0, 40.0)): 1,  # x cross z = -y: pitch
    (1, (5.0, 1.0, -40.0)): 0,  # y cross z = x: roll
    (1, (25.0, 1.0, 3.0)): 2,  # y cross x = -z: yaw
    (2, (25.0, 1.0, 3.0)): 1,  # z cross x = y: pitch
    (2, (1.0, 25.0, 3.0)): 0,  # z cross y = -x: roll
}


@pytest.mark.parametrize(("rod", "field"), sorted(FIELDS))
def test_the_kind_is_the_axis_that_the_current_turns(rod, field):
    """Analytic: the larger component of m x B, whatever the rod."""
    time, current = record(START + 0.2)
    currents = np.zeros((time.size, 3))
    currents[:, rod] = current
    found = detect(magnetometer(time, currents, field), **SETTINGS)
    assert (found["rod"].values.tolist(), found["kind"].values.tolist()) == ([rod], [FIELDS[rod, field]])
    assert abs(float(found["start"][0]) - START - 0.2) <= 0.25
    assert abs(float(found["stop"][0]) - START - 0.2 - 180) <= 0.25
    assert found["regular"].values.tolist() == [1]


def test_of_waves_at_the_same_time_the_strongest_is_the_manoeuvre():
    """Contract: cross-talk in the telemetry of another rod makes no second manoeuvre; an empty record holds none."""
    time, current = record(START + 0.7)
    currents = np.stack([0.3 * current, 0 * current, -current], axis=1)
    assert detect(magnetometer(time, currents, (25.0, 1.0, 3.0)), **SETTINGS)["rod"].values.tolist() == [2]
    assert detect(magnetometer(time[:0], currents[:0], (1.0, 2.0, 3.0)), **SETTINGS).sizes["manoeuvre"] == 0
