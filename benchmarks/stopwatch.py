"""Timing of several things in turn, so that a machine whose speed drifts is fair to all; what two processes can do."""

import multiprocessing
import statistics
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import psutil

TASKS = 20  # of plain numpy
ROWS, COLUMNS, REPEATS = 20_000, 60, 12  # a task of some 0.7 s


def interleaved(work: Mapping[str, Callable], rounds: int, *, warm: bool = True, collect: bool = False) -> dict:
    """Seconds of each piece of work by name, measured A B C A B C ..., each run once before, not counted, if ``warm``.

    With ``collect`` what the work returns is kept in place of its seconds.
    """
    if warm:
        for run in work.values():
            run()
    spent = {name: [] for name in work}
    for _ in range(rounds):
        for name, run in work.items():
            start = time.perf_counter()
            found = run()
            spent[name].append(found if collect else time.perf_counter() - start)
    return spent


def ratios(above: list[float], below: list[float]) -> list[float]:
    """Ratio of each round, both taken seconds apart."""
    return [a / b for a, b in zip(above, below, strict=True)]


def span(values: list[float], unit: str = "") -> str:
    """Smallest and largest."""
    return f"{min(values):.3g} .. {max(values):.3g}{unit}"


def middle(values: list[float]) -> float:
    """Median."""
    return statistics.median(values)


def busy() -> float:
    """Seconds that all processors were at work, for whomever; of processes that are ended, not waited for, as well."""
    spent = psutil.cpu_times()
    return spent.user + spent.nice + spent.system


def stolen() -> float:
    """Seconds of processor that this machine wanted and its host gave to others; 0 where that is not told."""
    return getattr(psutil.cpu_times(), "steal", 0.0)


def speed_up(processes: int) -> float:
    """Speed-up of so many processes over one in tasks of plain numpy; starting them is not counted."""
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
