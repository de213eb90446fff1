"""One line of the code changed at a time (mutants.toml), and whether the tests beside it notice.

Each is put into a copy of the project, where the tests named beside it run until one fails, and once without any change
to see them pass. What survives is a hole in the tests, or changes nothing; a text that is gone is stale.
"""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from benchmarks.tables import ROOT, Figure, at_least, say, show, title

COPIED = ("gravcal", "flows", "tasks", "catalog", "tests", "benchmarks", "pyproject.toml")
LIMIT_S = 1200  # then a mutant hangs, which is noticed
WANTED = 0.95  # share of the mutants that tests have to notice


def mutants(options) -> list[Figure]:
    """Every mutant of the table, or `--runs` of them from `--first` on; a line each."""
    table = tomllib.loads((ROOT / "benchmarks" / "mutants.toml").read_text())
    rows = [(path, *row) for path, entry in table.items() for row in entry["mutants"]]
    chosen = rows[options.first :][: options.runs]
    title(f"mutants: {len(chosen)} changed lines, each with the tests beside it")
    with tempfile.TemporaryDirectory() as folder:
        copy, left = Path(folder), 0
        for name in COPIED:
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
        named = list(dict.fromkeys(tests for *_, tests in chosen))
        whole = " tests/".join(tests for tests in named if " -k " not in tests)
        for tests in filter(None, (whole, *(tests for tests in named if " -k " in tests))):
            if noticed(copy, tests):
                raise SystemExit(f"tests/{tests} fails without any change")
        for path, old, new, tests in chosen:
            file = copy / "gravcal" / path
            whole = file.read_text()
            found = "STALE"
            if whole.count(old) == 1:
                file.write_text(whole.replace(old, new))
                found = "killed" if noticed(copy, tests) else "SURVIVED"
                file.write_text(whole)
            left += found != "killed"
            say(f"{found:8} {path}: {old.strip()} -> {new.strip()}")
    return show([at_least("share killed", 1 - left / len(chosen), WANTED)])


def noticed(copy: Path, tests: str) -> bool:
    """True if some of the tests, arguments of pytest below tests/, fail in a copy of the project."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *shlex.split(f"tests/{tests}")]
    environment = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return True
    if done.returncode not in (0, 1, 2):
        raise SystemExit(f"pytest tests/{tests} ended with {done.returncode}")
    return done.returncode != 0
