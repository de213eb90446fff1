"""Stages of the centre-of-mass calibration; the science is in `gravcal/calibrations/com_offset`."""

from __future__ import annotations

from gravcal.calibrations import align_schema
from gravcal.calibrations.checks import CHECKS
from gravcal.calibrations.com_offset import equations_schema, schemas
from gravcal.store import product
from tasks.stage import lazy, stage

detect_science = lazy("gravcal.calibrations.com_offset.detect")
align_science = lazy("gravcal.calibrations.align")
field_science = lazy("gravcal.calibrations.com_offset.field")
attitude_science = lazy("gravcal.calibrations.com_offset.attitude")
survey_science = lazy("gravcal.calibrations.com_offset.survey")
noise_science = lazy("gravcal.calibrations.com_offset.noise")
angular_science = lazy("gravcal.calibrations.com_offset.angular_acceleration")
equations_science = lazy("gravcal.calibrations.com_offset.equations")
solve_science = lazy("gravcal.calibrations.com_offset.solve")
published_science = lazy("gravcal.calibrations.com_offset.published_solve")
checks_science = lazy("gravcal.calibrations.com_offset.checks")
combine_science = lazy("gravcal.calibrations.com_offset.combine")

report_science = lazy("gravcal.calibrations.com_offset.page")

KINDS = {
    "com_offset.detect": schemas.DETECT,
    "com_offset.align": align_schema.ALIGN,
    "com_offset.field": schemas.FIELD,
    "com_offset.attitude": schemas.ATTITUDE,
    "com_offset.survey": schemas.SURVEY,
    "com_offset.checks": CHECKS,
    "com_offset.quiet": equations_schema.QUIET,
    "com_offset.noise": schemas.NOISE,
    "com_offset.angular_acceleration": schemas.ANGULAR,
    "com_offset.equations": equations_schema.EQUATIONS,
    "com_offset.solve": schemas.SOLVE,
    "com_offset.combine": schemas.COMBINE,
    "com_offset.report": schemas.REPORT,
}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)


@stage(reads=["ingest"], writes="com_offset.detect", version=2)
def detect(magnetometer, *, period_s, period_tolerance_s, minimum_half_periods, current_threshold_ma):
    """Manoeuvres in the torquer currents."""
    return detect_science.detect(
        magnetometer,
        period_s=period_s,
        period_tolerance_s=period_tolerance_s,
        minimum_half_periods=minimum_half_periods,
        current_threshold_ma=current_threshold_ma,
    )


@stage(reads=["com_offset.detect", "ingest"], writes="com_offset.align", version=1)
def align(*observed, margin_s, clock_gap_limit_s, orbit_gap_limit_s, star_camera_gap_limit_s, survey_s):
    """Records round the manoeuvres on GPS time."""
    settings = {name: value for name, value in locals().items() if name != "observed"}
    return align_science.align(*observed, **settings)


@stage(reads=["com_offset.align"], writes="com_offset.field", version=1)
def field(aligned, *, igrf_generation):
    """IGRF along the orbit, and the magnetometer's difference to it."""
    return field_science.field(aligned, igrf_generation=igrf_generation)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.attitude", version=1)
def attitude(
    aligned,
    checked,
    *,
    dynamics,
    torque_degree,
    estimate_torque_scale,
    torque_scale_sigma,
    estimate_inertia,
    inertia_scale_sigma,
    edge_shift_sigma_s,
    integration_step_s,
    iteration_limit,
    attitude_noise_order,
    calibration_drift_degree,
    lowpass_hz,
    half_width_s,
    step_s,
    inertia,
    dipole_per_current,
):
    """Dynamics fitted to the star camera, edge times in both instruments."""
    settings = {name: value for name, value in locals().items() if name not in ("aligned", "checked")}
    return attitude_science.attitude(aligned, checked, **settings)


@stage(reads=["com_offset.align", "com_offset.field"], writes="com_offset.survey", version=1)
def survey(aligned, checked):
    """Torque against roll acceleration."""
    return survey_science.survey(aligned, checked)


