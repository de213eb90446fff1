"""A few mutated file sets of each calibration; `python -m benchmarks fuzz` makes as many as wanted."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import fuzz

ROOT = Path(__file__).parents[1]
RUNS = 4  # of each calibration


@pytest.mark.parametrize(("calibration", "seed"), list(zip(fuzz.EVENTS, (2, 1, 3, 3), strict=True)))
def test_mutated_files_never_give_a_trace_or_a_wrong_result(calibration, seed):
    """Contract: an error, no result, questionable, or within 4 total sigma; within 1 GB and 60 s."""
    command = [sys.executable, "-m", "benchmarks", "fuzz", "--calibration", calibration, "--runs", str(RUNS)]
    done = subprocess.run([*command, "--seed", str(seed)], capture_output=True, text=True, check=True, cwd=ROOT)
    (said,) = re.findall(rf"^{calibration}: (.*)$", done.stdout, re.MULTILINE)
    found = {outcome: int(count) for count, outcome in re.findall(r"(\d+) ([^,]+)", said)}
    assert sum(found.values()) == RUNS, done.stdout
    assert not set(found) & set(fuzz.BAD), done.stdout


def test_every_mutation_changes_the_file(tmp_path):
    """Contract: of text and of netCDF; the file before stays as it is."""
    from flows import inertial_sensor, kbr_phase_centre

    made = tmp_path / "made"
    quick = {"manoeuvres": ",", "phase_step_s": 1.0}
    kbr_phase_centre.CALIBRATION.simulate(made, seed=1, truth=None, effects={}, settings=quick)
    inertial_sensor.CALIBRATION.simulate(made, seed=1, truth=None, effects={}, settings={"manoeuvre": "swing"})
    for number, kind in enumerate([*fuzz.IN_RECORDS, *fuzz.IN_BYTES]):
        for name in ("KBR1B_2020-09-10_Y_04.txt", "ORB_2022-05-18_T_01.nc"):
            rng = np.random.default_rng([1, number])
            folder = tmp_path / kind / name
            folder.mkdir(parents=True)
            for path in made.iterdir():
                (folder / path.name).symlink_to(path)
            path, before = folder / name, (made / name).read_bytes()
            if kind in fuzz.IN_BYTES:
                fuzz.IN_BYTES[kind](path, before, rng)
            else:
                table = fuzz.load(path)
                fuzz.IN_RECORDS[kind](table, rng)
                fuzz.save(table)
            assert (made / name).read_bytes() == before
            assert not path.exists() or path.read_bytes() != before, kind
