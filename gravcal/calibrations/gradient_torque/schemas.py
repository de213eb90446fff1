"""What the products of this calibration hold: dimensions, units, frames."""

_GPS = {"time": {"dims": "time"}}
_B = {"units": "m s-2", "frame": "b"}

FIELD = {
    "cosine": {"dims": "degree order", "units": "1", "long_name": "C, fully normalised"},
    "sine": {"dims": "degree order", "units": "1", "long_name": "S, fully normalised"},
    "cosine_sigma": {"dims": "degree order", "units": "1", "long_name": "standard deviation of C"},
    "sine_sigma": {"dims": "degree order", "units": "1", "long_name": "standard deviation of S"},
    "gm": {"dims": "", "units": "m3 s-2", "long_name": "gravitational constant times mass"},
    "radius": {"dims": "", "units": "m", "long_name": "reference radius"},
}

TRUTH = {
    **_GPS,
    "drag_b": {"dims": "time axis", **_B, "long_name": "non-gravitational acceleration of the centre of mass, true"},
}

GRADIENT = {
    **_GPS,
    "linear_b": {"dims": "time sensor axis", **_B, "long_name": "test mass relative to the satellite"},
    "angular_b": {
        "dims": "time sensor axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "test mass relative to the satellite, angular",
    },
    "sensor_position_b": {"dims": "sensor axis", "units": "m", "frame": "b", "long_name": "CoM to test mass"},
    "gradient_b": {"dims": "time axis axis_2", "units": "s-2", "frame": "b", "long_name": "gravity gradient, model"},
    "gradient_variance": {
        "dims": "element",
        "units": "s-4",
        "long_name": "of radial-radial, radial-tangential, tangential shear",
    },
    "up_b": {"dims": "time axis", "units": "1", "frame": "b", "long_name": "direction away from the Earth"},
    "angle": {"dims": "method time axis", "units": "rad", "long_name": "roll, pitch, yaw from the orbit frame"},
    "angle_dot": {"dims": "method time axis", "units": "rad s-1", "long_name": "derivative of the angles"},
    "rate_b": {"dims": "method time axis", "units": "rad s-1", "frame": "b", "long_name": "rate, smoothed"},
    "rate_dot_b": {
        "dims": "method time axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration, smoothed",
    },
    "motion_covariance": {
        "dims": "method time axis axis_2",
        "units": "m2 s-4",
        "frame": "b",
        "long_name": "of T r, from attitude and rates",
    },
    "attitude_chi2": {"dims": "method", "units": "1", "long_name": "star camera and angular accelerations"},
    "attitude_dof": {"dims": "method", "units": "1", "long_name": "degrees of freedom", "dtype": "i8"},
}

TORQUE = {
    "degree": {"dims": "degree", "units": "1", "long_name": "zonal degree", "dtype": "i4"},
    "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
    "amplitude": {
        "dims": "degree axis frequency",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration of test mass relative to satellite, amplitude spectrum",
    },
    "rms": {"dims": "degree axis", "units": "rad s-2", "frame": "b", "long_name": "the same, rms over the record"},
    "test_mass_rms": {
        "dims": "degree axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "part of the test mass, rms",
    },
    "sensitivity": {
        "dims": "axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular noise of the sensor in one spectral line",
    },
}

DRAG = {
    **_GPS,
    "drag_b": {"dims": "time axis", **_B, "long_name": "non-gravitational acceleration of the centre of mass"},
    "covariance": {"dims": "time axis axis_2", "units": "m2 s-4", "frame": "b", "long_name": "places held"},
    "covariance_total": {
        "dims": "time axis axis_2",
        "units": "m2 s-4",
        "frame": "b",
        "long_name": "with the error of the test masses' places",
    },
    "budget": {
        "dims": "source axis",
        "units": "m s-2",
        "frame": "b",
        "long_name": "rms: sensor noise, attitude and rates, gravity prior, places",
    },
    "bare_b": {"dims": "time axis", **_B, "long_name": "minus the reading, nothing removed"},
    "pressure": {"dims": "axis", "units": "m", "frame": "b", "optional": True, "long_name": "centre of pressure"},
    "pressure_covariance": {
        "dims": "axis axis_2",
        "units": "m2",
        "frame": "b",
        "optional": True,
        "long_name": "its covariance",
    },
    "pressure_prior_sigma": {
        "dims": "axis",
        "units": "m",
        "frame": "b",
        "optional": True,
        "long_name": "its standard deviation before",
    },
    "torque_residual": {
        "dims": "axis",
        "units": "N m",
        "frame": "b",
        "optional": True,
        "long_name": "torque not explained, rms",
    },
    "torque_gain": {
        "dims": "",
        "units": "1",
        "optional": True,
        "long_name": "largest share of the drag's information that the torque balance adds",
    },
}

COMBINE = {
    "method": {"dims": "method", "long_name": "method", "dtype": "str"},
    "error_rms": {"dims": "method", "units": "m s-2", "long_name": "against the truth, all axes; NaN without truth"},
    "error_rms_axis": {"dims": "method axis", "units": "m s-2", "frame": "b", "long_name": "against the truth"},
    "clean_error_rms": {"dims": "method", "units": "m s-2", "long_name": "the same from readings without noise"},
    "bare_error_rms": {"dims": "method", "units": "m s-2", "long_name": "of minus the reading"},
    "correction_rms": {"dims": "method", "units": "m s-2", "long_name": "of the solution against minus the reading"},
    "sigma_rms": {"dims": "method", "units": "m s-2", "long_name": "standard deviation, places held"},
    "sigma_total_rms": {"dims": "method", "units": "m s-2", "long_name": "with the error of the places"},
    "error_over_sigma": {"dims": "method", "units": "1", "long_name": "rms; NaN without truth"},
    "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
    "drag_amplitude": {"dims": "axis frequency", **_B, "long_name": "amplitude spectrum of the drag"},
    "error_amplitude": {"dims": "method axis frequency", **_B, "long_name": "amplitude spectrum of the error"},
    "clean_error_amplitude": {"dims": "method axis frequency", **_B, "long_name": "the same, without noise"},
    "bare_amplitude": {"dims": "method axis frequency", **_B, "long_name": "of minus the reading less the solution"},
    "step": {"dims": "step", "long_name": "what is known", "dtype": "str"},
    "step_rank": {"dims": "step", "units": "1", "long_name": "rank of the joint system", "dtype": "i4"},
    "step_unknowns": {"dims": "step", "units": "1", "long_name": "unknowns", "dtype": "i4"},
    "step_sigma": {"dims": "step axis", **_B, "long_name": "of the drag in the middle; NaN where not determined"},
    "unknown": {"dims": "unknown", "long_name": "unknowns of one epoch", "dtype": "str"},
    "null_space": {"dims": "null unknown", "units": "1", "long_name": "combinations that one epoch does not see"},
    "single_rank": {"dims": "", "units": "1", "long_name": "rank of one epoch, tensor and drag", "dtype": "i4"},
    "printed_rank": {"dims": "", "units": "1", "long_name": "rank of the printed pair of equations", "dtype": "i4"},
    "printed_null": {"dims": "printed_unknown", "units": "1", "long_name": "what the printed pair does not see"},
}

REPORT = {
    "delivered": {"dims": "", "units": "1", "long_name": "1 where the result could be formed", "dtype": "i1"},
}
