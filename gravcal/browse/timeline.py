"""Results over the years: one panel for each component, with errors, verdicts, mass trims and printed values."""

import datetime
import re
from dataclasses import dataclass

from gravcal import catalog
from gravcal.browse import store_index
from gravcal.errors import CatalogError

EPOCH = datetime.datetime(2000, 1, 1, 12)
RESULTS = ("delivered", "questionable")


@dataclass(frozen=True)
class Point:
    """One value with its error: ours or printed."""

    satellite: str
    panel: str
    unit: str
    date: datetime.datetime
    value: float
    sigma: float | None
    event: str
    mood: str
    said: str


def points(calibration) -> list[Point]:
    """Values of all reports of a calibration."""
    found = []
    for row in store_index.results():
        if row["calibration"] != calibration.name or (row["document"] or {}).get("status") not in RESULTS:
            continue
        mood = "questionable" if row["document"]["status"] == "questionable" else row["mood"]
        mood = mood if row["origin"] == "measured" else row["origin"]
        date = _date(row["document"], row["event"])
        for one in calibration.result(row["document"]):
            if one.value is not None:
                place = one.satellite or _letters(row["event"]), one.name, one.unit.replace("um", "µm")
                sigma = one.sigma_total or one.sigma
                found.append(Point(*place, date, one.value, sigma, row["event"], mood, row["said"]))
    return sorted(found, key=lambda point: (point.date, point.event))


def printed_points(calibration, satellite: str) -> list[Point]:
    """Printed values of the catalogue, in the units of ours."""
    try:
        name = catalog.satellite(satellite).name
    except CatalogError:
        return []
    sections, found = catalog.published(calibration.name) if calibration.printed else {}, []
    for section, values in calibration.printed.items():
        for one in sections.get(section, ()):
            date = _printed_date(one, name)
            rows = values(one) if date else ()
            event = one.events[0] if one.events else ""
            found += [
                Point(satellite, *row[:2], date, *row[2:4], event, "printed", f"{row[4]}{one.source}") for row in rows
            ]
    return found


def levels(calibration) -> dict[str, tuple[float, str]]:
    """Printed orders of magnitude without a date: value and text by panel."""
    if not calibration.levels:
        return {}
    scalars = {one.name: one.value[0] for one in catalog.published(calibration.name)["scalars"]}
    return {
        panel: (scalars[name], f"printed: order of {scalars[name]:.0e} m s-2")
        for panel, name in calibration.levels.items()
    }


def trims(satellite: str):
    """Mass trims of the catalogue for one satellite, () where it knows none."""
    try:
        return catalog.trims(satellite)
    except CatalogError:
        return ()


def _letters(event):
    """Letters of the satellites in the name of an event; a satellite named in full gives its own."""
    parts = event.split("-")
    known = (catalog.satellite(name) for name in catalog.names("satellites"))
    own = [one.letter for one in known if event.startswith(f"{one.name}-")]
    return own[0] if own else (parts[1].upper() if len(parts) > 1 else "?")


def _date(document, event):
    """Date of a result: that of its first manoeuvre, else that in the event's name."""
    starts = [one["start"] for one in document.get("manoeuvres") or [] if one.get("start") is not None]
    if starts:
        return EPOCH + datetime.timedelta(seconds=min(starts))
    found = re.search(r"\d{4}-\d{2}-\d{2}", event)
    return datetime.datetime.fromisoformat(found.group()) if found else EPOCH


def _printed_date(one, name):
    """Date of a printed value if it belongs to a satellite, else None: its own, else that of its event."""
    own = [event for event in one.events if event.startswith(name)]
    if one.labels.get("satellite", name) != name or (one.events and not own):
        return None
    found = re.search(r"\d{4}-\d{2}(-\d{2})?", one.labels.get("date") or (own[0] if own else ""))
    return datetime.datetime.fromisoformat(found.group() + ("" if found.group(1) else "-01")) if found else None
