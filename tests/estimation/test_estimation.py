"""Estimating equations, nuisance, instruments, shared and own errors, against dense brute force."""

import numpy as np
import pytest
import seeds
from numpy.testing import assert_allclose
from scipy import linalg, stats

from gravcal.estimation import least_squares
from gravcal.estimation.least_squares import Score


def block(rng, count=60, parameters=3, nuisance=4):
    """Random design, nuisance and observation of one block, unit white noise on zero truth."""
    return tuple(rng.standard_normal(shape) for shape in (count, (count, parameters), (count, nuisance)))


def test_projecting_nuisance_out_equals_estimating_it_along():
    """Analytic: value and covariance of the parameters equal those of the full least squares."""
    y, A, N = block(np.random.default_rng(1))
    score = least_squares.score(y, A, N)
    full = np.concatenate([A, N], axis=1)
    unknown, inverse = np.linalg.lstsq(full, y, rcond=None)[0], np.linalg.inv(full.T @ full)
    assert_allclose(score.value, unknown[:3], rtol=1e-10)
    assert_allclose(least_squares.covariance(score.information), inverse[:3, :3], rtol=1e-10)
    more = np.concatenate([N, 1e9 * N[:, :1], np.zeros((60, 1)), 1e-9 * N[:, 1:2]], axis=1)  # dependent, zero, scaled
    assert_allclose(least_squares.score(y, A, more).value, score.value, rtol=1e-8)
    assert_allclose(least_squares.project_out(np.zeros((60, 2)), y), y)


FREE, NONE = np.zeros((3, 3)), np.zeros((0, 3))  # no prior, no error beside the noise


def test_blocks_joined_equal_one_large_least_squares():
    """Analytic: three blocks with nuisance of their own against one stacked design."""
    rng = np.random.default_rng(3)
    blocks = [block(rng) for _ in range(3)]
    joined = least_squares.combine([least_squares.score(*b) for b in blocks], [NONE] * 3, [NONE] * 3, FREE)
    full = np.concatenate([np.concatenate([b[1] for b in blocks]), linalg.block_diag(*(b[2] for b in blocks))], axis=1)
    y = np.concatenate([b[0] for b in blocks])
    assert_allclose(joined.value, np.linalg.lstsq(full, y, rcond=None)[0][:3], rtol=1e-9)
    assert_allclose(joined.covariance, np.linalg.inv(full.T @ full)[:3, :3], rtol=1e-9)
    residual = y - full @ np.linalg.lstsq(full, y, rcond=None)[0]
    alone = sum(np.linalg.lstsq(np.concatenate(b[1:], axis=1), b[0], rcond=None)[1][0] for b in blocks)
    assert joined.chi2 == pytest.approx(residual @ residual - alone, rel=1e-9)
    assert joined.dof == 6


def test_own_and_shared_errors_weight_like_the_dense_covariance():
    """Analytic: blocks of direct estimates with own errors and one shared error against generalised least squares."""
    rng = np.random.default_rng(4)
    designs = [rng.standard_normal((20, 3)) for _ in range(4)]
    information = [A.T @ A for A in designs]
    own = [0.3 * rng.standard_normal((2, 3)) for _ in range(4)]
    estimates = [rng.standard_normal(3) for _ in range(4)]
    scores = [Score(i @ x, i, i) for i, x in zip(information, estimates, strict=True)]
    joined = least_squares.combine(scores, own, [NONE] * 4, FREE)
    weight = [np.linalg.inv(np.linalg.inv(i) + m.T @ m) for i, m in zip(information, own, strict=True)]
    total = np.linalg.inv(sum(weight))
    value = total @ sum(w @ x for w, x in zip(weight, estimates, strict=True))
    assert_allclose(joined.value, value, rtol=1e-9)
    assert_allclose(joined.covariance, total, rtol=1e-9)
    chi2 = sum((x - value) @ w @ (x - value) for w, x in zip(weight, estimates, strict=True))
    assert (joined.chi2, joined.dof) == (pytest.approx(chi2, rel=1e-9), 9)


def test_a_shared_error_moves_the_value_as_weighted_and_is_free_in_the_consistency():
    """Analytic: the shift is the weighted mean of the blocks' shifts; chi-square is that of the full covariance."""
    rng = np.random.default_rng(5)
    information = [A.T @ A for A in rng.standard_normal((3, 20, 3))]
    shared = [np.array([[0.4, 0.1, -0.2]]) * f for f in (1.0, 2.0, -0.5)]
    estimates = [rng.standard_normal(3) for _ in range(3)]
    scores = [Score(i @ x, i, i) for i, x in zip(information, estimates, strict=True)]
    joined = least_squares.combine(scores, [NONE] * 3, shared, FREE)
    shift = np.linalg.solve(sum(information), sum(i @ m[0] for i, m in zip(information, shared, strict=True)))
    assert_allclose(joined.shift[0], shift, rtol=1e-9)
    dense, mode = linalg.block_diag(*np.linalg.inv(information)), np.concatenate([m[0] for m in shared])
    weight = np.linalg.inv(dense + np.outer(mode, mode))
    x, A = np.concatenate(estimates), np.tile(np.eye(3), (3, 1))
    best = np.linalg.solve(A.T @ weight @ A, A.T @ weight @ x)
    assert joined.chi2 == pytest.approx((x - A @ best) @ weight @ (x - A @ best), rel=1e-8)


