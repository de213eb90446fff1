"""Stages of discovery in a ranging calibration."""

from __future__ import annotations

import json

from gravcal.discovery.schemas import DISCOVERY
from gravcal.store import product
from tasks.stage import lazy, stage

science = lazy("gravcal.discovery.kbr_phase_centre")
extension_science = lazy("gravcal.calibrations.kbr_phase_centre.extension")
report_science = lazy("gravcal.report.discovery_delivery")

KINDS = {"kbr_phase_centre.discovery": DISCOVERY, "kbr_phase_centre.discovery_report": product.ANY}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)
READ = [f"kbr_phase_centre.{name}" for name in ("align", "pointing", "observable", "noise", "solve")]


@stage(reads=READ, writes="kbr_phase_centre.discovery", version=6)
def search(*products, discovery_level, tie_chi2, round_limit, segment_s, discovery_seed, scene):
    """What the model of a ranging calibration gets wrong, and why."""
    limits = {"discovery_level": discovery_level, "tie_chi2": tie_chi2, "round_limit": round_limit}
    return science.discover(*products, **limits, segment_s=segment_s, discovery_seed=discovery_seed, **scene)


@stage(reads=READ, writes="kbr_phase_centre.align", version=1)
def extend(*products, model, scene):
    """Records without the effects of an extended model."""
    return extension_science.extend(*products, model=json.loads(model), **scene)


@stage(reads=[*READ, "kbr_phase_centre.discovery"], writes="kbr_phase_centre.align", version=1)
def extend_by(aligned, pointed, equations, measured, solved, found, *, scene):
    """Records without what was found in them."""
    model = json.loads(found.attrs["numbers"]).get("findings", [])
    return extension_science.extend(aligned, pointed, equations, measured, solved, model=model, **scene)


@stage(
    reads=["kbr_phase_centre.discovery", "kbr_phase_centre.combine", "kbr_phase_centre.combine"],
    writes="kbr_phase_centre.discovery_report",
    version=1,
)
def report(found, before, after, *, event, satellite, settings):
    """Result document, page and extended model."""
    named = {"calibration": "kbr_phase_centre", "event": event, "satellite": satellite}
    return report_science.report(found, before, after, settings=settings, **named)
