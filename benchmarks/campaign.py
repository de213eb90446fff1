"""A campaign of simulated days, cold with all workers and with one, after a changed setting, with nothing to do."""

import datetime
import json
import os
import tempfile
import time
from pathlib import Path

from benchmarks import tables as watch
from benchmarks.tables import CLI, Figure, at_least, at_most, cases, show, title

TWICE = 2  # cold runs with all workers and with one


def campaign(options) -> list[Figure]:
    """Events in one folder, processed by the command line with two workers.

    Targets are for twenty whole days of 200 MB, as satellites deliver them: events of five seconds.
    """
    count, rounds = options.events or (4 if options.quick else 20), 1 if options.quick else 5
    span = {} if options.quick else {"span": "day"}
    kind, load = "windows" if options.quick else "whole days", f"load {os.getloadavg()[0]:.1f}"
    title(f"campaign: com_offset, {count} events, {kind}, {options.workers} workers; {load}")
    begun, stolen = time.perf_counter(), watch.stolen()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        list(cases(_day, [(root / "level1", options.seed + k, k, span) for k in range(count)], options.workers))
        command = [*CLI, "campaign", "com_offset", "--data", str(root / "level1")]
        figures, cold = _cold(command, root, count, options)
        figures += _again([*command, "--workers", str(options.workers)], _store(root, "products0"), cold, rounds)
    share = 100 * (watch.stolen() - stolen) / (time.perf_counter() - begun) / os.cpu_count()
    figures.append(Figure("processor time that the host gave to others", f"{share:.2g} %"))
    figures = figures if span and count == 20 else [Figure(f.name, f.value, f.spread) for f in figures]
    return show(figures, "min .. max")


def _day(job):
    """Level-1 files of one day."""
    from flows import com_offset

    files, seed, number, span = job
    settings = span | {"date": str(datetime.date(2020, 3, 1) + datetime.timedelta(days=number))}
    com_offset.CALIBRATION.simulate(files, seed=seed, truth=None, effects={}, settings=settings)


def _store(root, name):
    """Environment with a store of its own; Prefect's home is shared."""
    return os.environ | {"GRAVCAL_PRODUCTS": str(root / name), "PREFECT_HOME": str(root / "prefect")}


def _run(command, environment):
    """Wall seconds of a campaign, processor seconds of the machine meanwhile, and seconds that its events took."""
    wall, machine, text = watch.command([*command, "--json", "-"], environment)
    return wall, machine, sum(row["seconds"] for row in json.loads(text)["events"])


def _cold(command, root, count, options):
    """Figures of runs on empty stores with all workers and with one; wall and processor seconds of the first.

    Both are run in turn and twice, and the faster of each counts: what others do on the host only ever adds time.
    """
    first = root / "first-day"
    first.mkdir()
    day = min(path.name.split("_")[1] for path in (root / "level1").iterdir())
    for path in (root / "level1").glob(f"*_{day}_*"):
        (first / path.name).symlink_to(path)
    _run([*command[:-1], str(first), "--workers", "1"], _store(root, "first"))  # migrates Prefect's database
    together, alone = [], []
    for k in range(1 if options.quick else TWICE):
        together.append(_run([*command, "--workers", str(options.workers)], _store(root, f"products{k}")))
        alone.append(_run([*command, "--workers", "1"], _store(root, f"alone{k}")))
    (cold, processor, busy), (one, _, work) = min(together), min(alone)
    return [
        Figure("empty store", f"{cold:.3g} s", watch.span([run[0] for run in together])),
        Figure("  for each event", f"{cold / count:.3g} s"),
        Figure("  processor time of the machine for each event", f"{processor / count:.3g} s"),
        Figure("  work on one event", f"{busy / count:.3g} s"),
        Figure("empty store, one worker", f"{one:.3g} s", watch.span([run[0] for run in alone])),
        Figure("  work on one event", f"{work / count:.3g} s"),
        Figure("  speed-up if nothing but the events took time", f"{options.workers * work / busy:.3g}"),
        at_least(f"  speed-up of {options.workers} workers", one / cold, 1.5),
    ], (cold, processor)


def _again(command, environment, cold, rounds):
    """Figures of runs that find what they need, wholly or in part."""
    changed = [watch.command([*command, "--set", f"noise_order={19 - i}"], environment) for i in range(rounds)]
    nothing = [watch.command(command, environment)[0] for _ in range(rounds)]
    wall, processor = ([100 * spent[place] / whole for spent in changed] for place, whole in enumerate(cold))
    return [
        watch.seconds("noise_order changed: noise, solve, combine, report", [spent[0] for spent in changed]),
        at_most("  of the cold run", watch.middle(wall), 25.0, " %", watch.span(wall)),
        watch.seconds("  of its processor time", processor, "%"),
        at_most("nothing to do", watch.middle(nothing), 3.0, " s", watch.span(nothing)),
    ]
