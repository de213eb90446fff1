"""Time tags: delays of the payloads against the torquer telemetry."""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Effect, Parameter

_REFERENCE = "CoM paper, erratum C-10: a lag of tau scales a 12 s signal by cos(2 pi tau / 12 s)"


def _constant(context, values):
    return np.full(np.shape(context.time), values[0])


def _ramp(context, values):
    return values[0] * (context.time - context.epoch)


def _delay(slug: str, channel: str, what: str) -> Effect:
    parameter = Parameter("delay", "s", f"{what} tags are late by", 0.1)
    return Effect(slug, channel, (parameter,), _constant, _REFERENCE)


EFFECTS = (
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
