"""Attitude thrusters: from star camera and firings of a day to gain of the impulses and delay of the tags."""

import functools
from dataclasses import replace

from flows.calibration import Calibration, Discovery, of_one_satellite
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import common, thrusters

TWIN = {"A": "B", "B": "A", "C": "D", "D": "C"}
TABLE = {"position_b": "thruster_position", "force_b": "thruster_force"}


@flow(name="thrusters")
def calibrate(source, chosen):
    """Gain of the attitude thrusters about each axis, and delay of their tags."""
    records = aligned(source, chosen)
    measured = thrusters.noise(records, **chosen.for_stage("noise"))
    solved = functools.partial(estimated, source, chosen, measured)
    records, moved = DISCOVERY.taken_out(source, chosen, records, solved, {"align": records, "noise": measured})
    found = solved(records)
    checked = thrusters.checks(records, found, **chosen.for_stage("checks"))
    found = thrusters.model_error(found, *moved) if moved else found
    products = (found, measured, records, checked)
    return thrusters.report(*products, event=source.event, settings=chosen.for_report())


def aligned(source, chosen):
    """Attitude, firings and orbit of the day."""
    files = [source.file(*names) for names in CALIBRATION.inputs.values()]
    files += replace(source, satellite=TWIN[source.satellite]).files("THR1B")  # a driver that should explain nothing
    observed = [common.ingest(file, event=source.event) for file in files]
    satellite = catalog.satellite(source.satellite).settings()
    table = {name: satellite[known] for name, known in TABLE.items()}
    return thrusters.align(*observed, **table, **chosen.for_stage("align"))


def estimated(source, chosen, measured, records):
    """Gain and delay from aligned records."""
    return thrusters.estimate(records, measured, **_inertia(source), **chosen.for_stage("estimate"))


def _inertia(source):
    return {"inertia": catalog.satellite(source.satellite).settings()["inertia"]}


def products(source, chosen, records):
    """Records of the day, and the noise of the attitude as it was recorded, by name."""
    measured = thrusters.noise(aligned(source, chosen), **chosen.for_stage("noise"))
    return {"align": records, "noise": measured}


DISCOVERY = Discovery(
    lambda source, chosen: _inertia(source) | chosen.for_stage("observe"),
    "gravcal.calibrations.thrusters.observations",
    records=aligned,
    products=products,
)
CALIBRATION = Calibration(
    name="thrusters",
    title="Attitude thrusters",
    quantity="Gain of the impulses over lever arm x force x time on, and delay of the tags",
    begins=("THR1B",),
    satellites=("A", "B", "C", "D"),
    inputs={"sca": ("SCA1B",), "thrusters": ("THR1B",), "orbit": ("GNV1B",)},
    flow=calibrate,
    simulation=of_one_satellite("gravcal.simulation.thrusters"),
    products=thrusters.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
)
