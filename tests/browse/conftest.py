"""An invented store for the pages: two runs of an event with a report, another event, a failed run."""

import os

import pytest
from chromium import DRAWN, chromium, missing, wait
from invented_store import EVENT, calibration, client, dataset, put, server

from gravcal.browse import series, store_index
from gravcal.store import history


@pytest.fixture
def shop(store_folder):
    """Return the references of an invented store."""
    store_index._known.clear()
    store_index._json.cache_clear()
    series.series.cache_clear()
    series.read.cache_clear()
    series.listed.cache_clear()
    first = calibration(EVENT, 1.0, gain=1.0)
    again = calibration(EVENT, 1.0, gain=1.5)
    other = calibration("grace-c-2021-03-01", 2.0)
    states = {"com_offset.align": ("reused", again["align"]), "com_offset.report": ("made", again["report"])}
    states |= {f"com_offset.solve.{v}": ("made", again[v]) for v in ("mtq", "acc")}
    record = {"event": EVENT, "flow": "com_offset", "status": "delivered", "started": "2026-01-01T00:00:00+00:00"}
    stages = {name: {"state": state, "key": ref.key} for name, (state, ref) in states.items()}
    history.write_run(record | {"seconds": 1.5, "stages": stages})
    broken = {"event": "grace-d-2022-01-01", "flow": "com_offset", "status": "failed", "error": "no data <b>here</b>"}
    stages = {"com_offset.align": {"state": "made", "key": "0" * 64}}
    put("grace-d-2022-01-01/com_offset.align", dataset(100))
    history.write_run(broken | {"started": "2026-01-02T00:00:00+00:00", "seconds": 1.0, "failed": "com_offset.solve",
                             "stages": stages})  # fmt: skip
    return {"first": first, "again": again, "other": other, "folder": store_folder}


@pytest.fixture
def ask():
    """Return a function that asks a server on loopback without token."""
    with client() as asking:
        yield asking


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Return Chromium; skips where it is missing, unless GRAVCAL_NEEDS_CHROMIUM is set, as .ci/run does."""
    if missing() and os.environ.get("GRAVCAL_NEEDS_CHROMIUM"):
        pytest.fail(missing())
    if missing():
        pytest.skip(missing())
    with chromium(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


@pytest.fixture
def site(shop, browser):
    """Return a function that opens a page, waits for its figures, and gives the browser."""
    with server() as port:

        def open_(path):
            browser.get(f"http://127.0.0.1:{port}{path}")
            wait(browser, lambda one: set(one.execute_script(DRAWN)) <= {"drawn", "failed"})
            return browser

        yield open_
