"""Campaigns: failures are tabulated, killed workers replaced, kill -9 at any moment leaves the same products."""

import contextlib
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pytest
from commands import gravcal, until

from flows import calibration, command
from flows import campaign as campaigns
from gravcal.store import housekeeping, keys

SCRIPT = Path(__file__).parent / "run_campaign.py"


@pytest.fixture
def events(fakecal, pipeline):
    """Return a folder with one folder of Level-1 files per event."""
    folder = fakecal / "events"
    for number in range(1, 5):
        pipeline.event(folder, number)
    return folder


def campaign(environment, events, *options):
    """Run a campaign in a process of its own: exit code and summary."""
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--json", "-", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


def here(events, *options):
    """Run a campaign in this process, as a new one would: exit code and summary."""
    sys.modules.pop("fakecal", None)
    calibration.load.cache_clear()
    path = events.parent / "summary.json"
    words = ("campaign", "fakecal", "--data", events, "--engine", "inline", "--workers", 0, "--json", path)
    return gravcal(*words, *options), json.loads(path.read_text())


def products():
    """Bytes of every product of the store by key."""
    return {
        folder.name: hashlib.sha256((folder / "product.nc").read_bytes()).hexdigest()
        for folder in housekeeping.folders()
    }


def test_a_campaign_says_and_makes_again_what_other_versions_made(events, monkeypatch):
    """Contract: rows name them; with the setting all are made again, and there is nothing to say."""
    versions = keys.versions()
    with monkeypatch.context() as patched:
        patched.setattr(keys, "versions", lambda: versions | {"scipy": "0.1"})
        here(events)
    said = [f"made by scipy 0.1, here {versions['scipy']}"] * 2
    for setting, made, named in (("", 0, said), ("1", 2, None)):
        monkeypatch.setenv("GRAVCAL_REMAKE_VERSIONS", setting)
        _, summary = here(events)
        assert [(row["made"], row.get("other_versions")) for row in summary["events"]] == 4 * [(made, named)]


def test_a_killed_worker_is_replaced_and_nothing_is_left_to_do(environment, events, pipeline, tmp_path):
    """Contract: worker processes make the products, after kill -9 of one, too; a second campaign starts no cluster."""
    mark = tmp_path / "killed"
    lines = f"    import os, pathlib\n    mark = pathlib.Path({str(mark)!r})\n    if count == 6 and not mark.exists():"
    lines += "\n        mark.write_text('')\n        os.kill(os.getpid(), 9)\n    values ="
    pipeline.replace("first.py", "    values =", lines)
    code, summary = campaign(environment, events, "--engine", "inline")
    assert mark.exists()
    assert (code, summary["counts"]) == (0, {"delivered": 4})
    assert [row["event"] for row in summary["events"]] == [f"fake-{number}" for number in range(1, 5)]
    assert [row["made"] for row in summary["events"] if row["event"] != "fake-2"] == [2, 2, 2]
    code, summary = campaign(environment, events)
    assert (code, [(row["made"], row["reused"]) for row in summary["events"]]) == (0, [(0, 2)] * 4)


def test_the_files_of_a_new_event_are_left_to_its_worker(events, monkeypatch):
    """Contract: the process that hands out events reads no file of one that was never made."""
    read, digest = [], keys.digest_of
    monkeypatch.setattr(keys, "digest_of", lambda item: read.append(item.path) or digest(item))
    source, chosen = command.many_sources("fakecal", None, events)[0], command.chosen("fakecal", None)
    how = campaigns.Campaign("fakecal", chosen)
    assert campaigns.answered(how, source) is None
    assert read == []
    command.record("fakecal").flow(source, chosen)
    assert campaigns.answered(how, source)["status"] == "delivered"
    assert read


