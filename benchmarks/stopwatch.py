"""Timing of several things in turn, so that a machine whose speed drifts is fair to all; what two processes can do."""

import os
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping

import numpy as np
import psutil

from benchmarks.tables import Figure, cases

TASKS = 20  # of plain numpy
ROWS, COLUMNS, REPEATS = 20_000, 60, 12  # a task of some 0.7 s
middle = statistics.median


def interleaved(work: Mapping[str, Callable], rounds: int) -> dict[str, list[float]]:
    """Seconds of each piece of work by name, measured A B C A B C ..., each run once before, not counted."""
    for run in work.values():
        run()
    spent = {name: [] for name in work}
    for _ in range(rounds):
        for name, run in work.items():
            start = time.perf_counter()
            run()
            spent[name].append(time.perf_counter() - start)
    return spent


def ratios(above: list[float], below: list[float]) -> list[float]:
    """Ratio of each round, both taken seconds apart."""
    return [a / b for a, b in zip(above, below, strict=True)]


def span(values: list[float], unit: str = "") -> str:
    """Smallest and largest."""
    return f"{min(values):.3g} .. {max(values):.3g}{unit}"


def seconds(name: str, spent: list[float], unit: str = "s") -> Figure:
    """Median time without a target."""
    return Figure(name, f"{middle(spent):.3g} {unit}", span(spent))


def command(words: list, environment: Mapping) -> tuple[float, float, float, str]:
    """Wall seconds of a command, processor seconds of it and of the machine meanwhile, and what it printed."""
    start, before, machine = time.perf_counter(), os.times(), _busy()
    text = subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout
    wall, after = time.perf_counter() - start, os.times()
    own = after.children_user + after.children_system - before.children_user - before.children_system
    return wall, own, _busy() - machine, text


def _busy():
    """Seconds that all processors were at work, for whomever; of processes that are ended, not waited for, as well."""
    spent = psutil.cpu_times()
    return spent.user + spent.nice + spent.system


def stolen() -> float:
    """Seconds of processor that this machine wanted and its host gave to others; 0 where that is not told."""
    return getattr(psutil.cpu_times(), "steal", 0.0)


def memory(process: psutil.Process) -> dict[psutil.Process, int]:
    """Bytes of a process and of its children; one that ended meanwhile is not there."""
    found = {}
    try:
        for one in [process, *process.children(recursive=True)]:
            found[one] = one.memory_info().rss
    except psutil.Error:
        pass
    return found


def speed_up(processes: int) -> float:
    """Speed-up of so many processes over one in tasks of plain numpy; starting them is not counted."""
    return _spent(1) / _spent(processes)


def _spent(processes):
    """Seconds that all tasks take."""
    results = cases(_task, range(TASKS + 4 * processes), max(processes, 1))
    for _ in range(4 * processes):  # begins every process
        next(results)
    start = time.perf_counter()
    list(results)
    return time.perf_counter() - start


def _task(seed):
    """Random columns, their spectra, and a solution of their normal equations."""
    rng, total = np.random.default_rng(seed), 0.0
    for _ in range(REPEATS):
        columns = rng.standard_normal((ROWS, COLUMNS))
        power = np.abs(np.fft.rfft(columns, axis=0)) ** 2
        total += float(np.linalg.solve(columns.T @ columns, power[:COLUMNS].sum(axis=1)).sum())
    return total
