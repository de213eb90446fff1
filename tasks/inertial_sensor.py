"""Stages of the inertial-sensor calibration: Datasets to Dataset, by `gravcal/calibrations/inertial_sensor`."""

import functools

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

files = lazy("gravcal.io.daily")
records = lazy("gravcal.calibrations.inertial_sensor.align")
estimating = lazy("gravcal.calibrations.inertial_sensor.estimate")
biases = lazy("gravcal.calibrations.inertial_sensor.bias")
checks_science = lazy("gravcal.calibrations.inertial_sensor.checks")
page = lazy("gravcal.calibrations.inertial_sensor.page")

KINDS = product.registered("inertial_sensor", **schemas.of("inertial_sensor.toml"))


@stage(reads=["file"], writes="inertial_sensor.detect", version=1)
def detect(*attitudes, **settings):
    """Swings and rolls detected in the attitude files (ATT)."""
    return records.detect(*(functools.partial(files.read, one) for one in attitudes), **settings)


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.align", version=2)
def align(detected, *observed, **settings):
    """Voltages, attitude and orbit about the swing, from the files of its days."""
    return records.align(detected, *files.between(observed), **settings)


@stage(reads=["inertial_sensor.align"], writes="inertial_sensor.scale", version=4)
def scale(aligned, **settings):
    """Angular and linear scale factors, and delay of the star tracker."""
    return estimating.scale(aligned, **settings)


@stage(reads=["inertial_sensor.align", "inertial_sensor.scale"], writes="inertial_sensor.offset", version=5)
def offset(aligned, scaled, **settings):
    """Offset vector from centre of mass to test mass."""
    return estimating.offset(aligned, scaled, **settings)


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.segment", version=3)
def segment(detected, *observed, **settings):
    """Record of the roll averaged in bins, day by day."""
    return records.segment(detected, files.loaders(observed), **settings)


SEGMENTED = [f"inertial_sensor.{name}" for name in ("segment", "scale", "offset")]


@stage(reads=SEGMENTED, writes="inertial_sensor.bias", version=6)
def bias(segmented, *swing, **settings):
    """Bias of every segment and their robust mean."""
    return biases.bias(segmented, *swing, **settings)


@stage(reads=["inertial_sensor.*"], writes="{kind}", version=3)
def model_error(solved, *moved, kind):
    """Scale factors, offset or bias with the errors of an extended model; moved: results of its moved models."""
    return biases.with_model_error(solved, *moved, kind=kind)


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.checks", version=1)
def checks(detected, *observed, **settings):
    """Consistency checks of voltages, attitude and orbit of the manoeuvres."""
    return checks_science.inputs(detected, files.loaders(observed), **settings)


@stage(reads=["inertial_sensor.*"], writes="inertial_sensor.report", version=3)
def report(*products, event, names, settings, published):
    """Result document and page."""
    return page.report(*products, event=event, names=names, settings=settings, published=published)
