"""Ranging: what the microwave or laser link reads beside the distance of the phase centres.

The context of these effects holds, beside the time, `extra["angle"]` (n, 2, 2) rad: pitch and yaw of both satellites
against the line of sight; `extra["range"]` (n,) m and `extra["range_rate"]` (n,) m s-1. `context.epoch` is noon.
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


def _missing(context: Context, values):
    """The reading less the antenna correction, which is added to it: rho_KBR = rho_COM - correction."""
    return -context.extra["antenna_correction"] * values[0]


def _centre(context: Context, values):
    """Phase centres away from those of the correction; lines of sight from each satellite to the other."""
    return -context.extra["line_of_sight_b"].reshape(-1, 6) @ np.asarray(values)


def _drift(context: Context, values):
    """Phase centres that move along; at `context.epoch` they are where the calibration says."""
    return (context.time - context.epoch) * _centre(context, values)


def _curvature(context: Context, values):
    """Phase front that is no sphere about the phase centre; the sum of both axes of a satellite is its x."""
    return context.extra["angle"].reshape(-1, 4) ** 2 @ np.asarray(values)


def _mounting(context: Context, values):
    """Star cameras turned: the arm x of the antenna is seen along y and z, R_A c_A moves by v x c."""
    line, arm = context.extra["line_of_sight_b"], context.extra["antenna_x"]
    levers = np.stack([-line[:, 0, 2] * arm[0], line[:, 0, 1] * arm[0]], axis=1)
    others = np.stack([-line[:, 1, 2] * arm[1], line[:, 1, 1] * arm[1]], axis=1)
    return -np.concatenate([levers, others], axis=1) @ np.asarray(values)


def _orbit(cycles):
    """Cosine and sine of a multiple of the argument of latitude."""

    def contribution(context: Context, values):
        angle = cycles * context.extra["argument"]
        return np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.asarray(values)

    return contribution


def _thermal(context: Context, values):
    return context.extra["warmth"] * values[0]


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
    Effect(
        "ranging.antenna_correction",
        "range",
        (Parameter("share", "1", "share of the antenna correction that is left out", 1.0),),
        _missing,
        "10.3390/rs14143395, eqs. 10-11 (erratum K-1)",
    ),
    Effect(
        "ranging.phase_centre",
        "range",
        tuple(
            Parameter(f"{a}_{k}", "m", f"phase centre of {k} further along {a} by", 1e-3) for k in "ab" for a in "xyz"
        ),
        _centre,
        "10.3390/rs14143395, eq. 13 (erratum K-1)",
    ),
    Effect(
        "ranging.phase_centre_drift",
        "range",
        tuple(
            Parameter(f"{a}_{k}", "m s-1", f"phase centre of {k} moves along {a} at", 1e-8) for k in "ab" for a in "xyz"
        ),
        _drift,
        "a millimetre a day; assumed, no source prints one",
    ),
    Effect(
        "ranging.phase_centre_curvature",
        "range",
        tuple(Parameter(n, "m rad-2", f"reading is longer by this times the square of {n}", 5e-4) for n in _PLACES),
        _curvature,
        "phase centre that differs by twice this between the planes; assumed, no source prints one",
    ),
    Effect(
        "ranging.star_camera_misalignment",
        "range",
        tuple(Parameter(n, "rad", f"attitude in error about {n}", 3e-4) for n in _PLACES),
        _mounting,
        "arm of the antenna times the angle",
    ),
    Effect(
        "ranging.once_per_revolution",
        "range",
        tuple(
            Parameter(n, "m", f"orbit error with the {n} of the argument of latitude", 3e-3) for n in ("cosine", "sine")
        ),
        _orbit(1),
        "resonance of orbit errors, 10.3390/rs14143395, Sec. 4.1",
    ),
    Effect(
        "ranging.slow_orbit_error",
        "range",
        tuple(
            Parameter(n, "m", f"orbit error with the {n} of twice the argument of latitude", 3e-3)
            for n in ("cosine", "sine")
        ),
        _orbit(2),
        "reduced-dynamic orbits, 2 cycles per revolution; 10.3390/rs14143395, Sec. 4.1",
    ),
    Effect(
        "ranging.thermal",
        "range",
        (Parameter("swing", "m", "reading is longer in full sunlight by", 1e-5),),
        _thermal,
        "warming of horn and wave guide",
    ),
)
