"""Magnetometer: bias, scale, axes and torquer coupling from field, attitude and orbit; `Source`, `Parameters`."""

import functools

from flows.calibration import Calibration, Discovery, of_columns, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.io import cdf
from gravcal.store import results
from tasks import common, magnetometer


@flow(name="magnetometer")
def calibrate(source, chosen):
    """ProductRef of the report: parameters of the magnetometer of one satellite against the reference field."""
    (estimate, records, checked), published = made(source, chosen).values(), []
    for file in cdf.files(source.folder, source.satellite, source.date):  # calibrated field of others less ours
        _, camera, orbit = _observed(source)
        theirs = magnetometer.theirs(file, event=source.event)
        settings = chosen.for_stage("estimate") | chosen.for_stage("align")
        published.append(magnetometer.beside(records, estimate, camera, orbit, theirs, **settings))
    return magnetometer.report(estimate, records, checked, *published, event=source.event, settings=chosen.for_report())


def made(source, chosen):
    """{"estimate", "align", "checks"}: ProductRefs from records less the model; estimate with the model's errors."""
    solved = functools.partial(estimated, chosen)
    records, moved = DISCOVERY.taken_out(source, chosen, aligned(source, chosen), solved)
    estimate = estimated(chosen, records)
    checked = magnetometer.checks(records, estimate, **chosen.for_stage("checks"))
    estimate = magnetometer.model_error(estimate, *moved) if moved else estimate
    return {"estimate": estimate, "align": records, "checks": checked}


def _observed(source):  # [ProductRef] of the ingested magnetometer, star camera and orbit files
    files = [source.file(*names) for names in CALIBRATION.inputs.values()]
    return [common.ingest(file, event=source.event) for file in files]


def aligned(source, chosen):
    """ProductRef of measured and reference field."""
    observed = _observed(source)
    torquers = catalog.satellite(source.satellite).settings()["dipole_per_current"]
    return magnetometer.align(*observed, dipole_per_current=torquers, **chosen.for_stage("align"))


def estimated(chosen, records):
    """ProductRef of the parameters from aligned records (ProductRef)."""
    return magnetometer.estimate(records, **chosen.for_stage("estimate"))


DISCOVERY = Discovery(
    lambda _source, chosen: chosen.for_stage("observe"),
    "gravcal.calibrations.magnetometer.observations",
    records=aligned,
    estimated=lambda chosen: magnetometer.estimation.estimated(chosen.for_stage("estimate")["held"]),
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    simulation=of_columns("gravcal.simulation.magnetometer"),
    products=magnetometer.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
)
