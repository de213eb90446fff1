"""A roll as discovery sees it: whitened linear readings of each segment, and the wander of the bias between them.

Bias and offset are shared by all segments. A segment has the amplitudes of its own that the calibration gives it, and a
constant that wanders about the bias; a row for each axis holds its prior. The noise is a sum of power laws, estimated
with every form that is tried free.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gravcal.calibrations.inertial_sensor import bias as segments
from gravcal.calibrations.inertial_sensor import noise
from gravcal.calibrations.inertial_sensor.observed_swing import waves_of
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.base import Context
from gravcal.effects.drivers import products, waves
from gravcal.estimation.noise import Levels, NoiseModel, changing_levels, unwhiten, whitened
from gravcal.estimation.records import Block

CHANNEL, CONSTANT = "roll", "constant"
MOST = 48  # segments, evenly taken: columns of more take memory and add little
ALIKE = 0.9  # correlation of the bias of neighbouring segments, at most
UNKNOWN_M = 1e-3  # prior sigma of an offset that was assumed
STEP_EVERY_S = 20.0
EDGE_S = 200.0  # from the ends of a segment, where its trend follows a step
USUAL = 1e-7  # m s-2, size of a reading without its bias


@dataclass(frozen=True)
class RollView:
    """Segments of a roll and their fits."""

    products: Mapping[str, xr.Dataset]  # "segment", "bias" and, of a swing, "scale" and "offset"
    settings: Mapping  # as of `view_of`
    time: np.ndarray  # (s, b) s
    step_s: float  # length of a bin
    reading: np.ndarray  # (s, b, 3) m s-2, k V as measured
    steady: np.ndarray  # (s, b, 3) m s-2, without wander: fitted by offset and rolling drag, about the mean bias
    tensor: np.ndarray  # (s, b, 3, 3) s-2, of the offset
    turn: np.ndarray  # (s, b) complex, cosine and sine of the roll angle
    rate_b: np.ndarray  # (s, b, 3) rad s-1
    gradient_b: np.ndarray  # (s, b, 3, 3) s-2
    designs: list[list[np.ndarray]]  # of each segment a design (b, p) for each axis, the constant first
    start: np.ndarray  # (6,) m s-2 and m: bias and offset that residuals are formed with
    k: np.ndarray  # (3,) m s-2 V-1
    beta: np.ndarray | None  # (2,) rad s-2 V-1 about x and about y and z, that k_z and k_x follow; None without swing

    channels = (CHANNEL,)
    #: Rolling about y does not tell b_y from a constant acceleration: their sum is `constant_y`.
    parameters = ("bias_x", "constant_y", "bias_z", "offset_x", "offset_y", "offset_z")

    @functools.cached_property
    def wander(self) -> np.ndarray:
        """Standard deviation (3,) m s-2 of the constants about a straight line, neighbours correlated by ALIKE.

        The bias remembers hours, so that a dozen segments show less of its wander than there is, and more of a slope.
        """
        biased = self.products["bias"]
        used = biased["used"].values.astype(bool)
        values, time = biased["segment_bias"].values[used], biased["time_segment"].values[used]
        line = np.stack([np.ones_like(time), time - time.mean()], axis=1)
        residual = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
        variance = np.sum(residual**2, axis=0) / max(time.size - 2, 1) * (1 + ALIKE) / (1 - ALIKE)
        return np.sqrt(np.maximum(variance, np.mean(biased["segment_sigma"].values[used] ** 2, axis=0)))

    @functools.cached_property
    def noise(self) -> tuple[list[NoiseModel], Levels]:
        """Noise model of each axis, estimated with the amplitudes of a segment and every form that is tried free.

        With it comes its amplitude in the bins (s b, 3), one unless it changes along the record.
        """
        squares = (self.steady / np.abs(self.steady).max(axis=(0, 1))) ** 2
        count = np.rint((self.time - self.time[0, 0]) / self.step_s).astype(int)
        slow = np.polynomial.legendre.legvander(2 * count / count.max() - 1, 2)
        forms = [np.atleast_3d(values) for _, _, values in self.series()]
        shared, turning = np.concatenate([slow, *forms, squares], axis=2), 1 + self.settings["trend_degree"]
        local = [[design[a][:, 0 if a == 1 else turning :] for design in self.designs] for a in range(3)]
        residual = self.reading - np.matvec(self.tensor, self.start[3:])
        models, white = noise.of_segments(residual, local, shared, count, self.step_s)
        return models, changing_levels(white, len(count) * self.designs[0][0].shape[1] + shared.shape[2])

    def rows(self, added: np.ndarray, first: int = 0) -> list[np.ndarray]:
        """Whitened rows (3 b + 3, q) of each segment from `first` on, of additions (s, b, 3, q) m s-2 to its readings.

        The last three, which hold the constants, are zero.
        """
        (models, level), valid = self.noise, np.ones(added.shape[1], dtype=bool)
        level = level.value.reshape(*self.time.shape, 3).swapaxes(1, 2).reshape(len(self.time), -1, 1)[first:]
        white = [whitened(models, one, valid) / amplitude for one, amplitude in zip(added, level, strict=False)]
        return [np.concatenate([one, np.zeros((3, added.shape[3]))]) for one in white]

    def blocks(self, parameters: Sequence[str], width: int, *, alone: bool) -> list[Block]:
        """A block for each segment with `width` global columns; those of bias, offset and factors by their parameters.

        Alone, without a swing that gives the offset, a last block holds its prior, of UNKNOWN_M.
        """
        (count, size), places = self.time.shape, [parameters.index(name) for name in self.parameters]
        residual = self.reading - np.matvec(self.tensor, self.start[3:]) + self.start[:3]
        shared = [np.broadcast_to(-np.eye(3), (count, size, 3, 3)), self.tensor]
        if self.beta is not None:  # k, and with it the reading, is proportional to them
            factors = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]) / np.append(self.beta, self.k[1])
            shared.append(-self.steady[..., None] * factors)
            places += [parameters.index(name) for name in ("beta_x", "beta_yz", "k_y")]
        shared = np.concatenate(shared, axis=3)
        whitened_rows = self.rows(np.concatenate([residual[..., None], shared], axis=3))
        channel = np.array([CHANNEL] * 3 * size + [CONSTANT] * 3)
        axis = np.append(np.repeat([0, 1, 2], size), [0, 1, 2])
        blocks = []
        for s, (time, rows) in enumerate(zip(self.time, whitened_rows, strict=True)):
            columns = np.zeros((len(rows), width))
            columns[:, places] = rows[:, 1:]
            local_columns = np.zeros((size, 3, sum(design.shape[1] for design in self.designs[s])))
            prior_rows, place = np.zeros((3, local_columns.shape[2])), 0  # rows of the constants
            for a, design in enumerate(self.designs[s]):
                local_columns[:, a, place : place + design.shape[1]] = design
                prior_rows[a, place] = 1 / self.wander[a]
                place += design.shape[1]
            (local,) = self.rows(local_columns[None], s)
            local[-3:] = prior_rows
            epochs = np.append(np.tile(time, 3), np.full(3, time[0]))
            steps = self.steps(s, np.arange(time[0] + EDGE_S, time[-1] - EDGE_S, STEP_EVERY_S) - self.step_s / 2)
            error = self.noise[1].error.reshape(*self.time.shape, 3)[s].mean(axis=0)
            uncertain = {(CHANNEL, a): float(one) for a, one in enumerate(error) if one}
            blocks.append(Block(f"roll {s + 1}", rows[:, 0], columns, local, channel, axis, epochs, steps, uncertain))
        if alone:
            known = np.zeros((3, width))
            known[:, places[3:6]] = np.eye(3) / UNKNOWN_M
            blocks.append(Block.of("offset", np.zeros(3), "offset", np.arange(3), self.time[0, 0], shared=known))
        return blocks

    def steps(self, index: int, epochs: np.ndarray) -> dict[float, np.ndarray]:
        """Whitened rows {epoch: (3 b + 3, 3)} of unit steps in each reading of a segment, at each of some epochs s."""
        time = self.time[index]
        shapes = np.clip((time[:, None] + self.step_s / 2 - epochs) / self.step_s, 0, 1)
        (rows,) = self.rows(np.einsum("bk,ac->bakc", shapes, np.eye(3)).reshape(1, time.size, 3, -1), index)
        return {float(epoch): rows[:, 3 * k : 3 * k + 3] for k, epoch in enumerate(epochs)}

    def segment_of(self, epoch: float) -> int | None:
        """Number of the segment that an epoch lies in."""
        inside = np.flatnonzero((self.time[:, 0] <= epoch) & (epoch <= self.time[:, -1]))
        return int(inside[0]) if inside.size else None

    def wave(self, axis: int, frequency: float) -> list[np.ndarray]:
        """Whitened cosine and sine (3 b + 3, 2) of every segment, a line Hz on one axis of the linear readings."""
        both = waves_of(self.time.ravel() - self.time[0, 0], self.step_s, frequency).reshape(*self.time.shape, 2)
        return self.rows(both[:, :, None, :] * np.eye(3)[axis][:, None])

    def context(self) -> Context:
        """Context of the effects of the sensor, all segments one after the other, from the readings as fitted.

        A regressor that holds the wander of the bias would explain it. Drifts count from the middle, so that the bias
        stays that of the middle whether they are taken out or not.
        """
        steady, rate = self.steady.reshape(-1, 3), self.rate_b.reshape(-1, 3)
        force = steady + self.start[:3]  # f = b + k V
        combined = np.concatenate([steady / self.k, np.zeros_like(steady)], axis=1)  # hardly any torque
        return Context(
            self.time.ravel(),
            rate_b=rate,
            rate_dot_b=np.zeros_like(rate),
            gradient_b=self.gradient_b.reshape(-1, 3, 3),
            linear_b=force,
            angular_b=np.zeros_like(rate),
            epoch=float(self.time.mean()),
            extra={"volts": electrodes.volts(combined), "displacement_b": -force / electrodes.LOOP**2},
        )

    def series(self) -> list[tuple[str, str, np.ndarray]]:
        """Regressors of the readings: driver, form, and values (s, b), of waves (s, b, 2), near one in size."""
        names = "the roll angle", "twice the roll angle", "three times the roll angle"
        angle_waves = [np.stack([(self.turn**n).real, (self.turn**n).imag], axis=2) for n in (1, 2, 3)]
        rows = [("attitude", f"wave of {name}", wave) for name, wave in zip(names, angle_waves, strict=True)]
        record = self.products["segment"]
        motion = np.sqrt(np.linalg.norm(record["gradient_b"].values, axis=(1, 2)) / np.sqrt(6))  # |G| = sqrt(6) n^2
        rows += [("latitude", *one) for one in waves(np.nanmean(motion) * (self.time - float(record["time"][0])))]
        reading = (self.steady + self.start[:3]) / USUAL
        rows += [("reading", *one) for one in products(reading, "square of {}")]
        rate = self.rate_b[:, :, 1] - self.rate_b[:, :, 1].mean()
        rate = rate / max(np.abs(rate).max(), 1e-30)
        return [*rows, ("rate", "component y", rate), ("rate", "square of y", rate**2)]

    def reading_of(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time (n,) s, linear reading (n, 3) m s-2 of the baseline, whitened rows (3 n, q) in its unit (q, n, 3)."""
        (models, level), valid = self.noise, np.ones(self.time.shape[1], dtype=bool)
        each = rows.reshape(3, *self.time.shape, -1) * level.value.T.reshape(3, *self.time.shape, 1)
        columns = [[unwhiten(models[a], one, valid) for one in each[a]] for a in range(3)]
        columns = np.moveaxis(np.array(columns).reshape(3, self.time.size, -1), (2, 1, 0), (0, 1, 2))
        model = np.matvec(self.tensor, self.start[3:]) - self.start[:3]
        return self.time.ravel(), model.reshape(-1, 3), columns


