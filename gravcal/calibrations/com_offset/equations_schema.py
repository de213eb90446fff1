"""What the products between the aligned records and the solution hold: everything on the grid of the solution."""

from gravcal.calibrations.com_offset.schemas import LATITUDE, MANOEUVRES, MODES

#: Epochs of both need not increase: windows may overlap, and with them the pieces of quiet data.
QUIET = {
    "epoch": {"dims": "sample", "units": "s", "long_name": "GPS time of a sample, piece after piece"},
    "piece": {"dims": "sample", "units": "1", "long_name": "piece of quiet data", "dtype": "i2"},
    "reading": {"dims": "sample axis", "units": "m s-2", "frame": "b", "long_name": "linear acceleration"},
}

EQUATIONS = {
    "epoch": {"dims": "sample", "units": "s", "long_name": "GPS time of a sample, manoeuvre after manoeuvre"},
    "grid_manoeuvre": {"dims": "sample", "units": "1", "long_name": "manoeuvre", "dtype": "i2"},
    "valid": {"dims": "sample", "units": "1", "long_name": "enough samples round the epoch", "dtype": "u1"},
    "reading": {"dims": "sample axis", "units": "m s-2", "frame": "b", "long_name": "linear acceleration"},
    "still": {
        "dims": "sample axis axis_2",
        "units": "s-2",
        "frame": "b",
        "long_name": "reading for a metre of offset, without angular acceleration",
    },
    "rate_dot_b": {"dims": "sample axis", "units": "rad s-2", "frame": "b", "long_name": "angular acceleration"},
    "driven_b": {
        "dims": "instrument sample axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration of the dynamics, without the noise of a sensor",
    },
    "mode": {
        "dims": "mode_index sample axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "change for one standard deviation",
    },
    **MODES,
    **MANOEUVRES,
    "latitude": LATITUDE,
}
