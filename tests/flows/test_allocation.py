"""Freed memory stays with a process that computes."""

import platform
import subprocess
import sys

import pytest

REPEATED = """
import resource
import numpy as np
from flows import allocation

{first}
for _ in range(3):
    np.ones(8_000_000) * 2
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(5):
    np.ones(8_000_000) * 2
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(first):
    """Pages that the kernel had to map for the same arrays again and again, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", REPEATED.format(first=first)], capture_output=True, text=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is not glibc")
def test_arrays_are_not_mapped_anew():
    """Robustness: two arrays of 64 MB five times: 32 huge pages or 16,000 small ones an array without, none with."""
    assert faults("allocation.keep_freed()") < 50 < 200 < faults("")


def test_nothing_happens_without_glibc(monkeypatch):
    """Robustness: a C library that knows no mallopt."""
    from flows import allocation

    monkeypatch.setattr(allocation.ctypes, "CDLL", lambda _: object())
    allocation.keep_freed.cache_clear()
    allocation.keep_freed()
