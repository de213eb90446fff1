"""Stages of the magnetometer calibration; the science is in `gravcal/calibrations/magnetometer`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

model = lazy("gravcal.calibrations.magnetometer.model")
estimation = lazy("gravcal.calibrations.magnetometer.estimate")
named_parameters = lazy("gravcal.calibrations.named_parameters")
reports = lazy("gravcal.report.named_parameters")
page = lazy("gravcal.calibrations.magnetometer.page")

KINDS = product.registered("magnetometer", **schemas.of("magnetometer.toml"))


@stage(reads=["ingest"], writes="magnetometer.align", version=3)
def align(observed, camera, orbit, **settings):
    """Measured and reference field in the body."""
    return model.align(observed, camera, orbit, **settings)


@stage(reads=["magnetometer.align"], writes="magnetometer.estimate", version=1)
def estimate(aligned, **settings):
    """Bias, scale, axes and leak of the torquers."""
    return estimation.estimate(aligned, **settings)


@stage(reads=["magnetometer.estimate"], writes="magnetometer.estimate", version=1)
def model_error(found, *moved):
    """Estimate with the errors of an extended model."""
    return named_parameters.with_model_error(found, *moved)


@stage(reads=["magnetometer.align", "magnetometer.estimate"], writes="magnetometer.checks", version=2)
def checks(aligned, found, **settings):
    """Field, attitude and orbit against each other, and parts of the result."""
    return estimation.check(aligned, found, **settings)


REPORTED = [f"magnetometer.{name}" for name in ("estimate", "align", "checks")]


@stage(reads=REPORTED, writes="magnetometer.report", version=1)
def report(*products, event, settings):
    """Result document and page."""
    return reports.report(page.PAGE, *products, event=event, settings=settings)
