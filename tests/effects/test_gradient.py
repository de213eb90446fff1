"""Effects of the gravity gradient on two sensors."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.effects import Context
from gravcal.effects.gradient import EFFECTS

PLACES = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.02]])


def test_a_stronger_field_pulls_a_test_mass_where_it_is():
    """Analytic: an accelerometer reads -dG r; 2e-6 s-2, 1 % and 0.1 m give -2e-9 m s-2."""
    tensor = np.array([np.diag([2e-6, -1e-6, -1e-6])])
    rest = {"rate_b": np.zeros((1, 3)), "rate_dot_b": np.zeros((1, 3))}
    given = Context(np.zeros(1), **rest, gradient_b=tensor, extra={"positions": PLACES})
    scale = next(effect for effect in EFFECTS if effect.slug == "gradient.field_scale")
    found = scale.contribution(given, np.array([0.01]))
    assert_allclose(found[0, 0], [-2e-9, 0, 0], atol=1e-24)


def test_an_unknown_tesseral_term_pulls_by_its_own_gradient():
    """Analytic: C_22 off by 1e-8 with a gradient of 3e-6 s-2 per unit and 0.1 m reads -3e-15 m s-2."""
    unit = np.zeros((1, 2, 3, 3))
    unit[0, 0] = np.diag([3e-6, -1e-6, -2e-6])
    given = Context(np.zeros(1), extra={"positions": PLACES, "tesseral_b": unit})
    tesseral = next(effect for effect in EFFECTS if effect.slug == "gradient.tesseral")
    found = tesseral.contribution(given, tesseral.values({"cosine": 1e-8}))
    assert_allclose(found[0, 0], [-3e-15, 0, 0], atol=1e-30)
