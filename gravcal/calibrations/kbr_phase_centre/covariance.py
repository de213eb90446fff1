"""Covariance of the noise of range, range rate or range acceleration at the epochs of one manoeuvre."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import pointing_noise
from gravcal.methods import crn
from gravcal.methods import noise as noises

FLOOR_HZ = 5e-4  # below it derivatives of the noise are held, so that their covariance keeps an inverse
BINS = 4096
SMALL = 0.2  # levers below this share of the largest one add less than 4 % to the variance of the pointing part


@dataclass(frozen=True)
class Lags:
    """Covariances by lag.

    Attributes
    ----------
    ranging : (n,) of ranging and orbit
    pointing : {(a, b): (2 n - 1,)} between derivatives a and b of the pointing noise, lags -(n - 1) .. n - 1
    derivative : 0, 1 or 2
    """

    ranging: np.ndarray
    pointing: dict
    derivative: int


def lags(measured: xr.Dataset, derivative: int, count: int) -> Lags:
    """Covariances of the noise of the range or one of its derivatives, by lag.

    Parameters
    ----------
    measured : Dataset, "kbr_phase_centre.noise"
    derivative : 0, 1 or 2
    count : number of lags

    Returns
    -------
    lags : Lags
    """
    step = float(measured.attrs["step_s"])
    fitted = noises.NoiseModel(measured["reflection"].values, measured["variance"].values, step)
    frequency = np.linspace(0, 0.5 / step, BINS + 1)
    ranging = _transformed(fitted.density(frequency) * derivative_power(derivative, frequency, step), step)[:count]
    density = measured["pointing_power"].values @ pointing_noise.shapes(frequency, step)
    pairs = {}
    if density.any():
        for a in range(derivative + 1):
            for b in range(derivative + 1):
                wave = density * (2 * np.pi * frequency) ** (a + b) * 1j ** (a - b)
                full = _transformed(wave, step)
                pairs[a, b] = np.concatenate([full[-count + 1 :], full[:count]])
    return Lags(ranging, pairs, derivative)


def _transformed(density, step):
    """Covariance by lag of a one-sided density, negative lags at the end."""
    return np.fft.irfft(density, 2 * BINS) * (0.5 / step)


def derivative_power(derivative: int, frequency_hz: np.ndarray, step_s: float) -> np.ndarray:
    """Power of a derivative over that of the range, both from the same white phase by the CRN filter, as sampled.

    Parameters
    ----------
    derivative : 0, 1 or 2
    frequency_hz : (m,) Hz
    step_s : s, spacing of the ranging epochs
    """
    if derivative == 0:
        return np.ones(frequency_hz.size)
    images = [frequency_hz, 1 / step_s - frequency_hz]
    share = [crn.gain(crn.Crn(), 0.5, 0, f) ** 2 + 1e-12 for f in images]
    turn = [(2 * np.pi * np.maximum(f, FLOOR_HZ)) ** (2 * derivative) for f in images]
    return sum(s * t for s, t in zip(share, turn, strict=True)) / sum(share)


def matrix(by_lag: Lags, place: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Covariance of the noise at some epochs of an even grid.

    Parameters
    ----------
    by_lag : Lags
    place : (n,) int, numbers of the epochs
    lever : (n, derivative + 1, 4) m s**-order, range per radian of pointing and its derivatives

    Returns
    -------
    covariance : (n, n)

    Notes
    -----
    The pointing part of the range is sum_j g_j phi_j; by Leibniz its d-th derivative has the covariance
    sum_ab (d a)(d b) sum_j g_j^(d-a)(t) g_j^(d-b)(t') K_ab(t - t').
    """
    from scipy.linalg import toeplitz

    size, d = place[-1] + 1, by_lag.derivative
    total = toeplitz(by_lag.ranging[:size])[np.ix_(place, place)]
    strength = np.sqrt(np.mean(lever[:, 0] ** 2, axis=0))
    strong = strength > SMALL * strength.max()
    middle = (len(next(iter(by_lag.pointing.values()))) - 1) // 2 if by_lag.pointing else 0
    for (a, b), values in by_lag.pointing.items():
        left, right = lever[:, d - a][:, strong], lever[:, d - b][:, strong]
        lagged = toeplitz(values[middle : middle + size], values[middle - np.arange(size)])[np.ix_(place, place)]
        total += comb(d, a) * comb(d, b) * (left @ right.T) * lagged
    return total
