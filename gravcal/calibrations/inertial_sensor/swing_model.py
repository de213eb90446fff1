"""Attitude that the voltages predict for a swing, its derivatives, and the covariance of measured minus predicted.

The angle is fitted, not the angular acceleration: integrating the voltages twice puts the star-tracker noise on the
side of the observations, where it attenuates nothing. The noise of the voltages is integrated with them: it enters
the covariance and is taken out of the regressor (see swing_fit).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.inertial_sensor import cleaning
from gravcal.physics import frames, gravity, kinematics

NUISANCE = ("angle", "rate", "constant", "slope")


@dataclass(frozen=True)
class Swing:
    """What is known before the fit.

    Attributes
    ----------
    time : (n,) s, sensor epochs, evenly spaced; angular_volt : (n, 3) V, angular readouts, spikes repaired
    time_att : (m,) s, tracker tags; quaternion : (m, 4)
    edges : (b + 1,) s, bins of the fit
    position_i : (n, 3) m; inertia : (3,) kg m2 of the test mass
    voltage_variance : (3,) V2 of an angular readout averaged over a bin
    tracker_variance : (3,) rad2 of one tracker sample
    owner : (3,) index of the estimated factor of each axis
    """

    time: np.ndarray
    angular_volt: np.ndarray
    time_att: np.ndarray
    quaternion: np.ndarray
    edges: np.ndarray
    position_i: np.ndarray
    inertia: np.ndarray
    voltage_variance: np.ndarray
    tracker_variance: np.ndarray
    owner: tuple[int, int, int]

    @property
    def factors(self) -> int:
        """Number of angular factors estimated."""
        return max(self.owner) + 1

    @property
    def middle(self) -> np.ndarray:
        """(b,) s, middles of the bins."""
        return (self.edges[1:] + self.edges[:-1]) / 2


@dataclass(frozen=True)
class Unknowns:
    """Current values: factors (f,) rad s-2 V-1, delay s, start attitude (4,), rate (3,), constant and slope (3,)."""

    factors: np.ndarray
    delay: float
    quaternion: np.ndarray
    rate: np.ndarray
    constant: np.ndarray
    slope: np.ndarray

    def moved(self, step: np.ndarray) -> Unknowns:
        """Unknowns after a step (f + 1 + 12,) in the order of the columns."""
        count = self.factors.size
        angle, rate, constant, slope = step[count + 1 :].reshape(4, 3)
        return Unknowns(
            self.factors + step[:count],
            self.delay + step[count],
            frames.quaternion_product(self.quaternion, frames.from_rotation_vector(angle)),
            self.rate + rate,
            self.constant + constant,
            self.slope + slope,
        )


@dataclass(frozen=True)
class Prediction:
    """Motion predicted at the sensor epochs: quaternion (n, 4), rate_b and rate_dot_b (n, 3)."""

    quaternion: np.ndarray
    rate_b: np.ndarray
    rate_dot_b: np.ndarray


def predict(swing: Swing, unknowns: Unknowns, before: Prediction) -> Prediction:
    """Motion that the voltages imply.

    Parameters
    ----------
    swing : Swing
    unknowns : Unknowns
    before : Prediction, from which the gyroscopic and gravity torques on the test mass are taken

    Notes
    -----
    w' = beta V + c - J^-1 (w x J w - vex(J G - G J)); Remote Sens. 2023, 15, 3817, eq. 11, completed.
    """
    u = _unit_time(swing)[:, None]
    measured = swing.angular_volt * unknowns.factors[list(swing.owner)] + unknowns.constant + u * unknowns.slope
    rate_dot = measured + _own_torque(swing, before)
    rate = unknowns.rate + kinematics.running_integral(swing.time, rate_dot)
    return Prediction(kinematics.attitude_from_rates(swing.time, rate, unknowns.quaternion), rate, rate_dot)


def _own_torque(swing, motion):
    """Angular acceleration of a free test mass (n, 3)."""
    J = np.diag(swing.inertia)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    gradient_b = gravity.rotate_tensor(R_bi, gravity.gradient_i(swing.position_i))
    gyroscopic = np.cross(motion.rate_b, motion.rate_b * swing.inertia)
    return (frames.vex(J @ gradient_b - gradient_b @ J) - gyroscopic) / swing.inertia


def _unit_time(swing):
    span = swing.time[-1] - swing.time[0]
    return 2 * (swing.time - swing.time[0]) / span - 1


def residual_and_columns(
    swing: Swing, unknowns: Unknowns, motion: Prediction
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured minus predicted attitude and its model columns, averaged over the bins.

    Parameters
    ----------
    swing : Swing; unknowns : Unknowns; motion : Prediction

    Returns
    -------
    residual_b : (b, 3) rad, rotation from the predicted to the measured attitude
    columns : (b, 3, f + 13) rad per unit: factors, delay, then angle, rate, constant, slope of x, y, z
    count : (b,) tracker samples in each bin
    """
    shown = swing.time_att - unknowns.delay
    inside = (shown >= swing.time[0]) & (shown <= swing.time[-1])
    shown = np.clip(shown, swing.time[0], swing.time[-1])
    predicted = frames.interpolate(swing.time, motion.quaternion, shown)
    residual = frames.attitude_error(swing.quaternion, predicted)
    columns = _at(swing.time, angle_columns(swing, motion), shown)
    delay = -_at(swing.time, motion.rate_b, shown)[:, :, None]
    split = swing.factors
    columns = np.concatenate([columns[:, :, :split], delay, columns[:, :, split:]], axis=2)
    both = np.concatenate([residual[:, :, None], columns], axis=2)
    both[~inside] = np.nan
    mean, count = cleaning.bin_means(swing.time_att, both, swing.edges)
    return mean[:, :, 0], mean[:, :, 1:], count


