"""Loops over epochs that effects need, compiled; loaded when such an effect is evaluated."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def ringing(time, drive, frequency, damping):
    """Oscillator less its drive, (n,) unit of the drive; the drive is held from epoch to epoch, at rest at first.

    Parameters
    ----------
    time : (n,) s
    drive : (n,) any unit
    frequency, damping : Hz, 1, less than critical
    """
    out = np.zeros(time.size)
    own = 2 * np.pi * max(frequency, 1e-9)
    decay, swing = damping * own, own * np.sqrt(1 - damping**2)
    x, v = 0.0, 0.0
    for k in range(1, time.size):
        step, target = time[k] - time[k - 1], drive[k - 1]
        c, s, fade = np.cos(swing * step), np.sin(swing * step), np.exp(-decay * step)
        away = x - target
        x = target + fade * (away * c + (v + decay * away) / swing * s)
        v = fade * (v * c - (decay * v + own**2 * away) / swing * s)
        out[k] = x - drive[k]
    return out


@njit(cache=True)
def lagged(commanded, decay):
    """Dipole (n, 3) that follows the commanded one, held from epoch to epoch, by the decay (n,) in each step."""
    out = commanded.copy()
    for k in range(1, commanded.shape[0]):
        for axis in range(3):
            held = commanded[k - 1, axis]
            out[k, axis] = held + (out[k - 1, axis] - held) * decay[k]
    return out
