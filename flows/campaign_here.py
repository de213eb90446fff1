"""Events with little left to make: done by forks of this process, for starting Prefect and Dask would take longer.

How long a stage takes is known from its last product. What is not known, as on an empty store, is never little.
"""

import contextlib
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from flows.children import die_with

LITTLE_S = 60.0  # work on all events together; starting Prefect and Dask takes six seconds, more on a busy machine


def run(waiting, work, processes, listener=None):
    """Rows of the first events, made by forks while the next are looked at, until it would be too much work.

    Parameters
    ----------
    waiting : iterator of (number, source, seconds that are left to do)
    work : function of a source that returns its row
    processes : int
    listener : function of one row, or None

    Returns
    -------
    rows : dict of number to row
    others : list of (number, source): those whose fork died, and the one that was too much; more may wait
    """
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("fork"), die_with, (os.getpid(),))
    rows, given, others, total = {}, {}, [], 0.0
    try:
        for number, source, seconds in waiting:
            total += seconds
            if total > LITTLE_S:
                others.append((number, source))
                break
            with contextlib.suppress(BrokenProcessPool):
                given[pool.submit(work, source)] = number, source
                continue
            others.append((number, source))
        for future in as_completed(given):
            number, source = given[future]
            try:
                rows[number] = future.result()
            except BrokenProcessPool:
                others.append((number, source))
            else:
                listener(rows[number]) if listener else None
    finally:
        pool.shutdown(cancel_futures=True)
    return rows, sorted(others, key=lambda event: event[0])