def test_consistency_of_consistent_blocks_is_chi_square():
    """Recovery: 400 draws with own and shared errors; uniform probabilities (Kolmogorov-Smirnov, 1e-4)."""
    rng = seeds.generator("test_consistency_of_consistent_blocks_is_chi_square", 1e-4)
    designs, own = rng.standard_normal((4, 30, 3)), 0.3 * rng.standard_normal((4, 2, 3))
    shared = 0.2 * rng.standard_normal((4, 1, 3))
    information = np.swapaxes(designs, 1, 2) @ designs
    found = []
    for _ in range(400):
        common, scores = rng.standard_normal(1), []
        for A, i, m, s in zip(designs, information, own, shared, strict=True):
            moved = rng.standard_normal(2) @ m + common @ s
            scores.append(Score(A.T @ rng.standard_normal(30) + i @ moved, i, i))
        joined = least_squares.combine(scores, list(own), list(shared), FREE)
        found.append(stats.chi2.sf(joined.chi2, joined.dof))
    assert stats.kstest(found, "uniform").pvalue > 1e-4


def test_noise_in_the_regressor_does_not_shrink_an_estimate_with_instruments():
    """Recovery: 600 draws; least squares is attenuated by a third, instruments are unbiased within four errors."""
    rng = seeds.generator("test_noise_in_the_regressor_does_not_shrink_an_estimate_with_instruments", 6e-5)
    signal = np.sin(2 * np.pi * np.arange(300) / 24)[:, None]
    drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, 300), 2)
    plain, robust = [], []
    for _ in range(600):
        noisy = signal + 0.5 * rng.standard_normal((300, 1))
        y = 2.0 * signal[:, 0] + 0.1 * rng.standard_normal(300)
        plain.append(least_squares.score(y, noisy, drift).value[0])
        robust.append(least_squares.score(y, noisy, drift, signal).value[0])
    assert np.mean(plain) < 1.5
    assert abs(np.mean(robust) - 2.0) < 4 * np.std(robust) / np.sqrt(600) + 0.005  # second order of the ratio


def test_a_direction_without_information_has_infinite_variance():
    """Analytic: null axes and combinations are told apart; twelve orders of size are units, no missing direction."""
    assert_allclose(np.diag(least_squares.covariance(np.diag([4.0, 0.0, 1e12]))), [0.25, np.inf, 1e-12])
    A = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    assert_allclose(np.diag(least_squares.covariance(A.T @ A)), [np.inf, np.inf, 0.25])
    assert np.isinf(np.diag(least_squares.covariance(np.zeros((3, 3))))).all()
    A = np.random.default_rng(6).standard_normal((30, 3)) * np.array([1.0, 1e-6, 1e6])
    for inverse in (least_squares.covariance, least_squares.stable_inverse):
        assert_allclose(inverse(A.T @ A), np.linalg.inv(A.T @ A), rtol=1e-6)


def test_what_a_block_does_not_tell_harms_no_other_component():
    """Analytic: a singular block adds what it knows, and takes part in the degrees of freedom by its rank.

    x known to 3 mm only: a noisy Z'A that cancels its prior of 1 mm does not reach y and z.
    """
    full, part = np.diag([2.0, 3.0, 4.0]), np.diag([5.0, 0.0, 0.0])
    scores = [Score(full @ [1.0, 2.0, 3.0], full, full), Score(part @ [2.0, 9.0, 9.0], part, part)]
    joined = least_squares.combine(scores, [NONE] * 2, [NONE] * 2, FREE)
    assert_allclose(joined.value, [12 / 7, 2.0, 3.0])
    assert joined.dof == 1
    assert joined.chi2 == pytest.approx(1.0 / (1 / 2 + 1 / 5))
    information = np.diag([1e5, 4e12, 1e11])
    normal = information.copy()
    normal[0, 0] = -1e6 + 10.0  # nearly minus the prior
    normal[1, 0], normal[2, 0] = 3e10, -2e9
    true = np.array([0.0, 4e-6, 13e-6])
    block = Score(normal @ true + np.array([3e3, 0.0, 0.0]), normal, information)
    joined = least_squares.combine([block], [NONE], [NONE], np.eye(3) / 1e-3**2)
    assert_allclose(joined.value[1:], true[1:], atol=1e-9)
    assert np.sqrt(joined.covariance[0, 0]) > 0.9e-3


def test_legendre_columns_are_one_u_and_so_on():
    """Analytic: first three polynomials over an interval; degree -1 gives no column."""
    time = np.linspace(10.0, 20.0, 5)
    u = np.array([-1, -0.5, 0, 0.5, 1])
    expected = np.stack([np.ones(5), u, 1.5 * u**2 - 0.5], axis=1)
    assert_allclose(least_squares.polynomial(time, 2, 10.0, 20.0), expected, atol=1e-15)
    assert least_squares.polynomial(time, -1, 10.0, 20.0).shape == (5, 0)


def test_the_filter_ends_at_regularised_least_squares():
    """Analytic: with a finite start the end is least squares with the start as an observation (erratum T-7)."""
    rng = np.random.default_rng(1)
    design, observed = rng.standard_normal((50, 3)), rng.standard_normal(50)
    variance = rng.uniform(0.5, 2.0, 50)
    start, prior = np.array([1.0, -2.0, 0.5]), np.diag([4.0, 1.0, 9.0])
    run = least_squares.filter_constants(observed, design, start, prior, variance)
    normal = design.T @ (design / variance[:, None]) + np.linalg.inv(prior)
    right = design.T @ (observed / variance) + np.linalg.solve(prior, start)
    assert_allclose(run.value[-1], np.linalg.solve(normal, right), rtol=1e-9)  # rounding of 50 steps
    assert_allclose(run.covariance, np.linalg.inv(normal), rtol=1e-9)
    assert_allclose(run.sigma[-1], np.sqrt(np.diag(np.linalg.inv(normal))), rtol=1e-9)
