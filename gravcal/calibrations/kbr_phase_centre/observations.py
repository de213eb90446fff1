"""A ranging calibration as discovery sees it: half sub-manoeuvres as blocks of whitened range residuals.

Range, range rate and range acceleration of a product come from one phase; the range stands for all three. With a whole
sub-manoeuvre left out, curvature and y or z of the same satellite cannot be told apart, and nothing could be predicted;
with half of one left out everything stays determined.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from scipy.signal import lfilter

from gravcal.calibrations.align import LATE_S, WHOLE_S, late_of_pair, late_orbit, moved_orbits
from gravcal.calibrations.causes import LateOrbit, listed
from gravcal.calibrations.kbr_phase_centre import model, noise
from gravcal.calibrations.kbr_phase_centre.align import interpolated
from gravcal.calibrations.kbr_phase_centre.estimate import of_manoeuvres
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES, PARAMETERS, angles, middle
from gravcal.effects import Context, Effect, catalogue, effect
from gravcal.effects.ranging import ripples
from gravcal.estimation import crn, records
from gravcal.estimation.resampling import Resampler
from gravcal.physics import frames, orbit_environment

BREAK = "ranging.phase_break"
FAMILIES = ("ranging", "timing", "attitude")
#: Searched for along the time axis; the calibration itself, once and as a share, of which noise is taken out before.
NOT_HERE = (BREAK, "ranging.phase_centre", "ranging.antenna_correction", "attitude.star_camera_noise")
#: Turns of the frame that the phase centres are given in.
FRAME = ("attitude.star_camera_misalignment", "ranging.star_camera_misalignment")
RIPPLE = "ranging.multipath"
PLACES = ("pitch_a", "yaw_a", "pitch_b", "yaw_b")
#: Satellites that an effect on attitudes may be of, by form.
SATELLITES = {"": (0, 1), "a alone": (0,), "b alone": (1,)}
SIZE = np.radians(3.0)  # rad, so that a driver is near one
#: Ripples a degree, so close that the phase of a ripple stays in step over the six degrees of a pair of wiggles.
RIPPLE_STEP = 0.07
RIPPLES_PER_DEG = np.arange(0.40, 2.05, RIPPLE_STEP)
LAGS_S = (20.0, 60.0, 180.0)
SUNLIGHT_LAGS_S = (60.0, 200.0, 2000.0)
#: Of waves along the argument of latitude; slower ones are taken up by the slow orbit error.
CYCLES = range(8, 41)
SETTLING_S = (100.0, 300.0, 900.0)
LEAST = 60  # epochs that a half needs beyond its own columns
#: Degree of the slow orbit error in a half over that in the whole: 10 instead of 15 leaves less than 1 nm of 5 mm.
HALF = 2 / 3
BREAK_STEP_S = 30.0
FILTER_S = 35.0  # half of the filter of the ranging
BREAK_MARGIN_S = 60.0  # of a phase break from the ends of its manoeuvre: half of the filter and some epochs
#: Closer together where a half ends, which leaves only a few epochs of a break to be seen.
NEAR_CUT_S = np.arange(-55.0, 56.0, 10.0)
#: Epochs round that of the search at which a phase break is looked for again, s.
FINE_S = np.arange(-40.0, 41.0, 2.0)


@dataclass(frozen=True)
class Half:
    """Half of a sub-manoeuvre."""

    manoeuvre: int  #: number
    label: str  #: satellite, sign and axis, half
    rows: slice  #: places in the observations of all halves, one after the other
    time: np.ndarray  #: (n,) s
    slow: np.ndarray  #: (n, k) columns of slow orbit error and biases, not whitened
    stretch: noise.Stretch  #: noise.Stretch, its epochs and levers

    def feels(self, epoch: float) -> bool:
        """True if the filter carries a break at an epoch into this half."""
        return self.time[0] - FILTER_S < epoch < self.time[-1] + FILTER_S


def observe(
    products: Mapping[str, xr.Dataset],
    *,
    nominal_m,
    orbit_degree: int,
    crn_window_s: float,
    crn_bandwidth_hz: float,
    band_hz,
    of_noise: Mapping,
    of_pointing: Mapping,
    of_observable: Mapping,
    plausible_mm: Sequence[float],
) -> "Ranging | LateOrbit | None":
    """Observations of a campaign, None without a wiggle.

    Products are "align", "pointing", "observable", "noise" and "solve" of the range, the settings those of their
    stages, of_noise, of_pointing and of_observable those of `noise.noise`, `model.pointing` and `model.observable`;
    phase centres may be plausible_mm (3,) from nominal_m (2, 3) of the catalogue. Tags that are minutes off are moved
    back, and what they do is in the rows to first order: nothing else is looked for.
    """
    aligned, pointed, equations = (products[name] for name in ("align", "pointing", "observable"))
    late, nominal = late_of_pair(aligned, pointed), np.asarray(nominal_m, dtype=float).reshape(2, 3)
    orbit = late_orbit(aligned, pointed, late)
    if orbit is not None:
        return _late_orbit(aligned, orbit)
    if not pointed.sizes["manoeuvre"]:
        return None
    records, measured, centre = aligned, products["noise"], products["solve"]["centre"].values[0, 0]
    late = np.where(np.abs(late[:3]) > LATE_S, late[:3], 0.0)
    if late[1:].all() and np.ptp(late[1:]) < LATE_S:
        late[1:] = np.rint(late[1:].mean())  # both off the line of sight, by the opposite
    if late.any():
        attitude = [
            turned(aligned["time"].values, *one) for one in zip(aligned["quaternion"].values, late[1:], strict=True)
        ]
        aligned = aligned.assign(quaternion=aligned["quaternion"].copy(data=attitude))
        aligned = aligned.assign_coords(time_kbr=aligned["time_kbr"].values - late[0])
        pointed = model.pointing(aligned, **of_pointing)
        settings = {"nominal_m": nominal, "variant": OBSERVABLES[0]}
        equations = model.observable(aligned, pointed, **of_observable, **settings)
        measured, centre = noise.noise(equations, **of_noise), nominal.ravel()
    filter_ = crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz)
    time, good = pointed["time"].values, pointed["usable"].values != 0
    if noise.of_star_cameras(measured, equations["lever"].values[equations["arc"].values >= 0, 0], band_hz[1]):
        pointed = smoothed(pointed, equations, band_hz[1])
        through = crn.operator(filter_, 0, good, (time[0], 1.0), equations["time_kbr"].values)
        column = -through(np.concatenate(list(pointed["line_of_sight_b"].values), axis=1))
        equations = equations.assign(column=equations["column"].copy(data=column))
        measured = noise.noise(equations, **of_noise).assign_attrs(smoothed_hz=band_hz[1])
    step, degree = float(measured.attrs["step_s"]), int(np.ceil(HALF * orbit_degree))
    at, segment, lever = (equations[name].values for name in ("time_kbr", "segment", "lever"))
    halves, places, first = [], [], 0
    for number, whole in enumerate(of_manoeuvres(equations)):
        satellite, axis, sign = (int(equations[n][number]) for n in ("satellite_index", "axis_index", "sign"))
        name = f"{number + 1} {equations.attrs['satellites'][satellite]} {('', '+', '-')[sign]}{('pitch', 'yaw')[axis]}"
        for rows, part in zip(np.array_split(whole, 2), ("begin", "end"), strict=True):
            slow = noise.slow_columns(at[rows], segment[rows], degree, 0)
            if rows.size <= slow.shape[1] + LEAST:
                continue
            place = np.rint((at[rows] - at[rows[0]]) / step).astype(int)
            stretch = noise.Stretch(place, lever[rows, :1])
            halves.append(Half(number, f"{name} {part}", slice(first, first + rows.size), at[rows], slow, stretch))
            places.append(rows)
            first += rows.size
    rows = np.concatenate(places or [np.zeros(0, dtype=int)])
    centre = np.where(np.isfinite(centre), centre, nominal.reshape(6))
    through = crn.operator(filter_, 0, good, (time[0], 1.0), at[rows])
    column = equations["column"].values[rows]
    residual = equations["observed"].values[rows] - column @ centre
    for half in halves:
        residual[half.rows] -= residual[half.rows].mean()  # a bias of 220 km would cost six digits
    known = context(aligned, pointed, nominal)
    for part in _moving(time, equations) if "smoothed_hz" in measured.attrs else ():
        for one in np.moveaxis(known.extra["turning"][part], 1, 0):  # noise of R_bi, which exceeds that of the range
            one[:] = noise.smoothed(one, band_hz[1])
    expected = dict(zip(PARAMETERS, zip(1e3 * nominal.ravel(), [*plausible_mm] * 2, strict=True), strict=True))
    made = Ranging(records, measured, known, filter_, good, through, halves, residual, column, centre, expected, late)
    if late.any():
        residual += made.filtered @ [made.far[one.cause, one.form] for one in made.signals]
        for half in halves:
            residual[half.rows] -= residual[half.rows].mean()
    return made


def _late_orbit(aligned, orbit):
    """Observations of a campaign with one orbit of another time, by the range rate."""
    number, position = orbit["satellite"], aligned["position_i"].values.copy()
    now = np.arange(aligned.sizes["time"])
    there = (now + orbit["late"] >= 0) & (now + orbit["late"] < now.size)
    position[number] = np.where(there[:, None], moved_orbits(aligned)(number, now, orbit["late"]), np.nan)
    return LateOrbit(
        aligned.assign(position_i=aligned["position_i"].copy(data=position)),
        *(orbit[name] for name in ("time", "left", "change")),
        delay=records.Parameter(float(orbit["late"]), WHOLE_S, "s"),
        channel="range rate",
        name=Ranging.name,
        parameters=PARAMETERS,
        unit=Ranging.unit,
        form=tuple(SATELLITES)[1 + number],
    )


def turned(time: np.ndarray, quaternion: np.ndarray, late) -> np.ndarray:
    """Attitudes (n, 4) at the time s that their tags should have had, late by (n,) s; NaN beyond the record."""
    if not np.any(late):
        return quaternion
    good, at = np.isfinite(quaternion).all(axis=1), time + late
    ends = time[good][[0, -1]]
    moved = interpolated(time[good], quaternion[good], np.clip(at, *ends), 10.0)
    moved[(at < ends[0] - LATE_S) | (at > ends[1] + LATE_S)] = np.nan
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def smoothed(pointed: xr.Dataset, equations: xr.Dataset, highest_hz: float) -> xr.Dataset:
    """Lines of sight without what is faster than the satellites move, in quiet data and manoeuvres, away from slews.

    Where star cameras are noisier than the range, their noise is in the rows and in every column that is made of the
    lines of sight, and the columns explain it (errors in variables).
    """
    line = pointed["line_of_sight_b"].values.copy()
    for rows in _moving(pointed["time"].values, equations):
        for one in line[:, rows]:
            missing = ~np.isfinite(one).all(axis=1)
            one[:, 1:] = noise.smoothed(one[:, 1:], highest_hz)
            one[:, 0] = np.sqrt(1 - np.sum(one[:, 1:] ** 2, axis=1))
            one[missing] = np.nan
    new = {"line_of_sight_b": line, "angle": angles(line)}
    return pointed.assign({name: pointed[name].copy(data=values) for name, values in new.items()})


def _moving(time, equations):
    """Seconds of quiet data and of each manoeuvre, away from slews."""
    at, number = equations["time_kbr"].values, equations["arc"].values
    for part in np.split(np.arange(at.size), np.flatnonzero(np.diff(number)) + 1):
        if number[part[0]] != -2:
            yield slice(*np.searchsorted(time, [at[part[0]] - FILTER_S - 1, at[part[-1]] + FILTER_S + 1]))


@dataclass(frozen=True)
class Ranging(records.Observations):
    """Observations of a campaign; signals, noise, blocks and candidates are made when they are asked for."""

    aligned: xr.Dataset  #: "kbr_phase_centre.align"
    measured: xr.Dataset  #: "kbr_phase_centre.noise"
    context: Context  #: Context on whole seconds
    filter_: crn.Crn  #: of the ranging
    good: np.ndarray  #: (n,) bool, seconds that it may use
    through: Resampler  #: from whole seconds to the rows
    halves: list[Half]  #: list of Half
    residual: np.ndarray  #: (m,) m, ranging less orbit less the phase centres of the solution, each half less its mean
    column: np.ndarray  #: (m, 6) 1, of the phase centres
    start: np.ndarray  #: (6,) m, phase centres of the solution
    #: {parameter: mm, of the catalogue and how far it may be from it}
    expected: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    late: np.ndarray = field(default_factory=lambda: np.zeros(3))  #: (3,) s, tags of ranging, star cameras minutes off

    name = "kbr_phase_centre"
    channels = ("range",)
    parameters = PARAMETERS
    unit, scale = "mm", np.full(6, 1e3)
    step = BREAK
    lines = (records.LineSearch("range", -1, "unknown:time", "m"),)
    periods = {250.0: 4, 5640.0: 12}  # s, of the wiggle by design, and of the orbit as far as its errors reach

    @property
    def epoch(self) -> float:
        """Middle of the wiggles, s."""
        return self.context.epoch

    @property
    def groups(self) -> list[int]:
        """Number of the sub-manoeuvre of each half; what is known beforehand has any, for no line is in it."""
        return [*(half.manoeuvre for half in self.halves), 0]

    @functools.cached_property
    def quiet(self) -> dict[str, float]:
        """Samples that the noise is known from: quiet ones for ranging, those of the manoeuvres for star cameras."""
        inside, step = self.residual.size, float(self.measured.attrs["step_s"])
        samples = float(self.measured["seconds"]) / step if self.measured.attrs["source_data"] == "quiet" else inside
        return {"range": 1 / (1 / max(samples, 1.0) + 1 / max(inside, 1))}

    @functools.cached_property
    def signals(self) -> list[records.Candidate]:
        """Effects of the catalogue, then regressors, on whole seconds; tags alone where they are minutes off."""
        known = effects_of(self.context, self.start.reshape(2, 3))
        if self.far:
            return [replace(one, apart=True) for one in known if (one.cause, one.form) in self.far]
        return known + drivers(self.context, [half.time[0] for half in self.halves])

    @property
    def shifted(self) -> bool:
        """Whether tags are minutes off."""
        return bool(self.late.any())

    @functools.cached_property
    def far(self) -> dict[tuple[str, str], float]:
        """Delays s of tags that are minutes off, by cause and form."""
        ranging, *both = self.late
        cameras = {"": both[0]} if both[0] == both[1] else {"a alone": both[0], "b alone": both[1]}
        found = {("ranging.delay", ""): ranging} | {("timing.star_camera_delay", of): s for of, s in cameras.items()}
        return {which: size for which, size in found.items() if size}

    @functools.cached_property
    def filtered(self) -> np.ndarray:
        """Columns (m, q) m of all signals side by side at the ranging epochs."""
        return np.concatenate([self.through(np.nan_to_num(signal.columns[0])) for signal in self.signals], axis=1)

    @functools.cached_property
    def fitted(self) -> xr.Dataset:
        """Dataset "kbr_phase_centre.noise" with what the halves say of it beside all effects."""
        tried = self.filtered[:, : sum(len(one.names) for one in self.signals if one.prior)]
        baselines = (np.column_stack([half.slow, self.column[half.rows]]) for half in self.halves)
        parts = zip(self.halves, baselines, strict=True)
        residuals = [(self.residual[half.rows], baseline, tried[half.rows]) for half, baseline in parts]
        return noise.with_restricted(self.measured, [half.stretch for half in self.halves], residuals)

    @functools.cached_property
    def factors(self) -> list[np.ndarray]:
        """Lower Cholesky factor (n, n) m of the noise of each half."""
        return noise.factors(self.fitted, [half.stretch for half in self.halves])

    @functools.cached_property
    def blocks(self) -> list[records.Block]:
        """One block a half, and one with where the phase centres are on the satellite, as far as that is known.

        A phase front that is curved alike in pitch and yaw is the phase centre's x by definition, and a turn of the
        star cameras is y and z: nothing but these places can tell them apart.
        """
        made = []
        for half, factor in zip(self.halves, self.factors, strict=True):
            column = self.column[half.rows] - self.column[half.rows].mean(axis=0)  # x is all bias where nothing turns
            rows = noise.white(factor, np.column_stack([self.residual[half.rows], column, half.slow]))
            channel, axis = np.array(["range"] * half.time.size), np.zeros(half.time.size, dtype=int)
            made.append(records.Block(half.label, rows[:, 0], rows[:, 1:7], rows[:, 7:], channel, axis, half.time))
        if made:
            place, sigma = 1e-3 * np.array([self.expected[name] for name in self.parameters]).T
            about = np.array(["prior"] * 6), np.tile([0, 1, 2], 2), np.arange(6, dtype=float)
            rows = (place - self.start) / sigma, np.diag(1 / sigma), np.zeros((6, 0))
            made.append(records.Block("known beforehand", *rows, *about))
        return made

    @functools.cached_property
    def candidates(self) -> list[records.Candidate]:
        """Effects as a whole and parameter by parameter, regressors, and phase breaks at many epochs."""
        parts = zip(self.halves, self.factors, strict=True)
        rows = [noise.white(factor, self.filtered[half.rows]) for half, factor in parts]
        made, first = [], 0
        for one in self.signals:
            last = first + len(one.names)
            columns = [*(part[:, first:last] for part in rows), None]
            whole = replace(one, columns=columns, of_frame=one.cause in FRAME, at=np.nan)
            if np.isfinite(one.at):
                made += [self._ripple(whole, one.at, form) for form in SATELLITES]
            else:
                made += [*whole.each_alone(), *_of_satellites(whole)] if whole.listed and not whole.form else [whole]
            first = last
        for number in dict.fromkeys(half.manoeuvre for half in self.halves if not self.far):
            members = [half for half in self.halves if half.manoeuvre == number]
            begin, end = members[0].time[0] + BREAK_MARGIN_S, members[-1].time[-1] - BREAK_MARGIN_S
            cuts = [half.time[0] + NEAR_CUT_S for half in members[1:]]
            made += self.breaks(np.unique(np.concatenate([np.arange(begin, end, BREAK_STEP_S), *cuts])))
        return made

    def _ripple(self, whole, period, form):
        """Ripple of the angles of some satellites, whose period may lie up to the next ones that are tried."""
        used = [k for k in range(8) if k % 4 // 2 in SATELLITES[form]]
        angle = np.nan_to_num(self.context.extra["angle"])

        def columns(value):
            rows = self.through(ripples(angle, value[0])[:, used])
            parts = zip(self.halves, self.factors, strict=True)
            return [*(noise.white(factor, rows[half.rows]) for half, factor in parts), None]

        ends = 1 / (1 / period + np.degrees(RIPPLE_STEP) * np.array([1, -1]))
        about = np.array([period]), columns, np.linspace(*ends, 9)[:, None], *ends[:, None]
        shape = records.Shape(("period",), ("rad",), *about, words=form)
        return replace(whole.part(used, form), form=f"{whole.form}{form and ', '}{form}", shape=shape)

    def breaks(self, epochs: np.ndarray) -> list[records.Candidate]:
        """Phase breaks at given epochs (k,) s of one sub-manoeuvre."""
        near = [k for k, half in enumerate(self.halves) if any(half.feels(epoch) for epoch in epochs)]
        columns = {k: noise.white(self.factors[k], self._steps(self.halves[k], epochs)) for k in near}
        made = []
        for i, epoch in enumerate(epochs):
            parts = [
                columns[k][:, i : i + 1] if k in columns and half.feels(epoch) else None
                for k, half in enumerate(self.halves)
            ]
            parts.append(None)
            label = next(half.label for half in self.halves if half.feels(epoch)).rpartition(" ")[0]
            form = f"{label}, time {epoch:.0f} s"
            made.append(records.Candidate(records.at_epoch(BREAK, epoch), form, ["size"], ["m"], parts, [1e-2]))
        return made

    def _steps(self, half, epochs):
        """Columns (n, k) of a range that is longer from an epoch on, at the rows of a half."""
        part = {name: getattr(self.through, name)[half.rows] for name in ("time", "start", "weights", "valid")}
        return replace(self.through, **part)((self.context.time[:, None] >= epochs).astype(float))

    def wave(self, search: records.LineSearch) -> Callable[[int, float], np.ndarray]:  # noqa: ARG002 - there is one
        """Whitened cosine and sine (n, 2) of a line in a half, by its number and the frequency in Hz."""

        def columns(k, frequency):
            if k == len(self.halves):
                return np.zeros((6, 2))
            phase = 2 * np.pi * frequency * (self.halves[k].time - self.context.epoch)
            return noise.white(self.factors[k], np.stack([np.cos(phase), np.sin(phase)], axis=1))

        return columns

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time, range less orbit of a half as the phase centres of the solution predict it, and rows in metres."""
        half = self.halves[number]
        model = self.column[half.rows] @ self.start
        return half.time, model[:, None], (self.factors[number] @ rows).T[:, :, None]

    def near(self, fitted: records.Fitted) -> list[records.Candidate]:
        """Phase breaks at epochs near that of a finding."""
        return self.breaks(records.epoch_of(fitted.candidate.cause) + FINE_S)

    def spacing(self, epoch: float) -> float:  # noqa: ARG002
        """Spacing s of the search for phase breaks."""
        return BREAK_STEP_S

    def physical(self, entry: records.Entry, fitted: records.Fitted) -> records.Entry:
        """A ripple with its period."""
        shape = fitted.candidate.shape
        if shape is None or entry.cause != RIPPLE:
            return entry
        sigma = None if shape.covariance is None else float(np.sqrt(shape.covariance[0, 0]))
        period = records.Parameter(float(shape.value[0]), sigma, "rad")
        return replace(entry, parameters=dict(entry.parameters) | {"period": period})

    def without(self, model: Sequence[records.Entry]) -> xr.Dataset:
        """Aligned records without the effects of a model.

        Readings less the contribution of their effects through the filter of the ranging; attitudes turned back, at the
        time that their tags should have had. A line is left where it is: its phase differs between manoeuvres.
        """
        time, records = self.context.time, self.aligned.copy(deep=True)
        total, attitude = np.zeros(time.size), records["quaternion"].values
        for entry in model:
            if not entry.listed:
                for one in (s for s in self.signals if (s.cause, s.form) == (entry.cause, entry.form)):
                    total += np.nan_to_num(one.columns[0] @ [entry.values.get(name, 0.0) for name in one.names])
                continue
            known = effect(entry.cause)
            added = known.contribution(self.context, known.values(entry.values))
            those = SATELLITES.get(entry.form.partition(",")[0], (0, 1))
            if entry.cause == "ranging.delay" and self.late[0]:  # by whole seconds; the rest in the range
                delay = entry.values["delay"]
                records = records.assign_coords(time_kbr=records["time_kbr"].values - np.rint(delay))
                added = added * (1 - np.rint(delay) / delay)
            if known.channel == "range":
                total += np.where(np.isfinite(added), added, 0.0)
            for k, q in ((k, attitude[k]) for k in those):
                good = np.isfinite(q).all(axis=1)
                if known.channel == "sca_delay":
                    attitude[k] = turned(time, q, added)
                elif known.channel == "pointing_b":
                    q[good] = frames.quaternion_product(q[good], frames.from_rotation_vector(-added[good]))
        for derivative, name in enumerate(OBSERVABLES if total.any() else ()):
            at = records["time_kbr"].values
            operator = crn.operator(self.filter_, derivative, self.good, (time[0], 1.0), at)
            records[f"reading_{name}"].values[:] -= np.where(operator.valid, operator(total), 0.0)
        return records.assign_attrs(model=" ".join(entry.cause for entry in model))


