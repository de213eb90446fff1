"""The catalogue: satellites, events, parameters and published values, read from TOML and CSV files.

``satellite("C")``, ``event("grace-c-2020-02-01")``, ``events(satellite="C")``, ``names("events")``,
``parameters("com_offset")``, ``published("com_offset")`` and ``trims("C")`` ask it, ``save_event`` adds to it. Files
ship with the package; a folder named by the environment variable GRAVCAL_CATALOG is searched first: a user's own
entries add or override.
"""

from gravcal.catalog.files import names
from gravcal.catalog.missions import (
    Event,
    Manoeuvre,
    Published,
    Satellite,
    event,
    event_origin,
    event_text,
    events,
    published,
    satellite,
    save_event,
    trims,
)
from gravcal.catalog.parameter_table import Parameters, parameters

__all__ = [
    "Event",
    "Manoeuvre",
    "Parameters",
    "Published",
    "Satellite",
    "event",
    "event_origin",
    "event_text",
    "events",
    "names",
    "parameters",
    "published",
    "satellite",
    "save_event",
    "trims",
]
