"""Plain evaluations by public tools that gravcal.physics is compared with, in tests and in benchmarks."""

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from gravcal.physics import dynamics, gravity, magnetic
from gravcal.physics.constants import EARTH_RADIUS, GM, J2

MEASURED = Path(__file__).parents[3] / "shared" / "data"


def level1(name, columns, folder="gracefo-2023-06-01"):
    """Columns of a measured GRACE-FO RL04 ASCII file."""
    text = (MEASURED / folder / name).read_text().split("# End of YAML header\n")[1]
    return np.array([[float(row.split()[c]) for c in columns] for row in text.splitlines()])


def random_field(degree, seed=0):
    """Gravity field by Kaula's rule, with the flattening of the Earth."""
    rng = np.random.default_rng(seed)
    n, m = np.arange(degree + 1)[:, None], np.arange(degree + 1)[None, :]
    size = np.where((m <= n) & (n >= 2), 1e-5 / np.maximum(n, 1) ** 2, 0.0)
    cosine, sine = size * rng.standard_normal(size.shape), size * rng.standard_normal(size.shape)
    cosine[0, 0], cosine[2, 0], sine[:, 0] = 1.0, -J2 / np.sqrt(5), 0.0
    return gravity.Field(GM, EARTH_RADIUS, cosine, sine)


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
    return state, dynamics.Torque(inertia, edges, dipole, clock, field, gradient), start + np.arange(duration + 1)


def attitude_by_scipy(time, state, torque, rtol=1e-12, atol=1e-14):
    """State and 6 x 6 state transition by scipy's DOP853, restarted at every edge: (n, 7), (n, 6, 6)."""
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
        solution = solve_ivp(slope, (begin, end), y, "DOP853", t_eval=np.unique(at), rtol=rtol, atol=atol)
        rows[here] = solution.y.T[np.searchsorted(solution.t, time[here])]
        y = solution.y[:, -1]
    return rows[:, :7], rows[:, 7:].reshape(-1, 6, 6)


def _cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _gravity(J, G):
    S = J @ G - G @ J
    return np.array([S[2, 1], S[0, 2], S[1, 0]])


UNIT = [_cross(e) for e in np.eye(3)]


def _slope(y, m, field_i, gradient_i, J, inverse, torque):
    """Kinematics, Euler's equation and the 6 x 6 transition, in plain numpy."""
    s, v, w, Phi = y[0], y[1:4], y[4:7], y[7:].reshape(6, 6)
    wx, mx = _cross(w), _cross(m)
    R = (s * s - v @ v) * np.eye(3) + 2 * np.outer(v, v) - 2 * s * _cross(v)
    Bx, H = _cross(R @ field_i), J @ w
    t = torque.scale_b * (mx @ R @ field_i) - wx @ H
    A = np.zeros((6, 6))
    A[:3, :3], A[:3, 3:] = -wx, np.eye(3)
    by_angle = np.asarray(torque.scale_b)[:, None] * (mx @ Bx)
    if gradient_i is not None:
        G = R @ gradient_i @ R.T
        t = t + _gravity(J, G)
        by_angle += np.stack([_gravity(J, G @ e - e @ G) for e in UNIT], axis=1)
    A[3:, :3], A[3:, 3:] = inverse @ by_angle, inverse @ (_cross(H) - wx @ J)
    qd = 0.5 * np.concatenate([[-v @ w], s * w + _cross(v) @ w])
    return np.concatenate([qd, inverse @ t, (A @ Phi).ravel()])


def field_by_chaosmagpy(time_gps, position_e, generation=14):
    """IGRF by ChaosMagPy with one epoch per point: (n, 3) T, Earth-fixed.

    It interpolates in days, the model in years: the epochs handed over are at the same fraction of the interval.
    """
    from chaosmagpy.chaos import BaseModel

    radius = np.linalg.norm(position_e, axis=-1)
    theta = np.degrees(np.arccos(position_e[:, 2] / radius))
    phi = np.degrees(np.arctan2(position_e[:, 1], position_e[:, 0]))
    model = BaseModel.from_shc(str(magnetic.coefficient_file(generation)), leap_year=True)
    epochs = magnetic.gauss_coefficients(generation)[0]
    starts = np.array([np.datetime64(f"{year:.0f}", "D") for year in epochs]) - np.datetime64("2000-01-01")
    mjd2000 = np.interp(magnetic.decimal_year(time_gps), epochs, starts.astype(float))
    components = model.synth_values(mjd2000, radius / 1e3, theta, phi)
    return spherical_to_cartesian(np.stack(components, axis=-1), theta, phi) * 1e-9


def spherical_to_cartesian(vector, theta_deg, phi_deg):
    """Components up, south, east to Earth-fixed ones."""
    t, p = np.radians(theta_deg), np.radians(phi_deg)
    up = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    south = np.stack([np.cos(t) * np.cos(p), np.cos(t) * np.sin(p), -np.sin(t)], axis=-1)
    east = np.stack([-np.sin(p), np.cos(p), 0 * p], axis=-1)
    return vector[..., :1] * up + vector[..., 1:2] * south + vector[..., 2:] * east
