"""A few mutated file sets of each calibration; `python -m benchmarks fuzz` makes as many as wanted."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import fuzz

ROOT = Path(__file__).parents[1]
RUNS = 3  # of each calibration


@pytest.mark.parametrize(("calibration", "seed"), list(zip(fuzz.EVENTS, (2, 1, 3, 3), strict=True)))
def test_mutated_files_never_give_a_trace_or_a_wrong_result(calibration, seed):
    """Contract: an error, no result, questionable, or within 4 total sigma; within 1 GB and 60 s."""
    command = [sys.executable, "-m", "benchmarks", "fuzz", "--calibration", calibration, "--runs", str(RUNS)]
    command += ["--workers", "1"]
    done = subprocess.run([*command, "--seed", str(seed)], capture_output=True, text=True, check=True, cwd=ROOT)
    (said,) = re.findall(rf"^{calibration}: (.*)$", done.stdout, re.MULTILINE)
    found = {outcome: int(count) for count, outcome in re.findall(r"(\d+) ([^,]+)", said)}
    assert sum(found.values()) == RUNS, done.stdout
    assert not set(found) & set(fuzz.BAD), done.stdout
