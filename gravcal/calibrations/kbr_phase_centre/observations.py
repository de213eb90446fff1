"""A ranging calibration as discovery sees it: half sub-manoeuvres as blocks of whitened range residuals.

Range, range rate and range acceleration of a product come from one phase; the range stands for all three.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.align import WHOLE_S, late_of_pair, late_orbit, moved_orbits
from gravcal.calibrations.causes import LateTags, of_late_orbit
from gravcal.calibrations.kbr_phase_centre import noise
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, PARAMETERS
from gravcal.calibrations.kbr_phase_centre.responses import BREAK, RIPPLE, SATELLITES, Halves, halves_of, turned
from gravcal.effects import effect
from gravcal.effects.ranging import BREAK_GAP_S
from gravcal.estimation import crn, records
from gravcal.physics import frames

#: Causes that turn the frame in which the phase centres are stated.
FRAME = ("attitude.star_camera_misalignment", "ranging.star_camera_misalignment")
BREAK_STEP_S = 30.0
BREAK_MARGIN_S = 60.0  # of a phase break from the ends of its manoeuvre: half of the filter and some epochs
#: Closer together where a half ends, which leaves only a few epochs of a break to be seen.
NEAR_CUT_S = np.arange(-55.0, 56.0, 10.0)
#: Epochs round that of the search at which a phase break is looked for again, s.
FINE_S = np.arange(-40.0, 41.0, 2.0)


def observe(
    products: Mapping[str, xr.Dataset], *, nominal_m, plausible_mm: Sequence[float], **settings
) -> "Ranging | LateTags | None":
    """Observations of a campaign; of the range rate alone where an orbit is tagged late, None without a wiggle.

    Products are "align", "pointing", "observable", "noise" and "solve" of the range, settings as of `halves_of`; phase
    centres may be plausible_mm (3,) from nominal_m (2, 3) of the catalogue.
    """
    aligned, pointed = products["align"], products["pointing"]
    late, nominal = late_of_pair(aligned, pointed), np.asarray(nominal_m, dtype=float).reshape(2, 3)
    orbit = late_orbit(aligned, pointed, late)
    if orbit is not None:
        return _late_orbit(aligned, orbit)
    if not pointed.sizes["manoeuvre"]:
        return None
    expected = dict(zip(PARAMETERS, zip(1e3 * nominal.ravel(), [*plausible_mm] * 2, strict=True), strict=True))
    view = halves_of(products, late[:3], nominal, **settings)
    groups, quiet = [*(half.manoeuvre for half in view.parts), 0], {"range": view.quiet}
    return Ranging(view, expected, view.start, view.context.epoch, quiet, groups, bool(view.late.any()))


def _late_orbit(aligned, orbit):
    """Observations of a campaign with one orbit late, as of `late_orbit`, by the range rate; its records moved back."""
    satellite, position = orbit["satellite"], aligned["position_i"].values.copy()
    second = np.arange(aligned.sizes["time"])
    inside = (second + orbit["late"] >= 0) & (second + orbit["late"] < second.size)
    position[satellite] = np.where(inside[:, None], moved_orbits(aligned)(satellite, second, orbit["late"]), np.nan)
    moved, series = aligned["position_i"].copy(data=position), (orbit[name] for name in ("time", "left", "change"))
    delay, form = records.Parameter(float(orbit["late"]), WHOLE_S, "s"), tuple(SATELLITES)[1 + satellite]
    fields = delay, "range rate", Ranging.name, form, PARAMETERS, Ranging.unit
    return of_late_orbit(aligned.assign(position_i=moved), *series, *fields)


@dataclass(frozen=True)
class Ranging(records.Observations):
    """Observations of a campaign; noise, blocks and candidates are computed on demand."""

    view: Halves
    #: {parameter: mm, of the catalogue and how far it may be from it}
    expected: Mapping[str, tuple[float, float]] = field()
    start: np.ndarray  #: (6,) m, phase centres of the solution
    epoch: float = field()  #: s, middle of the wiggles
    quiet: Mapping[str, float] = field()  #: {"range": samples that the noise is known from}
    groups: Sequence[int] = field()  #: sub-manoeuvre of each block; arbitrary for the prior: no line acts in it
    shifted: bool = field()  #: True if tags are minutes off

    name = "kbr_phase_centre"
    channels = ("range",)
    parameters = PARAMETERS
    unit, scale = "mm", np.full(6, 1e3)
    step = BREAK
    lines = (records.LineSearch("range", -1, "unknown:time", "m"),)
    periods = {250.0: 4, 5640.0: 12}  # s, of the wiggle by design, and of the orbit as far as its errors reach

    @functools.cached_property
    def blocks(self) -> list[records.Block]:
        """One block of whitened residuals for each half, and the prior of the phase centres as the satellite is built.

        A phase front that is curved alike in pitch and yaw is the phase centre's x by definition, and a turn of the
        star cameras is y and z: only this prior separates them.
        """
        blocks, view = [], self.view
        for half, factor in zip(view.parts, view.factors, strict=True):
            column = view.column[half.rows] - view.column[half.rows].mean(axis=0)  # x is all bias where nothing turns
            rows = noise.white(factor, np.column_stack([view.residual[half.rows], column, half.slow]))
            labels = rows[:, 0], "range", 0, half.time
            blocks.append(records.Block.of(half.label, *labels, shared=rows[:, 1:7], local=rows[:, 7:]))
        if blocks:
            nominal, sigma = 1e-3 * np.array([self.expected[name] for name in self.parameters]).T
            labels = (nominal - self.start) / sigma, "prior", np.tile([0, 1, 2], 2), np.arange(6.0)
            blocks.append(records.Block.of("known beforehand", *labels, shared=np.diag(1 / sigma)))
        return blocks

    @functools.cached_property
    def candidates(self) -> list[records.Candidate]:
        """Effects with all their parameters and with each alone, drivers, ripples, and phase breaks at many epochs."""
        whitened, candidates, first_column = self.view.white(self.view.filtered), [], 0
        for signal in self.view.signals:
            last_column = first_column + len(signal.names)
            columns = [part if part is None else part[:, first_column:last_column] for part in whitened]
            whole = replace(signal, columns=columns, of_frame=signal.cause in FRAME, at=np.nan)
            if np.isfinite(signal.at):
                candidates += [self.view.ripple(whole, signal.at, form) for form in SATELLITES]
            else:
                candidates += whole.each_alone() if whole.listed and not whole.form else [whole]
                for letter in "ab" if whole.listed and not whole.form else ():  # where it has several of a satellite
                    kept = [k for k, name in enumerate(whole.names) if name.endswith(f"_{letter}")]
                    candidates += [whole.part(kept, letter)] if len(kept) > 1 else []
            first_column = last_column
        for manoeuvre in dict.fromkeys(half.manoeuvre for half in self.view.parts if not self.view.far):
            halves = [half for half in self.view.parts if half.manoeuvre == manoeuvre]
            begin, end = halves[0].time[0] + BREAK_MARGIN_S, halves[-1].time[-1] - BREAK_MARGIN_S
            cuts = [half.time[0] + NEAR_CUT_S for half in halves[1:]]
            candidates += self.view.breaks(np.unique(np.concatenate([np.arange(begin, end, BREAK_STEP_S), *cuts])))
        return candidates

    def wave(self, search: records.LineSearch) -> Callable[[int, float], np.ndarray]:  # noqa: ARG002 - there is one
        """Function (number of a block, frequency Hz) -> whitened cosine and sine (n, 2) of a line in it."""

        def columns(number, frequency):
            if number == len(self.view.parts):
                return np.zeros((6, 2))
            phase = 2 * np.pi * frequency * (self.view.parts[number].time - self.view.context.epoch)
            return noise.white(self.view.factors[number], np.stack([np.cos(phase), np.sin(phase)], axis=1))

        return columns

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time (n,) s, range less orbit (n, 1) m by the solution's phase centres, whitened rows (q, n, 1) back in m."""
        half = self.view.parts[number]
        model = self.view.column[half.rows] @ self.start
        return half.time, model[:, None], (self.view.factors[number] @ rows).T[:, :, None]

    def response(self, entry: records.Entry) -> list[np.ndarray]:
        """Whitened rows (n,) of each block; ripple and break by their law: no candidate has their period or epoch."""
        if entry.cause not in (RIPPLE, BREAK):
            return super().response(entry)
        catalogued = effect(entry.cause)
        added = np.nan_to_num(catalogued.contribution(self.view.context, catalogued.values(entry.values)))
        rows = self.view.white(self.view.through(added[:, None]))
        return [np.zeros(b.time.size) if r is None else r[:, 0] for r, b in zip(rows, self.blocks, strict=True)]

    def near(self, fitted: records.Fitted) -> list[records.Candidate]:
        """Candidates of phase breaks at a finer grid of epochs about that of a fitted one."""
        return self.view.breaks(records.epoch_of(fitted.candidate.cause) + FINE_S)

    def spacing(self, epoch: float) -> float:  # noqa: ARG002
        """Spacing s of the search for phase breaks."""
        return BREAK_STEP_S

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """True but for phase breaks: they have no second order, and readings about a removed one are left out."""
        return any(cause != BREAK for cause, _ in gains)

    def without(self, model: Sequence[records.Entry]) -> xr.Dataset:
        """Aligned records without the effects of a model.

        Readings less the contribution of their effects through the filter of the ranging; attitudes turned back, at the
        time that their tags should have had. A line is left where it is: its phase differs between manoeuvres. About a
        phase break readings are left out, for rates show one that came before the filter alone.
        """
        time, records = self.view.context.time, self.view.records.copy(deep=True)
        total, attitude = np.zeros(time.size), records["quaternion"].values
        for entry in model:
            if not entry.listed:
                for one in (s for s in self.view.signals if (s.cause, s.form) == (entry.cause, entry.form)):
                    total += np.nan_to_num(one.added(entry)[0])
                continue
            catalogued = effect(entry.cause)
            added = catalogued.contribution(self.view.context, catalogued.values(entry.values))
            satellites = SATELLITES.get(entry.form.partition(",")[0], (0, 1))
            if entry.cause == "ranging.delay" and self.view.late[0]:  # by whole seconds; the rest in the range
                delay = entry.values["delay"]
                records = records.assign_coords(time_kbr=records["time_kbr"].values - np.rint(delay))
                added = added * (1 - np.rint(delay) / delay)
            if catalogued.channel == "range":
                total += np.where(np.isfinite(added), added, 0.0)
            for k, q in ((k, attitude[k]) for k in satellites):
                good = np.isfinite(q).all(axis=1)
                if catalogued.channel == "sca_delay":
                    attitude[k] = turned(time, q, added)
                elif catalogued.channel == "pointing_b":
                    q[good] = frames.quaternion_product(q[good], frames.from_rotation_vector(-added[good]))
        for derivative, name in enumerate(OBSERVABLES if total.any() else ()):
            at = records["time_kbr"].values
            operator = crn.operator(self.view.filter_, derivative, self.view.good, (time[0], 1.0), at)
            records[f"reading_{name}"].values[:] -= np.where(operator.valid, operator(total), 0.0)
        breaks = [one.values["time"] for one in model if one.cause == BREAK]
        kept = [np.abs(records["time_kbr"].values - epoch) > BREAK_GAP_S for epoch in breaks]
        records = records.isel(time_kbr=np.all(kept, axis=0)) if kept else records
        return records.assign_attrs(model=" ".join(entry.cause for entry in model))


def _result(combined: xr.Dataset, variant: str | None = None) -> tuple[str, np.ndarray, np.ndarray]:
    """Observable (the adopted one), phase centres (6,) mm, covariance (6, 6) mm2 of "kbr_phase_centre.combine"."""
    name, estimator = variant or combined.attrs["adopted_observable"], combined.attrs["adopted_estimator"]
    place = (combined.attrs["observables"].split().index(name), 0, ESTIMATORS.index(estimator))
    return name, 1e3 * combined["centre"].values[place], 1e6 * combined["covariance"].values[place]


REPORT = records.reported(__file__, "discovery.toml", _result)
