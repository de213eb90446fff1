"""What products hold: how a variable is described, aligned records of calibrations with torquers, named parameters."""


def column(dims: str, units: str = "", long_name: str = "", **more: object) -> dict[str, object]:
    """Variable of a product schema; more: frame, dtype ("f8" by default), optional. Blanks divide dimensions."""
    named = {"units": units, "long_name": long_name} | more
    return {"dims": dims} | {name: value for name, value in named.items() if value != ""}


ALIGN = {
    "time_acc": column("time_acc"),
    "time_sca": column("time_sca"),
    "time_mag": column("time_mag"),
    "time_orbit": column("time_orbit"),
    "linear_b": column("time_acc axis", "m s-2", "linear acceleration as read", frame="b"),
    "angular_b": column("time_acc axis", "rad s-2", "angular acceleration as read", frame="b"),
    "acc_flag": column("time_acc", "1", "0 usable, 1 not, 2 isolated outlier", dtype="u1"),
    "quaternion": column("time_sca q", "1", "scalar first"),
    "sca_flag": column("time_sca", "1", "0 usable, 1 not, 2 isolated outlier", dtype="u1"),
    "field_measured_b": column("time_mag axis", "T", "magnetometer", frame="b"),
    "current_b": column("time_mag axis", "mA", "torquer current", frame="b"),
    "mag_flag": column("time_mag", "1", "0 usable, 1 not", dtype="u1"),
    "window_start": column("window", "s", "begin of a window"),
    "window_stop": column("window", "s", "end of a window"),
    "gap": column(
        "window", "1", "longer than the limit inside the manoeuvre: 1 orbit, 2 star camera; not used", dtype="u1"
    ),
    "position_i": column("time_orbit axis", "m", "position of the centre of mass", frame="i"),
    "velocity_i": column("time_orbit axis", "m s-1", "velocity of the centre of mass", frame="i"),
    "position_e": column("time_orbit axis", "m", "position of the centre of mass", frame="e"),
    "orbit_flag": column("time_orbit", "1", "0 usable, 1 not", dtype="u1"),
    "start": column("manoeuvre", "s", "first edge, middle of its interval"),
    "stop": column("manoeuvre", "s", "last edge, middle of its interval"),
    "kind": column("manoeuvre", "1", "axis of the torque: 0 roll, 1 pitch, 2 yaw", dtype="i1"),
    "rod": column("manoeuvre", "1", "torquer with the wave: 0 x, 1 y, 2 z", dtype="i1"),
    "edge_lower": column("manoeuvre edge", "s", "last telemetry sample before an edge"),
    "edge_upper": column("manoeuvre edge", "s", "first telemetry sample after an edge"),
    "level": column("manoeuvre half_period", "mA", "mean current of each half period"),
    "regular": column("manoeuvre", "1", "edges are whole half periods apart", dtype="i1"),
}

#: Named parameters of different units, of `named_parameters`; parts are stretches of the record, each solved alone.
PARAMETERS = {
    "parameter": column("parameter", "", "name", dtype="str"),
    "unit": column("parameter", "", "unit of value and sigma", dtype="str"),
    "value": column("parameter", "1", "estimate in its own unit, NaN where not determined"),
    "sigma": column("parameter", "1", "standard deviation in the same unit"),
    "covariance": column("parameter parameter_2", "1", "covariance in the same units"),
    "part_start": column("part", "s", "GPS time at which a part of the record begins"),
    "part_value": column("part parameter", "1", "estimate from one part alone"),
    "part_sigma": column("part parameter", "1", "its standard deviation"),
    "agreement_chi2": column("", "1", "disagreement of the parts with the estimate"),
    "agreement_dof": column("", "1", "degrees of freedom", dtype="i8"),
}

REPORT = {"delivered": column("", "1", "1 where the result could be formed", dtype="i1")}
