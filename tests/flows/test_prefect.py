"""Prefect: an embedded server, tasks as thin shells, nothing started when nothing has to be made."""

import os
import subprocess
import sys
from pathlib import Path

import numpy  # noqa: F401 - loads BLAS
from commands import until

from flows import engine
from flows.engine import server

RUNNER = """
import importlib, json, os, platform, sys, urllib.request
sys.path.insert(0, sys.argv[1])
from flows import engine
from flows.engine import server
from gravcal.io.archive import LevelOneFile
from pathlib import Path
states, seen, plan = {}, [], []
drain = server.drain
def watch(url, run, expected):
    drain(url, run, expected)
    found = server.ask(url, "/task_runs/filter", {"flow_runs": {"id": {"any_": [str(run)]}}})
    states.update({one["name"].rpartition("-")[0]: one["state"]["name"] for one in found})
    seen.append(server.ask(url, f"/flow_runs/{run}")["tags"])
    assert seen[-1] == [f"{server.OWN}{platform.node()}-{os.getpid()}"]
    assert not any(one["tags"] for one in found)
    wanted = {"artifacts": {"flow_run_id": {"any_": [str(run)]}}}
    table = server.ask(url, "/artifacts/filter", wanted)[0]["data"]
    plan.extend(row["action"] for row in json.loads(table))
server.drain = watch
chosen = {"event": "fake-1", "count": 4, "offset": 0.0, "gain_one": float(sys.argv[4]), "gain_other": 3.0}
flow = importlib.import_module(sys.argv[2] + ".flow")
file = LevelOneFile(Path(sys.argv[3]), None, "MAG1B", "C", "2020-02-01", "04")
ref = engine.run(flow.calibrate, file, chosen, engine="prefect")
print(json.dumps({"key": ref.key, "states": states, "prefect": "prefect" in sys.modules, "runs": len(seen), "plan":
plan}))
"""


def run(pipeline, prefect_home, gain=1.0):
    """Run the pipeline through Prefect in a process of its own."""
    import json

    command = [sys.executable, "-c", RUNNER, str(pipeline.folder.parent), pipeline.name, str(pipeline.raw), str(gain)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT")}
    environment |= {"PREFECT_HOME": str(prefect_home)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_stages_are_tasks_and_products_there_end_as_cached(pipeline, prefect_home):
    """Contract: silent; a second run starts nothing; after a changed setting what is reused shows as Cached."""
    first = run(pipeline, prefect_home)
    assert first["runs"] == 1
    assert set(first["states"].values()) == {"Completed"}
    assert len(first["states"]) == 4
    again = run(pipeline, prefect_home)
    assert again["key"] == first["key"]
    assert not again["prefect"]
    changed = run(pipeline, prefect_home, 5.0)
    assert changed["plan"] == ["reuse", "run", "reuse", "may run"]
    names = {name.removeprefix(f"{pipeline.name}."): state for name, state in changed["states"].items()}
    assert names == {"start": "Cached", "scale.one": "Completed", "scale.other": "Cached", "join": "Completed"}


def test_the_server_dies_with_its_parent(prefect_home, monkeypatch):
    """Contract: kill -9 of gravcal leaves no server behind."""
    code = (
        "from flows.engine import server as p; import time;"
        "s = p.begin(); print(s.child.pid, flush=True); p._wait_for(s); print('up', flush=True); time.sleep(60)"
    )
    environment = os.environ | {"PREFECT_HOME": str(prefect_home)}
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
    child = int(parent.stdout.readline())
    assert parent.stdout.readline() == "up\n"
    parent.kill()
    parent.wait()
    parent.stdout.close()
    there, state = Path(f"/proc/{child}"), Path(f"/proc/{child}/stat")
    assert until(lambda: not there.exists() or "Z" in state.read_text().split()[2], 20)


def test_without_a_server_the_flow_runs_inline(pipeline, monkeypatch, capsys):
    """Contract: one line says so, the result is the same."""

    def refuse():
        raise server.Unavailable("port taken")

    monkeypatch.setattr(server, "begin", refuse)
    assert engine.run(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen).path.exists()
    assert capsys.readouterr().err.count("\n") == 1


def test_runs_of_killed_processes_are_marked_as_crashed(monkeypatch):
    """Contract: only those of this machine whose process is gone."""
    import platform

    here = f"{server.OWN}{platform.node()}-"
    tags = {"gone": f"{here}99999999", "alive": f"{here}{os.getpid()}", "foreign": f"{server.OWN}other-99999999"}
    asked = []

    def answer(url, path, question=None):
        asked.append(path)
        runs = [{"id": name, "tags": [tag]} for name, tag in tags.items()]
        return {"/flow_runs/filter": runs, "/task_runs/filter": [{"id": "task"}]}.get(path)

    monkeypatch.setattr(server, "ask", answer)
    server.bury("http://nowhere")
    marked = ["/task_runs/filter", "/task_runs/task/set_state", "/flow_runs/gone/set_state"]
    assert asked == ["/flow_runs/filter", *marked]


def test_a_first_serve_is_silent(tmp_path):
    """Contract: no warning of Prefect's where the store is still to be made."""
    settings = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT")}
    settings |= {"GRAVCAL_PRODUCTS": str(tmp_path / "deep" / "store")}
    line = "from flows.serve import server; server.set_environment(); import prefect.client.schemas.schedules as s; "
    line += "s.CronSchedule(cron='0 3 * * *', timezone='UTC')"
    done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, check=False, env=settings)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_log_of_the_server_is_begun_anew(tmp_path, monkeypatch):
    """Contract: what is too long is kept once, and the next server writes a new one."""
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    for text in ("first", "second"):
        (tmp_path / "server.log").write_text(text + "x" * server.LOG_LIMIT)
        server._log().write_text("last")
    assert {path.name: path.read_text()[:6] for path in tmp_path.iterdir()} == {
        "server.log": "last",
        "server.log.1": "second",
    }
