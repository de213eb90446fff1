"""A campaign of simulated events: cold, with nothing to do, and after a changed setting of the last stages."""

from __future__ import annotations

import datetime
import json
import os
import tempfile
import time
from pathlib import Path

from benchmarks import stopwatch as watch
from benchmarks.day import CLI, output
from benchmarks.tables import Figure, at_least, at_most, show, title

SEVEN = 20  # up to so many events have all seven windows; more have one


def run(options) -> list[Figure]:
    """Events in one folder, processed by the command line with two workers."""
    count, rounds = (4, 1) if options.quick else (20, 3)
    count = options.events or count
    windows = "seven windows" if count <= SEVEN else "one window"
    title(
        f"campaign: com_offset, {count} events of {windows}, {options.workers} workers; load {os.getloadavg()[0]:.1f}"
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        _simulate(root / "level1", count, options.seed)
        command = [*CLI, "campaign", "com_offset", "--data", str(root / "level1")]
        figures = _cold(command, root, count, options)
        cold, command = figures.pop(), [*command, "--workers", str(options.workers)]
        figures += _again(command, _store(root, "products"), cold, rounds)
    return show(figures, "min .. max")


def _cold(command, root, count, options):
    """Figures of runs on empty stores with all workers and with one; at the end the seconds of the first."""
    _campaign(
        [*command[:-1], str(_first(root)), "--workers", "1"], _store(root, "first")
    )  # migrates Prefect's database
    cold, busy = _campaign([*command, "--workers", str(options.workers)], _store(root, "products"))
    share = 100 * (1 - busy / (options.workers * cold))
    figures = [
        Figure("empty store", f"{cold:.3g} s"),
        Figure("  for each event", f"{cold / count:.3g} s"),
        Figure("  work on one event", f"{busy / count:.3g} s"),
    ]
    if count >= 200:
        figures.append(at_most("  orchestration, waiting of workers included", share, 10.0, " %"))
    elif not options.quick:
        alone, work = _campaign([*command, "--workers", "1"], _store(root, "alone"))
        figures.append(Figure("empty store, one worker", f"{alone:.3g} s"))
        figures.append(Figure("  work on one event", f"{work / count:.3g} s"))
        figures.append(at_least(f"  speed-up of {options.workers} workers", alone / cold, 1.6))
    return [*figures, cold]


def _again(command, environment, cold, rounds):
    """Figures of runs that find what they need, wholly or in part."""
    changed = [_seconds([*command, "--set", f"noise_order={19 - i}"], environment) for i in range(rounds)]
    pairs = [(_seconds(command, environment), _seconds([*CLI, "--help"], environment)) for _ in range(rounds)]
    extra = [again - start for again, start in pairs]
    share = [100 * seconds / cold for seconds in changed]
    return [
        Figure("noise_order changed: noise, solve, combine, report", f"{watch.middle(changed):.3g} s"),
        at_most("  of the cold run", watch.middle(share), 10.0, " %", watch.span(share)),
        at_most("nothing to do beyond start-up", watch.middle(extra), 2.0, " s", watch.span(extra)),
    ]


def _store(root, name):
    """Environment with a store of its own; Prefect's home is shared."""
    return os.environ | {"GRAVCAL_PRODUCTS": str(root / name), "PREFECT_HOME": str(root / "prefect")}


def _first(root):
    """Folder with the files of the first day alone."""
    folder = root / "first-day"
    folder.mkdir()
    day = min(path.name.split("_")[1] for path in (root / "level1").iterdir())
    for path in (root / "level1").glob(f"*_{day}_*"):
        (folder / path.name).symlink_to(path)
    return folder


def _campaign(command, environment):
    """Wall time of a campaign, and seconds that its events took."""
    start = time.perf_counter()
    summary = json.loads(output([*command, "--json", "-"], environment))
    return time.perf_counter() - start, sum(row["seconds"] for row in summary["events"])


def _simulate(files, count, seed):
    """Level-1 files of as many days."""
    from flows import com_offset

    for number in range(count):
        date = datetime.date(2020, 3, 1) + datetime.timedelta(days=number)
        settings = {"date": date.isoformat()} | ({} if count <= SEVEN else {"manoeuvres": "pitch_high"})
        com_offset.simulate(files, seed=seed + number, truth=None, effects={}, settings=settings)


def _seconds(command, environment):
    """Wall time of a command."""
    start = time.perf_counter()
    output(command, environment)
    return time.perf_counter() - start
