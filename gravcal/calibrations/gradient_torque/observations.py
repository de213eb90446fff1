"""A day of S-GRS as discovery sees it: the difference of both sensors, attitude against angular readings, torques."""

import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from gravcal.calibrations.causes import added_by, along, listed, on_axes, unknown
from gravcal.calibrations.gradient_torque import attitude, responses
from gravcal.calibrations.gradient_torque.model import METHODS, orbit
from gravcal.calibrations.gradient_torque.noise import GLOBAL, PLACES, Channel, channels_of, means
from gravcal.calibrations.gradient_torque.responses import POINTING, drivers, effects_of, memories
from gravcal.effects import Context, effect
from gravcal.effects.gradient import EFFECTS, added_to_channels, apart, reading_of, readings, tensor, tesseral
from gravcal.estimation.records import Block, Candidate, Entry, Observations, Shape, Unobservable, reported
from gravcal.physics import earth, frames, magnetic, orbit_environment

UNITS = {"linear": "m s-2", "attitude": "rad s-2", "torque": "N m"}
METHOD = METHODS.index("two_sensor")  # motion from all sensors
BLOCK_S = 7200.0  # more than a revolution, so that each block sees every latitude
HIGHEST = 20  # degree of a coefficient that is looked for
LAST_FIELD = 9.46e8  # GPS s, end of 2029: the geomagnetic field of later days is that of its model then


def observe(products: Mapping[str, xr.Dataset], **settings) -> "GradientTorque":
    """Observations of the products "ingest", "gradient", and "drag" by one sensor of a day.

    Settings are satellite, igrf_generation, elongation, gap_limit_s, torque_step_s, torque_noise_order, control_hz,
    control_damping, bin_s, stretch_s, noise_order.
    """
    observed, modelled, drag = (products[name] for name in ("ingest", "gradient", "drag"))
    position, velocity = orbit(observed, settings["gap_limit_s"])
    R_bi = attitude.R_bo(modelled["angle"].values[METHOD]) @ attitude.orbit_frame(position, velocity)
    about = _context(modelled, drag, R_bi, position, settings)
    added = (added["linear"] for _, _, added in effects_of(about, ("linear",)) if "linear" in added)
    outside = [shape for driver, _, shape in drivers(about) if driver in responses.OUTSIDE]
    outside += [remembered(tau) for _, remembered in memories(about) for tau in responses.MEMORY_S]
    outside_columns = map(on_axes, outside)
    channels = channels_of(about, R_bi, observed, modelled, itertools.chain(added, outside_columns), settings)
    satellite, prior = settings["satellite"], np.zeros((6, 1 + GLOBAL))
    pressure, distance = np.array(satellite["centre_of_pressure"]), satellite["sensor_position_sigma"]
    sigma = np.concatenate([satellite["centre_of_pressure_sigma"], np.linalg.norm(distance, axis=0)])
    prior[:3, 0] = pressure / sigma[:3]
    prior[np.arange(6), 1 + np.r_[PLACES["pressure"], PLACES["distance"]]] = 1 / sigma
    parts = [*(channel.rows for channel in channels.values()), prior]
    rows = np.concatenate(parts)
    scale = np.maximum(np.linalg.norm(rows[:, 1:], axis=0), 1e-300)
    solution = np.linalg.lstsq(rows[:, 1:] / scale, rows[:, 0], rcond=None)[0] / scale
    for part in parts:  # estimates are changes of the solution
        part[:, 0] -= part[:, 1:] @ solution
    start = drag["pressure"].values if "pressure" in drag else pressure
    drag_sigma = float(np.sqrt(np.nanmean(np.diagonal(drag["covariance"].values, axis1=1, axis2=2))))
    orders = {"linear": settings["noise_order"], "torque": settings["torque_noise_order"]}
    return GradientTorque(observed, about, channels, prior, start, drag_sigma, orders)


