"""Covariance of the noise of range, range rate or range acceleration at the epochs of one manoeuvre."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numba
import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import pointing_noise
from gravcal.estimation import noise as noises

FLOOR_HZ = 5e-4  # below it derivatives of the noise are held, so that their covariance keeps an inverse
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
    frequency = np.linspace(0, 0.5 / step, pointing_noise.BINS + 1)
    pointing = np.einsum("c,cim->im", measured["pointing_power"].values, pointing_noise.shapes(step))
    return of_densities((fitted.density(frequency), pointing), step, derivative, count)


def of_densities(densities, step_s: float, derivative: int, count: int) -> Lags:
    """Covariances by lag from the densities of the range and of the pointing error.

    Parameters
    ----------
    densities : (m,) m2 Hz-1, as sampled, and (2, m) rad2 Hz-1, not folded, one-sided at `pointing_noise.images`
    step_s : s
    derivative : 0, 1 or 2
    count : number of lags
    """
    ranging, pointing = densities
    turn = 2 * np.pi * pointing_noise.images(step_s)
    by_lag = _transformed(ranging * derivative_power(derivative, step_s), step_s)[:count]
    pairs = {}
    if np.any(pointing):
        for a in range(derivative + 1):
            for b in range(derivative + 1):
                own, folded = pointing * turn ** (a + b)
                full = _transformed(own * 1j ** (a - b) + folded * (-1j) ** (a - b), step_s)
                pairs[a, b] = np.concatenate([full[-count + 1 :], full[:count]])
    return Lags(by_lag, pairs, derivative)


def _transformed(density, step):
    """Covariance by lag of a one-sided density, negative lags at the end."""
    return np.fft.irfft(density, 2 * pointing_noise.BINS) * (0.5 / step)


def derivative_power(derivative: int, step_s: float) -> np.ndarray:
    """Power of a derivative over that of the range, both from the same white phase by the CRN filter, as sampled.

    Parameters
    ----------
    derivative : 0, 1 or 2
    step_s : s, spacing of the ranging epochs

    Returns
    -------
    power : (BINS + 1,) s**-(2 derivative), up to Nyquist
    """
    share = pointing_noise.passed(step_s) + 1e-12
    turn = 2 * np.pi * np.maximum(pointing_noise.images(step_s), FLOOR_HZ)
    return (share * turn ** (2 * derivative)).sum(axis=0) / share.sum(axis=0)


def matrix(by_lag: Lags, place: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Covariance of the noise at some epochs of an even grid.

    Parameters
    ----------
    by_lag : Lags
    place : (n,) int, numbers of the epochs
    lever : (n, derivative + 1, 4) m s**-order, range per radian of pointing and its derivatives

    Returns
    -------
    covariance : (n, n), lower triangle

    Notes
    -----
    The pointing part of the range is sum_j g_j phi_j; by Leibniz its d-th derivative has the covariance
    sum_ab (d a)(d b) sum_j g_j^(d-a)(t) g_j^(d-b)(t') K_ab(t - t').
    """
    d, n = by_lag.derivative, by_lag.ranging.size
    strength = np.sqrt(np.mean(lever[:, 0] ** 2, axis=0))
    strong = np.ascontiguousarray(lever[:, ::-1][:, :, strength > SMALL * strength.max()])
    by_pair = np.zeros((d + 1, d + 1, 2 * n - 1))
    for (a, b), values in by_lag.pointing.items():
        by_pair[a, b] = comb(d, a) * comb(d, b) * values
    return _lower(by_lag.ranging, by_pair, place, strong if by_lag.pointing else strong[:, :, :0])


@numba.njit(cache=True)
def _lower(ranging, by_pair, place, lever):
    """Lower triangle; `lever` (n, a, j) holds the derivative that goes with the a-th of the pointing noise."""
    n, orders, kinds = lever.shape
    middle = ranging.size - 1
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(i + 1):
            lag = place[i] - place[k]
            total = ranging[lag]
            for a in range(orders):
                for b in range(orders):
                    arms = 0.0
                    for j in range(kinds):
                        arms += lever[i, a, j] * lever[k, b, j]
                    total += arms * by_pair[a, b, middle + lag]
            out[i, k] = total
    return out
