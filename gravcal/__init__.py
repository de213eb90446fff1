"""gravcal: in-orbit calibration of gravity missions, from Level-1 files to values with honest errors.

Conventions, the same everywhere
--------------------------------
Frames
    ``i`` inertial (GCRF), ``e`` Earth-fixed (ITRF), ``o`` orbit, ``b`` body (the science reference frame, SRF: x
    along the line of sight, z to nadir), ``s`` sensor. A suffix says in which frame a vector is resolved:
    ``position_i``, ``com_to_proof_mass_b``. Accelerometer files are moved from their own frame to ``b`` by the reader.
Rotations
    ``R_ab`` takes components in b to components in a, and touching letters match: ``v_b = R_bi @ v_i``.
Quaternions
    Scalar first, as in SCA1B: q = (w, x, y, z) built as the usual active matrix takes b to i; its transpose is
    ``R_bi``.
Offsets
    The name says from where to where: ``com_to_proof_mass_b`` points from the centre of mass to the proof mass.
    An accelerometer at the offset p feels T p with T = [w' x] + [w x][w x] - G beside the non-gravitational
    acceleration.
Time
    Coordinate ``time``: seconds past 2000-01-01 12:00:00 on the GPS scale, float64, continuous, without leap seconds.
    A delay is positive when a tag is late.
Units
    SI in arrays and products, said in ``attrs["units"]``; in settings and the catalogue the unit is part of the name
    (``step_s``).
Arrays
    Vectors on the last axis, one epoch or many. Bad samples are flagged in ``flag``, not dropped.
Symbols
    w, wd: angular rate and its derivative; G: gravity gradient dg/dr; p: offset; J: inertia; m: dipole; B: magnetic
    flux density.
Errors
    ``gravcal.errors``: where, what was found against what was expected, what to do.
"""

import importlib.metadata

try:
    __version__ = importlib.metadata.version("gravcal")
except importlib.metadata.PackageNotFoundError:  # run from a folder that was never installed
    __version__ = "0+unknown"
