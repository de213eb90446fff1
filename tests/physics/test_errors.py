"""Errors keep their facts."""

import pickle

import pytest

from gravcal.errors import CatalogError, EstimationError, GravcalError, ProductError


@pytest.mark.parametrize("kind", [GravcalError, CatalogError, ProductError, EstimationError])
def test_an_error_survives_the_way_between_processes_with_its_facts(kind):
    """Contract: pickling returns the same class, message and facts."""
    error = pickle.loads(pickle.dumps(kind("row 3: found 2 m, expected 1 m", row=3, found=2.0)))
    assert type(error) is kind
    assert str(error) == "row 3: found 2 m, expected 1 m"
    assert error.facts == {"row": 3, "found": 2.0}
