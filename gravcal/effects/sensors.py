"""Effects on time tags, star camera and magnetometer.

A delay is that of a payload against the torquer telemetry.
"""

import numpy as np

from gravcal.effects.base import (
    REVERSED,
    Laws,
    Parameter,
    axes,
    constant,
    coupled,
    misaligned,
    pairs,
    scaled,
    symmetric,
    warming,
)

TIMING, EFFECTS = Laws(), Laws()
_REFERENCE = "CoM paper, erratum C-10: a lag of tau scales a 12 s signal by cos(2 pi tau / 12 s)"
_CLOCK = "receiver clock, GRACE-FO CLK1B drift is of order 1e-8 s/s"


for _word, _channel, _what in (
    ("accelerometer", "acc_delay", "accelerometer"),
    ("star_camera", "sca_delay", "star camera"),
    ("magnetometer", "mag_delay", "magnetometer and torquer telemetry"),
    ("thruster", "thr_delay", "thruster telemetry"),
    ("orbit", "orbit_delay", "orbit"),
):
    _delay = Parameter("delay", "s", f"{_what} tags are late by", 0.1)
    TIMING.law(f"timing.{_word}_delay", _channel, (_delay,), _REFERENCE)(lambda c, v: np.full(np.shape(c.time), v[0]))

_RATE = Parameter("rate", "s s-1", "accelerometer tags run late at", 1e-6)
TIMING.law("timing.clock_drift", "acc_delay", (_RATE,), _CLOCK)(lambda c, v: v[0] * (c.time - c.epoch))
law = EFFECTS.law
_ANGLE = axes("angle", "rad", "measured frame turned about", 1e-4)
law("attitude.star_camera_misalignment", "pointing_b", _ANGLE, "mounting of the heads")(constant)
_SHARE = Parameter("share", "1", "bias between heads that SCA1A shows, left in the attitude", 1.0)
law("attitude.star_camera_heads", "heads_b", (_SHARE,), "mounting of the heads against each other")(
    lambda c, v: v[0] * c.extra["heads_b"]
)
law("magnetometer.bias", "field_b", axes("", "T", "bias of", 5e-7), "CoM paper section 4.1")(constant)
_SCALE = axes("", "1", "relative excess of the scale of", 0.01, lower=REVERSED)
law("magnetometer.scale", "field_b", _SCALE, "reading")(scaled("field_b"))
_ANGLE = axes("angle", "rad", "magnetometer turned about", 5e-3)
law("magnetometer.misalignment", "field_b", _ANGLE, "mounting")(misaligned("field_b"))
_SKEW = tuple(
    Parameter(a, "rad", f"half of what {a[0]} and {a[1]} are out of square by", 5e-3) for a in ("xy", "xz", "yz")
)
law("magnetometer.nonorthogonality", "field_b", _SKEW, "construction")(lambda c, v: c.field_b @ symmetric(*v))
_LEAK = pairs("T A-1 m-2", "reading of {0[0]} per dipole along {0[7]}", 1e-8)
law("magnetometer.current_leak", "field_b", _LEAK, "stray field of the rods")(coupled("dipole_b"))
_STRENGTH = Parameter("strength", "T", "uniform field along the moment of the main dipole", 3e-8)
# Uniform field along the moment of the main dipole, as that of a ring current.
law("magnetometer.external_field", "field_b", (_STRENGTH,), "ring current, of the order of the Dst index")(
    lambda c, v: v[0] * c.extra["axis_b"]
)
_SUN = "Olsen 2021, doi 10.1186/s40623-021-01373-9: temperature by the Sun; here by sunlight with a lag of 600 s"
_WARMING = axes("", "T", "change from long night to long day of", 2e-8)
law("magnetometer.temperature_bias", "field_b", _WARMING, _SUN)(warming)
_WARMING = axes("", "1", "relative change of the scale from long night to long day of", 5e-4)
law("magnetometer.temperature_scale", "field_b", _WARMING, _SUN)(lambda c, v: c.field_b * warming(c, v))
#: Effects that change too slowly to show in a record of minutes.
OF_WARMTH = ("magnetometer.temperature_bias", "magnetometer.temperature_scale")
#: Effects on the reading of a magnetometer, and its tags: all that it shows beside the main field.
OF_MAGNETOMETER = (*(e.slug for e in EFFECTS if e.slug.startswith("magnetometer.")), "timing.magnetometer_delay")
