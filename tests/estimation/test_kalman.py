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


def test_a_free_start_leaves_batch_least_squares():
    """Analytic: a start 1e5 times wider than the result weighs 1e-10."""
    rng = np.random.default_rng(2)
    design = rng.standard_normal((200, 4)) * [1e-3, 1.0, 1e3, 1e6]
    observed = rng.standard_normal(200)
    run = kalman.filter_constants(observed, design, np.zeros(4), kalman.free_start(design, 1.0), 1.0)
    batch = np.linalg.lstsq(design, observed, rcond=None)[0]
    assert_allclose(run.value[-1], batch, atol=1e-6 * np.abs(run.sigma[-1]).max(), rtol=1e-6)  # a millionth of sigma
