"""Channels of a day for discovery: means in bins, noise estimated with the free parameters, whitened rows.

The drag is free at every epoch, so that it takes up the mean reading of the sensors and leaves their difference.
Distance of the sensors, a constant torque and the centre of pressure are free as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from gravcal.calibrations.gradient_torque.estimate import uncontrolled_torque, unsmoothed
from gravcal.calibrations.gradient_torque.model import box_inertia
from gravcal.effects.gradient import apart, tensor
from gravcal.estimation import noise
from gravcal.physics import frames, kinematics

#: Global parameters: centre of pressure m, constant torque N m, distance of the sensors m.
PLACES = {"pressure": slice(0, 3), "constant": slice(3, 6), "distance": slice(6, 9)}
GLOBAL = 9


@dataclass(frozen=True)
class Channel:
    """One channel in bins, with its noise."""

    width: int  #: epochs in a bin
    time: np.ndarray  #: (m,) s
    good: np.ndarray  #: (m,) bool, bins with data
    models: tuple = ()  #: noise models of the axes, none for the attitude
    common: tuple = ()  #: noise that axes have in common, taken out of the weaker ones before they are whitened
    level: noise.Levels | None = None  #: (m, 3) amplitude of these in each bin
    spectra: tuple = ()  #: of the axes with errors, where so many columns are free that these matter
    R_bi: np.ndarray | None = None  #: (m, 3, 3) of the bins of the attitude, None for the others
    stretches: tuple = ()  #: (begin, end, (3 k, 3 k) rad Cholesky factor of the noise) of the attitude
    rows: np.ndarray | None = None  #: (n, 1 + GLOBAL) whitened: observed, columns of the global parameters

    def whitened(self, added: np.ndarray) -> np.ndarray:
        """Whitened rows (n, q) of additions (epochs, 3, q) m s-2, N m, or, for the attitude, angular rad s-2."""
        bins = np.nan_to_num(means(added, self.width))
        if self.models:
            bins = without_common(self.common, bins, self.good)
            rows = [noise.whiten(model, bins[:, k], self.good) for k, model in enumerate(self.models)]
            return np.concatenate(rows) / self.level.value.T.reshape(-1, 1)
        angle = [integrated(self.time[b:e], self.R_bi[b:e], bins[b:e]) for b, e, _ in self.stretches]
        return self.whitened_angles(angle, added.shape[2])

    def whitened_angles(self, angles: Sequence[np.ndarray], width: int) -> np.ndarray:
        """Whitened rows (n, q) of angles (k, 3, q) rad of each stretch, `width` the number q."""
        both = zip((lower for _, _, lower in self.stretches), angles, strict=True)
        rows = (solve_triangular(lower, angle.reshape(-1, width), lower=True) for lower, angle in both)
        return np.concatenate([np.zeros((0, width)), *rows])

    def in_unit(self, rows: np.ndarray) -> np.ndarray:
        """Columns (m, 3, q) of whitened rows (n, q) in the unit of the channel; of angles those of the stretches."""
        if not self.models:
            parts = np.split(rows, np.cumsum([lower.shape[0] for *_, lower in self.stretches])[:-1])
            angles = [lower @ part for (*_, lower), part in zip(self.stretches, parts, strict=True)]
            return np.concatenate(angles).reshape(-1, 3, rows.shape[1])
        parts = rows.reshape(3, self.time.size, -1) * self.level.value.T[:, :, None]
        unwhitened = [noise.unwhiten(model, part, self.good) for model, part in zip(self.models, parts, strict=True)]
        together = np.nan_to_num(np.stack(unwhitened, axis=1))
        for one in reversed(self.common):
            together = one.taken_out(together, 1.0)
        return np.where(self.good[:, None, None], together, np.nan)

    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time s and axis of the rows, and time s that sorts them into blocks, of a stretch its begin; (n,) each."""
        if self.models:
            time = np.tile(self.time, 3)
            return time, np.repeat([0, 1, 2], self.time.size), time
        time = np.repeat(np.concatenate([np.zeros(0), *(self.time[b:e] for b, e, _ in self.stretches)]), 3)
        counts = np.array([3 * (e - b) for b, e, _ in self.stretches], dtype=int)
        return time, np.tile([0, 1, 2], time.size // 3), np.repeat([self.time[b] for b, _, _ in self.stretches], counts)

    def free(self, stretch: tuple) -> np.ndarray:
        """Whitened columns (3 k, 6) of the start angle and rate of the attitude of a stretch."""
        begin, end, lower = stretch
        R_bi = self.R_bi[begin:end]
        start = R_bi @ np.broadcast_to(R_bi[0].T, R_bi.shape)
        rate = kinematics.angle_from_rate_change(self.time[begin:end], R_bi, np.broadcast_to(np.eye(3), R_bi.shape))
        return solve_triangular(lower, np.concatenate([start, rate], axis=2).reshape(-1, 6), lower=True)


def without_common(common: Sequence[noise.Common], bins: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Bins (m, 3, q) without the noise that axes have in common, zero where there are no data (m,)."""
    bins = np.where(good[:, None, None], bins, 0.0)
    for one in common:
        bins = one.taken_out(bins)
    return bins


def _width(time, bin_s):
    """Number of epochs (n,) s in a bin of bin_s, at least one."""
    return max(1, round(bin_s / float(np.median(np.diff(time)))))


def coloured(time, series, columns, effects, bin_s, order) -> Channel:
    """Channel of a series (n, 3), a noise model for each axis; columns {parameter: (n, 3, 3)} are free, see PLACES.

    In the difference of the sensors effects [(n, 3, q)], with waves of latitude, and jumps are free too, so that
    none is noise; the noise that the fit absorbs is put back. In a torque they are not: attitude answers it, and so
    does what acts on attitude.
    """
    observed, width = np.zeros((len(series), 3, 1 + GLOBAL)), _width(time, bin_s)
    observed[:, :, 0] = series
    for name, part in columns.items():
        observed[:, :, 1:][:, :, PLACES[name]] = part
    bins = means(observed, width)
    good = np.isfinite(bins).all(axis=(1, 2))
    residual = np.where(good[:, None], bins[:, :, 0], np.nan)
    free = np.nan_to_num(np.concatenate([bins[:, :, 1:], *(means(one, width) for one in effects)], axis=2))

    def clean(columns):
        """Residual (m, 3) of the bins after least squares for columns (m, 3, q)."""
        return noise.beside([residual], [columns])(residual, 0)

    for axis in range(3 if effects else 0):
        jumps = noise.jumps(lambda places, a=axis, b=free: np.nan_to_num(clean(_with_jumps(b, a, places))[:, a]))
        free = _with_jumps(free, axis, jumps)
    common, spectra = (), ()
    if effects:
        _, models, white = noise.spectra_beside(residual, free, order, bin_s)
        unit = np.stack([noise.unwhiten(model, white[:, k], good) for k, model in enumerate(models)], axis=1)
        common = tuple(noise.in_common(unit, models))
        residual = np.where(good[:, None], without_common(common, bins[:, :, :1], good)[:, :, 0], np.nan)
        spectra, models, white = noise.spectra_beside(residual, without_common(common, free, good), order, bin_s)
    else:
        models = noise.fit_detrended([residual], noise.beside([residual], [free]), order, bin_s)
        white = noise.whitened(models, clean(free), good).reshape(3, -1).T
    level = noise.changing_levels(np.where(good[:, None], white, np.nan), free.shape[2] / 3)
    channel = Channel(width, means(time, width), good, tuple(models), common, level, spectra=tuple(spectra))
    return replace(channel, rows=channel.whitened(observed))


def _with_jumps(free, axis, places):
    """Columns (m, 3, q) with those of jumps of one axis, at row numbers (k,), added behind, (m, 3, q + 2 k)."""
    columns = np.zeros((len(free), 3, 2 * len(places)))
    columns[:, axis] = noise.jump_columns(len(free), places)
    return np.concatenate([free, columns], axis=2)


def of_attitude(about, R_bi, observed, modelled, beyond, settings) -> Channel:
    """Channel of star camera against angular readings, start and rate of each stretch free; beyond by `unsmoothed`."""
    width = _width(about.time, settings["bin_s"])
    norm = np.linalg.norm(observed["q"].values, axis=1, keepdims=True)  # NaN where there is none
    unit = np.where(norm > 0.5, observed["q"].values / np.maximum(norm, 0.5), [1.0, 0, 0, 0])
    turned = R_bi @ np.swapaxes(frames.R_bi_from_quaternion(unit), 1, 2)
    angle = np.stack([turned[:, i, j] - turned[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    angle = np.where(norm > 0.5, angle / 2, np.nan)
    angular, residual = modelled["angular_b"].values.mean(axis=1), -beyond
    time, turned = means(about.time, width), means(R_bi, width)
    bins = means(angle, width)
    good = np.isfinite(bins).all(axis=1) & np.isfinite(means(residual, width)).all(axis=1)
    angle_sigma, angular_sigma = (_white_noise(series, width) for series in (angle, angular))
    size, stretches = max(4, round(settings["stretch_s"] / np.median(np.diff(time)))), []
    for begin in range(0, time.size - size + 1, size):
        end = begin + size
        if good[begin:end].all():
            here = (begin + end) // 2
            units = np.eye(3 * size).reshape(size, 3, 3 * size) * np.tile(angular_sigma[here], size)
            P = integrated(time[begin:end], turned[begin:end], units).reshape(3 * size, -1)
            stretches.append((begin, end, np.linalg.cholesky(P @ P.T + np.diag(np.tile(angle_sigma[here] ** 2, size)))))
    channel = Channel(width, time, good, R_bi=turned, stretches=tuple(stretches))
    rows = channel.whitened_angles([bins[begin:end, :, None] for begin, end, _ in stretches], 1)
    rows = rows + channel.whitened(residual[:, :, None])
    return replace(channel, rows=np.concatenate([rows, np.zeros((len(rows), GLOBAL))], axis=1))


def _white_noise(series, width):
    """Sigma (m, 3) of white noise in bins of `width` samples, from differences of samples (n, 3) of a slow signal."""
    step = np.diff(series, axis=0)[::2]
    sigma = np.sqrt(np.nanmean(step**2, axis=0) / 2 / width)
    level = noise.changing_levels(step / np.sqrt(np.nanmean(step**2, axis=0)), 0.0).value
    return sigma * level[np.minimum(np.arange(len(series) // width) * width // 2, len(level) - 1)]


def integrated(time: np.ndarray, R_bi: np.ndarray, rate_dot_b: np.ndarray) -> np.ndarray:
    """Rotation (k, 3, q) rad that grows from added angular accelerations (k, 3, q) rad s-2, at rest at the start."""
    return kinematics.angle_from_rate_change(time, R_bi, kinematics.running_integral(time, rate_dot_b))


def means(series: np.ndarray, width: int) -> np.ndarray:
    """Means (m, ...) of `width` neighbouring samples (n, ...), of those there are; NaN where there are none."""
    parts = series[: len(series) // width * width].reshape(-1, width, *series.shape[1:])
    finite = np.isfinite(parts)
    count = finite.sum(axis=1)
    return np.where(count > 0, np.where(finite, parts, 0.0).sum(axis=1), np.nan) / np.maximum(count, 1)


def channels_of(about, R_bi, observed, modelled, effects, settings) -> dict[str, Channel]:
    """Channels of the record, {name: Channel}; effects are derivatives of the difference of two sensors, (n, 3, q)."""
    channels = {}
    if len(about.extra["positions"]) == 2:  # the difference of the readings less its model
        T, linear = tensor(about), modelled["linear_b"].values
        difference = linear[:, 0] - linear[:, 1] + np.matvec(T, apart(about))
        noise_model = settings["bin_s"], settings["noise_order"]
        channels["linear"] = coloured(about.time, difference, {"distance": -T}, list(effects), *noise_model)
    test_mass = box_inertia(settings["satellite"], settings["elongation"])
    rate_dot_left = unsmoothed(modelled, "two_sensor", slice(None), test_mass)
    channels["attitude"] = of_attitude(about, R_bi, observed, modelled, rate_dot_left, settings)
    if settings["control_hz"] > 0:
        control = settings["control_hz"], settings["control_damping"]
        torque = uncontrolled_torque(modelled, "two_sensor", about.inertia_b, *control)
        torque = torque + np.matvec(about.inertia_b, np.nan_to_num(rate_dot_left))
        arm = -about.extra["mass"] * frames.cross_matrix(about.extra["non_gravitational_b"])
        noise_model = settings["torque_step_s"], settings["torque_noise_order"]
        channels["torque"] = coloured(about.time, torque, {"pressure": arm, "constant": np.eye(3)}, [], *noise_model)
    return channels