def test_workers_serve_nobody_else_and_are_gone_with_their_cluster(environment):
    """Contract: Dask executes what it is sent, so who has not the keys of a campaign is refused; so is no address."""
    how = campaigns.Campaign("fakecal", None, scheduler="nowhere")
    with pytest.raises(campaigns.GravcalError, match="--scheduler nowhere"), campaigns.cluster(how, 1):
        pass
    command = [sys.executable, str(SCRIPT), "strangers"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stderr == ""
    said, pids = json.loads(done.stdout)
    assert said == [8, "refused", "refused"]
    assert len(pids) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_an_interrupt_ends_a_campaign_at_once(environment, events, pipeline, tmp_path):
    """Contract: Ctrl-C does not wait for the events that are being computed; what was made stays valid."""
    mark = tmp_path / "begun"
    lines = f"    import pathlib, time\n    pathlib.Path({str(mark)!r}).touch()\n    time.sleep(60)\n    values ="
    pipeline.replace("first.py", "    values =", lines)
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--engine", "inline"]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert until(mark.exists, 60)
    process.send_signal(signal.SIGINT)
    started = time.monotonic()
    process.communicate()
    assert time.monotonic() - started < 30
    assert process.returncode != 0
    assert housekeeping.verify() == []


@pytest.mark.long
def test_a_campaign_is_one_prefect_flow_with_a_task_per_event(environment, events, pipeline, prefect_home):
    """Contract: silent, and the failed event does not stop the flow."""
    (events / "3" / pipeline.raw.name).unlink()
    (events / "3" / "SCA1B_2020-02-01_C_04.txt").write_text("aaa")
    code, summary = campaign(environment | {"PREFECT_HOME": str(prefect_home)}, events, "--workers", "2")
    assert code == 1
    assert summary["counts"] == {"delivered": 3, "failed": 1}


@pytest.mark.long
def test_a_hundred_kills_leave_the_same_products(environment, events, store_folder, monkeypatch):
    """Contract: kill -9 at 100 random moments of campaigns; the next run ends with the same products, byte for byte."""
    kill = [sys.executable, str(SCRIPT), "kill", "100", "0.3", "campaign", "fakecal", "--data", str(events)]
    kill += ["--engine", "inline", "--workers", "0"]
    said = subprocess.run(kill, capture_output=True, text=True, check=True, env=environment).stdout
    killed, ended = map(int, said.split())
    assert killed == 100
    monkeypatch.setenv("GRAVCAL_PRODUCTS", f"{store_folder}-reference")
    assert here(events)[0] == 0
    expected = products()
    assert len(expected) == 8
    for store in [store_folder, *(Path(f"{store_folder}+{number}") for number in range(1, ended + 1))]:
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(store))
        assert housekeeping.verify() == []
        assert here(events)[0] == 0
        assert products() == expected


def test_what_failed_costs_a_re_run_no_cluster_start(environment, events, pipeline, tmp_path):
    """Contract: answered from its record while inputs, settings and code are the same; --only-failed tries again."""
    pipeline.replace("first.py", "    values =", "    assert count != 6, 'six'\n    values =")
    (events / "3" / pipeline.raw.name).unlink()
    (events / "3" / "SCA1B_2020-02-01_C_04.txt").write_text("aaa")
    code, first = campaign(environment, events, "--engine", "inline", "--workers", "0")
    assert (code, first["counts"]) == (1, {"delivered": 2, "failed": 2})
    absent = tmp_path / "absent"
    for name in ("prefect", "distributed"):
        (absent / name).mkdir(parents=True)
        (absent / name / "__init__.py").write_text("raise ImportError('not to be imported')")
    without = environment | {
        "PYTHONPATH": f"{absent}:{SCRIPT.parents[2]}",
        "GRAVCAL_PRODUCTS": os.environ["GRAVCAL_PRODUCTS"],
    }
    code, again = campaign(without, events, "--workers", "2")
    assert (code, again["counts"]) == (1, first["counts"])
    states = [[(row["event"], row["status"]) for row in one["events"]] for one in (first, again)]
    assert states[0] == states[1]
    assert "AssertionError: six" in again["events"][1]["error"]
    assert again["events"][1]["since"]
    assert "cannot be read" in again["events"][2]["error"]
    code, tried = here(events, "--only-failed")
    assert code == 1
    assert [(row["event"], "since" in row) for row in tried["events"]] == [("fake-2", False), ("fake-3", False)]
    _, other = here(events, "--set", "count=6")  # no failure of these settings
    assert [row["status"] for row in other["events"]] == ["delivered", "delivered", "failed", "delivered"]
    assert other["configuration"] == "count-6"
    pipeline.replace("first.py", "count != 6", "count != 66")
    (events / "3" / pipeline.raw.name).write_text("aaa")
    code, mended = here(events)
    assert (code, mended["counts"]) == (0, {"delivered": 4})
    code, nothing = here(events, "--only-failed")
    assert (code, nothing["events"]) == (0, [])


