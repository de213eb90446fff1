"""Cramer-Rao bound of the offset from true motion and true noise; nothing of the estimator is used.

Known: rates, angular accelerations and gravity gradient as the simulator flew them, at the true epochs of the
readings; inertia and dipole with them; the noise densities of the simulator and the quantisation. Every sample of the
square wave counts (10 Hz, 180 s). Unknown beside the offset: a polynomial of time per axis and manoeuvre, of the
degree that the estimator takes for the non-gravitational acceleration.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

LAGS = 2**17  # samples of the circle on which the spectrum is summed, long against any memory of the noise


def covariance(event, drift_degree: int) -> np.ndarray:
    """Smallest covariance (3, 3) m2 that an unbiased estimate of the offset of an `events.Simulated` can have."""
    factors = _factors(*_noise_of(event))
    information = np.zeros((3, 3))
    for wave in event.truth["manoeuvres"]:
        time, design = _during(event.motion, wave["start"], wave["stop"])
        drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), drift_degree)
        for axis in range(3):
            root = factors[axis][: time.size, : time.size]
            columns = np.concatenate([drift, design[:, axis]], axis=1)
            white = solve_triangular(root, columns, lower=True, check_finite=False)
            information += _without(white[:, : drift_degree + 1], white[:, drift_degree + 1 :])
    return np.linalg.inv(information)


def _during(motion, start, stop):
    """Epochs of the readings between the first and the last edge, and the reading per metre of offset (n, 3, 3)."""
    inside = [(epochs.acc >= start) & (epochs.acc < stop) for epochs, _ in motion]
    (epochs, true), inside = max(zip(motion, inside, strict=True), key=lambda part: part[1].sum())
    w, wd, G = true.rate_b[inside], true.rate_dot_b[inside], true.gradient_b[inside]
    columns = []
    for unit in np.eye(3):  # p = -offset; felt is w' x p + w x (w x p) - G p
        columns.append(-(np.cross(wd, unit) + np.cross(w, np.cross(w, unit)) - G @ unit))
    return epochs.acc[inside], np.stack(columns, axis=-1)


def _without(nuisance, columns):
    """Information (3, 3) that is left when the nuisance is free."""
    basis, _ = np.linalg.qr(nuisance)
    clean = columns - basis @ (basis.T @ columns)
    return clean.T @ clean


def _noise_of(event):
    """Hashable description of the noise: nodes in Hz, amplitudes of each axis, variance of rounding, step in s."""
    chosen, satellite = event.chosen, event.satellite
    tables = tuple(tuple(chosen.noise_scale * a for a in getattr(chosen, f"linear_noise_{x}")) for x in "xyz")
    rounding = tuple(step**2 / 12 for step in satellite["accelerometer_step"])
    return tuple(chosen.noise_frequency_hz), tables, rounding, satellite["accelerometer_interval"]


@functools.cache
def _factors(nodes, tables, rounding, step, count=1850):
    """Cholesky factor of the covariance of `count` samples, one an axis; its leading part serves fewer samples."""
    frequency = np.fft.rfftfreq(LAGS, step)
    factors = []
    for amplitude, variance in zip(tables, rounding, strict=True):
        log = np.interp(np.log(np.maximum(frequency, nodes[0])), np.log(nodes), np.log(amplitude))
        correlation = np.fft.irfft(np.exp(2 * log))[:count] / (2 * step)
        correlation[0] += variance
        factors.append(cholesky(toeplitz(correlation), lower=True))
    return factors
