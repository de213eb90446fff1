"""The pages in a real browser: Debian's Chromium without a screen.

It is skipped where Chromium and its driver are missing, unless GRAVCAL_NEEDS_CHROMIUM is set, as .ci/run does.
"""

import pytest
from chromium import DRAWN, click, complaints, wait
from invented_store import EVENT


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
    choose(browser, "with", "gain: 1.0 -> 1.5")
    assert "A: this product" in browser.find_element("tag name", "main").text
    choose(browser, "view", "difference")
    drawn = "return Bokeh.documents[0].get_model_by_name('line-0').data.y"
    largest = max(abs(value) for value in browser.execute_script(f"return Array.from((() => {{{drawn}}})())"))
    assert largest == pytest.approx(0.5, abs=0.01)  # m s-2: 1.5 - 1.0 times a sine of x
    choose(browser, "view", "spectrum")
    assert "Welch" in browser.find_element("css selector", ".plotted").text
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
