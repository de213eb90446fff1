"""A centre-of-mass calibration as discovery sees it: one block a manoeuvre, and one of the edge times."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import lag, manoeuvre, responses
from gravcal.calibrations.com_offset.estimate import QUIET_S, adopted
from gravcal.calibrations.com_offset.manoeuvre import Manoeuvre
from gravcal.effects import effect
from gravcal.errors import ProductError
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Lead, Observations, Parameter, Reported
from gravcal.physics.orbit_environment import sun_i

LARGE = 400.0  # chi-square of an effect whose second order may be seen


def observe(products: Mapping[str, xr.Dataset], **settings) -> ComOffset | None:
    """Observations of an event from "align", "field", "attitude" and "solve" with variant mtq, None without manoeuvre.

    Settings are those of the stages attitude, noise and solve, with inertia, dipole_per_current and mass; for the
    blocks also linear_drift_degree and angular_drift_degree, and for `common` drag_sigma_m_s2 and period_s.
    """
    if not products["align"].sizes["manoeuvre"]:
        return None
    records = products["align"], products["field"], products["attitude"]
    offset, noise = manoeuvre.offset_of(products["solve"]), {}
    views = manoeuvre.manoeuvres(*records, offset, noise, settings)
    return ComOffset(*records, offset, views, noise, settings)


@dataclass(frozen=True)
class ComOffset(Observations):
    """Observations; noise, blocks and candidates are made when they are asked for."""

    #: aligned, field, smoothed: Dataset, "com_offset.align", "com_offset.field", "com_offset.attitude"
    aligned: xr.Dataset
    field: xr.Dataset
    smoothed: xr.Dataset
    start: np.ndarray  #: (3,) m, offset of all manoeuvres together
    views: list[Manoeuvre]  #: one a manoeuvre
    noise: dict  #: {channel: Measured}, of all views
    settings: Mapping  #: of `observe`

    name = "com_offset"
    channels = manoeuvre.CHANNELS
    parameters = ("x", "y", "z")
    unit, scale = "um", np.full(3, 1e6)
    step = responses.STEP
    tones = responses.TONES
    whole_manoeuvres = True

    @functools.cached_property
    def quiet(self) -> dict[str, float]:
        """Quiet samples an axis that the noise of each channel was measured from; measures it unless it is given."""
        if self.noise:
            return {}
        models, samples = manoeuvre.quiet_noise(self.aligned, self.field, self.settings)
        if samples["linear"] * self.settings["step_s"] < QUIET_S:
            raise ProductError(
                "discovery: found less than 300 s of quiet data outside the manoeuvres, which the noise has to be "
                "measured in. Give files that reach further before and after them."
            )
        wider = [responses.attitude_of_torques(one) for one in self.views]
        order = self.settings["attitude_noise_order"]
        models["attitude"] = manoeuvre.attitude_noise(self.smoothed, self.views, wider, order)
        self.noise.update(models)
        return samples

    @property
    def noise_order(self) -> dict[str, int]:
        """Coefficients of the noise model of each channel that was measured in quiet data."""
        order = dict.fromkeys(("linear", "angular"), self.settings["noise_order"])
        return order | {"magnetometer": self.settings["attitude_noise_order"]}

    @property
    def periods(self) -> dict[float, int]:
        """All harmonics of the square wave of the torquers; those of the orbit are below all lines of a manoeuvre."""
        return {self.settings["period_s"]: 99}

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a manoeuvre, and one of the edge times."""
        _ = self.quiet  # the noise that whitens
        made = [manoeuvre.block_of(one, self.aligned, self.smoothed, self.settings) for one in self.views]
        return [*made, responses.edge_block(self.smoothed)]

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Effects of the catalogue, then regressors made of the measured channels."""
        _ = self.quiet
        return responses.candidates(self.views, self.smoothed, self.aligned["start"].values)

    @property
    def shared(self) -> dict[str, float]:
        """Delays s that edges look like which fall alike between two samples of the accelerometer in all events."""
        half = float(np.median(np.diff(self.smoothed["time_acc"].values))) / 2
        return dict.fromkeys(("timing.accelerometer_delay", "timing.star_camera_delay"), half)

    @property
    def circumstances(self) -> dict[str, float]:
        """Angle deg of the Sun above the orbit, and mean distance deg of the manoeuvres from the equator."""
        time, position = self.views[0].orbit
        at = np.array([np.mean(one.time) for one in self.views])
        place, later = (np.stack([np.interp(at + dt, time, c) for c in position.T], axis=1) for dt in (0.0, 60.0))
        normal, radius = np.cross(place, later), np.linalg.norm(place, axis=1)
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        beta = np.degrees(np.arcsin(np.sum(normal * sun_i(at), axis=1)))
        latitude = np.degrees(np.arcsin(np.abs(place[:, 2]) / radius))
        return {"beta_deg": float(np.mean(beta)), "latitude_deg": float(np.mean(latitude))}

    @property
    def common(self) -> float:
        """Offset m that a force looks like which stays while the body swings, as in "com_offset.combine".

        A free force in each manoeuvre would leave an offset to be told by the harmonics of the wave alone.
        """
        return self.settings["drag_sigma_m_s2"] * (self.settings["period_s"] / (2 * np.pi)) ** 2

    def response(self, entry: Entry) -> list[np.ndarray]:
        """Whitened rows of each manoeuvre and of the edge times."""
        _, rows = self.quiet, []
        for one in self.views:
            added = responses.contribution(one, entry)
            signal = None if added or not entry.listed else responses.of_delay(one, entry.cause)
            if signal:  # what a delay does to the field, where `without` moves tags
                delay = effect(entry.cause).values(entry.values)[0]
                added = {channel: columns[..., 0] * delay for channel, columns in signal.items()}
            signals = {channel: values[..., None] for channel, values in added.items()}
            rows.append(one.whitened(signals)[:, 0] if added else np.zeros(one.size))
        return [*rows, responses.edge_contribution(entry, self.smoothed, self.aligned["start"].values)]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records without the effects of a model."""
        return responses.without(self.aligned, self.views, model)

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s, reading of the model and whitened rows in its unit."""
        return manoeuvre.reading(self.views[number], channel, rows)

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:
        """True if the effects are so large, or so many, that their second order may matter."""
        if len(gains) != 1:
            return bool(gains)
        ((cause, gain),) = gains
        return gain > LARGE or cause.startswith("timing.") or not adequate

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:
        """Lines as amplitude and waves, saturation as its limit, shapes with their errors."""
        if "frequency" in entry.parameters and entry.cause in self.tones.values():
            waves = responses.waves(entry, self.views, self.blocks)
            return replace(entry, parameters=responses.amplitudes(entry, self.views), waves=waves)
        parameters, shape = dict(entry.parameters), fitted.candidate.shape
        if entry.cause == "torque.saturation":  # found as the dipole that is missing at full current
            full = max(float(np.abs(v.context.dipole_b).max()) for v in self.views)
            limit = parameters["limit"]
            parameters["limit"] = replace(limit, value=full - limit.value)
        if entry.cause == self.step and fitted.candidate.apart:  # in every manoeuvre, as long after its start
            starts, firsts = [float(v.time[0]) for v in self.views], [min(b.steps) for b in self.blocks if b.steps]
            since = fitted.candidate.at - firsts[0]
            leads = [Lead(a, first + since - a) for a, first in zip(starts, firsts, strict=True)]
            return replace(entry, leads=tuple(leads))
        if shape is None:
            return replace(entry, parameters=parameters)
        errors = np.sqrt(np.diag(shape.covariance)) if shape.covariance is not None else shape.value * np.nan
        rows = zip(shape.names, shape.value.tolist(), errors.tolist(), shape.units, strict=True)
        parameters |= {name: Parameter(value, sigma, unit) for name, value, sigma, unit in rows}
        leads = () if shape.chosen is None else lag.leads(self.views, shape.chosen)
        return replace(entry, parameters=parameters, leads=leads)


def _result(combined: xr.Dataset) -> tuple[str, np.ndarray, np.ndarray]:
    """Adopted variant, offset (3,) um and covariance (3, 3) um2 of "com_offset.combine"."""
    names = combined.attrs["variants"].split()
    index = names.index(adopted(combined) or names[0])
    return names[index], 1e6 * combined["offset"].values[index], 1e12 * combined["covariance"].values[index]


FILTERED = " It is low-passed like in the solution; its mean is left out."
TURNED = " It is the rotation from a satellite whose torquers are off; its mean is left out."
NOTE = "An offset that moves is that at the middle of each manoeuvre."
REPORT = Reported(_result, NOTE, readings={"linear": FILTERED, "angular": FILTERED, "attitude": TURNED})
