"""Columns of a block kept by channel, against the whole matrix."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.discovery.problem import basis_of, columns_of, without_rounding

CHANNELS = {
    "by channel": np.repeat(["linear", "angular", "attitude"], [40, 30, 20]),
    "alternating": np.tile(["linear", "angular", "attitude"], 30),
}


@pytest.fixture(params=CHANNELS)
def made(request):
    """Columns (90, 9) of five pieces, the whole matrix less its part along the own columns, and the basis of those."""
    rng = np.random.default_rng(17)
    channel = CHANNELS[request.param]
    linear, angular = (channel == name for name in ("linear", "angular"))
    pieces = [rng.standard_normal((90, q)) for q in (1, 3, 2)]
    pieces[1][~linear] = 0.0
    pieces[2][linear] = 0.0
    pieces += [None, rng.standard_normal((90, 1)) * angular[:, None]]
    widths = [1, 3, 2, 2, 1]
    basis = basis_of(rng.standard_normal((90, 4)))
    whole = np.concatenate([np.zeros((90, 2)) if p is None else p for p in pieces], axis=1)
    return columns_of(channel, basis, pieces, widths), whole, basis


def test_products_are_those_of_the_whole_matrix(made):
    """Analytic: of all columns with each other, of their squares, of some of them, and with a signal."""
    columns, whole, basis = made
    clean = whole - basis @ (basis.T @ whole)
    assert_allclose(columns.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(columns.squares, np.sum(whole**2, axis=0), rtol=1e-13)
    signal = np.random.default_rng(1).standard_normal((90, 5))
    signal -= basis @ (basis.T @ signal)
    assert_allclose(columns.onto(signal), clean.T @ signal, atol=1e-12)
    for wanted in ([0], [8, 2, 6], np.arange(9), []):
        assert_allclose(columns.of(np.array(wanted, dtype=int)), clean[:, np.array(wanted, dtype=int)], atol=1e-13)


def test_more_columns_stand_after_the_others(made):
    """Analytic: as if they had been handed over with them; the narrower ones stay as they are."""
    columns, whole, basis = made
    more = np.random.default_rng(2).standard_normal((90, 2))
    both = np.concatenate([whole, more], axis=1)
    clean = both - basis @ (basis.T @ both)
    wider = columns.wider(more)
    assert_allclose(wider.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(wider.of(np.array([10, 1])), clean[:, [10, 1]], atol=1e-13)
    assert columns.products().shape == (9, 9)


def test_columns_along_own_ones_are_gone_and_not_rounding(made):
    """Analytic: products with a column of the own ones are zero, also where it comes later; others are untouched."""
    columns, whole, basis = made
    own = 1e9 * basis @ np.ones((4, 1))
    wider = columns.wider(own).products()
    assert np.all(wider[-1] == 0)
    assert np.all(wider[:, -1] == 0)
    assert_allclose(wider[:9, :9], columns.products(), atol=0)
    squares = np.append(np.zeros(9), 1e20)
    products = np.full((10, 10), 1e3)
    assert np.count_nonzero(without_rounding(products, squares)) == 81
