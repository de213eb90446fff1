"""What all documents and pages share: checks decide the status, origin comes first, numbers, long series drawn."""

import importlib
import inspect
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from gravcal import calibrations
from gravcal.calibrations import checks
from gravcal.report import discovery, documents, pages, plain
from gravcal.report.figures import BARE, HANN, thinned

DOCUMENT = {"status": "delivered", "verdict": {"text": "Delivered: x 1.0 um."}, "settings": {}}
HEIGHT = checks.at_most("height", 3.0, 2.0, "km")
FIT = checks.at_least("probability of the fit", 0.2, 1e-3, "1")


def test_a_failed_check_makes_a_result_questionable():
    """Contract: status, checks and the first words of the verdict; without a result there is nothing to question.

    What cannot be evaluated does not pass and is null in the document.
    """
    assert documents.judged(DOCUMENT, (), [FIT])["status"] == "delivered"
    judged = documents.judged(DOCUMENT, (), [FIT, HEIGHT])
    assert judged["status"] == "questionable"
    assert judged["checks"][1] == {"name": "height", "value": 3.0, "limit": 2.0, "unit": "km", "passed": False}
    assert judged["verdict"]["text"] == "QUESTIONABLE: height 3, limit 2 km. Delivered: x 1.0 um."
    assert documents.judged(DOCUMENT | {"status": "no_manoeuvre"}, (), [HEIGHT])["status"] == "no_manoeuvre"
    for check in (checks.at_most("a", np.nan, 1.0, "m"), checks.at_least("a", np.nan, 1.0, "m")):
        assert not check.passed
        assert documents.judged(DOCUMENT, (), [check])["checks"][0]["value"] is None


@pytest.mark.parametrize(("found", "origin"), [("sm", "mixed"), ("ss", "simulated"), ("mm", "measured")])
def test_the_origin_stands_first(found, origin):
    """Contract: measured, simulated or mixed, and the verdict begins with it unless all is measured."""
    words = {"s": "simulated", "m": "measured"}
    judged = documents.judged(DOCUMENT, [xr.Dataset(attrs={"origin": words[letter]}) for letter in found], [])
    assert judged["origin"] == origin
    assert judged["verdict"]["text"].startswith("Delivered" if origin == "measured" else origin.upper())


def test_what_is_not_determined_becomes_null():
    """Contract: NaN and infinity reach no document; a value without error is not determined; no dof is no test."""
    assert plain.numbers([[1.0, np.nan], [np.inf, -2.0]]) == [[1.0, None], [None, -2.0]]
    assert plain.as_plain({"a": (np.float64("nan"), np.int64(3), np.bool_(True))}) == {"a": [None, 3, True]}
    assert plain.estimate([1.0, 2.0], [0.1, np.nan]) == {"value": [1.0, None], "sigma": [0.1, None]}
    assert plain.chi_square_test(0.0, 0) == {"chi2": None, "dof": 0, "p": None}


@pytest.mark.parametrize(
    ("form", "given", "text"),
    [
        (plain.plus_minus, (107.24, 2.34, None), "107.2 ± 2.3"),
        (plain.plus_minus, (-38.834, 0.478, 3.93), "−38.83 ± 0.48 (3.93)"),
        (plain.plus_minus, (None, None, None), "–"),
        (plain.plus_minus, (-0.01, 1.0, None), "0.0 ± 1.0"),
        (plain.probability, (0.546,), "0.55"),
        (plain.probability, (1e-9,), "< 0.001"),
        (plain.probability, (None,), "–"),
        (plain.gps_text, (0,), "2000-01-01 12:00:00"),  # the epoch as published
        (plain.gps_text, (633787200.25, 2), "2020-02-01 00:00:00.25"),
        (plain.quantity, (0.0199, 3.7e-4, "1"), "1.990 ± 0.037 %"),
        (plain.quantity, (3.2e-6, 2e-7, "1"), "3.20 ± 0.20 ×10⁻⁶"),
        (plain.quantity, (6.1e-12, 2.1e-13, "m s-2 A-1 m-2"), "6.10 ± 0.21 pm s⁻² A⁻¹ m⁻²"),
        (plain.quantity, (-0.3, 0.021, "s"), "−300 ± 21 ms"),
        (plain.quantity, (39.8, 2.2, "s"), "39.8 ± 2.2 s"),
        (plain.quantity, (2e-8, None, "T"), "20 nT"),
    ],
)
def test_numbers_as_they_are_printed(form, given, text):
    """Contract: two digits of the error, a true minus, no negative zero, no exponents, prefixes of the unit."""
    assert form(*given) == text


def test_thinning_keeps_every_peak_and_every_gap():
    """Analytic: of a long series the lowest and highest of each group stay, in order; what is unknown stays unknown."""
    x, y = np.linspace(0, 10, 100_001), np.zeros(100_001)
    y[54_321], y[65_432], y[10_000:20_000] = 0.9, -0.8, np.nan
    across, values = thinned(x, y)
    assert across.size <= 802
    assert (np.diff(across) >= 0).all()
    assert (np.nanmax(values), np.nanmin(values)) == (0.9, -0.8)
    assert np.isnan(values[(across > 1.03) & (across < 1.97)]).all()
    assert np.isfinite(values[(across < 0.97) | (across > 2.03)]).all()


def test_every_spectrum_states_its_method_and_window():
    """Contract: one phrase in the caption of each figure that draws along frequency."""
    names = [one.parent.name for one in Path(calibrations.__path__[0]).glob("*/page.py")]
    found = [importlib.import_module(f"{calibrations.__name__}.{name}.page") for name in names]
    figures = [one for module in (*found, discovery) for one in vars(module).values() if isinstance(one, pages.Figure)]
    spectra = [one for one in figures if "frequency" in inspect.getsource(one.draw)]
    assert len(spectra) >= 10
    assert [one.draw.__name__ for one in spectra if HANN not in one.caption and BARE not in one.caption] == []
