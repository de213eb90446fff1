"""Stages of discovery in a day of S-GRS."""

from __future__ import annotations

import json

from gravcal.discovery.schemas import DISCOVERY
from gravcal.store import product
from tasks.stage import lazy, stage

science = lazy("gravcal.discovery.gradient_torque")
extension_science = lazy("gravcal.calibrations.gradient_torque.extension")
report_science = lazy("gravcal.report.discovery_delivery")

KINDS = {"gradient_torque.discovery": DISCOVERY, "gradient_torque.discovery_report": product.ANY}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)
READ = ["ingest", "gradient_torque.gradient", "gradient_torque.drag"]


@stage(reads=READ, writes="gradient_torque.discovery", version=4)
def search(observed, modelled, found, *, discovery_level, tie_chi2, round_limit, heldout_s, discovery_seed, scene):
    """What the model of a day gets wrong, and why."""
    limits = {"discovery_level": discovery_level, "tie_chi2": tie_chi2, "round_limit": round_limit}
    numbers = {"segment_s": heldout_s, "discovery_seed": discovery_seed}
    return science.discover(observed, modelled, found, **limits, **numbers, **scene)


@stage(reads=[*READ, "gradient_torque.discovery"], writes="gradient_torque.discovery", version=4)
def search_again(
    observed,
    modelled,
    found,
    first,
    *,
    discovery_level,
    tie_chi2,
    round_limit,
    heldout_s,
    discovery_seed,
    scene,
):
    """The same in records without what was found."""
    limits = {"discovery_level": discovery_level, "tie_chi2": tie_chi2, "round_limit": round_limit}
    numbers = {"segment_s": heldout_s, "discovery_seed": discovery_seed}
    return science.discover_again(observed, modelled, found, first, **limits, **numbers, **scene)


@stage(reads=READ, writes="ingest", version=1)
def extend(observed, modelled, found, *, model, scene):
    """Record of a day without the effects of an extended model."""
    return extension_science.extend(observed, modelled, found, model=json.loads(model), **scene)


@stage(reads=[*READ, "gradient_torque.discovery"], writes="ingest", version=1)
def extend_by(observed, modelled, found, discovered, *, scene):
    """Record of a day without what was found in it."""
    model = json.loads(discovered.attrs["numbers"])["findings"]
    return extension_science.extend(observed, modelled, found, model=model, **scene)


@stage(reads=["gradient_torque.discovery"], writes="gradient_torque.discovery_report", version=1)
def report(found, *, event, satellite, settings):
    """Result document and page."""
    named = {"calibration": "gradient_torque", "event": event, "satellite": satellite}
    return report_science.report(found, settings=settings, **named)
