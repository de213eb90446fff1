"""The choices of the source paper and the artefacts they make."""

from functools import lru_cache

import numpy as np
from kbr_campaign import STILL, process, simulated
from numpy.testing import assert_allclose

TRUE = np.array([1444.4, -0.170, 0.448])


@lru_cache(maxsize=1)
def published():
    """The paper's own campaign without noise, and its treatment."""
    columns, _ = simulated(3, STILL, True)
    return process(columns, method="published").combined


def test_undetrended_columns_shorten_x_and_shrink_y_and_z():
    """Published: erratum K-3, range, noise-free: X 1340.9, Y -0.018, Z 0.046 mm for 1444.4, -0.170, 0.448."""
    found = 1e3 * published()["centre"].values[0, 0, 0, :3]
    assert_allclose(found[0], 1340.9, atol=0.5)  # trims to 5 s
    assert_allclose(found[1:], [-0.018, 0.046], atol=1e-3)  # printed rounding and the same
    assert_allclose(TRUE[0] - found[0], 103, atol=1)


def test_the_bias_makes_the_design_nearly_singular():
    """Published: erratum K-3: condition number 9.8e3 with the bias and undetrended columns, 21 when detrended."""
    assert_allclose(published()["condition"].values[0, 0], 9.8e3, rtol=0.01)
    detrended = process(simulated(3, STILL, True)[0]).combined
    # weighed with what rounding leaves of a record without noise, which differs from machine to machine
    assert_allclose(detrended["condition"].values[:, 0], 21, atol=0.5)
    assert_allclose(1e3 * detrended["centre"].values[0, 0, 0, :3], TRUE, atol=1e-3)


def test_formal_errors_have_the_fingerprint_of_the_levels():
    """Published: erratum K-3: sigma_Y / sigma_X 0.017-0.021 for the range, 0.050 for its rate."""
    sigma = published()["formal_sigma"].values[:, 0, 0]
    assert 0.017 < sigma[0, 1] / sigma[0, 0] < 0.021
    assert_allclose(sigma[1, 1] / sigma[1, 0], 0.050, atol=2e-3)


def test_the_acceleration_is_hardly_hurt():
    """Analytic: it carries no level and nothing is removed from it: x within 0.3 mm, y and z within 1 um."""
    found = 1e3 * published()["centre"].values[2, 0, 0, :3]
    assert_allclose(found[0], TRUE[0], atol=0.3)
    assert_allclose(found[1:], TRUE[1:], atol=1e-3)
