"""Attitude of one or both satellites of a pair, with their thruster firings left out of the model."""

from __future__ import annotations

import numpy as np

from gravcal import catalog
from gravcal.calibrations.attitude_thrusters import series, view
from gravcal.physics import earth, magnetic
from tasks import common

TWIN = {"A": "B", "B": "A"}
ORBIT_STEP_S = 60.0
SAID = "amplitudes, delays and inertia are confounded with attitude control, whose torquers are not observed"
NOTES = [
    "A torque free to change every knot stands for the torquers, aerodynamics, radiation and gravity gradient.",
    "Shares are in units of lever arm x force x time on of the thruster table, with assumed moments of inertia.",
    "A delay of the firings and the opposite delay of the star camera look the same: only their difference shows.",
    "Power and gains are divided by the inflation, what firings at wrong times gain over what chance would give.",
]


def prepare(data, satellite, date, chosen) -> dict:
    """Blocks and candidates of each satellite.

    Parameters
    ----------
    data : folder
    satellite : "A", "B" or "AB"
    date : YYYY-MM-DD
    chosen : Parameters
    """
    letters = satellite or "AB"
    source = common.source_of("com_offset", ("THR1B",), data=data, satellite=letters[0], date=date)
    files, runs, facts = [], [], {}
    for letter in letters:
        inputs, found = _inputs(source, letter)
        blocks, candidates, facts[letter] = view.view(*inputs, **chosen.for_stage("attitude"))
        files += found
        runs.append((letter, blocks, candidates))
    event = f"grace-{letters.lower()}-{source.date}"
    words = {"calibration": "com_offset", "event": event, "said": SAID, "notes": NOTES}
    return words | common.named(event, files) | {"runs": runs, "facts": facts}


def _inputs(source, letter):
    """Arguments of the view, and the files."""
    from gravcal.io.readers import read

    found = [source.file("SCA1B", satellite=letter), source.file("THR1B", satellite=letter)]
    found += [source.file("THR1B", satellite=TWIN[letter]), source.file("GNI1B", "GNV1B", satellite=letter)]
    camera, own, twin, orbit = (read(f) for f in found)
    firings = [_firings(one, x) for one, x in ((own, letter), (twin, TWIN[letter]))]
    inertia = np.array(catalog.satellite(letter).inertia.value)
    inputs = (series.camera(camera), *firings, _orbit(orbit), inertia)
    return inputs, found


def _firings(observed, letter):
    satellite = catalog.satellite(letter)
    return series.firings(observed, satellite.thruster_position.value, satellite.thruster_force.value)


def _orbit(observed):
    """Time, inertial position and inertial field, once a minute."""
    time = observed["time_tag"].values
    step = max(int(round(ORBIT_STEP_S / np.median(np.diff(time)))), 1)
    time = time[::step]
    position, velocity = (np.stack([observed[f"{a}{k}"].values[::step] for a in "xyz"], axis=1) for k in ("pos", "vel"))
    inertial, _ = earth.state_to_inertial(time, position, velocity)
    field = magnetic.field_e(time, position, 14)
    return time, inertial, np.matvec(np.swapaxes(earth.R_ei(time), 1, 2), field)
