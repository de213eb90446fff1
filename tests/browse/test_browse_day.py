"""A working day with the pages: what changed and why, tables kept in the address, data of plots, any screen, anyone."""

import csv
import io
import json
import re
from pathlib import Path

import axe_core_python
import numpy as np
import pytest
import xarray as xr
from chromium import DRAWN, click, complaints, wait
from commands import gravcal
from invented_store import EVENT, FILE, calibration, dataset, experiment, model, put, result

from gravcal.browse import store_index
from gravcal.report import discovery, pages
from gravcal.report.figures import HANN, grid
from gravcal.store import configurations, location

PAGES = ("/", "/products?all=1", f"/event/{EVENT}", f"/event/{EVENT}/discovery", "/timeline/com_offset",
         "/compare/com_offset", "/designs", "/designs?event=grace-c-2020-02-01",
         "/event/grace-d-2021-05-01")  # fmt: skip
#: Of axe-core: every page for screen readers and weak eyes.
SCRIPT = (Path(axe_core_python.__file__).parent / "axe.min.js").read_text()
AXE = """
const done = arguments[0];
const told = (found) => done(found.violations.map((one) => `${one.id}: ${one.nodes[0].html}`));
axe.run(document, {iframes: false}).then(told);
"""


#: Size at which an effect would be found.
LIMIT = {"cause": "timing.star_camera_delay", "parameter": "delay", "form": "", "unit": "s", "size": 0.004}
LIMIT |= {"prior": 0.1, "bias_in_sigma": 0.5, "confirmed": True, "confused_with": ["accelerometer.bias_step"]}


def searched(event):
    """Publish an invented discovery with a finding and two limits."""
    value = {"value": 0.03, "sigma": 0.002, "unit": "1"}
    finding = {"cause": "torque.dipole_gain", "tied_with": [], "significance": 1e-4, "parameters": {"rod_y": value}}
    document = {"calibration": "com_offset", "origin": "measured", "level": 0.005, "findings": [finding]}
    document |= {"verdict": {"text": "A gain is named."}, "adequate_after": True}
    document |= {"limits": [LIMIT, LIMIT | {"size": None}]}
    files = {"discovery.html": "<!DOCTYPE html><title>d</title>", "discovery.json": json.dumps(document)}
    return put(f"{event}/com_offset.discovery_report", dataset(10), files=files)


@pytest.fixture
def day(shop):
    """Return the invented store with a discovery and an experiment beside the delivery."""
    searched(EVENT)
    own = experiment("gain-9", 1.5, gain=9.0)
    location.write_json(configurations._path("com_offset", "gain-9"), {"name": "gain-9", "settings": {"gain": 9.0}})
    return shop | {"tried": own}


def test_the_chain_is_that_of_the_last_run_and_results_say_how_they_differ(day, ask):
    """Contract: no product of another flow; another value of a setting marks what takes it and what is made of that.

    Yesterday's beside last month's: values with digits of their error, in sigma, the setting by name.
    """
    nodes = store_index.chain(EVENT, flow="com_offset")
    assert {node.stage for node in nodes} == {f"com_offset.{n}" for n in ("align", "report", "solve.mtq", "solve.acc")}
    assert {node.key for node in nodes} == {day["again"][name].key for name in ("align", "report", "mtq", "acc")}
    assert "com_offset.discovery_report" in {node.stage for node in store_index.chain(EVENT)}
    picture = ask(f"/event/{EVENT}?change=gain").text.split("<h2>Chain")[1].split("</svg>")[0]
    assert len(re.findall(r'class="box \w+ again"', picture)) == 3
    assert "com_offset.align, reused, would be made again" not in picture
    assert "discovery_report" not in picture
    assert "discovery_report" in ask(f"/event/{EVENT}?flow=all").text.split("<h2>Chain")[1].split("</svg>")[0]
    text = ask(f"/event/{EVENT}").text.split("<h2>Other results")[1].split("</table>")[0]
    assert "gain: 1.0 -&gt; 1.5" in text
    assert "gain: 9.0 -&gt; 1.5" in text
    assert "x 15.0 ± 1.0 µm: −5 (−5.00 sigma)" in text.replace(" um", " µm")


def tried(name, scale, settings=(), **more):
    """Publish the chain of an experiment, and what it is; references by stage."""
    location.write_json(configurations._path("com_offset", name), {"name": name, "settings": dict(settings)})
    with location.configured(name):
        return calibration(EVENT, scale, gain=1.5, **more)


