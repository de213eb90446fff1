"""What two processes of this machine do at once at all: twenty tasks of plain numpy, with one process and with two."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

TASKS = 20
ROWS, COLUMNS, REPEATS = 20_000, 60, 12  # a task of some 0.7 s


def ratio(processes: int) -> float:
    """Speed-up of as many processes over one; starting them is not counted.

    Parameters
    ----------
    processes : int
    """
    alone, together = (_spent(count) for count in (1, processes))
    return alone / together


def _spent(processes):
    """Seconds that all tasks take."""
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(_task, range(4 * processes)))  # begins every process
        start = time.perf_counter()
        list(pool.map(_task, range(TASKS)))
        return time.perf_counter() - start


def _task(seed):
    """Random columns, their spectra, and a solution of their normal equations."""
    rng, total = np.random.default_rng(seed), 0.0
    for _ in range(REPEATS):
        columns = rng.standard_normal((ROWS, COLUMNS))
        power = np.abs(np.fft.rfft(columns, axis=0)) ** 2
        total += float(np.linalg.solve(columns.T @ columns, power[:COLUMNS].sum(axis=1)).sum())
    return total
