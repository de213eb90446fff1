"""Halves of the sub-manoeuvres of a campaign, and what effects and drivers in no list do to their ranges.

With a whole sub-manoeuvre left out, curvature and y or z of the same satellite cannot be told apart, and nothing could
be predicted; with half of one left out everything stays determined. Drivers are powers, rates and lags of the pointing
angles, products of two channels, waves along the orbit, sunlight, and decays from the start of a manoeuvre. Both
satellites or one may have an effect; a ripple has any period and phase.
"""

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.signal import lfilter

from gravcal.calibrations.align import LATE_S
from gravcal.calibrations.causes import listed, unknown
from gravcal.calibrations.kbr_phase_centre import model, noise
from gravcal.calibrations.kbr_phase_centre.align import interpolated
from gravcal.calibrations.kbr_phase_centre.estimate import of_manoeuvres
from gravcal.calibrations.kbr_phase_centre.model import OBSERVABLES, angles, middle
from gravcal.effects import Context, Effect, catalogue, effect
from gravcal.effects.ranging import ripples
from gravcal.estimation import crn
from gravcal.estimation.records import Candidate, Shape, at_epoch
from gravcal.estimation.resampling import Resampler
from gravcal.physics import frames, orbit_environment

BREAK, PLAUSIBLE_M = "ranging.phase_break", 1e-2
FAMILIES = ("ranging", "timing", "attitude")
#: No candidates: breaks are searched along time, two are the calibration itself, the last is in the noise model.
NOT_HERE = (BREAK, "ranging.phase_centre", "ranging.antenna_correction", "attitude.star_camera_noise")
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
LEAST = 60  # epochs that a half needs beyond its local columns
#: Degree of the slow orbit error in a half over that in the whole: 10 instead of 15 leaves less than 1 nm of 5 mm.
SHARE = 2 / 3
FILTER_S = 35.0  # half the support of the CRN filter of the ranging


@dataclass(frozen=True)
class Half:
    """Half of a sub-manoeuvre."""

    manoeuvre: int  #: number
    label: str  #: satellite, sign and axis, half
    rows: slice  #: places in the observations of all halves, one after the other
    time: np.ndarray  #: (n,) s
    slow: np.ndarray  #: (n, k) columns of slow orbit error and biases, not whitened
    place: np.ndarray  #: (n,) numbers of the epochs on an even grid
    lever: np.ndarray  #: (n, 1, 4) m, per radian

    def feels(self, epoch: float) -> bool:
        """True if a break at an epoch s reaches this half through the ranging filter."""
        return self.time[0] - FILTER_S < epoch < self.time[-1] + FILTER_S


