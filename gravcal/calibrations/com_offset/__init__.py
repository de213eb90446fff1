"""Centre of mass against the proof mass, from magnetic-torquer manoeuvres (Remote Sens. 2022, 14, 4030)."""

from gravcal.calibrations.com_offset.estimate import estimate

__all__ = ["estimate"]
