"""Gravity and its gradient: closed forms, an independent evaluation, poles."""

import functools
import math
from decimal import Decimal, getcontext

import numpy as np
import physics_references
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import gravity
from gravcal.physics.constants import EARTH_RADIUS, GM, J2

R = EARTH_RADIUS
PLACES = {
    "north pole": [0.0, 0.0, 6.87e6],
    "south pole": [0.0, 0.0, -6.87e6],
    "a metre from the pole": [1.0, -0.3, 6.87e6],
    "a hundred kilometres from the pole": [1e5, 2e4, 6.86e6],
    "equator": [6.87e6, 0.0, 0.0],
    "Potsdam at 490 km": [4.17e6, 0.97e6, 5.37e6],
}


def decimal_potential(field, position):
    """Potential by the textbook recursion of unnormalised V, W with fifty digits; shares nothing with the kernel."""
    x, y, z = position
    gm, radius = Decimal(field.gm), Decimal(field.radius)
    square = x * x + y * y + z * z
    size = field.degree + 1
    V, W, total = {(0, 0): radius / square.sqrt()}, {(0, 0): Decimal(0)}, Decimal(0)
    factorial = [Decimal(math.factorial(k)) for k in range(2 * size)]
    for m in range(size):
        if m:
            v, w, f = V[m - 1, m - 1], W[m - 1, m - 1], (2 * m - 1) * radius / square
            V[m, m], W[m, m] = f * (x * v - y * w), f * (x * w + y * v)
        for n in range(m, size):
            for table in (V, W):
                if n > m:
                    older = table.get((n - 2, m), Decimal(0))
                    first = (2 * n - 1) * z * radius / square * table[n - 1, m]
                    table[n, m] = (first - (n + m - 1) * radius**2 / square * older) / (n - m)
            norm = ((2 - (m == 0)) * (2 * n + 1) * factorial[n - m] / factorial[n + m]).sqrt()
            total += norm * (Decimal(field.cosine[n, m]) * V[n, m] + Decimal(field.sine[n, m]) * W[n, m])
    return gm / radius * total


H = Decimal("0.001")  # m


def potential(field, place, *moves):
    """Potential some steps of a millimetre away from a place: (axis, steps)."""
    point = [Decimal(v) for v in PLACES[place]]
    for axis, steps in moves:
        point[axis] += steps * H
    return decimal_potential(field, point)


@pytest.mark.parametrize("place", PLACES)
def test_point_mass_and_flattening_agree_with_their_closed_form(place):
    """Analytic: degrees 0 and 2 against the tensor that is written out, and both against differences of 1 mm."""
    getcontext().prec = 50
    cosine = np.diag([1.0, 0.0, 0.0])
    cosine[1, 1], cosine[2, 0] = 0.0, -J2 / np.sqrt(5)
    field, position = gravity.Field(GM, R, cosine, np.zeros((3, 3))), np.array(PLACES[place])
    d = np.linalg.norm(position)
    u, one, north = position / d, np.eye(3), np.diag([0.0, 0.0, 1.0])
    along, mixed = np.outer(u, u), 10 * u[2] * (np.outer(u, north[2]) + np.outer(north[2], u))
    even = (1 - 5 * u[2] ** 2) * one - (5 - 35 * u[2] ** 2) * along + 2 * north
    closed = GM / d**3 * (3 * along - one) - 1.5 * J2 * GM * R**2 / d**5 * (even - mixed)
    for gradient in (gravity.gradient_e(field, position), gravity.gradient_i(position)):
        assert_allclose(gradient, closed, rtol=0, atol=1e-20)
    here = potential(field, place)
    for axis in range(3):
        ahead, behind = potential(field, place, (axis, 1)), potential(field, place, (axis, -1))
        pull, bend = gravity.acceleration_i(position)[axis], (ahead - 2 * here + behind) / H**2
        assert_allclose(gravity.gradient_i(position)[axis, axis], float(bend), rtol=0, atol=1e-20)
        assert_allclose(pull, float((ahead - behind) / (2 * H)), rtol=0, atol=2e-14)


@pytest.mark.parametrize("place", ["north pole", "a metre from the pole", "Potsdam at 490 km"])
def test_every_second_derivative_agrees_with_differences_in_fifty_digits(place):
    """Analytic: degree 30, all orders; differences over 1 mm in decimal arithmetic are exact to 1e-19 relative."""
    getcontext().prec = 50
    field = physics_references.random_field(30)
    at = functools.partial(potential, field, place)
    middle, gradient = at(), gravity.gradient_e(field, np.array(PLACES[place]))
    for i in range(3):
        ahead, behind = at((i, 1)), at((i, -1))
        assert_allclose(gradient[i, i], float((ahead - 2 * middle + behind) / H**2), rtol=0, atol=2e-20)
        for j in range(i):
            corners = at((i, 1), (j, 1)) - at((i, 1), (j, -1)) - at((i, -1), (j, 1)) + at((i, -1), (j, -1))
            assert_allclose(gradient[i, j], float(corners / (4 * H**2)), rtol=0, atol=2e-20)


