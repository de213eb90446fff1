"""Attitude thrusters: from star camera and firings of a day to gain of the impulses and delay of the tags."""

from __future__ import annotations

from dataclasses import replace

from flows.calibration import Calibration
from flows.engine import flow
from gravcal import catalog
from gravcal.store import results
from tasks import common, thrusters
from tasks.stage import lazy

simulator = lazy("gravcal.simulation.thrusters")
writers = lazy("gravcal.io.writers")

TWIN = {"A": "B", "B": "A"}
TABLE = {"position_b": "thruster_position", "force_b": "thruster_force"}


@flow(name="thrusters")
def calibrate(source, chosen):
    """Gain of the attitude thrusters about each axis, and delay of their tags."""
    aligned, measured = baseline(source, chosen)
    found = thrusters.estimate(aligned, measured, **_inertia(source), **chosen.for_stage("estimate"))
    checked = thrusters.checks(aligned, found, **chosen.for_stage("checks"))
    products = (found, measured, aligned, checked)
    return thrusters.report(*products, event=source.event, settings=chosen.for_report())


def baseline(source, chosen):
    """Products that discovery looks at: records of the day and noise of the attitude."""
    files = [source.file(*names) for names in CALIBRATION.inputs.values()]
    files += replace(source, satellite=TWIN[source.satellite]).files("THR1B")  # a driver that should explain nothing
    observed = [common.ingest(file, event=source.event) for file in files]
    table = common.settings_of(catalog.satellite(source.satellite).settings(), *TABLE.values())
    table = {name: table[known] for name, known in TABLE.items()}
    aligned = thrusters.align(*observed, **table, **chosen.for_stage("align"))
    return aligned, thrusters.noise(aligned, **chosen.for_stage("noise"))


def _inertia(source):
    return common.settings_of(catalog.satellite(source.satellite).settings(), "inertia")


def simulation(out, chosen, day, seed, effects, truth):  # noqa: ARG001 - as for the other calibrations
    """Truth of an invented day; its Level-1 files are written."""
    columns, invented = simulator.simulate(catalog.satellite(chosen.satellite).settings(), chosen, day, seed, effects)
    for name, values in columns.items():
        writers.write(values, out / writers.file_name(name, chosen.date, chosen.satellite))
    return invented | {"satellite": chosen.satellite}


CALIBRATION = Calibration(
    name="thrusters",
    title="Attitude thrusters",
    quantity="Gain of the impulses over lever arm x force x time on, and delay of the tags",
    begins=("THR1B",),
    satellites=("A", "B"),
    inputs={"sca": ("SCA1B",), "thrusters": ("THR1B",), "orbit": ("GNV1B",)},
    flow=calibrate,
    simulation=simulation,
    products=thrusters.KINDS,
    result=results.parameters,
)
