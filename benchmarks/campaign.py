"""A campaign of simulated events: cold, with nothing to do, and after a changed setting of the last stages."""

from __future__ import annotations

import datetime
import os
import tempfile
import time
from pathlib import Path

from benchmarks import stopwatch as watch
from benchmarks.day import CLI, output
from benchmarks.tables import Figure, at_most, show, title


def run(options) -> list[Figure]:
    """Events in one folder, processed by the command line with two workers."""
    count, rounds = (4, 1) if options.quick else (20, 3)
    title(f"campaign: com_offset, {count} events of seven windows, {options.workers} workers")
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "level1"
        _simulate(files, count, options.seed)
        environment = os.environ | {"GRAVCAL_PRODUCTS": str(Path(folder) / "products")}
        command = [*CLI, "campaign", "com_offset", "--data", str(files), "--workers", str(options.workers)]
        cold = _seconds(command, environment)
        changed = [_seconds([*command, "--set", f"noise_order={19 - i}"], environment) for i in range(rounds)]
        pairs = [(_seconds(command, environment), _seconds([*CLI, "--help"], environment)) for _ in range(rounds)]
    extra = [again - start for again, start in pairs]
    share = [100 * seconds / cold for seconds in changed]
    return show(
        [
            Figure("empty store", f"{cold:.3g} s"),
            Figure("  for each event", f"{cold / count:.3g} s"),
            Figure("noise_order changed: noise, solve, combine, report", f"{watch.middle(changed):.3g} s"),
            at_most("  of the cold run", watch.middle(share), 10.0, " %", watch.span(share)),
            at_most("nothing to do beyond start-up", watch.middle(extra), 2.0, " s", watch.span(extra)),
        ],
        "min .. max",
    )


def _simulate(files, count, seed):
    """Level-1 files of as many days."""
    from flows import com_offset

    for number in range(count):
        date = datetime.date(2020, 3, 1) + datetime.timedelta(days=number)
        settings = {"date": date.isoformat()}
        com_offset.simulate(files, seed=seed + number, truth=None, effects={}, settings=settings)


def _seconds(command, environment):
    """Wall time of a command."""
    start = time.perf_counter()
    output(command, environment)
    return time.perf_counter() - start
