"""Antenna phase centres of a pair from ranging during pointing wiggles (Remote Sens. 2022, 14, 3395)."""

from gravcal.calibrations import offered

__all__ = ["estimate"]
__getattr__ = offered(__name__, estimate="arrays")