def test_two_models_of_one_cause_are_told_apart(shop, ask, capsys):
    """Contract: by value in both comparisons, the list of products and beside the event; against no model, too."""
    values = {"model-a": 0.0298, "model-b": 0.02}
    made = {n: tried(n, 1 + v, model(v), extended=model(v)) for n, v in values.items()}
    rod = "torque.dipole_gain rod_y"
    for first, second, settings, reason in (
        ("model-a", "model-b", (f"{rod} 0.0298", f"{rod} 0.0200"), f"{rod} 0.0298 -> 0.0200"),
        ("operational", "model-b", ("none", f"{rod} 0.0200"), f"none -> {rod} 0.0200"),
    ):
        page = ask(f"/compare/com_offset?a={first}&b={second}").text
        table, other = page.split("<h2>Settings that differ")[1].split("<h2>Values, event by event")
        assert re.findall("<td[^>]*>(.*?)</td>", table) == ["model", *settings]
        assert f">model: {reason}<".replace("->", "-&gt;") in other
        assert ("Only in operational: grace-c-2021-03-01" in page) == (first == "operational")
        assert gravcal("compare", "com_offset", first, second) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert f"model {' '.join(settings)} " in said
        assert f"reason model: {reason}" in said
    told = store_index.differing(store_index.entries())
    for name, own in made.items():
        for stage in ("extended", "mtq", "acc", "report"):
            assert told[own[stage].key] == [f"model: none -> {rod} {values[name]:.4f}"], (name, stage)
    assert ask("/compare/com_offset?a=operational&b=nothing").status_code == 200
    assert ask("/compare/nothing").status_code == 404
    assert f"model: none -&gt; {rod} 0.0200<" in ask("/products").text


def test_two_results_that_other_code_made_name_it(shop, ask):
    """Contract: equal settings: the module and the data file that changed are the reason, also beside the event."""
    modules = {"gravcal.estimation.noise": "new", "catalog/igrf.shc": "new", "gravcal.physics.frames": "same"}
    tried("rewritten", 1.25, modules=modules)
    text = ask("/compare/com_offset?a=operational&b=rewritten").text.split("What else changed, and why")[1]
    assert "code changed: gravcal.estimation.noise<" in text
    assert "data changed: catalog/igrf.shc<" in text
    assert "gain" not in text
    earlier = ask(f"/event/{EVENT}").text.split("<h2>Other results")[1].split("</table>")[0]
    assert "code changed: gravcal.estimation.noise; data changed: catalog/igrf.shc<" in earlier


def test_products_are_told_apart_by_what_differs(day, ask):
    """Contract: settings and files, not keys; the delivered one needs no mark."""
    told = store_index.differing(store_index.entries())
    assert told[day["first"]["mtq"].key] == ["gain: 1.5 -> 1.0"]
    assert told[day["again"]["mtq"].key] == []
    derived = put(f"{EVENT}/com_offset.combine", dataset(5), inputs=[day["first"]["mtq"]])
    put(f"{EVENT}/com_offset.combine", dataset(6), inputs=[day["again"]["mtq"]])
    assert store_index.differing(store_index.entries())[derived.key] == ["gain: 1.5 -> 1.0"]
    assert "gain: 1.5 -&gt; 9.0" in ask("/products").text
    read = [put(f"{EVENT}/ingest:MAG1B_C", dataset(7, k), source=f"{k}" * 64) for k in (1, 2)]
    old, new = (put(f"{EVENT}/com_offset.detect", dataset(4, k), inputs=[one]) for k, one in enumerate(read, 1))
    rows = dict(re.findall(r'/product/(\w+)">.*?<td class="long">(.*?)</td>', ask("/products?all=1").text))
    assert [rows[one.key] for one in (read[0], old)] == [f"input file {FILE['file']} changed"] * 2
    assert rows[new.key] == ""


