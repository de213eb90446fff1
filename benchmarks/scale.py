"""Orchestration of campaigns of 20, 200 and 2000 events that cost almost nothing: time, memory, nothing to do."""

from __future__ import annotations

import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks import stopwatch as watch
from benchmarks.tables import Figure, at_most, show, title

SCRIPT = [sys.executable, str(Path(__file__).parent / "small.py")]
SIZES = (20, 200, 2000)
REAL_EVENT_S = 5.0  # what a day of seven manoeuvres takes at least; the share is of this
PARAMETERS = """
[gain]
value = 2.0
unit = "1"
stage = "scale"
reason = "benchmark"

[count]
value = 1000
stage = "start"
reason = "benchmark"
"""


def run(options) -> list[Figure]:
    """Campaigns of growing size in stores of their own; the Prefect home is shared, so it is migrated once."""
    sizes = [count for count in SIZES if count <= (20 if options.quick else options.events or SIZES[-1])]
    sizes_text, load = ", ".join(map(str, sizes)), os.getloadavg()[0]
    title(f"scale: {sizes_text} events of five small products, {options.workers} workers; load {load:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        environment = _environment(root)
        _campaign(root, 2, environment, options.workers)
        found = {count: _campaign(root, count, environment, options.workers) for count in sizes}
    figures = [figure for count in sizes for figure in _figures(count, found[count])]
    if len(sizes) > 1:
        figures += _growth(found, options.workers)
    return show(figures)


def _environment(root):
    """Settings of the processes that run the campaigns."""
    (root / "catalog" / "parameters").mkdir(parents=True)
    (root / "catalog" / "parameters" / "small.toml").write_text(PARAMETERS)
    known = {"GRAVCAL_CATALOG": str(root / "catalog"), "PREFECT_HOME": str(root / "prefect")}
    return os.environ | known | {"PYTHONPATH": str(Path(__file__).parents[1])}


def _campaign(root, count, environment, workers):
    """Cold run, then with nothing to do: seconds, summary, and memory of process and server as events end."""
    files = root / f"files-{count}"
    files.mkdir()
    for number in range(count):
        date = datetime.date(2000, 1, 1) + datetime.timedelta(days=number)
        (files / f"MAG1B_{date}_C_04.txt").write_text(str(number))
    time.sleep(2.5)  # a folder that has just changed is listed each time
    environment = environment | {"GRAVCAL_PRODUCTS": str(root / f"products-{count}")}
    command = [*SCRIPT, "campaign", "small", "--data", str(files), "--workers", str(workers), "--json", "-"]
    cold, memory, summary = _watched(command, environment, root / f"products-{count}", count)
    again, _, second = _watched(command, environment, root / f"products-{count}", count)
    started, _, _ = _watched([*SCRIPT, "--help"], environment, root, 0)
    again = tuple(one - other for one, other in zip(again, started, strict=True))
    assert summary["counts"] == second["counts"] == {"delivered": count}
    assert sum(row["made"] for row in second["events"]) == 0
    busy = sum(row["seconds"] for row in summary["events"])
    return {"cold": cold[0], "processor": cold[1], "again": again, "busy": busy, "memory": memory}


def _watched(command, environment, store, count):
    """Wall seconds of a command, processor seconds of the machine, memory (MB) of it and its server, and its JSON."""
    start, before, seen = time.perf_counter(), watch.busy(), {}
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(command, env=environment, stdout=out)
        while process.poll() is None:
            time.sleep(0.1)
            done = len(list((store / "latest").glob("*"))) if count > 100 else 0
            if count > 100 and done >= count // 10:
                found = _memory(process.pid)
                if found is not None:
                    seen.setdefault("early", found)
                    seen["late"] = found
        seconds = time.perf_counter() - start, watch.busy() - before
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
        out.seek(0)
        text = out.read()
    return seconds, seen, json.loads(text) if count else {}


def _memory(pid):
    """Memory in MB of the process that schedules and of the Prefect server below it; None without a server."""
    try:
        process = psutil.Process(pid)
        server = [one for one in process.children() if "flows.engine.server" in one.cmdline()]
        return (process.memory_info().rss / 1e6, server[0].memory_info().rss / 1e6) if server else None
    except psutil.Error:
        return None


def _figures(count, found):
    """Figures of one size."""
    extra, processor = found["again"]
    limit = [at_most("  nothing to do beyond start-up", extra, 2.0, " s")] if count == 20 else []
    return [
        Figure(f"{count} events, empty store", f"{found['cold']:.3g} s"),
        Figure("  for each event", f"{1e3 * found['cold'] / count:.3g} ms"),
        Figure("  processor time of the machine for each event", f"{1e3 * found['processor'] / count:.3g} ms"),
        *(limit or [Figure("  nothing to do beyond start-up", f"{extra:.3g} s")]),
        Figure("    for each event", f"{1e3 * extra / count:.3g} ms"),
        Figure("    processor time of the machine for each event", f"{1e3 * processor / count:.3g} ms"),
    ]


def _growth(found, workers):
    """What one more event costs beyond the work on it, and memory."""
    less, more = sorted(found)[-2:]
    wall = found[more]["cold"] - found[less]["cold"]
    work = (found[more]["busy"] - found[less]["busy"]) / workers
    each = (wall - work) / (more - less)
    start = found[200]["cold"] - found[200]["busy"] / workers
    real = 200 * REAL_EVENT_S / workers
    early, late = (found[more]["memory"][name] for name in ("early", "late"))
    return [
        Figure(f"one more event, {less} to {more}: wall", f"{1e3 * wall / (more - less):.3g} ms"),
        Figure("  of it beyond the work of the workers", f"{1e3 * each:.3g} ms"),
        at_most(
            f"orchestration of 200 events, share if each took {REAL_EVENT_S:g} s",
            100 * start / (start + real),
            10.0,
            " %",
        ),
        Figure(f"memory of the scheduling process after {more // 10} events", f"{early[0]:.0f} MB"),
        at_most(f"  growth to {more} events", late[0] - early[0], 50.0, " MB"),
        Figure("memory of the Prefect server, early and late", f"{early[1]:.0f} .. {late[1]:.0f} MB"),
    ]
