"""Effects on a pair of accelerometers in the gravity gradient: errors of their positions and of the gravity field.

Contributions are (n, sensors, 3), as an accelerometer reads them. The context holds `extra["positions"]`
(sensors, 3) m and `extra["tesseral_b"]` (n, 2, 3, 3) s-2, gravity gradient of C_nm = 1 and of S_nm = 1. A centre of
pressure that is not where it is stated is `torque.aerodynamic`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gravcal.effects.base import Context, Effect, Laws, Parameter, axes
from gravcal.physics import frames, gravity
from gravcal.physics.constants import EARTH_RADIUS, GM
from gravcal.physics.sensing import offset_tensor

SOURCE = "S-GRS paper, eqs. 4-10 (errata S-2, S-3, S-5)"
EFFECTS = Laws()
law = EFFECTS.law

_PLACE = axes("", "m", "distance of both test masses from their place along", 1e-3)
# Both sensors displaced by the same vector, which eq. 10 takes to be zero.
law("gradient.mounting", "linear_each_b", _PLACE, SOURCE)(lambda c, v: _each(c, np.matvec(tensor(c), v)))
_APART = axes("", "m", "distance from the second test mass to the first beyond what is stated, along", 1e-3)
# Two sensors that are further apart than stated, half of it in each.
law("gradient.separation", "linear_each_b", _APART, SOURCE)(
    lambda c, v: (
        np.array([[0.5], [-0.5]] if len(c.extra["positions"]) == 2 else [[0.0]]) * np.matvec(tensor(c), v)[:, None]
    )
)
_SHARE = (Parameter("scale", "1", "relative excess of the gravity gradient", 1e-3),)
# Gravity gradient larger than modelled, at the position of each sensor.
law("gradient.field_scale", "linear_each_b", _SHARE, SOURCE)(
    lambda c, v: -v[0] * np.matvec(c.gradient_b[:, None], c.extra["positions"])
)
_WAVE = (
    Parameter("cosine", "1", "excess of C_nm, of degree and order 2 if no others are named,", 1e-8),
    Parameter("sine", "1", "excess of S_nm, likewise,", 1e-8),
)
# Gradient of tesseral coefficients that the model lacks, at the position of each sensor.
law("gradient.tesseral", "linear_each_b", _WAVE, SOURCE)(
    lambda c, v: -np.matvec(np.tensordot(v, c.extra["tesseral_b"], (0, 1))[:, None], c.extra["positions"])
)


def tesseral(position_e: np.ndarray, R_be: np.ndarray, degree: int = 2, order: int = 2) -> np.ndarray:
    """Gravity gradient (n, 2, 3, 3) s-2 in b of C_nm = 1 and of S_nm = 1, normalised, at (n, 3) m; R_be (n, 3, 3)."""
    unit, zero = np.zeros((2, degree + 1, degree + 1))
    unit[degree, order] = 1.0
    fields = (gravity.Field(GM, EARTH_RADIUS, *pair) for pair in ((unit, zero), (zero, unit)))
    return np.stack([gravity.rotate_tensor(R_be, gravity.gradient_e(field, position_e)) for field in fields], axis=1)


_BIAS = axes("", "rad s-2", "constant angular reading about", 1e-9)
law("gradient.angular_bias", "angular_each_b", _BIAS, SOURCE)(lambda c, v: _each(c, np.broadcast_to(v, c.rate_b.shape)))


def _each(context, reading):
    """Reading (n, sensors, 3) that is the same (n, 3) for every sensor of a Context."""
    return np.repeat(reading[:, None, :], len(context.extra["positions"]), axis=1)


def readings(about: Context, entry: Effect, law: Callable) -> dict[str, np.ndarray]:
    """{"linear" or "angular": (n, sensors or 1, 3, ...)}, contribution of `law`, Context -> array, to each sensor."""
    if entry.channel in ("linear_each_b", "angular_each_b"):
        return {entry.channel.removesuffix("_each_b"): law(about)}
    return {"angular": law(replace(about, angular_b=about.rate_dot_b))[:, None]} if entry.channel == "angular_b" else {}


def added_to_channels(about: Context, entry: Effect) -> dict[str, np.ndarray]:
    """{channel: (n, 3, q)}, partial derivatives of the observables of a pair of sensors by an effect's parameters, SI.

    Channels are "linear", the difference of both linear readings m s-2; "attitude", the star camera against the angular
    readings, rad s-2: what these gain the body has less; "torque" N m beside gravity gradient and control.
    """
    by_kind = readings(about, entry, entry.columns)
    if "linear" in by_kind:
        return {"linear": by_kind["linear"][:, -1] - by_kind["linear"][:, 0]}
    if "angular" in by_kind:
        return {"attitude": -by_kind["angular"].mean(axis=1)}
    if entry.channel == "torque_b":
        return {"torque": entry.columns(about)}
    if entry.channel == "dipole_b":
        return {"torque": np.cross(entry.columns(about), about.field_b[:, :, None], axis=1)}
    # a star camera that is turned: what it calls b is not the frame that the sensors read in
    turned = {"attitude": np.moveaxis(np.cross(about.rate_dot_b[:, None], np.eye(3)), 1, 2)}
    if len(about.extra["positions"]) == 2:
        T, crosses = tensor(about), [frames.cross_matrix(axis) for axis in np.eye(3)]
        turned["linear"] = np.stack([np.matvec(T @ c - c @ T, apart(about)) for c in crosses], axis=2)
    return turned


def apart(about: Context) -> np.ndarray:
    """Baseline (3,) m from the second sensor to the first."""
    return about.extra["positions"][0] - about.extra["positions"][1]


def tensor(about: Context) -> np.ndarray:
    """Tensor T (n, 3, 3) s-2 of the acceleration T p that a sensor at p from the centre of mass reads."""
    return offset_tensor(about.rate_b, about.rate_dot_b, about.gradient_b)


def reading_of(about: Context, sensor: int) -> np.ndarray:
    """Modelled reading (n, 3) m s-2 of the accelerometer with index `sensor`: non-gravitational part plus T p."""
    return about.extra["non_gravitational_b"] + np.matvec(tensor(about), about.extra["positions"][sensor])
