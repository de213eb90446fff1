"""Angular scale factors and tracker delay from a swing, with noise in voltages and attitude both accounted for.

Measured minus predicted attitude is r = n_t - A (beta n_V): tracker noise and twice-integrated voltage noise. The
maximum-likelihood estimate of an errors-in-variables problem with known noise minimises r' C(beta)^-1 r. Its score is
that of least squares whose regressor is the twice-integrated voltage with the estimated noise n_V taken out, so the
fit iterates: residual, estimated voltage noise, cleaned regressor, step. Nothing is attenuated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from gravcal.calibrations.inertial_sensor import swing_model as model
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares


@dataclass(frozen=True)
class Fit:
    """Solution of a swing.

    Attributes
    ----------
    unknowns : values; covariance : (p, p) in the order of the columns; chi2, dof
    motion : Prediction; voltage_noise : (b, 3) V, estimated error of the angular readouts per bin
    residual : (b, 3) rad; count : (b,) tracker samples
    observed : (r,) and design (r, p), whitened rows in order of time, about the solution, for the recursive filter
    """

    unknowns: model.Unknowns
    covariance: np.ndarray
    chi2: float
    dof: int
    motion: model.Prediction
    voltage_noise: np.ndarray
    residual: np.ndarray
    count: np.ndarray
    observed: np.ndarray
    design: np.ndarray


def fit(swing: model.Swing, first: np.ndarray, iterations: int = 12) -> Fit:
    """Maximum-likelihood factors, delay and start values.

    Parameters
    ----------
    swing : Swing
    first : (f,) rad s-2 V-1, factors to start from
    iterations : limit of the steps

    Raises
    ------
    EstimationError : no convergence
    """
    unknowns, motion = _begin(swing, first)
    shares = None
    for number in range(iterations):
        motion = model.predict(swing, unknowns, motion)
        if shares is None or number == 3:
            shares = model.noise_map(swing, motion)
        system = _system(swing, unknowns, motion, shares, cleaned=number > 1)
        value, covariance = _step(system)
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        size = np.max(np.abs(value) / sigma) if np.all(sigma > 0) and np.isfinite(value).all() else np.inf
        if size == np.inf or np.abs(value[swing.factors + 1 :]).max() > 1.0:  # rad, rad s-1: no swing any more
            break
        if number > 3 and size < 1e-3:
            return _result(swing, unknowns, motion, system, (value, covariance))
        unknowns = unknowns.moved(value)
    raise EstimationError(
        f"swing from {swing.time[0]:.1f} s: the fit still moves by {size:.1e} standard deviations after {number + 1} "
        "steps, expected 1e-3. Check that voltages and attitude belong together, or start from other factors.",
        size=float(size),
    )


def _begin(swing, first):
    """Start values: rates by differencing the tracker over five seconds."""
    from gravcal.physics import frames

    near = np.abs(swing.time_att - swing.time[0] - 2.5) <= 2.5
    angle = frames.attitude_error(swing.quaternion[near], swing.quaternion[near][:1])
    slope = np.polyfit(swing.time_att[near] - swing.time_att[near][0], angle, 1)[0]
    at = np.clip(swing.time, swing.time_att[0], swing.time_att[-1])
    attitude = frames.interpolate(swing.time_att, swing.quaternion, at)
    rate = np.broadcast_to(slope, (swing.time.size, 3))
    constant = -np.asarray(first)[list(swing.owner)] * swing.angular_volt.mean(axis=0)
    unknowns = model.Unknowns(np.asarray(first, dtype=float), 0.0, attitude[0], slope, constant, np.zeros(3))
    return unknowns, model.Prediction(attitude, rate, np.zeros_like(rate))


@dataclass(frozen=True)
class _System:
    residual: np.ndarray
    design: np.ndarray
    lower: np.ndarray
    valid: np.ndarray
    count: np.ndarray
    noise: np.ndarray


def _system(swing, unknowns, motion, shares, cleaned):
    """Residual, design with cleaned regressors and the Cholesky factor of the covariance."""
    residual, columns, count = model.residual_and_columns(swing, unknowns, motion)
    valid = np.repeat(count > 0, 3)
    r, design = residual.reshape(-1)[valid], columns.reshape(valid.size, -1)[valid]
    beta = unknowns.factors[list(swing.owner)]
    tracker = np.tile(swing.tracker_variance, count.size)[valid] / np.repeat(count, 3)[valid]
    maps = shares[:, valid]
    covariance = np.diag(tracker)
    for axis in range(3):
        covariance += beta[axis] ** 2 * swing.voltage_variance[axis] * (maps[axis] @ maps[axis].T)
    lower = np.linalg.cholesky(covariance)
    noise = np.zeros((count.size, 3))
    if cleaned:
        weighted = cho_solve((lower, True), r)
        noise = -(np.einsum("jrb,r->bj", maps, weighted) * beta * swing.voltage_variance)
        for axis, owner in enumerate(swing.owner):
            design[:, owner] -= maps[axis] @ noise[:, axis]
    return _System(r, design, lower, valid, count, noise)


def _step(system):
    """Gauss-Newton step and covariance."""
    design = solve_triangular(system.lower, system.design, lower=True)
    observed = solve_triangular(system.lower, system.residual, lower=True)
    covariance = least_squares.stable_inverse(design.T @ design)
    return covariance @ (design.T @ observed), covariance


def _result(swing, unknowns, motion, system, solved):
    """Fit record at the solution of the last linear system, which the recursive filter solves too."""
    design = solve_triangular(system.lower, system.design, lower=True)
    white = solve_triangular(system.lower, system.residual, lower=True)
    residual = np.full(system.valid.size, np.nan)
    residual[system.valid] = system.residual
    dof = white.size - design.shape[1]
    shape = (system.count.size, 3)
    value, covariance = solved
    return Fit(
        unknowns.moved(value),
        covariance,
        float(white @ white),
        dof,
        motion,
        system.noise,
        residual.reshape(shape),
        system.count,
        white + design[:, : swing.factors + 1] @ np.append(unknowns.factors, unknowns.delay),
        design,
    )
