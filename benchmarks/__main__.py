"""`python -m benchmarks [NAME ...]`: tables of figures, each beside its target."""

import argparse
import importlib
from pathlib import Path

from flows.engine import single_threaded

single_threaded()  # before numpy: processor time of several threads would count them all, and their waiting

from benchmarks.tables import summary  # noqa: E402

#: Module and function of each study; run without being asked for by name: always, or not with --quick ("whole").
NAMES = {
    "recovery": ("recovery", "recovery", "always"),
    "heads": ("recovery", "heads", ""),
    "readers": ("speed", "readers", "always"),
    "attitude": ("speed", "attitude", "always"),
    "field": ("speed", "field", "always"),
    "campaign": ("campaign", "campaign", "always"),
    "browse": ("browse", "browse", "always"),
    "kbr_phase_centre": ("kbr_phase_centre", "recovery", "whole"),
    "swings": ("inertial_sensor", "swings", "whole"),
    "rolls": ("inertial_sensor", "rolls", "whole"),
    "gradient": ("gradient_torque", "gradient_speed", "whole"),
    "drag": ("gradient_torque", "drag", "whole"),
    "swing_bound": ("inertial_sensor", "swing_bound", ""),
    "long_roll": ("inertial_sensor", "long_roll", ""),
    "degrees": ("gradient_torque", "degrees", ""),
    "ranging": ("ranging", "ranging", ""),
    "measured": ("measured", "measured", ""),
    "papers": ("papers", "papers", ""),
    "published_methods": ("published_methods", "published_methods", ""),
    "fuzz": ("fuzz", "fuzz", ""),
    "mutants": ("mutants", "mutants", ""),
    "joint": ("joint", "run", ""),
    "worlds": ("worlds", "study", ""),
    "folder": ("worlds", "folder", ""),
}


def options_of(words: list[str] | None = None) -> argparse.Namespace:
    """Names of studies, and options, of which each takes those that mean something to it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; by default what takes minutes"
    )
    parser.add_argument("--quick", action="store_true", help="few runs and rounds, two minutes")
    parser.add_argument("--runs", type=int, help="cases of a study: events, days, swings, rolls, mutants")
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--set", action="append", default=[], metavar="SETTING=VALUE", help="of the simulation")
    parser.add_argument("--calibration", help="of the fuzzing and the published methods, by default all; of the worlds")
    parser.add_argument("--world", help="that makes the cases: open (of worlds by default), second or own")
    parser.add_argument(
        "--sort",
        default="clean",
        help="of the cases: clean, listed, unlisted, or clean with changing, tailed or bumped noise",
    )
    parser.add_argument("--data", type=Path, metavar="DIR", help="measured days, files of the long roll")
    parser.add_argument("--out", metavar="PATH", help="for lines of cases, documents of a folder, figures")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of the fuzzing, or mutant")
    parser.add_argument("--workers", type=int, default=2, help="processes that run cases")
    parser.add_argument("--events", type=int, help="of the campaign, by default 20, and of the joint search")
    options = parser.parse_args(words)
    options.rounds = 2 if options.quick else 7
    options.settings = dict(text.split("=", 1) for text in options.set)
    if options.names[:1] == ["folder"]:
        options.folder, options.names = options.names[-1], ["folder"]
    unknown = [name for name in options.names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; there is {', '.join(NAMES)}")
    wanted = ("always",) if options.quick else ("always", "whole")
    options.names = options.names or [name for name, (*_, when) in NAMES.items() if when in wanted]
    return options


def main() -> None:
    """Run the benchmarks named."""
    options, figures = options_of(), []
    for name in options.names:
        module, function, _ = NAMES[name]
        figures += getattr(importlib.import_module(f"benchmarks.{module}"), function)(options)
    summary(figures)


if __name__ == "__main__":
    main()
