"""Bias, scale, axes and leak of a magnetometer against the reference field."""

from gravcal.calibrations.magnetometer.estimate import of_fields as estimate

__all__ = ["estimate"]
