"""`python -m benchmarks.first_run > catalog/usual/seconds.toml`: how long each part of a first run takes.

Everything as after an installation: an empty store, kernels not compiled yet, Prefect not started before. The time left
that a first run shows on a terminal is judged by this table.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.tables import say
from flows.calibration import known

CALIBRATIONS = known()
HEAD = """# Seconds that the parts of a first run take: an invented event of each calibration, an empty store, kernels
# compiled on the way. Only the time left that a terminal shows is judged by them. Written by
# `python -m benchmarks.first_run`; the times of one stage for several satellites are added up.
"""


def main() -> None:
    """Simulate and calibrate an event of each calibration, then discover where that is possible; print the table."""
    say(HEAD)
    for name in CALIBRATIONS:
        with tempfile.TemporaryDirectory() as folder:
            typed(folder, "simulate", name, "--out", f"{folder}/data", "--seed", "1")
            typed(folder, "run", name, "--data", f"{folder}/data")
            if name in ("com_offset", "kbr_phase_centre"):
                typed(folder, "discover", name, "--data", f"{folder}/data")
            for path in sorted((Path(folder) / "products").rglob("seconds-*")):
                table(path)


def typed(folder, *words) -> None:
    """Run a command whose standard error is a terminal; what it shows there is thrown away."""
    environment = os.environ | {"GRAVCAL_PRODUCTS": f"{folder}/products", "NUMBA_CACHE_DIR": f"{folder}/kernels"}
    ours, its = pty.openpty()
    command = [sys.executable, "-m", "flows.cli", *words]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=its, env=environment) as running:
        os.close(its)
        with contextlib.suppress(OSError):  # the other end is closed when the command ends
            while os.read(ours, 65536):
                pass
    os.close(ours)
    if running.returncode:
        raise SystemExit(f"{' '.join(words)} ended with {running.returncode}")


def table(path) -> None:
    """One table of the file: parts of at least a twentieth of a second."""
    parts = {}
    for stage, seconds in json.loads(path.read_text()).items():
        part = stage.rpartition("_")[0] if stage.startswith("ingest.") else stage
        parts[part] = parts.get(part, 0.0) + seconds
    say(f'["{path.stem.removeprefix("seconds-")}"]')
    for part, seconds in parts.items():
        if seconds >= 0.05:
            say(f'"{part}" = {seconds:.2f}')
    say()


if __name__ == "__main__":
    main()
