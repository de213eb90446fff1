"""Discovery in a swing and a roll of an inertial sensor."""

from __future__ import annotations

from flows import inertial_sensor as calibration
from flows.engine import flow
from tasks import discovery_swing as stages


@flow(name="inertial_sensor_discovery")
def inertial_sensor(source, chosen):
    """Causes of what the swing and the roll of an inertial sensor leave unexplained."""
    parts = calibration.baseline(source, chosen)
    settings = calibration.views(source, chosen) | chosen.for_stage("discovery")
    found = stages.search(*parts.values(), parts=list(parts), event=source.event, **settings)
    values = chosen.for_report()
    named = {"event": source.event, "satellite": source.satellite}
    return stages.report(found, settings=values, **named)
