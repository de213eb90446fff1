"""Stages of discovery in a swing and a roll of an inertial sensor."""

from __future__ import annotations

import json

from gravcal.discovery.schemas import DISCOVERY
from gravcal.store import product
from tasks.stage import lazy, stage

science = lazy("gravcal.discovery.inertial_sensor")
extension_science = lazy("gravcal.calibrations.inertial_sensor.extension")
report_science = lazy("gravcal.report.discovery_delivery")

KINDS = {"inertial_sensor.discovery": DISCOVERY, "inertial_sensor.discovery_report": product.ANY}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)


@stage(reads=["inertial_sensor.*"], writes="inertial_sensor.discovery", version=6)
def search(*products, parts, discovery_level, tie_chi2, round_limit, heldout_s, discovery_seed, scene, rolling):
    """What the model of a swing and of a roll gets wrong, and why; without both nothing."""
    limits = {"discovery_level": discovery_level, "tie_chi2": tie_chi2, "round_limit": round_limit}
    limits |= {"segment_s": heldout_s, "discovery_seed": discovery_seed}
    return science.discover(*products, parts=parts, scene=scene, rolling=rolling, **limits)


@stage(
    reads=["inertial_sensor.align", "inertial_sensor.scale", "inertial_sensor.offset"],
    writes="inertial_sensor.align",
    version=1,
)
def extend(aligned, scaled, moved, *, model, scene):
    """Record of a swing without the effects of an extended model."""
    return extension_science.extend(aligned, scaled, moved, model=json.loads(model), **scene)


@stage(
    reads=["inertial_sensor.segment", "inertial_sensor.bias", "inertial_sensor.scale", "inertial_sensor.offset"],
    writes="inertial_sensor.segment",
    version=1,
)
def extend_roll(segmented, biased, *swing, model, rolling):
    """Bins of a roll without the effects of an extended model."""
    return extension_science.extend_roll(segmented, biased, *swing, model=json.loads(model), **rolling)


@stage(reads=["inertial_sensor.discovery"], writes="inertial_sensor.discovery_report", version=1)
def report(found, *, event, satellite, settings):
    """Result document and page."""
    named = {"calibration": "inertial_sensor", "event": event, "satellite": satellite}
    return report_science.report(found, settings=settings, **named)
