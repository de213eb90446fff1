"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import PARAMETERS, column

ALIGN = {
    "time": column("time"),
    "measured_b": column("time axis", "T", "magnetometer", frame="b"),
    "model_b": column("time axis", "T", "reference field by orbit and star camera", frame="b"),
    "slope_b": column("time axis", "T s-1", "rate of the reference field in the body", frame="b"),
    "dipole_b": column("time axis", "A m2", "dipole of the torquers by their currents", frame="b"),
    "axis_b": column("time axis", "1", "direction along the moment of the main field", frame="b"),
    "step": column("", "s", "spacing of the records"),
    "attitude_jump": column("", "rad", "change of the turn from one attitude to the next, largest"),
    "velocity_error": column("", "m s-1", "velocity against change of position, 0 if sparse"),
}

ESTIMATE = PARAMETERS | {
    "noise": column("axis", "T", "standard deviation of what the model leaves", frame="b"),
    "noise_order": column("", "1", "coefficients of the noise model", dtype="i8"),
    "time": column("time"),
    "residual_b": column("time axis", "T", "measured less reference field", frame="b"),
    "fitted_b": column("time axis", "T", "the same as the model has it", frame="b"),
}
