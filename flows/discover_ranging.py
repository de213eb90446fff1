"""Discovery in a ranging calibration: cause, extended model, and the phase centres with it."""

from __future__ import annotations

from flows import kbr_phase_centre as calibration
from flows.engine import flow
from tasks import discovery_ranging as stages


@flow(name="kbr_phase_centre_discovery")
def kbr_phase_centre(source, chosen):
    """Causes of what the ranging calibration of a pair leaves unexplained."""
    products = calibration.baseline(source, chosen)
    scene = calibration.scene_settings(source, chosen)
    found = stages.search(*products, scene=scene, **chosen.for_stage("discovery"))
    extended = stages.extend_by(*products, found, scene=scene, variant="discovered")
    after = calibration.combined(source, chosen, extended)
    before = calibration.combined(source, chosen, products[0])  # last: latest/ leads to it
    values = chosen.for_report()
    named = {"event": source.event, "satellite": source.satellite}
    return stages.report(found, before, after, settings=values, **named)
