"""What the products of this calibration hold: dimensions, units, frames. The body frame is that of the sensor."""


def _of(dims, units=None, long_name=None, frame=None, dtype=None):
    """Statement of one variable."""
    stated = {"dims": dims, "units": units, "frame": frame, "long_name": long_name, "dtype": dtype}
    return {name: value for name, value in stated.items() if value is not None}


def _sensor(dims, units, long_name):
    """Statement of a vector in the frame of the sensor."""
    return _of(dims, units, long_name, "b")


DETECT = {
    "time": _of("time"),
    "rate_b": _sensor("time axis", "rad s-1", "mean body rate over a minute"),
    "swing_start": _of("swing", "s", "begin of a swing"),
    "swing_stop": _of("swing", "s", "end of a swing"),
    "roll_start": _of("roll", "s", "begin of a roll about y"),
    "roll_stop": _of("roll", "s", "end of a roll about y"),
}

ALIGN = {
    "time": _of("time"),
    "volts": _of("time electrode", "V", "actuation voltages, spikes and gaps bridged"),
    "recorded": _of("time electrode", "V", "actuation voltages as recorded"),
    "flag": _of("time electrode", "1", "0 as recorded, 1 spike, 2 missing", dtype="u1"),
    "time_att": _of("time_att"),
    "quaternion": _of("time_att q", "1", "scalar first"),
    "position_i": _of("time axis", "m", "position of the centre of mass", "i"),
    "start": _of("", "s", "begin of the swing"),
    "stop": _of("", "s", "end of the swing"),
}

SCALE = {
    "beta": _sensor("axis", "rad s-2 V-1", "angular scale factors"),
    "beta_sigma": _sensor("axis", "rad s-2 V-1", "standard deviation"),
    "delay": _of("", "s", "star-tracker tags later than those of the sensor"),
    "delay_sigma": _of("", "s", "standard deviation"),
    "covariance": _of("estimated estimated_2", "1", "of the factors in units of rad s-2 V-1 and the delay in s"),
    "k": _of("arm axis", "m s-2 V-1", "linear scale factors, arm about x of 8.00 and 10.45 mm", "b"),
    "k_sigma": _of("arm axis", "m s-2 V-1", "with the error of the angular factors", "b"),
    "k_sigma_total": _of("arm axis", "m s-2 V-1", "with the error of mass, inertia and arm too", "b"),
    "arm_x": _of("arm", "m", "arm about x"),
    "chosen_arm": _of("", "1", "index of the arm used", dtype="i4"),
    "ratio_relative_sigma": _of("axis", "1", "relative error of J / (M l)"),
    "k_budget": _of("cause axis", "1", "relative error of k by cause, NaN for y"),
    "time_bin": _of("time_bin"),
    "residual_b": _sensor("time_bin axis", "rad", "measured minus predicted attitude"),
    "angle_b": _sensor("time_bin axis", "rad", "measured attitude minus the smooth part of the prediction"),
    "rate_b": _sensor("time_bin axis", "rad s-1", "body rate"),
    "rate_dot_b": _sensor("time_bin axis", "rad s-2", "angular acceleration, voltage noise taken out"),
    "gradient_b": _sensor("time_bin axis axis_2", "s-2", "gravity gradient"),
    "angular_volt": _of("time_bin axis", "V", "angular readouts"),
    "filter_value": _of("time_bin estimated", "1", "Kalman estimate after each bin"),
    "filter_sigma": _of("time_bin estimated", "1", "its standard deviation"),
    "batch_value": _of("estimated", "1", "batch least squares"),
    "tracker_sigma": _of("axis", "rad", "noise of one star-tracker sample"),
    "voltage_density": _of("axis", "V Hz-1/2", "noise of the angular readouts"),
    "chi2": _of("", "1", "squared whitened residuals"),
    "dof": _of("", "1", "degrees of freedom", dtype="i4"),
}

