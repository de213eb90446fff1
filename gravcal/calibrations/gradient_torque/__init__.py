"""Gravity-gradient torque, and drag from one or two sensors (S-GRS paper, corrected; equations.md section 5)."""

from gravcal.calibrations import offered

__all__ = ["drag"]
__getattr__ = offered(__name__, drag="laws")
