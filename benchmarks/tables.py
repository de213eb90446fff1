"""Aligned tables with every figure beside its target, and a last word on what was met."""

import sys
from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """One measured number and what it should be."""

    name: str  #: what was measured
    value: str  #: as printed
    spread: str = ""  #: its interval, or minimum and maximum, as printed
    target: str = ""  #: as printed, "" where there is none
    met: bool | None = None  #: None where there is no target


def say(text: str = "") -> None:
    """One line, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def title(text: str) -> None:
    """Heading of a benchmark."""
    say(f"\n{text}\n{'-' * len(text)}")


def show(figures: list[Figure], spread: str = "") -> list[Figure]:
    """Print figures as a table, the column of spreads with this heading, and return them."""
    word = {None: "", True: "met", False: "NOT MET"}
    rows = [("figure", "value", spread, "target", "")]
    rows += [(f.name, f.value, f.spread, f.target, word[f.met]) for f in figures]
    grid(rows)
    return figures


def grid(rows: list[tuple[str, ...]]) -> None:
    """Print rows with columns as wide as they need; the first column to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = [cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))]
        say("  ".join(cells).rstrip())


def summary(figures: list[Figure]) -> None:
    """How many targets were met, and which were not."""
    judged = [f for f in figures if f.met is not None]
    missed = [f for f in judged if not f.met]
    title(f"{len(judged) - len(missed)} of {len(judged)} targets met")
    for figure in missed:
        say(f"not met: {figure.name}: {figure.value} {figure.spread}, target {figure.target}")


def at_most(name: str, value: float, limit: float, unit: str = "", spread: str = "") -> Figure:
    """Figure whose target is an upper limit."""
    return Figure(name, f"{value:.3g}{unit}", spread, f"<= {limit:g}{unit}", value <= limit)


def at_least(name: str, value: float, limit: float, unit: str = "", spread: str = "") -> Figure:
    """Figure whose target is a lower limit."""
    return Figure(name, f"{value:.3g}{unit}", spread, f">= {limit:g}{unit}", value >= limit)
