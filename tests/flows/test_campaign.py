"""Campaigns: failures are tabulated, killed workers replaced, kill -9 at any moment leaves the same products."""

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flows import campaign as campaigns
from flows import campaign_work, command
from gravcal.data import housekeeping, inputs

SCRIPT = Path(__file__).parent / "run_campaign.py"


@pytest.fixture
def events(fakecal, pipeline):
    """Return a folder with one folder of Level-1 files per event."""
    folder = fakecal / "events"
    for number in range(1, 5):
        (folder / str(number)).mkdir(parents=True)
        (folder / str(number) / pipeline.raw.name).write_text("a" * number)
    return folder


@pytest.fixture
def environment(fakecal, pipeline):
    """Return the environment in which other processes find the invented calibration."""
    known = {"FAKE_CODE": str(pipeline.folder.parent), "FAKE_FLOWS": str(fakecal / "extra")}
    return {name: value for name, value in os.environ.items() if not name.startswith("PREFECT")} | known


def campaign(environment, events, *options):
    """Run a campaign in a process of its own: exit code and summary."""
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--json", "-", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)


def products():
    """Bytes of every product of the store by key."""
    return {
        folder.name: hashlib.sha256((folder / "product.nc").read_bytes()).hexdigest()
        for folder in housekeeping.folders()
    }


def test_all_events_are_delivered_and_nothing_is_left_to_do(environment, events):
    """Contract: worker processes make the products; a second campaign starts no cluster."""
    code, summary = campaign(environment, events, "--engine", "inline")
    assert code == 0
    assert [(row["event"], row["made"]) for row in summary["events"]] == [
        (f"fake-{number}", 2) for number in range(1, 5)
    ]
    code, summary = campaign(environment, events)
    assert code == 0
    assert [(row["made"], row["reused"]) for row in summary["events"]] == [(0, 2)] * 4


def test_a_failed_event_is_tabulated_and_stops_no_other(environment, events, pipeline):
    """Contract: error of ours and unforeseen error alike; exit code 1."""
    first = pipeline.folder / "first.py"
    text = first.read_text()
    first.write_text(text.replace("    values =", "    assert count != 6, 'six'\n    values ="))
    (events / "3" / pipeline.raw.name).unlink()
    (events / "3" / "SCA1B_2020-02-01_C_04.txt").write_text("aaa")
    code, summary = campaign(environment, events, "--engine", "inline")
    assert code == 1
    assert summary["counts"] == {"delivered": 2, "failed": 2}
    errors = {row["event"]: row["error"] for row in summary["events"] if row["status"] == "failed"}
    assert "AssertionError: six" in errors["fake-2"]
    assert "cannot be read" in errors["fake-3"]


def test_a_killed_worker_is_replaced_and_its_event_completed(environment, events, pipeline, tmp_path):
    """Contract: kill -9 of a worker in the middle of an event."""
    mark = tmp_path / "killed"
    lines = (
        f"    import os, pathlib\n    mark = pathlib.Path({str(mark)!r})\n    if count == 6 and not mark.exists():\n"
    )
    lines += "        mark.write_text('')\n        os.kill(os.getpid(), 9)\n    values ="
    first = pipeline.folder / "first.py"
    first.write_text(first.read_text().replace("    values =", lines))
    code, summary = campaign(environment, events, "--engine", "inline")
    assert mark.exists()
    assert code == 0
    assert summary["counts"] == {"delivered": 4}


def test_the_files_of_a_new_event_are_left_to_its_worker(events, monkeypatch):
    """Contract: the process that hands out events reads no file of one that was never made."""
    read, digest = [], inputs._file_digest
    monkeypatch.setattr(inputs, "_file_digest", lambda item: read.append(item.path) or digest(item))
    source, chosen = campaigns.sources("fakecal", None, events)[0], command.chosen("fakecal", None)
    assert campaign_work.reuse("fakecal", source, chosen) == (None, math.inf)
    assert read == []
    command.flow_module("fakecal").calibrate(source, chosen)
    assert campaign_work.reuse("fakecal", source, chosen)[0]["status"] == "delivered"
    assert read


