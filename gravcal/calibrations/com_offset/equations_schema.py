"""What the products between the aligned records and the solution hold: everything on the grid of the solution."""

from gravcal.calibrations.com_offset.schemas import LATITUDE, MANOEUVRES, MODES

QUIET = {
    "time_grid": {"dims": "time_grid"},
    "piece": {"dims": "time_grid", "units": "1", "long_name": "piece of quiet data", "dtype": "i2"},
    "reading": {"dims": "time_grid axis", "units": "m s-2", "frame": "b", "long_name": "linear acceleration"},
}

EQUATIONS = {
    "time_grid": {"dims": "time_grid"},
    "grid_manoeuvre": {"dims": "time_grid", "units": "1", "long_name": "manoeuvre", "dtype": "i2"},
    "valid": {"dims": "time_grid", "units": "1", "long_name": "enough samples round the epoch", "dtype": "u1"},
    "reading": {"dims": "time_grid axis", "units": "m s-2", "frame": "b", "long_name": "linear acceleration"},
    "still": {
        "dims": "time_grid axis axis_2",
        "units": "s-2",
        "frame": "b",
        "long_name": "reading for a metre of offset, without angular acceleration",
    },
    "rate_dot_b": {"dims": "time_grid axis", "units": "rad s-2", "frame": "b", "long_name": "angular acceleration"},
    "driven_b": {
        "dims": "instrument time_grid axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "angular acceleration of the dynamics, without the noise of a sensor",
    },
    "mode": {
        "dims": "mode_index time_grid axis",
        "units": "rad s-2",
        "frame": "b",
        "long_name": "change for one standard deviation",
    },
    **MODES,
    **MANOEUVRES,
    "latitude": LATITUDE,
}
