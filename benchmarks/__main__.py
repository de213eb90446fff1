"""`python -m benchmarks [NAME ...]`: tables of figures, each beside its target."""

import argparse
import importlib
from pathlib import Path

from flows.engine import single_threaded

single_threaded()  # before numpy: processor time of several threads would count them all, and their waiting

from benchmarks.tables import STUDIES, summary  # noqa: E402

NAMES = STUDIES["names"]
TYPES = {"int": int, "path": Path}


def options_of(words: list[str] | None = None) -> argparse.Namespace:
    """Names of studies, and options, of which each takes those that mean something to it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; by default what takes minutes"
    )
    for name, given in STUDIES["options"].items():
        parser.add_argument(f"--{name}", **given | ({"type": TYPES[given["type"]]} if "type" in given else {}))
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