@dataclass(frozen=True)
class Halves:
    """Halves of all sub-manoeuvres; candidate columns and noise are computed on demand."""

    records: xr.Dataset  #: "kbr_phase_centre.align" as it is
    measured: xr.Dataset  #: "kbr_phase_centre.noise"
    context: Context  #: Context on whole seconds
    filter_: crn.Crn  #: of the ranging
    good: np.ndarray  #: (n,) bool, seconds that it may use
    through: Resampler  #: from whole seconds to the rows
    parts: list[Half]
    residual: np.ndarray  #: (m,) m, ranging less orbit less the phase centres of the solution, each half less its mean
    column: np.ndarray  #: (m, 6) 1, of the phase centres
    start: np.ndarray  #: (6,) m, phase centres of the solution
    late: np.ndarray  #: (3,) s, delay of the tags of ranging and both star cameras, 0 unless minutes

    @functools.cached_property
    def quiet(self) -> float:
        """Effective number of samples of the noise: quiet ones for ranging, those of manoeuvres for star cameras."""
        inside, step = self.residual.size, float(self.measured.attrs["step_s"])
        samples = float(self.measured["seconds"]) / step if self.measured.attrs["source_data"] == "quiet" else inside
        return 1 / (1 / max(samples, 1.0) + 1 / max(inside, 1))

    @functools.cached_property
    def signals(self) -> list[Candidate]:
        """Candidates with columns (n, q) m on whole seconds: effects, then drivers; late tags alone if minutes off."""
        effects = effects_of(self.context, self.start.reshape(2, 3))
        if self.far:
            return [replace(one, apart=True) for one in effects if (one.cause, one.form) in self.far]
        return effects + drivers(self.context, [half.time[0] for half in self.parts])

    @functools.cached_property
    def far(self) -> dict[tuple[str, str], float]:
        """Delays of tags that are minutes off, {(slug of the cause, form): s}."""
        ranging, *camera_s = self.late
        cameras = {"": camera_s[0]} if camera_s[0] == camera_s[1] else {"a alone": camera_s[0], "b alone": camera_s[1]}
        delays = {("ranging.delay", ""): ranging} | {("timing.star_camera_delay", of): s for of, s in cameras.items()}
        return {cause_and_form: delay for cause_and_form, delay in delays.items() if delay}

    @functools.cached_property
    def filtered(self) -> np.ndarray:
        """Columns (m, q) m of all signals side by side, through the CRN filter, at the ranging epochs."""
        return np.concatenate([self.through(np.nan_to_num(signal.columns[0])) for signal in self.signals], axis=1)

    @functools.cached_property
    def fitted(self) -> xr.Dataset:
        """Dataset "kbr_phase_centre.noise" as of `noise.with_restricted`: from the halves, all listed effects free."""
        effect_columns = self.filtered[:, : sum(len(one.names) for one in self.signals if one.prior)]
        baselines = (np.column_stack([half.slow, self.column[half.rows]]) for half in self.parts)
        parts = zip(self.parts, baselines, strict=True)
        residuals = [(self.residual[half.rows], baseline, effect_columns[half.rows]) for half, baseline in parts]
        return noise.with_restricted(self.measured, self.parts, residuals)

    @functools.cached_property
    def factors(self) -> list[np.ndarray]:
        """Lower Cholesky factor (n, n) m of the noise of each half."""
        return noise.factors(self.fitted, self.parts)

    def white(self, columns: np.ndarray) -> list[np.ndarray | None]:
        """Whitened columns (n, q) of each half from those of all rows (m, q) m, and None for the block of the prior."""
        parts = zip(self.parts, self.factors, strict=True)
        return [*(noise.white(factor, columns[half.rows]) for half, factor in parts), None]

    def ripple(self, whole, period, form):
        """Candidate `whole` (8 columns) for the satellites of a form, its period rad free up to the next ones tried."""
        kept = [k for k in range(8) if k % 4 // 2 in SATELLITES[form]]
        angle = np.nan_to_num(self.context.extra["angle"])

        def columns(value):
            return self.white(self.through(ripples(angle, value[0])[:, kept]))

        bounds = 1 / (1 / period + np.degrees(RIPPLE_STEP) * np.array([1, -1]))
        shape_fields = np.array([period]), columns, np.linspace(*bounds, 9)[:, None], *bounds[:, None]
        shape = Shape(("period",), ("rad",), *shape_fields, words=form)
        return replace(whole.part(kept, form), form=f"{whole.form}{form and ', '}{form}", shape=shape)

    def breaks(self, epochs: np.ndarray) -> list[Candidate]:
        """Candidates of a range step, filtered and whitened, one for each of the epochs (k,) s of one sub-manoeuvre."""
        reached = [k for k, half in enumerate(self.parts) if any(half.feels(epoch) for epoch in epochs)]
        columns = {k: noise.white(self.factors[k], self._steps(self.parts[k], epochs)) for k in reached}
        candidates = []
        for i, epoch in enumerate(epochs):
            parts = {k: columns[k][:, i : i + 1] for k in reached if self.parts[k].feels(epoch)}
            form = f"{self.parts[min(parts)].label.rpartition(' ')[0]}, time {epoch:.0f} s"
            parts = [parts.get(k) for k in range(len(self.parts) + 1)]  # the last block, the prior, has none
            candidates.append(Candidate(at_epoch(BREAK, epoch), form, ["size"], ["m"], parts, [PLAUSIBLE_M]))
        return candidates

    def _steps(self, half, epochs):
        """Columns (n, k) of unit range steps at epochs (k,) s, through the ranging filter, at the rows of a half."""
        operator = {name: getattr(self.through, name)[half.rows] for name in ("time", "start", "weights", "valid")}
        return replace(self.through, **operator)((self.context.time[:, None] >= epochs).astype(float))


def halves_of(
    products: Mapping[str, xr.Dataset],
    late: np.ndarray,
    nominal: np.ndarray,
    *,
    orbit_degree: int,
    crn_window_s: float,
    crn_bandwidth_hz: float,
    band_hz,
    of_noise: Mapping,
    of_pointing: Mapping,
    of_observable: Mapping,
) -> Halves:
    """Halves of the sub-manoeuvres of a campaign with residuals, columns, noise and filter.

    Products as of `observations.observe`, settings those of their stages, of_noise, of_pointing and of_observable those
    of `noise.noise`, `model.pointing` and `model.observable`; nominal (2, 3) m. Tags of ranging and star cameras `late`
    (3,) s by minutes are moved back, and their effect stays in the rows to first order: nothing else is looked for.
    """
    aligned, pointed, equations, measured = (products[name] for name in ("align", "pointing", "observable", "noise"))
    records, centre = aligned, products["solve"]["centre"].values[0, 0]
    late = np.where(np.abs(late) > LATE_S, late, 0.0)
    if late[1:].all() and np.ptp(late[1:]) < LATE_S:
        late[1:] = np.rint(late[1:].mean())  # both off the line of sight, by the opposite
    if late.any():
        attitude_and_delay = zip(aligned["quaternion"].values, late[1:], strict=True)
        attitude = [turned(aligned["time"].values, *one) for one in attitude_and_delay]
        aligned = aligned.assign(quaternion=aligned["quaternion"].copy(data=attitude))
        aligned = aligned.assign_coords(time_kbr=aligned["time_kbr"].values - late[0])
        pointed = model.pointing(aligned, **of_pointing)
        equations = model.observable(aligned, pointed, **of_observable, nominal_m=nominal, variant=OBSERVABLES[0])
        measured, centre = noise.noise(equations, **of_noise), nominal.ravel()
    filter_ = crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz)
    time, good = pointed["time"].values, pointed["usable"].values != 0
    noisy = noise.of_star_cameras(measured, equations["lever"].values[equations["arc"].values >= 0, 0], band_hz[1])
    if noisy:
        pointed = smoothed(pointed, equations, band_hz[1])
        through = crn.operator(filter_, 0, good, (time[0], 1.0), equations["time_kbr"].values)
        column = -through(np.concatenate(list(pointed["line_of_sight_b"].values), axis=1))
        equations = equations.assign(column=equations["column"].copy(data=column))
        measured = noise.noise(equations, **of_noise).assign_attrs(smoothed_hz=band_hz[1])
    halves, rows = _cut(equations, orbit_degree, float(measured.attrs["step_s"]))
    centre = np.where(np.isfinite(centre), centre, nominal.reshape(6))
    through = crn.operator(filter_, 0, good, (time[0], 1.0), equations["time_kbr"].values[rows])
    column = equations["column"].values[rows]
    residual = _level(halves, equations["observed"].values[rows] - column @ centre)
    about = context(aligned, pointed, nominal)
    for part in _moving(time, equations) if noisy else ():
        for one in np.moveaxis(about.extra["line_rate"][part], 1, 0):  # noise of R_bi, which exceeds that of the range
            one[:] = noise.smoothed(one, band_hz[1])
    view = Halves(records, measured, about, filter_, good, through, halves, residual, column, centre, late)
    if late.any():
        with_delays = residual + view.filtered @ [view.far[one.cause, one.form] for one in view.signals]
        return replace(view, residual=_level(halves, with_delays))
    return view


