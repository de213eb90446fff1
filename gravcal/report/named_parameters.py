"""Report of a calibration whose result is named parameters of different units: document, tables, figure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.schemas import build
from gravcal.report import pages
from gravcal.report.figures import COLOURS, bars, grid
from gravcal.report.pages import Section, Table, figure
from gravcal.report.plain import NOT_DETERMINED, gps_text, measured, numbers, prefixed
from gravcal.store import results

SAID = 9  # parameters that a verdict names


def document(estimate: xr.Dataset) -> dict:
    """{"parameters": as of `parameters`, "covariance": {"parameters": names, "matrix": (p, p)}} of an estimate."""
    known, matrix = parameters(estimate), numbers(estimate["covariance"].values)
    return {"parameters": known, "covariance": {"parameters": [*known], "matrix": matrix}}


def parameters(fit: xr.Dataset, before: str = "") -> dict[str, dict | None]:
    """{parameter: {"value", "sigma", "unit"}, None where not determined}; before: prefix of the variables read."""
    rows = zip(*(fit[name].values for name in ("parameter", "unit", f"{before}value", f"{before}sigma")), strict=True)
    known = lambda v, s, u: {"value": float(v), "sigma": float(s), "unit": str(u)} if np.isfinite(v) else None  # noqa: E731
    return {str(name): known(value, sigma, unit) for name, unit, value, sigma in rows}


@dataclass(frozen=True)
class Page:
    """Texts and functions by which a calibration adds to the report of its parameters."""

    calibration: str
    heading: str
    verdict: str  #: what the values are of, such as "Gain of the impulses"
    #: stages that the report reads, "estimate" and "checks" among them; the last may be missing
    products: Sequence[str]
    #: {stage: Dataset} -> facts, plain numbers with units in their names, and sections after the result
    content: Callable[[Mapping[str, xr.Dataset]], tuple[dict, list[Section]]]
    #: {stage: Dataset} -> more of the document by name, and a sentence of the verdict on it
    more: Callable[[Mapping[str, xr.Dataset]], tuple[dict, str]] = lambda _: ({}, "")


def report(own: Page, *datasets: xr.Dataset, event: str, settings: Mapping) -> tuple[xr.Dataset, dict[str, str]]:
    """(report Dataset, {file: text}) of one event; datasets are those of ``own.products``, in that order."""
    products = dict(zip(own.products, datasets, strict=False))
    facts, sections = own.content(products)
    more, sentence = own.more(products)
    estimate = products["estimate"]
    solved = document(estimate)
    determined = list(results.parameters(solved))
    text = results.text(determined[:SAID]) if determined else "no parameter is determined"
    text += f", and {len(determined) - SAID} more" if len(determined) > SAID else ""
    body = {"status": "delivered", "verdict": {"text": f"{own.verdict}: {text}.{sentence}"}, "facts": facts}
    stated = [[name.replace("_", " "), _short(value)] for name, value in facts.items()]
    page_sections = [
        Section("Result", [parameter_table(solved["parameters"], "estimate")], [by_part]),
        *sections,
        Section("Record", [Table("Facts of the record.", ["fact", "value"], stated)]),
    ]
    subtitle = f"From {gps_text(float(estimate['part_start'][0]))} GPS, {estimate.sizes['part']} parts."
    about = {"event": event, "settings": settings, "heading": own.heading, "subtitle": subtitle}
    checks, entries = of_product(products["checks"]), body | solved | more
    _, files = pages.report(own.calibration, entries, products, checks, lambda _: page_sections, **about)
    return build(schemas.of("shared.toml")["report"], {"delivered": 1}, event=event), files


def parameter_table(parameters: Mapping, read: str) -> Table:
    """Table of named parameters {name: {"value", "sigma", "unit"} or None}; read: name of their product."""
    rows = [[name.replace("_", " "), *cells(one)] for name, one in parameters.items()]
    caption = "Parameters with their errors by noise."
    return Table(caption, ["parameter", "value ± σ", "unit"], rows, reads=(read,), words=(0, 2))


def cells(one: Mapping | None) -> tuple[str, str]:
    """("value ± sigma", unit) of a parameter {"value", "sigma", "unit"}, None: not determined."""
    return measured(**one) if one else (NOT_DETERMINED, "")


def _short(value):
    """Text of a number, or numbers, with four digits."""
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_short, value))
    return NOT_DETERMINED if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


@figure("estimate", caption="Each part of the record by itself (points), and all (line, band).")
def by_part(estimate):
    """Figure with a panel for each determined parameter: its value by part of the record; None with one part."""
    known = np.flatnonzero(np.isfinite(estimate["value"].values))
    if not known.size or estimate.sizes["part"] < 2:
        return None
    columns = min(known.size, 3)
    rows = -(-known.size // columns)
    figure, panels = grid(rows, columns, 0.5 + 1.25 * rows, sharex=True, margins={"hspace": 0.45, "wspace": 0.4})
    number = 1 + np.arange(estimate.sizes["part"])
    for panel in panels.ravel()[known.size :]:
        panel.set_visible(False)
    for panel in panels.ravel()[known.size - columns : known.size]:  # the lowest of each column
        panel.set_xlabel("part")
        panel.tick_params(labelbottom=True)
    for panel, index in zip(panels.ravel(), known, strict=False):
        value, sigma = float(estimate["value"][index]), float(estimate["sigma"][index])
        name, unit = str(estimate["parameter"].values[index]).replace("_", " "), str(estimate["unit"].values[index])
        factor, unit_text = prefixed(max(abs(value), sigma), unit)
        part_value, error = (factor * estimate[f"part_{which}"].values[:, index] for which in ("value", "sigma"))
        bars(panel, number, part_value, error, color=COLOURS["blue"], markersize=3, capsize=0)
        panel.axhline(factor * value, color=COLOURS["vermilion"])
        panel.axhspan(factor * (value - sigma), factor * (value + sigma), color=COLOURS["vermilion"], alpha=0.2)
        panel.set_title(", ".join(text for text in (name, unit_text) if text))
    return figure
