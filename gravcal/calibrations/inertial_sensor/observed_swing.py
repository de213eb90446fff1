"""A swing as discovery sees it: whitened attitude and linear voltages, one block a channel.

All parameters of the fit are shared by all blocks: factors, delay and offset, which the calibration reports, then start
values of the attitude and drifts of the linear readings.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.linalg import block_diag, solve_triangular

from gravcal.calibrations.causes import on_axes
from gravcal.calibrations.inertial_sensor import model as fits
from gravcal.calibrations.inertial_sensor.estimate import Record, record_of, swing_of
from gravcal.calibrations.inertial_sensor.noise import cubic, quiet_blocks, quiet_edges, spectra_of
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.base import Context
from gravcal.estimation import noise
from gravcal.estimation.noise import Spectrum, without_lines, without_slow_lines, without_telegraph
from gravcal.estimation.records import Block
from gravcal.estimation.resampling import bin_means
from gravcal.physics import frames, kinematics, sensing

STEP, TONE = "accelerometer.bias_step", "accelerometer.stray_tone"
STILL = 3.0  # an axis moves if its angular acceleration is above this many times the noise of a bin
FEEBLE = 5.0  # ratio of the largest motion to that about an axis, above which that has no period of its own
FINE = 16384  # points of the Fourier transform in which it is looked for
LINE_ORDER = 3  # of the autoregressive noise against which a slow line is tested


@dataclass(frozen=True)
class SwingView:
    """A swing with its fits, for whitened rows of attitude and linear readings."""

    aligned: xr.Dataset  # "inertial_sensor.align"
    swing: fits.Swing
    motion: fits.Motion  # predicted
    unknowns: fits.Unknowns  # of the fit
    system: fits.LinearSystem  # attitude rows about the solution
    record: Record  # of the linear readings
    k: np.ndarray  # (3,) m s-2 V-1
    tensor: np.ndarray  # (b, 3, 3) s-2, of the offset
    time: np.ndarray  # (w,) s, bins of the linear readings with the quiet data, a bin without data between them
    volt: np.ndarray  # (w, 3) V
    trend: np.ndarray  # (w, t) of each of the three
    inside: slice  # bins of the swing
    good: np.ndarray  # (w,) bool, bins with data
    start: np.ndarray  # (7,) rad s-2 V-1, s, m, m s-2 V-1: the solution, k_y of the ground
    k_y_sigma: float  # m s-2 V-1, of the ground
    quiet: float  # samples an axis that the noise of the attitude was measured from
    spectra: tuple[Spectrum, ...]  # of the linear readings

    channels = ("attitude", "linear")
    parameters = ("beta_x", "beta_yz", "delay", "offset_x", "offset_y", "offset_z", "k_y")

    def attitude_rows(self, angle_b: np.ndarray) -> np.ndarray:
        """Whitened rows (r, q) of a rotation from predicted to measured attitude, (m, 3, q) rad at the tracker tags."""
        mean, _ = bin_means(self.swing.time_att, angle_b, self.swing.edges)
        rows = mean.reshape(self.system.valid.size, -1)[self.system.valid]
        return solve_triangular(self.system.lower, np.nan_to_num(rows), lower=True)

    def turned_rows(self, rate_dot_b: np.ndarray) -> np.ndarray:
        """Whitened rows (r, q) of the attitude, for angular accelerations (n, 3, q) rad s-2 added to the prediction."""
        swing = self.swing
        rate = kinematics.running_integral(swing.time, rate_dot_b)
        R_bi = frames.R_bi_from_quaternion(self.motion.quaternion)
        angle = kinematics.angle_from_rate_change(swing.time, R_bi, rate)
        epoch = np.clip(swing.time_att - self.unknowns.delay, swing.time[0], swing.time[-1])
        return self.attitude_rows(fits.interpolated(swing.time, angle, epoch))

    def linear_rows(self, reading: np.ndarray) -> np.ndarray:
        """Whitened rows (3 w, q), axis by axis, of linear readings m s-2: of the swing (b, 3, q) or all (w, 3, q)."""
        if len(reading) < self.time.size:
            reading = self.spread(reading)
        return noise.whitened(self.record.noise, reading / self.k[:, None], self.good)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values (b, ...) of the swing among those of all bins (w, ...), zero in the quiet data."""
        all_bins = np.zeros((self.time.size, *values.shape[1:]))
        all_bins[self.inside] = values
        return all_bins

    def blocks(self, parameters: Sequence[str]) -> list[Block]:
        """A block for each channel; global columns: `parameters` (names), start values of the attitude, drifts."""
        record, system, tensor = self.record, self.system, np.nan_to_num(self.tensor)
        attitude = np.column_stack([system.residual, system.design])
        drift, offset_term = on_axes(self.trend), np.matvec(tensor, self.start[3:6])
        residual = self.k * np.nan_to_num(self.volt) - self.spread(offset_term)
        # a_x determines p_z, then a_y the factor of a_y; those of a_z and a_x, and the turning, follow beta
        factors = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]) / np.append(self.start[:2], self.k[1])
        term = -offset_term[:, :, None] * factors
        turning = np.nan_to_num(record.rate_dot_b)[:, :, None] * np.eye(2)[fits.OWNER] / self.start[:2]
        term[:, :, :2] += np.cross(turning, self.start[3:6, None], axisa=1, axisb=0, axisc=1)
        swung = self.spread(np.concatenate([term[:, :, :2], tensor, term[:, :, 2:]], axis=2))
        linear = np.concatenate([residual[:, :, None], swung, drift], axis=2)
        rows_of = {
            "attitude": solve_triangular(system.lower, attitude, lower=True),
            "linear": self.linear_rows(np.where(self.good[:, None, None], linear, 0.0)),
        }
        reported = [parameters.index(name) for name in self.parameters]
        first_drift = len(parameters) + attitude.shape[1] - 4  # column; 4: residual, two factors and delay
        width = first_drift + drift.shape[2]
        places = {"attitude": [*reported[:3], *range(len(parameters), first_drift)]}
        places["linear"] = [*reported[:2], *reported[3:], *range(first_drift, width)]
        middle, axes, blocks = self.swing.middle, np.arange(3), []
        by_time = (one[system.valid] for one in (np.tile(axes, middle.size), np.repeat(middle, 3)))
        axis_and_time = {"attitude": by_time, "linear": (np.repeat(axes, self.time.size), np.tile(self.time, 3))}
        for channel, rows in rows_of.items():
            columns = np.zeros((len(rows), width))
            columns[:, places[channel]] = rows[:, 1:]
            blocks.append(Block.of(channel, rows[:, 0], channel, *axis_and_time[channel], shared=columns))
        return blocks

    def cut(self, **rows: np.ndarray) -> list[np.ndarray]:
        """Columns (n, q) of both blocks from whitened rows by channel; zeros without any, for both are one record."""
        width = next(iter(rows.values())).shape[1]
        size = {"attitude": np.count_nonzero(self.system.valid), "linear": 3 * self.time.size}
        return [rows.get(channel, np.zeros((size[channel], width))) for channel in self.channels]

    @functools.cached_property
    def rate_dot_b(self) -> np.ndarray:
        """Angular acceleration (n, 3) rad s-2 at the epochs of the sensor.

        Linear between bins. Where voltages change faster than their noise explains, at a reversal, it is that of the
        voltages: the square of a mean is not the mean of squares. Elsewhere their noise would enter the regressors.
        """
        swing, beta = self.swing, self.unknowns.factors[fits.OWNER]
        number = np.clip(np.searchsorted(swing.edges, swing.time, side="right") - 1, 0, swing.edges.size - 2)
        straight = fits.interpolated(self.record.time, np.nan_to_num(self.record.rate_dot_b), swing.time)
        abrupt = self.motion.rate_dot_b - beta * self.system.voltage_noise[number] - straight
        power, count = bin_means(swing.time, abrupt**2, swing.edges)
        noise_b = beta * np.sqrt(swing.voltage_variance * np.median(count))
        return straight + np.where((power > (STILL * noise_b) ** 2)[number], abrupt, 0.0)

    def context(self, time: np.ndarray | None = None, place: np.ndarray | None = None) -> Context:
        """Context of the effects of the sensor, from the fitted motion, at its epochs or others (m,) s; offset (3,) m.

        A regressor made of the readings themselves would hold their noise, and explain it: the linear reading is that
        of the model, drift and offset. Beside the record it is as at its ends. A force has no bias: the linear reading
        is without its mean, beside which less than a ten thousandth of its columns would be left; voltages keep it.
        """
        record, swing, place = self.record, self.swing, self.start[3:6] if place is None else place
        good = self.good[self.inside]
        drift = (self.k * record.linear_volt - np.matvec(np.nan_to_num(self.tensor), place))[good]
        coefficient = np.linalg.lstsq(record.trend[good], drift, rcond=None)[0]
        gradient = fits.interpolated(record.time, np.nan_to_num(record.gradient_b), swing.time)
        trend = fits.interpolated(record.time, record.trend @ coefficient, swing.time)
        signals = {"rate_b": self.motion.rate_b, "rate_dot_b": self.rate_dot_b, "gradient_b": gradient}
        signals["linear_b"] = trend + np.matvec(sensing.offset_tensor(*signals.values()), place)
        signals["angular_b"] = self.rate_dot_b
        turning = (self.rate_dot_b - self.rate_dot_b.mean(axis=0)) / self.unknowns.factors[fits.OWNER]
        turning = swing.angular_volt.mean(axis=0) + turning
        extra = {"volts": electrodes.volts(np.concatenate([signals["linear_b"] / self.k, turning], axis=1))}
        signals["linear_b"] = signals["linear_b"] - trend.mean(axis=0)
        extra["displacement_b"] = -signals["linear_b"] / electrodes.LOOP**2
        if time is not None:
            at = np.clip(time, swing.time[0], swing.time[-1])
            moved = lambda one: {name: fits.interpolated(swing.time, v, at) for name, v in one.items()}  # noqa: E731
            signals, extra = moved(signals), moved(extra)
        return Context(swing.time if time is None else time, epoch=record.time[0], extra=extra, **signals)

    def binned(self, values: np.ndarray) -> np.ndarray:
        """Means (b, ...) over the bins of values (n, ...) at the epochs of the sensor, zero where empty."""
        return np.nan_to_num(bin_means(self.swing.time, values, self.swing.edges)[0])

    def periods(self) -> list[float]:
        """Period s of the motion about each axis that moves, where its angular acceleration has most power."""
        time, rate_dot = self.record.time, np.nan_to_num(self.record.rate_dot_b)
        moving = rate_dot[:, rate_dot.std(axis=0) > rate_dot.std(axis=0).max() / FEEBLE]
        power = np.abs(np.fft.rfft((moving - moving.mean(axis=0)) * np.hanning(time.size)[:, None], FINE, axis=0)) ** 2
        return (1 / np.fft.rfftfreq(FINE, time[1] - time[0])[power.argmax(axis=0)]).tolist()

    def wave(self, axis: int, frequency: float) -> list[np.ndarray | None]:
        """Whitened cosine and sine (n, 2) of every block, of a frequency Hz on one axis of the linear readings."""
        both = waves_of(self.time - self.time[0], self.record.time[1] - self.record.time[0], frequency)
        return self.cut(linear=self.linear_rows(both[:, None, :] * np.eye(3)[axis][:, None]))

    def reading(self, channel: str, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s, reading (b, 3) of a channel as the fit predicts it, and its rows (r, q) in that unit (q, b, 3).

        The linear reading, m s-2, is that of the offset; the attitude, rad, the rotation less that at the mean rate.
        """
        if channel == "attitude":
            return self._attitude_reading(rows)
        parts = rows.reshape(3, self.time.size, -1)
        columns = [self.k[a] * noise.unwhiten(self.record.noise[a], parts[a], self.good) for a in range(3)]
        at = np.clip(self.time, *self.record.time[[0, -1]])  # in quiet data as at its ends
        model = fits.interpolated(self.record.time, np.matvec(np.nan_to_num(self.tensor), self.start[3:6]), at)
        return self.time, model, np.moveaxis(np.stack(columns, axis=1), 2, 0)

    def _attitude_reading(self, rows):
        """Time (b,) s, rotation (b, 3) rad less that at the mean rate, and whitened rows (r, q) in rad, (q, b, 3)."""
        record, valid = self.record, self.system.valid
        columns = np.full((rows.shape[1], valid.size), np.nan)
        columns[:, valid] = (self.system.lower @ rows).T
        rate = np.nan_to_num(record.rate_b - np.nanmean(record.rate_b, axis=0))
        angle = kinematics.running_integral(record.time, rate)
        middle = self.swing.middle
        return middle, fits.interpolated(record.time, angle, middle), columns.reshape(rows.shape[1], -1, 3)


def view_of(products: Mapping[str, xr.Dataset], settings: Mapping) -> SwingView:
    """View of "align", "scale" and "offset" of a swing.

    Settings are bin_s, quiet_margin_s, inertia, drift_degree, noise_order.
    """
    aligned, scaled = products["align"], products["scale"]
    bin_s, margin, order = (settings[name] for name in ("bin_s", "quiet_margin_s", "noise_order"))
    swing = swing_of(aligned, bin_s, margin, np.array(settings["inertia"]))
    fitted = fits.fit(swing, scaled["batch_value"].values[: fits.FACTORS])
    maps = fits.noise_map(swing, fitted.motion)
    record = record_of(aligned, scaled, margin, settings["drift_degree"], order)
    # About axes that the swing leaves at rest the voltages hold noise alone, and the electrodes that turn the test mass
    # about z also push it along x: their noise in the columns would explain noise in the readings.
    rate_dot = np.nan_to_num(record.rate_dot_b)
    noise_b = fitted.unknowns.factors[fits.OWNER] * np.sqrt(swing.voltage_variance)
    rate_dot = np.where(rate_dot.std(axis=0) < STILL * noise_b, rate_dot.mean(axis=0), rate_dot)
    readout = electrodes.readouts(aligned["volts"].values)[:, :3]
    bins = bin_s, margin, swing.edges[0]
    quiet, edges = quiet_blocks(aligned, readout, *bins), quiet_edges(aligned, *bins)
    pieces = without_telegraph(quiet, [cubic(len(one)) for one in quiet])  # nor is a tone noise
    pieces, _ = without_lines(without_slow_lines(pieces, LINE_ORDER, bin_s), bin_s)
    spectra = spectra_of(pieces, bin_s)
    record = replace(record, rate_dot_b=rate_dot, noise=tuple(one.model(order, bin_s) for one in spectra))
    tensor = sensing.offset_tensor(record.rate_b, rate_dot, record.gradient_b)
    place = np.nan_to_num(products["offset"]["offset"].values[0])
    k = scaled["k"].values[int(scaled["chosen_arm"])]
    parts = [((e[1:] + e[:-1]) / 2, q, cubic(len(q))) for e, q in zip(edges, quiet, strict=True)]
    parts = sorted([*parts, (record.time, record.linear_volt, record.trend)], key=lambda one: one[0][0])
    for n in range(len(parts) - 1, 0, -1):
        parts.insert(n, ((parts[n - 1][0][-1:] + parts[n][0][:1]) / 2, np.full((1, 3), np.nan), np.zeros((1, 0))))
    time, volt, trends = zip(*parts, strict=True)
    time, volt = np.concatenate(time), np.concatenate(volt)
    inside = slice(first := int(np.searchsorted(time, record.time[0])), first + record.time.size)
    good = np.isfinite(volt).all(axis=1)
    good[inside] &= np.isfinite(tensor).all(axis=(1, 2))
    return SwingView(
        aligned,
        swing,
        fitted.motion,
        fitted.unknowns,
        fits.linear_system(swing, fitted.unknowns, fitted.motion, maps),
        record,
        k=k,
        tensor=tensor,
        time=time,
        volt=volt,
        trend=block_diag(*trends),
        inside=inside,
        good=good,
        start=np.concatenate([fitted.unknowns.factors, [fitted.unknowns.delay], place, k[1:2]]),
        k_y_sigma=float(scaled["k_sigma"].values[0, 1]),
        quiet=float(sum(len(b) for b in pieces)),
        spectra=spectra,
    )


def waves_of(time: np.ndarray, width: float, frequency: float) -> np.ndarray:
    """Cosine and sine (n, 2) of a frequency Hz at epochs (n,) s, means over bins of a width s."""
    phase = 2 * np.pi * frequency * time
    return np.stack([np.cos(phase), np.sin(phase)], axis=1) * np.sinc(frequency * width)
