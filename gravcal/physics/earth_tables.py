"""Earth orientation parameters and leap seconds from the files of astropy-iers-data."""

from functools import lru_cache
from pathlib import Path

import astropy_iers_data
import numpy as np
import scipy

from gravcal.physics.constants import ARCSECOND, DAY, GPS_EPOCH_MJD, TAI_MINUS_GPS
from gravcal.physics.shapes import refuse

TABLES = Path(astropy_iers_data.__file__).parent / "data"
# Columns of finals2000A in characters from 0: (final values of Bulletin B, rapid ones and predictions of Bulletin A)
COLUMNS = {
    "xp": ((134, 144), (18, 27), ARCSECOND),
    "yp": ((144, 154), (37, 46), ARCSECOND),
    "ut1_minus_utc": ((154, 165), (58, 68), 1.0),
    "dx": ((165, 175), (97, 106), 1e-3 * ARCSECOND),
    "dy": ((175, 185), (116, 125), 1e-3 * ARCSECOND),
}


def orientation_parameters(time_gps, outside):
    """Polar motion, UT1 and pole corrections.

    Parameters
    ----------
    time_gps : (n,) GPS s
    outside : "raise" or "nearest"

    Returns
    -------
    parameters : (5, n) xp, yp rad; UT1 - TAI s; dX, dY rad
    """
    first, _, last = coverage()
    start, stop = np.min(time_gps), np.max(time_gps)
    if not (first <= start and stop <= last):
        if outside != "nearest":
            found, expected = f"epochs {start:.0f} to {stop:.0f} GPS s", f"{first:.0f} to {last:.0f} GPS s"
            remedy = 'Update astropy-iers-data, or accept the nearest value with outside="nearest".'
            refuse("Earth orientation", found, expected, remedy, first=first, last=last)
        time_gps = np.clip(time_gps, first, last)
    table = _table()
    low, high = np.searchsorted(table[0], [np.min(time_gps), np.max(time_gps)])
    rows = slice(max(low - 6, 0), high + 6)
    return scipy.interpolate.CubicSpline(table[0, rows], table[1:, rows], axis=1)(time_gps)


def coverage():
    """First epoch, last measured epoch and last predicted epoch of the table, GPS s."""
    table = _table()
    return table[0, 0], _last_measured(), table[0, -1]


def orientation_note(time_gps):
    """Text for attributes of a product: empty if all epochs are measured, else what was used instead."""
    first, measured, last = coverage()
    start, stop = np.min(time_gps), np.max(time_gps)
    if not (first <= start and stop <= last):
        return "Earth orientation: nearest tabulated value outside the IERS table; UT1 may be wrong by seconds"
    return "Earth orientation: IERS predictions, up to 0.02 s in UT1" if stop > measured else ""


def tai_minus_utc(seconds, scale="gps"):
    """Leap seconds (...,) s in force at GPS seconds, or at UTC seconds past 2000-01-01 12:00:00; 10 s before 1972."""
    midnight, leap = _leap_seconds()
    starts = midnight + leap - TAI_MINUS_GPS if scale == "gps" else midnight
    at = np.searchsorted(starts, np.asarray(seconds, float), side="right") - 1
    return leap[np.clip(at, 0, None)]


@lru_cache
def _leap_seconds():
    """UTC seconds past 2000-01-01 12:00:00 from which on TAI - UTC has a value, and the values."""
    rows = np.loadtxt(TABLES / "Leap_Second.dat", comments="#")
    return (rows[:, 0] - GPS_EPOCH_MJD) * DAY, rows[:, -1]


@lru_cache
def _lines():
    """Rows of finals2000A that hold polar motion and UT1, as (n, width) single characters."""
    raw = (TABLES / "finals2000A.all").read_bytes()
    width = raw.index(b"\n") + 1
    lines = np.frombuffer(raw, "S1").reshape(-1, width)
    return lines[np.any(lines[:, 58:68] != b" ", axis=1)]


def _numbers(lines, begin, end):
    """One column as floats, NaN where blank."""
    text = np.ascontiguousarray(lines[:, begin:end]).view(f"S{end - begin}")[:, 0]
    return np.where(np.char.strip(text) == b"", b"nan", text).astype(float)


@lru_cache
def _table():
    """GPS epoch, xp, yp, UT1 - TAI, dX, dY: (6, n). UT1 - TAI has no leaps, so it can be interpolated."""
    lines = _lines()
    values = {}
    for name, (final, rapid, unit) in COLUMNS.items():
        best, other = _numbers(lines, *final), _numbers(lines, *rapid)
        column = np.where(np.isfinite(best), best, other) * unit
        known = np.flatnonzero(np.isfinite(column))
        values[name] = column[known[np.clip(np.searchsorted(known, np.arange(column.size)), 0, known.size - 1)]]
    utc = (_numbers(lines, 7, 15) - GPS_EPOCH_MJD) * DAY
    leap = tai_minus_utc(utc, scale="utc")
    time = utc + leap - TAI_MINUS_GPS
    ut1_minus_tai = values["ut1_minus_utc"] - leap
    return np.stack([time, values["xp"], values["yp"], ut1_minus_tai, values["dx"], values["dy"]])


@lru_cache
def _last_measured():
    """Last epoch whose UT1 is flagged as measured (I), not predicted (P)."""
    return _table()[0, np.flatnonzero(_lines()[:, 57] == b"I")[-1]]
