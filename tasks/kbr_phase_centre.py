"""Stages of the ranging calibration: Datasets to Dataset, by `gravcal/calibrations/kbr_phase_centre`."""

from gravcal.calibrations import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

align_science = lazy("gravcal.calibrations.kbr_phase_centre.align")
model_science = lazy("gravcal.calibrations.kbr_phase_centre.model")
noise_science = lazy("gravcal.calibrations.kbr_phase_centre.noise")
estimate_science = lazy("gravcal.calibrations.kbr_phase_centre.estimate")
checks_science = lazy("gravcal.calibrations.kbr_phase_centre.checks")
report_science = lazy("gravcal.calibrations.kbr_phase_centre.page")

KINDS = product.registered("kbr_phase_centre", **schemas.of("kbr_phase_centre.toml"))
ALIGN, POINTING, OBSERVABLE, NOISE, SOLVE, COMBINE, REPORT, CHECKED = KINDS


@stage(reads=["ingest"], writes=ALIGN, version=3)
def align(*observed, **settings):
    """Ranging, orbits and attitudes on GPS time."""
    return align_science.align(*observed, **settings)


@stage(reads=[ALIGN], writes=POINTING, version=1)
def pointing(aligned, **settings):
    """Line of sight in both body frames, and the wiggles (attitude manoeuvres) in the pointing angles."""
    return model_science.pointing(aligned, **settings)


@stage(reads=[ALIGN, POINTING], writes=OBSERVABLE, version=1)
def observable(aligned, pointed, *, variant, **settings):
    """Observation equations of range, range rate or range acceleration."""
    return model_science.observable(aligned, pointed, variant=variant, **settings)


@stage(reads=[OBSERVABLE], writes=NOISE, version=2)
def noise(equations, **settings):
    """Noise of the range in quiet data, and that of the star cameras in the manoeuvres."""
    return noise_science.noise(equations, **settings)


@stage(reads=[OBSERVABLE, NOISE], writes=SOLVE, version=6)
def solve(equations, measured, *, variant, **settings):
    """Phase centres of both satellites from one observable (variant); measured: its noise."""
    return estimate_science.solve(equations, measured, variant=variant, **settings)


@stage(reads=[SOLVE], writes=COMBINE, version=1)
def combine(*solved, **settings):
    """Solutions of the three observables compared, and the one adopted."""
    return estimate_science.combine(*solved, **settings)


@stage(reads=[COMBINE], writes=COMBINE, version=1)
def model_error(combined, *moved, **settings):
    """Combined solution with the errors of an extended model; moved: results of its moved models."""
    return estimate_science.with_model_error(combined, *moved, **settings)


@stage(reads=[ALIGN, POINTING, OBSERVABLE, OBSERVABLE, "ingest"], writes=CHECKED, version=2)
def checks(aligned, pointed, ranges, rates, *orbits, **settings):
    """Consistency checks of orbits, attitudes and ranging."""
    return checks_science.of_inputs(aligned, pointed, ranges, rates, *orbits, **settings)


@stage(reads=[COMBINE, POINTING, NOISE, CHECKED, SOLVE], writes=REPORT, version=4)
def report(*products, event, settings, published, nominal_m):
    """Result document, page, vector files and lines of the sequence-of-events file."""
    return report_science.report(*products, event=event, settings=settings, published=published, nominal_m=nominal_m)
