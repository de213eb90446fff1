"""Time tags: from the on-board clock to GPS time, their order, their gaps, and those that are far off.

A tag is whole seconds and a fraction, since one double holds the sum to 0.1 us only.
"""

from dataclasses import dataclass

import numpy as np

ENDS = 1  # CLK1B qualflg bit 0: no extrapolation after this record
STARTS = 2  # CLK1B qualflg bit 1: no extrapolation before this record
UNMAPPED = 8 + 64  # TIM1B qualflg bits 3, 6: no mapping to receiver time


@dataclass(frozen=True)
class Tags:
    """Time tags past 2000-01-01 12:00:00: second (n,) int64 s, fraction (n,) s in [0, 1), NaN if undetermined."""

    second: np.ndarray
    fraction: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """Tags as (n,) float64 s, rounded to 0.1 us; NaN where undetermined."""
        return self.second + self.fraction


@dataclass(frozen=True)
class Clock:
    """Offsets of a clock at its knots, in order: second (m,) s, offset (m,) s, drift (m,) s s-1, ends, starts (m,)."""

    second: np.ndarray
    offset: np.ndarray
    drift: np.ndarray
    ends: np.ndarray
    starts: np.ndarray


def normalised(second, fraction) -> Tags:
    """Tags with the fraction carried into [0, 1) s."""
    second, fraction = np.asarray(second, np.int64), np.asarray(fraction, float)
    carry = np.where(np.isfinite(fraction), np.floor(fraction), 0.0)
    fraction = fraction - carry
    rounded = fraction >= 1.0  # a tiny negative fraction rounds up to 1
    return Tags(second + carry.astype(np.int64) + rounded, np.where(rounded, 0.0, fraction))


def tim1b_clock(obc_second, rcv_second, rcv_fraction, qualflg) -> Clock:
    """Receiver minus on-board time at the records (m,) of TIM1B, those without a mapping (bits 3, 6) left out.

    offset = (rcvtime_intg + rcvtime_frac) - obctime; GRACE-FO Level-1 Handbook (JPL D-56935); docs/real_data.md, Time.
    """
    obc_second = np.asarray(obc_second, np.int64)
    offset = (np.asarray(rcv_second, np.int64) - obc_second) + np.asarray(rcv_fraction, float)
    mapped = (np.asarray(qualflg) & UNMAPPED) == 0
    return _clock(obc_second[mapped], offset[mapped], np.zeros(mapped.sum()), np.zeros(mapped.sum(), int))


def clk1b_clock(rcv_second, eps_time, eps_drift, qualflg) -> Clock:
    """GPS minus receiver time at the records (m,) of CLK1B; qualflg bit 0 ends, bit 1 starts a stretch without jumps.

    t_gps = rcv_time + eps_time; GRACE-FO Level-1 Handbook (JPL D-56935), CLK1B; docs/real_data.md, Time.
    """
    return _clock(np.asarray(rcv_second, np.int64), np.asarray(eps_time, float), np.asarray(eps_drift, float), qualflg)


def _clock(second, offset, drift, qualflg):
    """Clock with knots in order, finite, equal ones merged; of two at one second that which ends a stretch is first."""
    ends, starts = (np.asarray(qualflg) & ENDS) > 0, (np.asarray(qualflg) & STARTS) > 0
    order = np.lexsort([~ends, second])
    order = order[np.isfinite(offset[order]) & np.isfinite(drift[order])]
    second, offset, drift, ends, starts = (x[order] for x in (second, offset, drift, ends, starts))
    new = np.ones(len(second), bool)
    new[1:] = (np.diff(second) > 0) | (np.diff(offset) != 0)
    first = np.flatnonzero(new)
    if len(first):
        ends, starts = np.logical_or.reduceat(ends, first), np.logical_or.reduceat(starts, first)
    return Clock(second[first], offset[first], drift[first], ends, starts)


