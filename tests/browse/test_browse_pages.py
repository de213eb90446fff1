"""The pages as a client sees them: content, and what they refuse."""

import contextlib
import http.client
import json
import re
import subprocess
import sys
import urllib.parse
from types import SimpleNamespace

import pytest
from invented_store import EVENT, calibration, client, dataset, experiment, put, result

from flows.calibration import load
from gravcal.browse import app, pages, store_index, timeline
from gravcal.errors import GravcalError
from gravcal.store import history


def test_every_link_of_every_page_leads_somewhere(ask, shop):
    """Contract: following all links from the first page meets no error, and the store stays as it was.

    Of the data and figures of products one of every kind of address is asked for.
    """
    listing = lambda: sorted((path, path.stat().st_mtime_ns) for path in shop["folder"].rglob("*"))  # noqa: E731
    before = listing()
    waiting, known = ["/", "/products?all=1"], set()
    while waiting:
        where = waiting.pop()
        kind = re.sub("[0-9a-f]{64}", "", where) if where.startswith(("/csv/", "/figure/")) else where
        if kind in known or where.startswith("#"):
            continue
        known.add(kind)
        answer = ask(where)
        assert answer.status_code == 200, where
        if answer.headers["content-type"].startswith("text/html"):
            found = re.findall(r'(?:href|src|data-figure)="([^"]+)"', answer.text)
            found = [link.replace("&amp;", "&") for link in found if not link.startswith(("data:", "http"))]
            path = where.partition("?")[0]
            waiting += [path + link if link.startswith("?") else link for link in found]
    assert len(known) > 60
    assert listing() == before


def test_first_page_and_chain_show_every_event_with_what_was_reused_made_and_failed(ask, shop):
    """Contract: delivered and failed events, their verdict or reason, nothing taken for markup; states of the last run.

    A product stands right of all it was made of, no two boxes at one place.
    """
    text = ask("/").text
    for event in (EVENT, "grace-c-2021-03-01", "grace-d-2022-01-01"):
        assert f"/event/{event}" in text
    assert f"Delivered: {EVENT}." in text
    assert "3 made, 1 reused" in text
    assert "failed" in text
    assert "no data &lt;b&gt;here&lt;/b&gt;" in text
    states = {node.stage: node.state for node in store_index.chain(EVENT)}
    assert states["com_offset.align"] == "reused"
    assert states["com_offset.report"] == "made"
    failed = [node for node in store_index.chain("grace-d-2022-01-01") if node.state == "failed"]
    assert [(node.stage, node.key) for node in failed] == [("com_offset.solve", "")]
    assert "box failed" in ask("/event/grace-d-2022-01-01").text
    places = {node.key: (x, y, node) for x, y, node in pages.placed(store_index.chain(EVENT))["boxes"]}
    assert len({(x, y) for x, y, _ in places.values()}) == len(places) == 4
    assert all(places[key][0] < x for x, _, node in places.values() for key in node.inputs)


def test_simulated_events_have_a_mark_and_a_banner_of_their_own(ask, shop):
    """Contract: on the first page, the event's, the product's and over the years, apart from what was measured."""
    event = "grace-c-2022-03-01"
    made = calibration(event, 3.0, origin="simulated")
    assert '<span class="mark simulated">simulated</span>' in ask("/").text
    assert '<span class="mark simulated">1 not measured</span>' in ask("/").text
    for path in (f"/event/{event}", f"/product/{made['align'].key}"):
        assert '<p class="origin">SIMULATED data</p>' in ask(path).text
    assert 'class="origin"' not in ask(f"/event/{EVENT}").text + ask(f"/product/{shop['again']['align'].key}").text
    assert '"diamond"' in ask("/timeline/com_offset/C.json").text
    assert '<span class="mark simulated">simulated</span>' in ask("/timeline/com_offset").text


