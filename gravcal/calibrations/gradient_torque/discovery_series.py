"""What a day of S-GRS leaves unexplained, channel by channel, at the epochs of the record.

Distance of the sensors, a constant torque and the centre of pressure are free: their columns stand behind each series.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.gradient_torque import attitude as smoothing
from gravcal.calibrations.gradient_torque import laws
from gravcal.calibrations.gradient_torque.gradient import orbit
from gravcal.effects import Context
from gravcal.physics import dynamics, earth, frames, gravity, gravity_field, sensing

#: Shared parameters: centre of pressure m, constant torque N m, distance of the sensors m.
SHARED = 9
PRESSURE, CONSTANT, DISTANCE = slice(0, 3), slice(3, 6), slice(6, 9)
METHOD = 1  # motion from all sensors


def context(modelled: xr.Dataset, found: xr.Dataset, satellite: dict, tesseral_b: np.ndarray) -> Context:
    """What effects look at, at the epochs of the record.

    Parameters
    ----------
    modelled, found : Dataset, "gradient_torque.gradient", "gradient_torque.drag"
    satellite : inertia, mass
    tesseral_b : (n, 2, 3, 3) s-2, of `tesseral`
    """
    motion = {name: modelled[name].values[METHOD] for name in ("rate_b", "rate_dot_b")}
    extra = {"positions": modelled["sensor_position_b"].values, "mass": satellite["mass"]}
    extra |= {"non_gravitational_b": np.nan_to_num(found["drag_b"].values), "tesseral_b": tesseral_b}
    time, inertia = modelled["time"].values, np.array(satellite["inertia"])
    gradient = modelled["gradient_b"].values
    return Context(time, epoch=time[0], inertia_b=inertia, gradient_b=gradient, extra=extra, **motion)


def attitude(modelled: xr.Dataset, observed: xr.Dataset, gap_limit_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed attitude R_bi (n, 3, 3), and position (n, 3) m in i.

    Parameters
    ----------
    modelled, observed : Dataset, "gradient_torque.gradient", "ingest"
    gap_limit_s : s, of the orbit
    """
    position, velocity = orbit(observed, gap_limit_s)
    return smoothing.R_bo(modelled["angle"].values[METHOD]) @ smoothing.orbit_frame(position, velocity), position


def tesseral(time: np.ndarray, R_bi: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Gravity gradient (n, 2, 3, 3) s-2 in b of C_22 = 1 and of S_22 = 1.

    Parameters
    ----------
    time : (n,) s; R_bi : (n, 3, 3); position : (n, 3) m in i
    """
    R_ei = earth.R_ei(time)
    both = gravity_field.sectorial_gradient_e(np.matvec(R_ei, position))
    R_be = R_bi @ np.swapaxes(R_ei, 1, 2)
    return np.stack([gravity.rotate_tensor(R_be, both[:, k]) for k in range(2)], axis=1)


def difference(about: Context, modelled: xr.Dataset) -> np.ndarray:
    """Difference of both linear readings less its model, (n, 3, 1 + SHARED) m s-2.

    Parameters
    ----------
    about : Context
    modelled : Dataset, "gradient_torque.gradient"
    """
    tensor = sensing.offset_tensor(about.rate_b, about.rate_dot_b, about.gradient_b)
    apart = about.extra["positions"][0] - about.extra["positions"][1]
    linear = modelled["linear_b"].values
    left = linear[:, 0] - linear[:, 1] + np.matvec(tensor, apart)
    return _beside(left, (DISTANCE, -tensor))


def star_camera(R_bi: np.ndarray, observed: xr.Dataset) -> np.ndarray:
    """Rotation (n, 3) rad in b from the smoothed attitude to that of the star camera.

    Parameters
    ----------
    R_bi : (n, 3, 3)
    observed : Dataset, "ingest"
    """
    turned = R_bi @ np.swapaxes(frames.R_bi_from_quaternion(observed["q"].values), 1, 2)
    pairs = ((2, 1), (0, 2), (1, 0))
    return np.stack([turned[:, i, j] - turned[:, j, i] for i, j in pairs], axis=1) / 2


def angular(about: Context, modelled: xr.Dataset, satellite: dict, elongation: float) -> np.ndarray:
    """Mean angular reading less its model by the smoothed attitude, (n, 3) rad s-2.

    Parameters
    ----------
    about : Context
    modelled : Dataset, "gradient_torque.gradient"
    satellite : test_mass, test_mass_inertia; elongation : 1, of the test masses
    """
    inertia = laws.box_inertia(satellite, elongation)
    free = laws.free_mass_angular_acceleration(inertia, about.gradient_b, about.rate_b)
    return modelled["angular_b"].values.mean(axis=1) - (free - about.rate_dot_b)


def torque(about: Context, modelled: xr.Dataset, control_hz: float, damping: float) -> np.ndarray:
    """Torque that gravity gradient and control leave, (n, 3, 1 + SHARED) N m; S-GRS paper, eq. 12 (erratum S-4).

    Parameters
    ----------
    about : Context
    modelled : Dataset, "gradient_torque.gradient"
    control_hz, damping : Hz, 1, law of the attitude control
    """
    J, control = about.inertia_b, 2 * np.pi * control_hz
    angle, angle_dot = (modelled[name].values[METHOD] for name in ("angle", "angle_dot"))
    pushed = np.matvec(J, control**2 * angle + 2 * damping * control * angle_dot)
    motion = np.matvec(J, about.rate_dot_b) + np.cross(about.rate_b, np.matvec(J, about.rate_b))
    left = motion - dynamics.gravity_gradient_torque(J, about.gradient_b) + pushed
    arm = -about.extra["mass"] * frames.cross_matrix(about.extra["non_gravitational_b"])
    return _beside(left, (PRESSURE, arm), (CONSTANT, np.eye(3)))


def _beside(left, *columns):
    """Series with the columns of some shared parameters behind it."""
    both = np.zeros((len(left), 3, 1 + SHARED))
    both[:, :, 0] = left
    for place, part in columns:
        both[:, :, 1 + place.start : 1 + place.stop] = part
    return both


def neighbours(series: np.ndarray) -> np.ndarray:
    """White noise (3,) of a series (n, 3) that changes slowly, from differences of neighbouring samples."""
    return np.sqrt(np.nanmean(np.diff(series, axis=0) ** 2, axis=0) / 2)


def means(series: np.ndarray, width: int) -> np.ndarray:
    """Means of so many neighbouring samples each, (m, ...), of those there are; NaN where there are none.

    Parameters
    ----------
    series : (n, ...)
    width : samples
    """
    whole = len(series) // width * width
    parts = series[:whole].reshape(-1, width, *series.shape[1:])
    there = np.isfinite(parts)
    count = there.sum(axis=1)
    return np.where(count > 0, np.where(there, parts, 0.0).sum(axis=1), np.nan) / np.maximum(count, 1)


def along_orbit(about: Context) -> np.ndarray:
    """Angle of the satellite along its orbit (n,) rad, from the rate about the axis that turns most.

    Parameters
    ----------
    about : Context
    """
    axis = int(np.argmax(np.abs(about.rate_b.mean(axis=0))))
    return np.cumsum(about.rate_b[:, axis] * np.diff(about.time, prepend=about.time[0]))
