"""Study of printed numbers: which listed effects explain the table of the manoeuvres of 2020-02-01."""

from __future__ import annotations

from dataclasses import dataclass

from flows.calibration import Discovery
from gravcal import catalog


@dataclass(frozen=True)
class Study:
    """Printed numbers that can be searched: what a discovery asks of a calibration, and of the source of an event."""

    name: str
    event: str
    satellite: str
    discovery: Discovery


def settings(study, chosen):
    """Rows of the chosen variant, and what the torquers did to the satellite."""
    records = [one for one in catalog.published("com_offset")["manoeuvres"] if one.labels["variant"] == chosen.variant]
    rows = [
        {"order": int(one.labels["order"]), "value": one.value, "sigma": one.sigma}
        | {name: one.labels[name] for name in ("kind", "latitude_class")}
        for one in records
    ]
    satellite = catalog.satellite(study.satellite).settings()
    known = {"rows": rows, "inertia": satellite["inertia"], "dipole": satellite["dipole_full_scale"]}
    return known | chosen.for_stage("observe")


OBSERVATIONS = "gravcal.calibrations.published_table.observations"
STUDY = Study("published_table", "grace-c-2020-02-01", "C", Discovery(settings, OBSERVATIONS, products=lambda *_: {}))
