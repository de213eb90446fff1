"""IGG-III weights and the covariance that their scatter supports."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.estimation import robust


def estimates(rng, draw, runs=400, constants=(1.5, 3.0)):
    """Errors over honest and over formal sigma of a straight line."""
    design = np.column_stack([np.ones(200), np.linspace(-1, 1, 200)])
    honest, formal = [], []
    for _ in range(runs):
        found = robust.solve(design @ [1.0, 2.0] + draw(rng), design, constants, 2)
        sigma = np.sqrt(np.diag(np.linalg.inv(found.information)))
        honest.append((found.value - [1.0, 2.0]) / sigma)
        formal.append((found.value - [1.0, 2.0]) / (sigma * found.formal_factor))
    return np.std(honest), np.std(formal)


def test_the_error_is_that_of_the_scatter():
    """Recovery: 800 values, Gauss and Student t of 3 degrees; the formal error is a third too small (erratum K-9)."""
    honest, formal = estimates(np.random.default_rng(1), lambda rng: rng.standard_normal(200))
    assert 0.92 < honest < 1.08
    assert formal > 1.25
    honest, _ = estimates(np.random.default_rng(2), lambda rng: rng.standard_t(3, 200))
    assert 0.9 < honest < 1.1


def test_gross_errors_lose_their_weight():
    """Analytic: 2 % of samples off by 100 sigma leave no trace beyond the noise; without noise nothing is divided.

    The three branches of IGG-III at their bounds and at a point between.
    """
    rng = np.random.default_rng(3)
    design = np.column_stack([np.ones(1000), np.linspace(-1, 1, 1000)])
    y = design @ [1.0, 2.0] + 1e-3 * rng.standard_normal(1000)
    y[::50] += 0.1
    found = robust.solve(y, design, (1.5, 3.0), 2)
    assert_allclose(found.value, [1.0, 2.0], atol=4e-4)  # ten sigma of 1e-3 / sqrt(1000)
    assert np.all(found.weight[::50] == 0)
    assert_allclose(robust.solve(design @ [1.0, 2.0], design, (1.5, 3.0), 2).value, [1.0, 2.0], rtol=1e-12)
    v = np.array([0.0, 1.5, 2.0, -3.0, 4.0])
    assert_allclose(robust.igg3_weights(v, 1.5, 3.0), [1, 1, 1.5 / 2 * (1 / 1.5) ** 2, 0, 0], rtol=1e-15)
