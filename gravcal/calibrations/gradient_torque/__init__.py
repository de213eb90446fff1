"""Gravity-gradient torque, and drag from one or two sensors (S-GRS paper, corrected; equations.md section 5)."""

__all__ = ["drag"]


def __getattr__(name):
    """Estimators on plain arrays, imported when they are asked for: commands load without them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gravcal.calibrations.gradient_torque import laws

    return getattr(laws, name)
