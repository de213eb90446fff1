"""A campaign of simulated events, cold, with nothing to do, after a changed setting."""

import datetime
import json
import os
import tempfile
import time
from pathlib import Path

from benchmarks import stopwatch as watch
from benchmarks.tables import CLI, Figure, at_least, at_most, cases, show, title

SEVEN = 60  # up to so many events have all seven windows; more have one
TWICE = 2  # cold runs with all workers and with one
LONG_S = 4.0  # of work on an event, from which two workers have to be worth it


def campaign(options) -> list[Figure]:
    """Events in one folder, processed by the command line with two workers.

    Targets are for twenty whole days of 200 MB, as satellites deliver them: events of five seconds.
    """
    count, rounds = (4, 1) if options.quick else (20, 5)
    count = options.events or count
    whole = not (options.windows or options.quick or count > SEVEN)
    windows, span = "seven windows" if count <= SEVEN else "one window", " in whole days" if whole else ""
    load = f"load {os.getloadavg()[0]:.1f}"
    title(f"campaign: com_offset, {count} events of {windows}{span}, {options.workers} workers; {load}")
    begun, stolen = time.perf_counter(), watch.stolen()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        settings = {"manoeuvres": "pitch_high"} if count > SEVEN else {}
        settings |= {"span": "day"} if whole else {}
        days = [(root / "level1", options.seed + number, number, settings) for number in range(count)]
        list(cases(_day, days, options.workers))
        command = [*CLI, "campaign", "com_offset", "--data", str(root / "level1")]
        figures, cold = _cold(command, root, count, options)
        command = [*command, "--workers", str(options.workers)]
        figures += _again(command, _store(root, "products"), (cold, count, whole), rounds)
    share = 100 * (watch.stolen() - stolen) / (time.perf_counter() - begun) / os.cpu_count()
    figures.append(Figure("processor time that the host gave to others", f"{share:.2g} %"))
    return show(figures, "min .. max")


def _day(job):
    """Level-1 files of one day."""
    from flows import com_offset

    files, seed, number, settings = job
    date = datetime.date(2020, 3, 1) + datetime.timedelta(days=number)
    settings = {"date": date.isoformat()} | settings
    com_offset.CALIBRATION.simulate(files, seed=seed, truth=None, effects={}, settings=settings)


def _store(root, name):
    """Environment with a store of its own; Prefect's home is shared."""
    return os.environ | {"GRAVCAL_PRODUCTS": str(root / name), "PREFECT_HOME": str(root / "prefect")}


def _run(command, environment):
    """Wall seconds of a campaign, processor seconds of the machine meanwhile, and seconds that its events took."""
    wall, _, machine, text = watch.command([*command, "--json", "-"], environment)
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
    rounds, peer, together, alone = 1 if options.quick or count >= 200 else TWICE, [], [], []
    for k in range(rounds):
        store = _store(root, "products" if k == 0 else f"products{k}")
        together.append(_run([*command, "--workers", str(options.workers)], store))
        if rounds > 1:
            peer.append(watch.speed_up(options.workers))
            alone.append(_run([*command, "--workers", "1"], _store(root, f"alone{k}")))
    cold, processor, busy = min(together)
    share = 100 * (1 - busy / (options.workers * cold))
    figures = [
        Figure("empty store", f"{cold:.3g} s", watch.span([run[0] for run in together])),
        Figure("  for each event", f"{cold / count:.3g} s"),
        Figure("  processor time of the machine for each event", f"{processor / count:.3g} s"),
        Figure("  work on one event", f"{busy / count:.3g} s"),
    ]
    if count >= 200:
        figures.append(at_most("  orchestration, waiting of workers included", share, 10.0, " %"))
    elif alone:
        one, _, work = min(alone)
        least = at_least if work / count > LONG_S else _untargeted
        figures += [
            Figure("empty store, one worker", f"{one:.3g} s", watch.span([run[0] for run in alone])),
            Figure("  work on one event", f"{work / count:.3g} s"),
            Figure("  speed-up if nothing but the events took time", f"{options.workers * work / busy:.3g}"),
            watch.seconds("  speed-up of plain numpy meanwhile", peer, ""),
            least(f"  speed-up of {options.workers} workers", one / cold, 1.6),
        ]
    return figures, (cold, processor)


def _again(command, environment, first, rounds):
    """Figures of runs that find what they need, wholly or in part."""
    cold, count, whole = first
    most = at_most if count == 20 else _untargeted
    changed = [watch.command([*command, "--set", f"noise_order={19 - i}"], environment) for i in range(rounds)]
    pairs = [[watch.command(one, environment)[0] for one in (command, [*CLI, "--help"])] for _ in range(rounds)]
    extra = [again - start for again, start in pairs]
    wall, processor = ([100 * spent[place] / cold[i] for spent in changed] for i, place in enumerate((0, 2)))
    share = most if whole else _untargeted
    return [
        watch.seconds("noise_order changed: noise, solve, combine, report", [spent[0] for spent in changed]),
        share("  of the cold run", watch.middle(wall), 10.0, " %", watch.span(wall)),
        watch.seconds("  of its processor time", processor, "%"),
        most("nothing to do beyond start-up", watch.middle(extra), 2.0, " s", watch.span(extra)),
    ]


def _untargeted(name, value, _, unit="", span=""):
    """Figure of a campaign that its target is not meant for."""
    return Figure(name, f"{value:.3g}{unit}", span)
