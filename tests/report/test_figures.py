"""Figures of the reports."""

import warnings

import pytest

from gravcal.report import com_offset_figures as figures
from gravcal.report import com_offset_result_figures as results
from gravcal.report.figures import COLOURS, image


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
    """Contract: every figure of the page, with warnings as errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = drawings(products, document)[name][0](*drawings(products, document)[name][1:])
    labels = [panel.get_ylabel() + panel.get_xlabel() + panel.get_title() for panel in figure.axes]
    assert any("(" in label for label in labels)


def test_the_same_figure_has_the_same_bytes(products):
    """Contract: no date, no random identifier, in both forms."""
    for form in ("png", "svg"):
        first, second = (image(results.roll, products["survey"], form=form) for _ in range(2))
        assert first == second


def test_nothing_to_show_gives_no_image(quiet_products):
    """Contract: a record without manoeuvre has no spectra."""
    assert image(results.spectra, by_variant(quiet_products, "solve")["acc"]) is None


def test_colours_differ_in_lightness_too():
    """Contract: the four angular accelerations can be told apart in grey, by marker and by line."""
    looks = [tuple(look.values()) for look in figures.VARIANT_STYLE.values()]
    for part in zip(*looks, strict=True):
        assert len(set(part)) >= 3
    assert {look["color"] for look in figures.VARIANT_STYLE.values()} <= set(COLOURS.values())