@pytest.mark.parametrize(
    ("given", "status", "code"),
    [
        (("delivered", "no_data"), "delivered", 0),
        (("no_data", "no_data"), "no_data", 0),
        (("no_manoeuvre", "no_data"), "no_manoeuvre", 0),
        (("delivered", "questionable", "no_data"), "questionable", 4),
        (("questionable", "failed", "delivered"), "failed", 1),
        ((), "no_data", 0),
    ],
)
def test_the_exit_code_of_a_campaign(fakecal, monkeypatch, given, status, code):
    """Contract: 0 if nothing failed, 4 if some are questionable, 1 if some failed."""
    rows = [{"event": str(number), "status": one} for number, one in enumerate(given)]
    monkeypatch.setattr(campaigns, "answered", lambda _, source: rows[source])
    told = campaigns.Campaign("fakecal", command.chosen("fakecal", None), "inline", None, 0)
    summary = campaigns.run(told, list(range(len(given))))
    assert (summary["status"], campaigns.exit_code(summary)) == (status, code)


def test_events_without_files_are_no_data_and_no_failure(tmp_path, monkeypatch):
    """Contract: events of the catalogue; also those without a date; a folder that is not there is an error."""
    monkeypatch.setenv("GRAVCAL_DATA", str(tmp_path / "data"))
    chosen = campaigns.Campaign("kbr_phase_centre", command.chosen("kbr_phase_centre", None), "inline", None, 0)
    sources = command.many_sources("kbr_phase_centre", None, None)
    assert len(sources) > 4
    assert {source.status for source in sources if source.error.startswith("GRAVCAL_DATA")} == {"failed"}
    (tmp_path / "data").mkdir()
    summary = campaigns.run(chosen, command.many_sources("kbr_phase_centre", None, None))
    assert summary["counts"] == {"no_data": len(sources)}
    assert campaigns.exit_code(summary) == 0
    (tmp_path / "data" / "GNV1B_2020-09-17_C_04.txt").write_text("")
    summary = campaigns.run(chosen, command.many_sources("kbr_phase_centre", None, None))
    assert summary["counts"] == {"no_data": len(sources) - 1, "failed": 1}
    (failed,) = (row for row in summary["events"] if row["status"] == "failed")
    assert "found no KBR1B or LRI1B" in failed["error"]


def test_an_event_whose_worker_died_is_tried_again_with_what_failed(fakecal, monkeypatch):
    """Contract: its row says how, and --only-failed knows it."""
    died = mock.Mock()
    died.submit.return_value.result.side_effect = RuntimeError("worker lost")
    monkeypatch.setattr(campaigns, "cluster", lambda *_: contextlib.nullcontext(died))
    how = campaigns.Campaign("fakecal", command.chosen("fakecal", None), "inline", workers=1)
    sources = [calibration.load("fakecal").source(event=None, data=fakecal, satellite=None, date=None)]
    assert [row["error"] for row in campaigns.run(how, sources)["events"]] == ["RuntimeError: worker lost"]
    assert campaigns.failed_last(how, sources) == sources


def test_of_many_events_several_are_one_task(monkeypatch):
    """Contract: so many tasks at most, every event once, a task fails with the names of what failed in it."""
    import prefect

    states = {}

    def task(body, name, **_):
        def submit():
            states[name] = body()
            return SimpleNamespace(wait=lambda: None)

        return SimpleNamespace(submit=submit)

    def row_of(number):
        if number == 4:
            return {"event": "4", "status": "failed", "error": "lost"}
        return {"event": str(number), "status": "delivered", "made": 2, "reused": 1, "seconds": 0.5}

    monkeypatch.setattr(prefect, "task", task)
    monkeypatch.setattr(campaigns, "TASKS", 3)
    waiting = {number: SimpleNamespace(event=str(number)) for number in range(7)}
    campaigns.as_tasks(waiting, row_of)
    assert [(name, state.name, state.message) for name, state in states.items()] == [
        ("0 to 2", "Completed", "3 Delivered; 6 products made, 3 reused, 1.500 s"),
        ("3 to 5", "Failed", "4: lost"),
        ("6", "Delivered", "2 products made, 1 reused, 0.500 s"),
    ]
    campaigns.as_tasks({}, row_of)
    assert len(states) == 3


def paths():
    """Where the project and its libraries are, for an interpreter with a standard library of its own."""
    return os.pathsep.join(one for one in sys.path if one and not one.startswith(sys.base_prefix))


