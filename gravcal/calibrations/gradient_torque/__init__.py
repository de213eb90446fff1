"""Gravity-gradient torque, and drag from one or two sensors (S-GRS paper, corrected; equations.md section 8.5)."""

from gravcal.calibrations.gradient_torque.model import drag

__all__ = ["drag"]
