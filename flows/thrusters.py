"""Attitude thrusters: gain and tag delay from star camera and firings; source: `Source`, chosen: `Parameters`."""

import functools
from dataclasses import replace

from flows.calibration import Calibration, Discovery, of_columns, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import common, thrusters

TWIN = {"A": "B", "B": "A", "C": "D", "D": "C"}
TABLE = {"position_b": "thruster_position", "force_b": "thruster_force"}


@flow(name="thrusters")
def calibrate(source, chosen):
    """ProductRef of the report: gain of the attitude thrusters about each axis, and delay of their time tags."""
    estimate, checked, records, measured, *heads = made(source, chosen).values()
    reported = (estimate, measured, records, checked, *heads)
    return thrusters.report(*reported, event=source.event, settings=chosen.for_report())


def made(source, chosen):
    """{stage: ProductRef}: estimate (with the model's errors), checks, records less the model, noise and heads."""
    records = aligned(source, chosen)
    known = products(source, chosen, records)
    solved = functools.partial(estimated, source, chosen, known["noise"])
    records, moved = DISCOVERY.taken_out(source, chosen, records, solved, known)
    estimate = solved(records)
    checked = thrusters.checks(records, estimate, **chosen.for_stage("checks"))
    estimate = thrusters.model_error(estimate, *moved) if moved else estimate
    return {"estimate": estimate, "checks": checked} | known | {"align": records}


def aligned(source, chosen):
    """ProductRef of attitude, firings and orbit of the day."""
    files = [source.file(*names) for names in CALIBRATION.inputs.values()]
    files += replace(source, satellite=TWIN[source.satellite]).files("THR1B")  # a driver that should explain nothing
    observed = [common.ingest(file, event=source.event) for file in files]
    satellite = catalog.satellite(source.satellite).settings()
    table = {name: satellite[known] for name, known in TABLE.items()}
    return thrusters.align(*observed, **table, **chosen.for_stage("align"))


def estimated(source, chosen, measured, records):
    """ProductRef of gain and delay from aligned records and their noise (``measured``), both ProductRefs."""
    return thrusters.estimate(records, measured, **_inertia(source), **chosen.for_stage("estimate"))


def _inertia(source):  # setting {"inertia": (3, 3) kg m2} of the satellite
    return {"inertia": catalog.satellite(source.satellite).settings()["inertia"]}


def products(source, chosen, records):
    """{name: ProductRef}: records, attitude noise (of the records as measured), camera heads where there is SCA1A."""
    made = {"align": records, "noise": thrusters.noise(aligned(source, chosen), **chosen.for_stage("noise"))}
    for file in source.files("SCA1A"):
        mounting = catalog.satellite(source.satellite).settings()["star_camera_mounting"]
        observed = common.ingest(file, event=source.event)
        made["heads"] = thrusters.heads(observed, mounting=mounting, **chosen.for_stage("heads"))
    return made


DISCOVERY = Discovery(
    lambda source, chosen: _inertia(source) | chosen.for_stage("observe"),
    "gravcal.calibrations.thrusters.observations",
    records=aligned,
    products=products,
    estimated=lambda _chosen: sorted({*thrusters.observations.PRESENT, *thrusters.observations.DELAYS}),
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=calibrate,
    simulation=of_columns("gravcal.simulation.thrusters"),
    products=thrusters.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
)