def _level(halves, residual):
    """Residual (m,), changed in place, less the mean of each half: a bias of 220 km would cost six digits."""
    for half in halves:
        residual[half.rows] -= residual[half.rows].mean()
    return residual


def _cut(equations, orbit_degree, step):
    """Halves of the sub-manoeuvres, and the row numbers (m,) of "kbr_phase_centre.observable" that they hold."""
    degree, halves, places, first_row = int(np.ceil(SHARE * orbit_degree)), [], [np.zeros(0, dtype=int)], 0
    time, segment, lever = (equations[name].values for name in ("time_kbr", "segment", "lever"))
    for number, manoeuvre_rows in enumerate(of_manoeuvres(equations)):
        satellite, axis, sign = (int(equations[n][number]) for n in ("satellite_index", "axis_index", "sign"))
        name = f"{number + 1} {equations.attrs['satellites'][satellite]} {('', '+', '-')[sign]}{('pitch', 'yaw')[axis]}"
        for rows, half_name in zip(np.array_split(manoeuvre_rows, 2), ("begin", "end"), strict=True):
            slow = noise.slow_columns(time[rows], segment[rows], degree, 0)
            if rows.size > slow.shape[1] + LEAST:
                place = np.rint((time[rows] - time[rows[0]]) / step).astype(int)
                fields = slice(first_row, first_row + rows.size), time[rows], slow, place, lever[rows, :1]
                halves.append(Half(number, f"{name} {half_name}", *fields))
                places.append(rows)
                first_row += rows.size
    return halves, np.concatenate(places)