OFFSET = {
    "offset": _sensor("choice axis", "m", "centre of mass to test mass; all axes, then without a_y"),
    "covariance": _sensor("choice axis axis_2", "m2", "scale factors held"),
    "covariance_total": _sensor("choice axis axis_2", "m2", "with the error of the scale factors"),
    "adopted": _of("", "1", "choice of the smallest total error, sum of the squares of the axes", dtype="i4"),
    "shift": _sensor("choice cause axis", "m", "change by one standard deviation of each factor"),
    "time_bin": _of("time_bin"),
    "reading": _sensor("time_bin axis", "m s-2", "linear acceleration, slow part removed"),
    "model": _sensor("time_bin axis", "m s-2", "term of the offset, slow part removed"),
    "filter_value": _sensor("time_bin axis", "m", "Kalman estimate after each bin"),
    "filter_sigma": _sensor("time_bin axis", "m", "its standard deviation"),
    "noise_density": _of("axis", "V Hz-1/2", "noise of the linear readouts, mean over the band"),
    "chi2": _of("", "1", "squared whitened residuals"),
    "dof": _of("", "1", "degrees of freedom", dtype="i4"),
}

SEGMENT = {
    "time": _of("time"),
    "linear_volt": _of("time axis", "V", "linear readouts, means without spikes"),
    "share": _of("time", "1", "share of the samples used"),
    "R_bo": _of("time axis axis_2", "1", "direction cosines; o: x radial, z along the flight, y = z x x"),
    "rate_b": _sensor("time axis", "rad s-1", "body rate"),
    "gradient_b": _sensor("time axis axis_2", "s-2", "gravity gradient"),
}

BIAS = {
    "bias": _sensor("axis", "m s-2", "b of f = b + k V; about y with the constant acceleration of the satellite"),
    "bias_sigma": _sensor("axis", "m s-2", "scale factors held; segments and offset"),
    "bias_sigma_total": _sensor("axis", "m s-2", "with the error of the scale factors"),
    "bias_volt": _of("axis", "V", "minus the constant of the linear readout"),
    "bias_volt_sigma": _of("axis", "V", "standard deviation"),
    "separable": _of("axis", "1", "1 where rolling tells the bias from other constants", dtype="u1"),
    "statistical_sigma": _sensor("axis", "m s-2", "from the noise of the segments, and wander in segments left out"),
    "offset_sigma": _sensor("axis", "m s-2", "from the error of the offset"),
    "factor_sigma": _sensor("axis", "m s-2", "from the error of the scale factor, which multiplies the bias"),
    "wander": _sensor("axis", "m s-2", "slow change from segment to segment"),
    "offset_effect": _sensor("axis", "m s-2", "change of the bias if the offset term were left out"),
    "amplitude": _of("seen_by orbit_axis", "m s-2", "non-gravitational acceleration along x and z of o, by x and by z"),
    "time_segment": _of("time_segment"),
    "segment_bias": _sensor("time_segment axis", "m s-2", "bias of each segment"),
    "segment_sigma": _sensor("time_segment axis", "m s-2", "standard deviation, noise as the residual shows it"),
    "used": _of("time_segment", "1", "1 uniform and complete", dtype="u1"),
    "uniformity": _of("time_segment", "1", "relative standard deviation of the roll rate"),
    "frequency": _of("frequency", "Hz", "frequency"),
    "density": _of("calibrated frequency", "m s-2 Hz-1/2", "amplitude spectrum of z: old k_z, new k_z, and corrected"),
}

REPORT = {
    "k": _sensor("axis", "m s-2 V-1", "linear scale factors, NaN where not determined"),
    "beta": _sensor("axis", "rad s-2 V-1", "angular scale factors, NaN where not determined"),
    "offset": _sensor("axis", "m", "centre of mass to test mass, NaN where not determined"),
    "bias": _sensor("axis", "m s-2", "b of f = b + k V, NaN where not determined"),
}
