"""Figures of the reports."""

import base64
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import rc_context

from gravcal.report import com_offset_figures as figures
from gravcal.report.figures import COLOURS, STYLE, VARIANTS, image, thinned


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
        "spectra": (figures.spectra, solved["acc"]),
        "estimates": (figures.estimates, document, {}),
        "roll": (figures.roll, products["survey"]),
    }


@pytest.mark.parametrize("name", ["field", "torquers", "attitude", "angular", "linear", "spectra", "estimates", "roll"])
def test_figures_are_drawn(products, document, name):
    """Contract: every figure of the page, warnings as errors: well-formed SVG, labelled panels, numbers only."""
    draw, *given = drawings(products, document)[name]
    with rc_context(STYLE):
        panels = draw(*given).axes
    assert any("(" in text for panel in panels for text in (panel.get_ylabel(), panel.get_title(loc="left")))
    curves = [line.get_ydata() for panel in panels for line in panel.lines]
    assert any(np.isfinite(np.asarray(values, dtype=float)).any() for values in curves)
    text = base64.b64decode(image(draw, *given).partition(",")[2])
    assert ElementTree.fromstring(text).tag.endswith("svg")
    assert b"nan" not in text


def test_the_same_figure_has_the_same_bytes(products):
    """Contract: no date, no random identifier."""
    assert image(figures.roll, products["survey"]) == image(figures.roll, products["survey"])


def test_nothing_to_show_gives_no_drawing(quiet_products):
    """Contract: a record without manoeuvre has no spectra."""
    assert figures.spectra(by_variant(quiet_products, "solve")["acc"]) is None
    assert image(figures.spectra, by_variant(quiet_products, "solve")["acc"]) is None


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


def test_colours_differ_in_lightness_too():
    """Contract: the four angular accelerations can be told apart in grey, by point and by line."""
    for part in ("color", "linestyle", "marker"):
        assert len({style.get(part) for style in VARIANTS.values()}) >= 3
    assert {style["color"] for style in VARIANTS.values()} <= set(COLOURS.values())
