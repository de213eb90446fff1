"""Attitude relative to the orbit frame: three small angles, their kinematics, and the frame itself."""

import numpy as np
from scipy.interpolate import CubicSpline

from gravcal.physics import frames, kinematics
from gravcal.physics.frames import R_bi_from_quaternion

NODE_STEP = 10.0  # s; 1e-2 rad of orbit, a polynomial of degree six over seven nodes is exact to rounding


def orbit_frame(position_i, velocity_i):
    """Rotation to the orbit frame: z to nadir, y against the orbit normal, x forward.

    Parameters
    ----------
    position_i : (n, 3) m
    velocity_i : (n, 3) m s-1

    Returns
    -------
    R_oi : (n, 3, 3)
    """
    z = -position_i / np.linalg.norm(position_i, axis=1, keepdims=True)
    y = np.cross(velocity_i, position_i)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=1)


def orbit_rates(time, position_i, velocity_i):
    """Rate of the orbit frame and its derivative, from the orbit alone.

    Parameters
    ----------
    time : (n,) s, gaps allowed
    position_i : (n, 3) m
    velocity_i : (n, 3) m s-1

    Returns
    -------
    rate_o : (n, 3) rad s-1, of o with respect to i
    rate_dot_o : (n, 3) rad s-2
    """
    from scipy.interpolate import CubicHermiteSpline

    kept = np.unique(
        np.append(np.arange(0, time.size, max(1, int(NODE_STEP / np.median(np.diff(time))))), time.size - 1)
    )
    path = CubicHermiteSpline(time[kept] - time[0], position_i[kept], velocity_i[kept])
    speed = CubicSpline(time[kept] - time[0], velocity_i[kept])
    nodes = np.linspace(0, time[-1] - time[0], max(8, int(np.ceil((time[-1] - time[0]) / NODE_STEP)) + 1))
    q = frames.quaternion_from_R_bi(orbit_frame(path(nodes), speed(nodes)))
    rates = kinematics.rates_from_attitude(nodes, frames.continuous(q), half_width=3, degree=6)
    return tuple(CubicSpline(nodes, r)(time - time[0]) for r in rates)


def angles(quaternion, R_oi):
    """Angles from the orbit frame to the body, R_bo = R1(x) R2(y) R3(z).

    Parameters
    ----------
    quaternion : (n, 4) scalar first, b to i
    R_oi : (n, 3, 3)

    Returns
    -------
    angle : (n, 3) rad, roll, pitch, yaw
    """
    R = R_bi_from_quaternion(quaternion) @ np.swapaxes(R_oi, -1, -2)
    return np.stack(
        [
            np.arctan2(R[:, 1, 2], R[:, 2, 2]),
            -np.arcsin(np.clip(R[:, 0, 2], -1, 1)),
            np.arctan2(R[:, 0, 1], R[:, 0, 0]),
        ],
        axis=1,
    )


def R_bo(angle):
    """Rotation from orbit to body components.

    Parameters
    ----------
    angle : (n, 3) rad

    Returns
    -------
    R_bo : (n, 3, 3)
    """
    (cx, cy, cz), (sx, sy, sz) = np.cos(angle.T), np.sin(angle.T)
    return np.moveaxis(
        np.array(
            [
                [cy * cz, cy * sz, -sy],
                [sx * sy * cz - cx * sz, sx * sy * sz + cx * cz, sx * cy],
                [cx * sy * cz + sx * sz, cx * sy * sz - sx * cz, cx * cy],
            ]
        ),
        -1,
        0,
    )


def axes(angle):
    """Axes about which the three angles turn, in b: columns of the matrix from angle rates to relative rate.

    Parameters
    ----------
    angle : (n, 3) rad

    Returns
    -------
    axes_b : (n, 3, 3)
    """
    cx, sx, cy, sy = np.cos(angle[:, 0]), np.sin(angle[:, 0]), np.cos(angle[:, 1]), np.sin(angle[:, 1])
    one, nought = np.ones_like(cx), np.zeros_like(cx)
    rows = [[one, nought, -sy], [nought, cx, sx * cy], [nought, -sx, cx * cy]]
    return np.moveaxis(np.array(rows), -1, 0)


def body_rates(angle, angle_dot, angle_ddot, rates_o):
    """Rate and angular acceleration of the body with respect to inertial space.

    Parameters
    ----------
    angle, angle_dot, angle_ddot : (n, 3) rad, rad s-1, rad s-2
    rates_o : (rate_o, rate_dot_o), each (n, 3), of the orbit frame

    Returns
    -------
    rate_b : (n, 3) rad s-1
    rate_dot_b : (n, 3) rad s-2

    Notes
    -----
    w = E phi' + R_bo w_o; w' = E phi'' + E' phi' - (E phi') x (R_bo w_o) + R_bo w_o'.
    """
    E, R = axes(angle), R_bo(angle)
    carried = np.matvec(R, rates_o[0])
    relative = np.matvec(E, angle_dot)
    first = np.zeros_like(angle)
    first[:, 0] = angle_dot[:, 0]
    second = first + E[:, :, 1] * angle_dot[:, 1:2]
    turning = -np.cross(first, E[:, :, 1]) * angle_dot[:, 1:2] - np.cross(second, E[:, :, 2]) * angle_dot[:, 2:3]
    rate_dot = np.matvec(E, angle_ddot) + turning - np.cross(relative, carried) + np.matvec(R, rates_o[1])
    return relative + carried, rate_dot