def view_of(products: Mapping[str, xr.Dataset], settings: Mapping) -> RollView | None:
    """View of "segment", "bias" and, of a swing, "scale" and "offset"; None of fewer than three usable segments.

    A segment that is left out of the bias for one bin of too few samples (its share) is looked at: that may be a step.
    Settings are segment_s, uniformity_limit, share_limit, trend_degree, amplitude_degree, amplitude_harmonics and
    assumed, as of `bias.bias`.
    """
    biased, share = products["bias"], products["segment"]["share"].values
    used = biased["used"].values.astype(bool)
    if used.sum() < segments.ENOUGH or not np.isfinite(biased["bias"].values).all():
        return None
    _, parts = segments.cut(products["segment"]["time"].values, settings["segment_s"])
    few = [np.sum(share[part] < settings["share_limit"]) <= 1 for part in parts]
    used = np.flatnonzero(used | (biased["uniformity"].values <= settings["uniformity_limit"]) & few)
    used = used[np.unique(np.linspace(0, used.size - 1, min(MOST, used.size)).round().astype(int))]
    return view_of_segments(products, settings, used)


def view_of_segments(products: Mapping[str, xr.Dataset], settings: Mapping, used: Sequence[int]) -> RollView:
    """View of the segments numbered `used`; other arguments as of `view_of`."""
    segmented = products["segment"]
    sensor = segments.sensor_of(tuple(products[n] for n in ("scale", "offset") if n in products), settings["assumed"])
    step, parts = segments.cut(segmented["time"].values, settings["segment_s"])
    names = ("trend_degree", "amplitude_degree", "amplitude_harmonics")
    model = segments.Model(*(settings[name] for name in names))
    bins = {n: np.stack([segmented[n].values[parts[k]] for k in used]) for n in segmented.variables}
    pairs = list(zip(bins["rate_b"], bins["gradient_b"], strict=True))
    tensor = np.stack([segments.offset_terms(rate, gradient, step) for rate, gradient in pairs])
    reading, term = sensor.k * bins["linear_volt"], np.matvec(tensor, sensor.offset)
    turning, designs = term.copy(), []
    for s, R_bo in enumerate(bins["R_bo"]):
        phase = segments.orbital_phase(bins["gradient_b"][s], step)
        designs.append([segments.design(axis, R_bo, model, phase) for axis in range(3)])
        for axis, design in enumerate(designs[-1]):
            coefficient = np.linalg.lstsq(design, (reading - term)[s, :, axis], rcond=None)[0]
            trend = model.trend_degree + 1
            turning[s, :, axis] += design[:, trend:] @ coefficient[trend:]
    start = np.concatenate([products["bias"]["bias"].values, sensor.offset])
    return RollView(
        products,
        settings,
        bins["time"],
        float(bins["time"][0, 1] - bins["time"][0, 0]),
        reading,
        steady=turning - start[:3],
        tensor=tensor,
        turn=bins["R_bo"][:, :, 0, 0] + 1j * bins["R_bo"][:, :, 0, 2],
        rate_b=bins["rate_b"],
        gradient_b=bins["gradient_b"],
        designs=designs,
        start=start,
        k=sensor.k,
        beta=products["scale"]["batch_value"].values[:2] if "scale" in products else None,
    )
