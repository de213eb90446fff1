"""Printed values for the time lines, in the units of ours; trims of the masses."""

import datetime
import re
from dataclasses import dataclass

AXES = "xyz"
METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}


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


def points(calibration, satellite):
    """Printed values of the catalogue as points.

    Parameters
    ----------
    calibration : flows.calibration.Calibration
    satellite : str

    Returns
    -------
    points : list of Point
    """
    from gravcal import catalog
    from gravcal.errors import CatalogError

    try:
        name = catalog.satellite(satellite).name
    except CatalogError:
        return []
    sections, found = catalog.published(calibration.name) if calibration.printed else {}, []
    for section, values in calibration.printed.items():
        for one in sections.get(section, ()):
            date = _date(one, name)
            rows = values(one) if date else ()
            event = one.events[0] if one.events else ""
            found += [
                Point(satellite, *row[:2], date, *row[2:4], event, "printed", f"{row[4]}{one.source}") for row in rows
            ]
    return found


def levels(calibration):
    """Printed orders of magnitude without a date.

    Returns
    -------
    levels : dict, panel -> (value, text)
    """
    from gravcal import catalog

    if not calibration.levels:
        return {}
    scalars = {one.name: one.value[0] for one in catalog.published(calibration.name)["scalars"]}
    return {
        panel: (scalars[name], f"printed: order of {scalars[name]:.0e} m s-2")
        for panel, name in calibration.levels.items()
    }


def trims(satellite):
    """Mass trims of the catalogue for one satellite, () where it knows none."""
    from gravcal import catalog
    from gravcal.errors import CatalogError

    try:
        return catalog.trims(satellite)
    except CatalogError:
        return ()


def _date(one, name):
    """Date of a printed value if it belongs to a satellite, else None: its own, else that of its event."""
    own = [event for event in one.events if event.startswith(name)]
    if one.labels.get("satellite", name) != name or (one.events and not own):
        return None
    found = re.search(r"\d{4}-\d{2}(-\d{2})?", one.labels.get("date") or (own[0] if own else ""))
    return datetime.datetime.fromisoformat(found.group() + ("" if found.group(1) else "-01")) if found else None


def vector(unit):
    """Function that gives the rows of a vector: panel, unit, value, sigma, remark."""

    def rows(one):
        units = one.unit.split(", ")
        for number, axis in enumerate(AXES):
            factor = METRES[units[number] if len(units) == 3 else units[0]] / METRES[unit]
            sigma = one.sigma[number] * factor if one.sigma else None
            yield axis, unit, one.value[number] * factor, sigma, ""

    return rows
