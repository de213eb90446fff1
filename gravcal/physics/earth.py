"""Earth orientation and shape: inertial (GCRS) to Earth-fixed (ITRS) frame, time scales, local frames. Works offline.

Precession-nutation is IAU 2006/2000A by pyerfa with the measured corrections; polar motion and UT1 come from the IERS
table finals2000A of the package astropy-iers-data (no astropy). Daily and half-daily tides in them (up to 0.5 mas and
0.05 ms, 2 cm on the orbit) are not in that table and are left out.
"""

from functools import lru_cache
from pathlib import Path

import astropy_iers_data
import erfa
import numpy as np
import scipy

from gravcal.physics import check_shape, constants, refuse

PRECESSION_STEP = 3 * 3600.0  # s; the fastest nutation takes days, a cubic over 3 h is good to 1e-13 rad


def R_ei(time_gps):
    """Rotation (n, 3, 3) from inertial (GCRS) to Earth-fixed (ITRS) components at GPS seconds (n,) of the IERS table.

    Notes
    -----
    R_ei = W(xp, yp, s') R3(ERA) Q(X, Y, s); IERS Conventions 2010, eq. 5.1.
    """
    return _orientation(time_gps)[0]


def state_to_inertial(time_gps, position_e, velocity_e):
    """Orbit from Earth-fixed to inertial.

    Parameters
    ----------
    time_gps : (n,) GPS s
    position_e : (n, 3) m
    velocity_e : (n, 3) m s-1, with respect to the rotating Earth

    Returns
    -------
    position_i : (n, 3) m
    velocity_i : (n, 3) m s-1

    Notes
    -----
    v_i = R_ie (v_e + w x r_e), w the Earth's rotation in e; IERS Conventions 2010, chapter 5.
    """
    position = check_shape("position_e", position_e, (None, 3))
    R, rate_e = _orientation(time_gps)
    carried = check_shape("velocity_e", velocity_e, (None, 3)) + np.cross(rate_e, position)
    R_ie = np.swapaxes(R, -1, -2)
    return np.matvec(R_ie, position), np.matvec(R_ie, carried)


def state_to_fixed(time_gps, position_i, velocity_i):
    """Orbit from inertial to Earth-fixed, the inverse of state_to_inertial, with the same shapes and units."""
    R, rate_e = _orientation(time_gps)
    position = np.matvec(R, check_shape("position_i", position_i, (None, 3)))
    velocity = np.matvec(R, check_shape("velocity_i", velocity_i, (None, 3)))
    return position, velocity - np.cross(rate_e, position)


def gps_to_tt(time_gps):
    """Terrestrial Time as a two-part Julian date (n,), (n,)."""
    return _julian(np.asarray(time_gps, float), constants.TT_MINUS_GPS)


def geodetic(position_e):
    """Geodetic latitude rad, longitude rad and height m on WGS 84, each (...,), of positions (..., 3) m."""
    longitude, latitude, height = erfa.gc2gd(1, check_shape("position_e", position_e, (..., 3)))
    return latitude, longitude, height


def position_from_geodetic(latitude, longitude, height):
    """Earth-fixed position (..., 3) m of geodetic latitude rad, longitude rad and height m on WGS 84."""
    return erfa.gd2gc(1, longitude, latitude, height)


def geocentric(position_e):
    """Geocentric latitude rad, longitude rad and radius m, each (...,), of positions (..., 3) m."""
    x, y, z = np.moveaxis(check_shape("position_e", position_e, (..., 3)), -1, 0)
    return np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x), np.sqrt(x**2 + y**2 + z**2)


def R_en_from_position(position_e, geocentric_down=False):
    """Rotation (..., 3, 3) from the local frame n to Earth-fixed components: columns north, east, down.

    Down is along the normal of the ellipsoid, or towards the centre of the Earth. The position is (..., 3) m; at a pole
    the longitude is atan2(y, x) = 0.
    """
    latitude, longitude, _ = (geocentric if geocentric_down else geodetic)(position_e)
    sin, cos, sin_l, cos_l = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    north = np.stack([-sin * cos_l, -sin * sin_l, cos], axis=-1)
    east = np.stack([-sin_l, cos_l, np.zeros_like(sin)], axis=-1)
    down = np.stack([-cos * cos_l, -cos * sin_l, -sin], axis=-1)
    return np.stack([north, east, down], axis=-1)


def _julian(time, offset):
    """Two-part Julian date of seconds past the GPS epoch plus an offset, the second part a fraction of a day."""
    day = np.floor(time / constants.DAY)
    return constants.GPS_EPOCH_JD + day, ((time - day * constants.DAY) + offset) / constants.DAY


