"""Stages of the centre-of-mass calibration: Datasets to Dataset, by `gravcal/calibrations/com_offset`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

aligning = lazy("gravcal.calibrations.com_offset.align")
modelling = lazy("gravcal.calibrations.com_offset.model")
attitudes = lazy("gravcal.calibrations.com_offset.attitude")
estimating = lazy("gravcal.calibrations.com_offset.estimate")
checking = lazy("gravcal.calibrations.com_offset.checks")
pages = lazy("gravcal.calibrations.com_offset.page")

KINDS = product.registered("com_offset", **schemas.of("com_offset.toml"))
ALIGNED, SMOOTHED, ANGULAR = (f"com_offset.{name}" for name in ("align", "attitude", "angular_acceleration"))


@stage(reads=["ingest"], writes="com_offset.detect", version=3)
def detect(magnetometer, **settings):
    """Manoeuvres (kind, start, stop) detected in the torquer currents."""
    return aligning.detect(magnetometer, **settings)


@stage(reads=["com_offset.detect", "ingest"], writes="com_offset.align", version=4)
def align(*observed, **settings):
    """Records about the manoeuvres on GPS time."""
    return aligning.align(*observed, **settings)


@stage(reads=["com_offset.align"], writes="com_offset.field", version=1)
def field(aligned, *, igrf_generation):
    """IGRF along the orbit, and the magnetometer's difference to it."""
    return modelling.field(aligned, igrf_generation=igrf_generation)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.attitude", version=4)
def attitude(aligned, checked, **settings):
    """Attitude by dynamics fitted to the star camera, and edge times of the manoeuvres in both instruments."""
    return attitudes.attitude(aligned, checked, **settings)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.survey", version=3)
def survey(aligned, checked):
    """Ratio of roll acceleration (star camera) to roll torque (torquer currents, measured field)."""
    return modelling.survey(aligned, checked)


@stage(reads=[ALIGNED, "com_offset.field", SMOOTHED, "ingest"], writes="com_offset.checks", version=3)
def checks(aligned, checked, smoothed, *others, **limits):
    """Consistency checks of the records against each other."""
    return checking.inputs(aligned, checked, smoothed, *others, **limits)


@stage(reads=["com_offset.align"], writes="com_offset.quiet", version=3)
def quiet(aligned, **settings):
    """Linear accelerations outside the manoeuvres, low-passed and resampled like the reading of a manoeuvre."""
    return estimating.quiet(aligned, **settings)


@stage(reads=["com_offset.quiet"], writes="com_offset.noise", version=3)
def noise(pieces, *, drift_degree, noise_order):
    """Autoregressive noise model of the linear accelerations from quiet data."""
    return estimating.noise(pieces, drift_degree=drift_degree, noise_order=noise_order)


@stage(reads=["com_offset.attitude", "com_offset.align"], writes="com_offset.angular_acceleration", version=1)
def angular_acceleration(smoothed, aligned, *, variant, **settings):
    """Angular acceleration by one of four methods (variant): mtq, acc_calibrated, acc, sca."""
    return modelling.angular_acceleration(smoothed, aligned, variant=variant, **settings)


@stage(reads=[ALIGNED, SMOOTHED, ANGULAR], writes="com_offset.equations", version=1)
def equations(aligned, smoothed, angular, **settings):
    """Observation equations of every manoeuvre for one angular acceleration: resampled reading, design columns."""
    return modelling.equations(aligned, smoothed, angular, **settings)


@stage(reads=["com_offset.equations", "com_offset.noise"], writes="com_offset.solve", version=3)
def solve(resampled, measured, *, drift_degree, noise_order):
    """Offset of every manoeuvre by one angular acceleration; measured: noise of the linear accelerations."""
    return estimating.solve(resampled, measured, drift_degree=drift_degree, noise_order=noise_order)


@stage(reads=[ALIGNED, SMOOTHED, ANGULAR], writes="com_offset.solve", version=2)
def published_solve(aligned, smoothed, angular):
    """Offset of every manoeuvre by the method as printed in 10.3390/rs14164030."""
    return estimating.published_solve(aligned, smoothed, angular)


@stage(reads=["com_offset.solve"], writes="com_offset.combine", version=1)
def combine(*solved, **settings):
    """Offset of all manoeuvres combined for each angular acceleration, with consistency tests."""
    return estimating.combine(*solved, **settings)


@stage(reads=["com_offset.combine"], writes="com_offset.combine", version=1)
def model_error(combined, *moved, added, determined_sigma_um):
    """Combined offset with the errors of an extended model; moved: results of its moved models, added: JSON."""
    return estimating.with_model_error(combined, *moved, added=added, determined_sigma_um=determined_sigma_um)


REPORTED = ["com_offset.combine", *["com_offset.solve"] * 4, *[ANGULAR] * 4, SMOOTHED]
REPORTED += [f"com_offset.{name}" for name in ("field", "survey", "detect", "align", "checks")]


@stage(reads=REPORTED, writes="com_offset.report", version=5)
def report(*products, event, satellite, settings, published):
    """Result document, page and line of the sequence-of-events file."""
    return pages.report(*products, event=event, satellite=satellite, settings=settings, published=published)
