"""Motion, torques and observed residuals of each manoeuvre, as discovery looks at them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import motion
from gravcal.calibrations.com_offset.attitude import slow_torque_response
from gravcal.calibrations.com_offset.motion import Window, windows
from gravcal.estimation import least_squares
from gravcal.estimation.resampling import Resampler, operator_for
from gravcal.physics import dynamics, frames


@dataclass(frozen=True)
class Scene:
    """One manoeuvre.

    Attributes
    ----------
    index : of the manoeuvre
    window : its observations and torques
    time : (n,) s, accelerometer epochs; true : (n,) s, the same less the shift of the accelerometer
    rows : indices of these epochs in the aligned product; smooth : slice of them in the attitude product
    operator : low-pass and resampling of the accelerometer
    sca_time, sca_good : (k,) s and bool, the origin in front
    transition : (k, 6, 6) of angle and rate from the origin
    own_attitude : (k, 3, p) rad, start angle, rate, slow torque and edge shift
    scale_attitude : (k, 3, 3) rad, torque scale
    shift : s, edges seen by the star camera
    """

    index: int
    window: Window
    time: np.ndarray
    true: np.ndarray
    rows: np.ndarray
    smooth: np.ndarray
    operator: Resampler
    sca_time: np.ndarray
    sca_good: np.ndarray
    transition: np.ndarray
    own_attitude: np.ndarray
    scale_attitude: np.ndarray
    shift: float

    @functools.cached_property
    def propagator(self) -> motion.Propagator:
        """Attitude after angular accelerations that jump at the edges."""
        return motion.propagator(self.sca_time, self.transition, self.window.arc.edges + self.shift)


def scenes(aligned: xr.Dataset, field: xr.Dataset, smoothed: xr.Dataset, settings: dict) -> list[Scene]:
    """Every manoeuvre that has an attitude and accelerometer samples.

    Parameters
    ----------
    aligned : Dataset, "align"
    field : Dataset, "com_offset.field"
    smoothed : Dataset, "com_offset.attitude"
    settings : inertia, dipole_per_current, dynamics, torque_degree, integration_step_s and the low-pass of the solution
    """
    full = settings["dynamics"] == "full"
    found = windows(aligned, field, settings["inertia"], np.asarray(settings["dipole_per_current"]), full)
    made = [_scene(aligned, smoothed, i, w, settings) for i, w in enumerate(found)]
    return [s for s in made if s is not None]


def offset_of(solved: xr.Dataset) -> np.ndarray:
    """Offset (3,) m of all manoeuvres together, of which the scenes are seen.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve"
    """
    normal, right = (np.nansum(solved[n].values, axis=0) for n in ("normal", "right"))
    return least_squares.stable_inverse(normal) @ right


def _scene(aligned, smoothed, index, window, settings):
    smooth = np.flatnonzero(smoothed["acc_manoeuvre"].values == index)
    shift = float(smoothed["sca_shift"].values[index])
    if smooth.size < 200 or window.rod < 0 or not np.isfinite(shift):
        return None
    late = float(np.nan_to_num(smoothed["acc_shift"].values[index] - shift))
    time = smoothed["time_acc"].values[smooth]
    rows = np.searchsorted(aligned["time_acc"].values, time)
    good = aligned["acc_flag"].values[rows] == 0
    good &= np.isfinite(aligned["linear_b"].values[rows]).all(axis=1)
    good &= np.isfinite(aligned["angular_b"].values[rows]).all(axis=1)
    first, last = window.arc.edges[[0, -1]] + shift + late
    filters = (settings["lowpass_hz"], settings["half_width_s"], settings["step_s"])
    operator = operator_for(time, good, max(first, time[0]), min(last, time[-1]), *filters)
    if operator.valid.sum() < 60:
        return None
    parts = _sensitivity(aligned, smoothed, index, window, (smooth[0], shift, settings))
    return Scene(index, window, time, time - late, rows, smooth, operator, window.time, window.good, *parts, shift)


def _sensitivity(aligned, smoothed, index, window, about):
    """Transition and columns of the attitude along a path that follows the measured one."""
    first, shift, settings = about
    quaternion = _quaternion(aligned, np.array([window.arc.origin]))[0]
    state = dynamics.State(window.arc.origin, quaternion, smoothed["rate_b"].values[first])
    degree = settings["torque_degree"]
    scale = np.nan_to_num(smoothed["torque_scale"].values[index], nan=1.0)
    path = motion.Solution(state, np.zeros((degree + 1, 3)), scale, shift)
    _, _, _, sensitivity = dynamics.integrate_with_sensitivity(
        window.time, state, motion.torque_of(window.arc, path), max_step=settings["integration_step_s"]
    )
    slow = slow_torque_response(window.arc, window.time, sensitivity[:, :, :6], degree)
    own = np.concatenate([sensitivity[:, :3, :6], slow, sensitivity[:, :3, 12:13]], axis=2)
    return sensitivity[:, :, :6], own, sensitivity[:, :3, 9:12]


def _quaternion(aligned, time):
    known = np.isfinite(aligned["quaternion"].values).all(axis=1) & (aligned["sca_flag"].values == 0)
    known_time = aligned["time_sca"].values[known]
    at = np.clip(time, known_time[0], known_time[-1])
    return frames.interpolate(known_time, aligned["quaternion"].values[known], at)


def attitude_at(scene: Scene, time: np.ndarray) -> np.ndarray:
    """Measured attitude (n, 4) at any epochs of the arc.

    Parameters
    ----------
    scene : Scene
    time : (n,) s
    """
    known = scene.window.time[1:][scene.window.good[1:]]
    quaternion = scene.window.quaternion[1:][scene.window.good[1:]]
    return frames.interpolate(known, quaternion, np.clip(time, known[0], known[-1]))


def field_at(scene: Scene, time: np.ndarray, R_bi: np.ndarray) -> np.ndarray:
    """Field in the body (n, 3) T.

    Parameters
    ----------
    scene : Scene
    time : (n,) s
    R_bi : (n, 3, 3)
    """
    arc = scene.window.arc
    inertial = np.stack([np.interp(time, arc.field_time, c) for c in arc.field_i.T], axis=1)
    return np.matvec(R_bi, inertial)


def turned(scene: Scene, basis) -> np.ndarray:
    """Attitude (k, 3, p) rad after angular accelerations `basis`, (m,) s -> (m, p, 3) rad s-2.

    Parameters
    ----------
    scene : Scene
    basis : callable
    """
    return scene.propagator(basis)
