"""A day of S-GRS as discovery sees it: the difference of both sensors, attitude against angular readings, torques.

The drag is free at every epoch, so that it takes up the mean reading of the sensors and leaves their difference.
Distance of the sensors, a constant torque and the centre of pressure are free as well.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.linalg import block_diag, solve_triangular

from gravcal.calibrations.gradient_torque import attitude
from gravcal.calibrations.gradient_torque.estimate import uncontrolled_torque
from gravcal.calibrations.gradient_torque.model import METHODS, box_inertia, free_mass_angular_acceleration, orbit
from gravcal.effects import Context, Effect, effect
from gravcal.effects.gradient import EFFECTS
from gravcal.estimation import noise
from gravcal.estimation.least_squares import orthonormal
from gravcal.estimation.records import Bias, Block, Candidate, Entry, Observations, Reported
from gravcal.physics import (
    earth,
    frames,
    gravity,
    gravity_field,
    kinematics,
    magnetic,
    orbit_environment,
    sensing,
)

#: Global parameters: centre of pressure m, constant torque N m, distance of the sensors m.
PLACES = {"pressure": slice(0, 3), "constant": slice(3, 6), "distance": slice(6, 9)}
GLOBAL = 9
CHANNELS = ("linear", "attitude", "torque")
UNITS = {"linear": "m s-2", "attitude": "rad s-2", "torque": "N m"}
METHOD = METHODS.index("two_sensor")  # motion from all sensors
BLOCK_S = 7200.0  # more than a revolution, so that each block sees every latitude
#: Effects of other families that such a satellite can have.
LINEAR = tuple(f"accelerometer.{n}" for n in ("scale", "misalignment", "cross_talk", "bias_drift", "temperature"))
ANGULAR = tuple(f"accelerometer.angular_{name}" for name in ("scale", "misalignment"))
TORQUE = tuple(f"torque.{name}" for name in ("aerodynamic", "gravity_gradient", "residual_dipole"))
POINTING, TESSERAL = "attitude.star_camera_misalignment", "gradient.tesseral"
HIGHEST = 20  # degree of a coefficient that is looked for
LAST_FIELD = 9.46e8  # GPS s, end of 2029: the geomagnetic field of later days is that of its model then
HARMONICS = (1, 2, 3, 4)  # of the argument of latitude, by which something may follow the orbit
#: Drivers that torques do not move: motion answers a torque, and would explain any.
OUTSIDE = ("latitude", "time")


def observe(products: Mapping[str, xr.Dataset], **settings) -> GradientTorque:
    """Observations of the products of a day.

    Parameters
    ----------
    products : "ingest", "gradient", and "drag" by one sensor
    settings : satellite, igrf_generation, elongation, gap_limit_s, torque_step_s, torque_noise_order, control_hz,
        control_damping, bin_s, stretch_s, noise_order
    """
    observed, modelled, found = (products[name] for name in ("ingest", "gradient", "drag"))
    position, velocity = orbit(observed, settings["gap_limit_s"])
    R_bi = attitude.R_bo(modelled["angle"].values[METHOD]) @ attitude.orbit_frame(position, velocity)
    about = _context(modelled, found, R_bi, position, settings)
    channels = _channels(about, R_bi, observed, modelled, settings)
    satellite = settings["satellite"]
    pressure, apart = (
        np.array(satellite["centre_of_pressure"]),
        np.linalg.norm(satellite["sensor_position_sigma"], axis=0),
    )
    sigma, prior = np.concatenate([satellite["centre_of_pressure_sigma"], apart]), np.zeros((6, 1 + GLOBAL))
    prior[:3, 0] = pressure / sigma[:3]
    prior[np.arange(6), 1 + np.r_[PLACES["pressure"], PLACES["distance"]]] = 1 / sigma
    parts = [*(channel.rows for channel in channels.values()), prior]
    rows = np.concatenate(parts)
    scale = np.maximum(np.linalg.norm(rows[:, 1:], axis=0), 1e-300)
    solution = np.linalg.lstsq(rows[:, 1:] / scale, rows[:, 0], rcond=None)[0] / scale
    for part in parts:  # what is found are changes of the solution
        part[:, 0] -= part[:, 1:] @ solution
    start = found["pressure"].values if "pressure" in found else pressure
    variance = np.diagonal(found["covariance"].values, axis1=1, axis2=2)
    drag_sigma = float(np.sqrt(np.nanmean(variance)))
    return GradientTorque(observed, about, channels, prior, start, drag_sigma, settings)


def _context(modelled, found, R_bi, position, settings):
    """What effects look at, at the epochs of the record."""
    time, satellite = modelled["time"].values, settings["satellite"]
    R_ei = earth.R_ei(time)
    position_e, R_be = np.matvec(R_ei, position), R_bi @ np.swapaxes(R_ei, 1, 2)
    extra = {
        "positions": modelled["sensor_position_b"].values,
        "mass": satellite["mass"],
        "non_gravitational_b": np.nan_to_num(found["drag_b"].values),
        "warmth": orbit_environment.warmth(time, time, position),
        "position_e": position_e,
        "R_be": R_be,
    }
    field_e = magnetic.field_e(np.minimum(time, LAST_FIELD), position_e, settings["igrf_generation"])
    about = Context(
        time,
        epoch=time[0],
        inertia_b=np.array(satellite["inertia"]),
        field_b=np.matvec(R_be, field_e),
        gradient_b=modelled["gradient_b"].values,
        rate_b=modelled["rate_b"].values[METHOD],
        rate_dot_b=modelled["rate_dot_b"].values[METHOD],
        extra=extra,
    )
    return _of_degree(about, 2, 2)


def _of_degree(about, degree, order):
    """Context with the gravity gradient of C_nm = 1 and of S_nm = 1."""
    both, R_be = gravity_field.tesseral_gradient_e(about.extra["position_e"], degree, order), about.extra["R_be"]
    turned = np.stack([gravity.rotate_tensor(R_be, both[:, k]) for k in range(2)], axis=1)
    return replace(about, extra=about.extra | {"tesseral_b": turned})


@dataclass(frozen=True)
class Channel:
    """One channel in bins, with its noise.

    Attributes
    ----------
    width : epochs in a bin; time : (m,) s; good : (m,) bool, bins with data
    models : noise models of the axes, none for the attitude
    R_bi : (m, 3, 3) of the bins of the attitude, None for the others
    stretches : (begin, end, (3 k, 3 k) rad Cholesky factor of the noise) of the attitude
    rows : (n, 1 + GLOBAL) whitened: observed, columns of the global parameters
    """

    width: int
    time: np.ndarray
    good: np.ndarray
    models: tuple = ()
    R_bi: np.ndarray | None = None
    stretches: tuple = ()
    rows: np.ndarray | None = None

    def whitened(self, added: np.ndarray) -> np.ndarray:
        """Rows (n, q) of what is added at the epochs, (epochs, 3, q) m s-2, N m, rad s-2 of the angular reading."""
        bins = np.nan_to_num(means(added, self.width))
        if self.models:
            return np.concatenate([noise.whiten(model, bins[:, k], self.good) for k, model in enumerate(self.models)])
        angle = [integrated(self.time[b:e], self.R_bi[b:e], bins[b:e]) for b, e, _ in self.stretches]
        return self.whitened_angles(angle, added.shape[2])

    def whitened_angles(self, angles: Sequence[np.ndarray], width: int) -> np.ndarray:
        """Rows (n, q) of angles (k, 3, q) rad of each stretch."""
        rows = [np.zeros((0, width))]
        for angle, (_, _, lower) in zip(angles, self.stretches, strict=True):
            rows.append(solve_triangular(lower, angle.reshape(-1, width), lower=True))
        return np.concatenate(rows)

    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s and axis of the rows, and the time by which they belong to a block: a stretch to that it begins in."""
        if self.models:
            time = np.tile(self.time, 3)
            return time, np.repeat([0, 1, 2], self.time.size), time
        time = np.repeat(np.concatenate([np.zeros(0), *(self.time[b:e] for b, e, _ in self.stretches)]), 3)
        size = np.array([3 * (e - b) for b, e, _ in self.stretches], dtype=int)
        return time, np.tile([0, 1, 2], time.size // 3), np.repeat([self.time[b] for b, _, _ in self.stretches], size)

    def free(self, stretch: tuple) -> np.ndarray:
        """Whitened columns (3 k, 6) of start and rate of the attitude of a stretch."""
        begin, end, lower = stretch
        R_bi = self.R_bi[begin:end]
        start = R_bi @ np.broadcast_to(R_bi[0].T, R_bi.shape)
        rate = kinematics.angle_from_rate_change(self.time[begin:end], R_bi, np.broadcast_to(np.eye(3), R_bi.shape))
        return solve_triangular(lower, np.concatenate([start, rate], axis=2).reshape(-1, 6), lower=True)


def _channels(about, R_bi, observed, modelled, settings):
    """Channels that the record has: {name: Channel}."""
    found = {}
    if len(about.extra["positions"]) == 2:  # the difference of the readings less its model
        tensor, linear = _tensor(about), modelled["linear_b"].values
        apart = about.extra["positions"][0] - about.extra["positions"][1]
        difference = linear[:, 0] - linear[:, 1] + np.matvec(tensor, apart)
        effects = [added["linear"] for _, _, added in listed(about, ("linear",)) if "linear" in added]
        noise_model = settings["bin_s"], settings["noise_order"]
        found["linear"] = _coloured(about.time, difference, {"distance": -tensor}, effects, *noise_model)
    found["attitude"] = _attitude(about, R_bi, observed, modelled, settings)
    if settings["control_hz"] > 0:
        control = settings["control_hz"], settings["control_damping"]
        torque = uncontrolled_torque(modelled, "two_sensor", about.inertia_b, *control)
        arm = -about.extra["mass"] * frames.cross_matrix(about.extra["non_gravitational_b"])
        noise_model = settings["torque_step_s"], settings["torque_noise_order"]
        found["torque"] = _coloured(about.time, torque, {"pressure": arm, "constant": np.eye(3)}, [], *noise_model)
    return found


def _width(time, bin_s):
    """Epochs in a bin."""
    return max(1, round(bin_s / float(np.median(np.diff(time)))))


def _coloured(time, series, columns, effects, bin_s, order):
    """Channel with a noise model of each axis, beside the columns of the global parameters.

    In the difference of the sensors everything that a listed effect adds is free as well, and jumps are, so that none
    is noise; what the fit took from the noise is put back. A torque is not: attitude answers it, and so does what acts
    on attitude.
    """
    observed, width = np.zeros((len(series), 3, 1 + GLOBAL)), _width(time, bin_s)
    observed[:, :, 0] = series
    for name, part in columns.items():
        observed[:, :, 1:][:, :, PLACES[name]] = part
    bins = means(observed, width)
    good = np.isfinite(bins).all(axis=(1, 2))
    left = np.where(good[:, None], bins[:, :, 0], np.nan)
    beside = np.nan_to_num(np.concatenate([bins[:, :, 1:], *(means(one, width) for one in effects)], axis=2))
    for axis in range(3 if effects else 0):
        found = noise.jumps(lambda places, a=axis, b=beside: _left_beside(left, _with_jumps(b, a, places))[:, a])
        beside = _with_jumps(beside, axis, found)
    models = tuple(noise.fit_detrended([left], noise.beside([left], [beside]), order, bin_s))
    channel = Channel(width, means(time, width), good, models)
    return replace(channel, rows=channel.whitened(observed))


def _with_jumps(beside, axis, places):
    """Columns (m, 3, q) and those of jumps of an axis."""
    columns = np.zeros((len(beside), 3, 2 * len(places)))
    columns[:, axis] = noise.jump_columns(len(beside), places)
    return np.concatenate([beside, columns], axis=2)


def _left_beside(series, columns):
    """What is left of bins (m, 3) beside columns (m, 3, q), zero where there are none."""
    good = np.isfinite(series).all(axis=1)
    basis, flat = orthonormal(columns[good].reshape(-1, columns.shape[2]), noise.DEPENDENT), series[good].ravel()
    left = np.zeros_like(series)
    left[good] = (flat - basis @ (basis.T @ flat)).reshape(-1, 3)
    return left


def _attitude(about, R_bi, observed, modelled, settings):
    """Channel of the star camera against the angular readings: angles of each stretch, its start and rate free."""
    width = _width(about.time, settings["bin_s"])
    turned = R_bi @ np.swapaxes(frames.R_bi_from_quaternion(observed["q"].values), 1, 2)
    angle = np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2
    angular = modelled["angular_b"].values.mean(axis=1)
    inertia = box_inertia(settings["satellite"], settings["elongation"])
    free = free_mass_angular_acceleration(inertia, about.gradient_b, about.rate_b)
    residual = angular - (free - about.rate_dot_b)
    time, turned = means(about.time, width), means(R_bi, width)
    bins = means(angle, width)
    good = np.isfinite(bins).all(axis=1) & np.isfinite(means(residual, width)).all(axis=1)
    # white noise of one bin, from differences of neighbouring samples of a series that changes slowly
    angle_sigma, angular_sigma = (
        np.sqrt(np.nanmean(np.diff(series, axis=0) ** 2, axis=0) / 2 / width) for series in (angle, angular)
    )
    size, stretches = max(4, round(settings["stretch_s"] / np.median(np.diff(time)))), []
    for begin in range(0, time.size - size + 1, size):
        end = begin + size
        if good[begin:end].all():
            units = np.eye(3 * size).reshape(size, 3, 3 * size) * np.tile(angular_sigma, size)
            P = integrated(time[begin:end], turned[begin:end], units).reshape(3 * size, -1)
            stretches.append((begin, end, np.linalg.cholesky(P @ P.T + np.diag(np.tile(angle_sigma**2, size)))))
    channel = Channel(width, time, good, R_bi=turned, stretches=tuple(stretches))
    rows = channel.whitened_angles([bins[begin:end, :, None] for begin, end, _ in stretches], 1)
    rows = rows + channel.whitened(residual[:, :, None])
    return replace(channel, rows=np.concatenate([rows, np.zeros((len(rows), GLOBAL))], axis=1))


def integrated(time: np.ndarray, R_bi: np.ndarray, rate_dot_b: np.ndarray) -> np.ndarray:
    """Rotation (k, 3, q) rad that grows from additional angular accelerations (k, 3, q) rad s-2, at rest at the start.

    Parameters
    ----------
    time : (k,) s; R_bi : (k, 3, 3); rate_dot_b : (k, 3, q)
    """
    return kinematics.angle_from_rate_change(time, R_bi, kinematics.running_integral(time, rate_dot_b))


def means(series: np.ndarray, width: int) -> np.ndarray:
    """Means (m, ...) of `width` neighbouring samples (n, ...), of those there are; NaN where there are none."""
    whole = len(series) // width * width
    parts = series[:whole].reshape(-1, width, *series.shape[1:])
    known = np.isfinite(parts)
    count = known.sum(axis=1)
    return np.where(count > 0, np.where(known, parts, 0.0).sum(axis=1), np.nan) / np.maximum(count, 1)


def listed(about: Context, channels: Sequence[str]) -> Iterator[tuple[Effect, int, dict[str, np.ndarray]]]:
    """Effect, number of the sensor that has it (0: all have), and what it adds by each parameter {channel: (n, 3, q)}.

    Parameters
    ----------
    about : Context of the epochs
    channels : those that the record has
    """
    yield from ((entry, 0, _added(about, entry)) for entry in EFFECTS)
    for entry in map(effect, LINEAR if "linear" in channels else ()):
        for sensor, sign in enumerate((-1.0, 1.0)):
            columns = entry.columns(replace(about, linear_b=_reading(about, sensor)))
            yield entry, sensor + 1, {"linear": sign * columns}
    others = (*ANGULAR, *(TORQUE if "torque" in channels else ()), POINTING)
    yield from ((entry, 0, _added(about, entry)) for entry in map(effect, others))


def _added(about, entry):
    """What an effect adds to the channels by each parameter, {channel: (n, 3, q)}, SI; files hold minus a reading."""
    if entry.channel == "linear_each_b":
        each = entry.columns(about)
        return {"linear": each[:, 1] - each[:, 0] if each.shape[1] == 2 else np.zeros_like(each[:, 0])}
    if entry.channel == "angular_each_b":
        return {"attitude": -entry.columns(about).mean(axis=1)}
    if entry.channel == "angular_b":
        return {"attitude": -entry.columns(replace(about, angular_b=about.rate_dot_b))}
    if entry.channel == "torque_b":
        return {"torque": entry.columns(about)}
    if entry.channel == "dipole_b":
        return {"torque": np.cross(entry.columns(about), about.field_b[:, :, None], axis=1)}
    # a star camera that is turned: what it calls b is not the frame that the sensors read in
    turned = {"attitude": np.moveaxis(np.cross(about.rate_dot_b[:, None], np.eye(3)), 1, 2)}
    if len(about.extra["positions"]) == 2:
        tensor, apart = _tensor(about), about.extra["positions"][0] - about.extra["positions"][1]
        crosses = [frames.cross_matrix(axis) for axis in np.eye(3)]
        turned["linear"] = np.stack([np.matvec(tensor @ c - c @ tensor, apart) for c in crosses], axis=2)
    return turned


def _tensor(about):
    return sensing.offset_tensor(about.rate_b, about.rate_dot_b, about.gradient_b)


def _reading(about, sensor):
    """What the model says an accelerometer in the place of a sensor reads, (n, 3) m s-2."""
    return sensing.proof_mass_reading(
        about.extra["non_gravitational_b"], _tensor(about), about.extra["positions"][sensor]
    )


def drivers(about: Context) -> Iterator[tuple[str, str, np.ndarray]]:
    """Drivers, their forms, and what follows them, (n,) 1 of a size near one: readings, drag, attitude, orbit, time.

    Of the readings of a sensor products: in proportion to them are scale, misalignment and cross-talk.
    """
    for sensor in range(len(about.extra["positions"])):
        reading = _reading(about, sensor)
        reading = reading / np.maximum(np.abs(reading).max(axis=0), 1e-300)
        for one, other in itertools.combinations_with_replacement(range(3), 2):
            words = f"square of {'xyz'[one]}" if one == other else f"product {'xyz'[one]}{'xyz'[other]}"
            yield "reading", f"{words} of sensor {sensor + 1}", reading[:, one] * reading[:, other]
    drag, rate = about.extra["non_gravitational_b"], about.rate_b - about.rate_b.mean(axis=0)
    for name, values in (("drag", drag), ("rate", rate), ("angular_acceleration", about.rate_dot_b)):
        for axis, letter in enumerate("xyz"):
            one = values[:, axis] - values[:, axis].mean()
            one = one / max(np.abs(one).max(), 1e-300)
            yield name, f"component {letter}", one
            yield name, f"square of {letter}", one**2
    fastest = int(np.argmax(np.abs(about.rate_b.mean(axis=0))))
    argument = np.cumsum(about.rate_b[:, fastest] * np.diff(about.time, prepend=about.time[0]))  # along the orbit
    for order in HARMONICS:
        yield "latitude", f"cosine of {order} times its argument", np.cos(order * argument)
        yield "latitude", f"sine of {order} times its argument", np.sin(order * argument)
    yield "time", "straight line", (about.time - about.time[0]) / (about.time[-1] - about.time[0]) - 0.5


@dataclass(frozen=True)
class GradientTorque(Observations):
    """Observations of a day."""

    record: xr.Dataset  #: Dataset, "ingest"
    about: Context  #: Context of its epochs
    made: Mapping[str, Channel]  #: {channel: Channel} of those that it has
    prior: np.ndarray  #: (k, 1 + GLOBAL) what is known of the global parameters beforehand, over its standard deviation
    start: np.ndarray  #: (3,) m, centre of pressure
    drag_sigma: float  #: m s-2, of the drag, rms
    settings: Mapping  #: of `observe`

    name = "gradient_torque"
    channels = CHANNELS
    parameters = tuple(f"centre_of_pressure_{axis}" for axis in "xyz")
    unit, scale = "mm", np.full(3, 1e3)
    contiguous = True

    @property
    def noise_order(self) -> dict[str, int]:
        """Coefficients of the noise models."""
        return {"linear": self.settings["noise_order"], "torque": self.settings["torque_noise_order"]}

    @functools.cached_property
    def _places(self) -> list[dict[str, np.ndarray]]:
        """Numbers of the rows of each channel in each block."""
        time = self.about.time
        count = max(2, int((time[-1] - time[0]) / BLOCK_S))
        edges, found = np.linspace(time[0], time[-1] + 1e-6, count + 1), [{} for _ in range(count)]
        for name, channel in self.made.items():
            number = np.clip(np.searchsorted(edges, channel.places()[2], side="right") - 1, 0, count - 1)
            for k in range(count):
                found[k][name] = np.flatnonzero(number == k)
        return found

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """Stretches of two hours, and what was known beforehand."""
        found, places = [], {name: channel.places() for name, channel in self.made.items()}
        for number, rows_of in enumerate(self._places, start=1):
            rows = np.concatenate([self.made[name].rows[rows] for name, rows in rows_of.items()])
            time, axis = (np.concatenate([places[name][k][rows] for name, rows in rows_of.items()]) for k in (0, 1))
            channel = np.concatenate([np.array([name] * rows.size) for name, rows in rows_of.items()])
            attitude_rows, at = self.made["attitude"], np.flatnonzero(channel == "attitude")
            begins = set(places["attitude"][2][rows_of["attitude"]])
            own = [attitude_rows.free(one) for one in attitude_rows.stretches if attitude_rows.time[one[0]] in begins]
            local = np.zeros((len(rows), 6 * len(own)))
            local[at] = block_diag(*own) if own else 0.0
            found.append(Block(f"stretch {number}", rows[:, 0], rows[:, 1:], local, channel, axis, time))
        known, count = self.prior, len(self.prior)
        axis, channel = np.argmax(known[:, 1:] > 0, axis=1) % 3, np.array(["prior"] * count)
        about = channel, axis, np.arange(count, dtype=float)
        return [*found, Block("known beforehand", known[:, 0], known[:, 1:], np.zeros((count, 0)), *about)]

    def _columns(self, added):
        """Columns of every block from what is added to the channels, {channel: (n, 3, q)} SI."""
        known = {name: self.made[name].whitened(values) for name, values in added.items() if name in self.made}
        width, columns = next(iter(added.values())).shape[2], []
        for rows_of in self._places if known else ():
            parts = [known[c][rows] if c in known else np.zeros((rows.size, width)) for c, rows in rows_of.items()]
            columns.append(np.concatenate(parts))
        return [*(columns or [None] * len(self._places)), None]

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Effects of the catalogue with all their parameters and each alone, then the drivers in each channel."""
        found = []
        for entry, sensor, added in listed(self.about, self.made):
            names = [f"{p.name}_{sensor}" if sensor else p.name for p in entry.parameters]
            units, prior = [p.unit for p in entry.parameters], [p.prior_sigma for p in entry.parameters]
            form = f"sensor {sensor}" if sensor else ""
            found += Candidate(entry.slug, form, names, units, self._columns(added), prior).each_alone()
        entry = effect(TESSERAL)
        names, units, prior = zip(*((p.name, p.unit, p.prior_sigma) for p in entry.parameters), strict=True)
        orders = [(n, m) for n in range(3, HIGHEST + 1) for m in range(1, n + 1)] if "linear" in self.made else []
        for degree, order in orders:
            columns = self._columns(_added(_of_degree(self.about, degree, order), entry))
            form = f"degree {degree}, order {order}"
            found.append(Candidate(TESSERAL, form, list(names), list(units), columns, list(prior), apart=True))
        for channel in self.made:
            for driver, form, shape in drivers(self.about):
                if channel != "torque" or driver in OUTSIDE:
                    columns = self._columns({channel: shape[:, None, None] * np.eye(3)})
                    names, units = [f"{channel}_{axis}" for axis in "xyz"], [UNITS[channel]] * 3
                    found.append(Candidate(f"unknown:{driver}", f"{channel}, {form}", names, units, columns))
        return found

    def response(self, entry: Entry) -> list[np.ndarray]:
        """Whitened rows of each block that an effect adds beside a record `without` it; a torque stays in there."""
        stays = entry.listed and effect(entry.cause).channel in ("torque_b", "dipole_b")
        return super().response(replace(entry, parameters={}) if stays else entry)

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Record without the effects of a model, so that the baseline describes what is left.

        A torque turns the satellite itself and stays in the record: it changes the torque balance alone.
        """
        extended = self.record.copy(deep=True)
        for entry in model:
            linear, angular = self._contribution(entry)
            extended["linear"].values[:] += linear  # minus a reading is what the files hold
            extended["angular"].values[:] += angular
            if entry.cause == POINTING:
                turn = -effect(POINTING).values(entry.values)
                back = frames.from_rotation_vector(np.tile(turn, (self.about.time.size, 1)))
                extended["q"].values[:] = frames.quaternion_product(extended["q"].values, back)
        return extended.assign_attrs(model=" ".join(entry.cause for entry in model)) if model else extended

    def _contribution(self, entry):
        """What an entry adds to the readings of each sensor, (n, sensors, 3) m s-2 and rad s-2."""
        about, sensors = self.about, len(self.about.extra["positions"])
        linear, angular = np.zeros((2, about.time.size, sensors, 3))
        if not entry.listed:  # a driver in the difference of the sensors, half in each, or in all angular readings
            channel, _, form = entry.form.partition(", ")
            size = np.array([entry.values.get(f"{channel}_{axis}", 0.0) for axis in "xyz"])
            shapes = [shape for name, own, shape in drivers(about) if (f"unknown:{name}", own) == (entry.cause, form)]
            for shape in shapes:
                if channel == "linear" and sensors == 2:
                    linear += shape[:, None, None] * size * np.array([-0.5, 0.5])[:, None]
                elif channel == "attitude":
                    angular -= shape[:, None, None] * size
            return linear, angular
        known = effect(entry.cause)
        if entry.form.startswith("degree"):  # of a coefficient
            about = _of_degree(about, *(int(part.split()[1]) for part in entry.form.split(", ")))
        if known.channel == "linear_each_b":
            linear += known.contribution(about, known.values(entry.values))
        elif known.channel == "angular_each_b":
            angular += known.contribution(about, known.values(entry.values))
        elif known.channel == "angular_b":
            about = replace(about, angular_b=about.rate_dot_b)
            angular += known.contribution(about, known.values(entry.values))[:, None]
        elif known.channel == "linear_b":
            for k in range(sensors):
                own = {n.removesuffix(f"_{k + 1}"): v for n, v in entry.values.items() if n.endswith(f"_{k + 1}")}
                if own:
                    about = replace(self.about, linear_b=_reading(self.about, k))
                    linear[:, k] += known.contribution(about, known.values(own))
        return linear, angular

    def biased(self) -> list[Bias]:
        """What effects that move both sensors alike, and so no difference shows, do to the drag."""
        found = []
        for entry in (one for one in EFFECTS if one.channel == "linear_each_b"):
            mean = entry.columns(self.about).mean(axis=1)
            for k, parameter in enumerate(entry.parameters):
                drag = parameter.prior_sigma * mean[:, :, k]
                size = float(np.sqrt(np.mean(drag**2))) / self.drag_sigma
                rms = np.sqrt(np.mean(drag**2, axis=0))
                found.append(Bias(entry.slug, parameter.name, parameter.prior_sigma, "drag_bias_m_s2", rms, size))
        return found

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s, reading that the model predicts, and whitened rows in its unit.

        Of the linear reading, m s-2, it is the difference that the distance of the sensors predicts; attitude, rad, and
        torque, N m, are themselves what the model leaves.
        """
        own, names = self.made[channel], np.concatenate([b.channel for b in self.blocks])
        time, *_ = own.places()
        ordered = np.zeros((time.size, rows.shape[1]))
        ordered[np.concatenate([place[channel] for place in self._places])] = rows[names == channel]
        inside = self._places[number][channel]
        if not own.models:
            ends = np.cumsum([lower.shape[0] for *_, lower in own.stretches])[:-1]
            each = zip(own.stretches, np.split(ordered, ends), strict=True)
            angle = np.concatenate([lower @ part for (*_, lower), part in each])[inside]
            angle = angle.T.reshape(rows.shape[1], -1, 3)
            return time[inside][::3], np.zeros(angle.shape[1:]), angle
        parts = ordered.reshape(3, own.time.size, -1)
        columns = [noise.unwhiten(model, part, own.good) for model, part in zip(own.models, parts, strict=True)]
        inside, predicted = np.unique(inside % own.time.size), np.zeros((own.time.size, 3))
        if channel == "linear":
            apart = self.about.extra["positions"][0] - self.about.extra["positions"][1]
            predicted = means(-np.matvec(_tensor(self.about), apart), own.width)
        return own.time[inside], predicted[inside], np.moveaxis(np.stack(columns, axis=1), 2, 0)[:, inside]


NOTE = (
    "A day is looked at in stretches of two hours, with the noise measured in the day itself: the difference of "
    "both sensors, the star camera against the angular readings, and the torque that gravity gradient and control "
    "leave."
)
READINGS = {
    "linear": " It is the difference of both sensors; its mean is left out.",
    "attitude": " It is that of the star camera beside that to which the angular readings integrate.",
    "torque": " It is what gravity gradient and control leave.",
}
REPORT = Reported(note=NOTE, readings=READINGS)
