"""Serving: a real server of the process itself, a run by the clock and one when data arrive, what their pages show."""

import base64
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.parse
from pathlib import Path

import psutil
import pytest
import requests
from commands import until

from flows import serve
from flows.engine import server
from gravcal.errors import CatalogError
from gravcal.store import location

ROOT = Path(__file__).parents[2]
SCRIPT = Path(__file__).parent / "run_campaign.py"
LIMIT_S = 240.0  # a first start of Prefect on a busy machine
SETTLE_S = 60.0  # the server writes states of tasks down in batches, a second after they came
DELIVERED = {"fake-1": "Delivered"}
EVERYWHERE = "import os, sys\nsys.path[:0] = [os.environ['FAKE_FLOWS'], os.environ['FAKE_CODE']]\n"
#: What an event of the invented calibration tells a joint search: x in um, moved by a trim of 2020-02-06 in the fourth.
TOLD = """
from dataclasses import dataclass, field
import numpy as np
from gravcal.estimation.records import Block, Candidate, Observations

@dataclass(frozen=True)
class Told(Observations):
    blocks: list
    candidates: list
    name: str = "fakecal"
    channels: tuple = ("linear",)
    parameters: tuple = ("x",)
    unit: str = "um"
    scale: np.ndarray = field(default_factory=lambda: np.array([1e6]))
    start: np.ndarray = field(default_factory=lambda: np.zeros(1))

def observe(products):
    number = products["start"]["value"].size - 4
    rng = np.random.default_rng(number)
    column, other = 1e6 * rng.standard_normal((50, 1)), rng.standard_normal((50, 1))
    reading = column[:, 0] * (1e-4 if number < 4 else -1.3e-5) + rng.standard_normal(50)
    zeros = np.zeros(50, dtype=int)
    time = np.full(50, 86400.0 * (7290 + 15 * number))  # the third a week before the trim
    block = Block("one", reading, column, np.zeros((50, 0)), zeros, zeros, time)
    return Told([block], [Candidate("timing.accelerometer_delay", "", ["delay"], ["s"], [other], [0.1])])
"""
SEARCHED = """
@dataclass(frozen=True)
class Watched(Source):
    satellite: str = "C"

def watched(event=None, data=None, satellite=None, date=None):
    return Watched(source(event, data).event, data)

def started(one, chosen):
    file = LevelOneFile(one.folder / "MAG1B_2020-02-01_C_04.txt", None, "MAG1B", "C", "2020-02-01", "04")
    return stages.start(file, event=one.event, variant="", count=chosen.count, offset=0.0)

looked = Discovery(lambda *_: {}, "told", records=started)
CALIBRATION = replace(CALIBRATION, source=watched, trims=True, discovery=looked)
"""
SETTINGS = {"discovery_level": 0.005, "tie_chi2": 9.0, "round_limit": 4, "segment_s": 60.0, "discovery_seed": 1}


@pytest.fixture
def events(fakecal, pipeline):
    """Return a folder with one event."""
    folder = fakecal / "events"
    pipeline.event(folder, 1)
    return folder


@pytest.fixture
def environment(environment, fakecal, prefect_home):
    """Return the environment in which the processes of the runs find the invented calibration."""
    site = fakecal / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(EVERYWHERE)
    known = {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}"}
    return environment | known | {"PREFECT_HOME": str(prefect_home), "PREFECT_RUNNER_POLL_FREQUENCY": "1"}


@pytest.fixture
def _prefect(monkeypatch, prefect_home):
    """Let this process import Prefect with a home that exists; its settings end with the test."""
    monkeypatch.setenv("PREFECT_HOME", str(prefect_home))
    for name, value in server.SETTINGS.items():
        monkeypatch.setenv(name, value)


