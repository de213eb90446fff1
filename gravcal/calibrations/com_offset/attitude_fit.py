"""Batch least squares of the attitude on the star camera, and the waveform that the star camera alone sees."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gravcal.calibrations.com_offset.motion import Arc, Solution, propagator, torque_of, updated
from gravcal.estimation.least_squares import covariance
from gravcal.estimation.noise import NoiseModel, whiten
from gravcal.physics import dynamics, frames

INERTIA_STEP = 1e-4  # relative, of the differences by the principal moments


@dataclass(frozen=True)
class Choice:
    """What is estimated beside the start attitude and rate.

    Attributes
    ----------
    torque_degree : degree of a slowly varying torque, -1 for none
    scale_sigma : prior of the torque scale per axis; 0 holds it at the catalogue
    inertia_sigma : relative prior of the principal moments; 0 holds them at the catalogue
    shift_sigma : s, prior of the common edge shift; 0 holds it
    step_s : s, longest integration step
    iterations : at most
    """

    torque_degree: int
    scale_sigma: float
    inertia_sigma: float
    shift_sigma: float
    step_s: float
    iterations: int


@dataclass(frozen=True)
class Fit:
    """Result of one arc.

    Attributes
    ----------
    solution : Solution
    residual : (n, 3) rad, star camera minus model, in the body
    design : (n, 3, p) rad, columns of the last step
    covariance : (p, p) of the unknowns `names`
    names : (p,)
    """

    solution: Solution
    residual: np.ndarray
    design: np.ndarray
    covariance: np.ndarray
    names: tuple[str, ...]


def names_of(choice: Choice) -> tuple[str, ...]:
    """Names of the unknowns in the order of the columns."""
    groups = ["angle", "rate", *(f"torque{k}" for k in range(choice.torque_degree + 1))]
    groups += ["scale"] if choice.scale_sigma > 0 else []
    groups += ["inertia"] if choice.inertia_sigma > 0 else []
    names = [f"{group}_{axis}" for group in groups for axis in "xyz"]
    return (*names, *(["shift"] if choice.shift_sigma > 0 else []))


def first_guess(arc: Arc, time: np.ndarray, quaternion: np.ndarray, degree: int) -> Solution:
    """State at the origin from a quadratic through the first measured attitudes."""
    near = slice(0, min(7, time.size))
    reference = quaternion[near][0]
    angle = frames.rotation_vector(frames.quaternion_product(frames.conjugate(reference), quaternion[near]))
    order = min(2, time[near].size - 1)
    fit = np.polynomial.polynomial.polyfit(time[near] - arc.origin, angle, order)
    start = frames.quaternion_product(reference, frames.from_rotation_vector(fit[0]))
    state = dynamics.State(arc.origin, start / np.linalg.norm(start), fit[1] if order else np.zeros(3))
    return Solution(state, np.zeros((degree + 1, 3)), np.ones(3), 0.0)


def fit_attitude(
    arc: Arc, time, quaternion, good, noise: list[NoiseModel], choice: Choice, start: Solution | None = None
) -> Fit:
    """Gauss-Newton on the three-parameter attitude error (CoM paper eqs. 19-30, errata C-5, C-6).

    Parameters
    ----------
    arc : Arc
    time : (n,) s, evenly spaced grid from the origin on
    quaternion : (n, 4) measured, continuous in sign
    good : (n,) bool
    noise : noise model of each axis
    choice : Choice
    start : solution to begin with; from the first attitudes if None

    Returns
    -------
    fit : Fit
    """
    solution = start or first_guess(arc, time[good], quaternion[good], choice.torque_degree)
    prior = _prior(choice)
    previous, slow = np.inf, None
    for _ in range(max(choice.iterations, 1)):
        residual, design, slow = _linearised(arc, solution, time, quaternion, choice, slow)
        y, A = _whitened(residual, design, good, noise)
        away = _deviation(solution, choice)
        normal = A.T @ A + np.diag(prior)
        right = A.T @ y - prior * away
        scale = np.sqrt(np.diag(normal))
        step = np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=1e-14)[0] / scale
        cost = float(y @ y + prior @ away**2)
        if abs(previous - cost) <= 1e-6 * max(cost, 1.0):
            break
        previous = cost
        solution = updated(solution, _unpacked(step, choice))
    return Fit(solution, residual, design, covariance(normal), names_of(choice))


def _linearised(arc, solution, time, quaternion, choice, slow):
    """Residual angles, their derivatives by the unknowns, and those by the slow torque, which stay as they are."""
    modelled, _, _, sensitivity = dynamics.integrate_with_sensitivity(
        time, solution.state, torque_of(arc, solution), max_step=choice.step_s
    )
    residual = frames.rotation_vector(frames.quaternion_product(frames.conjugate(modelled), quaternion))
    columns = [sensitivity[:, :3, :6]]
    if choice.torque_degree >= 0:
        if slow is None:
            slow = slow_torque_response(arc, time, sensitivity[:, :, :6], choice.torque_degree)
        columns.append(slow)
    if choice.scale_sigma > 0:
        columns.append(sensitivity[:, :3, 9:12])
    if choice.inertia_sigma > 0:
        columns.append(_inertia_response(arc, solution, time, modelled, choice.step_s))
    if choice.shift_sigma > 0:
        columns.append(sensitivity[:, :3, 12:13])
    return residual, np.concatenate(columns, axis=2), slow


def _inertia_response(arc, solution, time, modelled, step_s):
    """Derivative of the attitude by each principal moment, relative, (n, 3, 3) rad, by one-sided differences."""
    columns = []
    for axis in range(3):
        scale = solution.inertia_scale.copy()
        scale[axis] += INERTIA_STEP
        changed = replace(solution, inertia_scale=scale)
        moved, _, _ = dynamics.integrate(time, changed.state, torque_of(arc, changed), max_step=step_s)
        columns.append(frames.rotation_vector(frames.quaternion_product(frames.conjugate(modelled), moved)))
    return np.stack(columns, axis=2) / INERTIA_STEP


def slow_torque_response(arc: Arc, time, transition, degree: int) -> np.ndarray:
    """Response (n, 3, 3 (degree + 1)) rad to Legendre torques of 1 N m, degree by degree, axis by axis."""
    inverse = np.linalg.inv(arc.inertia)

    def basis(at):
        u = (2 * at - arc.origin - arc.stop) / (arc.stop - arc.origin)
        shape = np.polynomial.legendre.legvander(u, degree)
        return np.einsum("mk,ca->mkac", shape, inverse).reshape(at.size, -1, 3)

    return propagator(time, transition, np.zeros(0))(basis)


def _whitened(residual, design, good, noise):
    stacked = np.concatenate([residual[:, :, None], design], axis=2)
    rows = [whiten(noise[axis], stacked[:, axis], good) for axis in range(3)]
    rows = np.concatenate(rows)
    return rows[:, 0], rows[:, 1:]


def _prior(choice):
    """Inverse variance of each unknown; the slow torque has a loose one that keeps the sum solvable."""
    loose = 1e-3  # N m, above any torque of the environment
    count = 3 * (choice.torque_degree + 1)
    weights = [np.zeros(6), np.full(count, loose**-2.0)]
    weights += [np.full(3, choice.scale_sigma**-2.0)] if choice.scale_sigma > 0 else []
    weights += [np.full(3, choice.inertia_sigma**-2.0)] if choice.inertia_sigma > 0 else []
    weights += [np.full(1, choice.shift_sigma**-2.0)] if choice.shift_sigma > 0 else []
    return np.concatenate(weights)


def _deviation(solution, choice):
    """Present distance of each unknown from its prior mean."""
    parts = [np.zeros(6), solution.torque_coefficients.ravel()]
    parts += [solution.scale_b - 1] if choice.scale_sigma > 0 else []
    parts += [solution.inertia_scale - 1] if choice.inertia_sigma > 0 else []
    parts += [np.array([solution.shift])] if choice.shift_sigma > 0 else []
    return np.concatenate(parts)


def _unpacked(step, choice):
    """Parts of a step by name, zero for what is held."""
    count = 3 * (choice.torque_degree + 1)
    parts, rest = (
        {"angle": step[:3], "rate": step[3:6], "torque": step[6 : 6 + count].reshape(-1, 3)},
        step[6 + count :],
    )
    for name, estimated in (("scale", choice.scale_sigma > 0), ("inertia", choice.inertia_sigma > 0)):
        parts[name], rest = (rest[:3], rest[3:]) if estimated else (np.zeros(3), rest)
    return parts | {"shift": float(rest[0]) if choice.shift_sigma > 0 else 0.0}
