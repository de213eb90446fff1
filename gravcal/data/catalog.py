"""The catalogue: satellites, events, parameters and published values, read from TOML and CSV files.

``satellite("C")``, ``event("grace-c-2020-02-01")``, ``events(satellite="C")``, ``names("events")``,
``parameters("com_offset")``, ``published("com_offset")`` and ``trims("C")`` ask it, ``save_event`` adds to it. Files
ship with the package; a folder named by the environment variable GRAVCAL_CATALOG is searched first: a user's own
entries add or override.
"""

from gravcal.data.catalog_events import Designed, Event, Manoeuvre, RawFile, event, events
from gravcal.data.catalog_files import names
from gravcal.data.catalog_parameters import Parameter, Parameters, parameters
from gravcal.data.catalog_published import Published, Trim, published, trims
from gravcal.data.catalog_satellites import Quantity, Satellite, satellite
from gravcal.data.catalog_writer import event_text, save_event

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