# What is tried: effects of the catalogue, and regressors from the measured channels that stand for effects in no list:
# powers, rates and lags of the pointing angles, products of two channels, waves along the orbit, sunlight, and decays
# from the start of a manoeuvre. Both satellites or one may have an effect; a ripple has any period and phase.


def context(aligned: xr.Dataset, pointed: xr.Dataset, nominal: np.ndarray) -> Context:
    """What the effects of the ranging look at, on whole seconds, as measured."""
    time, distance = pointed["time"].values, pointed["range_com"].values
    line, position = np.moveaxis(pointed["line_of_sight_b"].values, 0, 1), aligned["position_i"].values[0]
    known = np.isfinite(position).all(axis=1)
    orbit, position = time[known][::10], position[known][::10]  # of the first satellite
    normal = np.cross(position[0], position[min(100, len(position) - 1)])
    sun = orbit_environment.sun_i(orbit[[0, -1]]).mean(axis=0)
    along = {
        "argument": np.unwrap(orbit_environment.argument_of_latitude(position, normal)),
        "latitude": np.arcsin(position[:, 2] / np.linalg.norm(position, axis=1)),
        "sunlit": orbit_environment.sunlit(position, sun).astype(float),
    }
    extra = {name: np.interp(time, orbit, values) for name, values in along.items()}
    extra |= {
        "warmth": orbit_environment.warmth(time, orbit, position),
        "angle": np.moveaxis(pointed["angle"].values, 0, 1),
        "range": distance,
        "range_rate": np.gradient(distance - np.einsum("nka,ka->n", np.nan_to_num(line), nominal), time),
        "line_of_sight_b": line,
        "antenna_x": nominal[:, 0],
        "antenna_correction": np.einsum("nka,ka->n", line, nominal),
        "turning": turning(aligned, line),
    }
    return Context(time=time, epoch=middle(pointed), extra=extra)


