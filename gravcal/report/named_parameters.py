"""Report of a calibration whose result is named parameters of different units: document, tables, figure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.calibrations.checks import of_product
from gravcal.report import documents
from gravcal.report.figures import COLOURS, grid
from gravcal.report.pages import Figure, Section, Table, page
from gravcal.report.plain import NOT_DETERMINED, as_plain, gps_text, number
from gravcal.store import results
from gravcal.store.schemas import VERSION

SAID = 9  # parameters that a verdict names


def document(found: xr.Dataset) -> dict:
    """Part of a result document of PARAMETERS: by name, null where not determined, and their covariance."""
    names = [str(name) for name in found["parameter"].values]
    columns = (found[name].values for name in ("unit", "value", "sigma"))
    parameters = {
        n: {"value": float(v), "sigma": float(s), "unit": str(u)} if np.isfinite(v) else None
        for n, u, v, s in zip(names, *columns, strict=True)
    }
    matrix = [[number(value) for value in row] for row in found["covariance"].values]
    return {"parameters": parameters, "covariance": {"parameters": names, "matrix": matrix}}


@dataclass(frozen=True)
class Page:
    """What a calibration says beside its parameters."""

    calibration: str
    heading: str
    verdict: str  #: what the values are of, such as "Gain of the impulses"
    products: Sequence[str]  #: stages that the report reads, in their order; among them "estimate" and "checks"
    #: {stage: Dataset} -> facts, plain numbers with units in their names, and sections after the result
    content: Callable[[Mapping[str, xr.Dataset]], tuple[dict, list[Section]]]
    #: {stage: Dataset} -> more of the document by name, and a sentence of the verdict on it
    more: Callable[[Mapping[str, xr.Dataset]], tuple[dict, str]] = lambda _: ({}, "")


def report(own: Page, *given: xr.Dataset, event: str, settings: Mapping) -> tuple[xr.Dataset, dict[str, str]]:
    """Report product of one event and its files, from the products that the page names and all settings."""
    products = dict(zip(own.products, given, strict=True))
    facts, sections = own.content(products)
    more, sentence = own.more(products)
    found = products["estimate"]
    parameters = document(found)
    known = list(results.parameters(parameters))
    text = results.text(known[:SAID]) if known else "no parameter is determined"
    text += f", and {len(known) - SAID} more" if len(known) > SAID else ""
    first = {
        "schema_version": VERSION,
        "status": "delivered",
        "calibration": own.calibration,
        "event": event,
        "verdict": {"text": f"{own.verdict}: {text}.{sentence}"},
    }
    tail = {"settings": as_plain(settings), "provenance": documents.traced(own.calibration, products)}
    made = first | parameters | as_plain(more) | {"facts": as_plain(facts)} | tail
    made, files = documents.delivered(made, list(products.values()), of_product(products["checks"]))
    start, parts = gps_text(float(found["part_start"][0])), found.sizes["part"]
    table = parameter_table(parameters["parameters"], "estimate")
    figure = Figure(draw_parts, ("estimate",), "Each part of the record by itself (points), and all (line, band).")
    stated = [[name.replace("_", " "), _short(value)] for name, value in facts.items()]
    about = Section("Record", [Table("Facts of the record.", ["fact", "value"], stated, words=(0,))])
    shown = [Section("Result", [table], [figure]), *sections, about]
    subtitle = f"From {start} GPS, {parts} parts."
    files["report.html"] = page(made, shown, products, heading=own.heading, subtitle=subtitle)
    return build(schemas.of("shared.toml")["report"], {"delivered": 1}, event=event), files


def parameter_table(parameters: Mapping, read: str) -> Table:
    """Named parameters of a document, as read from the product of that name."""
    heads, rows = ["parameter", "value", "σ", "unit"], [_row(name, one) for name, one in parameters.items()]
    return Table("Parameters with their errors by noise.", heads, rows, reads=(read,), words=(0, 3))


def _row(name, one):
    label = name.replace("_", " ")
    return (
        [label, NOT_DETERMINED, "", ""] if one is None else [label, *_rounded(one["value"], one["sigma"]), one["unit"]]
    )


def _rounded(value, sigma):
    """Value and sigma with two digits of sigma."""
    if not 1e-3 <= sigma < 1e4:
        power = int(np.floor(np.log10(abs(value) if abs(value) > sigma else sigma)))
        digits = max(0, 1 + power - int(np.floor(np.log10(sigma))))
        return f"{value:+.{digits}e}", f"{sigma:.1e}"
    digits = max(0, 1 - int(np.floor(np.log10(sigma))))
    return f"{value:+.{digits}f}", f"{sigma:.{digits}f}"


def _short(value):
    """Number or numbers with four digits."""
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_short, value))
    return NOT_DETERMINED if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def draw_parts(found: xr.Dataset):
    """Determined PARAMETERS from each part of the record, and from all of it."""
    known = np.flatnonzero(np.isfinite(found["value"].values))
    if not known.size or found.sizes["part"] < 2:
        return None
    columns = min(known.size, 3)
    rows = -(-known.size // columns)
    figure, panels = grid(rows, columns, 0.5 + 1.25 * rows, sharex=True, margins={"hspace": 0.45, "wspace": 0.4})
    number = 1 + np.arange(found.sizes["part"])
    for panel in panels.ravel()[known.size :]:
        panel.set_visible(False)
    for panel, index in zip(panels.ravel(), known, strict=False):
        value, sigma = float(found["value"][index]), float(found["sigma"][index])
        name, unit = str(found["parameter"].values[index]).replace("_", " "), str(found["unit"].values[index])
        scale = 10.0 ** (3 * np.floor(np.log10(max(abs(value), sigma)) / 3)) if max(abs(value), sigma) < 1e-2 else 1.0
        own, error = found["part_value"].values[:, index] / scale, found["part_sigma"].values[:, index] / scale
        panel.errorbar(number, own, error, color=COLOURS["blue"], marker="o", markersize=3, linestyle="none")
        panel.axhline(value / scale, color=COLOURS["vermilion"])
        panel.axhspan((value - sigma) / scale, (value + sigma) / scale, color=COLOURS["vermilion"], alpha=0.2)
        sized = unit if scale == 1.0 else f"{scale:.0e} {unit}" if unit != "1" else f"{scale:.0e}"
        panel.set_title(f"{name}{'' if sized == '1' else f', {sized}'}")
    for panel in panels[-1]:
        panel.set_xlabel("part")
    return figure
