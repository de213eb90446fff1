"""`python -m benchmarks [NAME ...]`: tables of figures, each beside its target."""

import argparse
import importlib
import subprocess
import sys

from benchmarks.tables import say, summary, title

NAMES = {
    "recovery": ("benchmarks.recovery", "run"),
    "adopted": ("benchmarks.recovery", "adopted"),
    "readers": ("benchmarks.speed", "readers"),
    "attitude": ("benchmarks.speed", "attitude"),
    "field": ("benchmarks.speed", "field"),
    "day": ("benchmarks.day", "run"),
    "campaign": ("benchmarks.campaign", "run"),
    "many": ("benchmarks.many", "run"),
    "browse": ("benchmarks.browse", "run"),
    "fuzz": ("benchmarks.fuzz", "run"),
    "mutants": ("benchmarks.mutants", "run"),
    "worlds": ("benchmarks.worlds", "study"),
    "folder": ("benchmarks.worlds", "folder"),
    "joint": ("benchmarks.joint", "run"),
    "others": ("benchmarks.__main__", "others"),
}
HOURS = ("fuzz", "mutants", "worlds", "folder", "joint", "many")  # asked for by name
#: Modules of studies that print tables of their own, and how they are called.
STUDIES = (
    ("kbr_phase_centre", "200"),
    ("inertial_sensor", "200", "50"),
    ("gradient_torque", "speed"),
    ("gradient_torque", "study", "--days", "100"),
)


def others(options) -> list:
    """Studies of the other calibrations, each in a process of its own; none with --quick."""
    for name, *arguments in () if options.quick else STUDIES:
        title(" ".join([name, *arguments]))
        subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *arguments], check=True)
    return []


def main() -> None:
    """Run the benchmarks named, by default all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; all by default")
    parser.add_argument("--quick", action="store_true", help="few runs and rounds, two minutes")
    parser.add_argument("--runs", type=int, help="cases of a study")
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--calibration", help="of the fuzzing, by default all four; of the worlds")
    parser.add_argument("--world", help="that makes the cases: open (of worlds by default), second or own")
    parser.add_argument("--sort", default="clean", help="of the cases: clean, listed or unlisted")
    parser.add_argument("--folder", metavar="DIR", help="of cases without truth")
    parser.add_argument("--out", metavar="PATH", help="for lines of cases, or documents of a folder")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of the fuzzing, or mutant")
    parser.add_argument("--workers", type=int, default=2, help="processes of the recovery studies")
    parser.add_argument("--rounds", type=int, help="how often each thing is timed")
    parser.add_argument("--events", type=int, help="events of the campaign, by default 20")
    parser.add_argument("--windows", action="store_true", help="windows of manoeuvres in the campaign, not days")
    options = parser.parse_args()
    options.rounds = options.rounds or (2 if options.quick else 7)
    if options.names[:1] == ["folder"]:
        options.folder, options.names = options.folder or options.names[-1], ["folder"]
    unknown = [name for name in options.names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; there is {', '.join(NAMES)}")
    from flows.engine import single_threaded

    single_threaded()
    figures = []
    for name in options.names or [one for one in NAMES if one not in HOURS]:
        module, function = NAMES[name]
        figures += getattr(importlib.import_module(module), function)(options)
    summary(figures)
    say()


if __name__ == "__main__":
    main()
