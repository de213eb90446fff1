"""Attitude that the voltages predict for a swing, and the fit of angular factors and tracker delay to the measured one.

The angle is fitted, not the angular acceleration: integrating the voltages twice puts the star-tracker noise on the
side of the observations, where it attenuates nothing. Measured minus predicted attitude is r = n_t - A (beta n_V):
tracker noise and twice-integrated voltage noise. The maximum-likelihood estimate of an errors-in-variables problem with
known noise minimises r' C(beta)^-1 r. Its score is that of least squares whose regressor is the twice-integrated
voltage with the estimated noise n_V taken out, so the fit iterates: residual, estimated voltage noise, cleaned
regressor, step.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import cho_solve, solve_triangular, toeplitz

from gravcal.errors import EstimationError
from gravcal.estimation import least_squares
from gravcal.estimation.resampling import bin_means
from gravcal.physics import frames, gravity, kinematics

#: Which of the two estimated factors belongs to each axis: those about y and z are one.
OWNER = np.array([0, 1, 1])
FACTORS = 2
STEPS = 12  # of the iterated fit, at most


@dataclass(frozen=True)
class Swing:
    """Records of a swing and their noise, before the fit."""

    time: np.ndarray  # (n,) s, sensor epochs, evenly spaced
    angular_volt: np.ndarray  # (n, 3) V, angular readouts, spikes repaired
    time_att: np.ndarray  # (m,) s, tracker tags
    quaternion: np.ndarray  # (m, 4)
    edges: np.ndarray  # (b + 1,) s, bins of the fit
    position_i: np.ndarray  # (n, 3) m
    inertia: np.ndarray  # (3,) kg m2 of the test mass
    voltage_variance: np.ndarray  # (3,) V2 of an angular readout averaged over a bin
    tracker_variance: np.ndarray  # (3,) rad2 of one tracker sample
    tracker_noise: np.ndarray  # (3, b) autocovariance of bins by lag over that of white noise

    @property
    def middle(self) -> np.ndarray:
        """(b,) s, middles of the bins."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @property
    def unit_time(self) -> np.ndarray:
        """(n,) sensor epochs on a scale from -1 to 1."""
        return 2 * (self.time - self.time[0]) / (self.time[-1] - self.time[0]) - 1


@dataclass(frozen=True)
class Unknowns:
    """Current values: factors (2,) rad s-2 V-1, delay s, start attitude (4,), rate (3,), constant and slope (3,)."""

    factors: np.ndarray
    delay: float
    quaternion: np.ndarray
    rate: np.ndarray
    constant: np.ndarray
    slope: np.ndarray

    def moved(self, step: np.ndarray) -> "Unknowns":
        """Unknowns after a step (15,) in the order of the columns."""
        angle, rate, constant, slope = step[FACTORS + 1 :].reshape(4, 3)
        return Unknowns(
            self.factors + step[:FACTORS],
            self.delay + step[FACTORS],
            frames.quaternion_product(self.quaternion, frames.from_rotation_vector(angle)),
            self.rate + rate,
            self.constant + constant,
            self.slope + slope,
        )


@dataclass(frozen=True)
class Motion:
    """Motion predicted at the sensor epochs: quaternion (n, 4), rate_b and rate_dot_b (n, 3)."""

    quaternion: np.ndarray
    rate_b: np.ndarray
    rate_dot_b: np.ndarray


@dataclass(frozen=True)
class LinearSystem:
    """Attitude observations linearised about some unknowns, of the bins with tracker samples."""

    residual: np.ndarray  # (r,) rad
    design: np.ndarray  # (r, 15) rad per unit
    lower: np.ndarray  # (r, r) rad, Cholesky factor of the covariance
    valid: np.ndarray  # (3 b,) rows that there are
    count: np.ndarray  # (b,) tracker samples
    voltage_noise: np.ndarray  # (b, 3) V, estimated error of the angular readouts per bin


@dataclass(frozen=True)
class Fit:
    """Solution of a swing; observed and design are whitened rows about it in order of time, for the Kalman filter."""

    unknowns: Unknowns
    covariance: np.ndarray  # (15, 15) in the order of the columns
    chi2: float
    dof: int
    motion: Motion
    system: LinearSystem  # of the last step
    observed: np.ndarray  # (r,)
    design: np.ndarray  # (r, 15)


