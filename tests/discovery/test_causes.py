"""Causes of a model file that a calibration does not know."""

from types import SimpleNamespace

import pytest

from gravcal.discovery.driver import check_causes
from gravcal.errors import CatalogError
from gravcal.estimation.records import Entry


def entry(cause):
    """An entry without parameters."""
    return Entry(cause, "", {})


def test_a_driver_that_the_calibration_has_not_is_an_error():
    """Contract: it was ignored without a word; causes of the catalogue, drivers and lines that are searched pass."""
    observed = SimpleNamespace(
        name="kbr_phase_centre",
        candidates=[SimpleNamespace(cause="unknown:pointing"), SimpleNamespace(cause="ranging.delay")],
        lines=(SimpleNamespace(cause="unknown:time"),),
        tones={},
    )
    check_causes(observed, [entry("unknown:pointing"), entry("unknown:time"), entry("torque.eddy_current")])
    check_causes(None, [entry("unknown:warmth")])
    with pytest.raises(CatalogError, match="found unknown:warmth, expected .* of kbr_phase_centre: unknown:pointing"):
        check_causes(observed, [entry("unknown:pointing"), entry("unknown:warmth")])
