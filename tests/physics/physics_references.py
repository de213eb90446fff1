"""Plain evaluations by public tools that gravcal.physics is compared with, in tests and in benchmarks."""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from gravcal.physics import dynamics, frames, gravity, magnetic
from gravcal.physics.constants import GM

MEASURED = Path(__file__).parents[3] / "shared" / "data"


def manoeuvre(start=0.0, phase=1.3, duration=180.0, height=6.87e6, half_period=6.0):
    """State, torque and 1 Hz epochs of a pitch manoeuvre by square wave on an invented polar orbit."""
    clock = start - 2 + np.arange(duration + 6)
    angle = (clock - start) * np.sqrt(GM / height**3)
    field = np.stack([3e-5 * np.cos(2 * angle), 1e-5 * np.sin(angle + 1), -4e-5 * np.sin(2 * angle + 0.3)], axis=-1)
    position = height * np.stack([np.cos(angle), 0.1 * np.sin(angle), np.sin(angle)], axis=-1)
    edges = start + phase - half_period + half_period * np.arange(np.ceil(duration / half_period) + 2)
    dipole = np.zeros((edges.size - 1, 3))
    dipole[:, 1], dipole[:, 0] = 27.5 * (-1.0) ** np.arange(edges.size - 1), 0.4
    inertia = np.array([[110.0, -2.0, 3.0], [-2.0, 580.0, 1.0], [3.0, 1.0, 650.0]])
    gradient = gravity.gradient_i(position)
    state = dynamics.State(start, np.array([0.5, 0.5, -0.5, 0.5]), np.array([1e-4, -1.1e-3, 2e-4]))
    torque = dynamics.Torque(inertia, edges, dipole, clock, field, gradient, constant_b=(1e-5, -2e-5, 5e-6))
    return state, torque, start + np.arange(duration + 1)


def attitude_by_scipy(time, state, torque, rtol=1e-12, atol=1e-14):
    """State and 6 x 6 state transition by scipy's DOP853, restarted at every edge: (n, 7), (n, 6, 6)."""
    from scipy.interpolate import CubicSpline

    field = CubicSpline(torque.field_time, torque.field_i)
    gradient = CubicSpline(torque.field_time, torque.gradient_i) if torque.gradient_i is not None else None
    inverse, J = np.linalg.inv(torque.inertia), torque.inertia
    y = np.concatenate([state.quaternion, state.rate_b, np.eye(6).ravel()])
    edges = torque.edges[(torque.edges > time[0]) & (torque.edges < time[-1])]
    stops = np.concatenate([[time[0]], edges, [time[-1]]])
    rows = np.empty((time.size, y.size))
    for begin, end in zip(stops[:-1], stops[1:], strict=True):
        m = torque.dipole_b[np.searchsorted(torque.edges, (begin + end) / 2, side="right") - 1]

        def slope(t, y, m=m):
            return _slope(y, m, field(t), None if gradient is None else gradient(t), J, inverse, torque)

        here = (time >= begin) & (time <= end)
        at = np.append(time[here], end)
        solution = solve_ivp(slope, (begin, end), y, "DOP853", t_eval=np.unique(at), rtol=rtol, atol=atol, max_step=2.0)
        rows[here] = solution.y.T[np.searchsorted(solution.t, time[here])]
        y = solution.y[:, -1]
    return rows[:, :7], rows[:, 7:].reshape(-1, 6, 6)


def _slope(y, m, field_i, gradient_i, J, inverse, torque):
    q, w, Phi = y[:4], y[4:7], y[7:].reshape(6, 6)
    s, v = q[0], q[1:]
    wx = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    vx = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    R = (s * s - v @ v) * np.eye(3) + 2 * np.outer(v, v) - 2 * s * vx
    B, H = R @ field_i, J @ w
    G = np.zeros((3, 3)) if gradient_i is None else R @ gradient_i @ R.T
    t = np.cross(m, B) * torque.scale_b + torque.constant_b + frames.vex(J @ G - G @ J)
    A = np.zeros((6, 6))
    A[:3, :3], A[:3, 3:] = -wx, np.eye(3)
    A[3:, 3:] = inverse @ (frames.cross_matrix(H) - wx @ J)
    by_angle = np.diag(torque.scale_b) @ frames.cross_matrix(m) @ frames.cross_matrix(B)
    for axis in range(3):
        e = frames.cross_matrix(np.eye(3)[axis])
        change = G @ e - e @ G
        by_angle[:, axis] += frames.vex(J @ change - change @ J)
    A[3:, :3] = inverse @ by_angle
    qd = 0.5 * np.concatenate([[-v @ w], s * w + np.cross(v, w)])
    return np.concatenate([qd, inverse @ (t - np.cross(w, H)), (A @ Phi).ravel()])


def field_by_chaosmagpy(time_gps, position_e, generation=14):
    """IGRF by ChaosMagPy with one epoch per point: (n, 3) T, Earth-fixed."""
    from chaosmagpy import BaseModel

    radius = np.linalg.norm(position_e, axis=-1)
    theta = np.degrees(np.arccos(position_e[:, 2] / radius))
    phi = np.degrees(np.arctan2(position_e[:, 1], position_e[:, 0]))
    model = BaseModel.from_shc(str(magnetic.coefficient_file(generation)), leap_year=True)
    mjd2000 = (np.asarray(time_gps) + 43200.0) / 86400.0
    components = model.synth_values(mjd2000, radius / 1e3, theta, phi)
    return spherical_to_cartesian(np.stack(components, axis=-1), theta, phi) * 1e-9


def spherical_to_cartesian(vector, theta_deg, phi_deg):
    """Components up, south, east to Earth-fixed ones."""
    t, p = np.radians(theta_deg), np.radians(phi_deg)
    up = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    south = np.stack([np.cos(t) * np.cos(p), np.cos(t) * np.sin(p), -np.sin(t)], axis=-1)
    east = np.stack([-np.sin(p), np.cos(p), 0 * p], axis=-1)
    return vector[..., :1] * up + vector[..., 1:2] * south + vector[..., 2:] * east
