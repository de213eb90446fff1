"""A whole day: what it costs from files to page, how much memory, and what a second run costs."""

import os
import subprocess
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks import stopwatch as watch
from benchmarks.tables import CLI, Figure, at_most, say, show, title


def day(options) -> list[Figure]:
    """Simulate a full day of files, calibrate it, and calibrate it again: nothing to do, against start-up alone."""
    title("day: seven manoeuvres in a full day of Level-1 files (ACC1A 864,000 records)")
    with tempfile.TemporaryDirectory() as folder:
        files, store = Path(folder) / "level1", os.environ | {"GRAVCAL_PRODUCTS": f"{folder}/products"}
        words = ["simulate", "com_offset", "--out", str(files), "--seed", str(options.seed), "--set", "span=day"]
        simulated, spent = _peak([*CLI, *words], os.environ)
        say(f"simulated and written in {spent:.1f} s, {sum(p.stat().st_size for p in files.iterdir()) / 1e6:.0f} MB\n")
        command = [*CLI, "run", "com_offset", "--data", str(files)]
        peak, spent = _peak([*command, "--engine", "inline"], store)
        figures = [
            at_most("peak memory of gravcal simulate", simulated, 2.0, " GiB"),
            at_most("peak memory of gravcal run, empty store", peak, 2.0, " GiB"),
            at_most("gravcal run, empty store, files to page", spent, 10.0, " s"),
        ]
        show(figures)
        pairs = [[watch.command(one, store) for one in (command, [*CLI, "--help"])] for _ in range(options.rounds + 1)]
    again, start = zip(*pairs[1:], strict=True)
    wall, processor = ([a[i] - b[i] for a, b in pairs[1:]] for i in (0, 1))
    return figures + show(
        [
            watch.seconds("gravcal run, nothing to do", [one[0] for one in again]),
            watch.seconds("gravcal --help, start-up", [one[0] for one in start]),
            at_most("nothing to do beyond start-up", watch.middle(wall), 1.0, " s", watch.span(wall)),
            watch.seconds("  of it processor time", processor),
        ],
        "min .. max",
    )


def _peak(command, environment):
    """Largest sum of the memory (GiB) of a command and its children, looked at every 20 ms, and its seconds."""
    most, start = 0, time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            most = max(most, sum(watch.memory(psutil.Process(process.pid)).values()))
            time.sleep(0.02)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return most / 1024**3, time.perf_counter() - start
