"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import PARAMETERS, column

_IMPULSE, _MIDDLE = "lever arm x force x time on of the thruster table", "GPS time of the middle of a firing"

ALIGN = {
    "time": column("time"),
    "quaternion": column("time q", "1", "attitude, scalar first, inertial to b"),
    "head": column("time", "1", "star camera or combination in use", dtype="i4"),
    "quality": column("time", "rad", "qual_rss of SCA1B"),
    "step": column("", "s", "spacing of the attitudes"),
    "firing": column("firings", "s", _MIDDLE),
    "impulse_b": column("firings axis", "N m s", _IMPULSE, frame="b"),
    "twin_firing": column("twin_firings", "s", _MIDDLE, optional=True),
    "twin_impulse_b": column("twin_firings axis", "N m s", _IMPULSE, frame="b", optional=True),
    "time_orbit": column("time_orbit"),
    "position_i": column("time_orbit axis", "m", "position", frame="i"),
    "field_i": column("time_orbit axis", "T", "geomagnetic field, model", frame="i"),
    "velocity_error": column("", "m s-1", "velocity against change of position, largest"),
}

NOISE = {
    "head": column("heads", "1", "star camera or combination", dtype="i4"),
    "factor": column("heads component axis", "rad-1", "inverse Cholesky factor of the covariance of its errors"),
    "reflection": column("component order", "1", "reflection coefficients of each component"),
    "variance": column("component orders", "1", "prediction-error variance of every order"),
    "step": column("", "s", "spacing of the attitudes"),
    "stretches": column("", "1", "quiet stretches it was measured from", dtype="i8"),
    "samples": column("", "1", "their epochs", dtype="i8"),
}

ESTIMATE = PARAMETERS | {
    "shift": column("shift", "s", "by which all firings were moved to wrong times"),
    "shifted_gain": column("shift", "1", "chi-square gained by the firings at wrong times"),
    "gain": column("", "1", "chi-square gained by the firings at their own times"),
    "inflation": column("", "1", "variance of the day over that of its quiet stretches"),
    "firings": column("", "1", "firings inside the record", dtype="i8"),
}
