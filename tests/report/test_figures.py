"""Figures of the reports."""

import warnings
from xml.etree import ElementTree

import pytest

from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_result_figures as results
from gravcal.report.drawing_looks import VARIANT_LOOK
from gravcal.report.figures import COLOURS


def by_variant(products, name):
    """Datasets of a kind by variant."""
    return {one.attrs["variant"]: one for one in products[name]}


def drawings(products, document):
    """Every figure with its arguments."""
    solved, angular = by_variant(products, "solve"), by_variant(products, "angular_acceleration")
    return {
        "field": (figures.field, products["field"], products["align"]),
        "torquers": (figures.torquers, products["align"], products["attitude"], products["detect"]),
        "attitude": (figures.attitude, products["attitude"]),
        "angular": (figures.angular_accelerations, angular, products["detect"]),
        "linear": (figures.linear_accelerations, solved["acc"], products["detect"]),
        "spectra": (results.spectra, solved["acc"]),
        "estimates": (results.estimates, document, {}),
        "roll": (results.roll, products["survey"]),
    }


@pytest.mark.parametrize("name", ["field", "torquers", "attitude", "angular", "linear", "spectra", "estimates", "roll"])
def test_figures_are_drawn_without_a_warning(products, document, name):
    """Contract: every figure of the page, warnings as errors; well-formed, with units, numbers only."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = drawings(products, document)[name][0](*drawings(products, document)[name][1:])
    root = ElementTree.fromstring(figure)
    words = ["".join(text.itertext()) for text in root.iter("text")]
    assert any("(" in text for text in words)
    assert len(list(root.iter("svg"))) > 1
    assert "nan" not in figure
    assert "inf" not in figure


def test_the_same_figure_has_the_same_text(products):
    """Contract: no date, no random identifier."""
    assert results.roll(products["survey"]) == results.roll(products["survey"])


def test_nothing_to_show_gives_no_drawing(quiet_products):
    """Contract: a record without manoeuvre has no spectra."""
    assert results.spectra(by_variant(quiet_products, "solve")["acc"]) is None


def test_colours_differ_in_lightness_too():
    """Contract: the four angular accelerations can be told apart in grey, by point and by line."""
    looks = VARIANT_LOOK.values()
    for part in ("colour", "dash", "shape"):
        assert len({getattr(look, part) for look in looks}) >= 3
    assert {look.colour for look in looks} <= set(COLOURS.values())
