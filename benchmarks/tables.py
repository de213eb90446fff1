"""What all studies share: cases in processes, figures beside targets, timing in turn, a last word on what was met."""

import importlib
import multiprocessing
import statistics
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from scipy import stats

ROOT = Path(__file__).parents[1]
STUDIES = tomllib.loads((ROOT / "benchmarks" / "studies.toml").read_text())
CLI = [sys.executable, "-m", "flows.cli"]
middle = statistics.median
FALSE_ALARM = 0.01  # chance that any statistic of a study leaves its interval though all is right


@dataclass(frozen=True)
class Figure:
    """One measured number and what it should be."""

    name: str  #: what was measured
    value: str  #: as printed
    spread: str = ""  #: its interval, or minimum and maximum, as printed
    target: str = ""  #: as printed, "" where there is none
    met: bool | None = None  #: None where there is no target


def cases(function: Callable, jobs: Iterable, workers: int):
    """Results of a function for each job, in order, each as soon as it is there; more than one worker: in processes."""
    if workers == 1:
        yield from map(function, jobs)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(function, jobs)


def parts(function: Callable, jobs: Iterable, workers: int) -> list[np.ndarray]:
    """What a function says of each job, part by part: arrays whose first axis is that of the jobs."""
    return [np.array(part) for part in zip(*cases(function, jobs, workers), strict=True)]


def study(options, default: int, words: str, function: Callable, first: int = 0) -> list[np.ndarray]:
    """Heading of a study of so many seeds, and what a function says of each, part by part."""
    count = options.runs or default
    title(words.format(count))
    return parts(function, range(first, first + count), options.workers)


def of_tests(name: str):
    """Module that stands beside the tests, by its path with dots."""
    folder, _, module = name.rpartition(".")
    place = str(ROOT / "tests" / folder.replace(".", "/"))
    if place not in sys.path:
        sys.path.insert(0, place)
    return importlib.import_module(module)


def say(text: str = "") -> None:
    """One line, at once."""
    print(text, flush=True)


def title(text: str) -> None:
    """Heading of a benchmark."""
    say(f"\n{text}\n{'-' * len(text)}")


def show(figures: list[Figure], spread: str = "") -> list[Figure]:
    """Print figures as a table, the column of spreads with this heading, and return them."""
    word = {None: "", True: "met", False: "NOT MET"}
    grid(
        [
            ("figure", "value", spread, "target", ""),
            *((f.name, f.value, f.spread, f.target, word[f.met]) for f in figures),
        ]
    )
    say()
    return figures


def grid(rows: list[tuple[str, ...]]) -> None:
    """Print rows with columns as wide as they need; the first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))]
        say("  ".join(cells).rstrip())


def numbers(values, form: str = ".3g") -> str:
    """Numbers side by side."""
    return " ".join(format(float(value), form) for value in np.atleast_1d(values))


def summary(figures: list[Figure]) -> None:
    """How many targets were met, and which were not; nothing where no figure has a target."""
    judged = [f for f in figures if f.met is not None]
    if not judged:
        return
    missed = [f for f in judged if not f.met]
    title(f"{len(judged) - len(missed)} of {len(judged)} targets met")
    for figure in missed:
        say(f"not met: {figure.name}: {figure.value} {figure.spread}, target {figure.target}")
    say()


def at_most(name: str, value: float, limit: float | None, unit: str = "", spread: str = "") -> Figure:
    """Figure whose target, if it has one, is an upper limit."""
    target = () if limit is None else (f"<= {limit:g}{unit}", bool(value <= limit))
    return Figure(name, f"{value:.3g}{unit}", spread, *target)


def at_least(name: str, value: float, limit: float, unit: str = "", spread: str = "") -> Figure:
    """Figure whose target is a lower limit."""
    return Figure(name, f"{value:.3g}{unit}", spread, f">= {limit:g}{unit}", bool(value >= limit))


def share(name: str, hits: list) -> Figure:
    """Share of cases, with its interval of 95 %."""
    if not hits:
        return Figure(name, "none")
    low, high = stats.binomtest(int(sum(hits)), len(hits)).proportion_ci(0.95, method="wilson")
    return Figure(name, f"{sum(hits)} of {len(hits)}", f"{low:.2f} to {high:.2f}")


def rms(values, axis=0):
    """Root mean square, NaN left out."""
    return np.sqrt(np.nanmean(np.square(values), axis=axis))


def interval(count: int, family: int = 1) -> tuple[float, float]:
    """What chance allows the rms of so many errors over sigma, if it is one of a family of statistics."""
    level = FALSE_ALARM / family
    low, high = np.sqrt(stats.chi2.ppf([level / 2, 1 - level / 2], count) / count)
    return float(low), float(high)


def rms_figure(name: str, ratio, family: int = 1, more: str = "", *, judged: bool = True) -> Figure:
    """Root mean square of errors over their sigma (n,), and what chance allows it; what is not judged has no target."""
    ratio = np.asarray(ratio)[np.isfinite(ratio)]
    value, (low, high) = float(rms(ratio)), interval(ratio.size, family)
    target = (f"{low:.3f} .. {high:.3f}", low <= value <= high) if judged else ()
    return Figure(name, f"{value:.3f}", f"+- {value / np.sqrt(2 * ratio.size):.3f}{more}", *target)


def scatter_figure(name: str, ratio, family: int, *, judged: bool = True) -> Figure:
    """Scatter of errors over their lower bound (n,): at most 1.1, chance allowed for."""
    ratio = np.asarray(ratio)[np.isfinite(ratio)]
    dof, value = ratio.size - 1, float(ratio.std(ddof=1))
    limit = 1.1 * np.sqrt(stats.chi2.ppf(1 - FALSE_ALARM / family, dof) / dof)
    target = (f"<= 1.10 ({limit:.2f})", bool(value <= limit)) if judged else ()
    return Figure(f"scatter/Cramer-Rao {name}", f"{value:.3f}", f"+- {value / np.sqrt(2 * dof):.3f}", *target)


def bias_figure(name: str, ratio) -> Figure:
    """Mean of errors over their sigma (n,): below 0.2 plus three standard errors."""
    ratio = np.asarray(ratio)[np.isfinite(ratio)]
    error = float(ratio.std(ddof=1) / np.sqrt(ratio.size))
    mean, limit = float(ratio.mean()), 0.2 + 3 * error
    return Figure(name, f"{mean:+.3f}", f"+- {3 * error:.3f}", f"|.| <= {limit:.2f}", abs(mean) <= limit)


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
