"""Square waves found in sampled torquer currents, their edges bracketed, nothing found where nothing is."""

import numpy as np
import pytest
import seeds
import xarray as xr

from gravcal.calibrations.com_offset.align import detect, find_waves, regular_edges

STEP_MA = 0.0537369  # of the telemetry
SETTINGS = {
    "period_s": 12.0,
    "period_tolerance_s": 0.6,
    "minimum_half_periods": 10,
    "current_threshold_ma": 20.0,
}
START, HALF_PERIODS = 200.0, 30


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


def edges_of(start, count=HALF_PERIODS):
    """True edges (count + 1,) s."""
    return start + 6.0 * np.arange(count + 1)


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
        lower, upper = regular_edges(wave, 12.0)
        assert lower - 1e-9 <= start <= upper + 1e-9
        assert upper - lower <= 0.5 + 1e-9


@pytest.mark.parametrize("fraction", [0.083329, 0.583329, 0.0833291, 0.0833289])
def test_an_edge_on_a_sample_is_bracketed(fraction):
    """Analytic: an edge exactly at a telemetry sample, or a hair beside it, still lies in its interval."""
    time, current = record(START + fraction)
    (wave,) = find_waves(time, current, 0, SETTINGS)
    assert brackets(wave, edges_of(START + fraction)).all()
    lower, upper = regular_edges(wave, 12.0)
    assert lower - 1e-6 <= START + fraction <= upper + 1e-6


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
    nearest = np.abs(inner[:, None] - true).min(axis=1)
    assert nearest.max() <= 0.25 + 1e-6
    assert waves[0].level.size >= 10
    assert waves[0].lower[0] >= time[kept][0] - 1.6
    assert waves[0].upper[-1] <= time[kept][-1] + 1.6


def test_missing_telemetry_inside_the_wave_widens_an_edge_and_moves_none():
    """Contract: one missing sample at an edge; the interval contains the truth, the wave stays one."""
    start = START + 0.3
    time, current = record(start)
    at = np.searchsorted(time, edges_of(start)[7])
    time, current = np.delete(time, at), np.delete(current, at)
    (wave,) = find_waves(time, current, 0, SETTINGS)
    assert brackets(wave, edges_of(start)).all()
    assert wave.upper[7] - wave.lower[7] == pytest.approx(1.0)


def control():
    """Ten hours of limit-cycle currents, as large as measured."""
    time, rng = np.arange(0, 36000, 0.5), seeds.generator("test_what_is_no_wave_is_not_found", 0)
    slow = np.cumsum(rng.standard_normal(time.size)) * 0.05
    return time, 8.0 * np.sin(2 * np.pi * time / 5670) + 6 * np.sin(slow) + rng.standard_normal(time.size)


def of_period(period):
    """A square wave of another period."""
    time = np.arange(0, 600, 0.5) + 0.083
    return time, 110 * np.sign(np.sin(2 * np.pi * (time - 100.1) / period)) * ((time > 100) & (time < 300))


TIME = np.arange(0, 600, 0.5)
NO_WAVE = {
    "control, twice": lambda: (control()[0], 2 * control()[1]),
    "control, ten times": lambda: (control()[0], 10 * control()[1]),
    "8 s": lambda: of_period(8.0),
    "15 s": lambda: of_period(15.0),
    "24 s": lambda: of_period(24.0),
    "one-sided": lambda: (TIME, np.maximum(square(TIME, 100.0), 0.0)),
    "unequal": lambda: (TIME, np.where(square(TIME, 100.0) < 0, 0.5, 1.0) * square(TIME, 100.0)),
}


@pytest.mark.parametrize("name", NO_WAVE)
def test_what_is_no_wave_is_not_found(name):
    """Contract: signs alternate, sizes agree, the period is a setting; control currents are no manoeuvre."""
    assert find_waves(*NO_WAVE[name](), 0, SETTINGS) == []


def test_a_control_current_of_the_same_sign_is_not_part_of_the_last_half_period():
    """Analytic: 20 mA of control follow the wave at once; level and last edge are those of the wave."""
    time = np.arange(0, 600, 0.5) + 0.083
    current = square(time, 100.0)
    stop = np.flatnonzero(current)[-1]
    current[stop + 1 :] = 20.0 * np.sign(current[stop])
    (wave,) = find_waves(time, current, 2, SETTINGS)
    np.testing.assert_allclose(np.abs(wave.level), 110.0)
    assert wave.lower[-1] == time[stop]
    assert wave.upper[-1] == time[stop + 1]


def magnetometer(time, currents, field_ut, flag=None):
    """MAG1B as the reader returns it."""
    second = np.floor(time).astype(np.int64)
    columns = {f"Mfv{a}_RAW": np.full(time.size, field_ut[i]) for i, a in enumerate("XYZ")}
    columns |= {"time_second": second, "time_fraction": time - second, "time_tag": time}
    columns |= {"flag": np.zeros(time.size, np.uint8) if flag is None else flag}
    columns |= {"qualflg": np.zeros(time.size, np.uint8)}
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


def test_repeated_unsorted_and_flagged_telemetry_gives_the_same_manoeuvres():
    """Contract: order and repetition do not matter; flagged samples are not looked at."""
    rng = np.random.default_rng(8)
    time, current = record(START + 0.37, rng=rng)
    currents = np.stack([0 * current, current, 0.05 * current], axis=1)
    one = detect(magnetometer(time, currents, (5.0, 1.0, 40.0)), **SETTINGS)
    order = np.concatenate([rng.permutation(time.size), np.arange(300, 330)])
    other = detect(magnetometer(time[order], currents[order], (5.0, 1.0, 40.0)), **SETTINGS)
    xr.testing.assert_identical(one, other)
    wild, flag = currents.copy(), np.zeros(time.size, np.uint8)
    wild[[420, 611]], flag[[420, 611]] = 1e6, 2
    third = detect(magnetometer(time, wild, (5.0, 1.0, 40.0), flag), **SETTINGS)
    assert third.sizes["manoeuvre"] == 1
    assert (third["edge_lower"].values <= one["edge_lower"].values).all()
    assert (third["edge_upper"].values >= one["edge_upper"].values).all()


def test_of_waves_at_the_same_time_the_strongest_is_the_manoeuvre():
    """Contract: cross-talk in the telemetry of another rod makes no second manoeuvre; an empty record holds none."""
    time, current = record(START + 0.7)
    currents = np.stack([0.3 * current, 0 * current, -current], axis=1)
    found = detect(magnetometer(time, currents, (25.0, 1.0, 3.0)), **SETTINGS)
    assert found["rod"].values.tolist() == [2]
    assert detect(magnetometer(time[:0], currents[:0], (1.0, 2.0, 3.0)), **SETTINGS).sizes["manoeuvre"] == 0