@stage(
    reads=["com_offset.align", "com_offset.field", "com_offset.attitude", "ingest"],
    writes="com_offset.checks",
    version=1,
)
def checks(
    aligned,
    checked,
    smoothed,
    *others,
    check_piece_s,
    velocity_limit_m_s,
    gravity_limit_m_s2,
    orbit_limit_m,
    height_lowest_km,
    height_greatest_km,
    pointing_limit_deg,
    field_limit_nt,
    unchanged_limit_s,
    attitude_limit_urad,
    scale_limit,
    delay_limit_s,
):
    """Records against each other."""
    limits = {n: v for n, v in locals().items() if n not in ("aligned", "checked", "smoothed", "others")}
    return checks_science.inputs(aligned, checked, smoothed, *others, **limits)


@stage(reads=["com_offset.align"], writes="com_offset.quiet", version=1)
def quiet(aligned, *, lowpass_hz, half_width_s, step_s, quiet_margin_s):
    """Linear channels outside the manoeuvres."""
    settings = {name: value for name, value in locals().items() if name != "aligned"}
    return noise_science.quiet(aligned, **settings)


@stage(reads=["com_offset.quiet"], writes="com_offset.noise", version=2)
def noise(pieces, *, drift_degree, noise_order):
    """Noise of the linear channels in quiet data."""
    return noise_science.noise(pieces, drift_degree=drift_degree, noise_order=noise_order)


@stage(reads=["com_offset.attitude", "com_offset.align"], writes="com_offset.angular_acceleration", version=1)
def angular_acceleration(
    smoothed,
    aligned,
    *,
    variant,
    method,
    inertia,
    inertia_sigma,
    dipole_per_current,
    dipole_per_current_sigma,
):
    """One of the four angular accelerations."""
    settings = {name: value for name, value in locals().items() if name not in ("smoothed", "aligned")}
    return angular_science.angular_acceleration(smoothed, aligned, **settings)


@stage(
    reads=["com_offset.align", "com_offset.attitude", "com_offset.angular_acceleration"],
    writes="com_offset.equations",
    version=1,
)
def equations(aligned, smoothed, angular, *, variant, lowpass_hz, half_width_s, step_s):  # noqa: ARG001 - of the name
    """Resampled reading and columns of every manoeuvre for one angular acceleration."""
    settings = {"lowpass_hz": lowpass_hz, "half_width_s": half_width_s, "step_s": step_s}
    return equations_science.equations(aligned, smoothed, angular, **settings)


@stage(reads=["com_offset.equations", "com_offset.noise"], writes="com_offset.solve", version=2)
def solve(resampled, measured, *, variant, drift_degree, noise_order):  # noqa: ARG001 - of the name
    """Offset of every manoeuvre from one angular acceleration."""
    return solve_science.solve(resampled, measured, drift_degree=drift_degree, noise_order=noise_order)


@stage(
    reads=["com_offset.align", "com_offset.attitude", "com_offset.angular_acceleration"],
    writes="com_offset.solve",
    version=1,
)
def published_solve(aligned, smoothed, angular, *, variant):  # noqa: ARG001 - of the name
    """The same as printed in the source paper."""
    return published_science.solve(aligned, smoothed, angular)


@stage(reads=["com_offset.solve"], writes="com_offset.combine", version=1)
def combine(*solved, method, determined_sigma_um, consistency_level, drag_sigma_m_s2, period_s):
    """Manoeuvres joined, and whether they and the angular accelerations agree."""
    settings = {name: value for name, value in locals().items() if name != "solved"}
    return combine_science.combine(*solved, **settings)


@stage(reads=["com_offset.combine"], writes="com_offset.combine", version=1)
def model_error(combined, *moved, determined_sigma_um):
    """The same with the errors of an extended model."""
    return combine_science.with_model_error(combined, *moved, determined_sigma_um=determined_sigma_um)


@stage(
    reads=[
        "com_offset.combine",
        *["com_offset.solve"] * 4,
        *["com_offset.angular_acceleration"] * 4,
        "com_offset.attitude",
        "com_offset.field",
        "com_offset.survey",
        "com_offset.detect",
        "com_offset.align",
        "com_offset.checks",
    ],
    writes="com_offset.report",
    version=5,
)
def report(*products, event, satellite, settings, published):
    """Result document, page and line of the sequence-of-events file."""
    return report_science.report(*products, event=event, satellite=satellite, settings=settings, published=published)
