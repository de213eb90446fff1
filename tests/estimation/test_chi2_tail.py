"""Probabilities of large values by chance."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from gravcal.estimation import chi2_tail
from gravcal.estimation.noise import fit_noise

RNG_LEVEL = 1e-4


def test_tails_are_those_of_the_distributions():
    """Reference: scipy.stats, numbers and arrays; below zero is certain to be exceeded; the least of every one."""
    gain = np.array([-1.0, 0.0, 0.3, 7.0, 90.0, 1300.0])
    for dof in (1, 3, 40):
        assert_allclose(chi2_tail.log_tail(gain, dof), stats.chi2.logsf(gain, dof), rtol=1e-12, atol=1e-15)
    assert chi2_tail.log_tail(7.0, 2) == pytest.approx(-3.5)
    assert chi2_tail.log_tail(1e5, 2) == -np.inf
    for smaller, reference in ((False, stats.gamma.logsf), (True, stats.gamma.logcdf)):
        found = chi2_tail.log_gamma_tail(gain, 2.5, 4.0, smaller=smaller)
        assert_allclose(found, reference(gain, 2.5, scale=1.6), rtol=1e-12, atol=1e-15)
    rng = np.random.default_rng(1)
    dof = rng.integers(1, 5, 60)
    gain = rng.chisquare(3, (60, 4))
    assert_allclose(chi2_tail.least_log_tail(gain, dof), stats.chi2.logsf(gain, dof[:, None]).min(axis=0), rtol=1e-12)


def test_a_measured_density_has_as_many_degrees_of_freedom_as_samples_for_a_coefficient(rng):
    """Recovery: 20 coefficients from 4000 samples, 200 times: the log of the density scatters by 2 / 200, within 40 %.

    Gains counted in it have the tail of an F distribution: six sigma have 9e-9 for 2e-9.
    """
    models = [fit_noise([rng.standard_normal(4000)], 20, 0.5) for _ in range(200)]
    spread = np.var([np.log(one.density(np.array([0.3, 0.5, 0.7]))) for one in models], axis=0)
    assert_allclose(spread.mean(), 2 / 200, rtol=0.4)
    assert_allclose(chi2_tail.log_tail(36.0, 1, 200.0), stats.f.logsf(36.0, 1, 200.0))
    gain, off = 30.0, 0.3 * rng.standard_normal(400_000)  # of the logarithm of the variance
    found = np.exp(chi2_tail.log_tail_of_level(gain, 3, np.inf, 0.3))
    assert_allclose(found, stats.chi2.sf(gain * np.exp(-off), 3).mean(), rtol=0.2)
    assert_allclose(chi2_tail.log_tail_of_level(gain, 3, 50.0, 0.0), stats.f.logsf(gain / 3, 3, 50.0), rtol=1e-6)
