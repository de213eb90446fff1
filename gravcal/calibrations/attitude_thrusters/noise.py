"""Noise of routine attitude, measured between firings: covariance of each camera, and correlation in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.attitude_thrusters import response
from gravcal.calibrations.attitude_thrusters.series import Camera
from gravcal.errors import EstimationError
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten

MARGIN_S = 1.0  # s, of a quiet stretch to the firings at its ends


@dataclass(frozen=True)
class Noise:
    """What turns attitudes into rows of unit variance.

    Attributes
    ----------
    factor : {head: (3, 3) rad-1}, inverse Cholesky factor of the covariance of its errors
    models : noise model of each of the three decorrelated components
    stretches, samples : quiet stretches and epochs they were measured from
    """

    factor: dict[int, np.ndarray]
    models: list[NoiseModel]
    stretches: int
    samples: int

    def rows(self, head: np.ndarray, place: np.ndarray, signal: np.ndarray) -> np.ndarray:
        """Whitened rows (3 m, q) of a signal (n, 3, q) rad at places of an even grid of m epochs; others are zero.

        Parameters
        ----------
        head : (n,)
        place : (n,) int, increasing
        signal : (n, 3, q) rad
        """
        grid = np.zeros((place[-1] + 1, 3, signal.shape[2]))
        valid = np.zeros(place[-1] + 1, dtype=bool)
        valid[place] = True
        grid[place] = np.stack([self.factor[h] for h in head]) @ signal
        return np.concatenate([whiten(model, grid[:, a], valid) for a, model in enumerate(self.models)])


def measured(camera: Camera, firing_times: np.ndarray, settings: dict) -> Noise:
    """Noise from stretches without firings, the smooth torque of each removed.

    Parameters
    ----------
    camera : Camera
    firing_times : (k,) s
    settings : quiet_minimum_s, knot_s, noise_order, head_minimum
    """
    pieces = []
    ends = np.concatenate([camera.time[:1], firing_times, camera.time[-1:]])
    for start, stop in zip(ends[:-1], ends[1:], strict=True):
        rows = np.flatnonzero((camera.time > start + MARGIN_S) & (camera.time < stop - MARGIN_S))
        if stop - start >= settings["quiet_minimum_s"] and rows.size * camera.step_s > 0.8 * (stop - start):
            pieces.append(_piece(camera.part(rows), settings["knot_s"]))
    if sum(p[1].size for p in pieces) < 500:
        raise EstimationError(
            f"found {len(pieces)} stretches of {settings['quiet_minimum_s']:.0f} s without a firing, expected 500 "
            f"epochs in them to measure the noise of the attitude. Give a longer record or a smaller quiet_minimum_s.",
            stretches=len(pieces),
        )
    return _fitted(pieces, camera.step_s, settings)


def _piece(part, knot_s):
    """Residual (n, 3) rad, head (n,), place on the grid (n,) and number of parameters of one quiet stretch."""
    angle, _ = response.reference(part.time, part.quaternion)
    basis = np.linalg.qr(response.smooth_torque(part.time, knot_s))[0]
    place = np.rint((part.time - part.time[0]) / part.step_s).astype(int)
    return angle - basis @ (basis.T @ angle), part.head, place, basis.shape[1]


def _fitted(pieces, step_s, settings):
    residual, head = (np.concatenate([p[k] for p in pieces]) for k in (0, 1))
    removed, total = sum(p[3] for p in pieces), len(residual)
    lost = total / (total - removed)
    factor = {}
    for h in np.unique(head):
        own = residual[head == h]
        if len(own) >= settings["head_minimum"]:
            factor[int(h)] = np.linalg.inv(np.linalg.cholesky(own.T @ own / len(own) * lost))
    series = [[], [], []]
    for values, heads, place, _ in pieces:
        known = np.isin(heads, list(factor))
        grid = np.full((place[-1] + 1, 3), np.nan)
        if known.any():
            turned = np.stack([factor[int(h)] for h in heads[known]]) @ values[known][..., None]
            grid[place[known]] = turned[..., 0]
        for axis in range(3):
            series[axis].append(grid[:, axis])
    models = [fit_noise(s, settings["noise_order"], step_s, removed) for s in series]
    return Noise(factor, models, len(pieces), total)
