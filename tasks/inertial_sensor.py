"""Stages of the inertial-sensor calibration; the science is in `gravcal/calibrations/inertial_sensor`."""

from __future__ import annotations

from gravcal.calibrations.checks import CHECKS
from gravcal.calibrations.inertial_sensor import schemas
from gravcal.store import product
from tasks.stage import lazy, stage

files = lazy("gravcal.io.inertial_files")
detect_science = lazy("gravcal.calibrations.inertial_sensor.detect")
align_science = lazy("gravcal.calibrations.inertial_sensor.align")
scale_science = lazy("gravcal.calibrations.inertial_sensor.scale")
model_error_science = lazy("gravcal.calibrations.inertial_sensor.model_error")
offset_science = lazy("gravcal.calibrations.inertial_sensor.offset")
segment_science = lazy("gravcal.calibrations.inertial_sensor.segment")
bias_science = lazy("gravcal.calibrations.inertial_sensor.bias")
checks_science = lazy("gravcal.calibrations.inertial_sensor.checks")
report_science = lazy("gravcal.report.inertial_sensor")

KINDS = {
    "inertial_sensor.detect": schemas.DETECT,
    "inertial_sensor.align": schemas.ALIGN,
    "inertial_sensor.scale": schemas.SCALE,
    "inertial_sensor.offset": schemas.OFFSET,
    "inertial_sensor.segment": schemas.SEGMENT,
    "inertial_sensor.bias": schemas.BIAS,
    "inertial_sensor.checks": CHECKS,
    "inertial_sensor.report": schemas.REPORT,
}
for _kind, _schema in KINDS.items():
    product.register(_kind, _schema)


@stage(reads=["file"], writes="inertial_sensor.detect", version=1)
def detect(*attitudes, swing_rate_dot_rad_s2, swing_minimum_s, roll_rate_rad_s, segment_s):
    """Swings and rolls in the attitude."""
    return detect_science.detect(
        *(files.loader(one) for one in attitudes),
        swing_rate_dot_rad_s2=swing_rate_dot_rad_s2,
        swing_minimum_s=swing_minimum_s,
        roll_rate_rad_s=roll_rate_rad_s,
        segment_s=segment_s,
    )


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.align", version=1)
def align(detected, *observed, margin_s, spike_sigma, gap_limit_s):
    """Record round the swing."""
    return align_science.align(
        detected, *files.between(observed), margin_s=margin_s, spike_sigma=spike_sigma, gap_limit_s=gap_limit_s
    )


@stage(reads=["inertial_sensor.align"], writes="inertial_sensor.scale", version=1)
def scale(aligned, *, method, bin_s, quiet_margin_s, first_beta, arm_x_mm, k_y, k_y_sigma, geometry):
    """Angular and linear scale factors, tracker delay."""
    settings = {name: value for name, value in locals().items() if name != "aligned"}
    return scale_science.scale(aligned, **settings)


@stage(reads=["inertial_sensor.align", "inertial_sensor.scale"], writes="inertial_sensor.offset", version=3)
def offset(aligned, scaled, *, method, quiet_margin_s, drift_degree, noise_order):
    """Centre of mass to test mass."""
    settings = {name: value for name, value in locals().items() if name not in ("aligned", "scaled")}
    return offset_science.offset(aligned, scaled, **settings)


@stage(reads=["inertial_sensor.scale"], writes="inertial_sensor.scale", version=1)
def scale_model_error(scaled, *moved):
    """Scale factors with the errors of an extended model."""
    return model_error_science.of_scale(scaled, *moved)


@stage(reads=["inertial_sensor.offset"], writes="inertial_sensor.offset", version=2)
def offset_model_error(found, *moved):
    """Offset with the errors of an extended model."""
    return model_error_science.of_offset(found, *moved)


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.segment", version=2)
def segment(detected, *observed, step_s, workers):
    """Roll reduced to bins, day by day."""
    return segment_science.segment(detected, files.loaders(observed), step_s=step_s, workers=workers)


@stage(
    reads=["inertial_sensor.segment", "inertial_sensor.scale", "inertial_sensor.offset"],
    writes="inertial_sensor.bias",
    version=4,
)
def bias(
    segmented,
    *swing,
    method,
    segment_s,
    uniformity_limit,
    share_limit,
    trend_degree,
    amplitude_degree,
    amplitude_harmonics,
    k_z_before,
    assumed,
):
    """Bias of every segment and their robust mean."""
    settings = {name: value for name, value in locals().items() if name not in ("segmented", "swing")}
    return bias_science.bias(segmented, *swing, **settings)


@stage(reads=["inertial_sensor.bias"], writes="inertial_sensor.bias", version=1)
def bias_model_error(found, *moved):
    """Bias with the errors of an extended model."""
    return model_error_science.of_bias(found, *moved)


@stage(reads=["inertial_sensor.detect", "file"], writes="inertial_sensor.checks", version=1)
def checks(
    detected,
    *observed,
    margin_s,
    constant_limit_s,
    norm_limit,
    jump_limit_rad,
    velocity_limit_m_s,
    height_limit_m,
    pointing_limit_rad,
    expected_beta,
    factor_limit,
    orbit_height,
    inertia,
):
    """Voltages, attitude and orbit of the manoeuvres against each other."""
    settings = {name: value for name, value in locals().items() if name not in ("detected", "observed")}
    return checks_science.inputs(detected, files.loaders(observed), **settings)


@stage(reads=["inertial_sensor.*"], writes="inertial_sensor.report", version=2)
def report(*products, event, names, settings, published):
    """Result document and page."""
    return report_science.report(*products, event=event, names=names, settings=settings, published=published)
