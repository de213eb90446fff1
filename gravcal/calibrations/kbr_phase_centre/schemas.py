"""What the products of this calibration hold: dimensions, units, frames.

`satellite` is 0 for the first letter of the pair and 1 for the second; `parameter` is x, y, z of the first, then of the
second; `axis` of a manoeuvre is 0 for pitch and 1 for yaw.
"""

PARAMETERS = ("x_a", "y_a", "z_a", "x_b", "y_b", "z_b")
OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = ("m", "m s-1", "m s-2")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")

ALIGN = {
    "time": {"dims": "time"},
    "time_kbr": {"dims": "time_kbr"},
    "position_i": {"dims": "satellite time axis", "units": "m", "frame": "i", "long_name": "centre of mass"},
    "quaternion": {"dims": "satellite time q", "units": "1", "long_name": "attitude, scalar first"},
    "reading_range": {"dims": "time_kbr", "units": "m", "long_name": "biased range, light time added"},
    "reading_range_rate": {"dims": "time_kbr", "units": "m s-1", "long_name": "range rate, light time added"},
    "reading_range_acceleration": {
        "dims": "time_kbr",
        "units": "m s-2",
        "long_name": "range acceleration, light time added",
    },
    "antenna_correction": {"dims": "time_kbr", "units": "m", "long_name": "antenna correction of the file, not added"},
    "kbr_flag": {"dims": "time_kbr", "long_name": "0 usable, 1 not", "dtype": "u1"},
    "segment": {"dims": "time_kbr", "long_name": "number of the stretch without a phase break", "dtype": "i4"},
}

POINTING = {
    "time": {"dims": "time"},
    "range_com": {"dims": "time", "units": "m", "long_name": "distance of the centres of mass"},
    "second_order": {"dims": "time", "units": "m", "long_name": "part of the range that is square in the offsets"},
    "line_of_sight_b": {
        "dims": "satellite time axis",
        "units": "1",
        "frame": "b",
        "long_name": "unit vector to the other satellite",
    },
    "angle": {
        "dims": "satellite time axis_2",
        "units": "rad",
        "long_name": "pitch and yaw of the line of sight in the satellite",
    },
    "usable": {"dims": "time", "long_name": "1 where orbits and attitudes are known", "dtype": "u1"},
    "satellite_index": {"dims": "manoeuvre", "long_name": "satellite that moves", "dtype": "i1"},
    "axis_index": {"dims": "manoeuvre", "long_name": "0 pitch, 1 yaw", "dtype": "i1"},
    "sign": {"dims": "manoeuvre", "long_name": "of the offset angle; 0 without offset", "dtype": "i1"},
    "start": {"dims": "manoeuvre", "units": "s", "long_name": "first slew"},
    "stop": {"dims": "manoeuvre", "units": "s", "long_name": "last slew"},
    "offset": {"dims": "manoeuvre", "units": "rad", "long_name": "mean angle"},
    "amplitude": {"dims": "manoeuvre", "units": "rad", "long_name": "amplitude of the wiggle"},
}

_MANOEUVRE = {name: POINTING[name] for name in ("satellite_index", "axis_index", "sign", "start", "stop")}


def _equations(unit: str) -> dict:
    """Schema of the observation equations of one observable, unit "m", "m s-1" or "m s-2"."""
    return {
        "time_kbr": {"dims": "time_kbr"},
        "observed": {"dims": "time_kbr", "units": unit, "long_name": "ranging minus orbit"},
        "column": {
            "dims": "time_kbr parameter",
            "units": {"m": "1", "m s-1": "s-1", "m s-2": "s-2"}[unit],
            "long_name": "derivative by the phase centres",
        },
        "published_column": {
            "dims": "time_kbr parameter",
            "units": {"m": "1", "m s-1": "s-1", "m s-2": "s-2"}[unit],
            "long_name": "the same by local cubic polynomials of the attitude",
        },
        "lever": {
            "dims": "time_kbr order lever",
            "units": "m",
            "long_name": "range per radian of pointing error (z and y of both) and its time derivatives, 1/s each",
        },
        "arc": {"dims": "time_kbr", "long_name": "manoeuvre, -1 quiet, -2 neither", "dtype": "i2"},
        "segment": {"dims": "time_kbr", "long_name": "number of the stretch without a phase break", "dtype": "i4"},
    } | _MANOEUVRE


OBSERVABLE = {name: _equations(unit) for name, unit in zip(OBSERVABLES, UNITS, strict=True)}

