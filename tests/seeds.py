"""Seeds of what is drawn at random in a test: the same in every run, fresh where GRAVCAL_TEST_SEED=fresh or a number.

A statistic that fails one run in a thousand fails in fresh seeds only; continuous integration repeats one set. The head
of a run prints the number that repeats it.
"""

import os
import secrets
import zlib

import numpy as np

VARIABLE, FIXED = "GRAVCAL_TEST_SEED", 20261123


def settle():
    """Number of this run, in the environment for all its processes."""
    given = os.environ.get(VARIABLE, "")
    os.environ[VARIABLE] = str(secrets.randbelow(2**31)) if given == "fresh" else given or str(FIXED)
    return int(os.environ[VARIABLE])


def seed(name):
    """Seed below a million for one purpose of one test module."""
    return (int(os.environ[VARIABLE]) + zlib.crc32(name.encode())) % 1_000_000


def generator(name):
    """Generator for one purpose of one test module."""
    return np.random.default_rng([int(os.environ[VARIABLE]), zlib.crc32(name.encode())])
