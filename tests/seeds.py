"""Seeds of what is drawn at random in a test: the same in every run, fresh where GRAVCAL_TEST_SEED=fresh or a number.

A statistic that fails one run in a thousand fails in fresh seeds only; continuous integration repeats one set. The head
of a run prints the number that repeats it. Who draws states the chance that a correct code fails, over all that is
asked of the draw; `python tests/seeds.py` prints these levels and their sum, the false alarms of the whole suite.
"""

import ast
import os
import secrets
import sys
import zlib
from pathlib import Path

import numpy as np
from draws import ALARM, FIXED, MISSED, VARIABLE


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


if __name__ == "__main__":
    for place, level in sorted(levels().items(), key=lambda pair: -pair[1]):
        sys.stdout.write(f"{level:8.2g}  {place}\n")
    sys.stdout.write(f"{sum(levels().values()):8.2g}  all\n")
