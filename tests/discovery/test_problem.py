"""Parts of a search: columns of a block kept by channel, items on cores, causes of a model file that nobody knows."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal.discovery.driver import check_causes
from gravcal.discovery.problem import basis_of, columns_of, parallel, without_rounding
from gravcal.errors import CatalogError
from gravcal.estimation.records import Entry

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
    """Analytic: of all columns, of their squares, of some of them, with a signal; more stand after the others."""
    columns, whole, basis = made
    clean = whole - basis @ (basis.T @ whole)
    assert_allclose(columns.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(columns.squares, np.sum(whole**2, axis=0), rtol=1e-13)
    signal = np.random.default_rng(1).standard_normal((90, 5))
    signal -= basis @ (basis.T @ signal)
    assert_allclose(columns.onto(signal), clean.T @ signal, atol=1e-12)
    for wanted in ([0], [8, 2, 6], np.arange(9), []):
        assert_allclose(columns.of(np.array(wanted, dtype=int)), clean[:, np.array(wanted, dtype=int)], atol=1e-13)
    both = np.concatenate([whole, np.random.default_rng(2).standard_normal((90, 2))], axis=1)
    clean, wider = both - basis @ (basis.T @ both), columns.wider(both[:, 9:])
    assert_allclose(wider.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(wider.of(np.array([10, 1])), clean[:, [10, 1]], atol=1e-13)
    assert columns.products().shape == (9, 9)


def test_columns_along_own_ones_are_gone_and_not_rounding(made):
    """Analytic: products with a column of the own ones are zero, also where it comes later; others are untouched."""
    columns, _, basis = made
    assert basis_of(np.concatenate([basis, basis[:, :1]], axis=1)).shape == (90, 4)  # what is repeated adds nothing
    own = 1e9 * basis @ np.ones((4, 1))
    wider = columns.wider(own).products()
    assert np.all(wider[-1] == 0)
    assert np.all(wider[:, -1] == 0)
    assert_allclose(wider[:9, :9], columns.products(), atol=0)
    squares = np.append(np.zeros(9), 1e20)
    products = np.full((10, 10), 1e3)
    assert np.count_nonzero(without_rounding(products, squares)) == 81


@pytest.mark.parametrize("cores", [1, 2])
def test_parallel_gives_the_results_in_order(monkeypatch, cores):
    """Contract: as a plain loop, on one core or on two, of one item, of none and of two a call; errors come through."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(cores))
    numbers = list(range(50))
    assert parallel(lambda a, b: 10 * a + b, numbers, numbers) == [11 * n for n in numbers]
    assert parallel(str, [7]) == ["7"]
    assert parallel(str, []) == []
    with pytest.raises(np.linalg.LinAlgError):
        parallel(np.linalg.inv, [np.eye(2), np.zeros((2, 2))])
    with pytest.raises(ValueError, match="shorter"):
        parallel(divmod, [1, 2], [3])


def test_a_driver_that_the_calibration_has_not_is_an_error():
    """Contract: it was ignored without a word; causes of the catalogue, drivers and lines that are searched pass."""
    searched = [SimpleNamespace(cause=cause) for cause in ("unknown:pointing", "ranging.delay")]
    lines = (SimpleNamespace(cause="unknown:time"),)
    observed = SimpleNamespace(name="kbr_phase_centre", candidates=searched, lines=lines, tones={})
    known, foreign = ("unknown:pointing", "unknown:time", "torque.eddy_current"), Entry("unknown:warmth", "", {})
    check_causes(observed, [Entry(cause, "", {}) for cause in known])
    check_causes(None, [foreign])
    with pytest.raises(CatalogError, match="found unknown:warmth, expected .* of kbr_phase_centre: unknown:pointing"):
        check_causes(observed, [Entry("unknown:pointing", "", {}), foreign])
