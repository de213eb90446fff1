"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import PARAMETERS, column

ALIGN = {
    "time": column("time"),
    "observed": column("time", "m", "ranging minus orbit, antenna correction left out, mean of a minute"),
    "column": column("time parameter", "1", "derivative by the phase centres", frame="b"),
    "segment": column("time", "1", "number of the stretch without a phase break", dtype="i4"),
    "range": column("time", "m", "range less its bias"),
    "range_rate": column("time", "m s-1", "change of the range"),
    "argument": column("time", "rad", "argument of latitude of the first satellite"),
    "warmth": column("time", "1", "sunlight on the first satellite with a lag, 0 to 1"),
}

ESTIMATE = PARAMETERS | {
    "time": column("time"),
    "residual": column("time", "m", "ranging minus orbit, bias and slow orbit error removed"),
    "fitted": column("time", "m", "the same as the phase centres have it"),
}
