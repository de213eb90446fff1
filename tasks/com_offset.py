"""Stages of the centre-of-mass calibration; the science is in `gravcal/calibrations/com_offset`."""

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


@stage(reads=["ingest"], writes="com_offset.detect", version=2)
def detect(magnetometer, **settings):
    """Manoeuvres in the torquer currents."""
    return aligning.detect(magnetometer, **settings)


@stage(reads=["com_offset.detect", "ingest"], writes="com_offset.align", version=2)
def align(*observed, **settings):
    """Records round the manoeuvres on GPS time."""
    return aligning.align(*observed, **settings)


@stage(reads=["com_offset.align"], writes="com_offset.field", version=1)
def field(aligned, *, igrf_generation):
    """IGRF along the orbit, and the magnetometer's difference to it."""
    return modelling.field(aligned, igrf_generation=igrf_generation)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.attitude", version=2)
def attitude(aligned, checked, **settings):
    """Dynamics fitted to the star camera, edge times in both instruments."""
    return attitudes.attitude(aligned, checked, **settings)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.survey", version=2)
def survey(aligned, checked):
    """Torque against roll acceleration."""
    return modelling.survey(aligned, checked)


@stage(reads=[ALIGNED, "com_offset.field", SMOOTHED, "ingest"], writes="com_offset.checks", version=3)
def checks(aligned, checked, smoothed, *others, **limits):
    """Records against each other."""
    return checking.inputs(aligned, checked, smoothed, *others, **limits)


@stage(reads=["com_offset.align"], writes="com_offset.quiet", version=2)
def quiet(aligned, **settings):
    """Linear channels outside the manoeuvres."""
    return estimating.quiet(aligned, **settings)


@stage(reads=["com_offset.quiet"], writes="com_offset.noise", version=3)
def noise(pieces, *, drift_degree, noise_order):
    """Noise of the linear channels in quiet data."""
    return estimating.noise(pieces, drift_degree=drift_degree, noise_order=noise_order)


@stage(reads=["com_offset.attitude", "com_offset.align"], writes="com_offset.angular_acceleration", version=1)
def angular_acceleration(smoothed, aligned, *, variant, **settings):
    """One of the four angular accelerations."""
    return modelling.angular_acceleration(smoothed, aligned, variant=variant, **settings)


@stage(reads=[ALIGNED, SMOOTHED, ANGULAR], writes="com_offset.equations", version=1)
def equations(aligned, smoothed, angular, **settings):
    """Resampled reading and columns of every manoeuvre for one angular acceleration."""
    return modelling.equations(aligned, smoothed, angular, **settings)


@stage(reads=["com_offset.equations", "com_offset.noise"], writes="com_offset.solve", version=3)
def solve(resampled, measured, *, drift_degree, noise_order):
    """Offset of every manoeuvre from one angular acceleration."""
    return estimating.solve(resampled, measured, drift_degree=drift_degree, noise_order=noise_order)


@stage(reads=[ALIGNED, SMOOTHED, ANGULAR], writes="com_offset.solve", version=1)
def published_solve(aligned, smoothed, angular):
    """The same as printed in the source paper."""
    return estimating.published_solve(aligned, smoothed, angular)


@stage(reads=["com_offset.solve"], writes="com_offset.combine", version=1)
def combine(*solved, **settings):
    """Manoeuvres joined, and whether they and the angular accelerations agree."""
    return estimating.combine(*solved, **settings)


@stage(reads=["com_offset.combine"], writes="com_offset.combine", version=1)
def model_error(combined, *moved, added, determined_sigma_um):
    """The same with the errors of an extended model."""
    return estimating.with_model_error(combined, *moved, added=added, determined_sigma_um=determined_sigma_um)


REPORTED = ["com_offset.combine", *["com_offset.solve"] * 4, *[ANGULAR] * 4, SMOOTHED]
REPORTED += [f"com_offset.{name}" for name in ("field", "survey", "detect", "align", "checks")]


@stage(reads=REPORTED, writes="com_offset.report", version=5)
def report(*products, event, satellite, settings, published):
    """Result document, page and line of the sequence-of-events file."""
    return pages.report(*products, event=event, satellite=satellite, settings=settings, published=published)
