"""Time tags: clocks, jumps, gaps and order."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gravcal.estimation import timing

START = 738849600
LIMITS = 20.0, 5.0, 1e-3  # s: gap, reach beyond the ends, jump


def _clock(seconds, eps, flags=None, drift=0.0):
    seconds = START + np.asarray(seconds)
    flags = np.zeros(len(seconds), int) if flags is None else np.asarray(flags)
    return timing.clk1b_clock(seconds, np.asarray(eps, float), np.full(len(seconds), drift), flags)


def _at(seconds):
    known = np.floor(np.nan_to_num(seconds))
    return timing.normalised(START + known.astype(int), np.asarray(seconds, float) - known)


def _offset(tags, moved):
    return (moved.second - tags.second) + (moved.fraction - tags.fraction)


THIRTY = [0, 10, 20, 30], [0.1, 0.1, 0.1001, 0.1001]
SPLIT = [5.0, 10.0, 15.0, 20.0, 25.0], [15.0], [0.1, 0.1, 0.1001, 0.1001]
ENDS = [-6.0, -4.0, 14.0, 16.0]
#: Tags, s; the clock: s, offset, flags, drift; tags that are lost, and offsets of the others.
CASES = {
    "line": ([0.0, 2.5, 7.75, 10.0], ([0, 10], [0.5, 0.5000001]), [], 0.5 + 1e-8 * np.array([0, 2.5, 7.75, 10])),
    "flag before a jump": (SPLIT[0], (*THIRTY, [0, 1, 0, 0]), *SPLIT[1:]),
    "flag after a jump": (SPLIT[0], (*THIRTY, [0, 0, 2, 0]), *SPLIT[1:]),
    "both flags": (SPLIT[0], (*THIRTY, [0, 1, 2, 0]), *SPLIT[1:]),
    "jump at one second": ([9.5, 10.0, 10.5], ([0, 10, 10, 20], [0, 0, 0.7, 0.7], [0, 1, 2, 0]), [], [0.0, 0.7, 0.7]),
    "in other order": ([9.5, 10.0, 10.5], ([0, 10, 10, 20], [0, 0.7, 0, 0.7], [0, 2, 1, 0]), [], [0.0, 0.7, 0.7]),
    "nothing says which": ([5.0, 15.0, 25.0], ([0, 10, 10, 20, 30], [0, 0, 0.7, 0.7, 0.7]), [5.0, 15.0], [0.7]),
    "jump of 2 ms, none of 0.5": ([5.0, 15.0], ([0, 10, 20], [0.0, 0.0005, 0.0025]), [15.0], [0.00025]),
    "drift of 3 ms, no jump": ([5.0], ([0, 10], [0.0, 0.003], [0, 0], 3e-4), [], [0.0015]),
    "gap of 21 s, none of 20": ([10.0, 20.0, 30.0, 41.0], ([0, 20, 41], [0, 0, 0]), [30.0], [0, 0, 0]),
    "before and after, by the drift": (ENDS, ([0, 10], [0, 1e-7], [0, 0], 1e-8), [-6.0, 16.0], [-4e-8, 1.4e-7]),
    "not before a start nor after an end": (ENDS, ([0, 10], [0, 1e-7], [2, 1], 1e-8), ENDS, []),
    "not after an end": (ENDS, ([0, 10], [0, 1e-7], [0, 1], 1e-8), [-6.0, 14.0, 16.0], [-4e-8]),
    "first record twice": ([-1.0, 0.0, 1.0], ([0, 0, 10], [0.1, 0.1, 0.1], [2, 0, 0]), [-1.0], [0.1, 0.1]),
    "empty clock": ([0.0], ([], []), [0.0], []),
    "over the second, down": ([3.01, 3.99], ([0, 10], [-0.02, -0.02]), [], [-0.02, -0.02]),
    "over the second, up": ([3.01, 3.99], ([0, 10], [0.02, 0.02]), [], [0.02, 0.02]),
    "lost before": ([np.nan, 1.0], ([0, 10], [0.0, 0.0]), [np.nan], [0.0]),
}


@pytest.mark.parametrize("name", CASES)
def test_tags_have_the_offset_of_the_clock_or_none(name):
    """Analytic: lines between records; never over a flag, a jump above 1 ms, a gap above 20 s, 5 s beyond the ends."""
    seconds, clock, lost, offsets = CASES[name]
    tags = _at(seconds)
    moved, found = timing.converted(tags, _clock(*clock), *LIMITS)
    assert_array_equal(found, [one in lost or np.isnan(one) for one in seconds])
    assert_allclose(_offset(tags, moved)[~found], offsets, rtol=0, atol=1e-15)
    assert ((moved.fraction[~found] >= 0) & (moved.fraction[~found] < 1)).all()
    assert np.isnan(moved.time[found]).all()


@given(second=st.integers(-(2**31), 2**31), fraction=st.floats(-1e3, 1e3))
@settings(max_examples=200, deadline=None)
def test_normalised_fractions_lie_in_the_second(second, fraction):
    """Analytic: the sum stays, the fraction is in [0, 1)."""
    tags = timing.normalised(np.array([second]), np.array([fraction]))
    assert 0 <= tags.fraction[0] < 1
    assert_allclose((tags.second[0] - second) + tags.fraction[0], fraction, atol=2e-13)


def test_records_without_mapping_leave_the_on_board_clock():
    """Contract: TIM1B bits 3 and 6; GRACE-FO steps of 119 ns come through."""
    obc = START + np.array([5, 13, 21, 29])
    rcv = START + np.array([5, 13, 20, 29])
    clock = timing.tim1b_clock(obc, rcv, np.array([0, 119e-9, 999999881e-9, 0.25]), [4, 4, 4, 8])
    assert_array_equal(clock.second, obc[:3])
    assert_allclose(clock.offset, [0, 119e-9, -119e-9], atol=1e-16)
    tags = _at([17.0])
    moved, lost = timing.converted(tags, clock, *LIMITS)
    assert not lost.any()
    assert_allclose(_offset(tags, moved), 0, atol=1e-16)


def test_records_are_ordered_and_repeats_reported():
    """Contract: one out of order, one equal repeat, one conflicting repeat; the first of each stays."""
    tags = _at([0.0, 2.0, 1.0, 2.0, 3.0, 3.0])
    kept, conflicting, counts = timing.ordered(tags, values=[np.array([0.0, 2.0, 1.0, 2.0, 3.0, 3.5])])
    assert_array_equal(kept, [0, 2, 1, 4])
    assert_array_equal(conflicting, [False, False, False, True])
    assert counts == {"records": 6, "out_of_order": 1, "repeated": 1, "conflicting": 1}


@given(st.lists(st.integers(0, 20), max_size=40))
@settings(max_examples=100, deadline=None)
def test_order_is_increasing_and_loses_nothing(seconds):
    """Analytic: one record of each tag is kept, kept tags increase."""
    tags = timing.Tags(np.array(seconds, int), np.zeros(len(seconds)))
    kept, _, counts = timing.ordered(tags, values=[np.arange(len(seconds))])
    assert_array_equal(tags.second[kept], sorted(set(seconds)))
    assert counts["conflicting"] == len(seconds) - len(kept)
