"""Hidden effects drawn afresh at every run, and how many draws have to be right."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: Draws at most, one of which has to be right; chance that none is where one in twenty is wrong.
DRAWS, MISSED = 3, 0.05**3


def enough(draw: Callable, rng: np.random.Generator, folder: Path) -> tuple[bool, list[str]]:
    """Whether one of the draws is right; what was wrong before. How often they are is what the studies count.

    Parameters
    ----------
    draw : function of a seed and an empty folder -> what was wrong, None if nothing was
    rng : of the run
    folder : for the files
    """
    wrong = []
    for k in range(DRAWS):
        (folder / str(k)).mkdir()
        problem = draw(int(rng.integers(1_000_000)), folder / str(k))
        if not problem:
            return True, wrong
        wrong.append(problem)
    return False, wrong


def document_of(result, target: Path) -> dict:
    """Document that a command wrote; without one the test fails with the command's own error.

    Parameters
    ----------
    result : of `typer.testing.CliRunner`
    target : of its option --json
    """
    if not target.exists():
        raise AssertionError(f"no document, exit code {result.exit_code}: {result.output}") from result.exception
    return json.loads(target.read_text())
