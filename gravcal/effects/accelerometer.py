"""What an accelerometer reads: offset from the centre of mass, scale, leaks, steps, tones."""

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
    lambda context, values: -offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b) @ np.asarray(values)
)
_SPEED = axes("speed", "m s-1", "drift of proof mass to centre of mass along", 1e-7)


@law("accelerometer.moving_offset", "linear_b", _SPEED, "equations.md (M1), terms in dp/dt")
def _moving(context: Context, values):
    """Offset drifting at a constant speed, zero at mid manoeuvre; the speed terms 2 w x dp/dt are kept."""
    middle = (context.start + context.stop) / 2
    nearest = middle[np.argmin(np.abs(context.time[:, None] - middle), axis=1)] if middle.size else context.time[0]
    elapsed = (context.time - nearest)[:, None]
    tensor = offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b)
    return -(elapsed * (tensor @ np.asarray(values)) + 2 * np.cross(context.rate_b, values))


_SCALE = axes("", "1", "relative excess of the scale of", 0.02, lower=REVERSED)
law("accelerometer.scale", "linear_b", _SCALE, "reading")(base.scaled("linear_b"))
_ANGLE = axes("angle", "rad", "sensor frame turned about", 1e-3)
law("accelerometer.misalignment", "linear_b", _ANGLE, "reading")(base.misaligned("linear_b"))
law("accelerometer.quadratic", "linear_b", axes("", "s2 m-1", "quadratic response of", 10.0), "reading")(
    lambda context, values: context.linear_b**2 * values
)
_LEAK = pairs("m s-2 A-1 m-2", "reading of {0[0]} per dipole along {0[7]}", 3e-11)
law("accelerometer.current_leak", "linear_b", _LEAK, _COUPLING)(base.coupled("dipole_b"))
_LEAK = pairs("m", "reading of {0[0]} per angular acceleration about {0[7]}", 1e-4)
law("accelerometer.angular_leak", "linear_b", _LEAK, "electrode cross-talk")(base.coupled("angular_b"))
_STEP = (*axes("", "m s-2", "step of the reading of", 1e-9), Parameter("time", "s", "GPS time of the step", 1.0))
law("accelerometer.bias_step", "linear_b", _STEP, "reading", linear=False)(
    lambda context, values: np.where((context.time >= values[3])[:, None], np.asarray(values[:3]), 0.0)
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
    lambda context, values: (
        np.sin(2 * np.pi * values[0] * (context.time - context.epoch) + values[4])[:, None] * np.asarray(values[1:4])
    )
)
_SCALE = axes("", "1", "relative excess of the angular scale about", 0.05, lower=REVERSED)
law("accelerometer.angular_scale", "angular_b", _SCALE, "CoM paper eq. 31")(base.scaled("angular_b"))
_ANGLE = axes("angle", "rad", "angular sensor turned about", 2e-3)
law("accelerometer.angular_misalignment", "angular_b", _ANGLE, "reading")(base.misaligned("angular_b"))
_LEAK = pairs("rad s-2 A-1 m-2", "reading about {0[0]} per dipole along {0[7]}", 1e-8)
law("accelerometer.angular_current_leak", "angular_b", _LEAK, _COUPLING)(base.coupled("dipole_b"))
_SHARE = each(("xy", "xz", "yz"), "1", "share of {0[0]} read by {0[1]} and of {0[1]} by {0[0]}", 1e-2)
# Each of two axes reads the same share of the other; the antisymmetric part is a misalignment.
law("accelerometer.cross_talk", "linear_b", _SHARE, "electrode cross-talk")(
    lambda context, values: context.linear_b @ base.symmetric(*values)
)
_WARMING = axes("", "m s-2", "change from long night to long day of", 1e-9)
law("accelerometer.temperature", "linear_b", _WARMING, "reading against sunlight with a lag of 600 s")(base.warming)
_MODE = (
    Parameter("frequency", "Hz", "own frequency", 0.01, neutral=0.5, lower=0.0),
    Parameter("damping", "1", "damping ratio", 0.01, neutral=0.02, lower=0.0),
    *pairs("m", "reading of {0[0]} per angular acceleration about {0[7]} that lasts", 1e-4),
)
# Deflection under angular acceleration a: x'' + 2 z w x' + w^2 x = w^2 a, reading c x.
law("accelerometer.flexible_mode", "linear_b", _MODE, "elastic mounting", linear=False)(
    lambda context, values: deflection(context.time, context.angular_b, *values[:2]) @ np.reshape(values[2:], (3, 3)).T
)


@njit(cache=True)
def deflection(time, drive, frequency, damping):
    """Oscillators (n, k) that follow their drives (n, k) of any unit, at rest at first.

    The mean of both drives is held between two epochs: a drive half a step late would look like another natural
    frequency. Natural frequency in Hz, damping ratio below 1.
    """
    out = np.zeros(drive.shape)
    omega = 2 * np.pi * max(frequency, 1e-9)
    decay, swing = damping * omega, omega * np.sqrt(1 - damping**2)
    for i in range(drive.shape[1]):
        x, v = 0.0, 0.0
        for k in range(1, time.size):
            step, target = time[k] - time[k - 1], (drive[k - 1, i] + drive[k, i]) / 2
            c, s, fade = np.cos(swing * step), np.sin(swing * step), np.exp(-decay * step)
            away = x - target
            x = target + fade * (away * c + (v + decay * away) / swing * s)
            v = fade * (v * c - (decay * v + omega**2 * away) / swing * s)
            out[k, i] = x
    return out
