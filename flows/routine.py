"""Routine day: measured against simulated readings of every instrument; source: `Source`, chosen: `Parameters`."""

import functools
from dataclasses import replace

from flows import discover, engine, magnetometer, ranging, thrusters
from flows.calibration import Calibration, Discovery, of_columns, stated
from flows.engine import flow
from gravcal import catalog
from gravcal.errors import NoDataError, refuse
from gravcal.store import results
from tasks import common, routine

PAIRS = {"A": "AB", "B": "AB", "C": "CD", "D": "CD"}
OTHERS = {"magnetometer": magnetometer, "thrusters": thrusters, "ranging": ranging}


@flow(name="routine")
def simulate_and_fit(source, chosen):
    """ProductRef of the report: simulated readings of every instrument of a day, the fit, and its residuals."""
    made, missing = _attempted(_made, source, chosen)
    products = {f"{part}.{name}": one for part, done in made.items() for name, one in done.items()}
    known = {"names": tuple(products), "missing": missing, "event": source.event}
    return routine.report(*products.values(), settings=chosen.for_report(), **known)


def search(source, chosen, shown):
    """ProductRef of one report of the discoveries of all instruments (parts) of a day; shown: with detection limits."""

    def of_part(part, source, chosen):  # (ProductRef of the search, facts for the report)
        one, source, own = _owner(part, source, chosen)
        about = {"calibration": one.name, "event": source.event, "settings": own.for_report()}
        return discover.searched(one, source, own, shown)[0], about

    searches, missing = _attempted(of_part, source, chosen)
    known = {"parts": {part: about for part, (_, about) in searches.items()}, "missing": missing, "event": source.event}
    return routine.discovered(*(ref for ref, _ in searches.values()), settings=chosen.for_report(), **known)


def _owner(part, source, chosen):
    """(Calibration, Source, Parameters) of a part (instrument); the calibration of the accelerometer is this one."""
    if part == "accelerometer":
        return CALIBRATION, source, chosen
    if part == "ranging":
        pair = PAIRS[source.satellite]
        event = f"{ranging.CALIBRATION.mission}-{pair.lower()}-{source.date}"
        source = replace(source, satellite=pair, event=event)
    return OTHERS[part].CALIBRATION, source, catalog.parameters(part)


def _attempted(make, source, chosen):
    """({part: ``make(part, source, chosen)``}, {part: reason} of those for which it fails); refused if all fail."""
    made, missing = {}, {}
    for part in ("accelerometer", *OTHERS):
        done = engine.attempt(functools.partial(make, part, source, chosen))
        if isinstance(done, engine.GravcalError):  # said without the folder that was looked into
            products = done.facts.get("products")
            missing[part] = f"no {' or '.join(products)}" if products else str(done).partition(". ")[0]
        else:
            made[part] = done
    if not made:
        refuse(source.event, "; ".join(missing.values()), "records of an instrument", "Add its files.", NoDataError)
    return made, missing


def _made(part, source, chosen):
    """{stage: ProductRef} of a part, with "discovery" if ``chosen.search``."""
    one, source, own = _owner(part, source, chosen)
    if part in OTHERS:
        made = OTHERS[part].made(source, own)
    else:
        made = _estimated(source, own, _aligned(source, own))
        made = {"checks": routine.checks(made["estimate"], **own.for_stage("checks"))} | made
    return made | {"discovery": discover.searched(one, source, own)[0]} if chosen.search else made


def _estimated(_source, chosen, aligned):  # {stage: ProductRef} of the records and their estimate
    return {"align": aligned, "estimate": routine.estimate(aligned, **chosen.for_stage("estimate"))}


def _aligned(source, chosen):  # ProductRef of accelerometer records with torquers and firings, where there are
    files = [source.file(*names) for names in CALIBRATION.inputs.values()] + source.files("MAG1B", "THR1B")
    satellite = catalog.satellite(source.satellite).settings()
    wanted = thrusters.TABLE | {name: name for name in ("inertia", "dipole_per_current")}
    known = {name: satellite[stated] for name, stated in wanted.items()}
    observed = [common.ingest(file, event=source.event) for file in files]
    return routine.align(*observed, **known, **chosen.for_stage("align"))


DISCOVERY = Discovery(
    lambda _source, chosen: chosen.for_stage("observe"),
    "gravcal.calibrations.routine.observations",
    records=_aligned,
    products=_estimated,
    together=search,
)
CALIBRATION = Calibration(
    **stated(__file__),
    flow=simulate_and_fit,
    simulation=of_columns("gravcal.simulation.com_offset"),
    products=routine.KINDS,
    result=results.parameters,
    discovery=DISCOVERY,
    level_one_files=lambda source: source.files("SCA1B"),
)
