"""Hidden effects drawn afresh at every run, and how many draws have to be right."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.stats import binom

VARIABLE, FIXED = "GRAVCAL_TEST_SEED", 20261123

#: In fresh seeds draws go on until so many are right or wrong; what is right half the time passes 38 runs in 100.
RIGHT, WRONG = 6, 5
#: Chance that a search which misses one in twenty, or names something in one clean record of 200, fails.
MISSED = float(binom.sf(WRONG - 1, RIGHT + WRONG - 1, 0.05))
ALARM = float(binom.sf(1, 3, 0.005))


def enough(draw: Callable, rng: np.random.Generator, folder: Path, right=RIGHT, wrong=WRONG) -> tuple[bool, list[str]]:
    """Whether draws are right often enough; what was wrong. With the seed of every run there is one, which has to be.

    Parameters
    ----------
    draw : function of a seed and an empty folder -> what was wrong, None if nothing was
    rng : of the run
    folder : for the files
    right, wrong : how many draws decide
    """
    if os.environ[VARIABLE] == str(FIXED):
        right = wrong = 1
    found = []
    while found.count(None) < right and len(found) - found.count(None) < wrong:
        place = folder / str(len(found))
        place.mkdir()
        found.append(draw(int(rng.integers(1_000_000)), place))
    return found.count(None) == right, [one for one in found if one is not None]


def clean(draw: Callable, rng: np.random.Generator, folder: Path) -> tuple[bool, list[str]]:
    """The same of clean records at the delivered level: two of three, and one of one with the seed of every run."""
    return enough(draw, rng, folder, 2, 2)
