"""Effects on the torque: errors of the dipole of the torque rods, and torques that are not commanded."""

import numpy as np

from gravcal.effects.base import REVERSED, Context, Laws, Parameter, axes, constant, each, scaled, symmetric
from gravcal.effects.drivers import lagged
from gravcal.physics.dynamics import gravity_gradient_torque

EFFECTS = Laws()
law = EFFECTS.law
_DIPOLE = "t = m x B, CoM paper eq. 18"
_EULER = "Euler's equation, CoM paper eq. 17"
_RODS = "CoM paper section 2.1: rods aligned to 0.06 deg"

_GAIN = axes("rod", "1", "relative excess of the dipole of rod", 0.05, lower=REVERSED)
law("torque.dipole_gain", "dipole_b", _GAIN, _DIPOLE)(scaled("dipole_b"))
# All rods turned by the small rotation v: dm = v x m.
law("torque.dipole_misalignment", "dipole_b", axes("angle", "rad", "rods turned about", 2e-3), _RODS)(
    lambda c, v: np.cross(v, c.dipole_b)
)
_TAU = Parameter("tau", "s", "time constant of the rods", 0.1, lower=0.0)


@law("torque.dipole_lag", "dipole_b", (_TAU,), "inductance of a torque rod: first-order lag", linear=False)
def _lag(context: Context, values):
    """Dipole change (n, 3) A m2 by a lag tau dm/dt = m_commanded - m, exact for a dipole constant between epochs."""
    if values[0] <= 0:
        return np.zeros_like(context.dipole_b)
    held = np.concatenate([context.dipole_b[:1], context.dipole_b[:-1]]).astype(float)  # from the epoch before on
    return np.stack([lagged(context.time, axis.copy(), values[0]) for axis in held.T], axis=1) - context.dipole_b


