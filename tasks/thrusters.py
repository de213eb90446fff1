"""Stages of the thruster calibration: Datasets to Dataset, by `gravcal/calibrations/thrusters`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

model = lazy("gravcal.calibrations.thrusters.model")
estimation = lazy("gravcal.calibrations.thrusters.estimate")
observations = lazy("gravcal.calibrations.thrusters.observations")
heads_science = lazy("gravcal.calibrations.thrusters.noise")
named_parameters = lazy("gravcal.calibrations.named_parameters")
reports = lazy("gravcal.report.named_parameters")
page = lazy("gravcal.calibrations.thrusters.page")

KINDS = product.registered("thrusters", **schemas.of("thrusters.toml"))


@stage(reads=["ingest"], writes="thrusters.align", version=2)
def align(observed, fired, orbit, *twin, **settings):
    """Attitude, firings of both satellites and orbit of one day."""
    return model.align(observed, fired, orbit, *twin, **settings)


@stage(reads=["thrusters.align"], writes="thrusters.noise", version=1)
def noise(aligned, **settings):
    """Noise of the attitude between firings."""
    return model.quiet_noise(aligned, **settings)


@stage(reads=["ingest"], writes="thrusters.heads", version=1)
def heads(observed, **settings):
    """Relative mounting of the star camera heads, and their noise."""
    return heads_science.heads(observed, **settings)


@stage(reads=["thrusters.align", "thrusters.noise"], writes="thrusters.estimate", version=2)
def estimate(aligned, measured, **settings):
    """Gain of the thruster impulses and delay of their time tags."""
    return estimation.estimate(aligned, measured, **settings)


@stage(reads=["thrusters.estimate"], writes="thrusters.estimate", version=1)
def model_error(estimated, *moved):
    """Estimate with the errors of an extended model; moved: results of its moved models."""
    return named_parameters.with_model_error(estimated, *moved)


@stage(reads=["thrusters.align", "thrusters.estimate"], writes="thrusters.checks", version=3)
def checks(aligned, estimated, **settings):
    """Consistency checks of attitude, orbit and firings, and of the estimates of parts of the day."""
    return estimation.check(aligned, estimated, **settings)


REPORTED = [f"thrusters.{name}" for name in ("estimate", "noise", "align", "checks", "heads")]


@stage(reads=REPORTED, writes="thrusters.report", version=2)
def report(*products, event, settings):
    """Result document and page; the heads are the last product, where there is SCA1A."""
    return reports.report(page.PAGE, *products, event=event, settings=settings)
