"""What the products of this calibration hold: dimensions, units, frames. The body frame is that of the sensor."""

import functools

from gravcal.calibrations.schemas import column

vector = functools.partial(column, frame="b")

DETECT = {
    "time": column("time"),
    "rate_b": vector("time axis", "rad s-1", "mean body rate over a minute"),
    "swing_start": column("swing", "s", "begin of a swing"),
    "swing_stop": column("swing", "s", "end of a swing"),
    "roll_start": column("roll", "s", "begin of a roll about y"),
    "roll_stop": column("roll", "s", "end of a roll about y"),
}

ALIGN = {
    "time": column("time"),
    "volts": column("time electrode", "V", "actuation voltages, spikes and gaps bridged"),
    "recorded": column("time electrode", "V", "actuation voltages as recorded"),
    "flag": column("time electrode", "1", "0 as recorded, 1 spike, 2 missing", dtype="u1"),
    "time_att": column("time_att"),
    "quaternion": column("time_att q", "1", "scalar first"),
    "position_i": column("time axis", "m", "position of the centre of mass", frame="i"),
    "start": column("", "s", "begin of the swing"),
    "stop": column("", "s", "end of the swing"),
}

SCALE = {
    "beta": vector("axis", "rad s-2 V-1", "angular scale factors"),
    "beta_sigma": vector("axis", "rad s-2 V-1", "standard deviation"),
    "delay": column("", "s", "star-tracker tags later than those of the sensor"),
    "delay_sigma": column("", "s", "standard deviation"),
    "covariance": column("estimated estimated_2", "1", "of the factors in units of rad s-2 V-1 and the delay in s"),
    "k": column("arm axis", "m s-2 V-1", "linear scale factors, arm about x of 8.00 and 10.45 mm", frame="b"),
    "k_sigma": column("arm axis", "m s-2 V-1", "with the error of the angular factors", frame="b"),
    "k_sigma_total": column("arm axis", "m s-2 V-1", "with the error of mass, inertia and arm too", frame="b"),
    "arm_x": column("arm", "m", "arm about x"),
    "chosen_arm": column("", "1", "index of the arm used", dtype="i4"),
    "ratio_relative_sigma": column("axis", "1", "relative error of J / (M l)"),
    "k_budget": column("cause axis", "1", "relative error of k by cause, NaN for y"),
    "time_bin": column("time_bin"),
    "residual_b": vector("time_bin axis", "rad", "measured minus predicted attitude"),
    "angle_b": vector("time_bin axis", "rad", "measured attitude minus the smooth part of the prediction"),
    "rate_b": vector("time_bin axis", "rad s-1", "body rate"),
    "rate_dot_b": vector("time_bin axis", "rad s-2", "angular acceleration, voltage noise taken out"),
    "gradient_b": vector("time_bin axis axis_2", "s-2", "gravity gradient"),
    "angular_volt": column("time_bin axis", "V", "angular readouts"),
    "filter_value": column("time_bin estimated", "1", "Kalman estimate after each bin"),
    "filter_sigma": column("time_bin estimated", "1", "its standard deviation"),
    "batch_value": column("estimated", "1", "batch least squares"),
    "tracker_sigma": column("axis", "rad", "noise of one star-tracker sample"),
    "voltage_density": column("axis", "V Hz-1/2", "noise of the angular readouts"),
    "chi2": column("", "1", "squared whitened residuals"),
    "dof": column("", "1", "degrees of freedom", dtype="i4"),
}

OFFSET = {
    "offset": vector("choice axis", "m", "centre of mass to test mass; all axes, then without a_y"),
    "covariance": vector("choice axis axis_2", "m2", "scale factors held"),
    "covariance_total": vector("choice axis axis_2", "m2", "with the error of the scale factors"),
    "adopted": column("", "1", "choice of the smallest total error, sum of the squares of the axes", dtype="i4"),
    "shift": vector("choice cause axis", "m", "change by one standard deviation of each factor"),
    "k_y": column("", "m s-2 V-1", "factor of a_y from the swing alone"),
    "k_y_sigma": column("", "m s-2 V-1", "its standard deviation, other factors held"),
    "k_y_sigma_total": column("", "m s-2 V-1", "with the error of the other factors"),
    "time_bin": column("time_bin"),
    "reading": vector("time_bin axis", "m s-2", "linear acceleration, slow part removed"),
    "model": vector("time_bin axis", "m s-2", "term of the offset, slow part removed"),
    "filter_value": vector("time_bin axis", "m", "Kalman estimate after each bin"),
    "filter_sigma": vector("time_bin axis", "m", "its standard deviation"),
    "noise_density": column("axis", "V Hz-1/2", "noise of the linear readouts, mean over the band"),
    "chi2": column("", "1", "squared whitened residuals"),
    "dof": column("", "1", "degrees of freedom", dtype="i4"),
}

SEGMENT = {
    "time": column("time"),
    "linear_volt": column("time axis", "V", "linear readouts, means without spikes"),
    "share": column("time", "1", "share of the samples used"),
    "R_bo": column("time axis axis_2", "1", "direction cosines; o: x radial, z along the flight, y = z x x"),
    "rate_b": vector("time axis", "rad s-1", "body rate"),
    "gradient_b": vector("time axis axis_2", "s-2", "gravity gradient"),
}

BIAS = {
    "bias": vector("axis", "m s-2", "b of f = b + k V; about y with the constant acceleration of the satellite"),
    "bias_sigma": vector("axis", "m s-2", "scale factors held; segments and offset"),
    "bias_sigma_total": vector("axis", "m s-2", "with the error of the scale factors"),
    "bias_volt": column("axis", "V", "minus the constant of the linear readout"),
    "bias_volt_sigma": column("axis", "V", "standard deviation"),
    "separable": column("axis", "1", "1 where rolling tells the bias from other constants", dtype="u1"),
    "statistical_sigma": vector("axis", "m s-2", "from the noise of the segments, and wander in segments left out"),
    "offset_sigma": vector("axis", "m s-2", "from the error of the offset"),
    "factor_sigma": vector("axis", "m s-2", "from the error of the scale factor, which multiplies the bias"),
    "wander": vector("axis", "m s-2", "slow change from segment to segment"),
    "offset_effect": vector("axis", "m s-2", "change of the bias if the offset term were left out"),
    "amplitude": column(
        "seen_by orbit_axis", "m s-2", "non-gravitational acceleration along x and z of o, by x and by z"
    ),
    "time_segment": column("time_segment"),
    "segment_bias": vector("time_segment axis", "m s-2", "bias of each segment"),
    "segment_sigma": vector("time_segment axis", "m s-2", "standard deviation, noise as the residual shows it"),
    "used": column("time_segment", "1", "1 uniform and complete", dtype="u1"),
    "uniformity": column("time_segment", "1", "relative standard deviation of the roll rate"),
    "frequency": column("frequency", "Hz", "frequency"),
    "density": column(
        "calibrated frequency", "m s-2 Hz-1/2", "amplitude spectrum of z: old k_z, new k_z, and corrected"
    ),
}

REPORT = {
    "k": vector("axis", "m s-2 V-1", "linear scale factors, NaN where not determined"),
    "beta": vector("axis", "rad s-2 V-1", "angular scale factors, NaN where not determined"),
    "offset": vector("axis", "m", "centre of mass to test mass, NaN where not determined"),
    "bias": vector("axis", "m s-2", "b of f = b + k V, NaN where not determined"),
}