def _context(modelled, drag, R_bi, position, settings):
    """Context of the effects at the epochs of the record; R_bi (n, 3, 3), position (n, 3) m in i."""
    time, satellite = modelled["time"].values, settings["satellite"]
    R_ei = earth.R_ei(time)
    position_e, R_be = np.matvec(R_ei, position), R_bi @ np.swapaxes(R_ei, 1, 2)
    extra = {
        "positions": modelled["sensor_position_b"].values,
        "mass": satellite["mass"],
        "non_gravitational_b": np.nan_to_num(drag["drag_b"].values),
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
    """Context whose "tesseral_b" (n, 2, 3, 3) s-2 is the gravity gradient of C_nm = 1 and of S_nm = 1."""
    gradients = tesseral(about.extra["position_e"], about.extra["R_be"], degree, order)
    return replace(about, extra=about.extra | {"tesseral_b": gradients})


@dataclass(frozen=True)
class GradientTorque(Observations):
    """Observations of a day."""

    record: xr.Dataset  #: Dataset, "ingest"
    about: Context  #: Context of its epochs
    made: Mapping[str, Channel]  #: {channel: Channel} of those that it has
    prior: np.ndarray  #: (k, 1 + GLOBAL) what is known of the global parameters beforehand, over its standard deviation
    start: np.ndarray  #: (3,) m, centre of pressure
    drag_sigma: float  #: m s-2, of the drag, rms
    noise_order: Mapping[str, int] = field()

    name = "gradient_torque"
    channels = tuple(UNITS)
    parameters = tuple(f"centre_of_pressure_{axis}" for axis in "xyz")
    unit, scale = "mm", np.full(3, 1e3)
    contiguous = True

    @functools.cached_property
    def quiet(self) -> dict[str, float]:
        """Bins with data of the difference of sensors, {"linear": number}: noise is estimated with candidates free."""
        return {name: float(one.good.sum()) for name, one in self.made.items() if name == "linear"}

    @property
    def spectra(self) -> dict[str, tuple]:
        """Noise spectra of the axes, {channel: (3 spectra)}, where they are estimated with all candidates free."""
        return {name: one.spectra for name, one in self.made.items() if one.spectra}

    @functools.cached_property
    def _places(self) -> list[dict[str, np.ndarray]]:
        """Row numbers (n,) of each channel in each block, a list of {channel: rows}."""
        time = self.about.time
        count = max(2, int((time[-1] - time[0]) / BLOCK_S))
        inner = np.linspace(time[0], time[-1] + 1e-6, count + 1)[1:-1]
        number = {n: np.searchsorted(inner, one.places()[2], side="right") for n, one in self.made.items()}
        return [{name: np.flatnonzero(one == k) for name, one in number.items()} for k in range(count)]

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """Blocks of two hours, and one of the prior of the global parameters."""
        stretches, places = [], {name: channel.places() for name, channel in self.made.items()}
        errors = {
            (name, axis): float(error)
            for name, one in self.made.items()
            for axis, error in enumerate(one.level.error.mean(axis=0) if one.models and one.level.error.any() else ())
        }
        for number, rows_of in enumerate(self._places, start=1):
            rows = np.concatenate([self.made[name].rows[rows] for name, rows in rows_of.items()])
            time, axis = (np.concatenate([places[name][k][rows] for name, rows in rows_of.items()]) for k in (0, 1))
            channel = np.repeat([*rows_of], [own.size for own in rows_of.values()])
            attitude_rows, begins = self.made["attitude"], set(places["attitude"][2][rows_of["attitude"]])
            own = [attitude_rows.free(one) for one in attitude_rows.stretches if attitude_rows.time[one[0]] in begins]
            local = np.zeros((len(rows), 6 * len(own)))
            local[channel == "attitude"] = block_diag(*own) if own else 0.0
            rows = rows[:, 0], rows[:, 1:], local, channel, axis, time
            stretches.append(Block(f"stretch {number}", *rows, level_error=errors))
        prior = self.prior
        about = "prior", np.argmax(prior[:, 1:] > 0, axis=1) % 3, np.arange(float(len(prior)))
        return [*stretches, Block.of("known beforehand", prior[:, 0], *about, shared=prior[:, 1:])]

    def _columns(self, added):
        """Whitened columns (n, q) of every block from additions {channel: (n, 3, q)} SI; None of the prior's block."""
        known = {name: self.made[name].whitened(values) for name, values in added.items() if name in self.made}
        width, columns = next(iter(added.values())).shape[2], []
        for rows_of in self._places if known else ():
            parts = [known[c][rows] if c in known else np.zeros((rows.size, width)) for c, rows in rows_of.items()]
            columns.append(np.concatenate(parts))
        return [*(columns or [None] * len(self._places)), None]

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Effects of the catalogue with all their parameters and each alone, then the drivers in each channel."""
        causes = []
        for entry, sensor, added in effects_of(self.about, self.made):
            form, suffix = (f"sensor {sensor}", f"_{sensor}") if sensor else ("", "")
            causes += listed(entry, self._columns(added), form, suffix=suffix).each_alone()
        entry = effect("gradient.tesseral")
        orders = [(n, m) for n in range(3, HIGHEST + 1) for m in range(1, n + 1)] if "linear" in self.made else []
        for degree, order in orders:
            columns = self._columns(added_to_channels(_of_degree(self.about, degree, order), entry))
            causes.append(replace(listed(entry, columns, f"degree {degree}, order {order}"), apart=True))
        for channel in self.made:
            for driver, form, shape in drivers(self.about):
                if channel != "torque" or driver in responses.OUTSIDE:
                    columns, names = self._columns({channel: on_axes(shape)}), along(channel, shape.ndim > 1)
                    causes.append(unknown(driver, f"{channel}, {form}", columns, UNITS[channel], names))
        return causes + [one for channel in self.made if channel != "torque" for one in self._memories(channel)]

    def _memories(self, channel, constants=responses.MEMORY_S):
        """Yield candidates of a channel that follows a component of the drag with memory, whose constant is fitted."""
        for (law, remembered), tau in itertools.product(memories(self.about), constants):

            def columns(value, remembered=remembered):
                return self._columns({channel: remembered(value[0])[:, None, None] * np.eye(3)})

            constant, bounds = np.array([tau]), (np.array([responses.SHORTEST_S]), np.array([responses.LONGEST_S]))
            start_values, words = np.outer((0.6, 1.0, 1.6), constant), f"{channel}, {law.words}"
            shape = Shape(law.names, ("s",), constant, columns, start_values, *bounds, words=words)
            form = f"{channel}, {law.told(constant)}"
            yield replace(unknown("drag", form, columns(constant), UNITS[channel], along(channel)), shape=shape)

    def forms_of(self, entry: Entry) -> Iterable[Candidate]:
        """Candidates of the form of an entry; of a memory the one with its own constant."""
        if "tau" not in entry.values:
            return super().forms_of(entry)
        laws = self._memories(entry.form.partition(", ")[0], [entry.values["tau"]])
        return [one for one in laws if one.form == entry.form]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Record without the effects of a model, so that the baseline describes what is left.

        A torque turns the satellite itself: the readings keep it, and the product has it as "torque" for the balance.
        """
        extended = self.record.copy(deep=True)
        for entry in model:
            known = effect(entry.cause) if entry.listed else None
            if entry.form.startswith("torque, ") or (known and known.channel in ("torque_b", "dipole_b")):
                torque = known and added_to_channels(self.about, known)["torque"] @ known.values(entry.values)
                torque = added_by(entry, "torque", "torque, ", drivers(self.about)) if torque is None else torque
                extended["torque"] = extended.get("torque", 0.0) + xr.DataArray(torque, dims=("time", "axis"))
                extended["torque"].attrs |= {"units": "N m", "frame": "b", "long_name": "of effects that are taken out"}
                continue
            linear, angular = self._contribution(entry)
            extended["linear"].values[:] += linear  # minus a reading is what the files hold
            extended["angular"].values[:] += angular
            if entry.cause == POINTING:
                back = frames.from_rotation_vector(-effect(POINTING).values(entry.values))
                extended["q"].values[:] = frames.quaternion_product(extended["q"].values, back)
        return extended.assign_attrs(model=" ".join(entry.cause for entry in model)) if model else extended

    def _contribution(self, entry):
        """Addition of an entry to linear and angular readings of each sensor, (n, sensors, 3) m s-2 and rad s-2."""
        about, sensors = self.about, len(self.about.extra["positions"])
        linear, angular = np.zeros((2, about.time.size, sensors, 3))
        if not entry.listed:  # a driver in the difference of the sensors, half in each, or in all angular readings
            channel = entry.form.partition(", ")[0]
            constants = [entry.values["tau"]] if "tau" in entry.values else ()
            laws = ((law, remembered, tau) for law, remembered in memories(about) for tau in constants)
            with_memory = (("drag", law.told((tau,)), remembered(tau)) for law, remembered, tau in laws)
            added = added_by(entry, channel, f"{channel}, ", itertools.chain(drivers(about), with_memory))[..., None, :]
            if channel == "linear" and sensors == 2:
                linear += added * np.array([-0.5, 0.5])[:, None]
            elif channel == "attitude":
                angular -= added
            return linear, angular
        known = effect(entry.cause)
        if entry.form.startswith("degree"):  # of a coefficient
            about = _of_degree(about, *(int(part.split()[1]) for part in entry.form.split(", ")))
        added = readings(about, known, lambda context: known.contribution(context, known.values(entry.values)))
        linear, angular = linear + added.get("linear", 0.0), angular + added.get("angular", 0.0)
        if known.channel == "linear_b":
            for k in range(sensors):
                values = {n.removesuffix(f"_{k + 1}"): v for n, v in entry.values.items() if n.endswith(f"_{k + 1}")}
                if values:
                    about = replace(self.about, linear_b=reading_of(self.about, k))
                    linear[:, k] += known.contribution(about, known.values(values))
        return linear, angular

    def biased(self) -> list[Unobservable]:
        """Biases of the drag by effects that move both sensors alike, at plausible size: no difference shows them."""
        biases = []
        for entry in (one for one in EFFECTS if one.channel == "linear_each_b"):
            mean = entry.columns(self.about).mean(axis=1)
            for k, parameter in enumerate(entry.parameters):
                rms = np.sqrt(np.mean((parameter.prior_sigma * mean[:, :, k]) ** 2, axis=0))
                size = float(np.sqrt(np.mean(rms**2))) / self.drag_sigma
                biases.append(Unobservable(entry.slug, {parameter.name: 1.0}, 0.0, (), size, (), rms.tolist()))
        return biases

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time (m,) s, reading (m, 3) that the model predicts, and whitened rows in its unit (q, m, 3), of one block.

        Of the linear reading, m s-2, it is the difference that the distance of the sensors predicts; attitude, rad, and
        torque, N m, are themselves what the model leaves.
        """
        own, names = self.made[channel], np.concatenate([b.channel for b in self.blocks])
        own_time, *_ = own.places()
        ordered = np.zeros((own_time.size, rows.shape[1]))
        ordered[np.concatenate([place[channel] for place in self._places])] = rows[names == channel]
        inside = self._places[number][channel]
        columns = np.moveaxis(own.in_unit(ordered), 2, 0)
        if not own.models:
            inside = inside[::3] // 3
            return own_time[3 * inside], np.zeros((inside.size, 3)), columns[:, inside]
        inside, predicted = np.unique(inside % own.time.size), np.zeros((own.time.size, 3))
        if channel == "linear":
            predicted = means(-np.matvec(tensor(self.about), apart(self.about)), own.width)
        return own.time[inside], predicted[inside], columns[:, inside]


def _result(drag: xr.Dataset, _method: str | None = None) -> tuple[str, np.ndarray, np.ndarray]:
    """Method, centre of pressure (3,) mm and covariance (3, 3) mm2 of "gradient_torque.drag"; NaN if not asked for."""
    value, covariance = (drag[n].values if n in drag else np.nan for n in ("pressure", "pressure_covariance"))
    return "torque balance", np.full(3, 1e3 * value), np.full((3, 3), 1e6 * covariance)


REPORT = reported(__file__, "discovery.toml", _result)