def shared_python():
    """An interpreter of this version that other users of the machine can run with these libraries, or None."""
    for path in (sys.executable, f"/usr/bin/python3.{sys.version_info.minor}"):
        if os.getuid() == 0 and Path(path).exists():
            own = {"PYTHONPATH": paths(), "PATH": os.environ["PATH"]}
            probe = [path, "-c", "import gravcal, flows.campaign, distributed"]
            with contextlib.suppress(OSError):
                if not subprocess.run(probe, env=own, cwd="/", capture_output=True, check=False, **user(0)).returncode:
                    return path
    return None


def user(number):
    """Arguments of a process of another user, all of one group and with rights for it; the umask alone for None."""
    own = {} if number is None else {"user": 61000 + number, "group": 61000, "extra_groups": []}
    return own | {"umask": 0o002}


@pytest.fixture
def public(environment, events, tmp_path):  # noqa: ARG001 - events are to be copied
    """Return a copy of the invented calibration where every user may read, its environment, and a store for a group."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "public"
        shutil.copytree(tmp_path, place, symlinks=True)
        subprocess.run(["chmod", "-R", "a+rX", folder], check=True)
        store = Path(folder) / "store"
        store.mkdir()
        known = {name: value.replace(str(tmp_path), str(place)) for name, value in environment.items()}
        yield place, known | {"GRAVCAL_PRODUCTS": str(store)}


def test_a_cluster_by_hand(public, events, tmp_path, monkeypatch):
    """Contract: the recipe of docs/scale.md: TLS with one's own keys, workers in folders and homes of their own.

    Where this is the superuser and others can run an interpreter, each is of a user of its own, the store of a group.
    """
    place, known = public
    python = shared_python()
    users = [None, 1, 2] if python else 3 * [None]
    store, address, running = Path(known["GRAVCAL_PRODUCTS"]), place / "scheduler.json", []
    if python:
        os.chown(store, 0, 61000)
        store.chmod(0o2775)
    key, cert = tmp_path / "dask.key", tmp_path / "dask.pem"
    made = ["openssl", "req", "-x509", "-newkey", "rsa:3072", "-nodes", "-days", "2", "-subj", "/CN=gravcal"]
    subprocess.run([*made, "-keyout", str(key), "-out", str(cert)], check=True, capture_output=True)
    known |= {"DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "true"}
    known |= {"PYTHONPATH": paths().replace(str(tmp_path), str(place))}
    roles = {
        "scheduler": ["scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", "0"],
        "one": ["worker", "--nthreads", "1", "--no-nanny"],
        "two": ["worker", "--nthreads", "1", "--no-nanny"],
    }
    before = os.umask(0o002)
    try:
        for (name, role), number in zip(roles.items(), users, strict=True):
            folder = place / name
            folder.mkdir()
            own = known | {"HOME": str(folder), "DASK_TEMPORARY_DIRECTORY": str(folder)} | keys_in(folder, key, cert)
            if number:
                for path in (folder, *folder.iterdir()):
                    os.chown(path, 61000 + number, 61000)
            command = [python or sys.executable, "-m", "dask", *role, "--no-dashboard", "--scheduler-file", address]
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            running.append(subprocess.Popen(map(str, command), cwd=folder, env=own, **quiet, **user(number)))
            until(lambda: address.exists() or running[0].poll() is not None, 60)
        url = json.loads(address.read_text())["address"]
        assert url.startswith("tls://")
        (place / "own").mkdir()
        monkeypatch.setattr(sys, "executable", python or sys.executable)
        here = place / events.relative_to(tmp_path)
        trusted = known | keys_in(place / "own", key, cert)
        code, summary = campaign(trusted, here, "--engine", "inline", "--scheduler", url)
        assert [process.poll() for process in running] == [None] * 3  # a cluster that was there lives on
    finally:
        os.umask(before)
        for process in reversed(running):
            process.terminate()
            process.wait()
    assert (code, summary["counts"]) == (0, {"delivered": 4}), summary["events"]
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(store))
    assert housekeeping.verify() == []
    if python:
        assert {(folder / "product.nc").stat().st_uid for folder in housekeeping.folders()} <= {61001, 61002}


def keys_in(folder, key, cert):
    """Copy key and certificate to a folder, for its owner alone; the environment in which Dask finds them."""
    for path in (key, cert):
        shutil.copy(path, folder)
    (folder / key.name).chmod(0o600)
    roles = {f"{role}__{part}": folder / path.name for role in ("SCHEDULER", "WORKER", "CLIENT") for part, path in
             (("KEY", key), ("CERT", cert))} | {"CA_FILE": folder / cert.name}  # fmt: skip
    return {f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(file) for name, file in roles.items()}
