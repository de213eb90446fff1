"""Scale factors, offset and bias of the inertial sensor of Taiji-1 (Remote Sens. 2023, 15, 3817)."""

from gravcal.calibrations import offered

__all__ = ["estimate"]
__getattr__ = offered(__name__, estimate="arrays")
