"""One function of many items on all cores that a process has to itself."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor


def parallel(function: Callable, *items: Iterable) -> list:
    """Results of a function of one item after the other, on all cores that this process has to itself.

    For functions that spend their time in numpy or compiled kernels, which leave the interpreter free. What they return
    is the same as of a plain loop, to the last bit and in the same order.

    Parameters
    ----------
    function : of one of each of the items
    items : of equal length
    """
    rows = list(zip(*items, strict=True))
    count = min(len(rows), _cores())
    if count < 2:
        return [function(*row) for row in rows]
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(function, *zip(*rows, strict=True)))


def _cores():
    """Number of cores that are this process's own: one where it is one of many workers."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return 1 if multiprocessing.current_process().daemon else max(len(allowed), 1)
