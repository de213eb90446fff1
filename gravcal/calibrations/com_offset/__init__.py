"""Centre of mass against the proof mass, from magnetic-torquer manoeuvres (Remote Sens. 2022, 14, 4030)."""

__all__ = ["estimate"]


def __getattr__(name):
    """Estimators on plain arrays, imported when they are asked for: commands load without them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gravcal.calibrations.com_offset import arrays

    return getattr(arrays, name)
