"""Stages of the ranging calibration; the science is in `gravcal/calibrations/kbr_phase_centre`."""

from __future__ import annotations

from gravcal.calibrations.checks import CHECKS
from gravcal.calibrations.kbr_phase_centre import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

align_science = lazy("gravcal.calibrations.kbr_phase_centre.align")
pointing_science = lazy("gravcal.calibrations.kbr_phase_centre.pointing")
observable_science = lazy("gravcal.calibrations.kbr_phase_centre.observable")
noise_science = lazy("gravcal.calibrations.kbr_phase_centre.noise")
solve_science = lazy("gravcal.calibrations.kbr_phase_centre.solve")
routine_science = lazy("gravcal.calibrations.kbr_phase_centre.routine")
checks_science = lazy("gravcal.calibrations.kbr_phase_centre.checks")
combine_science = lazy("gravcal.calibrations.kbr_phase_centre.combine")
report_science = lazy("gravcal.report.kbr_phase_centre_delivery")

KINDS = {
    "kbr_phase_centre.align": schemas.ALIGN,
    "kbr_phase_centre.pointing": schemas.POINTING,
    "kbr_phase_centre.observable": schemas.OBSERVABLE,
    "kbr_phase_centre.noise": schemas.NOISE,
    "kbr_phase_centre.routine": schemas.ROUTINE,
    "kbr_phase_centre.solve": schemas.SOLVE,
    "kbr_phase_centre.combine": schemas.COMBINE,
    "kbr_phase_centre.checks": CHECKS,
    "kbr_phase_centre.report": schemas.REPORT,
}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)


@stage(reads=["ingest"], writes="kbr_phase_centre.align", version=1)
def align(*observed, gap_limit_s, break_limit_m):
    """Ranging, orbits and attitudes on GPS time."""
    return align_science.align(*observed, gap_limit_s=gap_limit_s, break_limit_m=break_limit_m)


@stage(reads=["kbr_phase_centre.align"], writes="kbr_phase_centre.pointing", version=1)
def pointing(aligned, *, nominal_m, given, period_s, offset_limit_deg, amplitude_limit_deg):
    """Observation geometry, and the wiggles in the pointing angles."""
    return pointing_science.pointing(
        aligned,
        nominal_m=nominal_m,
        given=given,
        period_s=period_s,
        offset_limit_deg=offset_limit_deg,
        amplitude_limit_deg=amplitude_limit_deg,
    )


@stage(reads=["kbr_phase_centre.align", "kbr_phase_centre.pointing"], writes="kbr_phase_centre.observable", version=1)
def observable(
    aligned,
    pointed,
    *,
    variant,
    trim_s,
    quiet_margin_s,
    crn_window_s,
    crn_bandwidth_hz,
    nominal_m,
    published_half_width,
):
    """Observation equations of range, range rate or range acceleration."""
    settings = {name: value for name, value in locals().items() if name not in ("aligned", "pointed")}
    return observable_science.observable(aligned, pointed, **settings)


@stage(reads=["kbr_phase_centre.observable"], writes="kbr_phase_centre.noise", version=1)
def noise(equations, *, noise_order, noise_degree, quiet_length_s, quiet_minimum_s):
    """Noise of the range in quiet data, and what the star cameras add in the manoeuvres."""
    settings = {name: value for name, value in locals().items() if name != "equations"}
    return noise_science.noise(equations, **settings)


@stage(reads=["kbr_phase_centre.observable", "kbr_phase_centre.noise"], writes="kbr_phase_centre.solve", version=1)
def solve(
    equations,
    measured,
    *,
    variant,
    method,
    orbit_degree,
    band_hz,
    robust_k0,
    robust_k1,
    nominal_m,
    published_trim_s,
):
    """Phase centres from one observable."""
    settings = {name: value for name, value in locals().items() if name not in ("equations", "measured")}
    return solve_science.solve(equations, measured, **settings)


@stage(reads=["kbr_phase_centre.solve"], writes="kbr_phase_centre.combine", version=1)
def combine(*solved, adopted_observable, adopted_estimator, determined_limit_mm, offset_deg):
    """The three observables beside each other."""
    return combine_science.combine(
        *solved,
        adopted_observable=adopted_observable,
        adopted_estimator=adopted_estimator,
        determined_limit_mm=determined_limit_mm,
        offset_deg=offset_deg,
    )


@stage(reads=["kbr_phase_centre.combine"], writes="kbr_phase_centre.combine", version=1)
def model_error(combined, *moved, determined_limit_mm):
    """The same with the errors of an extended model."""
    return combine_science.with_model_error(combined, *moved, determined_limit_mm=determined_limit_mm)


@stage(
    reads=[
        "kbr_phase_centre.align",
        "kbr_phase_centre.pointing",
        "kbr_phase_centre.observable",
        "kbr_phase_centre.noise",
    ],
    writes="kbr_phase_centre.routine",
    version=2,
)
def routine(
    aligned,
    pointed,
    equations,
    measured,
    *,
    orbit_degree,
    quiet_length_s,
    robust_k0,
    robust_k1,
    nominal_m,
    determined_limit_mm,
    routine_limit,
):
    """What routine pointing says of the phase centres."""
    inputs = ("aligned", "pointed", "equations", "measured")
    settings = {name: value for name, value in locals().items() if name not in inputs and name != "inputs"}
    return routine_science.routine(aligned, pointed, equations, measured, **settings)


@stage(
    reads=["kbr_phase_centre.align", "kbr_phase_centre.pointing", *2 * ["kbr_phase_centre.observable"], "ingest"],
    writes="kbr_phase_centre.checks",
    version=1,
)
def checks(
    aligned,
    pointed,
    ranges,
    rates,
    *orbits,
    nominal_m,
    velocity_limit_m_s,
    orbit_difference_limit_m,
    separation_minimum_km,
    separation_maximum_km,
    height_minimum_km,
    height_maximum_km,
    pointing_limit_deg,
    largest_angle_deg,
    roll_limit_deg,
    pointing_rate_limit_deg_s,
    range_limit_mm,
    range_rate_limit_um_s,
    range_rate_largest_um_s,
    ranging_minimum,
    correction_limit_mm,
):
    """What orbits, attitudes and ranging must satisfy against each other."""
    products = ("aligned", "pointed", "ranges", "rates", "orbits")
    settings = {name: value for name, value in locals().items() if name not in products}
    return checks_science.of_inputs(aligned, pointed, ranges, rates, *orbits, **settings)


@stage(
    reads=[
        "kbr_phase_centre.combine",
        "kbr_phase_centre.pointing",
        "kbr_phase_centre.noise",
        "kbr_phase_centre.routine",
        "kbr_phase_centre.checks",
        "kbr_phase_centre.solve",
    ],
    writes="kbr_phase_centre.report",
    version=1,
)
def report(*products, event, settings, published, nominal_m):
    """Result document, page, vector files and lines of the sequence-of-events file."""
    return report_science.report(*products, event=event, settings=settings, published=published, nominal_m=nominal_m)
