"""Main magnetic field: IGRF, evaluated by ppigrf."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import ppigrf


def field_earth(date, seconds, position_e, generation=13):
    """Field (n, 3) in T, Earth-fixed axes, at positions in m; one epoch (the middle one) for the coefficients."""
    x, y, z = position_e.T
    radius = np.linalg.norm(position_e, axis=1)
    polar, azimuth = np.arccos(z / radius), np.arctan2(y, x)
    when = datetime.fromisoformat(date) + timedelta(seconds=float(np.mean(seconds)))
    table = Path(ppigrf.__file__).parent / f"IGRF{generation}.shc"
    args = (radius / 1e3, np.degrees(polar), np.degrees(azimuth), when)
    up, south, east = (part[0] * 1e-9 for part in ppigrf.igrf_gc(*args, coeff_fn=str(table)))
    st, ct, sp, cp = np.sin(polar), np.cos(polar), np.sin(azimuth), np.cos(azimuth)
    e_up = np.stack([st * cp, st * sp, ct], -1)
    e_south = np.stack([ct * cp, ct * sp, -st], -1)
    e_east = np.stack([-sp, cp, 0 * sp], -1)
    return up[:, None] * e_up + south[:, None] * e_south + east[:, None] * e_east