def test_a_failed_attempt_stands_beside_what_was_delivered(ask, shop):
    """Contract: the event stays delivered on both pages; what failed since is said beside it, and where."""
    attempt = {"event": EVENT, "flow": "com_offset", "status": "failed", "started": "2026-02-01T00:00:00+00:00"}
    attempt |= {"failed": "com_offset.align", "error": "no <files> elsewhere", "seconds": 1.0, "stages": {}}
    history.write_run(attempt)
    assert "a later attempt failed" in ask("/").text
    page = ask(f"/event/{EVENT}").text
    assert "com_offset: delivered" in page
    assert "no &lt;files&gt; elsewhere" in page
    assert [node.stage for node in store_index.chain(EVENT) if node.state == "failed"] == ["com_offset.align"]
    assert {node.state for node in store_index.chain(EVENT)} >= {"reused", "made"}


CLIMBING = (
    "/report/{key}/../../../../secret.txt",
    "/report/{key}/..%2f..%2f..%2f..%2fsecret.txt",
    "/report/{key}/%2e%2e/%2e%2e/secret.txt",
    "/report/{key}/meta.json",
    "/file/{key}/%2fetc%2fpasswd",
    "/file/../../secret.txt",
    "/product/..%2f..%2fsecret",
    "/event/..%2f..%2f..%2fsecret.txt",
    "/static/..%2fapp.py",
    "/static/../app.py",
    "/timeline/..%2f..%2fsecret",
    "/figure/{key}/..%2fmeta.json",
)


def test_no_path_leaves_the_store(ask, shop):
    """Contract: addresses that climb, or name files the record does not list, find nothing."""
    (shop["folder"].parent / "secret.txt").write_text("secret content")
    for path in CLIMBING:
        answer = ask(path.replace("{key}", shop["again"]["report"].key))
        assert (answer.status_code, "secret content" in answer.text) == (404, False), path


def test_a_link_out_of_the_store_is_not_followed(ask, shop, tmp_path):
    """Contract: a product file that is a link to elsewhere is not shown, nor is a report's."""
    (tmp_path / "outside.txt").write_text("outside")
    ref = shop["again"]["report"]
    (ref.folder / "report.html").unlink()
    (ref.folder / "report.html").symlink_to(tmp_path / "outside.txt")
    assert ask(f"/report/{ref.key}/report.html").status_code == 404
    product = shop["again"]["mtq"]
    product.path.rename(tmp_path / "elsewhere.nc")
    product.path.symlink_to(tmp_path / "elsewhere.nc")
    assert ask(f"/product/{product.key}").status_code == 404


HOSTS = {421: ("evil.example", "127.0.0.1.evil.example", "evil.example:8765", "", "localhost.evil"),
         200: ("127.0.0.1", "127.0.0.1:8765", "localhost:1", "[::1]:8765", "[::1]")}  # fmt: skip


def test_only_names_of_this_machine_are_answered(ask, shop):
    """Contract: loopback by any of its names; a foreign one that leads here (DNS rebinding) gets no answer."""
    for host, status in ((one, status) for status, hosts in HOSTS.items() for one in hosts):
        answer = ask("/", host=host)
        assert (answer.status_code, EVENT in answer.text) == (status, status == 200), host


def test_without_the_token_nothing_is_shown(shop):
    """Contract: away from loopback every page asks for the token; it moves from the address into a cookie."""
    with client("right", ("*",)) as ask:
        for path in ("/", "/products", "/static/browse.js", "/?token=wrong", f"/product/{shop['again']['mtq'].key}"):
            assert ask(path).status_code == 401
        moved = ask("//evil.example/products?all=1&token=right", host="machine.example")
        assert (moved.status_code, moved.headers["location"]) == (303, "/evil.example/products?all=1")
        assert {"HttpOnly", "SameSite=strict"} <= set(moved.headers["set-cookie"].split("; "))
        assert ask("/products", cookie=moved.headers["set-cookie"].partition(";")[0]).status_code == 200
        cookie = moved.headers["set-cookie"].partition("=")[0]
        assert ask("/products", cookie=f"{cookie}=wrong").status_code == 401


