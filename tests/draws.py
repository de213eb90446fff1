"""Hidden effects drawn afresh at every run, and how many draws have to be right."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

#: Draws at most, and how many have to be right: a wrong answer in twenty draws fails once in two thousand runs.
DRAWS, RIGHT = 4, 2


def enough(draw: Callable, rng: np.random.Generator, folder: Path) -> tuple[bool, list[str]]:
    """Whether enough of the draws are right; what was wrong in the others.

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
        wrong += [problem] if problem else []
        if k + 1 - len(wrong) == RIGHT:
            break
    return len(wrong) <= DRAWS - RIGHT, wrong


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
