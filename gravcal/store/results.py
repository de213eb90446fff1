"""The numbers that a result document hands on, the same for every calibration: for tables, time lines, comparisons."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

AXES = "xyz"
METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}


@dataclass(frozen=True)
class Value:
    """One number of a result document, null where it is not determined."""

    satellite: str  #: letter where the document is of several, otherwise ""
    name: str  #: such as "x", "offset x", "k z"
    unit: str  #: of all three
    #: value, sigma: with its error by noise
    value: float | None
    sigma: float | None
    sigma_total: float | None  #: with all errors; None where it is not known

    @property
    def label(self):
        """Name with the satellite."""
        return f"{self.satellite} {self.name}".strip()


def text(known):
    """Values with their total errors on one line: "x 107.0 +- 1.9, y 3.6 +- 0.9 um"."""
    said = [one for one in known if one.value is not None]
    parts = []
    for one, following in itertools.zip_longest(said, said[1:]):
        unit = "" if one.unit == "1" or (following and following.unit == one.unit) else f" {one.unit}"
        parts.append(f"{one.label} {rounded(one.value, one.sigma_total or one.sigma)}{unit}")
    return ", ".join(parts)


def rounded(value, sigma):
    """Value with two digits of its error, both with a power of ten where they are small or large."""
    size = max(abs(value), sigma or 0.0)
    if not sigma or sigma < 1e-7 * size:
        return f"{value:.3g}" if not sigma else f"{value:.9g} +- {sigma:.1e}"
    if not 1e-3 <= size < 1e6:
        power = 3 * math.floor(math.log10(size) / 3)
        return f"({rounded(value / 10.0**power, sigma / 10.0**power)})e{power}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:.{digits}f} +- {sigma:.{digits}f}"


def vector(satellite, prefix, unit, block, names=("value", "sigma", "sigma_total")):
    """Values of the three axes of a block of a document."""
    columns = [block.get(name) or [None] * 3 for name in names]
    for axis, *numbers in zip(AXES, *columns, strict=True):
        yield Value(satellite, f"{prefix} {axis}".strip(), unit, *numbers)


def parameters(document):
    """Determined ones of the named parameters of a document."""
    for name, one in (document.get("parameters") or {}).items():
        if one is not None:
            yield Value("", name.replace("_", " "), one["unit"], one["value"], one["sigma"], None)


def units(unit: str, names: Sequence[str]) -> list[str]:
    """Unit of each parameter of a result, where they differ in the order of the names."""
    parts = unit.split(", ")
    return parts if len(parts) == len(names) else [unit] * len(names)


def searched(document):
    """Parameters of a calibration after a search."""
    change = document.get("calibration_change") or {"names": (), "unit": "", "after": (), "sigma_after": ()}
    rows = change["names"], units(change["unit"], change["names"]), change["after"], change["sigma_after"]
    for row in zip(*rows, strict=True):
        yield Value("", *row, None)


def printed_vector(unit):
    """Function that gives the rows of a printed vector: panel, unit, value, sigma, remark."""

    def rows(one):
        units = one.unit.split(", ")
        for number, axis in enumerate(AXES):
            factor = METRES[units[number] if len(units) == 3 else units[0]] / METRES[unit]
            sigma = one.sigma[number] * factor if one.sigma else None
            yield axis, unit, one.value[number] * factor, sigma, ""

    return rows