def test_discovery_limits_designs_and_all_events_have_pages(day, ask):
    """Contract: digits of errors, what limits mean, calendar time; a joint model with its verdict and page."""
    text = ask(f"/event/{EVENT}/discovery").text
    for said in ("A gain is named.", "torque.dipole_gain", "3.00 ± 0.20 %", "4 ms", "0.04", "never"):
        assert said in text
    assert f'href="/event/{EVENT}/discovery"' in ask(f"/event/{EVENT}").text
    assert ask("/event/grace-c-2021-03-01/discovery").status_code == 404
    assert "com_offset_session" in ask("/designs").text
    assert "2020-02-26 14:40:00.0" in ask(f"/designs?event={EVENT}").text  # 6.36e8 s
    document = {"calibration": "com_offset", "origin": "measured", "verdict": {"text": "20 events: a gain in all."}}
    files = {"joint.html": "<!DOCTYPE html><title>j</title>", "joint.json": json.dumps(document)}
    key = put("grace-c/com_offset.joint", dataset(10), files=files).key
    assert "20 events: a gain in all." in ask("/").text
    assert "all events together" in ask("/event/grace-c").text
    text = ask("/event/grace-c/discovery").text
    assert f'src="/report/{key}/joint.html"' in text
    assert "Findings" not in text


def test_what_is_drawn_comes_as_csv(shop, ask):
    """Contract: every sample of the view, calendar time beside GPS seconds; spectra with their frequencies."""
    where = f"/csv/{shop['again']['align'].key}/acceleration_b"
    heads, *rows = list(csv.reader(io.StringIO(ask(f"{where}?column=0").text)))
    assert heads == ["series", "GPS time (s)", "calendar (GPS)", "acceleration_b (m s-2)"]
    assert len(rows) == 20000
    assert rows[0][:3] == ["x", "640000000.0", "2020-04-12 21:46:40.000"]
    assert float(rows[5][3]) == pytest.approx(np.sin(2 * np.pi * 0.25), abs=1e-6)
    start = (6.4e8 + 946728000.0) * 1e3  # ms of the axis
    part = ask(f"{where}?column=0&from={start + 1000}&to={start + 3000}").text
    assert len(part.splitlines()) == pytest.approx(23, abs=2)
    said, heads, *rows = ask(f"{where}?view=spectrum").text.splitlines()
    assert said.startswith(f"# {HANN} of 5000 samples, mean power of 7 that overlap by half (Welch)")
    assert heads == 'series,frequency (Hz),"density of acceleration_b (m s-2), Hz-1/2"'
    assert len(rows) == 3 * 2500
    assert said[2:] in ask(f"{where.replace('/csv/', '/figure/')}?view=spectrum").text
    assert ask(f"{where.replace('acceleration_b', 'nothing')}").status_code == 404


@pytest.mark.usefixtures("shop")
def test_seconds_of_gps_time_have_their_calendar_form_too(ask):
    """Contract: of `detect`, whose unit is s: on the axis, in tables and CSV; a length has none."""
    start, seconds = 6.4e8 + np.array([0.25, 180.0, np.nan]), {"units": "s"}
    held = {"start": ("manoeuvre", start, seconds), "record_start": ((), start[0], seconds)}
    held |= {"shift": ("manoeuvre", [0.1, 0.2, 0.3], seconds), "margin": ((), 600.0, seconds)}
    key, other = (put(f"{EVENT}/com_offset.detect", xr.Dataset(held), {"gain": gain}).key for gain in (1, 2))
    heads, *rows = ask(f"/csv/{key}/start").text.splitlines()
    assert heads == 'series,manoeuvre (number),start (s),"start, calendar (GPS)"'
    assert rows[0] == "start,0.0,640000000.25,2020-04-12 21:46:40.250"
    assert rows[2] == "start,2.0,nan,"
    assert ask(f"/csv/{key}/shift").text.splitlines()[0] == "series,manoeuvre (number),shift (s)"
    assert "<td>2020-04-12 21:46:40.250</td>" in ask(f"/product/{key}?variable=record_start").text
    assert "<td>2000-01-01" not in ask(f"/product/{key}?variable=margin").text
    assert "DatetimeAxis" in ask(f"/figure/{key}/start?view=overlay").text
    for view in (f"start?with={other}&view=difference", "start?view=spectrum", "shift?view=overlay"):
        assert "DatetimeAxis" not in ask(f"/figure/{key}/{view}").text, view


