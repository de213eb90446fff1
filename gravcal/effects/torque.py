"""Torques: the dipole that the rods really make, and torques that are not commanded."""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Context, Effect, Parameter, axes, constant, scaled
from gravcal.physics.dynamics import gravity_gradient_torque


def _misalignment(context: Context, values):
    """Rods turned together by the small rotation v: dm = v x m."""
    return np.cross(values, context.dipole_b)


def _lag(context: Context, values):
    """First-order lag: tau dm/dt = m_commanded - m, exact for a dipole constant between epochs."""
    from gravcal.effects.kernels import lagged

    if values[0] <= 0:
        return np.zeros_like(context.dipole_b)
    decay = np.exp(-np.diff(context.time, prepend=context.time[0]) / values[0])
    commanded = np.ascontiguousarray(context.dipole_b, dtype=float)
    return lagged(commanded, decay) - commanded


def _saturation(context: Context, values):
    """The dipole of a rod does not exceed the limit; the neutral limit is infinite."""
    return np.clip(context.dipole_b, -values[0], values[0]) - context.dipole_b


def _aerodynamic(context: Context, values):
    """Lever arm of the centre of pressure times the non-gravitational force: t = m r x a."""
    return context.extra["mass"] * np.cross(values, context.extra["non_gravitational_b"])


def _inertia(context: Context, values):
    """Moments larger than known by a share e answer the torquers less: t = -e/(1 + e) m x B about each axis."""
    return -np.asarray(values) / (1 + np.asarray(values)) * np.cross(context.dipole_b, context.field_b)


def _products(context: Context, values):
    """Products of inertia that the model has not: t = -P J^-1 (m x B)."""
    xy, xz, yz = values
    matrix = np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    alpha = np.linalg.solve(context.inertia_b, np.cross(context.dipole_b, context.field_b).T).T
    return -np.matvec(matrix, alpha)


def _gravity_gradient(context: Context, values):
    """Excess of the gravity-gradient torque, vex(J G - G J)."""
    return np.asarray(values) * gravity_gradient_torque(context.inertia_b, context.gradient_b)


def _radiation(context: Context, values):
    """Lever arm of the centre of radiation pressure times its force: t = m r x a."""
    return context.extra["mass"] * np.cross(values, context.extra["radiation_b"])


def _eddy(context: Context, values):
    """Induced currents damp rotation across the field: t = -c B x (w x B)."""
    return -values[0] * np.cross(context.field_b, np.cross(context.rate_b, context.field_b))


def _firings(context: Context, values):
    """Angular impulse of each firing, as a share of the nominal one; the epochs of the context are the firings."""
    return context.extra["nominal_impulse_b"] * values


_DIPOLE = "t = m x B, CoM paper eq. 18"

EFFECTS = (
    Effect(
        "torque.dipole_gain",
        "dipole_b",
        axes("rod", "1", "relative excess of the dipole of rod", 0.05),
        scaled("dipole_b"),
        _DIPOLE,
    ),
    Effect(
        "torque.dipole_misalignment",
        "dipole_b",
        axes("angle", "rad", "rods turned about", 2e-3),
        _misalignment,
        "CoM paper section 2.1: rods aligned to 0.06 deg",
    ),
    Effect(
        "torque.dipole_lag",
        "dipole_b",
        (Parameter("tau", "s", "time constant of the rods", 0.1, lower=0.0),),
        _lag,
        "inductance of a torque rod: first-order lag",
        linear=False,
    ),
    Effect(
        "torque.saturation",
        "dipole_b",
        (Parameter("limit", "A m2", "largest dipole of a rod", 1.0, neutral=np.inf),),
        _saturation,
        "core saturation",
        linear=False,
    ),
    Effect(
        "torque.residual_dipole",
        "dipole_b",
        axes("", "A m2", "constant dipole of the satellite along", 0.5),
        constant,
        _DIPOLE,
    ),
    Effect("torque.constant", "torque_b", axes("", "N m", "constant torque about", 1e-6), constant, "none"),
    Effect(
        "torque.aerodynamic",
        "torque_b",
        axes("arm", "m", "centre of mass to centre of pressure along", 0.02),
        _aerodynamic,
        "S-GRS paper eq. 11",
    ),
    Effect(
        "torque.inertia",
        "torque_b",
        axes("", "1", "relative excess of the principal moment about", 0.05),
        _inertia,
        "Euler's equation, CoM paper eq. 17; no inertia is published",
        linear=False,
    ),
    Effect(
        "torque.inertia_products",
        "torque_b",
        tuple(Parameter(n, "kg m2", f"product of inertia J_{n}", 5.0) for n in ("xy", "xz", "yz")),
        _products,
        "Euler's equation, CoM paper eq. 17",
    ),
    Effect(
        "torque.gravity_gradient",
        "torque_b",
        axes("", "1", "relative excess of the gravity-gradient torque about", 0.05),
        _gravity_gradient,
        "S-GRS paper eq. 1; equations.md (M2)",
    ),
    Effect(
        "torque.radiation",
        "torque_b",
        axes("arm", "m", "centre of mass to centre of radiation pressure along", 0.05),
        _radiation,
        "S-GRS paper eq. 11, with the force of sunlight",
    ),
    Effect(
        "torque.eddy_current",
        "torque_b",
        (Parameter("coefficient", "N m s T-2", "damping", 500.0),),
        _eddy,
        "induction in the structure",
    ),
    Effect(
        "torque.thruster_firings",
        "impulse_b",
        axes("share", "1", "impulse of the attitude thrusters, in units of the nominal one, about", 1.0),
        _firings,
        "lever arm x force x time on of THR1B; thruster table of the JPL reader, release of 2010-03-31",
    ),
)
