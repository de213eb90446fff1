"""Magnetometer against the reference field as discovery sees it: parts of the record that are left out in turn.

No parameter is free in the baseline: on minutes of data the parameters of the instrument are themselves among the
causes that are tried, and only what the data support is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.causes import listed
from gravcal.calibrations.magnetometer import model
from gravcal.effects import effect
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Observations, Parameter, Reported

#: Errors s of tags that are far off: 0.017 rad by which x of the body may be off the flight, 5 mrad of mounting.
FAR = {"timing.star_camera_delay": 15.0, "timing.magnetometer_delay": 5.0}


def observe(products: Mapping[str, xr.Dataset], *, blocks: int, field_noise_nt: float) -> Readings:
    """Observations of one record.

    Parameters
    ----------
    products : "align" of magnetometer
    blocks : parts of the record
    field_noise_nt : nT, smallest standard deviation of a record
    """
    field = model.field(products["align"])
    columns = {slug: model.columns(field, slug) for slug in model.EFFECTS}
    drift = (field.time - (field.time[0] + field.time[-1]) / 2)[:, None, None] * np.eye(3)
    late = model.late(products["align"])
    free = [*columns.values(), drift, *(moved[..., None] for _, moved in late.values())]
    sigma = model.noise_level(field.difference, free, 1e-9 * field_noise_nt)
    parts, columns = np.array_split(np.arange(field.time.size), blocks), columns | {"unknown:time": drift}
    if late:  # nothing else is looked for beside what is not there
        columns = {cause: (moved / delay)[..., None] for cause, (delay, moved) in late.items()}
    return Readings(products["align"], field, sigma, parts, columns, {cause: one[0] for cause, one in late.items()})


@dataclass(frozen=True)
class Readings(Observations):
    """Observations of a record."""

    aligned: xr.Dataset  #: "magnetometer.align"
    field: model.Field
    sigma: np.ndarray  #: (3,) T, noise of each axis
    parts: list[np.ndarray]  #: rows of each block
    columns: dict[str, np.ndarray]  #: {cause: (n, 3, q) T}
    late: dict[str, float]  #: s, tags that are far off

    name = "magnetometer"
    channels = ("magnetometer",)
    parameters = ()
    unit, scale, start = "T", np.zeros(0), np.zeros(0)
    step = "unknown:step"

    def _rows(self, values):
        """Whitened rows (3 n, q) of (n, 3, q) T, axis after axis."""
        return np.concatenate([values[:, a] / self.sigma[a] for a in range(3)])

    @property
    def blocks(self) -> list[Block]:
        """One block a part of the record; nothing is fitted in it."""
        made = []
        for rows in self.parts:
            observed = self._rows(self.field.difference[rows][..., None])[:, 0]
            begin, end = self.field.time[rows[[0, -1]]] - self.field.time[0]
            nothing, channel = np.zeros((observed.size, 0)), np.array(["magnetometer"] * observed.size)
            axis, time = np.repeat([0, 1, 2], rows.size), np.tile(self.field.time[rows], 3)
            made.append(Block(f"{begin:.0f} to {end:.0f} s", observed, nothing, nothing, channel, axis, time))
        return made

    @property
    def candidates(self) -> list[Candidate]:
        """Effects of a comparison of two fields, and a drift with time."""
        made = []
        for cause, values in self.columns.items():
            columns = [self._rows(values[rows]) for rows in self.parts]
            if cause.startswith("unknown:"):
                made.append(Candidate(cause, "drift", list("xyz"), ["T s-1"] * 3, columns))
            else:
                made.append(listed(effect(cause), columns, prior=False))
        return made

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:  # noqa: ARG002
        """Tags that are far off by what orbit, attitude and field show."""
        if entry.cause not in self.late:
            return entry
        return replace(entry, parameters={"delay": Parameter(self.late[entry.cause], FAR[entry.cause], "s")})

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records less what the effects of a model add to the reading."""
        added = np.zeros_like(self.field.measured_b)
        names = {one.cause: one.names for one in self.candidates}
        for entry in model:
            if entry.cause in self.columns:
                added += self.columns[entry.cause] @ [entry.values.get(name, 0.0) for name in names[entry.cause]]
        return self.aligned.assign(measured_b=self.aligned["measured_b"] - added)

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time, reference field (m, 3) T of a part, and rows (q, m, 3) T."""
        part = self.parts[number]
        columns = rows.reshape(3, part.size, -1) * self.sigma[:, None, None]
        return self.field.time[part], self.field.model_b[part], columns.transpose(2, 1, 0)


NOTE = (
    "The record is looked at in parts that are left out in turn, with nothing free beforehand: bias, scale, "
    "mounting and leak are themselves among the causes. The level of the noise is that of the residual with every "
    "cause in the model; it is known to some 10 %. The calibration has all its parameters free, so that nothing "
    "found here changes it."
)
REPORT = Reported(note=NOTE)
