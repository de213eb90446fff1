"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import PARAMETERS, column

ALIGN = {
    "time": column("time"),
    "begin": column("time", "s", "GPS time from which the samples of a step are"),
    "end": column("time", "s", "GPS time to which they are"),
    "linear_b": column("time axis", "m s-2", "linear acceleration as read, mean of a step, NaN if missing", frame="b"),
    "angular_b": column("time axis", "rad s-2", "angular acceleration as read, NaN if missing", frame="b"),
    "dipole_b": column("time axis", "A m2", "dipole of the torquers by their currents", frame="b"),
    "dipole_rate_b": column("time axis", "A m2 s-1", "its rate", frame="b"),
    "magnetic_b": column("time axis", "rad s-2", "angular acceleration by dipole x reference field", frame="b"),
    "firing": column("firings", "s", "GPS time at which a firing begins"),
    "on": column("firings pair", "s", "time on of each pair of thrusters, mean of its two"),
    "nominal_b": column("pair axis", "rad s-2", "angular acceleration by a pair while on, thruster table", frame="b"),
    "step": column("", "s", "length over which readings are averaged"),
}

ESTIMATE = PARAMETERS | {
    "time": column("time"),
    "measured": column("time component", "1", "reading less its slow part, m s-2 and rad s-2"),
    "fitted": column("time component", "1", "the same as firings, currents and turns make it"),
    "cause": column("cause", "", "what the readings may follow", dtype="str"),
    "gain": column("cause", "1", "chi-square that it takes beside all others"),
    "chance": column("cause", "1", "probability of as much by chance, corrected for the number of causes"),
    "transient": column("transient", "s", "epoch of what no record explains"),
    "transient_swings": column("transient", "1", "changes of sign above half the limit; a spike has none", dtype="i8"),
}
