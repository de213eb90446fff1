"""What the products of this calibration hold: dimensions, units, frames."""


def _variable(dims, units, long_name, frame=None, **more):
    """Entry of a schema; unit and frame are left out where there is none."""
    labels = {"units": units, "frame": frame} | more
    return {"dims": dims, "long_name": long_name} | {name: label for name, label in labels.items() if label is not None}


_TIME = {"time": {"dims": "time"}}
_AMPLITUDE = "method axis frequency"

FIELD = {
    "cosine": _variable("degree order", "1", "C, fully normalised"),
    "sine": _variable("degree order", "1", "S, fully normalised"),
    "cosine_sigma": _variable("degree order", "1", "standard deviation of C"),
    "sine_sigma": _variable("degree order", "1", "standard deviation of S"),
    "gm": _variable("", "m3 s-2", "gravitational constant times mass"),
    "radius": _variable("", "m", "reference radius"),
}

TRUTH = _TIME | {
    "drag_b": _variable("time axis", "m s-2", "non-gravitational acceleration of the centre of mass, true", "b"),
}

GRADIENT = _TIME | {
    "linear_b": _variable("time sensor axis", "m s-2", "test mass relative to the satellite", "b"),
    "angular_b": _variable("time sensor axis", "rad s-2", "test mass relative to the satellite, angular", "b"),
    "sensor_position_b": _variable("sensor axis", "m", "CoM to test mass", "b"),
    "gradient_b": _variable("time axis axis_2", "s-2", "gravity gradient, model", "b"),
    "gradient_variance": _variable("element", "s-4", "of radial-radial, radial-tangential, tangential shear"),
    "up_b": _variable("time axis", "1", "direction away from the Earth", "b"),
    "angle": _variable("method time axis", "rad", "roll, pitch, yaw from the orbit frame"),
    "angle_dot": _variable("method time axis", "rad s-1", "derivative of the angles"),
    "rate_b": _variable("method time axis", "rad s-1", "rate, smoothed", "b"),
    "rate_dot_b": _variable("method time axis", "rad s-2", "angular acceleration, smoothed", "b"),
    "motion_covariance": _variable("method time axis axis_2", "m2 s-4", "of T r, from attitude and rates", "b"),
    "attitude_chi2": _variable("method", "1", "star camera and angular accelerations"),
    "attitude_dof": _variable("method", "1", "degrees of freedom", dtype="i8"),
}

TORQUE = {
    "degree": _variable("degree", "1", "zonal degree", dtype="i4"),
    "frequency": _variable("frequency", "Hz", "frequency"),
    "amplitude": _variable(
        "degree axis frequency",
        "rad s-2",
        "angular acceleration of test mass relative to satellite, amplitude spectrum",
        "b",
    ),
    "rms": _variable("degree axis", "rad s-2", "the same, rms over the record", "b"),
    "test_mass_rms": _variable("degree axis", "rad s-2", "part of the test mass, rms", "b"),
    "sensitivity": _variable("axis", "rad s-2", "angular noise of the sensor in one spectral line", "b"),
}

DRAG = _TIME | {
    "drag_b": _variable("time axis", "m s-2", "non-gravitational acceleration of the centre of mass", "b"),
    "covariance": _variable("time axis axis_2", "m2 s-4", "places held", "b"),
    "covariance_total": _variable("time axis axis_2", "m2 s-4", "with the error of the test masses' places", "b"),
    "budget": _variable("source axis", "m s-2", "rms: sensor noise, attitude and rates, gravity prior, places", "b"),
    "bare_b": _variable("time axis", "m s-2", "minus the reading, nothing removed", "b"),
    "pressure": _variable("axis", "m", "centre of pressure", "b", optional=True),
    "pressure_covariance": _variable("axis axis_2", "m2", "its covariance", "b", optional=True),
    "pressure_prior_sigma": _variable("axis", "m", "its standard deviation before", "b", optional=True),
    "torque_residual": _variable("axis", "N m", "torque not explained, rms", "b", optional=True),
    "torque_gain": _variable(
        "", "1", "largest share of the drag's information that the torque balance adds", optional=True
    ),
}

COMBINE = {
    "method": _variable("method", None, "method", dtype="str"),
    "error_rms": _variable("method", "m s-2", "against the truth, all axes; NaN without truth"),
    "error_rms_axis": _variable("method axis", "m s-2", "against the truth", "b"),
    "clean_error_rms": _variable("method", "m s-2", "the same from readings without noise"),
    "bare_error_rms": _variable("method", "m s-2", "of minus the reading"),
    "correction_rms": _variable("method", "m s-2", "of the solution against minus the reading"),
    "sigma_rms": _variable("method", "m s-2", "standard deviation, places held"),
    "sigma_total_rms": _variable("method", "m s-2", "with the error of the places"),
    "error_over_sigma": _variable("method", "1", "rms; NaN without truth"),
    "frequency": _variable("frequency", "Hz", "frequency"),
    "drag_amplitude": _variable("axis frequency", "m s-2", "amplitude spectrum of the drag", "b"),
    "error_amplitude": _variable(_AMPLITUDE, "m s-2", "amplitude spectrum of the error", "b"),
    "clean_error_amplitude": _variable(_AMPLITUDE, "m s-2", "the same, without noise", "b"),
    "bare_amplitude": _variable(_AMPLITUDE, "m s-2", "of minus the reading less the solution", "b"),
    "step": _variable("step", None, "what is known", dtype="str"),
    "step_rank": _variable("step", "1", "rank of the joint system", dtype="i4"),
    "step_unknowns": _variable("step", "1", "unknowns", dtype="i4"),
    "step_sigma": _variable("step axis", "m s-2", "of the drag in the middle; NaN where not determined", "b"),
    "unknown": _variable("unknown", None, "unknowns of one epoch", dtype="str"),
    "null_space": _variable("null unknown", "1", "combinations that one epoch does not see"),
    "single_rank": _variable("", "1", "rank of one epoch, tensor and drag", dtype="i4"),
    "printed_rank": _variable("", "1", "rank of the printed pair of equations", dtype="i4"),
    "printed_null": _variable("printed_unknown", "1", "what the printed pair does not see"),
}

REPORT = {"delivered": _variable("", "1", "1 where the result could be formed", dtype="i1")}
