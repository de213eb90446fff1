"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import column

#: Of every manoeuvre, and of every way in which an angular acceleration may be wrong.
MANOEUVRES = {
    "kind": column("manoeuvre", "1", "axis of the torque: 0 roll, 1 pitch, 2 yaw", dtype="i1"),
    "start": column("manoeuvre", "s", "first edge, middle of its interval"),
    "stop": column("manoeuvre", "s", "last edge, middle of its interval"),
}
MODES = {
    "mode_shared": column("mode_index", "1", "in all manoeuvres", dtype="i1"),
    "mode_catalogue": column("mode_index", "1", "from inertia and dipole of the catalogue", dtype="i1"),
}
LATITUDE = column("manoeuvre", "rad", "geocentric latitude at the middle")

DETECT = {
    **MANOEUVRES,
    "rod": column("manoeuvre", "1", "torquer with the wave: 0 x, 1 y, 2 z", dtype="i1"),
    "edge_lower": column("manoeuvre edge", "s", "last telemetry sample before an edge"),
    "edge_upper": column("manoeuvre edge", "s", "first telemetry sample after an edge"),
    "level": column("manoeuvre half_period", "mA", "mean current of each half period"),
    "regular": column("manoeuvre", "1", "edges are whole half periods apart", dtype="i1"),
    "record_start": column("", "s", "first telemetry sample"),
    "record_stop": column("", "s", "last telemetry sample"),
}

FIELD = {
    "time_orbit": column("time_orbit"),
    "time_mag": column("time_mag"),
    "field_i": column("time_orbit axis", "T", "IGRF", frame="i"),
    "position_i": column("time_orbit axis", "m", "position of the centre of mass", frame="i"),
    "latitude": column("time_orbit", "rad", "geocentric latitude"),
    "longitude": column("time_orbit", "rad", "longitude"),
    "model_b": column("time_mag axis", "T", "IGRF in the SRF", frame="b"),
    "measured_b": column("time_mag axis", "T", "magnetometer", frame="b"),
    "difference_b": column("time_mag axis", "T", "magnetometer minus IGRF", frame="b"),
    "used": column("time_mag", "1", "in the statistics", dtype="u1"),
    "bias": column("axis", "T", "difference, bias", frame="b"),
    "rms": column("axis", "T", "difference, rms", frame="b"),
    "maximum": column("axis", "T", "difference, maximum", frame="b"),
}

SURVEY = {
    "time_sca": column("time_sca"),
    "roll_rate": column("time_sca", "rad s-1", "roll rate, star camera", frame="b"),
    "roll_impulse": column("time_sca", "mA T s", "roll torque, torquer current times field, integrated", frame="b"),
    "slope": column("", "rad s-2 mA-1 T-1", "dipole per current over roll inertia"),
    "slope_sigma": column("", "rad s-2 mA-1 T-1", "its standard deviation"),
}

ATTITUDE = {
    "rod": column("arc", "1", "torquer with the wave: 0 x, 1 y, 2 z, -1 none", dtype="i1"),
    "gap": column("arc", "1", "too long to use the arc: 1 orbit, 2 star camera", dtype="u1"),
    "time_sca": column("time_sca"),
    "time_acc": column("time_acc"),
    "rate_b": column("time_acc axis", "rad s-1", "body rate", frame="b"),
    "rate_dot_mtq_b": column(
        "time_acc axis", "rad s-2", "angular acceleration of the dynamics, catalogue torque", frame="b"
    ),
    "rate_dot_sca_b": column("time_acc axis", "rad s-2", "angular acceleration seen by the star camera", frame="b"),
    "magnetic_b": column("time_acc axis", "rad s-2", "part of the torquers, catalogue torque", frame="b"),
    "smooth_b": column("time_acc axis", "rad s-2", "part that is not of the torquers", frame="b"),
    "gradient_b": column("time_acc axis axis_2", "s-2", "gravity gradient", frame="b"),
    "sca_modes": column(
        "mode time_acc axis", "rad s-2", "change of rate_dot_sca_b for one standard deviation", frame="b"
    ),
    "acc_manoeuvre": column("time_acc", "1", "manoeuvre of the epoch", dtype="i2"),
    "sca_shift": column("arc", "s", "edges seen by the star camera, later than assumed"),
    "sca_shift_sigma": column("arc", "s", "sca shift, standard deviation"),
    "acc_shift": column("arc", "s", "edges seen by the accelerometer, later than assumed"),
    "acc_shift_sigma": column("arc", "s", "acc shift, standard deviation"),
    "torque_scale": column("arc axis", "1", "magnetic torque over the catalogue, seen by the star camera", frame="b"),
    "torque_scale_sigma": column("arc axis", "1", "torque scale, standard deviation", frame="b"),
    "angular_scale": column("arc axis", "1", "angular accelerometer over torquer", frame="b"),
    "angular_scale_sigma": column("arc axis", "1", "angular scale, standard deviation", frame="b"),
    "residual_rms": column("arc axis", "rad", "star camera minus model, rms", frame="b"),
    "sca_residual_b": column("time_sca axis", "rad", "measured minus model", frame="b"),
    "sca_manoeuvre": column("time_sca", "1", "manoeuvre of the epoch", dtype="i2"),
    "acc_delay": column("", "s", "tag late against the torquer telemetry"),
    "acc_delay_sigma": column("", "s", "tag late against the torquer telemetry"),
    "sca_delay": column("", "s", "tag late against the torquer telemetry"),
    "sca_delay_sigma": column("", "s", "tag late against the torquer telemetry"),
}

