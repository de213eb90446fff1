"""Star camera, magnetometer and time tags: what they read of the true attitude and field, and when.

A delay is that of a payload against the torquer telemetry.
"""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Context, Effect, Parameter, axes, constant, coupled, misaligned, scaled


def _external(context: Context, values):
    """Uniform field along the moment of the main dipole, as that of a ring current."""
    return values[0] * context.extra["axis_b"]


_REFERENCE = "CoM paper, erratum C-10: a lag of tau scales a 12 s signal by cos(2 pi tau / 12 s)"


def _late(context, values):
    return np.full(np.shape(context.time), values[0])


def _ramp(context, values):
    return values[0] * (context.time - context.epoch)


def _delay(slug: str, channel: str, what: str) -> Effect:
    parameter = Parameter("delay", "s", f"{what} tags are late by", 0.1)
    return Effect(slug, channel, (parameter,), _late, _REFERENCE)


_PAIRS = tuple(f"{a}_from_{b}" for a in "xyz" for b in "xyz")

TIMING = (
    _delay("timing.accelerometer_delay", "acc_delay", "accelerometer"),
    _delay("timing.star_camera_delay", "sca_delay", "star camera"),
    _delay("timing.magnetometer_delay", "mag_delay", "magnetometer and torquer telemetry"),
    _delay("timing.thruster_delay", "thr_delay", "thruster telemetry"),
    Effect(
        "timing.clock_drift",
        "acc_delay",
        (Parameter("rate", "s s-1", "accelerometer tags run late at", 1e-6),),
        _ramp,
        "receiver clock, GRACE-FO CLK1B drift is of order 1e-8 s/s",
    ),
)
EFFECTS = (
    Effect(
        "attitude.star_camera_misalignment",
        "pointing_b",
        axes("angle", "rad", "measured frame turned about", 1e-4),
        constant,
        "mounting of the heads",
    ),
    Effect("magnetometer.bias", "field_b", axes("", "T", "bias of", 5e-7), constant, "CoM paper section 4.1"),
    Effect(
        "magnetometer.scale",
        "field_b",
        axes("", "1", "relative excess of the scale of", 0.01),
        scaled("field_b"),
        "reading",
    ),
    Effect(
        "magnetometer.misalignment",
        "field_b",
        axes("angle", "rad", "turned about", 5e-3),
        misaligned("field_b"),
        "mounting",
    ),
    Effect(
        "magnetometer.current_leak",
        "field_b",
        tuple(Parameter(n, "T A-1 m-2", f"reading of {n[0]} per dipole along {n[-1]}", 1e-8) for n in _PAIRS),
        coupled("dipole_b"),
        "stray field of the rods",
    ),
    Effect(
        "magnetometer.external_field",
        "field_b",
        (Parameter("strength", "T", "uniform field along the moment of the main dipole", 3e-8),),
        _external,
        "ring current, of the order of the Dst index",
    ),
)
