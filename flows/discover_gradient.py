"""Discovery in a day of S-GRS."""

from __future__ import annotations

from flows import gradient_torque as calibration
from flows.engine import flow
from tasks import discovery_gradient as stages


@flow(name="gradient_torque_discovery")
def gradient_torque(source, chosen):
    """Causes of what the readings of one day leave unexplained."""
    products = calibration.baseline(source, chosen)
    scene = calibration.scene_settings(source, chosen)
    settings = {"scene": scene, **chosen.for_stage("discovery")}
    first = stages.search(*products, variant="first", **settings)
    extended = stages.extend_by(*products, first, scene=scene, variant="discovered")
    found = stages.search_again(*calibration.from_one_sensor(source, chosen, extended), first, variant="", **settings)
    calibration.baseline(source, chosen)  # last: latest/ leads to it
    values = {name: value for name, value in chosen.for_report().items() if name != "truth"}
    named = {"event": source.event, "satellite": source.satellite}
    return stages.report(found, settings=values, **named)
