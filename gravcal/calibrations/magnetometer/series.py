"""Level-1 records of one satellite as arrays: measured field, reference field, dipoles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.align import QUATERNION, sorted_samples
from gravcal.errors import EstimationError
from gravcal.estimation import timing
from gravcal.physics import earth, frames, magnetic, orbit_environment


@dataclass(frozen=True)
class Field:
    """Measured and modelled field at the magnetometer's epochs.

    Attributes
    ----------
    time : (n,) s
    measured_b, model_b : (n, 3) T
    slope_b : (n, 3) T s-1, rate of the modelled field in the body
    dipole_b : (n, 3) A m2, of the torquers
    axis_b : (n, 3) unit vector along the moment of the main field
    """

    time: np.ndarray
    measured_b: np.ndarray
    model_b: np.ndarray
    slope_b: np.ndarray
    dipole_b: np.ndarray
    axis_b: np.ndarray


def field(mag: xr.Dataset, camera: xr.Dataset, orbit: xr.Dataset, per_current, generation: int) -> Field:
    """Records that attitude and orbit cover.

    Parameters
    ----------
    mag, camera, orbit : Dataset, "ingest" of MAG1B, SCA1B, GNV1B
    per_current : (3,) A m2 mA-1
    generation : of the IGRF
    """
    columns = tuple(f"Mfv{a}_RAW" for a in "XYZ")
    mag = mag.assign({f"current_{a}": mag["current_b"][:, i] for i, a in enumerate("xyz")})
    time, values = _usable(mag, (*columns, *(f"current_{a}" for a in "xyz")))
    sca_time, quaternion = _usable(camera, QUATERNION)
    orbit_time, position = _usable(orbit, ("xpos", "ypos", "zpos"))
    inside = (time >= max(sca_time[0], orbit_time[0])) & (time <= min(sca_time[-1], orbit_time[-1]))
    if inside.sum() < 20:
        raise EstimationError(
            f"{mag.attrs.get('file', 'MAG1B')}: found {int(inside.sum())} records with attitude and orbit, expected at "
            f"least 20. Give files of the same minutes.",
            records=int(inside.sum()),
        )
    time, values = time[inside], values[inside]
    turning = _body_field(orbit_time, position, sca_time, frames.continuous(quaternion), generation)
    model, axis = turning(time)
    before, after = np.maximum(time - 0.5, sca_time[0]), np.minimum(time + 0.5, sca_time[-1])
    slope = (turning(after)[0] - turning(before)[0]) / (after - before)[:, None]
    scale = 1e-6 if mag[columns[0]].attrs.get("units") != "T" else 1.0
    return Field(time, values[:, :3] * scale, model, slope, values[:, 3:] * np.asarray(per_current), axis)


def _usable(observed, names):
    tags = timing.normalised(observed["time_second"].values, observed["time_fraction"].values)
    time, values, flag, _ = sorted_samples(observed, tags, names)
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    return time[good], values[good]


def _body_field(orbit_time, position_e, sca_time, quaternion, generation):
    """Reference field and direction of the main dipole in the body: callable of time."""
    from scipy.interpolate import CubicSpline

    to_inertial = np.swapaxes(earth.R_ei(orbit_time), 1, 2)
    field_i = CubicSpline(orbit_time, np.matvec(to_inertial, magnetic.field_e(orbit_time, position_e, generation)))
    axis_i = CubicSpline(orbit_time, orbit_environment.dipole_axis_i(orbit_time))

    def at(time):
        R_bi = frames.R_bi_from_quaternion(frames.interpolate(sca_time, quaternion, time))
        return np.matvec(R_bi, field_i(time)), np.matvec(R_bi, axis_i(time))

    return at