def test_answers_forbid_scripts_of_others_and_any_change(ask, shop):
    """Contract: only our own scripts run; reports run none; no method but GET and HEAD."""
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS"):
        assert ask("/", method).status_code == 405
    assert "script-src 'self';" in ask("/").headers["content-security-policy"]
    report = ask(f"/report/{shop['again']['report'].key}/report.html")
    assert "sandbox" in report.headers["content-security-policy"]
    assert "script-src" not in report.headers["content-security-policy"]
    assert ask("/").headers["x-content-type-options"] == "nosniff"


NO_VIEW = {
    400: [f"/data/{{key}}/acceleration_b?{asked}" for asked in ("from=a&to=1", "from=nan&to=1", "from=1", "")],
    404: [f"/product/{'0' * 64}", "/figure/{key}/nothing", "/figure/{key}/factor"],
    200: ["/figure/{key}/acceleration_b?column=99&with=nothing&view=nothing", "/product/{key}?variable=factor"],
}


def test_what_is_not_there_and_no_view_is_said(ask, shop):
    """Contract: unknown products, variables and columns; places that are no numbers are wrong usage, not a failure."""
    for status, path in ((status, path) for status, paths in NO_VIEW.items() for path in paths):
        assert ask(path.replace("{key}", shop["again"]["mtq"].key)).status_code == status, path


def test_on_loopback_only_names_of_this_machine_are_answered_to(monkeypatch):
    """Contract: the address that is listened on decides; elsewhere the machine may have other names."""
    answered = []
    monkeypatch.setattr(app, "application", lambda _calibrations, _token, hosts: answered.append(hosts))
    monkeypatch.setattr(app.uvicorn, "Server", lambda _: SimpleNamespace(run=lambda sockets: sockets[0].close()))
    for host in ("127.0.0.1", "localhost", "127.8.9.1", "0.0.0.0"):
        app.serve({}, app.bound(host, 0), host, print)
    assert answered == [(*app.LOCAL, host) for host in ("127.0.0.1", "localhost", "127.8.9.1")] + [("*",)]


def test_printed_values_come_in_our_units():
    """Published: Table 7 of 10.3390/rs14143395 prints 1443.7 mm, -370.6 um, 145.0 um for C on 2020-09-17.

    Offset, scale factors and bias of Taiji-1, a factor not calibrated in orbit from ground; orders of the drag,
    1e-13 m s-2 with two sensors and with one, are levels.
    """
    points = timeline.printed_points(load("kbr_phase_centre"), "C")
    assert [round(point.value, 6) for point in points] == [1443.7, -0.3706, 0.145]  # mm
    assert {point.date.date().isoformat() for point in points} == {"2020-09-17"}
    assert timeline.printed_points(load("kbr_phase_centre"), "Z") == []
    found = {point.panel: point for point in timeline.printed_points(load("inertial_sensor"), "T")}
    assert [found[f"offset {axis}"].value for axis in "xyz"] == [-140.02, 627.75, -896.46]  # um
    assert (found["k x"].value, found["k x"].sigma) == (5.43e-4, 3.73e-6)  # m s-2 V-1
    assert (found["k y"].value, found["k y"].sigma, found["k y"].said[:9]) == (2.7e-4, None, "on ground")
    assert found["bias z"].value == 2.9887e-6  # m s-2
    assert found["bias z"].date.isoformat() == "2022-08-01T00:00:00"
    orders = {panel: value for panel, (value, _) in timeline.levels(load("gradient_torque")).items()}
    assert orders == dict.fromkeys(("two sensor sigma", "one sensor sigma", "one sensor published sigma"), 1e-13)
    assert timeline.levels(load("com_offset")) == {}
    assert timeline.printed_points(load("gradient_torque"), "S") == []


