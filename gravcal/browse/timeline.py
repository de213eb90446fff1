"""Results over the years: one panel for each component, with errors, verdicts, mass trims and printed values."""

import datetime
import re
from dataclasses import dataclass

from gravcal import catalog
from gravcal.browse import store_index
from gravcal.errors import CatalogError
from gravcal.report.documents import WITH_RESULT
from gravcal.report.plain import EPOCH, csv_text

CATALOGUE = (
    *("event", "calibration", "satellite", "date", "origin", "status"),
    *("quantity", "value", "sigma", "sigma_total", "unit", "verdict", "report", "document", "product"),
)


@dataclass(frozen=True)
class Point:
    """One value with its error: a result of this store, or a printed value."""

    satellite: str  #: letter or letters
    panel: str  #: name of the quantity, "x"
    unit: str
    date: datetime.datetime
    value: float
    sigma: float | None  #: total where known, else by noise
    event: str
    mood: str  #: key of `plots.MOODS`: verdict, origin or "printed"
    said: str  #: verdict, or source of a printed value


def points(calibration) -> list[Point]:
    """[Point] of all reports of a calibration with a result, by date."""
    ours = []
    for row, one in _values(calibration):
        mood = "questionable" if row["document"]["status"] == "questionable" else row["mood"]
        mood = mood if row["origin"] == "measured" else row["origin"]
        place = one.satellite or letters_of(row["event"]), one.name, one.unit.replace("um", "µm")
        date, sigma = _date(row["document"], row["event"]), one.sigma_total or one.sigma
        ours.append(Point(*place, date, one.value, sigma, row["event"], mood, row["said"]))
    return sorted(ours, key=lambda point: (point.date, point.event))


def _values(calibration):
    """(row of `store_index.results`, `results.Value`) of every determined value of a calibration."""
    for row in store_index.results():
        if row["calibration"] == calibration.name and (row["document"] or {}).get("status") in WITH_RESULT:
            yield from ((row, one) for one in calibration.result(row["document"]) if one.value is not None)


def delivered(calibrations, link) -> list[dict]:
    """[dict with the keys `CATALOGUE`] of every delivered value of the operational configuration.

    Calibrations are {name: record}; ``link(entry, name)`` is the address of a file of a product.
    """
    rows = []
    for row, one in (pair for calibration in calibrations.values() for pair in _values(calibration)):
        files = {"report": "report.html", "document": "result.json", "product": "product.nc"}
        files_there = {"product.nc", *row["report"].record["files"]}
        links = {kind: link(row["report"], name) if name in files_there else "" for kind, name in files.items()}
        where = (row["event"], row["calibration"], one.satellite or letters_of(row["event"]))
        when = _date(row["document"], row["event"]).date().isoformat()
        what = (one.name, one.value, one.sigma, one.sigma_total, one.unit, row["said"], *links.values())
        rows.append(dict(zip(CATALOGUE, (*where, when, row["origin"], row["document"]["status"], *what), strict=True)))
    return sorted(rows, key=lambda one: (one["date"], one["event"], one["calibration"]))


def csv_of(rows) -> str:
    """CSV text of the rows of `delivered` with a header line; None is an empty cell."""
    return csv_text(CATALOGUE, ([row[name] for name in CATALOGUE] for row in rows))


def printed_points(calibration, satellite: str) -> list[Point]:
    """[Point] of the published values of a calibration for a satellite (letter), in the units of our results."""
    try:
        name = catalog.satellite(satellite).name
    except CatalogError:
        return []
    sections, printed = catalog.published(calibration.name) if calibration.printed else {}, []
    for section, values in calibration.printed.items():
        for one in sections.get(section, ()):
            own = [event for event in one.events if event.startswith(name)]
            if one.labels.get("satellite", name) != name or (one.events and not own):
                continue
            date = re.search(r"\d{4}-\d{2}(-\d{2})?", one.labels.get("date") or (own[0] if own else ""))
            if date:
                when = datetime.datetime.fromisoformat(date.group() + ("" if date.group(1) else "-01"))
                about = one.events[0] if one.events else "", "printed"
                printed += [Point(satellite, *r[:2], when, *r[2:4], *about, f"{r[4]}{one.source}") for r in values(one)]
    return printed


def levels(calibration) -> dict[str, tuple[float, str]]:
    """{panel: (value m s-2, label)} of printed orders of magnitude without a date."""
    if not calibration.levels:
        return {}
    known = {one.name: one.value[0] for one in catalog.published(calibration.name)["scalars"]}
    said = "printed: order of {:.0e} m s-2"
    return {panel: (known[name], said.format(known[name])) for panel, name in calibration.levels.items()}


def trims(satellite: str):
    """(catalog.Trim, ...) of one satellite, () for an unknown one."""
    try:
        return catalog.trims(satellite)
    except CatalogError:
        return ()


def letters_of(event):
    """Letters of the satellites from the name of an event: "C" of grace-c-2020-02-01, "CD" of grace-cd-..."""
    parts = event.split("-")
    known = (catalog.satellite(name) for name in catalog.names("satellites"))
    own = [one.letter for one in known if event.startswith(f"{one.name}-")]
    return own[0] if own else (parts[1].upper() if len(parts) > 1 else "?")


def _date(document, event):
    """Date of a result document: of its first manoeuvre, else in the event's name, else 2000-01-01."""
    starts = [one["start"] for one in document.get("manoeuvres") or [] if one.get("start") is not None]
    if starts:
        return EPOCH + datetime.timedelta(seconds=min(starts))
    match = re.search(r"\d{4}-\d{2}-\d{2}", event)
    return datetime.datetime.fromisoformat(match.group()) if match else EPOCH