def predict(swing: Swing, unknowns: Unknowns, before: Motion) -> Motion:
    """Motion that the voltages imply; gyroscopic and gravity torques on the test mass are those of the motion before.

    w' = beta V + c - J^-1 (w x J w - vex(J G - G J)); Remote Sens. 2023, 15, 3817, eq. 11, completed.
    """
    J, w = np.diag(swing.inertia), before.rate_b
    R_bi = frames.R_bi_from_quaternion(before.quaternion)
    G = gravity.rotate_tensor(R_bi, gravity.gradient_i(swing.position_i))
    torque = frames.vex(J @ G - G @ J) - np.cross(w, w * swing.inertia)
    constant = unknowns.constant + swing.unit_time[:, None] * unknowns.slope
    rate_dot = swing.angular_volt * unknowns.factors[OWNER] + constant + torque / swing.inertia
    rate = unknowns.rate + kinematics.running_integral(swing.time, rate_dot)
    return Motion(kinematics.attitude_from_rates(swing.time, rate, unknowns.quaternion), rate, rate_dot)


def residual_and_columns(swing: Swing, unknowns: Unknowns, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bin means of measured minus predicted attitude (b, 3) rad, of its columns (b, 3, 15), and samples in bins (b,).

    The residual is the rotation from the predicted to the measured attitude; columns are rad per unit of factors,
    delay, then angle, rate, constant, slope of x, y, z.
    """
    epoch = swing.time_att - unknowns.delay
    inside = (epoch >= swing.time[0]) & (epoch <= swing.time[-1])
    epoch = np.clip(epoch, swing.time[0], swing.time[-1])
    residual = frames.attitude_error(swing.quaternion, frames.interpolate(swing.time, motion.quaternion, epoch))
    columns = interpolated(swing.time, angle_columns(swing, motion), epoch)
    delay = -interpolated(swing.time, motion.rate_b, epoch)[:, :, None]
    rows = [residual[:, :, None], columns[:, :, :FACTORS], delay, columns[:, :, FACTORS:]]
    rows = np.concatenate(rows, axis=2)
    rows[~inside] = np.nan
    mean, count = bin_means(swing.time_att, rows, swing.edges)
    return mean[:, :, 0], mean[:, :, 1:], count


def angle_columns(swing: Swing, motion: Motion) -> np.ndarray:
    """Partial derivatives (n, 3, 14) rad of the attitude by factors, start angle and rate, constant and slope."""
    identity = np.eye(3)
    identities = np.broadcast_to(identity, (swing.time.size, 3, 3))
    volts = np.zeros((swing.time.size, 3, FACTORS))
    volts[:, range(3), OWNER] = swing.angular_volt
    rate_dot = np.concatenate([volts, identities, swing.unit_time[:, None, None] * identity], axis=2)
    rate = kinematics.running_integral(swing.time, rate_dot)
    rate = np.concatenate([rate[:, :, :FACTORS], identities, rate[:, :, FACTORS:]], axis=2)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    angle = kinematics.angle_from_rate_change(swing.time, R_bi, rate)
    return np.concatenate([angle[:, :, :FACTORS], R_bi @ R_bi[0].T, angle[:, :, FACTORS:]], axis=2)


def interpolated(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (n, ...) interpolated linearly along the first axis at epochs (m,) s, extrapolated beyond the ends."""
    return make_interp_spline(time - time[0], values, k=1)(at - time[0])


def noise_map(swing: Swing, motion: Motion) -> np.ndarray:
    """Angle in every bin per unit of angular acceleration about each axis during every bin, (3, 3 b, b) s2."""
    count = swing.edges.size - 1
    step = swing.edges[1] - swing.edges[0]
    nearest = np.clip(np.searchsorted(swing.time, swing.middle), 0, swing.time.size - 1)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion[nearest])
    turn = np.einsum("mai,lji->mlaj", R_bi, R_bi)  # (to bin, from bin, angle axis, rate axis)
    turn *= np.tri(count, count)[:, :, None, None]
    half = turn - 0.5 * np.eye(count)[:, :, None, None] * turn
    later = np.cumsum(half[:, ::-1], axis=1)[:, ::-1] - 0.5 * half  # rate after a bin is full, within it half
    return step**2 * np.transpose(later, (3, 0, 2, 1)).reshape(3, 3 * count, count)


