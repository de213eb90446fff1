"""A centre-of-mass calibration as discovery sees it: one block a manoeuvre, and one of the edge times."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_lag, discovery_noise, discovery_timing, discovery_tones
from gravcal.calibrations.com_offset.discovery_candidates import attitude_of_torques, candidates, field_of_delay
from gravcal.calibrations.com_offset.discovery_reading import reading
from gravcal.calibrations.com_offset.discovery_scene import offset_of, scenes
from gravcal.calibrations.com_offset.discovery_view import CHANNELS, View, block_of, view_of
from gravcal.calibrations.com_offset.extension import contribution, without
from gravcal.calibrations.com_offset.noise import QUIET_S
from gravcal.effects import effect
from gravcal.errors import ProductError
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Observations, Parameter

LARGE = 400.0  # chi-square of an effect whose second order may be seen


def observe(products: Mapping[str, xr.Dataset], **settings) -> ComOffset | None:
    """Observations of an event, None without manoeuvre.

    Parameters
    ----------
    products : "align", "field", "attitude" and "solve" of com_offset, solved with variant mtq
    settings : of the stages attitude, noise and solve, with inertia, dipole_per_current and mass; for the blocks also
        linear_drift_degree and angular_drift_degree
    """
    if not products["align"].sizes["manoeuvre"]:
        return None
    records = products["align"], products["field"], products["attitude"]
    offset, noise = offset_of(products["solve"]), {}
    views = [view_of(scene, records, noise, offset, settings["mass"]) for scene in scenes(*records, settings)]
    return ComOffset(*records, offset, views, noise, settings)


@dataclass(frozen=True)
class ComOffset(Observations):
    """Observations; noise, blocks and candidates are made when they are asked for.

    Attributes
    ----------
    aligned, field, smoothed : Dataset, "com_offset.align", "com_offset.field", "com_offset.attitude"
    start : (3,) m, offset of all manoeuvres together
    views : one a manoeuvre
    noise : {channel: noise model of each axis}, of all views
    settings : of `observe`
    """

    aligned: xr.Dataset
    field: xr.Dataset
    smoothed: xr.Dataset
    start: np.ndarray
    views: list[View]
    noise: dict
    settings: Mapping

    name = "com_offset"
    channels = CHANNELS
    parameters = ("x", "y", "z")
    unit, scale = "um", np.full(3, 1e6)
    step = "accelerometer.bias_step"
    tones = {"linear": "accelerometer.stray_tone", "angular": "unknown:time"}  # noqa: RUF012
    widest, named_form, whole_manoeuvres = False, True, True

    @functools.cached_property
    def quiet(self) -> dict[str, float]:
        """Quiet samples an axis that the noise of each channel was measured from; measures it unless it is given."""
        if self.noise:
            return {}
        aligned, field, settings = self.aligned, self.field, self.settings
        self.noise["linear"], samples = discovery_noise.linear(aligned, settings)
        if samples * settings["step_s"] < QUIET_S:
            raise ProductError(
                "discovery: found less than 300 s of quiet data outside the manoeuvres, which the noise has to be "
                "measured in. Give files that reach further before and after them."
            )
        quiet = {"linear": samples}
        self.noise["magnetometer"], quiet["magnetometer"] = discovery_noise.magnetometer(aligned, field, settings)
        wider = [attitude_of_torques(view) for view in self.views]
        made = [view.scene for view in self.views]
        self.noise["attitude"] = discovery_noise.attitude(self.smoothed, made, wider, settings)
        self.noise["angular"], quiet["angular"] = discovery_noise.angular(aligned, field, settings)
        return quiet

    @property
    def noise_order(self) -> dict[str, int]:
        """Coefficients of the noise model of each channel that was measured in quiet data."""
        order = dict.fromkeys(("linear", "angular"), self.settings["noise_order"])
        return order | {"magnetometer": self.settings["attitude_noise_order"]}

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a manoeuvre, and one of the edge times."""
        _ = self.quiet  # the noise that whitens
        made = [block_of(view, self.aligned, self.smoothed, self.settings) for view in self.views]
        return [*made, discovery_timing.block(self.smoothed)]

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Effects of the catalogue, then regressors made of the measured channels."""
        _ = self.quiet
        return candidates(self.views, self.smoothed, self.aligned["start"].values)

    def response(self, entry: Entry) -> list[np.ndarray]:
        """Whitened rows of each manoeuvre and of the edge times."""
        _, rows = self.quiet, []
        for view in self.views:
            added = contribution(view, entry)
            if not added and entry.listed:  # what a delay does to the field; tags themselves are moved
                signal = field_of_delay(view, entry.cause) or {}
                value = effect(entry.cause).values(entry.values)[0]
                added = {channel: columns[..., 0] * value for channel, columns in signal.items()}
            signals = {channel: values[..., None] for channel, values in added.items()}
            rows.append(view.rows(signals)[:, 0] if added else np.zeros(view.size))
        return [*rows, self._edges(entry)]

    def _edges(self, entry):
        """Rows of an effect among the edge times; behind a lag the fitted edges stay where they were."""
        column = None
        if entry.listed and entry.cause != discovery_lag.CAUSE:
            column = discovery_timing.columns(entry.cause, self.smoothed, self.aligned["start"].values)
        if column is None:
            return np.zeros(self.smoothed["acc_shift"].size + 1)
        return column[:, 0] * effect(entry.cause).values(entry.values)[0]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records without the effects of a model."""
        return without(self.aligned, self.views, model)

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s, reading of the model and whitened rows in its unit."""
        return reading(self.views[number], channel, rows)

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:
        """True if the effects are so large, or so many, that their second order may matter."""
        if len(gains) != 1:
            return bool(gains)
        ((cause, gain),) = gains
        return gain > LARGE or cause.startswith("timing.") or not adequate

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:
        """Lines as amplitude and waves, saturation as its limit, shapes with their errors."""
        if "frequency" in entry.parameters and entry.cause in self.tones.values():
            waves = discovery_tones.waves(entry, self.views, self.blocks)
            return replace(entry, parameters=discovery_tones.amplitudes(entry, self.views), waves=waves)
        parameters, shape = dict(entry.parameters), fitted.candidate.shape
        if entry.cause == "torque.saturation":  # found as the dipole that is missing at full current
            full = max(float(np.abs(v.context.dipole_b).max()) for v in self.views)
            limit = parameters["limit"]
            parameters["limit"] = replace(limit, value=full - limit.value)
        if shape is None:
            return replace(entry, parameters=parameters)
        errors = np.sqrt(np.diag(shape.covariance)) if shape.covariance is not None else shape.value * np.nan
        rows = zip(shape.names, shape.value.tolist(), errors.tolist(), shape.units, strict=True)
        parameters |= {name: Parameter(value, sigma, unit) for name, value, sigma, unit in rows}
        leads = () if shape.chosen is None else discovery_lag.leads(self.views, shape.chosen)
        return replace(entry, parameters=parameters, leads=leads)
