"""On-board time to GPS time on the measured files: the figures of the data's README."""

import numpy as np
import pytest
from commands import MEASURED
from numpy.testing import assert_allclose

from gravcal.calibrations.align import between
from gravcal.estimation import timing
from gravcal.io.archive import find
from gravcal.io.readers import read

pytestmark = pytest.mark.measured
DAY = "2023-06-01"
LIMITS = 20.0, 10.0, 1e-3  # s: gap, reach beyond the ends, jump


def _records(satellite, *products):
    return [read(find(MEASURED / f"gracefo-{DAY}", product, satellite, DAY)) for product in products]


def _step(done, tags):
    return (done.time_second - tags.second) + (done.time_fraction - tags.fraction)


def _to_gps(observed, satellite):
    tim, clk = _records(satellite, "TIM1B", "CLK1B")
    received = tim.receiver_second.values, tim.receiver_fraction.values
    on_board = timing.tim1b_clock(tim.obctime.values, *received, tim.qualflg.values)
    receiver = timing.clk1b_clock(clk.rcv_time.values, clk.eps_time.values, clk.eps_drift.values, clk.qualflg.values)
    tags = timing.Tags(observed.time_second.values, observed.time_fraction.values)
    tags, lost = timing.converted(tags, on_board, *LIMITS)
    tags, lost_too = timing.converted(tags, receiver, *LIMITS)
    return tags, lost | lost_too


@pytest.mark.parametrize(("satellite", "offset"), [("C", -0.016671), ("D", -0.017256)])
def test_magnetometer_tags_move_by_the_clock_offset(satellite, offset):
    """Published: MAG1B - MAG1A of data/README.md, to 1 us, the resolution of the tags."""
    raw, done = _records(satellite, "MAG1A", "MAG1B")
    assert_allclose((done.time_second - raw.time_second) + (done.time_fraction - raw.time_fraction), offset, atol=1e-6)
    tags, lost = _to_gps(raw, satellite)
    assert not lost.any()
    assert_allclose(_step(done, tags), 0, atol=1e-6)


@pytest.mark.parametrize("satellite", ["C", "D"])
def test_gyro_tags_are_reproduced(satellite):
    """Published: IMU 1A to 1B to 1 us (data/README.md); the angles tell which records belong together."""
    raw, done = _records(satellite, "IMU1A", "IMU1B")
    tags, lost = _to_gps(raw, satellite)
    both = (np.column_stack([o.gyro_id.values, o.FiltAng.values]) for o in (raw, done))
    both = (np.unique(rows, axis=0, return_index=True, return_counts=True) for rows in both)
    place, seen = ({tuple(a): i for a, i, n in zip(*found, strict=True) if n == 1} for found in both)
    i, j = np.array([(place[a], seen[a]) for a in seen if a in place]).T
    assert len(i) > 80
    step = (done.time_second.values[j] - tags.second[i]) + (done.time_fraction.values[j] - tags.fraction[i])
    assert not lost[i].any()
    assert_allclose(step, 0, atol=1e-6)


def test_thruster_tags_are_reproduced_where_the_clock_files_reach():
    """Published: THR 1A to 1B to 1 us (data/README.md); beyond the 100 clock records tags are undetermined."""
    raw, done = _records("C", "THR1A", "THR1B")
    tags, lost = _to_gps(raw, "C")
    assert 3 <= (~lost).sum() < len(lost)
    assert_allclose(_step(done, tags)[~lost], 0, atol=1e-6)
    assert np.isnan(tags.time[lost]).all()


def test_accelerometer_at_whole_seconds_is_what_act1b_was_made_of():
    """Published: rms 1.5e-11, 1.0e-11, 2.2e-11 m s-2 (data/README.md), to a unit of the last digit."""
    raw, done = _records("C", "ACC1A", "ACT1B")
    tags, lost = _to_gps(raw, "C")
    assert not lost.any()
    inside = between(done.time_tag.values, tags.time, 0.11)
    rms = []
    for axis in "xyz":
        unfiltered = (done[f"lin_accl_{axis}"] - done[f"acl_{axis}_res"]).values[inside]
        interpolated = np.interp(done.time_tag.values[inside], tags.time, raw[f"lin_accl_{axis}"].values)
        rms.append(np.sqrt(np.mean((interpolated - unfiltered) ** 2)))
    assert inside.sum() >= 9
    assert_allclose(np.array(rms) * 1e11, [1.5, 1.0, 2.2], atol=0.1)


def test_microwave_and_laser_range_rate_agree():
    """Published: KBR minus LRI mean 1.7e-8, std 6.2e-8 m s-1 (data/README.md), to the printed rounding."""
    kbr, lri = _records("Y", "KBR1B", "LRI1B")
    _, ik, il = np.intersect1d(kbr.time_second, lri.time_second, return_indices=True)
    rates = [o.range_rate + o.lighttime_rate + o.ant_centr_rate for o in (kbr, lri)]
    difference = rates[0].values[ik] - rates[1].values[il]
    assert_allclose([difference.mean() * 1e8, difference.std() * 1e8], [1.7, 6.2], atol=0.051)