def linear_system(
    swing: Swing, unknowns: Unknowns, motion: Motion, maps: np.ndarray, *, cleaned: bool = True
) -> LinearSystem:
    """Residual, design and covariance of the attitude; cleaned: without estimated voltage noise in the regressors."""
    residual, columns, count = residual_and_columns(swing, unknowns, motion)
    valid = np.repeat(count > 0, 3)
    residual, design = residual.reshape(-1)[valid], columns.reshape(valid.size, -1)[valid]
    beta = unknowns.factors[OWNER]
    maps = maps[:, valid]
    covariance = np.zeros((count.size, 3, count.size, 3))
    sigma = np.sqrt(swing.tracker_variance / np.maximum(count, 1)[:, None])
    for axis in range(3):
        covariance[:, axis, :, axis] = toeplitz(swing.tracker_noise[axis]) * np.outer(sigma[:, axis], sigma[:, axis])
    covariance = covariance.reshape(valid.size, valid.size)[np.ix_(valid, valid)]
    for axis in range(3):
        covariance += beta[axis] ** 2 * swing.voltage_variance[axis] * (maps[axis] @ maps[axis].T)
    lower = np.linalg.cholesky(covariance)
    noise = np.zeros((count.size, 3))
    if cleaned:
        weighted = cho_solve((lower, True), residual)
        noise = -(np.einsum("jrb,r->bj", maps, weighted) * beta * swing.voltage_variance)
        for axis, owner in enumerate(OWNER):
            design[:, owner] -= maps[axis] @ noise[:, axis]
    return LinearSystem(residual, design, lower, valid, count, noise)


def fit(swing: Swing, first: np.ndarray) -> Fit:
    """Maximum-likelihood factors, delay and start values, from first factors (2,) rad s-2 V-1."""
    unknowns, motion = _begin(swing, np.asarray(first, dtype=float))
    maps = None
    for number in range(STEPS):
        motion = predict(swing, unknowns, motion)
        if maps is None or number == 3:
            maps = noise_map(swing, motion)
        system = linear_system(swing, unknowns, motion, maps, cleaned=number > 1)
        design = solve_triangular(system.lower, system.design, lower=True)
        white = solve_triangular(system.lower, system.residual, lower=True)
        covariance = least_squares.stable_inverse(design.T @ design)
        step = covariance @ (design.T @ white)
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        size = np.max(np.abs(step) / sigma) if np.all(sigma > 0) and np.isfinite(step).all() else np.inf
        if size == np.inf or np.abs(step[FACTORS + 1 :]).max() > 1.0:  # rad, rad s-1: no swing any more
            break
        if number > 3 and size < 1e-3:
            return Fit(
                unknowns.moved(step),
                covariance,
                chi2=float(white @ white),
                dof=white.size - design.shape[1],
                motion=motion,
                system=system,
                observed=white + design[:, : FACTORS + 1] @ np.append(unknowns.factors, unknowns.delay),
                design=design,
            )
        unknowns = unknowns.moved(step)
    raise EstimationError(
        f"swing from {swing.time[0]:.1f} s: the fit still moves by {size:.1e} standard deviations after {number + 1} "
        "steps, expected 1e-3. Check that voltages and attitude belong together, or start from other factors.",
        size=float(size),
    )


def _begin(swing, first):
    """Start unknowns and motion, from first factors (2,); rates by differencing the tracker over five seconds."""
    near = swing.time_att - swing.time_att[0] <= 5.0
    angle = frames.attitude_error(swing.quaternion[near], swing.quaternion[near][:1])
    rate = np.polyfit(swing.time_att[near] - swing.time_att[near][0], angle, 1)[0]
    at = np.clip(swing.time, swing.time_att[0], swing.time_att[-1])
    attitude = frames.interpolate(swing.time_att, swing.quaternion, at)
    constant = -first[OWNER] * swing.angular_volt.mean(axis=0)
    rates = np.broadcast_to(rate, (swing.time.size, 3))
    unknowns = Unknowns(first, 0.0, attitude[0], rate, constant, np.zeros(3))
    return unknowns, Motion(attitude, rates, np.zeros_like(rates))