def turning(aligned: xr.Dataset, line_b: np.ndarray) -> np.ndarray:
    """Change (n, 2, 3) s-1 of the lines of sight (n, 2, 3) by the turning of the satellites, the line itself held.

    l' - R_bi e', by differences over two seconds; error (2 pi / 250 s)^2 / 6, a ten thousandth. The noise of R_bi is
    that of the attitude times the orbital rate.
    """
    position, quaternion = aligned["position_i"].values, aligned["quaternion"].values
    line = position[1] - position[0]
    line = line / np.linalg.norm(line, axis=1, keepdims=True)
    result = np.zeros((line.shape[0], 2, 3))
    for k, toward in enumerate((line, -line)):
        q = np.where(np.isfinite(quaternion[k]), quaternion[k], [1.0, 0.0, 0.0, 0.0])
        rotation = frames.R_bi_from_quaternion(q)[1:-1]
        result[1:-1, k] = (line_b[2:, k] - line_b[:-2, k] - np.matvec(rotation, toward[2:] - toward[:-2])) / 2
    return result


def effects_of(context: Context, centre: np.ndarray) -> list[records.Candidate]:
    """Effects of the catalogue that a ranging calibration can show, with one column (n, q) m on whole seconds.

    A ripple with the angles has the columns of both satellites, and its period, rad, for a place.
    """
    signals = []
    for slug, entry in catalogue().items():
        if slug.partition(".")[0] not in FAMILIES or slug in (*NOT_HERE, RIPPLE):
            continue
        if entry.channel == "range":
            signals.append(listed(entry, [entry.columns(context)]))
        elif entry.channel in ("sca_delay", "pointing_b"):
            for form, those in SATELLITES.items():
                signals.append(listed(entry, [_of_attitude(entry, context, centre, those)], form))
    angle = np.nan_to_num(context.extra["angle"])
    for period in np.radians(1 / RIPPLES_PER_DEG):
        form = f"period {np.degrees(period):.3g} deg"
        ripple = listed(effect(RIPPLE), [ripples(angle, period)], form, slice(-1))
        signals.append(replace(ripple, at=float(period)))
    return signals