def _orientation(time_gps):
    """R_ei (n, 3, 3) and the angular velocity of the Earth-fixed frame in e (n, 3) rad s-1."""
    time = check_shape("time_gps", time_gps, (None,))
    if time.size == 0:
        return np.empty((0, 3, 3)), np.empty((0, 3))
    xp, yp, ut1_minus_tai, dx, dy = orientation_parameters(time)
    (x, y, s), (x_dot, y_dot) = _pole(time)
    celestial = erfa.c2ixys(x + dx, y + dy, s)
    era = erfa.era00(*_julian(time + constants.TAI_MINUS_GPS, ut1_minus_tai))
    wobble = erfa.pom00(xp, yp, erfa.sp00(*gps_to_tt(time)))
    R = erfa.c2tcio(celestial, era, wobble)
    precession = np.stack([-y_dot, x_dot, np.zeros_like(x)], axis=-1)  # pole x its rate, the pole being near z
    return R, constants.EARTH_ROTATION_RATE * wobble[..., 2] + np.matvec(R, precession)


def _pole(time):
    """Celestial intermediate pole: X, Y, s (3, n) rad and rates of X, Y (2, n) rad s-1; by spline unless few epochs."""
    grid = np.arange(time.min() - 3 * PRECESSION_STEP, time.max() + 4 * PRECESSION_STEP, PRECESSION_STEP)
    if 3 * time.size < grid.size:
        before, here, after = (_pole_at(time + lag) for lag in (-PRECESSION_STEP, 0.0, PRECESSION_STEP))
        return here, (after - before)[:2] / (2 * PRECESSION_STEP)
    spline = scipy.interpolate.CubicSpline(grid, _pole_at(grid), axis=1)
    return spline(time), spline(time, 1)[:2]


def _pole_at(time):  # X, Y, s (3, n) rad of IAU 2006/2000A at GPS seconds (n,)
    return np.stack(erfa.xys06a(*gps_to_tt(time)))


TABLES = Path(astropy_iers_data.__file__).parent / "data"
# Columns of finals2000A in characters from 0: (final values of Bulletin B, rapid ones and predictions of Bulletin A)
COLUMNS = {
    "xp": ((134, 144), (18, 27), constants.ARCSECOND),
    "yp": ((144, 154), (37, 46), constants.ARCSECOND),
    "ut1_minus_utc": ((154, 165), (58, 68), 1.0),
    "dx": ((165, 175), (97, 106), 1e-3 * constants.ARCSECOND),
    "dy": ((175, 185), (116, 125), 1e-3 * constants.ARCSECOND),
}


def orientation_parameters(time_gps):
    """Polar motion xp, yp in rad, UT1 - TAI in s, and pole corrections dX, dY in rad, (5, n), at GPS seconds (n,)."""
    table = _table()
    first, last = table[0, [0, -1]]
    start, stop = np.min(time_gps), np.max(time_gps)
    if not (first <= start and stop <= last):
        span, expected = f"epochs {start:.0f} to {stop:.0f} GPS s", f"{first:.0f} to {last:.0f} GPS s"
        refuse("Earth orientation", span, expected, "Update astropy-iers-data.", first=first, last=last)
    low, high = np.searchsorted(table[0], [start, stop])
    rows = slice(max(low - 6, 0), high + 6)
    return scipy.interpolate.CubicSpline(table[0, rows], table[1:, rows], axis=1)(time_gps)


def _numbers(lines, begin, end):
    """One column (n,) of the lines of a table, characters begin to end, as floats, NaN where blank."""
    return np.array([float(line[begin:end].strip() or "nan") for line in lines])


@lru_cache
def _table():
    """Rows GPS epoch s, xp, yp rad, UT1 - TAI s, dX, dY rad (6, n). UT1 - TAI has no leaps: it can be interpolated."""
    lines, values = (TABLES / "finals2000A.all").read_text().splitlines(), {}
    lines = [line for line in lines if line[58:68].strip()]  # with polar motion and UT1
    for name, (final, rapid, unit) in COLUMNS.items():
        best, other = _numbers(lines, *final), _numbers(lines, *rapid)
        column = np.where(np.isfinite(best), best, other) * unit
        known = np.flatnonzero(np.isfinite(column))
        values[name] = column[known[np.clip(np.searchsorted(known, np.arange(column.size)), 0, known.size - 1)]]
    utc = (_numbers(lines, 7, 15) - constants.GPS_EPOCH_MJD) * constants.DAY
    rows = np.loadtxt(TABLES / "Leap_Second.dat", comments="#")
    midnight, leap = (rows[:, 0] - constants.GPS_EPOCH_MJD) * constants.DAY, rows[:, -1]
    leap = leap[np.clip(np.searchsorted(midnight, utc, side="right") - 1, 0, None)]
    time = utc + leap - constants.TAI_MINUS_GPS
    ut1_minus_tai = values["ut1_minus_utc"] - leap
    return np.stack([time, values["xp"], values["yp"], ut1_minus_tai, values["dx"], values["dy"]])
