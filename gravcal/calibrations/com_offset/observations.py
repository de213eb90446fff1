"""A centre-of-mass calibration as discovery sees it: one block a manoeuvre, and one of the edge times."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from gravcal.calibrations.align import OFF_S, POINTING_S, WHOLE_S, between, off_orbit
from gravcal.calibrations.causes import LateTags, of_late_orbit
from gravcal.calibrations.com_offset import checks, lag, manoeuvre, responses
from gravcal.calibrations.com_offset.estimate import QUIET_S, adopted
from gravcal.calibrations.com_offset.manoeuvre import Manoeuvre
from gravcal.effects import effect
from gravcal.errors import refuse
from gravcal.estimation.least_squares import polynomial, project_out, stable_inverse
from gravcal.estimation.noise import fit_noise, whiten
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Lead, Observations, Parameter, reported
from gravcal.physics.orbit_environment import sun_i

#: {instrument: (channel, cause)} of tags that are minutes off.
FAR = {"acc": ("angular", "timing.accelerometer_delay"), "sca": ("attitude", "timing.star_camera_delay")}
FAR |= {"mag": ("magnetometer", "timing.magnetometer_delay")}
LARGE = 400.0  # gain in chi-square of an effect whose second order may be seen


def observe(products: Mapping[str, xr.Dataset], **settings) -> "ComOffset | LateTags | None":
    """Observations of an event from products "align", "field", "attitude" and "solve" of mtq; None without manoeuvre.

    LateTags where tags of an instrument are late, or all agree and attitudes are off the orbit: its tags are wrong.

    Settings are those of the stages attitude, noise and solve, with inertia, dipole_per_current and mass; for the
    blocks also linear_drift_degree and angular_drift_degree, and for `common` drag_sigma_m_s2 and period_s.
    """
    aligned = products["align"]
    if not aligned.sizes["manoeuvre"]:
        return None
    late = checks.late(aligned)
    if late:
        return _late(aligned, late, settings["noise_order"])
    orbit = _late_orbit(aligned)
    if orbit is not None:
        return orbit
    records = products["align"], products["field"], products["attitude"]
    normal, right = (np.nansum(products["solve"][name].values, axis=0) for name in ("normal", "right"))
    offset, noise = stable_inverse(normal) @ right, {}  # m, of all manoeuvres together; noise is measured on first use
    views = manoeuvre.manoeuvres(*records, offset, noise, settings)
    orders, period = dict.fromkeys(("linear", "angular"), settings["noise_order"]), settings["period_s"]
    half = float(np.median(np.diff(products["attitude"]["time_acc"].values))) / 2
    return ComOffset(
        *(*records, offset, views, noise, settings),
        noise_order=orders | {"magnetometer": settings["attitude_noise_order"]},
        periods={period: 99},
        shared=dict.fromkeys(("timing.accelerometer_delay", "timing.star_camera_delay"), half),
        common=settings["drag_sigma_m_s2"] * (period / (2 * np.pi)) ** 2,
    )


def _late_orbit(aligned):
    """LateTags of an event whose attitudes are off the orbit by more than `OFF_S`: its tags are wrong; else None."""
    known = np.isfinite(aligned["quaternion"].values).all(axis=1)
    every = max(known.sum() // 1000, 1)
    time, quaternion = (aligned[name].values[known][::every] for name in ("time_sca", "quaternion"))
    orbit = aligned["time_orbit"].values
    inside = between(time, orbit, checks.STEP_LIMIT_S)
    if not inside.any():
        return None
    state = np.concatenate([aligned[name].values for name in ("position_i", "velocity_i")], axis=1)
    angle, rate = off_orbit(time[inside], quaternion[inside], orbit, state)
    late = float(np.median(angle / rate))
    if not abs(late) > OFF_S:
        return None
    delay, about = Parameter(-late, POINTING_S, "s"), (ComOffset.name, "", ComOffset.parameters, ComOffset.unit)
    return of_late_orbit(aligned, time[inside], angle, -rate, delay, "attitude", *about)


@dataclass(frozen=True)
class ComOffset(Observations):
    """Observations of one event; noise, blocks and candidates are computed when first used."""

    aligned: xr.Dataset  #: "com_offset.align"
    checked: xr.Dataset  #: "com_offset.field"
    smoothed: xr.Dataset  #: "com_offset.attitude"
    start: np.ndarray  #: (3,) m, offset of all manoeuvres together
    views: list[Manoeuvre]  #: one a manoeuvre
    noise: dict  #: {channel: Measured}, of all views
    settings: Mapping  #: of `observe`
    #: of the channels that were measured in quiet data
    noise_order: Mapping[str, int] = field()
    #: all harmonics of the square wave of the torquers; those of the orbit are below all lines of a manoeuvre
    periods: Mapping[float, int] = field()
    #: {slug: s} delay that edges imitate if they fall alike between two samples of the accelerometer in all events
    shared: Mapping[str, float] = field()
    #: m, offset imitated by a force that stays while the body swings, as in "com_offset.combine": were the force free
    #: in each manoeuvre, only the harmonics of the wave would determine the offset
    common: float = field()

    name = "com_offset"
    channels = manoeuvre.CHANNELS
    parameters = ("x", "y", "z")
    unit, scale = "um", np.full(3, 1e6)
    step = responses.STEP
    tones = responses.TONES
    whole_manoeuvres = True

    @functools.cached_property
    def quiet(self) -> dict[str, float]:
        """{channel: quiet samples an axis} of the noise, which is measured into `noise` here; {} if it is known."""
        if self.noise:
            return {}
        models, samples = manoeuvre.quiet_noise(self.aligned, self.checked, self.settings)
        if samples["linear"] * self.settings["step_s"] < QUIET_S:
            remedy = "Give files that reach further before and after the manoeuvres."
            refuse("discovery", "too little quiet data to measure the noise in", f"{QUIET_S:.0f} s", remedy)
        wider = [responses.attitude_of_torques(one) for one in self.views]
        order = self.settings["attitude_noise_order"]
        models["attitude"] = manoeuvre.attitude_noise(self.smoothed, self.views, wider, order)
        self.noise.update(models)
        return samples

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a manoeuvre, and one of the edge times."""
        _ = self.quiet  # the noise that whitens
        of_manoeuvres = [manoeuvre.block_of(one, self.aligned, self.smoothed, self.settings) for one in self.views]
        return [*of_manoeuvres, responses.edge_block(self.smoothed)]

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Effects of the catalogue, then unlisted drivers made of the measured channels."""
        _ = self.quiet
        return responses.candidates(self.views, self.smoothed, self.aligned["start"].values)

    @property
    def circumstances(self) -> dict[str, float]:
        """{"beta_deg": elevation of the Sun above the orbital plane, "latitude_deg": mean absolute latitude}."""
        if not self.views:
            return {}
        time, orbit = self.views[0].orbit
        at = np.array([np.mean(one.time) for one in self.views])
        position, later = (np.stack([np.interp(at + dt, time, c) for c in orbit.T], axis=1) for dt in (0.0, 60.0))
        normal, radius = np.cross(position, later), np.linalg.norm(position, axis=1)
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        beta = np.degrees(np.arcsin(np.sum(normal * sun_i(at), axis=1)))
        latitude = np.degrees(np.arcsin(np.abs(position[:, 2]) / radius))
        return {"beta_deg": float(np.mean(beta)), "latitude_deg": float(np.mean(latitude))}

    def response(self, entry: Entry) -> list[np.ndarray]:
        """Whitened rows (n,) that an entry of a model adds in each manoeuvre and in the edge times."""
        _, rows = self.quiet, []
        for one in self.views:
            added = responses.contribution(one, entry)
            signal = None if added or not entry.listed else responses.of_delay(one, entry.cause)
            if signal:  # what a delay does to the field, where `without` moves tags
                delay = effect(entry.cause).values(entry.values)[0]
                added = {channel: columns[..., 0] * delay for channel, columns in signal.items()}
            signals = {channel: values[..., None] for channel, values in added.items()}
            rows.append(one.whitened(signals)[:, 0] if added else np.zeros(one.size))
        column = responses.edge_column(entry.cause, self.smoothed, self.aligned["start"].values)
        if column is None:  # of a lag as well: behind it the fitted edges stay where they were
            return [*rows, np.zeros(self.smoothed["acc_shift"].size + 1)]
        return [*rows, column[:, 0] * effect(entry.cause).values(entry.values)[0]]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Product "align" less what the effects of a model add to it."""
        return responses.without(self.aligned, self.views, model)

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time (m,) s, reading (m, 3) of the model, and whitened rows (n, q) in its unit as (q, m, 3)."""
        return manoeuvre.reading(self.views[number], channel, rows)

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:
        """True if the effects are so large, or so many, that their second order may matter."""
        if len(gains) != 1:
            return bool(gains)
        ((cause, gain),) = gains
        return gain > LARGE or cause.startswith("timing.") or not adequate

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:
        """Entry in physical parameters: amplitude and waves of a line, limit of saturation, leads of a step or lag."""
        if "frequency" in entry.parameters and entry.cause in self.tones.values():
            waves = responses.waves(entry, self.views, self.blocks)
            return replace(entry, parameters=responses.amplitudes(entry, self.views), waves=waves)
        if entry.cause == "torque.saturation":  # found as the dipole that is missing at full current
            full = max(float(np.abs(v.context.dipole_b).max()) for v in self.views)
            limit = entry.parameters["limit"]
            return replace(entry, parameters={"limit": replace(limit, value=full - limit.value)})
        if entry.cause == self.step and fitted.candidate.apart:  # in every manoeuvre, as long after its start
            starts, firsts = [float(v.time[0]) for v in self.views], [min(b.steps) for b in self.blocks if b.steps]
            since = fitted.candidate.at - firsts[0]
            leads = [Lead(a, first + since - a) for a, first in zip(starts, firsts, strict=True)]
            return replace(entry, leads=tuple(leads))
        chosen = None if fitted.candidate.shape is None else fitted.candidate.shape.chosen
        leads = entry.leads if chosen is None else lag.leads(self.views, chosen)
        return replace(super().physical(entry, fitted), leads=leads)


@dataclass(frozen=True)
class Late(LateTags):
    """Angular accelerations of records with tags minutes off; other causes are searched once the tags are moved."""

    step, whole_manoeuvres = responses.STEP, True

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """True if any tags were moved: the search is then repeated."""
        return bool(gains)

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Product "align" with its tags moved back by the delays."""
        return responses.tags_moved(self.records, model)


