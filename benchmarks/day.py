"""A whole day: what it costs from files to page, and how much memory."""

import os
import subprocess
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks import stopwatch as watch
from benchmarks.tables import CLI, Figure, at_most, say, show, title


def day(options) -> list[Figure]:
    """Simulate a full day of files and calibrate it; what a second run costs is a figure of the campaign."""
    title("day: seven manoeuvres in a full day of Level-1 files (ACC1A 864,000 records)")
    with tempfile.TemporaryDirectory() as folder:
        files, store = Path(folder) / "level1", os.environ | {"GRAVCAL_PRODUCTS": f"{folder}/products"}
        words = ["simulate", "com_offset", "--out", str(files), "--seed", str(options.seed), "--set", "span=day"]
        simulated, spent = _peak([*CLI, *words], os.environ)
        say(f"simulated and written in {spent:.1f} s, {sum(p.stat().st_size for p in files.iterdir()) / 1e6:.0f} MB\n")
        peak, spent = _peak([*CLI, "run", "com_offset", "--data", str(files), "--engine", "inline"], store)
    return show(
        [
            at_most("peak memory of gravcal simulate", simulated, 2.0, " GiB"),
            at_most("peak memory of gravcal run, empty store", peak, 2.0, " GiB"),
            at_most("gravcal run, empty store, files to page", spent, 10.0, " s"),
        ]
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
