"""Stages of a routine day, Datasets to Dataset: accelerometer in `gravcal/calibrations/routine`, others in theirs."""

import importlib

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

science = lazy("gravcal.calibrations.routine.accelerometer")
page = lazy("gravcal.calibrations.routine.page")
magnetometer = lazy("gravcal.calibrations.magnetometer.page")
thrusters = lazy("gravcal.calibrations.thrusters.page")
ranging = lazy("gravcal.calibrations.ranging.page")

KINDS = product.registered("routine", **schemas.of("routine.toml"))


@stage(reads=["ingest"], writes="routine.align", version=2)
def align(*observed, **settings):
    """Accelerometer readings averaged over time steps, with torquer dipoles and thruster firings."""
    return science.align(*observed, **settings)


@stage(reads=["routine.align"], writes="routine.estimate", version=3)
def estimate(aligned, **settings):
    """Response of the accelerometer to firings, torquers and rotation."""
    return science.estimate(aligned, **settings)


@stage(reads=["routine.estimate"], writes="routine.checks", version=3)
def checks(estimated, **settings):
    """Checks of the estimates of parts of the day."""
    return science.check(estimated, **settings)


@stage(reads=["*"], writes="routine.report", version=4)
def report(*products, names, missing, event, settings):
    """Result document and page of all instruments; missing: {instrument: reason}."""
    pages = {"accelerometer": page.PAGE, "magnetometer": magnetometer.PAGE}
    pages |= {"thrusters": thrusters.PAGE, "ranging": ranging.PAGE}
    return page.report(*products, names=names, missing=missing, pages=pages, event=event, settings=settings)


OBSERVATIONS = {part: f"gravcal.calibrations.{part}.observations" for part in ("magnetometer", "thrusters", "ranging")}
OBSERVATIONS = {"accelerometer": "gravcal.calibrations.routine.observations"} | OBSERVATIONS


@stage(reads=["*.discovery"], writes="routine.discovery_report", version=3, also=[*OBSERVATIONS.values()])
def discovered(*searches, parts, missing, event, settings):
    """Result document and page of the discoveries of all instruments (parts)."""
    reported = {part: importlib.import_module(name).REPORT for part, name in OBSERVATIONS.items()}
    return page.discovered(*searches, parts=parts, missing=missing, reported=reported, event=event, settings=settings)
