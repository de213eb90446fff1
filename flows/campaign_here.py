"""Events with little left to make: done by forks of this process, for starting Prefect and Dask would take longer.

How long a stage takes is known from its last product. What is not known, as on an empty store, is never little.
"""

import contextlib
import importlib
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from flows.children import die_with

LITTLE_S = 20.0  # work on all events together; starting Prefect and Dask takes six seconds


def look_ahead(waiting, most):
    """Events that have something to make, and whether these are all and little work.

    Parameters
    ----------
    waiting : iterator of (number, source, engine.Left)
    most : int, events to look at where there is more

    Returns
    -------
    head : list of (number, source)
    modules : set of str that the work needs; None where it is not little, or there are more events
    """
    head, modules, seconds = [], set(), 0.0
    for number, source, left in waiting:
        head.append((number, source))
        modules |= left.modules
        seconds += left.seconds
        if len(head) >= most and seconds > LITTLE_S:
            return head, None
    return head, modules if seconds <= LITTLE_S else None


def run(events, work, processes, modules, listener=None):
    """Rows by number, made by forks of this process; an event whose fork died has none.

    Parameters
    ----------
    events : list of (number, source)
    work : function of a source that returns its row
    processes : int
    modules : set of str, loaded before, so that not every fork has to
    listener : function of one row, or None

    Returns
    -------
    rows : dict of number to row
    """
    for name in sorted(modules):
        with contextlib.suppress(Exception):  # what is wrong with it is said by the event that needs it
            importlib.import_module(name)
    rows, forks = {}, multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(min(processes, len(events)), forks, die_with, (os.getpid(),))
    try:
        futures = {pool.submit(work, source): number for number, source in events}
        for future in as_completed(futures):
            with contextlib.suppress(BrokenProcessPool):
                rows[futures[future]] = future.result()
                if listener:
                    listener(rows[futures[future]])
    finally:
        pool.shutdown(cancel_futures=True)
    return rows
