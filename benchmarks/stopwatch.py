"""Timing of several things in turn, so that a machine whose speed drifts is fair to all."""

import statistics
import subprocess
import time
from collections.abc import Callable, Mapping

import psutil

from benchmarks.tables import Figure

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


def command(words: list, environment: Mapping) -> tuple[float, float, str]:
    """Wall seconds of a command, processor seconds of the machine meanwhile, and what it printed."""
    start, before = time.perf_counter(), psutil.cpu_times()
    text = subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout
    wall, after = time.perf_counter() - start, psutil.cpu_times()
    busy = sum(getattr(after, kind) - getattr(before, kind) for kind in ("user", "nice", "system"))
    return wall, busy, text


def stolen() -> float:
    """Seconds of processor that this machine wanted and its host gave to others; 0 where that is not told."""
    return getattr(psutil.cpu_times(), "steal", 0.0)