def test_little_work_starts_neither_prefect_nor_dask(environment, events, tmp_path):
    """Contract: what took a moment the last time is done at once by forks; on an empty store nobody knows."""
    absent = tmp_path / "absent"
    for name in ("prefect", "distributed"):
        (absent / name).mkdir(parents=True)
        (absent / name / "__init__.py").write_text("raise ImportError('not to be imported')")
    without = environment | {"PYTHONPATH": str(absent), "GRAVCAL_PRODUCTS": os.environ["GRAVCAL_PRODUCTS"]}
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--workers", "2"]
    refused = subprocess.run(command, capture_output=True, text=True, check=False, env=without)
    assert "not to be imported" in refused.stderr
    campaign(environment, events, "--workers", "0")
    (events / "2" / "MAG1B_2020-02-01_C_04.txt").write_text("-" * 500)
    code, summary = campaign(without, events, "--workers", "2", "--set", "gain=3")
    assert code == 0
    assert [(row["made"], row["reused"]) for row in summary["events"]] == [(1, 1), (2, 0), (1, 1), (1, 1)]


def test_an_event_whose_fork_is_killed_is_completed_by_a_worker(environment, events, pipeline, tmp_path):
    """Contract: kill -9 in the middle of an event that has little left to make."""
    campaign(environment, events, "--workers", "0")
    mark = tmp_path / "killed"
    lines = f"    import os, pathlib\n    mark = pathlib.Path({str(mark)!r})\n    if not mark.exists():\n"
    lines += "        mark.write_text('')\n        os.kill(os.getpid(), 9)\n    values ="
    first = pipeline.folder / "first.py"
    first.write_text(first.read_text().replace("    values =", lines))
    code, summary = campaign(environment, events, "--engine", "inline")
    assert mark.exists()
    assert (code, summary["counts"]) == (0, {"delivered": 4})


def test_workers_are_gone_when_their_cluster_is_closed(environment):
    """Robustness: they end at once, but not before Dask has closed them."""
    command = [sys.executable, str(SCRIPT), "workers"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stderr == ""
    pids = json.loads(done.stdout)
    assert len(pids) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_an_existing_cluster_does_the_same_work(environment, events):
    """Contract: --scheduler names a cluster; the code is the same, and the cluster lives on."""
    command = [sys.executable, str(SCRIPT), "cluster"]
    cluster = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
    address = cluster.stdout.readline().strip()
    code, summary = campaign(environment, events, "--engine", "inline", "--scheduler", address)
    assert (code, summary["counts"]) == (0, {"delivered": 4})
    assert cluster.poll() is None
    cluster.communicate("")
    assert cluster.returncode == 0


def test_an_interrupt_ends_a_campaign_at_once(environment, events, pipeline, tmp_path):
    """Contract: Ctrl-C does not wait for the events that are being computed; what was made stays valid."""
    mark = tmp_path / "begun"
    lines = (
        f"    import pathlib, time\n    pathlib.Path({str(mark)!r}).write_text('')\n    time.sleep(60)\n    values ="
    )
    first = pipeline.folder / "first.py"
    first.write_text(first.read_text().replace("    values =", lines))
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--engine", "inline"]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    limit = time.monotonic() + 60
    while not mark.exists() and time.monotonic() < limit:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    started = time.monotonic()
    process.communicate()
    assert time.monotonic() - started < 30
    assert process.returncode != 0
    assert housekeeping.verify() == []


def test_a_campaign_is_one_prefect_flow_with_a_task_per_event(environment, events, pipeline, prefect_home):
    """Contract: silent, and the failed event does not stop the flow."""
    (events / "3" / pipeline.raw.name).unlink()
    (events / "3" / "SCA1B_2020-02-01_C_04.txt").write_text("aaa")
    code, summary = campaign(environment | {"PREFECT_HOME": str(prefect_home)}, events, "--workers", "2")
    assert code == 1
    assert summary["counts"] == {"delivered": 3, "failed": 1}


def test_a_hundred_kills_leave_the_same_products(environment, events, store_folder, monkeypatch):
    """Contract: kill -9 at 100 random moments of campaigns; the next run ends with the same products, byte for byte."""
    command = [sys.executable, str(SCRIPT), "campaign", "fakecal", "--data", str(events), "--workers", "0"]
    kill = [sys.executable, str(SCRIPT), "kill", "100", "0.3", *command[2:]]
    killed, ended = map(
        int, subprocess.run(kill, capture_output=True, text=True, check=True, env=environment).stdout.split()
    )
    assert killed == 100
    monkeypatch.setenv("GRAVCAL_PRODUCTS", f"{store_folder}-reference")
    subprocess.run(command, check=True, env=environment | dict(os.environ), capture_output=True)
    expected = products()
    assert len(expected) == 8
    for store in [store_folder, *(Path(f"{store_folder}+{number}") for number in range(1, ended + 1))]:
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(store))
        assert housekeeping.verify() == []
        subprocess.run(command, check=True, env=environment | dict(os.environ), capture_output=True)
        assert products() == expected
