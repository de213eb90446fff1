"""Stages of the gradient-torque calibration: Datasets to Dataset, by `gravcal/calibrations/gradient_torque`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

files = lazy("gravcal.io.daily")
field_files = lazy("gravcal.io.icgem")
model = lazy("gravcal.calibrations.gradient_torque.model")
estimate = lazy("gravcal.calibrations.gradient_torque.estimate")
checks_science = lazy("gravcal.calibrations.gradient_torque.checks")
page = lazy("gravcal.calibrations.gradient_torque.page")

GRADIENT, FIELD, DRAG = "gradient_torque.gradient", "gradient_torque.field", "gradient_torque.drag"
KINDS = product.registered("gradient_torque", **schemas.of("gradient_torque.toml"))


@stage(reads=["file"], writes="ingest", version=1)
def ingest(file):
    """Readings, attitude and orbit of one SGRS file (LevelOneFile)."""
    return files.read_sgrs(file)


@stage(reads=["file"], writes="gradient_torque.field", version=1)
def field(file):
    """Gravity field coefficients of a .gfc file (LevelOneFile of kind "GFC")."""
    return model.field(field_files.read_field(file.path))


@stage(reads=["file"], writes="gradient_torque.truth", version=1)
def truth(file):
    """True drag of a simulated day, from its file of truth."""
    return model.truth(files.read_sgrs(file, truth=True))


@stage(reads=["ingest", "gradient_torque.field"], writes="gradient_torque.gradient", version=2)
def gradient(observed, stored, **settings):
    """Gravity gradient in the body frame b, and smoothed angular rates."""
    return model.gradient(observed, stored, **settings)


@stage(reads=[GRADIENT, "ingest", FIELD], writes="gradient_torque.torque", version=3)
def torque(modelled, observed, stored, **settings):
    """Gravity-gradient torque by zonal degree."""
    return model.torque(modelled, observed, stored, **settings)


@stage(reads=["gradient_torque.gradient"], writes="gradient_torque.drag", version=4)
def drag(modelled, *, variant, **settings):
    """Drag by one method (variant): two_sensor, one_sensor_published, one_sensor."""
    return estimate.drag(modelled, variant=variant, **settings)


@stage(reads=["gradient_torque.drag"], writes="gradient_torque.drag", version=2)
def drag_model_error(solution, *moved, added):
    """Drag with the errors of an extended model; moved: results of its moved models, added: JSON."""
    return estimate.with_model_error(solution, *moved, added=added)


@stage(reads=[GRADIENT, f"{DRAG}|gradient_torque.truth"], writes="gradient_torque.combine", version=1)
def combine(*products, **settings):
    """Comparison of the drag by all methods, and identifiability of the parameters."""
    return estimate.combine(*products, **settings)


@stage(reads=["gradient_torque.gradient", "ingest"], writes="gradient_torque.checks", version=1)
def checks(modelled, observed, **settings):
    """Consistency checks of readings, attitude and orbit of a day."""
    return checks_science.inputs(modelled, observed, **settings)


REPORTED = ["gradient_torque.combine", "gradient_torque.torque", GRADIENT, "gradient_torque.checks", DRAG]


@stage(reads=REPORTED, writes="gradient_torque.report", version=4)
def report(*products, event, settings):
    """Result document and page."""
    return page.report(*products, event=event, settings=settings)
