"""Antenna phase centres of a pair from ranging during pointing wiggles (Remote Sens. 2022, 14, 3395)."""

__all__ = ["estimate"]


def __getattr__(name):
    """Estimators on plain arrays, imported when they are asked for: commands load without them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gravcal.calibrations.kbr_phase_centre import arrays

    return getattr(arrays, name)
