"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.named_parameters import PARAMETERS

_IMPULSE = {"units": "N m s", "frame": "b", "long_name": "lever arm x force x time on of the thruster table"}
_EPOCH = {"units": "s", "long_name": "GPS time of the middle of a firing"}

ALIGN = {
    "time": {"dims": "time"},
    "quaternion": {"dims": "time quaternion_part", "units": "1", "long_name": "attitude, scalar first, inertial to b"},
    "head": {"dims": "time", "units": "1", "dtype": "i4", "long_name": "star camera or combination in use"},
    "quality": {"dims": "time", "units": "rad", "long_name": "qual_rss of SCA1B"},
    "step": {"dims": "", "units": "s", "long_name": "spacing of the attitudes"},
    "firing": {"dims": "firings", **_EPOCH},
    "impulse_b": {"dims": "firings axis", **_IMPULSE},
    "twin_firing": {"dims": "twin_firings", "optional": True, **_EPOCH},
    "twin_impulse_b": {"dims": "twin_firings axis", "optional": True, **_IMPULSE},
    "time_orbit": {"dims": "time_orbit"},
    "position_i": {"dims": "time_orbit axis", "units": "m", "frame": "i", "long_name": "position"},
    "field_i": {"dims": "time_orbit axis", "units": "T", "frame": "i", "long_name": "geomagnetic field, model"},
    "velocity_error": {"dims": "", "units": "m s-1", "long_name": "velocity against change of position, largest"},
}

NOISE = {
    "head": {"dims": "heads", "units": "1", "dtype": "i4", "long_name": "star camera or combination"},
    "factor": {
        "dims": "heads component axis",
        "units": "rad-1",
        "long_name": "inverse Cholesky factor of the covariance of its errors",
    },
    "reflection": {"dims": "component order", "units": "1", "long_name": "reflection coefficients of each component"},
    "variance": {"dims": "component orders", "units": "1", "long_name": "prediction-error variance of every order"},
    "step": {"dims": "", "units": "s", "long_name": "spacing of the attitudes"},
    "stretches": {"dims": "", "units": "1", "dtype": "i8", "long_name": "quiet stretches it was measured from"},
    "samples": {"dims": "", "units": "1", "dtype": "i8", "long_name": "their epochs"},
}

ESTIMATE = PARAMETERS | {
    "shift": {"dims": "shift", "units": "s", "long_name": "by which all firings were moved to wrong times"},
    "shifted_gain": {"dims": "shift", "units": "1", "long_name": "chi-square gained by the firings at wrong times"},
    "gain": {"dims": "", "units": "1", "long_name": "chi-square gained by the firings at their own times"},
    "inflation": {"dims": "", "units": "1", "long_name": "variance of the day over that of its quiet stretches"},
    "firings": {"dims": "", "units": "1", "dtype": "i8", "long_name": "firings inside the record"},
}

REPORT = {"delivered": {"dims": "", "units": "1", "long_name": "1 where the result could be formed", "dtype": "i1"}}
