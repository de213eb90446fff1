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

What there is
-------------
``gravcal.open(event)``
    Products of an event in the store, as an ``xarray.DataTree``.
``com_offset``, ``kbr_phase_centre``, ``inertial_sensor``, ``gradient_torque``, ``magnetometer``
    The estimators on plain arrays, usable without store, flows or files: ``from gravcal import com_offset``.
``physics``, ``estimation``, ``effects``
    Laws, least squares and noise models, and the effects that simulator, estimator and discovery share.
``catalog``
    Satellites, events, parameters and published values.

The pipeline is the command ``gravcal``; its flows are in ``flows``, its stages in ``tasks``.
"""

import importlib
import importlib.metadata
import importlib.util

try:
    __version__ = importlib.metadata.version("gravcal")
except importlib.metadata.PackageNotFoundError:  # run from a folder that was never installed
    __version__ = "0+unknown"


def open(event, configuration=None):  # noqa: A001 - gravcal.open, as xarray.open_dataset
    """Products of an event that its last run left in the store.

    Parameters
    ----------
    event : name, such as "grace-c-2020-03-01"; `gravcal products` lists them
    configuration : name of an experiment; the operational one by default

    Returns
    -------
    tree : xarray.DataTree, a node a product, "com_offset/solve/mtq"; attributes "stage" and "key" lead to its record

    Raises
    ------
    ProductError : the store (GRAVCAL_PRODUCTS) has no product of this event
    """
    from gravcal.store import housekeeping

    return housekeeping.tree(event, configuration)


def __getattr__(name):
    """Modules of the interface, imported when they are asked for."""
    for parent in ("gravcal", "gravcal.calibrations"):
        if importlib.util.find_spec(f"{parent}.{name}") is not None:
            return importlib.import_module(f"{parent}.{name}")
    raise AttributeError(f"module 'gravcal' has no attribute {name!r}")


def __dir__():
    """Names of the interface."""
    from pathlib import Path

    below = [*Path(__file__).parent.iterdir(), *(Path(__file__).parent / "calibrations").iterdir()]
    return sorted({*globals(), *(path.name for path in below if (path / "__init__.py").exists())} - {"calibrations"})
