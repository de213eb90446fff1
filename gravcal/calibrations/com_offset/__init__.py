"""Centre of mass against the proof mass, from magnetic-torquer manoeuvres (Remote Sens. 2022, 14, 4030)."""

from gravcal.calibrations import offered

__all__ = ["estimate"]
__getattr__ = offered(__name__, estimate="arrays")
