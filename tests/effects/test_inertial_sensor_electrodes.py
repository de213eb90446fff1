"""Electrodes of the inertial sensor: printed factors, their ratios, the combinations of Table 3."""

import numpy as np
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.effects import inertial_sensor as electrodes

AREA, GAP, ARM = [2.395e-4, 2.054e-4, 2.056e-4], [6.20e-5, 7.70e-5, 7.50e-5], [10.45e-3] * 3
INERTIA = [1.9440e-5, 1.0328e-5, 1.0328e-5]


def pushed(mass, preload):
    """Accelerations and angular ones (6, 6) per volt: an electrode pushes with 2 e0 S V_P / D^2 at its arm.

    Erratum T-4 reads Table 1: four equal electrodes along x, one pair along y, two halves of the total along z.
    """
    area = np.array([AREA[0]] * 3 + [AREA[1]] + [AREA[2] / 2] * 2)
    count, axis, gap = np.array([2, 1, 1, 1, 1, 1]), np.array([0, 0, 0, 1, 2, 2]), np.array(GAP)
    force = count * 2 * 8.8541878128e-12 * area * preload / gap[axis] ** 2
    sign = np.array([[0, 0, 0, 0, 1, -1], [0, 1, -1, 0, 0, 0], [1, -1, -1, 0, 0, 0]])
    linear = (axis == np.arange(3)[:, None]) * force / mass
    return np.concatenate([linear, sign * force * np.array(ARM)[:, None] / np.array(INERTIA)[:, None]])


def test_the_electrodes_give_the_printed_nominal_factors_and_combinations():
    """Published: 10.3390/rs15153817, Table 4, nominal, with V_P and M of erratum T-4, within its 0.5 %; Table 3."""
    matrix = pushed(0.0698, 34.15)
    found = np.abs(matrix).max(axis=1) / np.abs(electrodes.READOUT).max(axis=1)
    printed = {r.labels["factor"]: r.value[0] for r in catalog.published("inertial_sensor")["scale_factors"]}
    names = ("k_x", "k_y", "k_z", "beta_x", "beta_y", "beta_z")
    assert_allclose(found, [printed[name] for name in names], rtol=5e-3)
    assert_allclose(matrix, found[:, None] * electrodes.READOUT, rtol=1e-12, atol=1e-18)
    printed = [r.value for r in catalog.published("inertial_sensor")["actuation"]]
    assert_allclose(electrodes.READOUT, np.array(printed, dtype=float), atol=0)
    ratio = electrodes.linear_over_angular(0.0698, INERTIA, ARM)
    assert_allclose(found[[2, 0, 0]], ratio * found[3:], rtol=1e-12)  # k_z by beta_x, k_x by beta_y and beta_z


def test_the_printed_ratio_is_twice_too_large():
    """Published: eqs. 8-10 with their 1/2 double k (erratum T-4)."""
    right, printed = (
        form(0.072, INERTIA, ARM) for form in (electrodes.linear_over_angular, electrodes.published_linear_over_angular)
    )
    assert_allclose(printed, 2 * right, rtol=1e-15)


def test_the_calibrated_ratio_follows_the_longer_arm():
    """Published: beta_x 4.42e-3 gives k_z 1.14e-4 with 10.45 mm and 1.49e-4 with 8.00 mm (erratum T-5)."""
    both = [4.42e-3 * electrodes.linear_over_angular(0.072, INERTIA, [arm, 1, 1])[0] for arm in (10.45e-3, 8.00e-3)]
    assert_allclose(both, [1.14e-4, 1.49e-4], atol=0.5e-6)  # last printed digit


def test_voltages_and_readouts_are_inverse():
    """Analytic: six combinations of six voltages determine them."""
    volts = np.random.default_rng(1).standard_normal((5, 6))
    assert_allclose(electrodes.volts(electrodes.readouts(volts)), volts, rtol=1e-12)
