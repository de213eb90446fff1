"""The Kalman filter for constants is recursive least squares."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal.estimation import kalman


def test_the_filter_ends_at_regularised_least_squares():
    """Analytic: with a finite start the end is least squares with the start as an observation (erratum T-7)."""
    rng = np.random.default_rng(1)
    design, observed = rng.standard_normal((50, 3)), rng.standard_normal(50)
    variance = rng.uniform(0.5, 2.0, 50)
    start, prior = np.array([1.0, -2.0, 0.5]), np.diag([4.0, 1.0, 9.0])
    run = kalman.filter_constants(observed, design, start, prior, variance)
    normal = design.T @ (design / variance[:, None]) + np.linalg.inv(prior)
    right = design.T @ (observed / variance) + np.linalg.solve(prior, start)
    assert_allclose(run.value[-1], np.linalg.solve(normal, right), rtol=1e-9)  # rounding of 50 steps
    assert_allclose(run.covariance, np.linalg.inv(normal), rtol=1e-9)
    assert_allclose(run.sigma[-1], np.sqrt(np.diag(np.linalg.inv(normal))), rtol=1e-9)