def angle_columns(swing: Swing, motion: Prediction) -> np.ndarray:
    """Change of the attitude with factors, start angle and rate, constant and slope (n, 3, f + 12) rad per unit."""
    count = swing.time.size
    one = np.eye(3)
    volts = np.zeros((count, 3, swing.factors))
    for axis, owner in enumerate(swing.owner):
        volts[:, axis, owner] = swing.angular_volt[:, axis]
    drive = np.concatenate([volts, np.broadcast_to(one, (count, 3, 3)), _unit_time(swing)[:, None, None] * one], axis=2)
    rate = kinematics.running_integral(swing.time, drive)
    rate = np.concatenate([rate[:, :, :-6], np.broadcast_to(one, (count, 3, 3)), rate[:, :, -6:]], axis=2)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion)
    angle = kinematics.angle_from_rate_change(swing.time, R_bi, rate)
    start = R_bi @ R_bi[0].T
    return np.concatenate([angle[:, :, : swing.factors], start, angle[:, :, swing.factors :]], axis=2)


def _at(time, values, at):
    """Linear interpolation along the first axis."""
    place = np.clip(np.searchsorted(time, at, side="right") - 1, 0, time.size - 2)
    share = ((at - time[place]) / (time[place + 1] - time[place])).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[place] + share * values[place + 1]


def noise_map(swing: Swing, motion: Prediction) -> np.ndarray:
    """Angle in every bin per unit of angular acceleration, about each axis, held over every bin (3, 3 b, b) s2.

    Parameters
    ----------
    swing : Swing; motion : Prediction
    """
    bins = swing.edges.size - 1
    step = swing.edges[1] - swing.edges[0]
    pick = np.clip(np.searchsorted(swing.time, swing.middle), 0, swing.time.size - 1)
    R_bi = frames.R_bi_from_quaternion(motion.quaternion[pick])
    turned = np.einsum("mai,lji->mlaj", R_bi, R_bi)  # (to bin, from bin, angle axis, rate axis)
    turned *= np.tri(bins, bins)[:, :, None, None]
    half = turned - 0.5 * np.eye(bins)[:, :, None, None] * turned
    later = np.cumsum(half[:, ::-1], axis=1)[:, ::-1] - 0.5 * half  # rate after a bin is full, within it half
    return step**2 * np.transpose(later, (3, 0, 2, 1)).reshape(3, 3 * bins, bins)
