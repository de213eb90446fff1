"""One function of many items on all cores that a process has to itself."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor


def parallel(function: Callable, *items: Iterable) -> list:
    """Results of a function of one of each of the items after the other, on all cores that this process has to itself.

    For functions that spend their time in numpy or compiled kernels, which leave the interpreter free. What they return
    is the same as of a plain loop, to the last bit and in the same order.
    """
    rows = list(zip(*items, strict=True))
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    own = 1 if multiprocessing.current_process().daemon else len(allowed)  # one where it is one of many workers
    count = min(len(rows), own)
    if count < 2:
        return [function(*row) for row in rows]
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(function, *zip(*rows, strict=True)))
