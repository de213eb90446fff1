"""The pages in a real browser: Debian's Chromium without a screen.

It is skipped where Chromium and its driver are missing, unless GRAVCAL_NEEDS_CHROMIUM is set, as .ci/run does.
"""

from dataclasses import replace

import pytest
from chromium import DRAWN, PIXELS, click, complaints, wait
from invented_store import EVENT

from flows.calibration import load
from gravcal.browse import timeline
from gravcal.report.history import history

BLUE, VERMILION = "0,114,178", "213,94,0"


def colours(browser):
    """Colours on the canvases of all figures."""
    return {colour for found in browser.execute_script(PIXELS) for colour in found}


def choose(browser, name, text):
    """Choose an entry of a list by a part of its text; the page follows."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import Select

    box = Select(browser.find_element(By.NAME, name))
    label = next(one.text for one in box.options if text in one.text)
    before = browser.current_url
    box.select_by_visible_text(label)
    wait(browser, lambda one: one.current_url != before)
    wait(browser, lambda one: one.execute_script(DRAWN) == ["drawn"])


def test_from_the_first_page_to_a_plot_and_a_comparison(site, shop):
    """Contract: by clicks alone to a product, a figure with its lines, a comparison and a spectrum; a quiet console."""
    browser = site("/")
    click(browser, EVENT)
    assert browser.find_elements("css selector", ".chain .box.made")
    browser.get(browser.current_url.rpartition("/event/")[0] + f"/product/{shop['again']['mtq'].key}")
    wait(browser, lambda one: one.execute_script(DRAWN) == ["drawn"])
    assert {BLUE, VERMILION} <= colours(browser)
    choose(browser, "with", "gain: 1.0 -> 1.5")
    assert "A: this product" in browser.find_element("tag name", "main").text
    choose(browser, "view", "difference")
    drawn = "return Bokeh.documents[0].get_model_by_name('line-0').data.y"
    largest = max(abs(value) for value in browser.execute_script(f"return Array.from((() => {{{drawn}}})())"))
    assert largest == pytest.approx(0.5, abs=0.01)  # m s-2: 1.5 - 1.0 times a sine of x
    assert BLUE in colours(browser)
    choose(browser, "view", "spectrum")
    assert "Welch" in browser.find_element("css selector", ".plotted").text
    assert complaints(browser) == []


def test_zooming_brings_finer_data(site, shop):
    """Contract: a narrower view is asked for and is then the samples themselves."""
    browser = site(f"/product/{shop['again']['align'].key}")
    range_ = "Bokeh.documents[0].get_model_by_name('figure').x_range"
    start, end = browser.execute_script(f"return [{range_}.start, {range_}.end]")
    assert end - start == pytest.approx(19999 * 100, rel=1e-6)  # ms
    browser.execute_script(f"{range_}.start = {start + 1000}; {range_}.end = {start + 3000}")
    wait(browser, lambda one: one.execute_script("return document.querySelector('.plot').dataset.refined") is not None)
    times = browser.execute_script("return Array.from(Bokeh.documents[0].get_model_by_name('line-0').data.x)")
    assert len(times) == pytest.approx(23, abs=2)
    assert times[1] - times[0] == pytest.approx(100, abs=1)  # ms
    assert complaints(browser) == []


def test_a_report_runs_no_script(site, shop):
    """Contract: the report is shown in a frame that runs nothing."""
    browser = site(f"/report/{shop['again']['report'].key}/report.html")
    assert "the report" in browser.find_element("tag name", "body").text
    assert browser.title == "r"
    browser.get_log("browser")  # Chromium notes the script that it kept from running


def test_nothing_is_asked_of_other_hosts(site, shop):
    """Contract: the browser's own log of requests names no host but this machine."""
    browser = site("/")
    browser.get_log("performance")
    for path in ("/", f"/event/{EVENT}", "/timeline/com_offset", f"/product/{shop['again']['mtq'].key}"):
        site(path)
    lines = [line["message"] for line in browser.get_log("performance")]
    asked = {part.partition('"')[0] for line in lines for part in line.split('"url":"')[1:]}
    assert any("bokeh.min.js" in address for address in asked)
    assert not {address for address in asked if not address.startswith(("http://127.0.0.1:", "data:", "about:"))}


@pytest.mark.parametrize(("calibration", "satellite"), [("com_offset", "C"), ("inertial_sensor", "T")])
def test_every_column_of_a_series_is_in_sight(calibration, satellite, browser, tmp_path):
    """Contract: no table of `gravcal series` is wider than a page of 756 pixels, half a screen."""
    said = timeline.printed_points(load(calibration), satellite)
    trims = [(satellite, one) for one in timeline.trims(satellite)]
    own = [replace(one, mood="good", event="grace-c-2020-02-01") for one in said]
    page = tmp_path / "series.html"
    page.write_text(history(calibration, [*own, *said], trims)[1])
    browser.get(page.as_uri())
    widths = "return [...document.querySelectorAll('.scroll')].map((one) => one.firstElementChild.offsetWidth)"
    found = browser.execute_script(widths)
    assert found
    assert max(found) <= 756