def _of_attitude(entry: Effect, context, centre, those):
    """Range per parameter of an effect on the attitude of some satellites.

    The orbit side of the residual holds -l . c with the measured line of sight. Star cameras late by a second measure
    l = l_true - delay * turning; a rotation phi from true to measured attitude adds -phi . sum l x c.
    """
    centre = centre * np.isin([0, 1], those)[:, None]
    if entry.channel == "sca_delay":
        return -np.einsum("nka,ka->n", context.extra["turning"], centre)[:, None] * entry.columns(context)
    arm = np.cross(context.extra["line_of_sight_b"], centre).sum(axis=1)
    return -np.einsum("na,naq->nq", arm, entry.columns(context))


def drivers(context: Context, starts: Sequence[float]) -> list[records.Candidate]:
    """Regressors for effects that are in no list; a rate times its angle is a late star camera."""
    extra, time = context.extra, context.time
    angle = np.nan_to_num(extra["angle"].reshape(-1, 4)) / SIZE
    rate = np.gradient(angle, time, axis=0) * 40.0  # 250 s / 2 pi
    signals = _each("pointing", "cube", angle**3) + _each("pointing", "fourth power", angle**4)
    signals += _each("pointing", "size", np.abs(angle))
    signals += _each("pointing_rate", "itself", rate) + _each("pointing_rate", "square", rate**2)
    signals += _each("pointing_rate", "size", np.abs(rate))
    for lag in LAGS_S:
        signals += _each("pointing", f"lag {lag:g} s", _lagged(angle, lag))
    for i, first in enumerate(PLACES):
        for j in range(i + 1, 4):
            form, product = f"product of {first} and {PLACES[j]}", angle[:, i] * angle[:, j]
            signals.append(_driver("pointing", form, ["range"], product[:, None]))
    others = {
        "latitude": np.sin(extra["latitude"]),
        "eclipse": extra["warmth"] - extra["warmth"].mean(),
        "time": ((time - context.epoch) / 43200.0) ** 2,
        "range_rate": extra["range_rate"] / max(np.nanmax(np.abs(extra["range_rate"])), 1e-9),
    }
    for name, values in others.items():
        signals += _each(f"pointing*{name}", f"{name} times the angle", angle * np.nan_to_num(values)[:, None])
    for cycles in CYCLES:
        phase = cycles * extra["argument"]
        wave, form = np.stack([np.sin(phase), np.cos(phase)], axis=1), f"wave of {cycles:g} cycles a revolution"
        signals.append(_driver("latitude", form, ["range_sine", "range_cosine"], wave))
    sunlit = extra["sunlit"][:, None]
    signals.append(_driver("eclipse", "sunlight", ["range"], sunlit))
    for lag in SUNLIGHT_LAGS_S:
        signals.append(_driver("eclipse", f"sunlight with a lag of {lag:g} s", ["range"], _lagged(sunlit, lag)))
    since = time[:, None] - np.array(starts)
    for decay in SETTLING_S:
        shape = np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0).sum(axis=1, keepdims=True)
        signals.append(_driver("time", f"decay of {decay:g} s from the start of a manoeuvre", ["range"], shape))
    return signals


