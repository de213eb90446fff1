"""Geomagnetic field."""

import warnings
from datetime import datetime

import numpy as np
import physics_references
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import earth, magnetic

ORIGIN = datetime(2000, 1, 1, 12)


def gps_seconds(*date):
    """Seconds past 2000-01-01 12:00:00 of a calendar date."""
    return (datetime(*date) - ORIGIN).total_seconds()


def cartesian(theta_deg, phi_deg, radius):
    """Earth-fixed position of colatitude and longitude."""
    theta, phi = np.broadcast_arrays(np.asarray(theta_deg, float), np.asarray(phi_deg, float))
    up = np.tile([1.0, 0.0, 0.0], (*theta.shape, 1))
    return physics_references.spherical_to_cartesian(up, theta, phi) * radius


@pytest.mark.parametrize("generation", [13, 14])
@pytest.mark.parametrize("year", [1905, 1995, 2015, 2020])
def test_the_field_equals_ppigrf(generation, year):
    """Analytic: another implementation at 300 points, on 1 January where calendars agree; 1e-9 nT, rounding.

    It has no poles: they are compared with a place 1 cm beside them, where the field differs by 2e-4 nT.
    """
    ppigrf = pytest.importorskip("ppigrf")
    rng = np.random.default_rng(year)
    theta, phi = np.degrees(np.arccos(rng.uniform(-1, 1, 300))), rng.uniform(-180, 360, 300)
    theta[:2] = 1e-7, 180 - 1e-7
    date = datetime(year, 1, 1)
    file = str(magnetic.coefficient_file(generation))
    reference = np.stack([b.ravel() for b in ppigrf.igrf_gc(6870.0, theta, phi, date, coeff_fn=file)], axis=-1)
    expected = physics_references.spherical_to_cartesian(reference, theta, phi)
    time = np.full(300, (date - ORIGIN).total_seconds())
    found = magnetic.field_e(time, cartesian(theta, phi, 6870e3), generation) * 1e9
    assert_allclose(found[2:], expected[2:], atol=1e-9)
    poles = magnetic.field_e(time[:2], np.array([[0, 0, 6870e3], [0, 0, -6870e3]]), generation) * 1e9
    assert_allclose(poles, expected[:2], atol=5e-4)


def test_the_field_between_epochs_is_linear_in_the_decimal_year():
    """Analytic: ChaosMagPy over ten years, handed the same fraction of each interval; 1e-7 nT, rounding of epochs."""
    pytest.importorskip("chaosmagpy")
    rng = np.random.default_rng(5)
    time = gps_seconds(2015, 1, 1) + np.sort(rng.uniform(0, 10 * 365.25 * 86400, 200))
    position = cartesian(np.degrees(np.arccos(rng.uniform(-1, 1, 200))), rng.uniform(0, 360, 200), 6870e3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = physics_references.field_by_chaosmagpy(time, position)
    assert_allclose(magnetic.field_e(time, position, 14) * 1e9, expected * 1e9, atol=1e-7)


def test_coefficients_are_the_published_ones_and_a_year_has_its_own_days():
    """Published: SHA-256 of the files, g10 of 2020 in nT; the middle of 366 days is 2 July 0 h, of 365 days 12 h."""
    assert magnetic.coefficient_digest(13) == "357536152bb6f72ced3eb886def84f91a592512465c367ca5ab7bda4c36c3522"
    assert magnetic.coefficient_digest(14) == "717f6dce821a8f2bfcc6a77f79cc227ba91f61aeb458d5433e8c72450d48f8e0"
    for generation, value in ((13, -29404.8), (14, -29403.41)):
        epochs, g, _ = magnetic.gauss_coefficients(generation)
        assert g[np.flatnonzero(epochs == 2020)[0], 1, 0] == value
    middle = np.array([gps_seconds(2016, 7, 2), gps_seconds(2017, 7, 2, 12)])
    assert_allclose(magnetic.decimal_year(middle), [2016.5, 2017.5], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("time", "position", "generation", "message"),
    [
        (gps_seconds(2026, 1, 1), [7e6, 0, 0], 13, "1900 to 2025"),
        (gps_seconds(2031, 1, 1), [7e6, 0, 0], 14, "1900 to 2030"),
        (gps_seconds(2020, 1, 1), [7e3, 0, 0], 14, "metres"),
        (gps_seconds(2020, 1, 1), [np.nan, 0, 0], 14, "NaN"),
        (gps_seconds(2020, 1, 1), [7e6, 0, 0], 12, "13 or 14"),
    ],
)
def test_what_the_model_does_not_cover_is_refused(time, position, generation, message):
    """Contract: epochs, places and generations outside the model raise an error."""
    with pytest.raises(GravcalError, match=message):
        magnetic.field_e(time, np.array([position]), generation)


@pytest.mark.measured
def test_swarm_sees_the_model_and_the_ring_current_of_a_storm():
    """Published: Swarm A on 2016-01-01, 00:28 to 01:00 UTC, in a magnetic storm, within 40 degrees of the equator.

    The residual is the storm's, -150 nT north with 13 nT scatter; the east component agrees to 2 nT.
    """
    file = physics_references.MEASURED / "swarm-2016-01-01" / "test_data_01.csv"
    rows = [line.split(",") for line in file.read_text().splitlines()[1:]]
    utc = np.array([row[1].rstrip("Z") for row in rows], "datetime64[ns]")
    time = (utc - np.datetime64("2000-01-01T12:00:00")) / np.timedelta64(1, "s") + 17.0  # GPS - UTC in 2016
    latitude, longitude, radius, total = np.array([[float(v) for v in row[2:6]] for row in rows]).T
    measured = np.array([[float(v) for v in row[6].strip("{}").split(";")] for row in rows])
    position = cartesian(90 - latitude, longitude, 1.0) * radius[:, None]
    field = magnetic.field_e(time, position, 14)
    local = np.matvec(np.swapaxes(earth.R_en_from_position(position, geocentric_down=True), -1, -2), field) * 1e9
    residual = (measured - local)[np.abs(latitude) < 40]
    assert_allclose(residual.mean(axis=0), [-150.1, 0.6, 32.1], atol=0.3)  # nT
    assert np.all(residual.std(axis=0) < [13, 2.1, 18])
    assert abs(np.mean(total - np.linalg.norm(local, axis=1))) < 17
