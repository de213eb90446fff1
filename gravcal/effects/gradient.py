"""Effects on sensors that feel the gravity gradient: a place that is not where it is stated, a field that is off.

Contributions are (n, sensors, 3), as an accelerometer reads them. The context holds `extra["positions"]`
(sensors, 3) m and `extra["tesseral_b"]` (n, 2, 3, 3) s-2, gravity gradient of C_nm = 1 and of S_nm = 1. A centre of
pressure that is not where it is stated is `torque.aerodynamic`.
"""

import numpy as np

from gravcal.effects.base import Context, Laws, Parameter, axes
from gravcal.physics.sensing import offset_tensor

SOURCE = "S-GRS paper, eqs. 4-10 (errata S-2, S-3, S-5)"
EFFECTS = Laws()
law = EFFECTS.law

_PLACE = axes("", "m", "distance of both test masses from their place along", 1e-3)


@law("gradient.mounting", "linear_each_b", _PLACE, SOURCE)
def _mounting(context: Context, values):
    """Both sensors moved by the same vector: what eq. 10 takes to be zero, as an accelerometer reads it."""
    tensor = offset_tensor(context.rate_b, context.rate_dot_b, context.gradient_b)
    return _each(context, np.matvec(tensor, values))


_SHARE = (Parameter("scale", "1", "relative excess of the gravity gradient", 1e-3),)


@law("gradient.field_scale", "linear_each_b", _SHARE, SOURCE)
def _field_scale(context: Context, values):
    """Gravity gradient larger than modelled, felt at each sensor's place."""
    places = context.extra["positions"]
    return np.stack([-values[0] * np.matvec(context.gradient_b, place) for place in places], axis=1)


_WAVE = (
    Parameter("cosine", "1", "excess of C_nm, of degree and order 2 if no others are named,", 1e-8),
    Parameter("sine", "1", "excess of S_nm, likewise,", 1e-8),
)


@law("gradient.tesseral", "linear_each_b", _WAVE, SOURCE)
def _tesseral(context: Context, values):
    """Gradient of coefficients that the model does not know, felt at each sensor's place."""
    tensor = np.einsum("p,npij->nij", np.asarray(values, dtype=float), context.extra["tesseral_b"])
    return np.stack([-np.matvec(tensor, place) for place in context.extra["positions"]], axis=1)


_BIAS = axes("", "rad s-2", "constant angular reading about", 1e-9)


@law("gradient.angular_bias", "angular_each_b", _BIAS, SOURCE)
def _angular_bias(context: Context, values):
    return _each(context, np.broadcast_to(values, context.rate_b.shape))


def _each(context, reading):
    """The same reading for every sensor, (n, sensors, 3)."""
    return np.repeat(reading[:, None, :], len(context.extra["positions"]), axis=1)