def turned(time: np.ndarray, quaternion: np.ndarray, late) -> np.ndarray:
    """Attitudes (n, 4) whose tags are late by a scalar or (n,) s, interpolated to true times; NaN beyond the record."""
    if not np.any(late):
        return quaternion
    good, at = np.isfinite(quaternion).all(axis=1), time + late
    ends = time[good][[0, -1]]
    attitude = interpolated(time[good], quaternion[good], np.clip(at, *ends), 10.0)
    attitude[(at < ends[0] - LATE_S) | (at > ends[1] + LATE_S)] = np.nan
    return attitude / np.linalg.norm(attitude, axis=1, keepdims=True)


def smoothed(pointed: xr.Dataset, equations: xr.Dataset, highest_hz: float) -> xr.Dataset:
    """Product "kbr_phase_centre.pointing" with lines of sight smoothed in quiet data and manoeuvres, slews as they are.

    Where star cameras are noisier than the range, their noise is in the rows and in every column that is made of the
    lines of sight, and the columns explain it (errors in variables).
    """
    line = pointed["line_of_sight_b"].values.copy()
    for rows in _moving(pointed["time"].values, equations):
        for vectors in line[:, rows]:
            missing = ~np.isfinite(vectors).all(axis=1)
            vectors[:, 1:] = noise.smoothed(vectors[:, 1:], highest_hz)
            vectors[:, 0] = np.sqrt(1 - np.sum(vectors[:, 1:] ** 2, axis=1))
            vectors[missing] = np.nan
    new = {"line_of_sight_b": line, "angle": angles(line)}
    return pointed.assign({name: pointed[name].copy(data=values) for name, values in new.items()})


def _moving(time, equations):
    """Yield slices of the whole seconds (n,), one for each stretch of quiet data and each manoeuvre, without slews."""
    time_kbr, arc = equations["time_kbr"].values, equations["arc"].values
    for rows in np.split(np.arange(time_kbr.size), np.flatnonzero(np.diff(arc)) + 1):
        if arc[rows[0]] != -2:
            yield slice(*np.searchsorted(time, [time_kbr[rows[0]] - FILTER_S - 1, time_kbr[rows[-1]] + FILTER_S + 1]))


def context(aligned: xr.Dataset, pointed: xr.Dataset, nominal: np.ndarray) -> Context:
    """Context of the ranging effects on whole seconds: orbit, sunlight, pointing, range; phase centres (2, 3) m."""
    time, distance = pointed["time"].values, pointed["range_com"].values
    line, position = np.moveaxis(pointed["line_of_sight_b"].values, 0, 1), aligned["position_i"].values[0]
    valid = np.isfinite(position).all(axis=1)
    orbit, position = time[valid][::10], position[valid][::10]  # of the first satellite
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
        "line_rate": line_rate(aligned, line),
    }
    return Context(time=time, epoch=middle(pointed), extra=extra)


