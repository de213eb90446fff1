"""Values of result documents in one form for every calibration: for tables, time lines, comparisons, campaigns."""

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
    unit: str  #: of value, sigma and sigma_total
    #: value and its error by noise alone, None where not determined
    value: float | None
    sigma: float | None
    sigma_total: float | None  #: with all errors; None where it is not known

    @property
    def label(self):
        """Name after the letter of the satellite, if any: "C offset x"."""
        return f"{self.satellite} {self.name}".strip()


def text(known):
    """Text of [Value] with their total errors: "x 107.0 +- 1.9, y 3.6 +- 0.9 um"; undetermined ones are left out."""
    determined = [one for one in known if one.value is not None]
    parts = []
    for one, following in itertools.zip_longest(determined, determined[1:]):
        unit = "" if one.unit == "1" or (following and following.unit == one.unit) else f" {one.unit}"
        parts.append(f"{one.label} {rounded(one.value, one.sigma_total or one.sigma)}{unit}")
    return ", ".join(parts)


def rounded(value, sigma):
    """Text "value +- sigma" with two digits of sigma, with a power of ten where both are small or large."""
    size = max(abs(value), sigma or 0.0)
    if not sigma or sigma < 1e-7 * size:
        return f"{value:.3g}" if not sigma else f"{value:.9g} +- {sigma:.1e}"
    if not 1e-3 <= size < 1e6:
        power = 3 * math.floor(math.log10(size) / 3)
        return f"({rounded(value / 10.0**power, sigma / 10.0**power)})e{power}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:z.{digits}f} +- {sigma:.{digits}f}"


def vector(satellite, prefix, unit, block, names=("value", "sigma", "sigma_total")):
    """Value of x, y, z of a block {name: (3,)} of a document; names of its value, sigma and total sigma."""
    columns = [block.get(name) or [None] * 3 for name in names]
    for axis, *numbers in zip(AXES, *columns, strict=True):
        yield Value(satellite, f"{prefix} {axis}".strip(), unit, *numbers)


def parameters(document):
    """Value of each determined one of "parameters" {name: {"value", "sigma", "unit"}} of a document."""
    for name, one in (document.get("parameters") or {}).items():
        if one is not None:
            yield Value("", name.replace("_", " "), one["unit"], one["value"], one["sigma"], None)


def units(unit: str, names: Sequence[str]) -> list[str]:
    """Unit of each name: from "unit, unit, ..." if there are as many as names, otherwise the same for all."""
    parts = unit.split(", ")
    return parts if len(parts) == len(names) else [unit] * len(names)


def searched(document):
    """Value of each parameter of a calibration after a search, from the document of a discovery."""
    change = document.get("calibration_change") or {"names": (), "unit": "", "after": (), "sigma_after": ()}
    rows = change["names"], units(change["unit"], change["names"]), change["after"], change["sigma_after"]
    for row in zip(*rows, strict=True):
        yield Value("", *row, None)


def printed_vector(unit):
    """Function: Published record of a vector -> rows (axis, unit, value, sigma or None, "") in ``unit``."""

    def rows(one):  # one: catalog.Published
        units = one.unit.split(", ")
        for number, axis in enumerate(AXES):
            factor = METRES[units[number] if len(units) == 3 else units[0]] / METRES[unit]
            sigma = one.sigma[number] * factor if one.sigma else None
            yield axis, unit, one.value[number] * factor, sigma, ""

    return rows
