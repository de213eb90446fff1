"""Six electrode voltages of the inertial sensor, linear and angular scale factors, and effects on its readings.

Errata T-4, T-5: a voltage counted once makes the force M k V at the arm l: beta = M l k / J, without the printed 1/2.
"""

import numpy as np

from gravcal.effects.base import Context, Laws, Parameter, axes, constant, drifting, each

#: Rows a_x, a_y, a_z, wd_x, wd_y, wd_z; columns the voltages V_x1, V_x2, V_x3, V_y, V_z1, V_z2 (Table 3).
READOUT = np.array(
    [
        [2.0, 1.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 1.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, -1.0],
        [0.0, 1.0, -1.0, 0.0, 0.0, 0.0],
        [2.0, -1.0, -1.0, 0.0, 0.0, 0.0],
    ]
)

#: rad s-1, bandwidth of the suspension: displacement is acceleration over its square; assumed, no source prints it.
LOOP = 2 * np.pi * 1.0


def linear_over_angular(mass: float, inertia, arm) -> np.ndarray:
    """Ratios J / (M l) (3,) m that convert beta_x to k_z, beta_y to k_x, beta_z to k_x; mass kg, inertia kg m2, arm m.

    k = J beta / (M l); Remote Sens. 2023, 15, 3817, eqs. 8-10 without their factor 1/2 (erratum T-4).
    """
    return np.asarray(inertia) / (mass * np.asarray(arm))


def readouts(volts: np.ndarray) -> np.ndarray:
    """Combinations (..., 6) V of Table 3: linear accelerations x, y, z over k, angular ones over beta."""
    return volts @ READOUT.T


def volts(combined: np.ndarray) -> np.ndarray:
    """Electrode voltages (..., 6) V from the six combinations (..., 6) V, the inverse of `readouts`."""
    return combined @ np.linalg.inv(READOUT).T


#: The context holds `extra["volts"]` (n, 6) V in that order, and `extra["displacement_b"]` (n, 3) m of the test mass.
EFFECTS = Laws()
law = EFFECTS.law
_PAPER = "Remote Sens. 2023, 15, 3817"
_SQUARE = axes("", "V-1", "relative quadratic response of the electrodes along", 2e-4)
# Recorded V + q V^2 of every electrode, so that combinations hold products of voltages; Taiji eq. 4.
law("inertial_sensor.quadratic", "electrode_v", _SQUARE, f"{_PAPER}, eq. 4, second term")(
    lambda c, v: np.asarray(v)[[int(np.argmax(READOUT[:3, k])) for k in range(6)]] * c.extra["volts"] ** 2
)
_OFF = (np.array([0, 0, 1, 1, 2, 2]), np.array([1, 2, 0, 2, 0, 1]))
_SHARES = [f"{'xyz'[i]}_from_{'xyz'[j]}" for i, j in zip(*_OFF, strict=True)]
_SHARES = each(_SHARES, "1", "share of the force along {0[7]} that {0[0]} reads", 1e-3)


@law("inertial_sensor.cross_coupling", "linear_b", _SHARES, "electrodes not at right angles")
def _coupling(context: Context, values):
    """Contribution (n, 3) of cross-coupling: off-diagonal shares, values (6,), of the reading along the other axes."""
    shares = np.zeros((3, 3))
    shares[_OFF] = values
    return context.linear_b @ shares.T


_PULL = axes("", "s-2", "pull per metre off the middle of the cage along", 1e-5)
# A test mass held off its place is pulled on; the suspension reads the opposite.
law("inertial_sensor.stiffness", "linear_b", _PULL, "electrostatic spring of the electrodes, of negative sign")(
    lambda c, v: -np.asarray(v) * c.extra["displacement_b"]
)
_DELAY = Parameter("delay", "s", "angular readings follow the motion by", 0.02)
# Voltages answer to the motion of before: to first order minus the delay times the change.
law("inertial_sensor.loop_delay", "angular_b", (_DELAY,), "suspension loop")(
    lambda c, v: -v[0] * np.gradient(c.angular_b, c.time, axis=0)
)
_DRIFT = axes("", "m s-3", "drift of the reading of", 1e-13)
law("inertial_sensor.bias_drift", "linear_b", _DRIFT, f"{_PAPER}, Sec. 4.4, trends of the segments")(drifting)
_ANGLE = axes("angle", "rad", "star tracker turned against the sensor about", 1e-3)
law("inertial_sensor.tracker_misalignment", "pointing_b", _ANGLE, "mounting")(constant)
