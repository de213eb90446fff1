"""What the products of this calibration hold: dimensions, units, frames.

`satellite` is 0 for the first letter of the pair and 1 for the second; `parameter` is x, y, z of the first, then of
the second; `axis_index` of a manoeuvre is 0 for pitch and 1 for yaw. `subset`, `estimator` and `observable` are in the
order of SUBSETS, ESTIMATORS and OBSERVABLES. Where a variable has three units, they are those of the observables.
"""

PARAMETERS = ("x_a", "y_a", "z_a", "x_b", "y_b", "z_b")
OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = ("m", "m s-1", "m s-2")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")


def _v(dims: str, units: str | tuple[str, ...], long_name: str, dtype: str = "f8", frame: str | None = None) -> dict:
    """One variable of a schema."""
    stated = {"dims": dims, "units": units, "long_name": long_name, "dtype": dtype}
    return stated | ({"frame": frame} if frame else {})


TIME, TIME_KBR = {"dims": "time"}, {"dims": "time_kbr"}
CENTRE = "centre of mass to phase centre"
PER_M = ("1", "s-1", "s-2")
DENSITY = ("m2 Hz-1", "m2 s-2 Hz-1", "m2 s-4 Hz-1")

ALIGN = {
    "time": TIME,
    "time_kbr": TIME_KBR,
    "position_i": _v("satellite time axis", "m", "centre of mass", frame="i"),
    "quaternion": _v("satellite time q", "1", "attitude, scalar first"),
    "reading_range": _v("time_kbr", "m", "biased range, light time added"),
    "reading_range_rate": _v("time_kbr", "m s-1", "range rate, light time added"),
    "reading_range_acceleration": _v("time_kbr", "m s-2", "range acceleration, light time added"),
    "antenna_correction": _v("time_kbr", "m", "antenna correction of the file, not added"),
    "kbr_flag": _v("time_kbr", "1", "0 usable, 1 not", "u1"),
    "segment": _v("time_kbr", "1", "number of the stretch without a phase break", "i4"),
}

_MANOEUVRE = {
    "satellite_index": _v("manoeuvre", "1", "satellite that moves", "i1"),
    "axis_index": _v("manoeuvre", "1", "0 pitch, 1 yaw", "i1"),
    "sign": _v("manoeuvre", "1", "of the offset angle; 0 without offset", "i1"),
    "start": _v("manoeuvre", "s", "first slew"),
    "stop": _v("manoeuvre", "s", "last slew"),
}

MANOEUVRE = tuple(_MANOEUVRE)

POINTING = {
    "time": TIME,
    "range_com": _v("time", "m", "distance of the centres of mass"),
    "second_order": _v("time", "m", "part of the range that is square in the offsets"),
    "line_of_sight_b": _v("satellite time axis", "1", "unit vector to the other satellite", frame="b"),
    "angle": _v("satellite time axis_2", "rad", "pitch and yaw of the line of sight in the satellite"),
    "usable": _v("time", "1", "1 where orbits and attitudes are known", "u1"),
    "offset": _v("manoeuvre", "rad", "mean angle"),
    "amplitude": _v("manoeuvre", "rad", "amplitude of the wiggle"),
} | _MANOEUVRE

OBSERVABLE = {
    "time_kbr": TIME_KBR,
    "observed": _v("time_kbr", UNITS, "ranging minus orbit"),
    "column": _v("time_kbr parameter", PER_M, "derivative by the phase centres"),
    "published_column": _v("time_kbr parameter", PER_M, "the same by local cubic polynomials"),
    "lever": _v(
        "time_kbr derivative arm",
        "m",
        "range per radian of pointing error, z and y of both; order n of the time derivative in m s-n",
    ),
    "arc": _v("time_kbr", "1", "manoeuvre, -1 quiet, -2 neither", "i2"),
    "segment": _v("time_kbr", "1", "number of the stretch without a phase break", "i4"),
} | _MANOEUVRE

