"""Timing of several things in turn, so that a machine whose speed drifts is fair to all of them."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

import psutil


def interleaved(work: Mapping[str, Callable], rounds: int, *, warm: bool = True, collect: bool = False) -> dict:
    """Seconds of each piece of work by name, measured A B C A B C ...

    Parameters
    ----------
    work : callables by name
    rounds : how often each is timed
    warm : run each once before, not counted
    collect : keep what the work returns instead of its seconds
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
