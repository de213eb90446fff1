"""Stages of the calibration by routine pointing: Datasets to Dataset, by `gravcal/calibrations/ranging`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

model = lazy("gravcal.calibrations.ranging.model")
reports = lazy("gravcal.report.named_parameters")
page = lazy("gravcal.calibrations.ranging.page")

KINDS = product.registered("ranging", **schemas.of("ranging.toml"))


ALIGNED = [f"kbr_phase_centre.{name}" for name in ("align", "pointing", "observable")]


@stage(reads=ALIGNED, writes="ranging.align", version=6)
def align(aligned, pointed, equations, **settings):
    """Quiet ranging minus orbit, with design columns by smoothed pointing."""
    return model.align(aligned, pointed, equations, **settings)


@stage(reads=["ranging.align"], writes="ranging.estimate", version=3)
def estimate(rows, **settings):
    """Phase centres from routine pointing, and the share of the antenna correction that the range shows."""
    return model.estimate(rows, **settings)


@stage(reads=["kbr_phase_centre.checks", "ranging.estimate"], writes="ranging.checks", version=1)
def checks(pair, estimated, **settings):
    """Consistency checks of orbits, attitudes and ranging, and of the estimates of blocks."""
    return model.check(pair, estimated, **settings)


@stage(reads=["ranging.estimate", "ranging.align", "ranging.checks"], writes="ranging.report", version=1)
def report(*products, event, settings):
    """Result document and page."""
    return reports.report(page.PAGE, *products, event=event, settings=settings)
