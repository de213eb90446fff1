"""Scale factors, offset and bias of the inertial sensor of Taiji-1 (Remote Sens. 2023, 15, 3817)."""

from gravcal.calibrations.inertial_sensor.estimate import estimate

__all__ = ["estimate"]
