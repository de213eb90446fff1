"""The page of a centre-of-mass event."""

import base64
import re
from xml.etree import ElementTree

import invented
import numpy as np
import pytest
import xarray as xr
from matplotlib import rc_context

from gravcal import catalog
from gravcal.calibrations.com_offset import page
from gravcal.calibrations.com_offset.page import vcm_line
from gravcal.report import documents, pages
from gravcal.report.figures import STYLE, image
from gravcal.report.plain import plus_minus

EVENT = "grace-c-2020-02-01"


WITHOUT_FIGURES = dict.fromkeys(("field", "align", "attitude", "survey"))
WITHOUT_FIGURES |= {f"{kind}.{name}": None for kind in ("solve", "angular_acceleration") for name in invented.VARIANTS}


def page_of(document, products, published=None, vcm=None):
    """Page of all products."""
    return page.html(document, products, published or {}, vcm)


@pytest.fixture(scope="module")
def html(document, products):
    """Page of the event beside its printed values."""
    line = vcm_line(document, "C")
    return page_of(document, products, published=catalog.published("com_offset", EVENT), vcm=line)


def test_the_same_products_give_the_same_bytes(html, document, products):
    """Contract: no clock, no machine, no memory address in the page."""
    line = vcm_line(document, "C")
    again = page_of(document, products, published=catalog.published("com_offset", EVENT), vcm=line)
    assert again == html


def test_the_page_needs_nothing_from_outside(html):
    """Contract: one file without addresses, scripts or style sheets elsewhere."""
    assert html.count("<img") == html.count('<img src="data:')
    assert [word for word in ("://", "<script", "<link", "url(") if word in html] == []
    assert len(html) < 2e6


def test_the_page_says_the_numbers_of_the_document(html, document):
    """Contract: verdict first, then every combined offset with both errors, and the printed ones."""
    body = html[html.index("<body>") :]
    assert body.index("Delivered:") < body.index("<h1>")
    for block in document["variants"].values():
        for value, sigma, total in zip(*(block[n] for n in ("offset_um", "sigma_um", "sigma_total_um")), strict=True):
            assert plus_minus(value, sigma, total) in body
    assert "113.5 ± 0.5" in body  # Table 6, acc_calibrated
    assert vcm_line(document, "C") in body


def test_printed_values_beside_a_simulated_event_are_marked(html, document, products):
    """Contract: banner first; every table and figure with printed values says that they belong to measured data."""
    given = {"published": catalog.published("com_offset", EVENT)}
    text = page_of(documents.judged(document, [xr.Dataset(attrs={"origin": "simulated"})], []), products, **given)
    body = text.partition("<body>")[2]
    assert body.index('class="origin">Simulated data') < body.index("SIMULATED. Delivered:") < body.index("<h1>")
    mark = "What is printed belongs to measured data, this event is simulated."
    assert text.count(mark) == 3
    assert mark not in html
    assert "Hollow: printed values. " + mark in text


def test_every_figure_is_there_and_numbered(html):
    """Contract: seven figures like those of the paper."""
    assert html.count("<figure>") == 7
    assert [int(n) for n in re.findall(r"<b>Figure (\d+)\.</b>", html)] == list(range(1, 8))


def test_a_missing_product_leaves_out_its_figure(document, products):
    """Contract: the page comes all the same."""
    html = page_of(document, products | WITHOUT_FIGURES | {"attitude": products["attitude"]})
    assert html.count("<figure>") == 2  # estimates, from the document; attitude


def test_a_record_without_manoeuvre_has_its_page(quiet_document, quiet_products):
    """Contract: field, attitude and torque response, no table of offsets."""
    html = page_of(quiet_document, quiet_products)
    assert "No manoeuvre in the torquer currents" in html
    assert html.count("<figure>") == 3
    assert "0.0028 ± 0.0002" in html
    assert "Every manoeuvre" not in html


def test_a_manoeuvre_that_is_not_used_says_why(documented, products):
    """Contract: the row of the manoeuvre names the gap."""
    smoothed = products["attitude"].copy(deep=True)
    smoothed["gap"][1] = 1
    html = page_of(documented(products | {"attitude": smoothed}), products | WITHOUT_FIGURES)
    assert html.count("not used: gap in orbit") == 1


def test_names_from_outside_are_escaped(products, documented):
    """Contract: an event is text, not HTML."""
    document = documented(products, "<b>x</b>")
    html = page_of(document, products | WITHOUT_FIGURES)
    assert "<b>x</b>" not in html


def test_printed_manoeuvres_are_matched_by_kind_and_latitude(document):
    """Published: Table 7; ours are pitch at high, roll at middle, yaw at low latitude."""
    found = page.printed_manoeuvres(document, catalog.published("com_offset", EVENT))
    classes = [one["latitude_class"] for one in document["manoeuvres"]]
    assert found[0, "mtq"].value == ((109.5, None, 22.9) if classes[0] == "high" else (122.7, 79.3, 9.7))
    assert found[2, "mtq"].value == (-6.0, 1.8, 8.8)


@pytest.mark.parametrize("which", range(7))
def test_figures_are_drawn(products, document, which):
    """Contract: warnings as errors; well-formed SVG, the same bytes again, labelled panels, numbers only."""
    figures_are_drawn(page.event_sections(document, {}), products, which)


@pytest.mark.parametrize("which", range(3))
def test_figures_of_a_record_without_manoeuvre_are_drawn(quiet_products, quiet_document, which):
    """Contract: as those of an event."""
    figures_are_drawn(page.survey_sections(quiet_document), quiet_products, which)


def figures_are_drawn(sections, products, which):
    """Assert that a figure of a page is as it has to be."""
    one = [one for section in sections for one in section.figures][which]
    given = pages.arguments(one, products)
    with rc_context(STYLE):
        panels = one.draw(*given).axes
    assert any("(" in text for panel in panels for text in (panel.get_ylabel(), panel.get_title(loc="left")))
    curves = [line.get_ydata() for panel in panels for line in panel.lines]
    assert any(np.isfinite(np.asarray(values, dtype=float)).any() for values in curves)
    text = base64.b64decode(image(one.draw, *given).partition(",")[2])
    assert ElementTree.fromstring(text).tag.endswith("svg")
    assert b"nan" not in text
