"""What an accelerometer reads: offset from the centre of mass, scale, leaks, steps, tones."""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Context, Effect, Parameter, axes, coupled, drifting, misaligned, scaled
from gravcal.physics.sensing import offset_tensor


def _offset(context: Context, values):
    """CoM paper eq. 5: reading T p with p = -(proof mass to centre of mass)."""
    return _offset_columns(context) @ np.asarray(values)


def _offset_columns(context: Context):
    """Reading per metre of offset, (n, 3, 3)."""
    return -offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b)


def _moving(context: Context, values):
    """Offset drifting at a constant speed, zero at mid manoeuvre; the speed terms 2 w x dp/dt are kept."""
    middle = (context.start + context.stop) / 2
    nearest = middle[np.argmin(np.abs(context.time[:, None] - middle), axis=1)] if middle.size else context.time[0]
    elapsed = (context.time - nearest)[:, None]
    tensor = offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b)
    return -(elapsed * (tensor @ np.asarray(values)) + 2 * np.cross(context.rate_b, values))


def _quadratic(context: Context, values):
    return context.linear_b**2 * values


def _bias_step(context: Context, values):
    return np.where((context.time >= values[3])[:, None], np.asarray(values[:3]), 0.0)


def _tone(context: Context, values):
    frequency, x, y, z, phase = values
    return np.sin(2 * np.pi * frequency * (context.time - context.epoch) + phase)[:, None] * np.array([x, y, z])


def _crosstalk(context: Context, values):
    """Each of two axes reads the same share of the other; the antisymmetric part is a misalignment."""
    xy, xz, yz = values
    return context.linear_b @ np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])


def _temperature(context: Context, values):
    """Reading that follows sunlight through a first-order lag."""
    return context.extra["warmth"][:, None] * np.asarray(values)


def _flexible(context: Context, values):
    """Ringing of an appendage driven by the torquers: x'' + 2 z w x' + w^2 x = w^2 u, reading c (x - u), u = |m|."""
    from gravcal.effects.kernels import ringing

    frequency, damping, *size = values
    return ringing(context.time, context.dipole_b.sum(axis=1), frequency, damping)[:, None] * np.array(size)


_BOTH = ("xy", "xz", "yz")
_PAIRS = tuple(f"{a}_from_{b}" for a in "xyz" for b in "xyz")

EFFECTS = (
    Effect(
        "accelerometer.offset",
        "linear_b",
        axes("", "m", "proof mass to centre of mass along", 2e-4),
        _offset,
        "CoM paper eqs. 2, 5; equations.md (M1)",
        jacobian=_offset_columns,
    ),
    Effect(
        "accelerometer.moving_offset",
        "linear_b",
        axes("speed", "m s-1", "drift of proof mass to centre of mass along", 1e-7),
        _moving,
        "equations.md (M1), terms in dp/dt",
    ),
    Effect(
        "accelerometer.scale",
        "linear_b",
        axes("", "1", "relative excess of the scale of", 0.02),
        scaled("linear_b"),
        "reading",
    ),
    Effect(
        "accelerometer.misalignment",
        "linear_b",
        axes("angle", "rad", "sensor frame turned about", 1e-3),
        misaligned("linear_b"),
        "reading",
    ),
    Effect(
        "accelerometer.quadratic", "linear_b", axes("", "s2 m-1", "quadratic response of", 10.0), _quadratic, "reading"
    ),
    Effect(
        "accelerometer.current_leak",
        "linear_b",
        tuple(Parameter(n, "m s-2 A-1 m-2", f"reading of {n[0]} per dipole along {n[-1]}", 3e-11) for n in _PAIRS),
        coupled("dipole_b"),
        "coupling of the torquer currents into the electronics",
    ),
    Effect(
        "accelerometer.angular_leak",
        "linear_b",
        tuple(Parameter(n, "m", f"reading of {n[0]} per angular acceleration about {n[-1]}", 1e-4) for n in _PAIRS),
        coupled("angular_b"),
        "electrode cross-talk",
    ),
    Effect(
        "accelerometer.bias_step",
        "linear_b",
        (*axes("", "m s-2", "step of", 1e-9), Parameter("time", "s", "GPS time of the step", 1.0)),
        _bias_step,
        "reading",
        linear=False,
    ),
    Effect("accelerometer.bias_drift", "linear_b", axes("", "m s-3", "drift of", 1e-12), drifting, "reading"),
    Effect(
        "accelerometer.stray_tone",
        "linear_b",
        (
            Parameter("frequency", "Hz", "frequency", 0.1),
            *axes("", "m s-2", "amplitude along", 1e-10),
            Parameter("phase", "rad", "phase at the reference epoch", 1.0),
        ),
        _tone,
        "disturbance of the platform",
        linear=False,
    ),
    Effect(
        "accelerometer.angular_scale",
        "angular_b",
        axes("", "1", "relative excess of the angular scale about", 0.05),
        scaled("angular_b"),
        "CoM paper eq. 31",
    ),
    Effect(
        "accelerometer.angular_misalignment",
        "angular_b",
        axes("angle", "rad", "angular sensor turned about", 2e-3),
        misaligned("angular_b"),
        "reading",
    ),
    Effect(
        "accelerometer.angular_current_leak",
        "angular_b",
        tuple(Parameter(n, "rad s-2 A-1 m-2", f"reading about {n[0]} per dipole along {n[-1]}", 1e-8) for n in _PAIRS),
        coupled("dipole_b"),
        "coupling of the torquer currents into the electronics",
    ),
    Effect(
        "accelerometer.cross_talk",
        "linear_b",
        tuple(Parameter(n, "1", f"share of {n[0]} read by {n[1]} and of {n[1]} by {n[0]}", 1e-2) for n in _BOTH),
        _crosstalk,
        "electrode cross-talk",
    ),
    Effect(
        "accelerometer.temperature",
        "linear_b",
        axes("", "m s-2", "change from long night to long day of", 1e-9),
        _temperature,
        "reading against sunlight with a lag of 600 s",
    ),
    Effect(
        "accelerometer.flexible_mode",
        "linear_b",
        (
            Parameter("frequency", "Hz", "own frequency", 0.01, neutral=0.5, lower=0.0),
            Parameter("damping", "1", "damping ratio", 0.01, neutral=0.02, lower=0.0),
            *axes("", "m s-2 A-1 m-2", "ringing per dipole of", 1e-11),
        ),
        _flexible,
        "appendage driven by the torque steps",
        linear=False,
    ),
)
