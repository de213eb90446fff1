"""The catalogue: satellites, events, parameters and published values, read from TOML and CSV files.

``satellite("C")``, ``event("grace-c-2020-02-01")``, ``events(satellite="C")``, ``names("events")``,
``parameters("com_offset")``, ``published("com_offset")`` and ``trims("C")`` ask it, ``save_event`` adds to it. Files
ship with the package; a folder named by the environment variable GRAVCAL_CATALOG is searched first: a user's own
entries add or override.
"""

from gravcal.catalog.event_table import Designed, Event, Manoeuvre, RawFile, event, events
from gravcal.catalog.event_writer import event_text, save_event
from gravcal.catalog.files import names
from gravcal.catalog.parameter_table import Parameter, Parameters, parameters
from gravcal.catalog.published_values import Published, Trim, published, trims
from gravcal.catalog.satellite_table import Quantity, Satellite, satellite

__all__ = [
    "Designed",
    "Event",
    "Manoeuvre",
    "Parameter",
    "Parameters",
    "Published",
    "Quantity",
    "RawFile",
    "Satellite",
    "Trim",
    "event",
    "event_text",
    "events",
    "names",
    "parameters",
    "published",
    "satellite",
    "save_event",
    "trims",
]
