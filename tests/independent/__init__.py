"""A second simulator of centre-of-mass events, for tests: own orbit, field, attitude, sensors and writer.

`ranging`, `taiji` and `gradient` are those of the other calibrations. None shares code with the package under test.
Times inside are seconds of the day of the event (GPS), vectors are SRF unless a name ends in `_i` (inertial) or `_e`
(Earth-fixed), currents are mA, everything else is SI.
"""

from . import damage
from .event import make_event

__all__ = ["damage", "make_event"]
