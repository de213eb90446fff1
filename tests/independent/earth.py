"""Time scales, Earth rotation, and constants of the Earth."""

from datetime import date as calendar_date
from functools import cache
from pathlib import Path

import astropy_iers_data
import erfa
import numpy as np

MU = 3.986004418e14  # m3 s-2
EQUATOR = 6378136.3  # m
J2 = 1.0826355e-3
ROTATION = 7.292115e-5  # rad s-1
J2000 = 2451545.0
TT_MINUS_GPS = 51.184  # s


def day_start(date):
    """Seconds from 2000-01-01 12:00:00 GPS to midnight of the date."""
    days = calendar_date.fromisoformat(date) - calendar_date(2000, 1, 1)
    return days.days * 86400 - 43200


@cache
def orientation(date):
    """Polar motion x, y (rad) and UT1 - GPS (s) at noon of the date, from the IERS table."""
    day = calendar_date.fromisoformat(date)
    mjd = (day - calendar_date(1858, 11, 17)).days
    for line in Path(astropy_iers_data.IERS_A_FILE).read_text().splitlines():
        if int(float(line[7:15])) == mjd and line[58:68].strip():
            pole = np.array([float(line[18:27]), float(line[37:46])]) * np.pi / 648000
            leap = erfa.dat(day.year, day.month, day.day, 0.5) - 19.0
            return pole[0], pole[1], float(line[58:68]) - leap
    raise ValueError(f"no Earth orientation for {date}")


def intermediate_to_gcrs(gps):
    """Matrix from the frame of the celestial intermediate pole to GCRS."""
    x, y, s = erfa.xys06a(J2000, (gps + TT_MINUS_GPS) / 86400)
    return erfa.c2ixys(x, y, s).T


def gcrs_to_earth(date, seconds):
    """Matrices (n, 3, 3) from GCRS to the Earth-fixed frame at seconds of the day."""
    xp, yp, ut1_minus_gps = orientation(date)
    gps = day_start(date) + np.asarray(seconds, float)
    knots = np.linspace(gps.min() - 1.0, gps.max() + 1.0, 2 + int(np.ptp(gps) // 1800))
    tt = (knots + TT_MINUS_GPS) / 86400
    xys = [np.interp(gps, knots, row) for row in erfa.xys06a(J2000, tt)]
    angle = erfa.era00(J2000, (gps + ut1_minus_gps) / 86400)
    return erfa.c2tcio(erfa.c2ixys(*xys), angle, erfa.pom00(xp, yp, erfa.sp00(J2000, gps.mean() / 86400)))