def lag_missing(edges: np.ndarray, dipole_b: np.ndarray, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Commanded minus actual dipole (m + 1, 3) of lagging rods after each edge (m + 1,) s, and the commanded jumps."""
    jump = np.diff(dipole_b, axis=0, prepend=np.zeros((1, 3)), append=np.zeros((1, 3)))
    missing, decay = jump.copy(), np.exp(-np.diff(edges) / tau)
    for k in range(1, len(jump)):
        missing[k] += missing[k - 1] * decay[k - 1]
    return missing, jump


def lagging(time, edges, dipole, missing, tau, leads):
    """Dipole (n, 3, q) A m2 of lagging rods at epochs (n,) s, with edges earlier by each of the leads (q,) s."""
    shifted = time[:, None] + leads
    interval = np.searchsorted(edges, shifted, side="right") - 1
    decay = np.exp(-np.maximum(shifted - edges[interval], 0.0) / tau)[:, :, None]
    actual = np.concatenate([dipole, np.zeros((1, 3))])[interval] - missing[interval] * decay
    return np.moveaxis(np.where(interval[:, :, None] < 0, 0.0, actual), 2, 1)


def lag_swing(edges: np.ndarray, dipole_b: np.ndarray, shift: float, time: np.ndarray, tau: float) -> np.ndarray:
    """Double time integral (n, 3) A m2 s2 of the dipole of rods that lag by tau minus ideal ones with edges + shift.

    Edges (m + 1,) s, dipole_b (m, 3) between. Rods that lag start at edges + shift - tau: a jump D gives
    D (t^2 / 2 - tau t + tau^2 (1 - exp(-t / tau))), an ideal rod D (t - tau)^2 / 2 from tau on.
    """
    missing, jump = lag_missing(edges, dipole_b, tau)
    edges = edges + (shift - tau)
    interval = np.searchsorted(edges, time, side="right") - 1
    since_edge = np.where(interval >= 0, time - edges[interval], np.inf)[:, None]
    after = time[:, None] - edges
    early = np.where((after >= 0) & (after < tau), (after - tau) ** 2 / 2, 0.0) @ jump
    inside = ((interval >= 0) & (interval < len(dipole_b)))[:, None]
    settled = tau**2 / 2 * np.where(inside, dipole_b[np.clip(interval, 0, len(dipole_b) - 1)], 0.0)
    return settled - tau**2 * missing[interval] * np.exp(-since_edge / tau) + early


_LIMIT = Parameter("limit", "A m2", "largest dipole of a rod", 1.0, neutral=np.inf, lower=0.0)
# The dipole of a rod does not exceed the limit; the neutral limit is infinite.
law("torque.saturation", "dipole_b", (_LIMIT,), "core saturation", linear=False)(
    lambda c, v: np.clip(c.dipole_b, -v[0], v[0]) - c.dipole_b
)
_RESIDUAL = axes("", "A m2", "constant dipole of the satellite along", 0.5)
law("torque.residual_dipole", "dipole_b", _RESIDUAL, _DIPOLE)(constant)
law("torque.constant", "torque_b", axes("", "N m", "constant torque about", 1e-6), "none")(constant)
_ARM = axes("arm", "m", "centre of mass to centre of pressure along", 0.02)
# Lever arm of the centre of pressure times the non-gravitational force: t = m r x a.
law("torque.aerodynamic", "torque_b", _ARM, "S-GRS paper eq. 11")(
    lambda c, v: c.extra["mass"] * np.cross(v, c.extra["non_gravitational_b"])
)
_MOMENT = axes("", "1", "relative excess of the principal moment about", 0.05, lower=-1.0)
# Moments larger than known by a share e answer the torquers less: t = -e/(1 + e) m x B about each axis.
law("torque.inertia", "torque_b", _MOMENT, f"{_EULER}; no inertia is published", linear=False)(
    lambda c, v: -np.asarray(v) / (1 + np.asarray(v)) * np.cross(c.dipole_b, c.field_b)
)
_PRODUCTS = each(("xy", "xz", "yz"), "kg m2", "product of inertia J_{0}", 5.0)
# Products of inertia that the model has not: t = -P J^-1 (m x B).
law("torque.inertia_products", "torque_b", _PRODUCTS, _EULER)(
    lambda c, v: -(symmetric(*v) @ np.linalg.solve(c.inertia_b, np.cross(c.dipole_b, c.field_b).T)).T
)
_EXCESS = axes("", "1", "relative excess of the gravity-gradient torque about", 0.05, lower=-1.0)
# Excess of the gravity-gradient torque, vex(J G - G J).
law("torque.gravity_gradient", "torque_b", _EXCESS, "S-GRS paper eq. 1; equations.md (M2)")(
    lambda c, v: np.asarray(v) * gravity_gradient_torque(c.inertia_b, c.gradient_b)
)
_ARM = axes("arm", "m", "centre of mass to centre of radiation pressure along", 0.05)
# Lever arm of the centre of radiation pressure times its force: t = m r x a.
law("torque.radiation", "torque_b", _ARM, "S-GRS paper eq. 11, with the force of sunlight")(
    lambda c, v: c.extra["mass"] * np.cross(v, c.extra["radiation_b"])
)
_DAMPING = Parameter("coefficient", "N m s T-2", "damping", 500.0)
# Induced currents damp rotation across the field: t = -c B x (w x B).
law("torque.eddy_current", "torque_b", (_DAMPING,), "induction in the structure")(
    lambda c, v: -v[0] * np.cross(c.field_b, np.cross(c.rate_b, c.field_b))
)
_IMPULSE = axes("share", "1", "impulse of the attitude thrusters, in units of the nominal one, about", 1.0)
_THRUSTERS = "lever arm x force x time on of THR1B; thruster table of the JPL reader, release of 2010-03-31"
# Angular impulse of each firing, as a share of the nominal one; the epochs of the context are the firings.
law("torque.thruster_firings", "impulse_b", _IMPULSE, _THRUSTERS)(lambda c, v: c.extra["nominal_impulse_b"] * v)
