"""Routine pointing: from ranging, orbits and attitudes of a day without wiggles to the phase centres."""

from __future__ import annotations

from flows import kbr_phase_centre as wiggles
from flows.calibration import Calibration, Discovery
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import kbr_phase_centre, ranging


@flow(name="ranging")
def calibrate(source, chosen):
    """Phase centres of both satellites by the slow motion of their pointing."""
    minutes, checked = _minutes(source)
    if chosen.model:
        minutes = DISCOVERY.without(source, chosen, minutes, chosen.model)
    found = ranging.estimate(minutes, **chosen.for_stage("estimate"))
    checked = ranging.checks(checked, found, **chosen.for_stage("checks"))
    return ranging.report(found, minutes, checked, event=source.event, settings=chosen.for_report())


def _minutes(source):
    """Means of a minute and checks of the inputs; ranging minus orbit is made as for kbr_phase_centre."""
    chosen = catalog.parameters("kbr_phase_centre")
    files = wiggles.ingested(source, chosen)
    aligned = kbr_phase_centre.align(*files, **chosen.for_stage("align"))
    pointed, equations = wiggles.with_equations(source, chosen, aligned, ("range", "range_rate"))
    checked = wiggles.inputs_checked(source, chosen, files, aligned, pointed, equations)
    return ranging.align(aligned, equations[0]), checked


def observation_settings(source, chosen):
    """What the observations need beside the products."""
    return wiggles.nominal_of(source) | chosen.for_stage("observe")


DISCOVERY = Discovery(
    observation_settings,
    "gravcal.calibrations.ranging.observations",
    records=lambda source, _chosen: _minutes(source)[0],
)
CALIBRATION = Calibration(
    name="ranging",
    title="Routine pointing",
    quantity="Centre of mass to phase centre by routine pointing, in the SRF",
    begins=wiggles.RANGING,
    satellites=wiggles.CALIBRATION.satellites,
    inputs=wiggles.CALIBRATION.inputs,
    flow=calibrate,
    simulation=wiggles.simulation,
    pairs=wiggles.PAIRS,
    level_one_files=wiggles.level_one_files,
    products=ranging.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
)
