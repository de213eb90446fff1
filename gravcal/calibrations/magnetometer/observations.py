"""Observations of a magnetometer against the reference field for discovery: parts of the record, left out in turn.

No parameter is free in the baseline: those of the instrument are among the causes, and what data support is named.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.align import POINTING_S
from gravcal.calibrations.causes import listed, unknown
from gravcal.calibrations.magnetometer import model
from gravcal.effects import effect
from gravcal.estimation.noise import NoiseModel, unwhiten
from gravcal.estimation.records import Block, Candidate, Entry, Observations, Parameter, reported

#: Errors s of tags that are far off, the second by 5 mrad of mounting.
FAR = {"timing.star_camera_delay": POINTING_S, "timing.magnetometer_delay": 5.0}


def observe(products: Mapping[str, xr.Dataset], *, blocks: int, **settings) -> "Readings":
    """Observations of one record ("align") in so many blocks.

    Settings are noise_order, field_noise_nt, camera_limit_s and delay_limit_s, within which tags are no lag.
    """
    aligned = products["align"]
    field, step = model.field(aligned), float(aligned["step"])
    columns = {slug: model.columns(field, slug) for slug in model.causes(field)}
    drift = (field.time - (field.time[0] + field.time[-1]) / 2)[:, None, None] * np.eye(3)
    late = model.late(aligned, settings["camera_limit_s"], settings["delay_limit_s"])
    free = [*columns.values(), drift, *(change[..., None] for _, change in late.values())]
    order = settings["noise_order"] if np.ptp(field.time) > model.SHORT_S else 0
    noise = model.noise(field, step, free, order, 1e-9 * settings["field_noise_nt"])
    parts, columns = np.array_split(np.arange(field.time.size), blocks), columns | {"unknown:time": drift}
    if late:  # fields are not where tagged: only delays are causes, columns the whole effect over the delay
        columns = {cause: (change / delay)[..., None] for cause, (delay, change) in late.items()}
    delays = {cause: Parameter(delay, FAR[cause], "s") for cause, (delay, _) in late.items()}
    return Readings(aligned, field, noise, parts, columns, delays, {"magnetometer": noise[0].reflection.size})


@dataclass(frozen=True)
class Readings(Observations):
    """Observations of a record, whitened by axis; no parameter is free in the baseline."""

    aligned: xr.Dataset  #: "magnetometer.align"
    field: model.Field
    noise: list[NoiseModel]  #: of each axis, T
    parts: list[np.ndarray]  #: rows of each block
    columns: dict[str, np.ndarray]  #: {cause: (n, 3, q) T}
    delays: dict[str, Parameter] = field()  #: of tags that are far off by what orbit, attitude and field show
    noise_order: Mapping[str, int] = field()

    name = "magnetometer"
    channels = ("magnetometer",)
    parameters, floored = (), True
    unit, scale, start = "T", np.zeros(0), np.zeros(0)

    def _rows(self, values, part):
        """Whitened rows (3 m, q) of values (n, 3, q) T at the records (m,) of a part, axis after axis."""
        place = model.placed(self.field.time[part], float(self.aligned["step"]))
        return np.concatenate([model.whitened(one, place, values[part, a]) for a, one in enumerate(self.noise)])

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a part of the record; nothing is fitted in it."""
        made = []
        for rows in self.parts:
            observed = self._rows(self.field.difference[..., None], rows)[:, 0]
            begin, end = self.field.time[rows[[0, -1]]] - self.field.time[0]
            about = np.repeat([0, 1, 2], rows.size), np.tile(self.field.time[rows], 3)
            made.append(Block.of(f"{begin:.0f} to {end:.0f} s", observed, "magnetometer", *about))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates with whitened columns in every block: effects of a comparison of fields, and a drift."""
        made = {cause: [self._rows(values, rows) for rows in self.parts] for cause, values in self.columns.items()}
        drift = [unknown("time", "drift", made.pop("unknown:time"), "T s-1")] if "unknown:time" in made else []
        return [*(listed(effect(cause), columns, prior=False) for cause, columns in made.items()), *drift]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records less what the effects of a model add to the reading."""
        added = np.zeros_like(self.field.measured_b)
        known = {one.cause: replace(one, columns=[self.columns[one.cause]]) for one in self.candidates}
        for entry in (one for one in model if one.cause in known):
            added += known[entry.cause].added(entry)[0]
        return self.aligned.assign(measured_b=self.aligned["measured_b"] - added)

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time (m,) s and reference field (m, 3) T of a part, and rows (q, m, 3) T."""
        part = self.parts[number]
        place = model.placed(self.field.time[part], float(self.aligned["step"]))
        each = zip(self.noise, rows.reshape(3, part.size, -1), strict=True)
        columns = [model.whitened(noise, place, one, unwhiten) for noise, one in each]
        return self.field.time[part], self.field.model_b[part], np.stack(columns).transpose(2, 1, 0)


REPORT = reported(__file__, "discovery.toml")