def begin(environment, events):
    """Start a gravcal that serves: its process and the address of its server."""
    options = ["fakecal", "--watch", str(events), "--every", "0.5", "--workers", "0", "--cron", "30 4 * * *"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    process = subprocess.Popen([sys.executable, str(SCRIPT), "serve", *options], env=environment, **pipes)
    address = process.stdout.readline().split()[1:]
    assert address, process.stderr.read()
    os.environ[server.AUTH] = (Path(environment["PREFECT_HOME"]) / "auth").read_text()
    return process, f"{address[0]}/api"


def end(process, url):
    """End a gravcal that serves, silently and with its server."""
    process.send_signal(signal.SIGTERM)
    try:
        _, errors = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0
    assert errors == ""
    with pytest.raises(OSError, match="refused"):
        server.ask(url, "/health")


@pytest.fixture
def served(environment, events):
    """Return the address of the server of a gravcal that serves, and end it."""
    process, url = begin(environment, events)
    yield url
    end(process, url)


def runs(url, events, kinds):
    """Runs on a folder in such states, newest first; the server knows those of other tests too."""
    question = {"flow_runs": {"state": {"type": {"any_": kinds}}}, "sort": "START_TIME_DESC"}
    found = server.ask(url, "/flow_runs/filter", question)
    return [run for run in found if run["parameters"].get("data") == str(events)]


def finished(url, events, count):
    """Wait for so many runs that ended by themselves; newest first."""
    assert until(lambda: len(runs(url, events, server.ENDED)) >= count, LIMIT_S, 0.3), f"expected {count} runs to end"
    return runs(url, events, server.ENDED)


def states(url, run, expected):
    """Name of the state of each task of a run, once the server knows all that is expected; it records them later."""
    limit, found = time.monotonic() + SETTLE_S, None
    while found != expected and time.monotonic() < limit:
        tasks = server.ask(url, "/task_runs/filter", {"flow_runs": {"id": {"any_": [run["id"]]}}})
        found = {one["name"].rpartition("-")[0]: (one["state"] or {}).get("name") for one in tasks}  # None: not yet
        time.sleep(0.1)
    return found


def artifacts(url, run):
    """Content of the artifacts of a run by key."""
    found = server.ask(url, "/artifacts/filter", {"artifacts": {"flow_run_id": {"any_": [run["id"]]}}})
    return {one["key"]: one["data"] for one in found}


def new_data_and_the_clock_start_campaigns(served, events, store_folder):
    """Contract: what is in the folder is processed, then what arrives, then all on demand; the page says it all.

    The run by the clock also removes from the store what nothing refers to and is older than a month.
    """
    first = finished(served, events, 1)[0]
    assert first["state"]["name"] == "Delivered", first["state"]
    assert states(served, first, DELIVERED) == DELIVERED
    table = json.loads(artifacts(served, first)["fakecal-values"])
    assert [(row["event"], row["status"], row["made"]) for row in table] == [("fake-1", "delivered", 2)]
    (events / "2").mkdir()
    (events / "2" / "SCA1B_2020-02-01_C_04.txt").write_text("not what is wanted")
    second = finished(served, events, 2)[0]
    assert (second["state"]["type"], second["state"]["message"]) == ("FAILED", "delivered: 1, failed: 1")
    both = DELIVERED | {"fake-2": "Failed"}
    assert states(served, second, both) == both
    deployment = server.ask(served, "/deployments/name/reprocess-all/fakecal")
    assert [one["schedule"]["cron"] for one in deployment["schedules"] if one["active"]] == ["30 4 * * *"]
    wanted = {"deployment_id": {"any_": [deployment["id"]]}, "state": {"type": {"any_": ["SCHEDULED"]}}}
    planned = until(lambda: server.ask(served, "/flow_runs/filter", {"flow_runs": wanted}), SETTLE_S)
    assert {one["expected_start_time"][11:19] for one in planned if one["auto_scheduled"]} == {"04:30:00"}
    stale = store_folder / "objects" / "ab" / ("ab" + "0" * 62)
    stale.mkdir(parents=True)
    os.utime(stale, (time.time() - 31 * 86400,) * 2)
    server.ask(served, f"/deployments/{deployment['id']}/create_flow_run", {})
    third = finished(served, events, 3)[0]
    assert third["deployment_id"] == deployment["id"]
    assert not stale.exists()
    assert artifacts(served, third)["store"].startswith("1 entries")
    assert json.loads(artifacts(served, third)["fakecal-values"])[0]["made"] == 0


FOREIGN = "http://evil.example"


def answer(url, path="", method="GET", body=None, **headers):
    """Answer of the server to anybody, whatever its status."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    return requests.request(method, url + path, json=body, headers=named, timeout=30)


def shell(file):
    """Change of a deployment whose runs would execute a command first."""
    return {"pull_steps": [{"prefect.deployments.steps.run_shell_script": {"script": f"touch {file}"}}]}


def strangers_are_refused_and_run_nothing(served, events, tmp_path, prefect_home):
    """Contract: without the string no change and no run; no foreign page, no foreign name, no other machine.

    The string is in files for the user alone, one of which opens Prefect's page; on no command line, in no log.
    """
    finished(served, events, 1)
    deployment = server.ask(served, "/deployments/name/reprocess-all/fakecal")
    path, made = f"/deployments/{deployment['id']}", tmp_path / "made"
    begun = {"flow_runs": {"deployment_id": {"any_": [deployment["id"]]}, "start_time": {"is_null_": False}}}
    before = server.ask(served, "/flow_runs/count", begun)
    wrong = f"Basic {base64.b64encode(b'gravcal:wrong').decode()}"
    for known in ({}, {"Authorization": wrong}, {"Authorization": "Bearer x"}):
        assert answer(served, path, **known).status_code == 401
        assert answer(served, path, "PATCH", shell(made), **known).status_code == 401
        assert answer(served, f"{path}/create_flow_run", "POST", {}, **known).status_code == 401
    asked = {"Access_Control_Request_Method": "PATCH", "Access_Control_Request_Headers": "authorization"}
    foreign, own = (answer(served, path, "OPTIONS", Origin=one, **asked) for one in (FOREIGN, served[:-4]))
    assert (foreign.status_code, foreign.headers.get("access-control-allow-origin")) == (400, None)
    assert (own.status_code, own.headers["access-control-allow-origin"]) == (200, served[:-4])
    port = urllib.parse.urlsplit(served).port
    for url in (f"{served}/health", served[:-3]):
        assert answer(url, Host=f"evil.example:{port}").status_code == 400
        assert answer(url, Host=f"localhost:{port}").status_code == 200
    heard = [one.laddr.ip for one in psutil.net_connections("tcp") if one.status == "LISTEN" and one.laddr.port == port]
    assert heard == ["127.0.0.1"]
    assert server.ask(served, "/flow_runs/count", begun) == before
    assert server.ask(served, path)["pull_steps"] == deployment["pull_steps"]
    assert not made.exists()
    string, page = (prefect_home / "auth").read_text(), prefect_home / "open-fakecal.html"
    assert len(string) > 40
    modes = [path.stat().st_mode & 0o777 for path in (prefect_home, prefect_home / "auth", page)]
    assert modes == [0o700, 0o600, 0o600]
    coded = base64.b64encode(string.encode()).decode()
    assert f"{served[:-4]}/enter#{coded}" in page.read_text()
    assert "localStorage" in answer(served[:-4], "/enter").text
    shown = [" ".join(one.info["cmdline"] or []) for one in psutil.process_iter(["cmdline"])]
    shown += [path.read_text(errors="replace") for path in prefect_home.glob("*.log*")]
    secret = string.partition(":")[2]
    assert not any(secret in text or coded in text for text in shown)


def a_deployment_that_was_changed_is_refused(served, events, tmp_path):
    """Contract: also from who knows the string, only what gravcal registered is run; no command before it."""
    finished(served, events, 1)
    deployment = server.ask(served, "/deployments/name/reprocess-all/fakecal")
    path, made = f"/deployments/{deployment['id']}", tmp_path / "made"
    (tmp_path / "evil.py").write_text(f"import pathlib\npathlib.Path({str(made)!r}).touch()\n")
    asked = [({"parameters": deployment["parameters"] | {"satellite": "D"}}, {}, "parameters of the run")]
    asked += [({}, shell(made) | {"entrypoint": f"{tmp_path}/evil.py:main"}, "entrypoint, pull_steps")]
    asked += [({}, {"parameters": deployment["parameters"] | {"settings": ["gain=9.0"]}}, "parameters")]
    for given, change, said in asked:
        old = {name: deployment[name] for name in change}
        if change:
            server.ask(served, path, change, "PATCH")
        run = f"/flow_runs/{server.ask(served, f'{path}/create_flow_run', given)['id']}"
        until(lambda at=run: server.ask(served, at)["state"]["type"] in server.ENDED, LIMIT_S, 0.3)
        state = server.ask(served, run)["state"]
        assert (state["type"], state["name"]) == ("FAILED", "Refused"), state
        assert f"found {said} changed" in state["message"]
        if change:
            server.ask(served, path, old, "PATCH")
    assert not made.exists()


def a_second_process_does_not_serve_the_same_calibration(served, environment, events):
    """Contract: refused at once, with what to do; the first goes on."""
    command = [sys.executable, str(SCRIPT), "serve", "fakecal", "--watch", str(events)]
    second = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert second.returncode == 1
    assert "another gravcal serve" in " ".join(second.stderr.split())  # lines are as wide as a terminal
    assert server.ask(served, "/health") is True


def test_a_server_runs_what_it_is_to_and_nothing_else(  # one, for its start and its end take 10 s
    served, environment, events, tmp_path, prefect_home, store_folder
):
    """Contract: the four functions above: data and clock, strangers, changed deployments, a second process."""
    new_data_and_the_clock_start_campaigns(served, events, store_folder)
    strangers_are_refused_and_run_nothing(served, events, tmp_path, prefect_home)
    a_deployment_that_was_changed_is_refused(served, events, tmp_path)
    a_second_process_does_not_serve_the_same_calibration(served, environment, events)


@pytest.mark.long
def test_a_note_beside_the_run_says_what_a_new_event_changed(environment, events, pipeline, fakecal):
    """Contract: the joint model is brought up to date after each new event; its page is linked, the trim explains."""
    code = fakecal / "extra" / "fakecal.py"
    imported = "from dataclasses import replace\nfrom flows.calibration import Discovery\n"
    code.write_text(code.read_text() + imported + SEARCHED)
    (code.parent / "told.py").write_text(TOLD)
    parameters = fakecal / "catalog" / "parameters" / "fakecal.toml"
    tables = [f'[{n}]\nvalue = {v}\nstage = "discovery"\nreason = "invented"\n' for n, v in SETTINGS.items()]
    parameters.write_text("\n".join([parameters.read_text(), *tables]))
    for number in (2, 3):
        pipeline.event(events, number)
    process, url = begin(environment, events)
    first = artifacts(url, finished(url, events, 1)[0])["fakecal-joint"]
    pipeline.event(events, 4)
    second = artifacts(url, finished(url, events, 2)[0])["fakecal-joint"]
    end(process, url)
    assert "grace-c: 3 events: no cause that they share." in first
    assert "changed" not in first
    (line,) = [line for line in second.splitlines() if "changed" in line]
    moved = r"- changed: fakecal x moved by −11[23]\.\d+ ± 0\.\d+ um since 2020-01-31: "
    assert re.fullmatch(moved + "trim of 2020-02-06 explains −11[23]", line)
    assert "- [joint.html](http://127.0.0.1:" in second


@pytest.mark.long
def test_a_killed_run_is_seen_running_then_crashed_and_its_links_stay(environment, events, pipeline, store_folder):
    """Contract: the page shows an event at work; after kill -9 of all, the next start marks it and goes on."""
    begun = events.parent / "begun"
    code = f"import pathlib, time; mark = pathlib.Path({str(begun)!r})"
    code += "; first = not mark.exists(); mark.touch(); time.sleep(120 * first)"
    pipeline.replace("first.py", "    values =", f"    {code}\n    values =")
    process, url = begin(environment, events)
    assert until(begun.exists, LIMIT_S)
    (run,) = runs(url, events, ["RUNNING"])
    running = states(url, run, {"fake-1": "Running"})
    ports = [location.recall(f"port-{what}-fakecal") for what in ("pages", "reports")]
    os.killpg(process.pid, signal.SIGKILL)
    for child in prefect_children(events):
        os.kill(child, signal.SIGKILL)
    process.communicate()
    assert running == {"fake-1": "Running"}
    process, url = begin(environment, events)
    assert server.ask(url, f"/flow_runs/{run['id']}")["state"]["name"] == "Crashed"
    crashed = {"fake-1": "Crashed"}
    assert states(url, run, crashed) == crashed
    assert finished(url, events, 2)[0]["state"]["name"] == "Delivered"
    assert [location.recall(f"port-{what}-fakecal") for what in ("pages", "reports")] == ports
    end(process, url)


def prefect_children(events):
    """Processes that still run something on a folder: a run is in a session of its own."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            known = (folder / "environ").read_bytes()
        except OSError:
            continue
        if f"FAKE_FLOWS={events.parent / 'extra'}".encode() in known.split(b"\0"):
            found.append(int(folder.name))
    return found


def test_a_folder_is_new_when_it_changed_and_came_to_rest(tmp_path):
    """Contract: not while a file grows; parts of downloads and other files do not count; an error is tried again."""
    calls, looks = [], []
    file = tmp_path / "MAG1B_2020-02-01_C_04.txt"

    class Ticks:
        def wait(self, _):
            looks.append(1)
            if len(looks) <= 4:
                file.write_text("a" * len(looks))
            (tmp_path / ".gracefo.tgz.part").write_text("b" * len(looks))
            return len(looks) > 9

    def changed():
        calls.append(len(looks))
        if len(calls) == 1:
            raise OSError("no answer")

    serve.watch(tmp_path, 0.0, Ticks(), changed)
    assert calls == [5, 6]


@pytest.mark.usefixtures("_prefect")
def test_what_is_refused_before_a_server_is_started_and_a_port_that_is_taken():
    """Contract: no time of the clock; the wanted port if nobody listens there, otherwise another."""
    nothing = serve.Served("whenever", None, 1.0, None, {"calibration": "fakecal"})
    with pytest.raises(CatalogError, match="whenever"):
        serve.serve(nothing, print)
    with server.listener(0) as door:
        port = door.getsockname()[1]
        with server.listener(port) as other:
            assert other.getsockname()[1] != port
    with server.listener(port) as again, server.listener(123456) as free:
        assert again.getsockname()[1] == port
        assert free.getsockname()[1] < 65536


@pytest.mark.usefixtures("_prefect")
def test_reports_are_served_to_who_has_the_link_and_nothing_else(store_folder):
    """Contract: pages of the store, on this machine, with the token of the link; no lists, nothing outside."""
    page = store_folder / "objects" / "ab" / "key" / "report.html"
    page.parent.mkdir(parents=True)
    page.write_text("<p>said</p>")
    (store_folder / "secret.txt").write_text("no")
    with serve.reports() as address:
        assert requests.get(address.format("ab/key/report.html"), timeout=10).text == "<p>said</p>"
        for path in ("ab/key/", "../secret.txt", "%2e%2e/secret.txt"):
            assert requests.get(address.format(path), timeout=10).status_code == 404
        without = address.format("ab/key/report.html").partition("?")[0]
        for link in (without, f"{without}?token=wrong"):
            assert requests.get(link, timeout=10).status_code == 401
        there = address.format("ab/key/report.html")
        assert requests.get(there, headers={"Host": "evil.example"}, timeout=10).status_code == 421
    with serve.reports() as again:
        assert again.partition("?")[2] == address.partition("?")[2]  # links stay good


@pytest.mark.usefixtures("_prefect")
def test_a_server_that_ends_before_it_answers_is_started_again(monkeypatch):
    """Contract: twice; then the error says how it ended."""
    healthy, started = sys.executable, []

    def child(command, **given):
        started.append(command)
        command = [healthy, *command[1:]] if len(started) > 1 else [healthy, "-c", "raise SystemExit(7)"]
        return popen(command, **given)

    popen = server.subprocess.Popen
    monkeypatch.setattr(server.subprocess, "Popen", child)
    with server.running(server.begin()) as url:
        assert server.ask(url, "/health") is True
    assert len(started) == 2
    for code in (7, 0):
        ending = [healthy, "-c", f"raise SystemExit({code})"]
        monkeypatch.setattr(server.subprocess, "Popen", lambda _, end=ending, **given: popen(end, **given))
        with pytest.raises(server.Unavailable, match=f"ended with code {code}"), server.running(server.begin()):
            pass


@pytest.mark.long
@pytest.mark.usefixtures("_prefect")
def test_the_deployments_run_on_a_server_and_a_work_pool(environment, events, tmp_path, monkeypatch):
    """Contract: prefect.yaml as it is, but for the calibration: deployed offline, run by a worker of a process pool."""
    text = (ROOT / "prefect.yaml").read_text()
    assert text.count("calibration: com_offset") == 1
    (tmp_path / "prefect.yaml").write_text(text.replace("com_offset", "fakecal"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with server.running(server.begin()) as url:
        known = environment | server.SETTINGS | {"GRAVCAL_WATCH": str(events), "PREFECT_API_URL": url}
        known |= {server.AUTH: os.environ[server.AUTH]}
        prefect(tmp_path, known, "work-pool", "create", "gravcal", "--type", "process", "--overwrite")
        prefect(tmp_path, known, "--no-prompt", "deploy", "--all")
        deployed = server.ask(url, "/deployments/name/new-data/fakecal")
        assert [one["schedule"]["interval"] for one in deployed["schedules"]] == [300.0]
        assert server.ask(url, "/deployments/name/reprocess-all/fakecal")["work_pool_name"] == "gravcal"
        server.ask(url, f"/deployments/{deployed['id']}/create_flow_run", {})
        prefect(tmp_path, known, "worker", "start", "--pool", "gravcal", "--run-once")
        (run,) = finished(url, events, 1)
        assert run["state"]["name"] == "Delivered", run["state"]
        assert states(url, run, DELIVERED) == DELIVERED


def prefect(folder, environment, *arguments):
    """Run Prefect's own command line in a folder."""
    command = [sys.executable, "-m", "prefect", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
