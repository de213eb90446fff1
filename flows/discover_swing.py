"""Discovery in a swing of an inertial sensor."""

from __future__ import annotations

from flows import inertial_sensor as calibration
from flows.engine import flow
from gravcal.report import pages
from tasks import discovery_swing as stages


@flow(name="inertial_sensor_discovery")
def inertial_sensor(source, chosen):
    """Causes of what the swing of an inertial sensor leaves unexplained."""
    products = calibration.baseline(source, chosen)
    scene = calibration.scene_settings(chosen)
    found = stages.search(*products, event=source.event, scene=scene, **chosen.for_stage("discovery"))
    values = {name: entry.value for name, entry in chosen.entries.items()}
    named = {"event": source.event, "satellite": source.satellite, "templates": pages.digest()}
    return stages.report(found, settings=values, **named)
