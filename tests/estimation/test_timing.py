"""Time tags: clocks, jumps, gaps and order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gravcal.estimation import timing

START = 738849600
LIMITS = timing.Limits(max_gap_s=20.0, max_extrapolation_s=5.0, jump_s=1e-3)


def _clock(seconds, eps, flags=None, drift=0.0):
    seconds = START + np.asarray(seconds)
    flags = np.zeros(len(seconds), int) if flags is None else np.asarray(flags)
    return timing.clk1b_clock(seconds, np.asarray(eps, float), np.full(len(seconds), drift), flags)


def _at(seconds):
    seconds = np.asarray(seconds, float)
    return timing.normalised(START + np.floor(seconds).astype(int), seconds - np.floor(seconds))


def _offset(tags, moved):
    return (moved.second - tags.second) + (moved.fraction - tags.fraction)


def test_offset_is_a_line_between_two_records():
    """Analytic: 10 s apart, 1e-7 s apart in offset, to 1e-16 s, the rounding of a fraction."""
    tags = _at([0.0, 2.5, 7.75, 10.0])
    moved, lost = timing.converted(tags, _clock([0, 10], [0.5, 0.5000001]), LIMITS)
    assert not lost.any()
    assert_allclose(_offset(tags, moved), 0.5 + 1e-8 * np.array([0, 2.5, 7.75, 10]), atol=2e-16)


def test_fractions_are_carried_into_the_seconds():
    """Analytic: a negative offset takes a tag over the second, a positive one too."""
    tags = _at([3.01, 3.99])
    moved, _ = timing.converted(tags, _clock([0, 10], [-0.02, -0.02]), LIMITS)
    assert_array_equal(moved.second, [START + 2, START + 3])
    assert_allclose(moved.fraction, [0.99, 0.97], atol=1e-15)
    moved, _ = timing.converted(tags, _clock([0, 10], [0.02, 0.02]), LIMITS)
    assert_array_equal(moved.second, [START + 3, START + 4])


@given(second=st.integers(-(2**31), 2**31), fraction=st.floats(-1e3, 1e3))
@settings(max_examples=200, deadline=None)
def test_normalised_fractions_lie_in_the_second(second, fraction):
    """Analytic: the sum stays, the fraction is in [0, 1)."""
    tags = timing.normalised(np.array([second]), np.array([fraction]))
    assert 0 <= tags.fraction[0] < 1
    assert_allclose((tags.second[0] - second) + tags.fraction[0], fraction, atol=2e-13)


@pytest.mark.parametrize("flags", [[0, 1, 0, 0], [0, 0, 2, 0], [0, 1, 2, 0]])
def test_a_flagged_jump_is_never_interpolated_across(flags):
    """Contract: bit 0 after the record before, bit 1 before the record after, or both."""
    tags = _at([5.0, 10.0, 15.0, 20.0, 25.0])
    moved, lost = timing.converted(tags, _clock([0, 10, 20, 30], [0.1, 0.1, 0.1001, 0.1001], flags), LIMITS)
    assert_array_equal(lost, [False, False, True, False, False])
    assert_allclose(_offset(tags, moved)[~lost], [0.1, 0.1, 0.1001, 0.1001], atol=1e-15)
    assert np.isnan(moved.time[lost]).all()


def test_a_jump_at_one_second_splits_the_clock_there():
    """Contract: two records of one second, the first ends a stretch, the second starts one, in either order."""
    tags = _at([9.5, 10.0, 10.5])
    for order in ([0, 1, 2, 3], [0, 2, 1, 3]):
        seconds, eps, flags = np.array([0, 10, 10, 20]), np.array([0.0, 0.0, 0.7, 0.7]), np.array([0, 1, 2, 0])
        moved, lost = timing.converted(tags, _clock(seconds[order], eps[order], flags[order]), LIMITS)
        assert not lost.any()
        assert_allclose(_offset(tags, moved), [0.0, 0.7, 0.7], atol=1e-15)


def test_two_offsets_at_one_second_without_a_flag_are_not_trusted():
    """Contract: nothing says which holds, on either side."""
    tags = _at([5.0, 15.0, 25.0])
    _, lost = timing.converted(tags, _clock([0, 10, 10, 20, 30], [0.0, 0.0, 0.7, 0.7, 0.7]), LIMITS)
    assert_array_equal(lost, [True, True, False])


def test_an_unflagged_jump_is_seen_by_its_size():
    """Contract: 2 ms between two records against a limit of 1 ms; 0.5 ms pass."""
    tags = _at([5.0, 15.0])
    _, lost = timing.converted(tags, _clock([0, 10, 20], [0.0, 0.0005, 0.0025]), LIMITS)
    assert_array_equal(lost, [False, True])


def test_gaps_of_the_clock_are_not_bridged_beyond_the_limit():
    """Contract: 20 s pass, 21 s do not; a tag on a record needs no neighbour."""
    tags = _at([10.0, 20.0, 30.0, 41.0])
    _, lost = timing.converted(tags, _clock([0, 20, 41], [0.0, 0.0, 0.0]), LIMITS)
    assert_array_equal(lost, [False, False, True, False])


@pytest.mark.parametrize(
    ("flags", "expected"), [([0, 0], [1, 0, 0, 1]), ([2, 1], [1, 1, 1, 1]), ([0, 1], [1, 0, 1, 1])]
)
def test_extrapolation_ends_at_the_limit_and_at_the_flags(flags, expected):
    """Contract: 5 s either side, nothing before a start, nothing after an end; by the drift."""
    tags = _at([-6.0, -4.0, 14.0, 16.0])
    moved, lost = timing.converted(tags, _clock([0, 10], [0.0, 1e-7], flags, drift=1e-8), LIMITS)
    assert_array_equal(lost, np.array(expected, bool))
    assert_allclose(_offset(tags, moved)[~lost], np.array([-4e-8, 1.4e-7])[~lost[1:3]], atol=1e-15)


def test_first_record_twice_is_one_record_that_starts():
    """Contract: as in every RL04 file, flags 2 then 0."""
    clock = _clock([0, 0, 10], [0.1, 0.1, 0.1], [2, 0, 0])
    assert_array_equal(clock.second, [START, START + 10])
    assert_array_equal(clock.starts, [True, False])
    _, lost = timing.converted(_at([-1.0, 0.0, 1.0]), clock, LIMITS)
    assert_array_equal(lost, [True, False, False])


def test_records_without_mapping_leave_the_on_board_clock():
    """Contract: TIM1B bits 3 and 6; GRACE-FO steps of 119 ns come through."""
    obc = START + np.array([5, 13, 21, 29])
    rcv = START + np.array([5, 13, 20, 29])
    fraction = np.array([0, 119e-9, 999999881e-9, 0.25])
    clock = timing.tim1b_clock(obc, rcv, fraction, [4, 4, 4, 8])
    assert_array_equal(clock.second, obc[:3])
    assert_allclose(clock.offset, [0, 119e-9, -119e-9], atol=1e-16)
    tags = _at([17.0])
    moved, lost = timing.converted(tags, clock, LIMITS)
    assert not lost.any()
    assert_allclose(_offset(tags, moved), 0, atol=1e-16)


def test_an_undetermined_tag_stays_undetermined():
    """Contract: what the first clock lost, the second does not find; an empty clock loses all."""
    tags = timing.Tags(np.array([START, START + 1]), np.array([np.nan, 0.0]))
    _, lost = timing.converted(tags, _clock([0, 10], [0.0, 0.0]), LIMITS)
    assert_array_equal(lost, [True, False])
    moved, lost = timing.converted(tags, _clock([], []), LIMITS)
    assert lost.all()
    assert np.isnan(moved.time).all()


def test_records_are_ordered_and_repeats_reported():
    """Contract: one out of order, one equal repeat, one conflicting repeat; the first of each stays."""
    tags = _at([0.0, 2.0, 1.0, 2.0, 3.0, 3.0])
    values = np.array([0.0, 2.0, 1.0, 2.0, 3.0, 3.5])
    found = timing.ordered(tags, values=[values])
    assert_array_equal(found.index, [0, 2, 1, 4])
    assert_array_equal(found.conflicting, [False, False, False, True])
    assert_array_equal(found.dropped, [3, 5])
    assert found.counts == {"records": 6, "out_of_order": 1, "repeated": 1, "conflicting": 1}


@given(st.lists(st.integers(0, 20), max_size=40))
@settings(max_examples=100, deadline=None)
def test_order_is_increasing_and_loses_nothing(seconds):
    """Analytic: kept and dropped are all records, kept tags increase."""
    tags = timing.Tags(np.array(seconds, int), np.zeros(len(seconds)))
    found = timing.ordered(tags, values=[np.arange(len(seconds))])
    assert sorted([*found.index, *found.dropped]) == list(range(len(seconds)))
    assert (np.diff(tags.second[found.index]) > 0).all()
    assert found.counts["conflicting"] == len(found.dropped)
