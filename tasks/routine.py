"""Stages of a routine day: its accelerometer is in `gravcal/calibrations/routine`, the rest with its own names."""

from __future__ import annotations

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

science = lazy("gravcal.calibrations.routine.accelerometer")
page = lazy("gravcal.calibrations.routine.page")
magnetometer = lazy("gravcal.calibrations.magnetometer.page")
thrusters = lazy("gravcal.calibrations.thrusters.page")
ranging = lazy("gravcal.calibrations.ranging.page")

KINDS = product.registered("routine", **schemas.of("routine.toml"))


@stage(reads=["ingest"], writes="routine.align", version=1)
def align(*observed, **settings):
    """Readings of the accelerometer over steps, with torquers and firings beside them."""
    return science.align(*observed, **settings)


@stage(reads=["routine.align"], writes="routine.estimate", version=1)
def estimate(aligned, **settings):
    """What firings, torquers and turns make of the readings."""
    return science.estimate(aligned, **settings)


@stage(reads=["routine.estimate"], writes="routine.checks", version=1)
def checks(found, **settings):
    """Parts of the result."""
    return science.check(found, **settings)


@stage(reads=["*"], writes="routine.report", version=1)
def report(*products, names, missing, event, settings):
    """Result document and page of all instruments."""
    pages = {"accelerometer": page.PAGE, "magnetometer": magnetometer.PAGE}
    pages |= {"thrusters": thrusters.PAGE, "ranging": ranging.PAGE}
    return page.report(*products, names=names, missing=missing, pages=pages, event=event, settings=settings)
