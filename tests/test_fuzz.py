"""A few mutated file sets of each calibration; `python -m benchmarks fuzz` makes as many as wanted."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import fuzz

ROOT = Path(__file__).parents[1]
RUNS, SEED = 2, 3  # of each calibration, in one process: its libraries take longer to load than a run


@pytest.mark.long
def test_mutated_files_never_give_a_trace_or_a_wrong_result():
    """Contract: an error, no result, questionable, or within 4 total sigma; within 1 GB and 60 s."""
    command = [sys.executable, "-m", "benchmarks", "fuzz", "--runs", str(RUNS), "--workers", "1", "--seed", str(SEED)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    for calibration in fuzz.EVENTS:
        (said,) = re.findall(rf"^{calibration}: (.*)$", done.stdout, re.MULTILINE)
        found = {outcome: int(count) for count, outcome in re.findall(r"(\d+) ([^,]+)", said)}
        assert sum(found.values()) == RUNS, done.stdout
        assert not set(found) & set(fuzz.BAD), done.stdout
