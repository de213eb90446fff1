"""Effects on accelerometer readings: offset from the centre of mass, scale, cross-talk, steps, tones, flexible mode."""

import numpy as np
from numba import njit

from gravcal.effects import base
from gravcal.effects.base import REVERSED, Context, Laws, Parameter, axes, each, pairs
from gravcal.physics.sensing import offset_tensor

EFFECTS = Laws()
law = EFFECTS.law
_COUPLING = "coupling of the torquer currents into the electronics"


_SOURCE = "CoM paper eqs. 2, 5; equations.md (M1)"
_FROM_PROOF_MASS = axes("", "m", "proof mass to centre of mass along", 2e-4)
# CoM paper eq. 5: reading T p with p = -(proof mass to centre of mass).
law("accelerometer.offset", "linear_b", _FROM_PROOF_MASS, _SOURCE)(
    lambda c, v: -offset_tensor(c.rate_b, c.rate_dot_b, c.gradient_b) @ np.asarray(v)
)
_SPEED = axes("speed", "m s-1", "drift of proof mass to centre of mass along", 1e-7)


@law("accelerometer.moving_offset", "linear_b", _SPEED, "equations.md (M1), terms in dp/dt")
def _moving(context: Context, values):
    """Contribution (n, 3) of an offset drifting at values (3,) m s-1, zero at mid manoeuvre; 2 w x dp/dt is kept."""
    middle = (context.start + context.stop) / 2
    reference = middle[np.argmin(np.abs(context.time[:, None] - middle), axis=1)] if middle.size else context.time[0]
    elapsed = (context.time - reference)[:, None]
    tensor = offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b)
    return -(elapsed * (tensor @ np.asarray(values)) + 2 * np.cross(context.rate_b, values))


_SCALE = axes("", "1", "relative excess of the scale of", 0.02, lower=REVERSED)
law("accelerometer.scale", "linear_b", _SCALE, "reading")(base.scaled("linear_b"))
_ANGLE = axes("angle", "rad", "sensor frame turned about", 1e-3)
law("accelerometer.misalignment", "linear_b", _ANGLE, "reading")(base.misaligned("linear_b"))
law("accelerometer.quadratic", "linear_b", axes("", "s2 m-1", "quadratic response of", 10.0), "reading")(
    lambda c, v: c.linear_b**2 * v
)
_LEAK = pairs("m s-2 A-1 m-2", "reading of {0[0]} per dipole along {0[7]}", 3e-11)
law("accelerometer.current_leak", "linear_b", _LEAK, _COUPLING)(base.coupled("dipole_b"))
_LEAK = pairs("m", "reading of {0[0]} per angular acceleration about {0[7]}", 1e-4)
law("accelerometer.angular_leak", "linear_b", _LEAK, "electrode cross-talk")(base.coupled("angular_b"))
_STEP = (*axes("", "m s-2", "step of the reading of", 1e-9), Parameter("time", "s", "GPS time of the step", 1.0))
law("accelerometer.bias_step", "linear_b", _STEP, "reading", linear=False)(
    lambda c, v: np.where((c.time >= v[3])[:, None], np.asarray(v[:3]), 0.0)
)
law("accelerometer.bias_drift", "linear_b", axes("", "m s-3", "drift of the reading of", 1e-12), "reading")(
    base.drifting
)
_TONE = (
    Parameter("frequency", "Hz", "frequency", 0.1),
    *axes("", "m s-2", "amplitude along", 1e-10),
    Parameter("phase", "rad", "phase at the reference epoch", 1.0),
)
law("accelerometer.stray_tone", "linear_b", _TONE, "disturbance of the platform", linear=False)(
    lambda c, v: np.sin(2 * np.pi * v[0] * (c.time - c.epoch) + v[4])[:, None] * np.asarray(v[1:4])
)
_SCALE = axes("", "1", "relative excess of the angular scale about", 0.05, lower=REVERSED)
law("accelerometer.angular_scale", "angular_b", _SCALE, "CoM paper eq. 31")(base.scaled("angular_b"))
_ANGLE = axes("angle", "rad", "angular sensor turned about", 2e-3)
law("accelerometer.angular_misalignment", "angular_b", _ANGLE, "reading")(base.misaligned("angular_b"))
_LEAK = pairs("rad s-2 A-1 m-2", "reading about {0[0]} per dipole along {0[7]}", 1e-8)
law("accelerometer.angular_current_leak", "angular_b", _LEAK, _COUPLING)(base.coupled("dipole_b"))
_SHARE = each(("xy", "xz", "yz"), "1", "share of {0[0]} read by {0[1]} and of {0[1]} by {0[0]}", 1e-2)
# Symmetric part of the cross-talk, an equal share between two axes; the antisymmetric part is a misalignment.
law("accelerometer.cross_talk", "linear_b", _SHARE, "electrode cross-talk")(
    lambda c, v: c.linear_b @ base.symmetric(*v)
)
_WARMING = axes("", "m s-2", "change from long night to long day of", 1e-9)
law("accelerometer.temperature", "linear_b", _WARMING, "reading against sunlight with a lag of 600 s")(base.warming)
_MODE = (
    Parameter("frequency", "Hz", "own frequency", 0.01, neutral=0.5, lower=0.0),
    Parameter("damping", "1", "damping ratio", 0.01, neutral=0.02, lower=0.0),
    *pairs("m", "reading of {0[0]} per angular acceleration about {0[7]} that lasts", 1e-4),
)
# Flexible mode driven by angular acceleration a: x'' + 2 z w x' + w^2 x = w^2 a, reading c x.
law("accelerometer.flexible_mode", "linear_b", _MODE, "elastic mounting", linear=False)(
    lambda c, v: deflection(c.time, c.angular_b, *v[:2]) @ np.reshape(v[2:], (3, 3)).T
)


@njit(cache=True)
def deflection(time, drive, frequency, damping):
    """Response (n, k) of damped oscillators to drives (n, k) at (n,) s, in the unit of the drive, at rest at first.

    Between two epochs the drive is held at the mean of both: half a step late it would look like another natural
    frequency. Frequency is the undamped natural one in Hz, damping the damping ratio, below 1.
    """
    response = np.zeros(drive.shape)
    omega = 2 * np.pi * max(frequency, 1e-9)
    decay, damped_omega = damping * omega, omega * np.sqrt(1 - damping**2)
    for i in range(drive.shape[1]):
        x, x_dot = 0.0, 0.0
        for k in range(1, time.size):
            step, target = time[k] - time[k - 1], (drive[k - 1, i] + drive[k, i]) / 2
            cosine, sine, fade = np.cos(damped_omega * step), np.sin(damped_omega * step), np.exp(-decay * step)
            distance = x - target
            x = target + fade * (distance * cosine + (x_dot + decay * distance) / damped_omega * sine)
            x_dot = fade * (x_dot * cosine - (decay * x_dot + omega**2 * distance) / damped_omega * sine)
            response[k, i] = x
    return response
