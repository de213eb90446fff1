"""Studies of the other calibrations, which print tables of their own."""

from __future__ import annotations

import os
import subprocess
import sys

from benchmarks.tables import Figure, title

STUDIES = {
    "kbr_phase_centre": (["200"],),
    "inertial_sensor": (["200", "50"],),
    "gradient_torque": (["speed"], ["study", "--days", "100"]),
}


def run(options) -> list[Figure]:
    """Every study in a process of its own; none with --quick."""
    if options.quick:
        return []
    for name, runs in STUDIES.items():
        for arguments in runs:
            title(" ".join([name, *arguments]))
            subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *arguments], env=os.environ, check=True)
    return []