def converted(tags: Tags, clock: Clock, gap_s: float, reach_s: float, jump_s: float) -> tuple[Tags, np.ndarray]:
    """Tags in the time that a clock leads to, never across one of its jumps, and True (n,) where undetermined.

    On-board tags for the clock of TIM1B, receiver time for that of CLK1B; undetermined is what lies in a gap over
    gap_s between two knots, over reach_s beyond the first or last one, or at a jump over jump_s, all in s.
    """
    if not len(clock.second):
        undetermined = np.ones(len(tags.second), bool)
        return Tags(tags.second, np.full(len(tags.second), np.nan)), undetermined
    knot = np.searchsorted(clock.second, tags.second, side="right") - 1
    before = knot < 0
    knot = np.maximum(knot, 0)
    past = (tags.second - clock.second[knot]) + tags.fraction
    steps, rises = np.diff(clock.second), np.diff(clock.offset)
    slope = np.append(np.divide(rises, steps, out=np.zeros(len(steps)), where=steps > 0), clock.drift[-1])
    offset = clock.offset[knot] + np.where(before, clock.drift[knot], slope[knot]) * past
    determined = _reachable(clock, gap_s, jump_s)[knot] | (past == 0)
    outside = before | (knot == len(clock.second) - 1)
    open_end = np.where(before, ~clock.starts[0], ~clock.ends[-1])
    determined[outside] = (open_end & (np.abs(past) <= reach_s))[outside]
    determined |= (past == 0) & ~before
    undetermined = ~determined | ~np.isfinite(tags.fraction)
    return normalised(tags.second, np.where(undetermined, np.nan, tags.fraction + offset)), undetermined


def _reachable(clock, gap_s, jump_s):
    """True (m,) if the clock may be interpolated from each knot to the next, False for the last knot."""
    intervals = np.diff(clock.second)
    steady = np.abs(clock.offset[1:] - (clock.offset[:-1] + clock.drift[:-1] * intervals)) <= jump_s
    flagged = clock.ends[:-1] | clock.starts[1:]
    unexplained = (intervals == 0) & ~flagged  # two offsets at one second, and nothing says which holds
    doubtful = np.append(unexplained, False) | np.insert(unexplained, 0, False)
    return np.append((intervals <= gap_s) & steady & ~flagged & ~(doubtful[:-1] | doubtful[1:]), False)


def ordered(tags: Tags, values=()) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """Indices (k,) of records in the order of their tags, all determined, of equal tags the first; conflicts; counts.

    Conflicts (k,) are True where a dropped record had the same tag and other values (n, ...); counts {name: number} of
    records, out_of_order, repeated (same values) and conflicting ones.
    """
    n = len(tags.second)
    order = np.lexsort([np.arange(n), tags.fraction, tags.second])
    second, fraction = tags.second[order], tags.fraction[order]
    repeats = np.zeros(n, bool)
    repeats[1:] = (second[1:] == second[:-1]) & (fraction[1:] == fraction[:-1])
    first = np.maximum.accumulate(np.where(repeats, 0, np.arange(n)))
    equal = np.ones(len(order), bool)
    for column in values if len(order) else ():
        a, b = np.asarray(column)[order], np.asarray(column)[order[first]]
        equal &= ((a == b) | ((a != a) & (b != b))).reshape(len(order), -1).all(axis=1)
    differs = repeats & ~equal
    conflicting = np.zeros(n, bool)
    conflicting[first[differs]] = True
    intervals = tags.second[1:] - tags.second[:-1] + (tags.fraction[1:] - tags.fraction[:-1])
    counts = {
        "records": n,
        "out_of_order": int((intervals < 0).sum()),
        "repeated": int((repeats & ~differs).sum()),
        "conflicting": int(differs.sum()),
    }
    return order[~repeats], conflicting[~repeats], counts


#: Times what any lag further away than `near` gains, from which on a lag stands out: of noise the largest of a thousand
#: is a tenth above the next.
CLEARLY = 2.0


def lag(read, foretold, longest: int, near: int, weight=1.0, *, either: bool = False) -> int:
    """Lag in steps of series behind their prediction, that of largest chi-square gain; 0 where none stands out.

    None does where all lags are near the best. Both are spectra (n + 1, k) of k series of n steps on one even grid, n
    zeros appended, weight that of each frequency; `longest` is the largest lag tried, and lags within `near` of the
    best are not independent of it. With `either` a series may follow with either sign.
    """
    by_lag = np.fft.irfft(read * foretold.conj() * weight, axis=0)
    by_lag = by_lag if either else np.maximum(by_lag, 0.0)
    power = np.sum(np.abs(foretold) ** 2 * weight, axis=0)
    gain = (by_lag**2 / np.maximum(power, 1e-300)).sum(axis=1)
    lags = np.arange(-longest, longest + 1)
    best = int(lags[np.argmax(gain[lags])])
    others = gain[lags[np.abs(lags - best) > near]]
    return best if gain[best] > CLEARLY * np.max(others, initial=0.0) and others.size else 0
