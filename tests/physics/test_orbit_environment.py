"""Sunlight, warmth and the dipole axis against formulas of another source."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.physics import earth, orbit_environment

DAY = 86400.0


def test_the_sun_stands_where_the_almanac_says():
    """Published: formulas of the Astronomical Almanac, 0.01 deg; of date against J2000 differs by 0.35 deg at most."""
    n = np.array([5128.0, 5219.5, 5310.0, 7335.0, 8551.0])
    mean, anomaly = np.radians(280.460 + 0.9856474 * n), np.radians(357.528 + 0.9856003 * n)
    longitude = mean + np.radians(1.915) * np.sin(anomaly) + np.radians(0.020) * np.sin(2 * anomaly)
    tilt = np.radians(23.439 - 4e-7 * n)
    sun = [np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)]
    assert np.all(np.degrees(np.arccos(np.sum(orbit_environment.sun_i(n * DAY).T * sun, axis=0))) < 0.36)


def test_the_shadow_lies_behind_the_earth_and_warmth_lags_behind_it():
    """Analytic: day side, behind the centre, just outside the cylinder; exp(-t / lag) after long sunlight."""
    sun = np.tile([1.0, 0.0, 0.0], (3, 1))
    position = np.array([[6.9e6, 0.0, 0.0], [-6.9e6, 0.0, 0.0], [-3e6, 6.4e6, 0.0]])
    assert orbit_environment.sunlit(position, sun).tolist() == [True, False, True]
    sun = orbit_environment.sun_i(np.array([6e8]))[0]
    time = 6e8 + np.arange(0.0, 9000.0, 5.0)
    position = np.where((time < 6e8 + 6000)[:, None], 7e6 * sun, -7e6 * sun)
    found = orbit_environment.warmth(time[time > 6e8 + 6100], time, position)
    assert_allclose(found, np.exp(-(time[time > 6e8 + 6100] - 6e8 - 6000) / 600.0), atol=0.03)


def test_the_dipole_axis_points_to_the_south_of_greenland_and_away():
    """Published: geomagnetic north pole of IGRF-13 at 2015, 80.31 N 72.63 W; the moment points the other way."""
    time = np.array([5.0e8])
    axis_e = (earth.R_ei(time) @ orbit_environment.dipole_axis_i(time)[..., None])[0, :, 0]
    latitude, longitude = np.degrees(np.arcsin(-axis_e[2])), np.degrees(np.arctan2(-axis_e[1], -axis_e[0]))
    assert_allclose([latitude, longitude], [80.31, -72.63], atol=0.01)
