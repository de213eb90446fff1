"""Earth orientation, time scales, local frames."""

import erfa
import numpy as np
import physics_references
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import earth
from gravcal.physics.constants import ARCSECOND

DAY_2023 = 738849600.0  # 2023-06-01 00:00:00 GPS


def test_the_rotation_equals_the_complete_series_at_each_epoch():
    """Analytic: erfa.c2t06a with the same UT1 and pole, without its dX, dY of 0.3 mas; alone and through the spline.

    1e-12 rad is 7 um on the orbit; epochs outside the table are an error that names it.
    """
    time = DAY_2023 + np.linspace(0, 86400, 7)
    xp, yp, ut1_minus_tai, dx, dy = earth.orientation_parameters(time)
    tt = 2451545.0, (time + 51.184) / 86400
    ut1 = 2451545.0, (time + 19 + ut1_minus_tai) / 86400
    rotation = earth.R_ei(np.sort(np.concatenate([time, DAY_2023 + np.arange(100.0) * 860 + 1])))
    assert_allclose(earth.R_ei(time), erfa.c2t06a(*tt, *ut1, xp, yp), atol=3e-9)
    assert np.abs([dx, dy]).max() < 1e-3 * ARCSECOND
    assert_allclose(rotation @ np.swapaxes(rotation, -1, -2), np.tile(np.eye(3), (107, 1, 1)), atol=1e-14)
    time = DAY_2023 + np.linspace(0, 86400, 200)
    alone = np.concatenate([earth.R_ei(time[k : k + 1]) for k in (0, 57, 199)])
    assert_allclose(earth.R_ei(time)[[0, 57, 199]], alone, atol=1e-12)
    with pytest.raises(GravcalError, match="astropy-iers-data"):
        earth.R_ei(np.array([3e9]))


def test_states_and_latitudes_return():
    """Analytic: round trip, 1e-8 m and 1e-11 m/s are rounding; velocity of a place on the Earth by differences.

    At 45 degrees geodetic latitude is 0.19 degrees more than geocentric.
    """
    rng, time = np.random.default_rng(2), DAY_2023 + np.arange(5) * 1e3
    position, velocity = rng.normal(size=(5, 3)) * 7e6, rng.normal(size=(5, 3)) * 7e3
    back = earth.state_to_fixed(time, *earth.state_to_inertial(time, position, velocity))
    assert_allclose(back[0], position, atol=1e-7)
    assert_allclose(back[1], velocity, atol=1e-10)
    place, time = np.tile([4.0e6, 3.0e6, 4.2e6], (3, 1)), DAY_2023 + 43200 + np.array([-1.0, 0.0, 1.0])
    position, velocity = earth.state_to_inertial(time, place, np.zeros((3, 3)))
    assert_allclose(velocity[1], (position[2] - position[0]) / 2, atol=1e-6)  # h^2 w^3 r / 6 = 3e-7 m/s
    position = earth.position_from_geodetic(np.pi / 4, 0.3, 5e5)
    latitude, longitude, height = earth.geodetic(position)
    assert_allclose([latitude, longitude, height], [np.pi / 4, 0.3, 5e5], atol=1e-8)
    assert 0.17 < 45 - np.degrees(earth.geocentric(position)[0]) < 0.195


@pytest.mark.parametrize(
    ("place", "north", "east", "down"),
    [
        ([0, 0, 6.87e6], [-1, 0, 0], [0, 1, 0], [0, 0, -1]),
        ([6.87e6, 0, 0], [0, 0, 1], [0, 1, 0], [-1, 0, 0]),
        ([0, -6.87e6, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]),
    ],
)
@pytest.mark.parametrize("geocentric_down", [True, False])
def test_north_east_down_is_right_at_pole_and_equator(place, north, east, down, geocentric_down):
    """Analytic: columns of R_en."""
    R = earth.R_en_from_position(np.array([place], float), geocentric_down)[0]
    assert_allclose(R, np.stack([north, east, down], axis=-1), atol=1e-15)


@pytest.mark.measured
@pytest.mark.parametrize("satellite", ["C", "D"])
def test_the_two_orbit_products_of_gracefo_are_one_orbit(satellite):
    """Published: GNV1B turned to GCRS against GNI1B, 2023-06-01: 2 cm (daily tides of UT1), 0.06 mm/s."""
    fixed, inertial = (
        physics_references.level1(f"{product}_2023-06-01_{satellite}_04.txt", [0, 3, 4, 5, 9, 10, 11])
        for product in ("GNV1B", "GNI1B")
    )
    position, velocity = earth.state_to_inertial(fixed[:, 0], fixed[:, 1:4], fixed[:, 4:])
    assert_allclose(position, inertial[:, 1:4], atol=0.025, rtol=0)
    assert_allclose(velocity, inertial[:, 4:], atol=7e-5, rtol=0)
