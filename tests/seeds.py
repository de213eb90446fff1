"""Seeds of what is drawn at random in a test: the same in every run, fresh where GRAVCAL_TEST_SEED=fresh or a number.

A statistic that fails one run in a thousand fails in fresh seeds only; continuous integration repeats one set. The head
of a run prints the number that repeats it. Who draws states the chance that a correct code fails, over all that is
asked of the draw; `python tests/seeds.py` prints these levels and their sum, the false alarms of the whole suite. Of
hidden effects so many draws have to be right.
"""

import ast
import os
import secrets
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

VARIABLE, FIXED = "GRAVCAL_TEST_SEED", 20261123

#: In fresh seeds draws go on until so many are right or wrong; what is right half the time passes 38 runs in 100.
RIGHT, WRONG = 6, 5
#: Chance that a search which misses one in twenty, or names something in one clean record of 200, fails.
MISSED = float(binom.sf(WRONG - 1, RIGHT + WRONG - 1, 0.05))
ALARM = float(binom.sf(1, 3, 0.005))


def settle():
    """Number of this run, in the environment for all its processes."""
    given = os.environ.get(VARIABLE, "")
    os.environ[VARIABLE] = str(secrets.randbelow(2**31)) if given == "fresh" else given or str(FIXED)
    return int(os.environ[VARIABLE])


def seed(name, level):  # noqa: ARG001 - read by `levels`
    """Seed below a million for one purpose; what it is used for fails a correct code with the chance `level`."""
    return (int(os.environ[VARIABLE]) + zlib.crc32(name.encode())) % 1_000_000


def generator(name, level):  # noqa: ARG001 - read by `levels`
    """Generator for one purpose, as `seed`."""
    return np.random.default_rng([int(os.environ[VARIABLE]), zlib.crc32(name.encode())])


def levels():
    """Level of every draw of the suite, by file and purpose; of a module whose tests draw from `rng`, that of all."""
    found, folder = {}, Path(__file__).parent
    for path in sorted(folder.rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("seeds.seed", "seeds.generator"):
                name, level = node.args[0].value, node.args[1]
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "RNG_LEVEL":
                name, level = "rng", node.value
            else:
                continue
            given = eval(ast.unparse(level), {"MISSED": MISSED, "ALARM": ALARM})  # noqa: S307 - numbers
            found[f"{path.relative_to(folder)}: {name}"] = given
    return found


def enough(draw: Callable, rng: np.random.Generator, folder: Path, right=RIGHT, wrong=WRONG) -> None:
    """Assert that draws are right often enough. With the seed of every run there is one, which has to be.

    A draw is a function of a seed and an empty folder, which holds its store -> what was wrong, None if nothing was; so
    many right or wrong ones decide.
    """
    if os.environ[VARIABLE] == str(FIXED):
        right = wrong = 1
    found = []
    while found.count(None) < right and len(found) - found.count(None) < wrong:
        place = folder / str(len(found))
        place.mkdir()
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("GRAVCAL_PRODUCTS", str(place / "products"))
            found.append(draw(int(rng.integers(1_000_000)), place))
    assert found.count(None) == right, [one for one in found if one is not None]


def clean(searched: Callable, rng: np.random.Generator, folder: Path, *, adequate=False) -> list[dict]:
    """Documents (seed, folder) -> of clean records, nothing named in two of three, adequate if asked; see `enough`."""
    documents = []

    def draw(seed, place):
        documents.append(searched(seed, place))
        named = [one["cause"] for one in documents[-1]["findings"]] or any(place.rglob("model.toml"))
        wrong = named or (adequate and not documents[-1]["adequate_before"])
        return f"seed {seed}: {named}, p {documents[-1]['p_before']}" if wrong else None

    enough(draw, rng, folder, 2, 2)
    return documents


if __name__ == "__main__":
    for place, level in sorted(levels().items(), key=lambda pair: -pair[1]):
        sys.stdout.write(f"{level:8.2g}  {place}\n")
    sys.stdout.write(f"{sum(levels().values()):8.2g}  all\n")
