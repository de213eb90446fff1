"""Attitude over time from star camera and angular accelerations together: angles, rates and their covariance."""

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.gradient_torque import pointing, spline
from gravcal.errors import EstimationError
from gravcal.physics.frames import cross_matrix

ITERATIONS = 3  # Gauss-Newton; angles of 1e-2 rad make the second one exact to 1e-4 of the first
ANGLE_PRIOR = 0.1  # rad, keeps splines in gaps from floating away; 1e-10 of the weight of data


@dataclass(frozen=True)
class Frame:
    """Orbit frame at the epochs.

    R_oi : (n, 3, 3)
    rates_o : (rate_o, rate_dot_o), each (n, 3) rad s-1, rad s-2
    """

    R_oi: np.ndarray
    rates_o: tuple


@dataclass(frozen=True)
class Measured:
    """What is seen of the attitude.

    time : (n,) s
    quaternion : (n, 4), NaN where not usable
    angular_b : (n, 3) rad s-2, test mass relative to satellite, NaN where not usable
    angle_sigma : (3,) rad, of each attitude
    angular_sigma : (n, 3) rad s-2, of each sample
    """

    time: np.ndarray
    quaternion: np.ndarray
    angular_b: np.ndarray
    angle_sigma: np.ndarray
    angular_sigma: np.ndarray


@dataclass(frozen=True)
class Attitude:
    """Smoothed attitude.

    angle, angle_dot : (n, 3) rad, rad s-1, from the orbit frame
    R_bi : (n, 3, 3)
    rate_b, rate_dot_b : (n, 3) rad s-1, rad s-2
    operators : derivative of (small rotation in b, rate_b, rate_dot_b) by the angles and their first and second
        derivatives, each (n, 3, 3, 3)
    table : splines
    covariance : blocks of the covariance of the splines
    chi2, dof : of star camera and angular accelerations together
    """

    angle: np.ndarray
    angle_dot: np.ndarray
    R_bi: np.ndarray
    rate_b: np.ndarray
    rate_dot_b: np.ndarray
    operators: tuple
    table: spline.Basis
    covariance: tuple
    chi2: float
    dof: int


def smooth(measured, frame, knot_step, free_test_mass):
    """Least squares for the angles as splines, from attitudes and angular accelerations.

    Parameters
    ----------
    measured : Measured
    frame : Frame
    knot_step : s, distance of the knots of splines of degree five
    free_test_mass : callable, (R_bi, rate_b) -> (n, 3) rad s-2, angular acceleration of the free test mass

    Returns
    -------
    attitude : Attitude

    Notes
    -----
    al_TM/B = al_TM - w_B'; equations.md, section 8.5. The rates come out consistent with the attitude.
    """
    table = spline.basis(measured.time, knot_step)
    seen = pointing.angles(_filled(measured.quaternion), frame.R_oi)
    coefficients = np.zeros((table.count, 3))
    for _ in range(ITERATIONS):
        state = _state(table, coefficients, frame)
        residuals = _residuals(measured, seen, state, free_test_mass)
        operators = _operators(state, frame)
        blocks = _weighted(measured, operators, residuals)
        band, right = spline.normal(blocks, table)
        band[0] += 1 / ANGLE_PRIOR**2
        step = spline.solve(band, right - coefficients.ravel() / ANGLE_PRIOR**2)
        coefficients = coefficients + step.reshape(-1, 3)
    state = _state(table, coefficients, frame)
    blocks = _weighted(measured, operators, _residuals(measured, seen, state, free_test_mass))
    chi2, dof = _adequacy(blocks, table.count)
    return Attitude(*state[:2], *state[3:], operators, table, spline.band_covariance(band), chi2, dof)


def _filled(quaternion):
    """Unit quaternions, the identity where not usable."""
    good = np.isfinite(quaternion).all(axis=1)
    if good.sum() < 10:
        raise EstimationError(
            f"star camera: found {good.sum()} usable attitudes, expected at least 10. Check the file."
        )
    unit = np.where(good[:, None], quaternion, [1.0, 0, 0, 0])
    return unit / np.linalg.norm(unit, axis=1, keepdims=True)


def _state(table, coefficients, frame):
    """Angles, their rates, R_bi, rate and angular acceleration of the body."""
    active = coefficients[table.start[:, None] + np.arange(spline.ACTIVE)]
    angle, dot, ddot = (np.einsum("nk,nki->ni", part, active) for part in (table.value, table.first, table.second))
    rate, rate_dot = pointing.body_rates(angle, dot, ddot, frame.rates_o)
    return angle, dot, ddot, pointing.R_bo(angle) @ frame.R_oi, rate, rate_dot


def _residuals(measured, seen, state, free_test_mass):
    """Angles and angular accelerations, measured minus modelled, zero where not usable."""
    difference = seen - state[0]
    difference = (difference + np.pi) % (2 * np.pi) - np.pi
    difference[~np.isfinite(measured.quaternion).all(axis=1)] = np.nan
    return difference, measured.angular_b - (free_test_mass(state[3], state[4]) - state[5])


def _operators(state, frame):
    """Derivative of small rotation, rate and angular acceleration by the angles and their derivatives."""
    E, R = pointing.axes(state[0]), pointing.R_bo(state[0])
    w, wd = (cross_matrix(np.matvec(R, part)) @ E for part in frame.rates_o)
    nought = np.zeros_like(E)
    parts = ((E, nought, nought), (w, E, nought), (wd, w, E))
    return tuple(np.stack(part, axis=1) for part in parts)


def _weighted(measured, operators, residuals):
    """Observation blocks over their standard deviations, zero where not usable."""
    by_angle = np.zeros_like(operators[0])
    by_angle[:, 0] = np.eye(3)
    sigmas = (measured.angle_sigma, measured.angular_sigma)
    blocks = []
    for operator, residual, sigma in zip((by_angle, -operators[2]), residuals, sigmas, strict=True):
        weight = np.where(np.isfinite(residual), 1 / np.broadcast_to(sigma, residual.shape), 0.0)
        blocks.append((operator * weight[:, None, :, None], np.nan_to_num(residual) * weight))
    return blocks


def _adequacy(blocks, splines):
    """Chi-square of all observations and its degrees of freedom."""
    chi2 = sum(float(np.sum(residual**2)) for _, residual in blocks)
    count = sum(int(np.count_nonzero(np.any(operator != 0, axis=(1, 3)))) for operator, _ in blocks)
    return chi2, count - 3 * splines
