"""What the products of this calibration hold: dimensions, units, frames."""

from gravcal.calibrations.schemas import PARAMETERS, column

ALIGN = {
    "time": column("time"),
    "observed": column("time", "m", "ranging minus orbit, antenna correction left out"),
    "column": column("time parameter", "1", "derivative by the phase centres, smoothed pointing", frame="b"),
    "motion": column("time parameter", "1", "the same where range and motion exceed their noise", frame="b"),
    "correction": column("time", "m", "antenna correction by the pointing as measured and the catalogue"),
    "correction_band": column("time band", "m", "parts of it by band"),
    "smoothed_band": column("time band", "m", "parts by band of the correction by the smoothed pointing"),
    "edge": column("edge", "Hz", "edges of the bands"),
    "segment": column("time", "1", "number of the stretch without a phase break", dtype="i4"),
    "range": column("time", "m", "range less its bias"),
    "range_rate": column("time", "m s-1", "change of the range"),
    "argument": column("time", "rad", "argument of latitude of the first satellite"),
    "warmth": column("time", "1", "sunlight on the first satellite with a lag, 0 to 1"),
    "late": column("stream", "s", "tags late against those of the orbits: ranging, star cameras of both"),
    "frequency": column("frequency", "Hz", "frequency"),
    "pointing_density": column("satellite angle frequency", "rad2 Hz-1", "one-sided density of yaw and pitch"),
    "pointing_gain": column("satellite angle frequency", "1", "share of it that the smoothed pointing keeps"),
}

ESTIMATE = PARAMETERS | {
    "time": column("time"),
    "residual": column("time", "m", "ranging minus orbit, bias and slow orbit error removed"),
    "fitted": column("time", "m", "the same as the phase centres have it"),
    "edge": column("edge", "Hz", "edges of the bands"),
    "share": column("band", "1", "part of the antenna correction that the range shows"),
    "share_covariance": column("band band_2", "1", "covariance of these"),
    "expected": column("band", "1", "part that is motion, by the star cameras alone"),
    "excess": column("kind", "1", "of the variance at wrong times, taken into the errors: phase centres, shares"),
    "density": column("correction band", "m2 Hz-1", "of the range: no correction, as measured, smoothed pointing"),
}
