"""Star camera and magnetometer: what they read of the true attitude and field."""

from __future__ import annotations

import numpy as np

from gravcal.effects.base import Context, Effect, Parameter, axes


def _constant(context: Context, values):
    return np.broadcast_to(values, (*context.time.shape, 3)).copy()


def _scale(context: Context, values):
    return context.field_b * values


def _misalignment(context: Context, values):
    return np.cross(context.field_b, values)


def _current_leak(context: Context, values):
    return context.dipole_b @ np.asarray(values).reshape(3, 3).T


def _external(context: Context, values):
    """Uniform field along the moment of the main dipole, as that of a ring current."""
    return values[0] * context.extra["axis_b"]


_PAIRS = tuple(f"{a}_from_{b}" for a in "xyz" for b in "xyz")

EFFECTS = (
    Effect(
        "attitude.star_camera_misalignment",
        "pointing_b",
        axes("angle", "rad", "measured frame turned about", 1e-4),
        _constant,
        "mounting of the heads",
    ),
    Effect("magnetometer.bias", "field_b", axes("", "T", "bias of", 5e-7), _constant, "CoM paper section 4.1"),
    Effect("magnetometer.scale", "field_b", axes("", "1", "relative excess of the scale of", 0.01), _scale, "reading"),
    Effect(
        "magnetometer.misalignment", "field_b", axes("angle", "rad", "turned about", 5e-3), _misalignment, "mounting"
    ),
    Effect(
        "magnetometer.current_leak",
        "field_b",
        tuple(Parameter(n, "T A-1 m-2", f"reading of {n[0]} per dipole along {n[-1]}", 1e-8) for n in _PAIRS),
        _current_leak,
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
