"""Stages of the magnetometer calibration: Datasets to Dataset, by `gravcal/calibrations/magnetometer`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

model = lazy("gravcal.calibrations.magnetometer.model")
estimation = lazy("gravcal.calibrations.magnetometer.estimate")
cdf = lazy("gravcal.io.cdf")
named_parameters = lazy("gravcal.calibrations.named_parameters")
reports = lazy("gravcal.report.named_parameters")
page = lazy("gravcal.calibrations.magnetometer.page")

KINDS = product.registered("magnetometer", **schemas.of("magnetometer.toml"))


@stage(reads=["ingest"], writes="magnetometer.align", version=5)
def align(observed, camera, orbit, **settings):
    """Measured and reference field in the body frame."""
    return model.align(observed, camera, orbit, **settings)


@stage(reads=["magnetometer.align"], writes="magnetometer.estimate", version=1)
def estimate(aligned, **settings):
    """Bias, scale factors, axes and torquer coupling of the magnetometer."""
    return estimation.estimate(aligned, **settings)


@stage(reads=["magnetometer.estimate"], writes="magnetometer.estimate", version=1)
def model_error(estimated, *moved):
    """Estimate with the errors of an extended model; moved: results of its moved models."""
    return named_parameters.with_model_error(estimated, *moved)


@stage(reads=["magnetometer.align", "magnetometer.estimate"], writes="magnetometer.checks", version=3)
def checks(aligned, estimated, **settings):
    """Consistency checks of field, attitude and orbit, and of the estimates of parts of the day."""
    return estimation.check(aligned, estimated, **settings)


@stage(reads=["file"], writes="magnetometer.theirs", version=2)
def theirs(file):
    """Calibrated field of a CDF file."""
    values, origin = cdf.read(file)
    return schemas.build(KINDS["magnetometer.theirs"], values, origin=origin)


READ = ["magnetometer.align", "magnetometer.estimate", "ingest", "ingest", "magnetometer.theirs"]


@stage(reads=READ, writes="magnetometer.beside", version=3)
def beside(aligned, estimated, camera, orbit, published, **settings):
    """Calibrated field published by others (CDF) less ours, and the parameters that it implies."""
    return estimation.compare(aligned, estimated, camera, orbit, published, **settings)


REPORTED = [f"magnetometer.{name}" for name in ("estimate", "align", "checks", "beside")]


@stage(reads=REPORTED, writes="magnetometer.report", version=2)
def report(*products, event, settings):
    """Result document and page; the field of others is the fourth product, if there is one."""
    own = page.PAGE if len(products) < len(REPORTED) else page.BESIDE
    return reports.report(own, *products, event=event, settings=settings)