@pytest.mark.parametrize("degree", [0, 1, 7, 60, 200])
def test_the_trace_vanishes_though_every_element_has_its_own_series(degree):
    """Analytic: Laplace; 1e-18 s-2 asked, rounding of 3e-6 s-2 over the sum gives 1e-20."""
    position = np.random.default_rng(degree).standard_normal((300, 3))
    position *= 6.8e6 / np.linalg.norm(position, axis=1)[:, None]
    position = np.concatenate([position, list(PLACES.values())])
    gradient = gravity.gradient_e(physics_references.random_field(max(degree, 2)), position)
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 3e-20
    assert_allclose(gradient, np.swapaxes(gradient, 1, 2))


def test_the_highest_degree_stays_finite_at_the_pole_and_what_is_beyond_is_refused():
    """Analytic: at LIMIT only orders up to 2 contribute at the pole; kilometres and higher degrees are refused."""
    field = physics_references.random_field(gravity.LIMIT)
    position = np.array([0.0, 0.0, 6.87e6])
    low = gravity.Field(GM, R, field.cosine * (np.arange(601) < 3), field.sine * (np.arange(601) < 3))
    found = gravity.gradient_e(field, position)
    assert np.isfinite(gravity.gradient_e(field, np.array(list(PLACES.values())))).all()
    assert_allclose(found, gravity.gradient_e(low, position), rtol=0, atol=1e-20)
    with pytest.raises(GravcalError, match="positions in metres"):
        gravity.gradient_e(physics_references.random_field(3), [6870.0, 0, 0])
    with pytest.raises(GravcalError, match="metres"):
        gravity.gradient_i([7000.0, 0, 0])
    zeros = np.zeros((gravity.LIMIT + 2, gravity.LIMIT + 2))
    with pytest.raises(GravcalError, match="truncated"):
        gravity.gradient_e(gravity.Field(GM, R, zeros, zeros), [6.87e6, 0, 0])


def test_parts_by_degree_add_up_and_degree_one_is_empty():
    """Analytic: the sum is linear; degree 1 gives nothing (erratum S-9)."""
    field, position = physics_references.random_field(20), np.array(PLACES["Potsdam at 490 km"])
    parts = [gravity.gradient_e(gravity.truncated(field, n, n), position) for n in range(21)]
    assert_allclose(sum(parts), gravity.gradient_e(field, position), rtol=0, atol=1e-20)
    assert np.all(parts[1] == 0)
    assert np.all(gravity.gradient_e(gravity.zonal(field, 1), position) == 0)
    zonals = [gravity.gradient_e(gravity.zonal(field, n), position) for n in range(21)]
    whole = gravity.Field(field.gm, field.radius, field.cosine * (np.arange(21) == 0), 0 * field.sine)
    assert_allclose(sum(zonals), gravity.gradient_e(whole, position), rtol=0, atol=1e-20)


def test_field_errors_scatter_as_their_covariance_says():
    """Recovery: 400 drawn errors, variance of each kind of element to 10 %."""
    rng = np.random.default_rng(3)
    n, m = np.arange(31)[:, None], np.arange(31)[None, :]
    sigma = np.where((m <= n) & (n >= 2), 1e-9 / np.maximum(n, 1), 0.0)
    field = gravity.Field(GM, R, sigma, sigma, sigma, np.where(m > 0, sigma, 0.0))
    place = rng.standard_normal((40, 3))
    position = 6.87e6 * place / np.linalg.norm(place, axis=1)[:, None]
    up = position / 6.87e6
    east = np.cross([0, 0, 1.0], up)
    east /= np.linalg.norm(east, axis=1)[:, None]
    frame = np.stack([up, east, np.cross(up, east)], axis=1)
    drawn = []
    for _ in range(100):
        parts = [s * rng.standard_normal(s.shape) for s in (sigma, np.where(m > 0, sigma, 0.0))]
        drawn.append(frame @ gravity.gradient_e(gravity.Field(GM, R, *parts), position) @ np.swapaxes(frame, 1, 2))
    drawn = np.concatenate(drawn)
    rr, rt, tt = gravity.error_covariance(field, 6.87e6)
    assert_allclose(np.mean(drawn[:, 0, 0] ** 2), rr, rtol=0.1)
    assert_allclose(np.mean(drawn[:, 0, 1:] ** 2), rt, rtol=0.1)
    assert_allclose(np.mean(drawn[:, 1, 2] ** 2), tt, rtol=0.1)
    assert_allclose(np.mean((drawn[:, 1, 1] - drawn[:, 2, 2]) ** 2) / 4, tt, rtol=0.1)
