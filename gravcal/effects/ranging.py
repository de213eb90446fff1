"""Effects on the range of the microwave or laser link, beside the distance of the phase centres.

The context of these effects holds, beside the time, `extra["angle"]` (n, 2, 2) rad: pitch and yaw of both satellites
against the line of sight; `extra["range"]` (n,) m and `extra["range_rate"]` (n,) m s-1. `context.epoch` is noon of a
simulated day, and in a calibration the middle of its manoeuvres.
"""

import numpy as np

from gravcal.effects.base import Context, Laws, Parameter, each

EFFECTS = Laws()
#: Band limits of noise in the antenna correction, from orbit errors to the cut-off of the ranging filter.
BANDS_HZ = (5e-3, 1e-2, 2e-2, 4e-2, 8e-2, 1e-1)
BREAK_GAP_S = 36.0  # on either side of a phase break, which the filter does not bridge
RIPPLE = np.radians(1.2)  # rad, angular period of the standing wave unless given; no source prints one
_PAPER = "10.3390/rs14143395"
_PLACES = tuple(f"{axis}_{letter}" for letter in "ab" for axis in ("pitch", "yaw"))
_CENTRES = tuple(f"{axis}_{letter}" for letter in "ab" for axis in "xyz")


def law(word, parameters, reference, **more):
    """Decorator that adds an effect on the range."""
    return EFFECTS.law(f"ranging.{word}", "range", parameters, reference, **more)


_HORN = f"standing wave of the horn; {_PAPER}, Sec. 4.2 supposes multipath"


_RIPPLES = each(_PLACES, "m", "sine of the reading's ripple with {0}", 5e-6)
_RIPPLES += each([f"cosine_{place}" for place in _PLACES], "m", "cosine, less one, of that ripple: {0}", 5e-6)
_PERIOD = Parameter("period", "rad", "angle from crest to crest of the ripple", 0.01 * RIPPLE, RIPPLE, 1e-4)
law("multipath", (*_RIPPLES, _PERIOD), _HORN, linear=False)(
    lambda c, v: ripples(c.extra["angle"], v[8]) @ np.asarray(v[:8])
)


def ripples(angle: np.ndarray, period: float) -> np.ndarray:
    """Sines, then cosines minus one, (n, 8), of pitch and yaw of both satellites (n, 2, 2) rad; period in rad."""
    phase = 2 * np.pi * angle.reshape(-1, 4) / period
    return np.concatenate([np.sin(phase), np.cos(phase) - 1], axis=1)


_SIZE = Parameter("size", "m", "reading is longer after the break by", 0.01), Parameter("time", "s", "GPS time", 1.0)
law("phase_break", _SIZE, "lost cycles of the carrier; KBR1B quality bit 0", linear=False)(
    lambda c, v: np.where(c.time >= v[1], v[0], 0.0)
)
law("delay", each(("delay",), "s", "ranging tags are late by", 1e-4), "receiver clock against GPS time")(
    lambda c, v: -c.extra["range_rate"] * v[0]
)
_EXCESS = each(("excess",), "1", "relative excess of the reading", 1e-8)
law("scale", _EXCESS, "oscillator frequency; LRI1B gives 6.5e-8 for the laser")(lambda c, v: c.extra["range"] * v[0])
_LEFT_OUT = each(("share",), "1", "share of the antenna correction that is left out", 1.0)
# The reading less the antenna correction, which is added to it: rho_KBR = rho_COM - correction.
law("antenna_correction", _LEFT_OUT, f"{_PAPER}, eqs. 10-11 (erratum K-1)")(
    lambda c, v: -c.extra["antenna_correction"] * v[0]
)
_PAIRS = zip(BANDS_HZ, BANDS_HZ[1:], strict=False)
_BANDS = [f"share_{1e3 * low:g}_{1e3 * high:g}_mhz" for low, high in _PAIRS]
_BANDS = each(_BANDS, "1", "noise in the antenna correction, as a share of it, {0},", 1.0)
_NOISY = "Inacio et al., Earth Planets Space 67 (2015); Goswami et al., Adv. Space Res. 62 (2018)"
# What no motion is of the correction that is added; extra["correction_band"] (n, b) m, its parts by band.
EFFECTS.law("attitude.star_camera_noise", "range", _BANDS, _NOISY)(
    lambda c, v: c.extra["correction_band"] @ np.asarray(v)
)
_FURTHER = each(_CENTRES, "m", "phase centre of {0[2]} further along {0[0]} by", 1e-3)


@law("phase_centre", _FURTHER, f"{_PAPER}, eq. 13 (erratum K-1)")
def _centre(context: Context, values):
    """Change (n,) m of the range by phase-centre errors, values (6,) m; lines of sight to the other satellite."""
    return -context.extra["line_of_sight_b"].reshape(-1, 6) @ np.asarray(values)


_SPEED = each(_CENTRES, "m s-1", "phase centre of {0[2]} moves along {0[0]} at", 1e-8)
# Phase centres that move along; at `context.epoch` they are where the calibration says.
law("phase_centre_drift", _SPEED, "a millimetre a day; assumed, no source prints one")(
    lambda c, v: (c.time - c.epoch) * _centre(c, v)
)
_SQUARE = each(_PLACES, "m rad-2", "excess of the reading over the square of {0}", 5e-4)
_PLANES = "phase centre that differs by twice this between the planes; assumed, no source prints one"
# Phase front that is no sphere about the phase centre, in the direction cosines that y and z are the first order of.
law("phase_centre_curvature", _SQUARE, _PLANES)(
    lambda c, v: c.extra["line_of_sight_b"][:, :, [2, 1]].reshape(-1, 4) ** 2 @ np.asarray(v)
)
_TURN = each(_PLACES, "rad", "error of the attitude, {0},", 3e-4)


@law("star_camera_misalignment", _TURN, "arm of the antenna turned by the angle", linear=False)
def _mounting(context: Context, values):
    """Range change (n,) m by star cameras turned by v = (0, pitch, yaw): c_A moves by v x c and its second order."""
    turn = np.reshape(values, (2, 2))
    total_angle = np.linalg.norm(turn, axis=1)
    across = np.sinc(total_angle / np.pi)[:, None] * turn[:, ::-1] * [1.0, -1.0]
    displacement = context.extra["antenna_x"][:, None] * np.column_stack([np.cos(total_angle) - 1, across])
    return -np.einsum("nka,ka->n", context.extra["line_of_sight_b"], displacement)


def _orbit(cycles):
    """Contribution of cosine and sine, values (2,) m, of `cycles` times the argument of latitude."""

    def contribution(context: Context, values):
        angle = cycles * context.extra["argument"]
        return np.stack([np.cos(angle), np.sin(angle)], axis=1) @ np.asarray(values)

    return contribution


_ORBIT = each(("cosine", "sine"), "m", "orbit error with the {0} of the argument of latitude", 3e-3)
law("once_per_revolution", _ORBIT, f"resonance of orbit errors, {_PAPER}, Sec. 4.1")(_orbit(1))
_ORBIT = each(("cosine", "sine"), "m", "orbit error with the {0} of twice the argument of latitude", 3e-3)
_REDUCED = f"reduced-dynamic orbits, 2 cycles per revolution; {_PAPER}, Sec. 4.1"
law("slow_orbit_error", _ORBIT, _REDUCED)(_orbit(2))
_SWING = each(("swing",), "m", "reading is longer in full sunlight by", 1e-5)
law("thermal", _SWING, "warming of horn and wave guide")(lambda c, v: c.extra["warmth"] * v[0])
