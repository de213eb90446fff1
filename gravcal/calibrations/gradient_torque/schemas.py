"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import column

_TIME = {"time": {"dims": "time"}}
_AMPLITUDE = "method axis frequency"

FIELD = {
    "cosine": column("degree order", "1", "C, fully normalised"),
    "sine": column("degree order", "1", "S, fully normalised"),
    "cosine_sigma": column("degree order", "1", "standard deviation of C"),
    "sine_sigma": column("degree order", "1", "standard deviation of S"),
    "gm": column("", "m3 s-2", "gravitational constant times mass"),
    "radius": column("", "m", "reference radius"),
}

TRUTH = _TIME | {
    "drag_b": column("time axis", "m s-2", "non-gravitational acceleration of the centre of mass, true", frame="b"),
}

GRADIENT = _TIME | {
    "linear_b": column("time sensor axis", "m s-2", "test mass relative to the satellite", frame="b"),
    "angular_b": column("time sensor axis", "rad s-2", "test mass relative to the satellite, angular", frame="b"),
    "sensor_position_b": column("sensor axis", "m", "CoM to test mass", frame="b"),
    "gradient_b": column("time axis axis_2", "s-2", "gravity gradient, model", frame="b"),
    "gradient_variance": column("element", "s-4", "of radial-radial, radial-tangential, tangential shear"),
    "up_b": column("time axis", "1", "direction away from the Earth", frame="b"),
    "angle": column("method time axis", "rad", "roll, pitch, yaw from the orbit frame"),
    "angle_dot": column("method time axis", "rad s-1", "derivative of the angles"),
    "rate_b": column("method time axis", "rad s-1", "rate, smoothed", frame="b"),
    "rate_dot_b": column("method time axis", "rad s-2", "angular acceleration, smoothed", frame="b"),
    "motion_covariance": column("method time axis axis_2", "m2 s-4", "of T r, from attitude and rates", frame="b"),
    "attitude_chi2": column("method", "1", "star camera and angular accelerations"),
    "attitude_dof": column("method", "1", "degrees of freedom", dtype="i8"),
}

TORQUE = {
    "degree": column("degree", "1", "zonal degree", dtype="i4"),
    "frequency": column("frequency", "Hz", "frequency"),
    "amplitude": column(
        "degree axis frequency",
        "rad s-2",
        "angular acceleration of test mass relative to satellite, amplitude spectrum",
        frame="b",
    ),
    "rms": column("degree axis", "rad s-2", "the same, rms over the record", frame="b"),
    "test_mass_rms": column("degree axis", "rad s-2", "part of the test mass, rms", frame="b"),
    "sensitivity": column("axis", "rad s-2", "angular noise of the sensor in one spectral line", frame="b"),
}

DRAG = _TIME | {
    "drag_b": column("time axis", "m s-2", "non-gravitational acceleration of the centre of mass", frame="b"),
    "covariance": column("time axis axis_2", "m2 s-4", "places held", frame="b"),
    "covariance_total": column("time axis axis_2", "m2 s-4", "with the error of the test masses' places", frame="b"),
    "budget": column("source axis", "m s-2", "rms: sensor noise, attitude and rates, gravity prior, places", frame="b"),
    "bare_b": column("time axis", "m s-2", "minus the reading, nothing removed", frame="b"),
    "pressure": column("axis", "m", "centre of pressure", frame="b", optional=True),
    "pressure_covariance": column("axis axis_2", "m2", "its covariance", frame="b", optional=True),
    "pressure_prior_sigma": column("axis", "m", "its standard deviation before", frame="b", optional=True),
    "torque_residual": column("axis", "N m", "torque not explained, rms", frame="b", optional=True),
    "torque_gain": column(
        "", "1", "largest share of the drag's information that the torque balance adds", optional=True
    ),
}

COMBINE = {
    "method": column("method", "", "method", dtype="str"),
    "error_rms": column("method", "m s-2", "against the truth, all axes; NaN without truth"),
    "clean_error_rms": column("method", "m s-2", "the same from readings without noise"),
    "bare_error_rms": column("method", "m s-2", "of minus the reading"),
    "correction_rms": column("method", "m s-2", "of the solution against minus the reading"),
    "sigma_rms": column("method", "m s-2", "standard deviation, places held"),
    "sigma_total_rms": column("method", "m s-2", "with the error of the places"),
    "error_over_sigma": column("method", "1", "rms; NaN without truth"),
    "frequency": column("frequency", "Hz", "frequency"),
    "drag_amplitude": column("axis frequency", "m s-2", "amplitude spectrum of the drag", frame="b"),
    "error_amplitude": column(_AMPLITUDE, "m s-2", "amplitude spectrum of the error", frame="b"),
    "clean_error_amplitude": column(_AMPLITUDE, "m s-2", "the same, without noise", frame="b"),
    "step": column("step", "", "what is known", dtype="str"),
    "step_rank": column("step", "1", "rank of the joint system", dtype="i4"),
    "step_unknowns": column("step", "1", "unknowns", dtype="i4"),
    "step_sigma": column("step axis", "m s-2", "of the drag in the middle; NaN where not determined", frame="b"),
    "unknown": column("unknown", "", "unknowns of one epoch", dtype="str"),
    "null_space": column("null unknown", "1", "combinations that one epoch does not see"),
    "single_rank": column("", "1", "rank of one epoch, tensor and drag", dtype="i4"),
    "printed_rank": column("", "1", "rank of the printed pair of equations", dtype="i4"),
    "printed_null": column("printed_unknown", "1", "what the printed pair does not see"),
}

REPORT = {"delivered": column("", "1", "1 where the result could be formed", dtype="i1")}
