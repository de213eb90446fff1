"""What the products of this calibration hold: dimensions, units, frames."""

#: Of every manoeuvre, and of every way in which an angular acceleration may be wrong.
MANOEUVRES = {
    "kind": {
        "dims": "manoeuvre",
        "units": "1",
        "long_name": "axis of the torque: 0 roll, 1 pitch, 2 yaw",
        "dtype": "i1",
    },
    "start": {"dims": "manoeuvre", "units": "s", "long_name": "first edge, middle of its interval"},
    "stop": {"dims": "manoeuvre", "units": "s", "long_name": "last edge, middle of its interval"},
}
MODES = {
    "mode_shared": {"dims": "mode_index", "units": "1", "long_name": "in all manoeuvres", "dtype": "i1"},
    "mode_catalogue": {
        "dims": "mode_index",
        "units": "1",
        "long_name": "from inertia and dipole of the catalogue",
        "dtype": "i1",
    },
}
LATITUDE = {"dims": "manoeuvre", "units": "rad", "long_name": "geocentric latitude at the middle"}

DETECT = {
    **MANOEUVRES,
    "rod": {"dims": "manoeuvre", "units": "1", "long_name": "torquer with the wave: 0 x, 1 y, 2 z", "dtype": "i1"},
    "edge_lower": {"dims": "manoeuvre edge", "units": "s", "long_name": "last telemetry sample before an edge"},
    "edge_upper": {"dims": "manoeuvre edge", "units": "s", "long_name": "first telemetry sample after an edge"},
    "level": {"dims": "manoeuvre half_period", "units": "mA", "long_name": "mean current of each half period"},
    "regular": {"dims": "manoeuvre", "units": "1", "long_name": "edges are whole half periods apart", "dtype": "i1"},
    "record_start": {"dims": "", "units": "s", "long_name": "first telemetry sample"},
    "record_stop": {"dims": "", "units": "s", "long_name": "last telemetry sample"},
}

FIELD = {
    "time_orbit": {"dims": "time_orbit"},
    "time_mag": {"dims": "time_mag"},
    "field_i": {"dims": "time_orbit axis", "units": "T", "frame": "i", "long_name": "IGRF"},
    "position_i": {
        "dims": "time_orbit axis",
        "units": "m",
        "frame": "i",
        "long_name": "position of the centre of mass",
    },
    "latitude": {"dims": "time_orbit", "units": "rad", "long_name": "geocentric latitude"},
    "longitude": {"dims": "time_orbit", "units": "rad", "long_name": "longitude"},
    "model_b": {"dims": "time_mag axis", "units": "T", "frame": "b", "long_name": "IGRF in the SRF"},
    "measured_b": {"dims": "time_mag axis", "units": "T", "frame": "b", "long_name": "magnetometer"},
    "difference_b": {"dims": "time_mag axis", "units": "T", "frame": "b", "long_name": "magnetometer minus IGRF"},
    "used": {"dims": "time_mag", "units": "1", "long_name": "in the statistics", "dtype": "u1"},
    "bias": {"dims": "axis", "units": "T", "frame": "b", "long_name": "difference, bias"},
    "rms": {"dims": "axis", "units": "T", "frame": "b", "long_name": "difference, rms"},
    "maximum": {"dims": "axis", "units": "T", "frame": "b", "long_name": "difference, maximum"},
}

SURVEY = {
    "time_sca": {"dims": "time_sca"},
    "roll_rate": {"dims": "time_sca", "units": "rad s-1", "frame": "b", "long_name": "roll rate, star camera"},
    "roll_impulse": {
        "dims": "time_sca",
        "units": "mA T s",
        "frame": "b",
        "long_name": "roll torque, torquer current times field, integrated",
    },
    "slope": {"dims": "", "units": "rad s-2 mA-1 T-1", "long_name": "dipole per current over roll inertia"},
    "slope_sigma": {"dims": "", "units": "rad s-2 mA-1 T-1", "long_name": "its standard deviation"},
}