NOISE = {
    "reflection": {"dims": "lag", "units": "1", "long_name": "reflection coefficients of the range"},
    "variance": {"dims": "order", "units": "m2", "long_name": "prediction-error variance"},
    "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
    "density": {"dims": "frequency", "units": "m2 Hz-1", "long_name": "one-sided density of quiet ranging minus orbit"},
    "model": {"dims": "frequency", "units": "m2 Hz-1", "long_name": "one-sided density of the model"},
    "seconds": {"dims": "", "units": "s", "long_name": "length of the quiet data"},
    "pointing_power": {
        "dims": "corner",
        "units": "rad2 Hz-1",
        "long_name": "one-sided density of the star camera noise below each corner, seen in the manoeuvres",
    },
    "corner": {"dims": "corner", "units": "Hz", "long_name": "corner frequency; the last one stands for white"},
    "in_manoeuvres": {"dims": "frequency", "units": "m2 Hz-1", "long_name": "one-sided density in the manoeuvres"},
}


def _solution(unit: str) -> dict:
    """Schema of a solution from one observable."""
    return (
        {
            "time_kbr": {"dims": "time_kbr"},
            "frequency": {"dims": "frequency", "units": "Hz", "long_name": "frequency"},
            "centre": {
                "dims": "subset estimator parameter",
                "units": "m",
                "frame": "b",
                "long_name": "centre of mass to phase centre",
            },
            "covariance": {
                "dims": "subset estimator parameter parameter_2",
                "units": "m2",
                "frame": "b",
                "long_name": "covariance",
            },
            "formal_sigma": {
                "dims": "subset estimator parameter",
                "units": "m",
                "frame": "b",
                "long_name": "as usual least squares would print it",
            },
            "condition": {"dims": "subset", "units": "1", "long_name": "condition number of the design"},
            "sigma0": {
                "dims": "subset estimator",
                "units": "1",
                "long_name": "noise in the manoeuvres over quiet noise",
            },
            "kept": {"dims": "subset", "units": "1", "long_name": "mean robust weight"},
            "arc_value": {"dims": "manoeuvre", "units": "m", "long_name": "y or z from one manoeuvre, others held"},
            "arc_sigma": {"dims": "manoeuvre", "units": "m", "long_name": "its standard deviation"},
            "arcs_chi2": {"dims": "", "units": "1", "long_name": "disagreement of the manoeuvres"},
            "arcs_dof": {"dims": "", "long_name": "degrees of freedom", "dtype": "i8"},
        }
        | _residuals(unit)
        | _MANOEUVRE
    )


def _residuals(unit: str) -> dict:
    """What a solution keeps of its observations, to look at."""
    return {
        "detrended": {"dims": "time_kbr", "units": unit, "long_name": "ranging minus orbit, detrended"},
        "modelled": {"dims": "time_kbr", "units": unit, "long_name": "phase centres, detrended"},
        "arc": {"dims": "time_kbr", "long_name": "manoeuvre", "dtype": "i2"},
        "spectrum_observed": {"dims": "frequency", "units": f"({unit})2 Hz-1", "long_name": "density, detrended"},
        "spectrum_residual": {"dims": "frequency", "units": f"({unit})2 Hz-1", "long_name": "density, residual"},
    }


SOLVE = {name: _solution(unit) for name, unit in zip(OBSERVABLES, UNITS, strict=True)}

COMBINE = {
    "centre": {
        "dims": "observable subset estimator parameter",
        "units": "m",
        "frame": "b",
        "long_name": "centre of mass to phase centre",
    },
    "covariance": {
        "dims": "observable subset estimator parameter parameter_2",
        "units": "m2",
        "frame": "b",
        "long_name": "covariance",
    },
    "formal_sigma": {
        "dims": "observable subset estimator parameter",
        "units": "m",
        "frame": "b",
        "long_name": "as usual least squares would print it",
    },
    "determined": {"dims": "observable subset parameter", "long_name": "1 determined", "dtype": "u1"},
    "condition": {"dims": "observable subset", "units": "1", "long_name": "condition number of the design"},
    "sigma0": {
        "dims": "observable subset estimator",
        "units": "1",
        "long_name": "noise in the manoeuvres over quiet noise",
    },
    "kept": {"dims": "observable subset", "units": "1", "long_name": "mean robust weight"},
    "arc_value": {"dims": "observable manoeuvre", "units": "m", "long_name": "y or z from one manoeuvre, others held"},
    "arc_sigma": {"dims": "observable manoeuvre", "units": "m", "long_name": "its standard deviation"},
    "arcs_chi2": {"dims": "observable", "units": "1", "long_name": "disagreement of the manoeuvres"},
    "arcs_dof": {"dims": "observable", "long_name": "degrees of freedom", "dtype": "i8"},
    "shift": {
        "dims": "observable subset parameter",
        "units": "m",
        "long_name": "one-sided set minus all, least squares",
    },
    "predicted_shift": {
        "dims": "observable subset parameter",
        "units": "m",
        "long_name": "tan of the offset angle times the shift of x",
    },
} | _MANOEUVRE
