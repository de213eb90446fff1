"""The catalogue: satellites, events, parameters and published values, read from TOML and CSV files.

``satellite("C")``, ``event("grace-c-2020-02-01")``, ``events(satellite="C")``, ``parameters("com_offset")``,
``published("com_offset")`` and ``trims("C")`` are all there is. The files ship with the package; a folder named by
the environment variable GRAVCAL_CATALOG is searched first, so that a user's own satellites and events add or override.
"""

from gravcal.data.catalog_parameters import Parameter, Parameters, parameters
from gravcal.data.catalog_satellites import Quantity, Satellite, satellite

__all__ = [
    "Parameter",
    "Parameters",
    "Quantity",
    "Satellite",
    "parameters",
    "satellite",
]
