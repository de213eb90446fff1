"""Stages of discovery; the search is in `gravcal/discovery`, the view of a calibration beside its science."""

from __future__ import annotations

import json

from gravcal.discovery.schemas import DISCOVERY
from gravcal.store import product
from tasks.stage import lazy, stage

com_offset_science = lazy("gravcal.discovery.com_offset")
extension_science = lazy("gravcal.calibrations.com_offset.extension")
report_science = lazy("gravcal.report.discovery_delivery")

KINDS = {"com_offset.discovery": DISCOVERY, "com_offset.discovery_report": product.ANY}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)
READ = ["com_offset.align", "com_offset.field", "com_offset.attitude", "com_offset.solve"]


@stage(reads=READ, writes="com_offset.discovery", version=10)
def com_offset(
    aligned,
    checked,
    smoothed,
    solved,
    *,
    discovery_level,
    tie_chi2,
    round_limit,
    segment_s,
    linear_drift_degree,
    angular_drift_degree,
    discovery_seed,
    scene,
):
    """What the model of an event gets wrong, and why."""
    settings = {name: value for name, value in locals().items() if name not in _INPUTS}
    return com_offset_science.discover(aligned, checked, smoothed, solved, **scene, **settings)


@stage(reads=[*READ, "com_offset.discovery"], writes="com_offset.discovery", version=9)
def com_offset_again(
    aligned,
    checked,
    smoothed,
    solved,
    first,
    *,
    discovery_level,
    tie_chi2,
    round_limit,
    segment_s,
    linear_drift_degree,
    angular_drift_degree,
    discovery_seed,
    scene,
):
    """The same round the extended model, where its effects are large."""
    settings = {name: value for name, value in locals().items() if name not in _INPUTS}
    return com_offset_science.discover_again(aligned, checked, smoothed, solved, first, **scene, **settings)


_INPUTS = ("aligned", "checked", "smoothed", "solved", "first", "scene")


@stage(reads=READ, writes="com_offset.align", version=2)
def extend(aligned, checked, smoothed, solved, *, model, scene):
    """Records without the effects of an extended model."""
    return extension_science.extend(aligned, checked, smoothed, solved, model=json.loads(model), **scene)


@stage(reads=[*READ, "com_offset.discovery"], writes="com_offset.align", version=2)
def extend_by(aligned, checked, smoothed, solved, found, *, scene):
    """Records without what was found in them."""
    model = json.loads(found.attrs["numbers"]).get("findings", [])
    return extension_science.extend(aligned, checked, smoothed, solved, model=model, **scene)


@stage(
    reads=["com_offset.discovery", "com_offset.combine", "com_offset.combine"],
    writes="com_offset.discovery_report",
    version=1,
)
def com_offset_report(found, before, after, *, event, satellite, settings):
    """Result document, page and extended model."""
    named = {"calibration": "com_offset", "event": event, "satellite": satellite}
    return report_science.report(found, before, after, settings=settings, **named)
