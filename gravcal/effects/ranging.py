"""Ranging: what the microwave or laser link reads beside the distance of the phase centres.

The context of these effects holds, beside the time, `extra["angle"]` (n, 2, 2) rad: pitch and yaw of both satellites
against the line of sight; `extra["range"]` (n,) m and `extra["range_rate"]` (n,) m s-1.
"""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Context, Effect, Parameter

RIPPLE = np.radians(1.2)  # rad, angular period of the standing wave; assumed, no source prints one


def _multipath(context: Context, values):
    wave = np.sin(2 * np.pi * context.extra["angle"].reshape(-1, 4) / RIPPLE)
    return wave @ np.asarray(values)


def _break(context: Context, values):
    size, time = values
    return np.where(context.time >= time, size, 0.0)


def _delay(context: Context, values):
    return -context.extra["range_rate"] * values[0]


def _scale(context: Context, values):
    return context.extra["range"] * values[0]


_PLACES = tuple(f"{axis}_{letter}" for letter in "ab" for axis in ("pitch", "yaw"))

EFFECTS = (
    Effect(
        "ranging.multipath",
        "range",
        tuple(Parameter(n, "m", f"amplitude of the reading's ripple with {n}", 5e-6) for n in _PLACES),
        _multipath,
        "standing wave of the horn; 10.3390/rs14143395, Sec. 4.2 supposes multipath",
    ),
    Effect(
        "ranging.phase_break",
        "range",
        (Parameter("size", "m", "reading is longer after the break", 0.01), Parameter("time", "s", "GPS time", 1.0)),
        _break,
        "lost cycles of the carrier; KBR1B quality bit 0",
        linear=False,
    ),
    Effect(
        "ranging.delay",
        "range",
        (Parameter("delay", "s", "ranging tags are late by", 1e-4),),
        _delay,
        "receiver clock against GPS time",
    ),
    Effect(
        "ranging.scale",
        "range",
        (Parameter("excess", "1", "reading is longer by this share", 1e-8),),
        _scale,
        "oscillator frequency; LRI1B gives 6.5e-8 for the laser",
    ),
)
