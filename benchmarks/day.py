"""A whole day: what it costs from files to page, how much memory, and what a second run costs."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks import stopwatch as watch
from benchmarks.tables import Figure, at_most, say, show, title

CLI = [sys.executable, "-m", "flows.cli"]


def run(options) -> list[Figure]:
    """Simulate a full day of files, calibrate it, and calibrate it again."""
    title("day: seven manoeuvres in a full day of Level-1 files (ACC1A 864,000 records)")
    with tempfile.TemporaryDirectory() as folder:
        files, start = Path(folder) / "level1", time.perf_counter()
        arguments = ["simulate", "com_offset", "--out", str(files), "--seed", str(options.seed), "--set", "span=day"]
        peak = _peak([*CLI, *arguments], os.environ)
        size = sum(path.stat().st_size for path in files.iterdir()) / 1e6
        say(f"simulated and written in {time.perf_counter() - start:.1f} s, {size:.0f} MB\n")
        store = os.environ | {"GRAVCAL_PRODUCTS": str(Path(folder) / "products")}
        command = [*CLI, "run", "com_offset", "--data", str(files)]
        return _first(peak, command, store) + _again(command, store, options.rounds)


def _first(simulated, command, store):
    """Time and peak memory of the first run, which leaves its products in the store, and memory of simulating."""
    start = time.perf_counter()
    peak = _peak([*command, "--engine", "inline"], store)
    figures = [
        at_most("peak memory of gravcal simulate", simulated, 2.0, " GiB"),
        at_most("peak memory of gravcal run, empty store", peak, 2.0, " GiB"),
        at_most("gravcal run, empty store, files to page", time.perf_counter() - start, 10.0, " s"),
    ]
    show(figures)
    say()
    return figures


def output(command, environment):
    """Standard output of a command."""
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


def _again(command, store, rounds):
    """The command line with nothing to do, against start-up alone, in turn."""
    spent = watch.interleaved(
        {"again": lambda: _timed(command, store), "help": lambda: _timed([*CLI, "--help"], store)}, rounds, collect=True
    )
    wall, processor = ([a[i] - b[i] for a, b in zip(spent["again"], spent["help"], strict=True)] for i in (0, 1))
    again, start = ([run[0] for run in spent[name]] for name in ("again", "help"))
    say()
    return show(
        [
            Figure("gravcal run, nothing to do", f"{watch.middle(again):.3g} s", watch.span(again)),
            Figure("gravcal --help, start-up", f"{watch.middle(start):.3g} s", watch.span(start)),
            at_most("nothing to do beyond start-up", watch.middle(wall), 1.0, " s", watch.span(wall)),
            Figure("  of it processor time", f"{watch.middle(processor):.3g} s", watch.span(processor)),
        ],
        "min .. max",
    )


def _timed(command, environment):
    """Wall and processor seconds of a command and what it started."""
    before, start = os.times(), time.perf_counter()
    output(command, environment)
    wall, after = time.perf_counter() - start, os.times()
    used = (after.children_user + after.children_system) - (before.children_user + before.children_system)
    return wall, used


def _peak(command, environment):
    """Largest sum of the memory (GiB) of a command and its children, looked at every 20 ms."""
    most = 0
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        watched = psutil.Process(process.pid)
        while process.poll() is None:
            most = max(most, _memory(watched))
            time.sleep(0.02)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return most / 1024**3


def _memory(process):
    """Bytes of a process and its children; one that ended meanwhile counts nothing."""
    total = 0
    try:
        for one in [process, *process.children(recursive=True)]:
            total += one.memory_info().rss
    except psutil.NoSuchProcess:
        pass
    return total