ATTITUDE = {
    "rod": {"dims": "arc", "units": "1", "long_name": "torquer with the wave: 0 x, 1 y, 2 z, -1 none", "dtype": "i1"},
    "gap": {"dims": "arc", "units": "1", "long_name": "too long to use the arc: 1 orbit, 2 star camera", "dtype": "u1"},
    "time_sca": {"dims": "time_sca"},
    "time_acc": {"dims": "time_acc"},
    "rate_b": {"dims": "time_acc axis", "units": "rad s-1", "frame": "b", "long_name": "body rate"},
    "rate_dot_mtq_b": {
        "dims": "time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration of the dynamics, catalogue torque",
    },
    "rate_dot_sca_b": {
        "dims": "time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration seen by the star camera",
    },
    "magnetic_b": {
        "dims": "time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "part of the torquers, catalogue torque",
    },
    "smooth_b": {
        "dims": "time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "part that is not of the torquers",
    },
    "gradient_b": {"dims": "time_acc axis axis_2", "units": "s-2", "frame": "b", "long_name": "gravity gradient"},
    "sca_modes": {
        "dims": "mode time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "change of rate_dot_sca_b for one standard deviation",
    },
    "acc_manoeuvre": {"dims": "time_acc", "units": "1", "long_name": "manoeuvre of the epoch", "dtype": "i2"},
    "sca_shift": {"dims": "arc", "units": "s", "long_name": "edges seen by the star camera, later than assumed"},
    "sca_shift_sigma": {"dims": "arc", "units": "s", "long_name": "sca shift, standard deviation"},
    "acc_shift": {
        "dims": "arc",
        "units": "s",
        "long_name": "edges seen by the accelerometer, later than assumed",
    },
    "acc_shift_sigma": {"dims": "arc", "units": "s", "long_name": "acc shift, standard deviation"},
    "torque_scale": {
        "dims": "arc axis",
        "units": "1",
        "frame": "b",
        "long_name": "magnetic torque over the catalogue, seen by the star camera",
    },
    "torque_scale_sigma": {
        "dims": "arc axis",
        "units": "1",
        "frame": "b",
        "long_name": "torque scale, standard deviation",
    },
    "inertia_scale": {
        "dims": "arc axis",
        "units": "1",
        "frame": "b",
        "long_name": "principal moments over the catalogue",
    },
    "inertia_scale_sigma": {"dims": "arc axis", "units": "1", "frame": "b", "long_name": "its standard deviation"},
    "angular_scale": {
        "dims": "arc axis",
        "units": "1",
        "frame": "b",
        "long_name": "angular accelerometer over torquer",
    },
    "angular_scale_sigma": {
        "dims": "arc axis",
        "units": "1",
        "frame": "b",
        "long_name": "angular scale, standard deviation",
    },
    "residual_rms": {
        "dims": "arc axis",
        "units": "rad",
        "frame": "b",
        "long_name": "star camera minus model, rms",
    },
    "sca_residual_b": {"dims": "time_sca axis", "units": "rad", "frame": "b", "long_name": "measured minus model"},
    "sca_manoeuvre": {"dims": "time_sca", "units": "1", "long_name": "manoeuvre of the epoch", "dtype": "i2"},
    "acc_delay": {"dims": "", "units": "s", "long_name": "tag late against the torquer telemetry"},
    "acc_delay_sigma": {"dims": "", "units": "s", "long_name": "tag late against the torquer telemetry"},
    "sca_delay": {"dims": "", "units": "s", "long_name": "tag late against the torquer telemetry"},
    "sca_delay_sigma": {"dims": "", "units": "s", "long_name": "tag late against the torquer telemetry"},
}

ANGULAR = {
    "time_acc": {"dims": "time_acc"},
    "rate_dot_b": {
        "dims": "time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration, acc_calibrated",
    },
    "mode": {
        "dims": "mode_index time_acc axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "change for one standard deviation",
    },
    **MODES,
    "ratio": {"dims": "axis", "units": "1", "long_name": "this angular acceleration over the torquer, all manoeuvres"},
    "scale": {"dims": "axis", "units": "1", "long_name": "torquer over angular accelerometer"},
    "scale_sigma": {"dims": "axis", "units": "1", "long_name": "its standard deviation"},
    "acc_manoeuvre": {"dims": "time_acc", "units": "1", "long_name": "manoeuvre of the epoch", "dtype": "i2"},
}

NOISE = {
    "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
    "reflection": {"dims": "axis lag", "units": "1", "frame": "b", "long_name": "reflection coefficients"},
    "variance": {"dims": "axis order", "units": "m2 s-4", "frame": "b", "long_name": "prediction-error variance"},
    "density": {
        "dims": "axis frequency",
        "units": "m2 s-4 Hz-1",
        "frame": "b",
        "long_name": "one-sided noise density as measured",
    },
    "seconds": {"dims": "", "units": "s", "long_name": "length of the quiet data"},
}