def test_the_time_line_shows_value_error_and_verdict(ask, shop):
    """Contract: the adopted offset with its total error at the date of its first manoeuvre.

    A questionable result has a mark of its own: in the list of events by its state, over time by its mark and in words.
    """
    points = [point for point in timeline.points(load("com_offset")) if point.event == EVENT]
    values = [(point.panel, point.value, point.sigma) for point in points]
    assert values == [("x", 10.0, 8.0), ("y", 0.0, 9.0), ("z", -5.0, 1.0)]  # um
    assert {(point.mood, point.date.date().isoformat()) for point in points} == {("good", "2020-02-26")}
    assert ask("/timeline/com_offset/C.json").status_code == 200
    assert ask("/timeline/com_offset/D.json").status_code == 404
    event = "grace-d-2021-05-01"
    document = result(event, [1.0, 2.0, 3.0]) | {"status": "questionable"}
    files = {"result.json": json.dumps(document), "report.html": "<p>page</p>"}
    put(f"{event}/com_offset.report", dataset(10), files=files)
    assert {point.mood for point in timeline.points(load("com_offset")) if point.event == event} == {"questionable"}
    assert "questionable</span>" in ask("/timeline/com_offset").text


def started(*options):
    """Process of `gravcal browse` and the address that it prints."""
    program = (sys.executable, "-c", "from flows.cli import main; main()", "browse", *options)
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return process, process.stdout.readline().strip()


@pytest.mark.parametrize("options", [(), ("--host", "0.0.0.0")])
def test_the_command_prints_an_address_that_answers(shop, options):
    """Contract: with the token printed, on loopback too, where other users can ask; the cookie has the port."""
    process, address = started("--port", "0", *options)
    try:
        parts = urllib.parse.urlsplit(address)
        line = http.client.HTTPConnection("127.0.0.1", parts.port, timeout=30)
        for path, cookie, status in (("/", None, 401), (f"/?{parts.query}", f"gravcal_token_{parts.port}=", 303)):
            line.request("GET", path)
            answer = line.getresponse()
            answer.read()
            assert answer.status == status
            assert (answer.headers["set-cookie"] or "").startswith(cookie or "")
        line.close()
    finally:
        process.terminate()
        process.communicate(timeout=30)


def test_a_port_in_use_is_an_error_with_a_remedy():
    """Contract: one line that says what to do."""
    with contextlib.closing(app.bound("127.0.0.1", 0)) as taken, pytest.raises(GravcalError, match="another --port"):
        app.bound("127.0.0.1", taken.getsockname()[1])


def test_a_product_is_compared_with_its_successor_and_drawn_along_its_samples(shop, ask):
    """Contract: other variants are siblings, a newer product is a relative with its setting; without gaps: samples."""
    old = store_index.entry(shop["first"]["mtq"].key)
    assert [one.ref.variant for one in store_index.siblings(old)] == ["acc"]
    newer = [why for one, why in store_index.relatives(old) if one.ref.key == shop["again"]["mtq"].key]
    assert newer == [["gain: 1.5 -> 1.0"]]
    assert "number of the sample" in ask(f"/figure/{shop['first']['align'].key}/acceleration_b?even=1").text


def test_an_experiment_is_shown_as_such_beside_the_operational_result(shop, ask):
    """Contract: home, event and time line are operational; the experiment has a page, a mark and its own chain."""
    own = experiment("gain-9", 3.0, gain=9.0)
    row = next(row for row in store_index.results() if row["event"] == EVENT)
    assert row["report"].ref.key == shop["again"]["report"].key
    assert row["run"]["configuration"] == "operational"
    assert row["experiments"] == ["gain-9"]
    assert {point.value for point in timeline.points(load("com_offset")) if point.event == EVENT} == {10.0, 0.0, -5.0}
    (tried,) = (row for row in store_index.results("gain-9") if row["event"] == EVENT)
    assert tried["report"].ref.key == own["report"].key
    assert f'href="/event/{EVENT}?as=gain-9"' in ask("/").text
    page = ask(f"/event/{EVENT}").text
    assert "Experiment gain-9" not in page
    assert own["report"].key[:12] not in page.split("<h2>Chain of stages")[1]
    page = ask(f"/event/{EVENT}?as=gain-9").text
    assert "Experiment gain-9: not the operational configuration" in page
    assert own["report"].key[:12] in page.split("<h2>Chain of stages")[1]
    assert ask(f"/event/{EVENT}?as=nothing").status_code == 404