@pytest.fixture
def at(day, site, browser):
    """Return a function that opens a page on a screen: width in px, dark or not."""

    def open_(path, width=1300, dark=False):
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 700}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        wish = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": wish})
        return site(path)

    yield open_
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_columns_sort_and_filters_combine_and_both_stand_in_the_address(at):
    """Contract: a click sorts, a second turns; words and column:word all count; the address brings it all back."""
    browser = at("/products?all=1")
    cells = "return [...document.querySelectorAll('tbody tr:not([hidden])')].map((row) => row.cells[{}].textContent)"
    browser.find_elements("css selector", ".sort")[1].click()
    found = browser.execute_script(cells.format(1))
    assert found == sorted(found)
    browser.find_elements("css selector", ".sort")[1].click()
    browser.find_element("css selector", ".filter").send_keys(f"{EVENT} stage:solve gain-9")
    found = browser.execute_script(cells.format(1))
    assert found == ["com_offset.solve.mtq", "com_offset.solve.acc"]
    address = browser.current_url
    assert "sort=-1" in address
    browser.get("about:blank")
    browser.get(address)
    assert browser.execute_script(cells.format(1)) == found


def test_a_view_stands_in_the_address_and_in_the_csv(at, shop):
    """Contract: a zoom changes the address, which brings the same view back with finer data; a reset takes it out."""
    browser = at(f"/product/{shop['again']['align'].key}")
    range_ = "Bokeh.documents[0].get_model_by_name('figure').x_range"
    start = browser.execute_script(f"return {range_}.start")
    browser.execute_script(f"{range_}.setv({{start: {start + 1000}, end: {start + 3000}}})")
    wait(browser, lambda one: "from=" in one.current_url)
    assert "from=" in browser.find_element("id", "csv").get_attribute("href")
    drawn = "const d = Bokeh.documents[0].get_model_by_name('line-0').data; "
    x, seconds, *lengths = browser.execute_script(drawn + "return [d.x[5], d.s[5], d.x.length, d.s.length]")
    assert seconds == pytest.approx(x / 1e3 - 946728000.0)  # GPS seconds beside calendar time, under the mouse
    assert lengths[0] == lengths[1] == pytest.approx(23, abs=2)  # the samples themselves
    browser.get(browser.current_url)
    wait(browser, lambda one: one.execute_script(DRAWN) == ["drawn"])
    assert browser.execute_script(f"return {range_}.start") == pytest.approx(start + 1000)
    browser.execute_script("Bokeh.index.find_one(Bokeh.documents[0].roots()[0]).reset()")
    wait(browser, lambda one: not re.search("(from|to|low|high)[.0-9]*=", one.current_url))


@pytest.fixture
def failing(day):
    """Return an event of which one check of two fails, beside a proposed design."""
    event, sigma = "grace-d-2021-05-01", {"x": 1.51, "y": 0.45}
    checks = [{"name": "chi2 of the manoeuvres", "value": 7.25, "limit": 2.0, "unit": "1", "passed": False}]
    checks.append(checks[0] | {"name": "gaps", "value": 1.0, "passed": True})
    document = result(event, [1.0, 2.0, 3.0]) | {"status": "questionable", "checks": checks}
    put(f"{event}/com_offset.report", dataset(10), files={"result.json": json.dumps(document)})
    proposal = {"calibration": "com_offset", "satellite": "C", "date": "2026-03-01"}
    proposal |= {"manoeuvres": [{"count": 5, "kind": "pitch", "rod": "x", "latitude_deg": [70, 80]}]}
    pair = {"causes": ["accelerometer.current_leak", "accelerometer.angular_leak"], "chi2": 43.0, "odds": 0.97}
    new = {"sigma": sigma, "unit": {"x": "um", "y": "um"}, "separated": [pair]}
    proposal |= {"design": new, "published": {"sigma": {"x": 2.25, "y": None}, "separated": [pair | {"odds": 0.31}]}}
    designs = location.folder() / "designs"
    location.write_json(designs / "com_offset-C-2026-02-01.json", proposal)  # as without --verify, or of before
    proposal |= {"verified": {"flights": 12, "sigma": [1.49, 0.45], "error_rms": [1.56, None]}}
    location.write_json(designs / "com_offset-C-2026-03-01.json", proposal | {"noise": {"of": "the catalogue"}})
    return event