def _driver(channel, form, names, columns):
    return records.Candidate(f"unknown:{channel}", form, names, ["m"] * len(names), [columns])


def _each(channel, form, values):
    """A function (n, 4) of all four angles together and of each of them."""
    names = [f"range_{place}" for place in PLACES]
    alone = [_driver(channel, f"{form} of {p}", [names[k]], values[:, k : k + 1]) for k, p in enumerate(PLACES)]
    return [_driver(channel, f"{form} of all angles", names, values), *alone]


def _lagged(values, lag_s):
    """Series (n, q) of whole seconds through a first-order lag."""
    keep = np.exp(-1 / lag_s)
    return lfilter([1 - keep], [1, -keep], values, axis=0)


def _of_satellites(whole: records.Candidate) -> list[records.Candidate]:
    """A cause with the parameters of one satellite, where it has several of each."""
    each = [[k for k, name in enumerate(whole.names) if name.endswith(f"_{letter}")] for letter in "ab"]
    return [whole.part(one, letter) for letter, one in zip("ab", each, strict=True) if len(one) > 1]


def _result(combined: xr.Dataset) -> tuple[str, np.ndarray, np.ndarray]:
    """Adopted observable, phase centres (6,) mm and covariance (6, 6) mm2 of "kbr_phase_centre.combine"."""
    name, estimator = (combined.attrs[f"adopted_{n}"] for n in ("observable", "estimator"))
    place = (combined.attrs["observables"].split().index(name), 0, ESTIMATORS.index(estimator))
    return name, 1e3 * combined["centre"].values[place], 1e6 * combined["covariance"].values[place]


NOTE = (
    "Range, range rate and range acceleration come from one phase; the range stands for all three. Only a tilted "
    "antenna feels the noise of the star cameras, so this part is that of the manoeuvres beside everything that a "
    "listed cause could explain."
)
REPORT = records.Reported(_result, NOTE, {"range": " The distance of the orbits is taken off, and the mean."})
