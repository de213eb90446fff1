"""What the products of this calibration hold: dimensions, units, frames.

`satellite` is 0 for the first letter of the pair and 1 for the second; `parameter` is x, y, z of the first, then of
the second; `axis_index` of a manoeuvre is 0 for pitch and 1 for yaw. `subset`, `estimator` and `observable` are in the
order of SUBSETS, ESTIMATORS and OBSERVABLES. Where a variable has three units, they are those of the observables.
"""

from gravcal.calibrations.schemas import column

PARAMETERS = ("x_a", "y_a", "z_a", "x_b", "y_b", "z_b")
OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = ("m", "m s-1", "m s-2")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")

CENTRE = "centre of mass to phase centre"
PER_M = ("1", "s-1", "s-2")
DENSITY = ("m2 Hz-1", "m2 s-2 Hz-1", "m2 s-4 Hz-1")

ALIGN = {
    "time": column("time"),
    "time_kbr": column("time_kbr"),
    "position_i": column("satellite time axis", "m", "centre of mass", frame="i"),
    "quaternion": column("satellite time q", "1", "attitude, scalar first"),
    "reading_range": column("time_kbr", "m", "biased range, light time added"),
    "reading_range_rate": column("time_kbr", "m s-1", "range rate, light time added"),
    "reading_range_acceleration": column("time_kbr", "m s-2", "range acceleration, light time added"),
    "antenna_correction": column("time_kbr", "m", "antenna correction of the file, not added"),
    "kbr_flag": column("time_kbr", "1", "0 usable, 1 not", dtype="u1"),
    "segment": column("time_kbr", "1", "number of the stretch without a phase break", dtype="i4"),
}

_MANOEUVRE = {
    "satellite_index": column("manoeuvre", "1", "satellite that moves", dtype="i1"),
    "axis_index": column("manoeuvre", "1", "0 pitch, 1 yaw", dtype="i1"),
    "sign": column("manoeuvre", "1", "of the offset angle; 0 without offset", dtype="i1"),
    "start": column("manoeuvre", "s", "first slew"),
    "stop": column("manoeuvre", "s", "last slew"),
}

MANOEUVRE = tuple(_MANOEUVRE)

POINTING = {
    "time": column("time"),
    "range_com": column("time", "m", "distance of the centres of mass"),
    "second_order": column("time", "m", "part of the range that is square in the offsets"),
    "line_of_sight_b": column("satellite time axis", "1", "unit vector to the other satellite", frame="b"),
    "angle": column("satellite time axis_2", "rad", "pitch and yaw of the line of sight in the satellite"),
    "usable": column("time", "1", "1 where orbits and attitudes are known", dtype="u1"),
    "offset": column("manoeuvre", "rad", "mean angle"),
    "amplitude": column("manoeuvre", "rad", "amplitude of the wiggle"),
} | _MANOEUVRE

OBSERVABLE = {
    "time_kbr": column("time_kbr"),
    "observed": column("time_kbr", UNITS, "ranging minus orbit"),
    "column": column("time_kbr parameter", PER_M, "derivative by the phase centres"),
    "published_column": column("time_kbr parameter", PER_M, "the same by local cubic polynomials"),
    "lever": column(
        "time_kbr derivative arm",
        "m",
        "range per radian of pointing error, z and y of both; order n of the time derivative in m s-n",
    ),
    "arc": column("time_kbr", "1", "manoeuvre, -1 quiet, -2 neither", dtype="i2"),
    "segment": column("time_kbr", "1", "number of the stretch without a phase break", dtype="i4"),
} | _MANOEUVRE

NOISE = {
    "knot": column("knot", "Hz", "knots of the spectrum of the range"),
    "log_density": column("knot", "1", "logarithm of its one-sided density in m2 Hz-1"),
    "log_covariance": column("knot knot_2", "1", "covariance of these logarithms"),
    "frequency": column("frequency", "Hz", "frequency"),
    "density": column("frequency", "m2 Hz-1", "one-sided density of quiet ranging minus orbit"),
    "model": column("frequency", "m2 Hz-1", "one-sided density of the model"),
    "in_manoeuvres": column("frequency", "m2 Hz-1", "one-sided density of the residual in the manoeuvres"),
    "seconds": column("", "s", "length of the quiet data"),
    "corner": column("corner", "Hz", "corner frequency; the last one stands for white"),
    "pointing_power": column("corner", "rad2 Hz-1", "one-sided density of the star camera noise below each corner"),
}

_ESTIMATE = {
    "centre": column("subset estimator parameter", "m", CENTRE, frame="b"),
    "covariance": column("subset estimator parameter parameter_2", "m2", "covariance", frame="b"),
    "formal_sigma": column("subset estimator parameter", "m", "as usual least squares would print it", frame="b"),
    "condition": column("subset", "1", "condition number of the design"),
    "sigma0": column("subset estimator", "1", "noise in the manoeuvres over the noise assumed"),
    "kept": column("subset", "1", "mean robust weight"),
    "arc_value": column("manoeuvre", "m", "y or z from one manoeuvre, the others held"),
    "arc_sigma": column("manoeuvre", "m", "its standard deviation"),
    "arcs_chi2": column("", "1", "disagreement of the manoeuvres"),
    "arcs_dof": column("", "1", "degrees of freedom", dtype="i8"),
}

SOLVE = (
    _ESTIMATE
    | _MANOEUVRE
    | {
        "time_kbr": column("time_kbr"),
        "frequency": column("frequency", "Hz", "frequency"),
        "detrended": column("time_kbr", UNITS, "ranging minus orbit, slow part removed"),
        "modelled": column("time_kbr", UNITS, "phase centres, slow part removed"),
        "arc": column("time_kbr", "1", "manoeuvre", dtype="i2"),
        "spectrum_observed": column("frequency", DENSITY, "one-sided density, slow part removed"),
        "spectrum_residual": column("frequency", DENSITY, "one-sided density of the residual"),
    }
)

COMBINE = (
    {name: stated | {"dims": f"observable {stated['dims']}".strip()} for name, stated in _ESTIMATE.items()}
    | _MANOEUVRE
    | {
        "determined": column("observable subset parameter", "1", "1 determined", dtype="u1"),
        "shift": column("observable subset parameter", "m", "sub-set minus all, least squares"),
        "predicted_shift": column("observable subset parameter", "m", "tan of the offset angle times the shift of x"),
    }
)


REPORT = {
    "centre": column("satellite axis", "m", f"{CENTRE}, NaN where not determined", frame="b"),
    "sigma": column("satellite axis", "m", "its standard deviation", frame="b"),
}


def of(schema: dict, observable: str) -> dict:
    """Schema with the units of one observable."""
    number = OBSERVABLES.index(observable)
    return {
        name: stated | {"units": stated["units"][number]} if isinstance(stated.get("units"), tuple) else stated
        for name, stated in schema.items()
    }