ANGULAR = {
    "time_acc": column("time_acc"),
    "rate_dot_b": column("time_acc axis", "rad s-2", "angular acceleration, acc_calibrated", frame="b"),
    "mode": column("mode_index time_acc axis", "rad s-2", "change for one standard deviation", frame="b"),
    **MODES,
    "ratio": column("axis", "1", "this angular acceleration over the torquer, all manoeuvres"),
    "scale": column("axis", "1", "torquer over angular accelerometer"),
    "scale_sigma": column("axis", "1", "its standard deviation"),
    "acc_manoeuvre": column("time_acc", "1", "manoeuvre of the epoch", dtype="i2"),
}

NOISE = {
    "frequency": column("frequency", "Hz", "frequency"),
    "reflection": column("axis lag", "1", "reflection coefficients", frame="b"),
    "variance": column("axis order", "m2 s-4", "prediction-error variance", frame="b"),
    "density": column("axis frequency", "m2 s-4 Hz-1", "one-sided noise density as measured", frame="b"),
    "seconds": column("", "s", "length of the quiet data"),
}

SOLVE = {
    "time_grid": column("time_grid"),
    "frequency": column("frequency", "Hz", "frequency"),
    "offset": column("manoeuvre axis", "m", "proof mass to centre of mass", frame="b"),
    "latitude": LATITUDE,
    "right": column("manoeuvre axis", "m-1", "right-hand side Z'y", frame="b"),
    "normal": column("manoeuvre axis axis_2", "m-2", "normal matrix Z'A", frame="b"),
    "information": column("manoeuvre axis axis_2", "m-2", "inverse covariance", frame="b"),
    "mode_shift": column("manoeuvre mode_index axis", "m", "change for one sigma", frame="b"),
    "chi2": column("manoeuvre", "1", "whitened residuals"),
    "dof": column("manoeuvre", "1", "degrees of freedom", dtype="i4"),
    **MANOEUVRES,
    "reading": column("time_grid axis", "m s-2", "linear acceleration, drift removed", frame="b"),
    "model": column("time_grid axis", "m s-2", "modelled linear acceleration, drift removed", frame="b"),
    "grid_manoeuvre": column("time_grid", "1", "manoeuvre", dtype="i2"),
    "noise_density": column("axis frequency", "m2 s-4 Hz-1", "one-sided noise density as measured"),
    **MODES,
}

COMBINE = {
    "offset": column("variant axis", "m", "proof mass to centre of mass", frame="b"),
    "covariance": column("variant axis axis_2", "m2", "covariance of the offset", frame="b"),
    "covariance_total": column(
        "variant axis axis_2", "m2", "with the error of inertia and dipole per current", frame="b"
    ),
    "determined": column("variant axis", "1", "1 where the component is determined", dtype="u1"),
    "chi2": column("variant", "1", "disagreement of the manoeuvres with their combination"),
    "dof": column("variant", "1", "degrees of freedom", dtype="i8"),
    "manoeuvre_offset": column("variant manoeuvre axis", "m", "proof mass to centre of mass", frame="b"),
    "manoeuvre_covariance": column("variant manoeuvre axis axis_2", "m2", "covariance of the offset", frame="b"),
    "manoeuvre_determined": column("variant manoeuvre axis", "1", "1 determined", dtype="u1"),
    "manoeuvre_chi2": column("variant manoeuvre", "1", "squared whitened residuals"),
    "manoeuvre_dof": column("variant manoeuvre", "1", "degrees of freedom", dtype="i4"),
    "variants_chi2": column("", "1", "disagreement of acc and sca"),
    "variants_dof": column("", "1", "degrees of freedom", dtype="i8"),
    "catalogue_chi2": column("", "1", "disagreement of mtq and acc, catalogue's error within"),
    "catalogue_dof": column("", "1", "degrees of freedom", dtype="i8"),
    **MANOEUVRES,
}

REPORT = {
    "offset": column("axis", "m", "proof mass to centre of mass, adopted", frame="b"),
    "sigma": column("axis", "m", "its standard deviation", frame="b"),
    "sigma_total": column("axis", "m", "with inertia and dipole per current", frame="b"),
}

#: Epochs of both need not increase: windows may overlap, and with them the pieces of quiet data.
QUIET = {
    "epoch": column("sample", "s", "GPS time of a sample, piece after piece"),
    "piece": column("sample", "1", "piece of quiet data", dtype="i2"),
    "reading": column("sample axis", "m s-2", "linear acceleration", frame="b"),
}

EQUATIONS = {
    "epoch": column("sample", "s", "GPS time of a sample, manoeuvre after manoeuvre"),
    "grid_manoeuvre": column("sample", "1", "manoeuvre", dtype="i2"),
    "valid": column("sample", "1", "enough samples round the epoch", dtype="u1"),
    "reading": column("sample axis", "m s-2", "linear acceleration", frame="b"),
    "still": column(
        "sample axis axis_2", "s-2", "reading for a metre of offset, without angular acceleration", frame="b"
    ),
    "rate_dot_b": column("sample axis", "rad s-2", "angular acceleration", frame="b"),
    "driven_b": column(
        "instrument sample axis",
        "rad s-2",
        "angular acceleration of the dynamics, without the noise of a sensor",
        frame="b",
    ),
    "mode": column("mode_index sample axis", "rad s-2", "change for one standard deviation", frame="b"),
    **MODES,
    **MANOEUVRES,
    "latitude": LATITUDE,
}