def test_a_new_user_finds_by_clicks_alone(at, failing):
    """Contract: each of four questions is answered from the first page with one or two clicks."""
    browser = at("/")
    shown = lambda: browser.find_element("tag name", "main").text  # noqa: E731
    click(browser, EVENT)  # why does yesterday's run differ from that of last month
    because = browser.find_elements("css selector", "td[data-label='because of']")
    assert {one.text for one in because} == {"gain: 9.0 -> 1.5", "gain: 1.0 -> 1.5"}
    click(browser, "findings and limits")  # what did discovery say of an event
    assert "A gain is named." in browser.find_element("css selector", ".verdict").text
    browser = at("/")
    click(browser, "with a check that fails")  # which events fail a check
    (row,) = [one.text for one in browser.find_elements("css selector", "tbody tr") if one.is_displayed()]
    assert "fails: chi2 of the manoeuvres" in row
    click(browser, failing)
    assert "chi2 of the manoeuvres: 7.25, limit 2" in shown()
    assert "gaps" not in shown()
    browser = at("/")
    click(browser, "Designs")  # how can a better session be flown
    rows = "x (um) 2.25 1.51 1.49 1.56", "y (um) not determined 0.45 0.45 not determined", "31 % 97 % 43"
    for said in ("C, 2026-03-01", "achieved in 12 flights", *rows, "count 5, kind pitch, rod x"):
        assert said in shown()


def test_keys_are_shown_on_demand(at):
    """Contract: no hash before it is asked for."""
    one = put(f"{EVENT}/com_offset.field", dataset(9).assign_attrs(igrf="f1" * 32), {"records": "da" * 32})
    own = [one.key, one.digest, "f1" * 32, "da" * 32, "gravcal_key"]
    for path, keys in (("/products", [one.key[:12]]), (f"/product/{one.key}", own)):
        browser = at(path)
        text = browser.find_element("tag name", "main").text
        assert not re.search("[0-9a-f]{12}|sha256", text), path
        browser.find_element("id", "keys").click()
        text = browser.find_element("tag name", "main").text
        assert all(key in text for key in keys), path


def reports(folder):
    """Write a report and a discovery by their templates, each with a wide table, checks and a figure; their paths."""
    check = {"name": "gaps", "value": 1.0, "limit": 2.0, "unit": "1", "passed": True}
    document = result(EVENT, [1.0, 2.0, 3.0]) | {"provenance": {"products": {"com_offset.align": "ab" * 32}}}
    document |= {"configuration": "operational", "settings": {"level": 0.005}, "checks": [check], "limits": [LIMIT]}
    drawn = pages.Figure(lambda: grid(1, 1, 2.0)[0], ("align",), "What was drawn.", ())
    several = pages.Table("Rows of many columns.", [f"column {n}" for n in range(30)], [range(30)], ("align",))
    for name, table in (("report", several), ("discovery", discovery.WORDS.table("limits", document))):
        sections = [pages.Section("One", [table], [drawn], ["Said."], beside=True)]
        page = pages.page(document, sections, {}, heading=name, badges=[("a", True, "b")])
        (folder / f"{name}.html").write_text(page)
    return [folder / "report.html", folder / "discovery.html"]


@pytest.mark.parametrize(("width", "dark"), [(1300, False), (390, True)])
def test_every_page_is_for_screen_readers_and_weak_eyes_too(at, shop, failing, width, dark, tmp_path):  # noqa: ARG001 - more to show
    """Contract: no violation that axe-core finds (contrast, names, roles, headings); figures drawn, a quiet console."""
    for path in (*PAGES, f"/product/{shop['again']['mtq'].key}"):
        browser = at(path, width=width, dark=dark)
        browser.execute_script(SCRIPT)
        assert browser.execute_async_script(AXE) == [], path
        assert set(browser.execute_script(DRAWN)) <= {"drawn"}, path
        assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), path
        assert complaints(browser) == []
    for path in reports(tmp_path):
        browser.get(path.as_uri())  # as the pages show it in a frame, where no script may run
        browser.execute_script(SCRIPT)
        assert browser.execute_async_script(AXE) == [], path.name
        assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), path.name


def test_the_difference_of_two_products_is_drawn(site, shop):
    """Contract: a figure beside another run of the same stage: 1.5 - 1.0 times a sine of x; a quiet console."""
    browser = site(f"/product/{shop['again']['mtq'].key}?with={shop['first']['mtq'].key}&view=difference")
    assert "A: this product" in browser.find_element("tag name", "main").text
    drawn = "return Bokeh.documents[0].get_model_by_name('line-0').data.y"
    largest = max(abs(value) for value in browser.execute_script(f"return Array.from((() => {{{drawn}}})())"))
    assert largest == pytest.approx(0.5, abs=0.01)  # m s-2
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
