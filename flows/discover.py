"""Discovery: what the simulation of an event gets wrong, the cause, the extended model, the gain."""

from __future__ import annotations

from flows import com_offset as calibration
from flows import discover_gradient, discover_ranging, discover_swing
from flows.engine import flow
from tasks import common, discovery


@flow(name="com_offset_discovery")
def com_offset(source, chosen):
    """Causes of what the centre-of-mass calibration of one day leaves unexplained."""
    products, found = searched(source, chosen)
    scene = calibration.scene_settings(source, chosen)
    extended = discovery.extend_by(*products, found, scene=scene, variant="discovered")
    after = calibration.combined(source, chosen, extended)
    before = calibration.combined(source, chosen, products[0])  # last: latest/ leads to it
    values = chosen.for_report()
    named = {"event": source.event, "satellite": source.satellite}
    return discovery.com_offset_report(found, before, after, settings=values, **named)


def searched(source, chosen):
    """Products of the baseline and the causes found in them, strong ones round their own extended model."""
    products = calibration.baseline(source, chosen)
    scene, settings = calibration.scene_settings(source, chosen), chosen.for_stage("discovery")
    first = discovery.com_offset(*products, scene=scene, **settings, variant="first")
    extended = discovery.extend_by(*products, first, scene=scene, variant="first")
    again = calibration.solved_with_torquers(source, chosen, extended)
    return products, discovery.com_offset_again(*again, first, scene=scene, **settings)


FLOWS = {
    "com_offset": com_offset,
    "kbr_phase_centre": discover_ranging.kbr_phase_centre,
    "inertial_sensor": discover_swing.inertial_sensor,
    "gradient_torque": discover_gradient.gradient_torque,
}


def document(ref):
    """Result document of a discovery, with the keys of everything it was made from."""
    return common.document(ref, "discovery.json")


def measured_views():
    """Names of the views of measured data."""
    from flows import discover_measured

    return tuple(discover_measured.VIEWS)


def measured(name, data, satellite, date, settings):
    """Result document of a view of measured data, and its page."""
    from flows import discover_measured
    from gravcal.report import discovery_measured

    document, found = discover_measured.discovered(name, data, satellite, date, settings)
    return document, discovery_measured.page(document, found)
