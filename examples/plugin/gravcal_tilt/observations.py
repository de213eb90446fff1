"""The turntable as discovery sees it: swings that are left out in turn, scale and bias free in all of them."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.estimation.records import Block, Candidate, Observations
from gravcal_tilt import science


def observe(products, *, swing_s):
    """Observations of one day, a block for each ``swing_s`` seconds."""
    observed = products["ingest"]
    angle, since = observed["angle"].values, observed["time"].values - observed["time"].values[0]
    value, _, residual = science.fit(angle, observed["reading"].values)
    swing = (since // swing_s).astype(int)
    return Readings(
        observed, angle, residual, residual.std(), [np.flatnonzero(swing == k) for k in np.unique(swing)], value
    )


@dataclass(frozen=True)
class Readings(Observations):
    """Residual rad of all rows, its noise, and the rows of each block."""

    observed: xr.Dataset
    angle: np.ndarray
    residual: np.ndarray
    sigma: float
    parts: list[np.ndarray]
    start: np.ndarray

    name = "tilt_scale"
    channels = ("tilt",)
    parameters = ("scale", "bias")
    unit, scale = "1", np.ones(2)
    step = "unknown:step"

    @property
    def blocks(self):
        """One block a swing."""
        design, time = np.stack([self.angle, np.ones_like(self.angle)], axis=1), self.observed["time"].values
        white, design = self.residual / self.sigma, design / self.sigma
        return [
            Block.of(f"swing {number}", white[rows], "tilt", 0, time[rows], shared=design[rows])
            for number, rows in enumerate(self.parts)
        ]

    @property
    def candidates(self):
        """A reading that bends with the angle."""
        columns = [self.angle[rows, None] ** 2 / self.sigma for rows in self.parts]
        return [Candidate("unknown:angle_squared", "", ["curvature"], ["rad-1"], columns)]

    def without(self, model):
        """Readings less what the effects of a model add."""
        added = sum(entry.values.get("curvature", 0.0) for entry in model) * self.angle**2
        return self.observed.assign(reading=self.observed["reading"] - added)

    def reading(self, channel, number, rows):  # noqa: ARG002
        """Time, angle and rows of a swing, in rad."""
        part = self.parts[number]
        return self.observed["time"].values[part], self.angle[part, None], self.sigma * rows.T[..., None]