def line_rate(aligned: xr.Dataset, line_b: np.ndarray) -> np.ndarray:
    """Derivative (n, 2, 3) s-1 of lines of sight (n, 2, 3) in b by the rotation of the satellites alone.

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


def effects_of(context: Context, centre: np.ndarray) -> list[Candidate]:
    """Candidates of the catalogue that a ranging calibration can show, one column array (n, q) m on whole seconds.

    Phase centres are (2, 3) m. A ripple has the columns of both satellites, and its period rad in `at`.
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
    """Range (n, q) m per parameter of an effect on the attitude of some satellites `those`; phase centres (2, 3) m.

    The orbit side of the residual holds -l . c with the measured line of sight. Star cameras late by a second measure
    l = l_true - delay * line_rate; a rotation phi from true to measured attitude adds -phi . sum l x c.
    """
    centre = centre * np.isin([0, 1], those)[:, None]
    if entry.channel == "sca_delay":
        return -np.einsum("nka,ka->n", context.extra["line_rate"], centre)[:, None] * entry.columns(context)
    arm = np.cross(context.extra["line_of_sight_b"], centre).sum(axis=1)
    return -np.einsum("na,naq->nq", arm, entry.columns(context))


def drivers(context: Context, starts: Sequence[float]) -> list[Candidate]:
    """Candidates in no list, (n, q) m; decays begin at starts s. Rate times angle is none: a late star camera."""
    extra, time = context.extra, context.time
    angle = np.nan_to_num(extra["angle"].reshape(-1, 4)) / SIZE
    rate = np.gradient(angle, time, axis=0) * 40.0  # 250 s / 2 pi
    signals = _of_angles("pointing", {"cube": angle**3, "fourth power": angle**4, "size": np.abs(angle)})
    signals += _of_angles("pointing_rate", {"itself": rate, "square": rate**2, "size": np.abs(rate)})
    signals += _of_angles("pointing", {f"lag {lag:g} s": _lagged(angle, lag) for lag in LAGS_S})
    for (i, first), (j, second) in itertools.combinations(enumerate(PLACES), 2):
        signals.append(_of_range("pointing", f"product of {first} and {second}", angle[:, i] * angle[:, j]))
    modulators = {
        "latitude": np.sin(extra["latitude"]),
        "eclipse": extra["warmth"] - extra["warmth"].mean(),
        "time": ((time - context.epoch) / 43200.0) ** 2,
        "range_rate": extra["range_rate"] / max(np.nanmax(np.abs(extra["range_rate"])), 1e-9),
    }
    for name, values in modulators.items():
        signals += _of_angles(f"pointing*{name}", {f"{name} times the angle": angle * np.nan_to_num(values)[:, None]})
    for cycles in CYCLES:
        phase, form = cycles * extra["argument"], f"wave of {cycles:g} cycles a revolution"
        wave = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        signals.append(_of_range("latitude", form, wave, ("range_sine", "range_cosine")))
    light, since = extra["sunlit"], time[:, None] - np.array(starts)
    signals.append(_of_range("eclipse", "sunlight", light))
    signals += [_of_range("eclipse", f"sunlight with a lag of {s:g} s", _lagged(light, s)) for s in SUNLIGHT_LAGS_S]
    for decay in SETTLING_S:
        shape = np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0).sum(axis=1)
        signals.append(_of_range("time", f"decay of {decay:g} s from the start of a manoeuvre", shape))
    return signals


def _of_range(driver, form, values, names=("range",)):
    """Candidate of a driver that adds values (n,) or (n, q) m to the range."""
    return unknown(driver, form, [values.reshape(len(values), -1)], "m", names)


def _of_angles(driver, functions):
    """Candidates of functions {form: (n, 4)} of pitch and yaw of both satellites: all four, then each alone."""
    names, made = [f"range_{place}" for place in PLACES], []
    for form, values in functions.items():
        made.append(_of_range(driver, f"{form} of all angles", values, names))
        made += [_of_range(driver, f"{form} of {p}", values[:, k], names[k : k + 1]) for k, p in enumerate(PLACES)]
    return made


def _lagged(values, lag_s):
    """Series (n, ...) of whole seconds through a first-order low-pass of time constant `lag_s`."""
    keep = np.exp(-1 / lag_s)
    return lfilter([1 - keep], [1, -keep], values, axis=0)
