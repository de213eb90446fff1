"""A campaign of simulated events: cold, with nothing to do, and after a changed setting of the last stages."""

import datetime
import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks import stopwatch as watch
from benchmarks.day import CLI, output
from benchmarks.tables import Figure, at_least, at_most, show, title

SEVEN = 60  # up to so many events have all seven windows; more have one
TWICE = 2  # cold runs with all workers and with one
LONG_S = 4.0  # of work on an event, from which two workers have to be worth it


def run(options) -> list[Figure]:
    """Events in one folder, processed by the command line with two workers.

    Targets are for twenty whole days of 200 MB, as satellites deliver them: events of five seconds.
    """
    count, rounds = (4, 1) if options.quick else (20, 5)
    count = options.events or count
    whole = not (options.windows or options.quick or count > SEVEN)
    windows = "seven windows" if count <= SEVEN else "one window"
    span = " in whole days" if whole else ""
    load = f"load {os.getloadavg()[0]:.1f}"
    title(f"campaign: com_offset, {count} events of {windows}{span}, {options.workers} workers; {load}")
    begun, stolen = time.perf_counter(), watch.stolen()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        _simulate(root / "level1", count, options, whole)
        command = [*CLI, "campaign", "com_offset", "--data", str(root / "level1")]
        figures = _cold(command, root, count, options)
        cold, command = figures.pop(), [*command, "--workers", str(options.workers)]
        figures += _again(command, _store(root, "products"), (cold, count, whole), rounds)
    share = 100 * (watch.stolen() - stolen) / (time.perf_counter() - begun) / os.cpu_count()
    figures.append(Figure("processor time that the host gave to others", f"{share:.2g} %"))
    return show(figures, "min .. max")


def _cold(command, root, count, options):
    """Figures of runs on empty stores with all workers and with one; at the end wall and processor of the first.

    Both are run in turn and twice, and the faster of each counts: what others do on the host only ever adds time.
    """
    _campaign(
        [*command[:-1], str(_first(root)), "--workers", "1"], _store(root, "first")
    )  # migrates Prefect's database
    rounds, peer = range(1 if options.quick or count >= 200 else TWICE), []
    together, alone = [], []
    for k in rounds:
        store = _store(root, "products" if k == 0 else f"products{k}")
        together.append(_campaign([*command, "--workers", str(options.workers)], store))
        if len(rounds) > 1:
            peer.append(watch.speed_up(options.workers))
            alone.append(_campaign([*command, "--workers", "1"], _store(root, f"alone{k}")))
    ((cold, processor), busy), walls = min(together), [one[0][0] for one in together]
    share = 100 * (1 - busy / (options.workers * cold))
    figures = [
        Figure("empty store", f"{cold:.3g} s", watch.span(walls)),
        Figure("  for each event", f"{cold / count:.3g} s"),
        Figure("  processor time of the machine for each event", f"{processor / count:.3g} s"),
        Figure("  work on one event", f"{busy / count:.3g} s"),
    ]
    if count >= 200:
        figures.append(at_most("  orchestration, waiting of workers included", share, 10.0, " %"))
    elif alone:
        figures += _speed_up((cold, busy), alone, peer, (count, options.workers))
    return [*figures, (cold, processor)]


def _speed_up(together, alone, peer, counts):
    """Figures of one worker beside several, and of plain numpy in as many processes."""
    (cold, busy), (count, workers) = together, counts
    (one, _), work = min(alone)
    least = at_least if work / count > LONG_S else _untargeted
    return [
        Figure("empty store, one worker", f"{one:.3g} s", watch.span([run[0][0] for run in alone])),
        Figure("  work on one event", f"{work / count:.3g} s"),
        Figure("  speed-up if nothing but the events took time", f"{workers * work / busy:.3g}"),
        Figure("  speed-up of plain numpy meanwhile", f"{np.mean(peer):.3g}", watch.span(peer)),
        least(f"  speed-up of {workers} workers", one / cold, 1.6),
    ]


def _again(command, environment, first, rounds):
    """Figures of runs that find what they need, wholly or in part."""
    cold, count, whole = first
    most = at_most if count == 20 else _untargeted
    share = most if whole else _untargeted
    changed = [_spent([*command, "--set", f"noise_order={19 - i}"], environment)[0] for i in range(rounds)]
    commands = command, [*CLI, "--help"]
    pairs = [[_spent(one, environment)[0][0] for one in commands] for _ in range(rounds)]
    extra = [again - start for again, start in pairs]
    wall, processor = ([100 * spent[i] / cold[i] for spent in changed] for i in (0, 1))
    return [
        Figure("noise_order changed: noise, solve, combine, report", f"{watch.middle([c[0] for c in changed]):.3g} s"),
        share("  of the cold run", watch.middle(wall), 10.0, " %", watch.span(wall)),
        Figure("  of its processor time", f"{watch.middle(processor):.3g} %", watch.span(processor)),
        most("nothing to do beyond start-up", watch.middle(extra), 2.0, " s", watch.span(extra)),
    ]


def _untargeted(name, value, _, unit="", span=""):
    """Figure of a campaign that its target is not meant for."""
    return Figure(name, f"{value:.3g}{unit}", span)


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
    """Wall and processor time of a campaign, and seconds that its events took."""
    spent, text = _spent([*command, "--json", "-"], environment)
    return spent, sum(row["seconds"] for row in json.loads(text)["events"])


def _simulate(files, count, options, whole):
    """Level-1 files of as many days."""
    settings = {"manoeuvres": "pitch_high"} if count > SEVEN else {}
    settings |= {"span": "day"} if whole else {}
    with ProcessPoolExecutor(options.workers) as pool:
        list(pool.map(_day, *zip(*[(files, options.seed, number, settings) for number in range(count)], strict=True)))


def _day(files, seed, number, settings):
    """Level-1 files of one day."""
    from flows import com_offset

    date = datetime.date(2020, 3, 1) + datetime.timedelta(days=number)
    settings = {"date": date.isoformat()} | settings
    com_offset.CALIBRATION.simulate(files, seed=seed + number, truth=None, effects={}, settings=settings)


def _spent(command, environment):
    """Wall seconds of a command, processor seconds of the machine meanwhile, and what it printed."""
    start, before = time.perf_counter(), watch.busy()
    text = output(command, environment)
    return (time.perf_counter() - start, watch.busy() - before), text