SOLVE = {
    "time_grid": {"dims": "time_grid"},
    "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
    "offset": {"dims": "manoeuvre axis", "units": "m", "frame": "b", "long_name": "proof mass to centre of mass"},
    "latitude": LATITUDE,
    "right": {"dims": "manoeuvre axis", "units": "m-1", "frame": "b", "long_name": "right-hand side Z'y"},
    "normal": {"dims": "manoeuvre axis axis_2", "units": "m-2", "frame": "b", "long_name": "normal matrix Z'A"},
    "information": {"dims": "manoeuvre axis axis_2", "units": "m-2", "frame": "b", "long_name": "inverse covariance"},
    "mode_shift": {
        "dims": "manoeuvre mode_index axis",
        "units": "m",
        "frame": "b",
        "long_name": "change for one sigma",
    },
    "chi2": {"dims": "manoeuvre", "units": "1", "long_name": "whitened residuals"},
    "dof": {"dims": "manoeuvre", "units": "1", "long_name": "degrees of freedom", "dtype": "i4"},
    **MANOEUVRES,
    "reading": {
        "dims": "time_grid axis",
        "units": "m s-2",
        "frame": "b",
        "long_name": "linear acceleration, drift removed",
    },
    "model": {
        "dims": "time_grid axis",
        "units": "m s-2",
        "frame": "b",
        "long_name": "modelled linear acceleration, drift removed",
    },
    "grid_manoeuvre": {"dims": "time_grid", "units": "1", "long_name": "manoeuvre", "dtype": "i2"},
    "noise_density": {
        "dims": "axis frequency",
        "units": "m2 s-4 Hz-1",
        "long_name": "one-sided noise density as measured",
    },
    **MODES,
}

COMBINE = {
    "offset": {"dims": "variant axis", "units": "m", "frame": "b", "long_name": "proof mass to centre of mass"},
    "covariance": {"dims": "variant axis axis_2", "units": "m2", "frame": "b", "long_name": "covariance of the offset"},
    "covariance_total": {
        "dims": "variant axis axis_2",
        "units": "m2",
        "frame": "b",
        "long_name": "with the error of inertia and dipole per current",
    },
    "determined": {
        "dims": "variant axis",
        "units": "1",
        "long_name": "1 where the component is determined",
        "dtype": "u1",
    },
    "chi2": {"dims": "variant", "units": "1", "long_name": "disagreement of the manoeuvres with their combination"},
    "dof": {"dims": "variant", "units": "1", "long_name": "degrees of freedom", "dtype": "i8"},
    "manoeuvre_offset": {
        "dims": "variant manoeuvre axis",
        "units": "m",
        "frame": "b",
        "long_name": "proof mass to centre of mass",
    },
    "manoeuvre_covariance": {
        "dims": "variant manoeuvre axis axis_2",
        "units": "m2",
        "frame": "b",
        "long_name": "covariance of the offset",
    },
    "manoeuvre_determined": {
        "dims": "variant manoeuvre axis",
        "units": "1",
        "long_name": "1 determined",
        "dtype": "u1",
    },
    "manoeuvre_chi2": {"dims": "variant manoeuvre", "units": "1", "long_name": "squared whitened residuals"},
    "manoeuvre_dof": {"dims": "variant manoeuvre", "units": "1", "long_name": "degrees of freedom", "dtype": "i4"},
    "variants_chi2": {"dims": "", "units": "1", "long_name": "disagreement of acc and sca"},
    "variants_dof": {"dims": "", "units": "1", "long_name": "degrees of freedom", "dtype": "i8"},
    "catalogue_chi2": {"dims": "", "units": "1", "long_name": "disagreement of mtq and acc, catalogue's error within"},
    "catalogue_dof": {"dims": "", "units": "1", "long_name": "degrees of freedom", "dtype": "i8"},
    **MANOEUVRES,
}

REPORT = {
    "offset": {"dims": "axis", "units": "m", "frame": "b", "long_name": "proof mass to centre of mass, adopted"},
    "sigma": {"dims": "axis", "units": "m", "frame": "b", "long_name": "its standard deviation"},
    "sigma_total": {"dims": "axis", "units": "m", "frame": "b", "long_name": "with inertia and dipole per current"},
}
