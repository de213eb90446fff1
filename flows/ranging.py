"""Routine pointing: from ranging, orbits and attitudes of a day without wiggles to the phase centres."""

from __future__ import annotations

from flows import kbr_phase_centre as wiggles
from flows.calibration import Calibration, Discovery
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import discovery, kbr_phase_centre, ranging

OBSERVATIONS = "gravcal.calibrations.ranging.observations"


@flow(name="ranging")
def calibrate(source, chosen):
    """Phase centres of both satellites by the slow motion of their pointing."""
    minutes, checked = _minutes(source)
    if chosen.model:
        minutes = _extended(source, chosen, minutes)
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


def _extended(source, chosen, minutes):
    """Minutes without the effects of a model."""
    about = {"observations": OBSERVATIONS, "records": "ranging.align", "names": ["align"]}
    settings = observation_settings(source, chosen)
    return discovery.extend(minutes, model=chosen.model, settings=settings, variant="extended", **about)


def baseline(source, chosen):
    """Products that discovery looks at, by name."""
    minutes, _ = _minutes(source)
    return {"align": _extended(source, chosen, minutes) if chosen.model else minutes}


def observation_settings(source, chosen):
    """What the observations need beside the products."""
    return wiggles.nominal_of(source) | chosen.for_stage("observe")


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
    discovery=Discovery(baseline, observation_settings, observations=OBSERVATIONS, records="ranging.align"),
)
