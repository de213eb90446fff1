"""Effects of the gravity gradient on two sensors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.effects import CHANNELS, Context
from gravcal.effects.gradient import EFFECTS

PLACES = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.02]])


def context(count=7):
    """A turning satellite."""
    rng = np.random.default_rng(0)
    tensor = 1e-6 * rng.standard_normal((count, 3, 3))
    tesseral = 1e-6 * rng.standard_normal((count, 2, 3, 3))
    rates = 1e-3 * rng.standard_normal((count, 3)), 1e-7 * rng.standard_normal((count, 3))
    given = {"rate_b": rates[0], "rate_dot_b": rates[1], "gradient_b": tensor + np.swapaxes(tensor, 1, 2)}
    return Context(np.arange(count), **given, extra={"positions": PLACES, "tesseral_b": tesseral})


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.slug)
def test_effects_are_neutral_and_linear(effect):
    """Analytic: nothing at the neutral values, twice as much at twice the values."""
    values = np.array([p.prior_sigma for p in effect.parameters])
    one = effect.contribution(context(), values)
    assert effect.channel in CHANNELS
    assert one.shape == (7, 2, 3)
    assert np.all(effect.contribution(context(), effect.values({})) == 0)
    assert_allclose(effect.contribution(context(), 2 * values), 2 * one)
    assert effect.columns(context()).shape == (7, 2, 3, values.size)


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
