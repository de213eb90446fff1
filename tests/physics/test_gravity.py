"""Gravity and its gradient."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.errors import GravcalError
from gravcal.physics import gravity
from gravcal.physics.constants import EARTH_RADIUS, GM, J2

PLACES = {"pole": (0, 0, 6.87e6), "equator": (6.87e6, 0, 0), "between": (3e6, -4e6, 4.5e6)}


def potential(position):
    """U = mu/r [1 - J2 (R/r)^2 (3 sin^2 - 1)/2]."""
    r = np.linalg.norm(position)
    return GM / r * (1 - J2 * (EARTH_RADIUS / r) ** 2 * (3 * (position[2] / r) ** 2 - 1) / 2)


@pytest.mark.parametrize("place", PLACES)
def test_acceleration_and_gradient_are_slopes(place):
    """Analytic: central differences over 200 m of the potential, error 1e-9 of g, and of acceleration, 1e-15 s-2."""
    position, step = np.array(PLACES[place], float), 100 * np.eye(3)
    slope = [(potential(position + e) - potential(position - e)) / 200 for e in step]
    assert_allclose(gravity.acceleration_i(position), slope, atol=5e-8)  # rounding of U: 6e7 * 2e-16 / 200 m, and h^2
    slope = (gravity.acceleration_i(position + step) - gravity.acceleration_i(position - step)) / 200
    assert_allclose(gravity.gradient_i(position), slope.T, atol=1e-14)


def test_the_pole_can_be_tilted():
    """Analytic: turning position and pole together turns the tensor."""
    R = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    position = np.array([3e6, -4e6, 4.5e6])
    turned = gravity.gradient_i(R @ position, pole_i=R @ [0, 0, 1.0])
    assert_allclose(turned, gravity.rotate_tensor(R, gravity.gradient_i(position)), atol=1e-20)


def test_kilometres_are_refused():
    """Contract: a position within 1000 km of the centre raises an error."""
    with pytest.raises(GravcalError, match="metres"):
        gravity.gradient_i([7000.0, 0, 0])
