"""The published table of the manoeuvres of 2020-02-01 as measured data: which listed effects explain it."""

from __future__ import annotations

import numpy as np

from gravcal import catalog
from gravcal.calibrations.published_table import view

EVENT = "grace-c-2020-02-01"
SAID = "the table holds estimates, not readings: what an effect does to them is modelled, no offset is adopted"
NOTES = [
    "Areas, rods and the field in the middle of each area are modelled; the direction of flight is not printed, so "
    "every heading is tried.",
    "Errors are the printed ones times what repeated manoeuvres of one kind ask for.",
    "The four variants share one linear accelerometer: they are not independent evidence.",
]


def prepare(data, satellite, date, chosen) -> dict:  # noqa: ARG001
    """Blocks and candidates of each variant.

    Parameters
    ----------
    data, satellite, date : not used, the table ships with the package
    chosen : Parameters
    """
    records = catalog.published("com_offset")["manoeuvres"]
    satellite = catalog.satellite("C")
    inertia, dipole = np.array(satellite.inertia.value), float(satellite.dipole_full_scale.value)
    runs, facts = [], {}
    for variant, rows in view.variants(records).items():
        blocks, candidates, facts[variant] = view.view(rows, inertia, dipole, chosen.igrf_generation)
        runs.append((variant, blocks, candidates))
    words = {"calibration": "com_offset", "event": EVENT, "origin": "measured", "said": SAID, "notes": NOTES}
    return words | {"files": ["com_offset_manoeuvres.csv"], "runs": runs, "facts": facts}