NOISE = {
    "reflection": _v("lag", "1", "reflection coefficients of the range"),
    "variance": _v("order", "m2", "prediction-error variance"),
    "frequency": _v("frequency", "Hz", "frequency"),
    "density": _v("frequency", "m2 Hz-1", "one-sided density of quiet ranging minus orbit"),
    "model": _v("frequency", "m2 Hz-1", "one-sided density of the model"),
    "in_manoeuvres": _v("frequency", "m2 Hz-1", "one-sided density of the residual in the manoeuvres"),
    "seconds": _v("", "s", "length of the quiet data"),
    "corner": _v("corner", "Hz", "corner frequency; the last one stands for white"),
    "pointing_power": _v("corner", "rad2 Hz-1", "one-sided density of the star camera noise below each corner"),
}

_ESTIMATE = {
    "centre": _v("subset estimator parameter", "m", CENTRE, frame="b"),
    "covariance": _v("subset estimator parameter parameter_2", "m2", "covariance", frame="b"),
    "formal_sigma": _v("subset estimator parameter", "m", "as usual least squares would print it", frame="b"),
    "condition": _v("subset", "1", "condition number of the design"),
    "sigma0": _v("subset estimator", "1", "noise in the manoeuvres over the noise assumed"),
    "kept": _v("subset", "1", "mean robust weight"),
    "arc_value": _v("manoeuvre", "m", "y or z from one manoeuvre, the others held"),
    "arc_sigma": _v("manoeuvre", "m", "its standard deviation"),
    "arcs_chi2": _v("", "1", "disagreement of the manoeuvres"),
    "arcs_dof": _v("", "1", "degrees of freedom", "i8"),
}

SOLVE = (
    _ESTIMATE
    | _MANOEUVRE
    | {
        "time_kbr": TIME_KBR,
        "frequency": _v("frequency", "Hz", "frequency"),
        "detrended": _v("time_kbr", UNITS, "ranging minus orbit, slow part removed"),
        "modelled": _v("time_kbr", UNITS, "phase centres, slow part removed"),
        "arc": _v("time_kbr", "1", "manoeuvre", "i2"),
        "spectrum_observed": _v("frequency", DENSITY, "one-sided density, slow part removed"),
        "spectrum_residual": _v("frequency", DENSITY, "one-sided density of the residual"),
    }
)

COMBINE = (
    {name: stated | {"dims": f"observable {stated['dims']}".strip()} for name, stated in _ESTIMATE.items()}
    | _MANOEUVRE
    | {
        "determined": _v("observable subset parameter", "1", "1 determined", "u1"),
        "shift": _v("observable subset parameter", "m", "sub-set minus all, least squares"),
        "predicted_shift": _v("observable subset parameter", "m", "tan of the offset angle times the shift of x"),
    }
)

ROUTINE = {
    "centre": _v("parameter", "m", f"{CENTRE}, from quiet ranging", frame="b"),
    "sigma": _v("parameter", "m", "its standard deviation; both NaN where not determined", frame="b"),
    "x_misfit": _v("", "1", "largest distance of x from the catalogue over its error, which tests the errors"),
    "singular": _v("parameter", "1", "singular values of the columns without their mean, rms"),
    "correction_centre": _v("satellite axis", "m", f"{CENTRE}, behind the file's antenna correction", frame="b"),
    "correction_sigma": _v("satellite axis", "m", "its standard deviation if the misfit is white", frame="b"),
    "correction_rms": _v("", "m", "misfit of the records that keep their weight"),
    "correction_kept": _v("", "1", "share of the records that do"),
}

REPORT = {
    "centre": _v("satellite axis", "m", f"{CENTRE}, NaN where not determined", frame="b"),
    "sigma": _v("satellite axis", "m", "its standard deviation", frame="b"),
}


def of(schema: dict, observable: str) -> dict:
    """Schema with the units of one observable."""
    number = OBSERVABLES.index(observable)
    return {
        name: stated | {"units": stated["units"][number]} if isinstance(stated.get("units"), tuple) else stated
        for name, stated in schema.items()
    }