def _late(aligned, late, order):
    """Observations of records whose tags are late by {instrument: s}, as of `checks.late`; order is that of the noise.

    Rows of each instrument and axis in each manoeuvre: angular acceleration minus that of the torquers at its tags; a
    global column, the change per second of lag; local columns, the torques about all three axes at the lag and a second
    off, mean and drift. A block covers a manoeuvre, both where it is and where the late tags put it.
    """
    lags = dict.fromkeys(("acc", "sca"), -late["mag"]) if "mag" in late else late
    first, far = aligned["window_start"].values.min(), [0, *lags.values()]
    ends = aligned["start"].values + min(far) - first, aligned["stop"].values + max(far) - first
    length = int(aligned["window_stop"].values.max() - first)
    places = [np.arange(max(int(start), 0), min(int(stop), length)) for start, stop in zip(*ends, strict=True)]
    _, accelerations = checks.angular_accelerations(aligned)
    accelerations = {name: one - np.nanmean(one, axis=0) for name, one in accelerations.items()}
    whitened = [[] for _ in places]
    for name, lag_s in lags.items():
        lagged = np.roll(accelerations["mag"], lag_s, axis=0)
        around = np.concatenate([np.roll(lagged, step, axis=0) for step in (-1, 0, 1)], axis=1)
        for axis in range(3):
            read, tagged = accelerations[name][:, axis], accelerations["mag"][:, axis]
            good = np.isfinite(np.column_stack([read, tagged, around])).all(axis=1)
            size = lagged[good, axis] @ read[good] / max(lagged[good, axis] @ lagged[good, axis], 1e-300)
            rows_all = np.column_stack([read - size * tagged, size * (lagged[:, axis] - tagged) / lag_s, around])
            by_place = [np.column_stack([rows_all[p], polynomial(p, 1, p[0], p[-1])]) for p in places]
            residuals = [np.full(p.size, np.nan) for p in places]
            for one, rest, place in zip(by_place, residuals, places, strict=True):
                rest[good[place]] = project_out(one[good[place], 2:], one[good[place], 0] - lag_s * one[good[place], 1])
            noise = fit_noise(residuals, order, 1.0, 11 * len(residuals))
            for mine, one, place in zip(whitened, by_place, places, strict=True):
                mine.append(whiten(noise, np.nan_to_num(one), good[place]))
    channels, blocks, columns = [FAR[name][0] for name in lags], [], {FAR[name][1]: [] for name in late}
    for number, (place, rows) in enumerate(zip(places, whitened, strict=True), 1):
        rows_all, local = np.concatenate(rows), block_diag(*(one[:, 2:] for one in rows))
        about = np.repeat(channels, 3 * place.size), np.tile(np.repeat([0, 1, 2], place.size), len(lags))
        about = *about, np.tile(np.floor(first) + place, len(rows))
        shared = np.zeros((len(rows_all), 3))  # the offset, of which these rows know nothing
        blocks.append(Block.of(f"manoeuvre {number}", rows_all[:, 0], *about, shared=shared, local=local))
        for name in late:
            share = [-1.0 if name == "mag" else float(name == one) for one in lags]
            columns[FAR[name][1]].append((np.repeat(share, 3 * place.size) * rows_all[:, 1])[:, None])
    delays = {FAR[name][1]: Parameter(float(seconds), WHOLE_S, "s") for name, seconds in late.items()}
    about = ComOffset.name, "", ComOffset.parameters, ComOffset.unit, ComOffset.scale, np.zeros(3)
    return Late(aligned, blocks, columns, delays, tuple(channels), *about)


def _result(combined: xr.Dataset, variant: str | None = None) -> tuple[str, np.ndarray, np.ndarray]:
    """Variant (by default the adopted one), its offset (3,) um and covariance (3, 3) um2 from "com_offset.combine"."""
    names = combined.attrs["variants"].split()
    index = names.index(variant or adopted(combined) or names[0])
    return names[index], 1e6 * combined["offset"].values[index], 1e12 * combined["covariance"].values[index]


REPORT = reported(__file__, "discovery.toml", _result)
