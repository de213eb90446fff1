"""Angular acceleration from the star camera alone: shape from the edges of the current, size from the attitude."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.com_offset import attitude_fit, motion
from gravcal.estimation.least_squares import stable_inverse
from gravcal.estimation.noise import whiten
from gravcal.physics import dynamics


def shape(arc: motion.Arc, rod: int, shift: float, time: np.ndarray, width: float) -> np.ndarray:
    """Sign of the wave times (1, u), u from -1 to 1 over the arc, (n, 2)."""
    amplitude = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    sign = motion.mean_dipole(arc, time, shift, width)[:, rod] / (amplitude or 1.0)
    u = (2 * time - arc.origin - arc.stop) / (arc.stop - arc.origin)
    return np.stack([sign, sign * u], axis=1)


def fit_star_camera_wave(window, fit, noise, rod: int, degree: int):
    """Amplitudes of the wave about each body axis from the star camera, nothing of the torquer's strength used.

    Start attitude, rate and a slow torque are estimated along; the timing is that of the attitude fit.

    Parameters
    ----------
    window : Window
    fit : Fit, whose motion is the reference
    noise : noise model of each axis
    rod : excited torquer
    degree : of the slow torque

    Returns
    -------
    amplitude : (2, 3) rad s-2, coefficients of `shape` about each axis
    root : (6, 6) with root root^T the covariance, ordered (shape, axis)
    """
    arc, shift = window.arc, fit.solution.shift
    _, _, _, sensitivity = dynamics.integrate_with_sensitivity(
        window.time, fit.solution.state, motion.torque_of(arc, fit.solution), max_step=1.0
    )
    transition = sensitivity[:, :, :6]

    def basis(at):
        parts = shape(arc, rod, shift, at, 1e-6)
        return np.einsum("mk,ca->mkac", parts, np.eye(3)).reshape(at.size, 6, 3)

    columns = [transition[:, :3, :6], motion.propagator(window.time, transition, arc.edges + shift)(basis)]
    if degree >= 0:
        columns.insert(1, attitude_fit.slow_torque_response(arc, window.time, transition, degree))
    design = np.concatenate(columns, axis=2)
    removed = design[:, :, -6:] @ _modelled(arc, fit, rod)
    observed = fit.residual + removed
    rows = [
        whiten(noise[a], np.concatenate([observed[:, a, None], design[:, a]], axis=1), window.good) for a in range(3)
    ]
    rows = np.concatenate(rows)
    inverse = stable_inverse(rows[:, 1:].T @ rows[:, 1:])
    unknown = inverse @ rows[:, 1:].T @ rows[:, 0]
    size, vectors = np.linalg.eigh(inverse[-6:, -6:])
    return unknown[-6:].reshape(2, 3), vectors * np.sqrt(np.clip(size, 0, None))


def _modelled(arc, fit, rod):
    """Amplitudes that the fitted torque model already put into the reference motion, projected on the shape."""
    from scipy.interpolate import CubicSpline

    from gravcal.physics import frames

    time = np.linspace(arc.origin, arc.stop, 361)[1:-1]
    quaternion, _, _ = dynamics.integrate(time, fit.solution.state, motion.torque_of(arc, fit.solution), max_step=1.0)
    field_b = np.matvec(frames.R_bi_from_quaternion(quaternion), CubicSpline(arc.field_time, arc.field_i)(time))
    unit = np.zeros(3)
    unit[rod] = np.abs(arc.dipole_b[:, rod]).max(initial=0.0)
    torque = fit.solution.scale_b * np.cross(unit, field_b)
    u = (2 * time - arc.origin - arc.stop) / (arc.stop - arc.origin)
    constant_linear = np.linalg.lstsq(np.stack([np.ones_like(u), u], axis=1), torque, rcond=None)[0]
    return np.linalg.solve(arc.inertia, constant_linear.T).T.ravel()
