"""What a block gains that the others predict: against densities written out, and where the others see little."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gravcal.discovery import attribution


def grams(blocks):
    """Products (b, m, m) of (observed, columns) of each block."""
    joined = [np.column_stack(one) for one in blocks]
    return np.array([one.T @ one for one in joined])


def density(blocks, left_out, count):
    """Twice the log density of one block as the first `count` columns of the others predict it."""
    observed = np.concatenate([b[0] for i, b in enumerate(blocks) if i != left_out])
    columns = np.concatenate([b[1][:, :count] for i, b in enumerate(blocks) if i != left_out])
    y, x = blocks[left_out][0], blocks[left_out][1][:, :count]
    covariance = np.linalg.inv(columns.T @ columns)
    mean = x @ covariance @ columns.T @ observed
    return 2 * multivariate_normal.logpdf(y, mean, np.eye(y.size) + x @ covariance @ x.T)


@pytest.mark.parametrize("seed", range(4))
def test_the_gain_is_that_of_densities_written_out(seed):
    """Analytic: normal densities of the blocks with the covariance of their prediction; units differ by 1e6."""
    rng = np.random.default_rng(seed)
    scale = [1.0, 1e3, 1e-3]
    blocks = [(rng.standard_normal(30) * 3, rng.standard_normal((30, 3)) * scale) for _ in range(4)]
    gain = attribution.held_out(grams(blocks), np.array([1, 2]), np.array([3]))
    expected = sum(density(blocks, i, 3) - density(blocks, i, 2) for i in range(4))
    assert gain == pytest.approx(expected, abs=1e-8)


def hardly_seen(rng, size, twin):
    """Two blocks; of a candidate beside its near twin in the baseline, the second block sees a hundredth."""
    one, two = rng.standard_normal((2, 400, 2))
    one[:, 1] = one[:, 0] + twin * one[:, 1]
    two[:, 1] = two[:, 0] + 0.1 * twin * two[:, 1]
    effect = size / (twin * np.sqrt(400))
    return [(rng.standard_normal(400) + effect * c[:, 1], c) for c in (one, two)]


def test_a_direction_that_the_others_hardly_see_costs_little():
    """Recovery: noise extrapolated a hundredfold costs log(1 + 100) and no more; 200 draws."""
    rng = np.random.default_rng(8)
    gains = [attribution.held_out(grams(hardly_seen(rng, 0.0, 0.01)), np.array([1]), np.array([2])) for _ in range(200)]
    assert -8.0 < np.mean(gains) < 0.0
    assert min(gains) > -25.0


def test_what_only_one_block_sees_gains_nothing():
    """Analytic: a column of the candidate in a single block, of any size, at right angles to the baseline."""
    rng = np.random.default_rng(4)
    blocks = [(rng.standard_normal(50), rng.standard_normal((50, 2))) for _ in range(3)]
    for _, columns in blocks[1:]:
        columns[:, 1] = 0.0
    columns = np.linalg.qr(blocks[0][1])[0]
    blocks[0] = (blocks[0][0] + 30 * columns[:, 1], columns)
    assert attribution.held_out(grams(blocks), np.array([1]), np.array([2])) == pytest.approx(0.0, abs=1e-6)


def test_a_part_of_the_baseline_that_only_one_block_sees_is_fitted_in_it():
    """Analytic: own column in place of a baseline column of one block, the same gain."""
    rng = np.random.default_rng(6)
    blocks = [(rng.standard_normal(60), rng.standard_normal((60, 3))) for _ in range(3)]
    for observed, columns in blocks:
        observed += columns @ [1.0, 5.0, 1.0]
    for _, columns in blocks[1:]:
        columns[:, 1] = 0.0
    fitted = attribution.held_out(grams(blocks), np.array([1, 2]), np.array([3]))
    basis = blocks[0][1][:, 1] / np.linalg.norm(blocks[0][1][:, 1])
    first = np.column_stack(blocks[0])
    first -= np.outer(basis, basis @ first)
    gone = [(first[:, 0], first[:, 1:]), *blocks[1:]]
    assert fitted == pytest.approx(attribution.held_out(grams(gone), np.array([1]), np.array([3])), abs=1e-6)


def test_the_inverse_of_products_is_never_below_zero():
    """Analytic: a column of which only rounding is left, below zero, and one that depends on others, are left out."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((40, 3)) * [1.0, 1e6, 1e-6]
    inner = np.zeros((5, 5))
    inner[:3, :3] = columns.T @ columns
    inner[3, 3], inner[3, :3], inner[:3, 3] = -1e-20, 1e-12, 1e-12
    inner[4], inner[:, 4] = inner[0], inner[:, 0]
    inner[4, 4] = inner[0, 0] * (1 - 1e-14)
    inverse = attribution.inverse_of(inner)
    assert np.all(inverse[3] == 0)
    assert np.all(np.diag(inverse)[[0, 1, 2, 4]] > 0)
    sums = np.eye(3) + np.outer([1.0, 0, 0], [1.0, 0, 0])  # the twin shares what the first explains
    expected = np.linalg.inv(columns.T @ columns)
    found = inverse[:3, :3] * np.where(sums == 2, 4.0, 1.0)
    assert found[1:, 1:] == pytest.approx(expected[1:, 1:], rel=1e-6)
    assert found[0, 0] == pytest.approx(expected[0, 0], rel=1e-6)
