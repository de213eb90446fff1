"""Gain and delay of the firings by least squares, inflation of their variance by firings at wrong times, and checks."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations import checks, named_parameters
from gravcal.calibrations.checks import at_least, at_most
from gravcal.calibrations.schemas import build
from gravcal.calibrations.thrusters import model
from gravcal.calibrations.thrusters.model import SCHEMAS, Firings, Noise, Segment
from gravcal.effects import effect
from gravcal.estimation import least_squares

NAMES = ("gain_x", "gain_y", "gain_z", "delay")
UNITS = ("1", "1", "1", "s")
#: Times by which all firings are moved; multiples of a time that no period of control or orbit shares.
SHIFTS_S = tuple(k * 97.0 for k in range(-10, 11) if k)
ITERATIONS = 3  # of the delay, which is not linear


@dataclass(frozen=True)
class Rows:
    """Whitened rows of one block."""

    segment: Segment
    noise: Noise
    observed: np.ndarray  #: (n,) 1, attitude
    smooth: np.ndarray  #: (n, k) 1, columns of the smooth torque about each axis
    basis: np.ndarray  #: (n, r) orthonormal basis of the smooth torque

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Whitened rows (n, q) of columns (epochs, 3, q) rad."""
        return self.noise.rows(self.segment, columns)

    def less(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n,) or (n, q) with the smooth torque projected out."""
        return rows - self.basis @ (self.basis.T @ rows)


def rows_of(camera: model.Camera, noise: Noise, inertia_b, *, block_s: float, knot_s: float) -> list[Rows]:
    """Whitened rows of every block of block_s; epochs of a camera whose noise is not known are left out."""
    usable, blocks = camera.part(np.isin(camera.head, list(noise.factor))), []
    for segment in model.segments(usable, inertia_b, block_s=block_s, knot_s=knot_s):
        smooth = np.einsum("nk,ac->nakc", segment.smooth, np.eye(3)).reshape(segment.place.size, 3, -1)
        rows = noise.rows(segment, np.concatenate([segment.angle_b[..., None], smooth], axis=2))
        nonzero = rows[:, 1:][:, np.any(rows[:, 1:] != 0, axis=0)]
        blocks.append(Rows(segment, noise, rows[:, 0], rows[:, 1:], np.linalg.qr(nonzero)[0]))
    return blocks


def gains_alone(parts: list[Rows], firings: Firings) -> np.ndarray:
    """Gain (3,) of the impulses about each axis by least squares, beside the smooth torque alone."""
    columns = [part.less(part.whiten(part.segment.gains(firings))) for part in parts]
    normal = sum(c.T @ c for c in columns)
    return least_squares.stable_inverse(normal) @ sum(c.T @ p.observed for c, p in zip(columns, parts, strict=True))


def joint_fit(rows: list[Rows], firings: Firings, heads: list[int]) -> tuple:
    """(value (q,), delay s, columns by block, information, right) of a fit by Gauss and Newton.

    Value: gains, last step of the delay, steps of the cameras `heads`. Columns (n, q) are whitened; information
    (blocks, q, q) and right side (blocks, q) have the smooth torque projected out.
    """
    steps = [row.whiten(row.segment.heads(heads)) for row in rows]
    gain, delay = gains_alone(rows, firings), 0.0
    for _ in range(ITERATIONS):
        corrected = firings.late_by(delay)
        by_gain = [row.whiten(row.segment.gains(corrected)) for row in rows]
        by_delay = [row.whiten(row.segment.delay(Firings(corrected.time, corrected.impulse_b * gain))) for row in rows]
        columns = [np.concatenate(one, axis=1) for one in zip(by_gain, by_delay, steps, strict=True)]
        reduced = [row.less(c) for row, c in zip(rows, columns, strict=True)]
        for kept, whole in zip(reduced, columns, strict=True):  # nothing but rounding, as of a camera used all the time
            kept[:, np.linalg.norm(kept, axis=0) < 1e-7 * np.linalg.norm(whole, axis=0)] = 0.0
        right = np.stack([c.T @ row.observed for row, c in zip(rows, reduced, strict=True)])
        information = np.stack([c.T @ c for c in reduced])
        value = least_squares.stable_inverse(information.sum(axis=0)) @ right.sum(axis=0)
        gain, delay = value[:3], delay + value[3]
    return value, delay, columns, information, right


def inflation(parts: list[Rows], present: list[np.ndarray], wrong: Iterable[list[np.ndarray]]):
    """Variance inflation factor, at least one, and gains in chi-square (k,) of the firings at each wrong time.

    Quiet stretches are quieter than the rest of the day, so that the noise measured in them makes every gain look
    larger than it is: the factor is the mean gain per degree of freedom of firings at times when there were none.
    Whitened columns of each block: `present` (n, q) of all causes in the model, `wrong` (n, 3) of every wrong time.
    """
    columns = [part.less(one) for part, one in zip(parts, present, strict=True)]
    residual = [part.less(part.observed) for part in parts]
    inverse = least_squares.stable_inverse(sum(c.T @ c for c in columns))
    value = inverse @ sum(c.T @ y for c, y in zip(columns, residual, strict=True))
    residual = [y - c @ value for c, y in zip(columns, residual, strict=True)]
    gains, dof = [], 0
    for one in wrong:
        shifted = [part.less(c) for part, c in zip(parts, one, strict=True)]
        cross = sum(t.T @ c for t, c in zip(shifted, columns, strict=True))
        normal = sum(t.T @ t for t in shifted) - cross @ inverse @ cross.T
        right = sum(t.T @ y for t, y in zip(shifted, residual, strict=True))
        gains.append(float(right @ least_squares.stable_inverse(normal) @ right))
        dof += least_squares.rank(normal)
    return max(sum(gains) / max(dof, 1), 1.0), np.array(gains)


def wrong_times(parts: list[Rows], firings: Firings) -> Iterable[list[np.ndarray]]:
    """Columns of the gains of the firings moved by each of SHIFTS_S: a list of whitened (n, 3), one a block."""
    for shift in SHIFTS_S:
        yield [part.whiten(part.segment.gains(firings.late_by(-shift))) for part in parts]


def estimate(
    aligned: xr.Dataset,
    measured: xr.Dataset,
    *,
    inertia,
    block_s: float,
    knot_s: float,
    parts: int,
    determined_ratio: float,
) -> xr.Dataset:
    """Product "thrusters.estimate": gain of the impulses about each axis and delay of their tags.

    Camera steps and a smooth torque are free. Products are "thrusters.align" and "thrusters.noise"; inertia kg m2.
    A parameter is determined if its sigma is at most determined_ratio times its plausible size.

    Notes
    -----
    angle(t) = sum_k R(t - t_k + delay) diag(gain) L_k + smooth(t) + step of the camera in use; R of
    `model.impulse_response`, L_k lever arm x force x time on. Linear in all but the delay, by Gauss and Newton.
    """
    day = model.records(aligned)
    rows = rows_of(day.camera, model.noise_of(measured), inertia, block_s=block_s, knot_s=knot_s)
    time = day.camera.time
    inside = (day.firings.time > time[0]) & (day.firings.time < time[-1])
    firings = Firings(day.firings.time[inside], day.firings.impulse_b[inside])
    heads = model.heads_of([row.segment for row in rows])[:-1]
    value, delay, columns, information, right = joint_fit(rows, firings, heads)
    factor, shifted = inflation(rows, columns, wrong_times(rows, firings.late_by(delay - value[3])))
    group = np.arange(len(rows)) * parts // len(rows)
    groups = [group == number for number in np.unique(group)]
    information, right = (np.stack([each[g].sum(axis=0) for g in groups]) / factor for each in (information, right))
    normal, side, of_cameras = information.sum(axis=0), right.sum(axis=0), slice(len(NAMES), None)
    chi2 = factor * side @ least_squares.stable_inverse(normal) @ side  # gain of all, less that of the camera steps
    chi2 -= factor * side[of_cameras] @ least_squares.stable_inverse(normal[of_cameras, of_cameras]) @ side[of_cameras]
    right += information[:, :, 3] * (delay - value[3])  # the last step of the delay was about this one
    prior_sigma = [effect("torque.thruster_firings").parameters[0].prior_sigma] * 3
    prior_sigma += [effect("timing.thruster_delay").parameters[0].prior_sigma]
    limit = np.concatenate([determined_ratio * np.array(prior_sigma), np.full(3 * len(heads), np.inf)])
    names = [*NAMES, *(f"camera_{head}_{axis}" for head in heads for axis in "xyz")]
    starts = [rows[np.flatnonzero(g)[0]].segment.camera.time[0] for g in groups]
    units = [*UNITS, *["rad"] * (3 * len(heads))]
    solution = named_parameters.estimated(names, units, limit, information, right, starts)
    solution |= {"shift": SHIFTS_S, "shifted_gain": shifted, "gain": chi2, "inflation": factor}
    return build(SCHEMAS["estimate"], solution | {"firings": firings.time.size})


def check(aligned: xr.Dataset, solution: xr.Dataset, **limits: float) -> xr.Dataset:
    """Checks of the inputs against each other and of the result, "thrusters.align" and "thrusters.estimate"."""
    time, (_, angle, rate) = aligned["time"].values, model.off_the_orbit(aligned)
    jump, error = checks.attitude_jump(time, aligned["quaternion"].values), aligned["velocity_error"]
    ratio, inflated = solution["gain"] / max(float(solution["shifted_gain"].max()), 1.0), solution["inflation"]
    gap = np.diff(aligned["time_orbit"].values, prepend=time[0], append=time[-1]).max()
    rows = [
        at_most("tags of the attitude against the orbit", abs(np.median(angle / rate)), limits["camera_limit_s"], "s"),
        at_most("jump of the attitude", jump, limits["jump_limit_rad"], "rad"),
        at_most("velocity against change of position", error, limits["velocity_limit_m_s"], "m s-1"),
        at_most("gap of the orbit", gap, limits["orbit_gap_limit_s"], "s"),
        at_least("firings in the record", int(solution["firings"]), 1, "1"),
        at_least("chi-square gained by the firings over the most at wrong times", ratio, 1.0, "1"),
        at_most("variance of the day over that of its quiet stretches", inflated, limits["inflation_limit"], "1"),
    ]
    value, sigma = solution["value"].values[:3], solution["sigma"].values[:3]
    if np.isfinite(value).any():
        rows.append(at_least("smallest gain and three sigma", np.nanmin(value + 3 * sigma), 0.0, "1"))
    return checks.product([*rows, *named_parameters.checks(solution, limits["agreement_limit"])])
