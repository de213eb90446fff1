"""Scale factors, offset and bias of the inertial sensor of Taiji-1 (Remote Sens. 2023, 15, 3817)."""

__all__ = ["estimate"]


def __getattr__(name):
    """Estimators on plain arrays, imported when they are asked for: commands load without them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gravcal.calibrations.inertial_sensor import arrays

    return getattr(arrays, name)
