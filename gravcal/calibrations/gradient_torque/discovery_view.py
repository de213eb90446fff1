"""A day of S-GRS as discovery sees it: the difference of both sensors, attitude against angular readings, torques.

The drag is free at every epoch, so that it takes up the mean reading of the sensors and leaves their difference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.linalg import block_diag, solve_triangular

from gravcal.calibrations.gradient_torque import discovery_series as series
from gravcal.calibrations.gradient_torque.discovery_effects import listed
from gravcal.calibrations.gradient_torque.discovery_series import DISTANCE, PRESSURE, SHARED
from gravcal.effects import Context
from gravcal.estimation import noise
from gravcal.estimation.noise import fit_beside
from gravcal.physics import kinematics

CHANNELS = ("linear", "attitude", "torque")
PARAMETERS = tuple(f"centre_of_pressure_{axis}" for axis in "xyz")
BLOCK_S = 7200.0  # more than a revolution, so that each block sees every latitude


@dataclass(frozen=True)
class View:
    """A record with what its rows are made of.

    Attributes
    ----------
    fine : Context of the epochs of the record
    width : {channel: epochs in a bin}; time : {channel: (m,) s}; good : {channel: (m,) bool, bins with data}
    noise : {channel: noise models of the axes}, of linear and torque
    pieces : (begin, end, (3 k, 3 k) rad Cholesky factor) of each stretch of the attitude
    R_bi : (m, 3, 3) of the bins of the attitude
    rows : {channel: (n, 1 + SHARED)} whitened: observed, shared columns
    prior : (k, 1 + SHARED) what is known of the shared parameters beforehand, over its standard deviation
    start : (3,) m, centre of pressure
    drag_sigma : m s-2, of the drag, rms
    """

    fine: Context
    width: dict
    time: dict
    good: dict
    noise: dict
    pieces: list
    R_bi: np.ndarray
    rows: dict
    prior: np.ndarray
    start: np.ndarray
    drag_sigma: float


def view(observed: xr.Dataset, modelled: xr.Dataset, found: xr.Dataset, **scene) -> View:
    """View of the products of a day.

    Parameters
    ----------
    observed, modelled, found : Dataset, "ingest", "gradient_torque.gradient", "gradient_torque.drag" by one sensor
    scene : satellite, elongation, gap_limit_s, torque_step_s, torque_noise_order, control_hz, control_damping, bin_s,
        stretch_s, noise_order
    """
    satellite = scene["satellite"]
    R_bi, position = series.attitude(modelled, observed, scene["gap_limit_s"])
    tesseral = series.tesseral(modelled["time"].values, R_bi, position)
    fine = series.context(modelled, found, satellite, tesseral)
    parts = _parts(fine, R_bi, (observed, modelled), scene)
    step = float(np.median(np.diff(fine.time)))
    wide = {name: scene["torque_step_s" if name == "torque" else "bin_s"] for name in parts}
    width = {name: max(1, round(seconds / step)) for name, seconds in wide.items()}
    means = {name: series.means(one, width[name]) for name, one in parts.items()}
    time = {name: series.means(fine.time, width[name]) for name in parts}
    good = {name: np.isfinite(one).all(axis=(1, 2)) for name, one in means.items()}
    models = _noise(fine, means, good, scene, width)
    turned = series.means(R_bi, width["attitude"])
    spread = _spread(parts["attitude"], modelled) / np.sqrt(width["attitude"])
    pieces = _pieces(time["attitude"], turned, good["attitude"], spread, scene["stretch_s"])
    start = found["pressure"].values if "pressure" in found else np.array(satellite["centre_of_pressure"])
    variance = np.diagonal(found["covariance"].values, axis1=1, axis2=2)
    about = (fine, width, time, good, models, pieces, turned, {}, _prior(satellite), start)
    seen = View(*about, float(np.sqrt(np.nanmean(variance))))
    seen.rows.update({name: _first(seen, name, means[name]) for name in parts})
    return _about_solution(seen)


def _parts(fine, R_bi, products, scene):
    """Series of each channel that the record has."""
    observed, modelled = products
    angle = series.star_camera(R_bi, observed)
    reading = series.angular(fine, modelled, scene["satellite"], scene["elongation"])
    found = {"attitude": np.stack([angle, reading], axis=2)}
    if len(fine.extra["positions"]) == 2:
        found["linear"] = series.difference(fine, modelled)
    if scene["control_hz"] > 0:
        found["torque"] = series.torque(fine, modelled, scene["control_hz"], scene["control_damping"])
    return {name: found[name] for name in CHANNELS if name in found}


def _noise(fine, means, good, scene, width):
    """Noise models of the axes of each channel but the attitude, beside the shared columns.

    In the difference of the sensors everything that a listed effect adds is free as well, so that none is noise; what
    the fit took from the noise is put back. A torque is not: attitude answers it, and so does what acts on attitude.
    """
    found = {}
    for name in (one for one in means if one != "attitude"):
        order, step = ("torque_noise_order", "torque_step_s") if name == "torque" else ("noise_order", "bin_s")
        effects = listed(fine, means) if name == "linear" else ()
        added = (series.means(one[name], width[name]) for _, _, one in effects if name in one)
        left = np.where(good[name][:, None], means[name][:, :, 0], np.nan)
        beside = np.nan_to_num(np.concatenate([means[name][:, :, 1:], *added], axis=2))
        found[name] = tuple(fit_beside([left], [beside], scene[order], scene[step]))
    return found


def _spread(attitude, modelled):
    """White noise of one attitude of the star camera rad and of one mean angular reading rad s-2, (2, 3)."""
    return np.stack(
        [series.neighbours(attitude[:, :, 0]), series.neighbours(modelled["angular_b"].values.mean(axis=1))]
    )


def _prior(satellite):
    """What is known of the shared parameters beforehand, (k, 1 + SHARED), each over its standard deviation."""
    apart = np.linalg.norm(satellite["sensor_position_sigma"], axis=0)
    pressure = np.array(satellite["centre_of_pressure"]), np.array(satellite["centre_of_pressure_sigma"])
    rows = []
    for place, value, sigma in ((PRESSURE, *pressure), (DISTANCE, np.zeros(3), apart)):
        columns = np.zeros((3, SHARED))
        columns[:, place] = np.diag(1 / sigma)
        rows.append(np.column_stack([value / sigma, columns]))
    return np.concatenate(rows)


def _pieces(time, R_bi, good, spread, stretch_s):
    """Stretches of the attitude without gap, with the Cholesky factor of their noise."""
    size, found = max(4, round(stretch_s / np.median(np.diff(time)))), []
    for begin in range(0, time.size - size + 1, size):
        end = begin + size
        if good[begin:end].all():
            units = np.eye(3 * size).reshape(size, 3, 3 * size) * np.tile(spread[1], size)
            P = integrated(time[begin:end], R_bi[begin:end], units).reshape(3 * size, -1)
            found.append((begin, end, np.linalg.cholesky(P @ P.T + np.diag(np.tile(spread[0] ** 2, size)))))
    return found


def integrated(time: np.ndarray, R_bi: np.ndarray, rate_dot_b: np.ndarray) -> np.ndarray:
    """Rotation (k, 3, q) rad that grows from additional angular accelerations (k, 3, q) rad s-2, at rest at the start.

    Parameters
    ----------
    time : (k,) s; R_bi : (k, 3, 3); rate_dot_b : (k, 3, q)
    """
    return kinematics.angle_from_rate_change(time, R_bi, kinematics.running_integral(time, rate_dot_b))


def binned(seen: View, channel: str, values: np.ndarray) -> np.ndarray:
    """Whitened rows (n, q) of what is added to a channel.

    Parameters
    ----------
    seen : View
    channel : of CHANNELS
    values : (epochs, 3, q), m s-2, N m, or rad s-2 of the mean angular reading
    """
    means = np.nan_to_num(series.means(values, seen.width[channel]))
    if channel != "attitude":
        return _axes(seen, channel, means)
    return _stretches(seen, lambda begin, end: integrated(*_at(seen, begin, end), means[begin:end]))


def _axes(seen, channel, means):
    """Rows of a channel with noise models, axis by axis."""
    return np.concatenate([noise.whiten(seen.noise[channel][k], means[:, k], seen.good[channel]) for k in range(3)])


def _stretches(seen, angle):
    """Rows of the attitude from a function of begin and end that gives angles (k, 3, q) rad."""
    rows = [
        solve_triangular(lower, (part := angle(begin, end)).reshape(-1, part.shape[2]), lower=True)
        for begin, end, lower in seen.pieces
    ]
    return np.concatenate(rows) if rows else np.zeros((0, 1))


def _at(seen, begin, end):
    return seen.time["attitude"][begin:end], seen.R_bi[begin:end]


def _first(seen, channel, means):
    """Rows of the record itself, with the shared columns."""
    if channel != "attitude":
        return _axes(seen, channel, np.nan_to_num(means))

    def angle(begin, end):
        return means[begin:end, :, :1] + integrated(*_at(seen, begin, end), means[begin:end, :, 1:])

    rows = _stretches(seen, angle)
    return np.concatenate([rows, np.zeros((len(rows), SHARED))], axis=1)


def _about_solution(seen):
    """View with rows less the solution of the shared parameters, so that what is found are changes of it."""
    rows = np.concatenate([*seen.rows.values(), seen.prior])
    scale = np.maximum(np.linalg.norm(rows[:, 1:], axis=0), 1e-300)
    value = np.linalg.lstsq(rows[:, 1:] / scale, rows[:, 0], rcond=None)[0] / scale

    def left(part):
        return np.column_stack([part[:, 0] - part[:, 1:] @ value, part[:, 1:]])

    return replace(seen, rows={name: left(part) for name, part in seen.rows.items()}, prior=left(seen.prior))


def rows_of(seen: View, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Time s and axis of the rows of a channel.

    Parameters
    ----------
    seen : View
    channel : of CHANNELS
    """
    time = seen.time[channel]
    if channel != "attitude":
        return np.tile(time, 3), np.repeat([0, 1, 2], time.size)
    parts = [time[begin:end] for begin, end, _ in seen.pieces]
    time = np.repeat(np.concatenate([np.zeros(0), *parts]), 3)
    return time, np.tile([0, 1, 2], time.size // 3)


def places(seen: View) -> list[dict]:
    """Places of the rows of each channel in each block.

    Parameters
    ----------
    seen : View
    """
    time = seen.fine.time
    count = max(2, int((time[-1] - time[0]) / BLOCK_S))
    edges, found = np.linspace(time[0], time[-1] + 1e-6, count + 1), [{} for _ in range(count)]
    for channel in seen.rows:
        at, _ = rows_of(seen, channel)
        if channel == "attitude":  # a stretch belongs to the block that it begins in
            size = [3 * (end - begin) for begin, end, _ in seen.pieces]
            first = [seen.time[channel][begin] for begin, _, _ in seen.pieces]
            at = np.repeat(first, size) if size else at
        number = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, count - 1)
        for k in range(count):
            found[k][channel] = np.flatnonzero(number == k)
    return found


def blocks(seen: View) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Block`: stretches of two hours, and what was known beforehand.

    Parameters
    ----------
    seen : View
    """
    free, found = _free(seen), []
    for number, place in enumerate(places(seen), start=1):
        rows = np.concatenate([seen.rows[c][p] for c, p in place.items()])
        about = [rows_of(seen, c) for c in place]
        own = np.zeros((len(rows), 0))
        if place["attitude"].size:
            begin = sum(p.size for c, p in place.items() if CHANNELS.index(c) < CHANNELS.index("attitude"))
            columns = free[place["attitude"]]
            columns = columns[:, np.any(columns != 0, axis=0)]
            own = np.zeros((len(rows), columns.shape[1]))
            own[begin : begin + len(columns)] = columns
        one = {"label": f"stretch {number}", "observed": rows[:, 0], "shared": rows[:, 1:], "own": own}
        one["channel"] = np.concatenate([np.array([c] * p.size) for c, p in place.items()])
        one["time"], one["axis"] = (
            np.concatenate([a[k][p] for a, p in zip(about, place.values(), strict=True)]) for k in (0, 1)
        )
        found.append(one)
    return [*found, _known(seen)]


def _free(seen):
    """Columns (n, 6 per stretch) of start and rate of the attitude of each stretch."""
    parts = []
    for begin, end, lower in seen.pieces:
        time, R_bi = _at(seen, begin, end)
        start = R_bi @ np.broadcast_to(R_bi[0].T, R_bi.shape)
        rate = kinematics.angle_from_rate_change(time, R_bi, np.broadcast_to(np.eye(3), R_bi.shape))
        both = np.concatenate([start, rate], axis=2).reshape(-1, 6)
        parts.append(solve_triangular(lower, both, lower=True))
    return block_diag(*parts) if parts else np.zeros((0, 0))


def _known(seen):
    """What was known of the shared parameters beforehand, as a block of its own."""
    count = len(seen.prior)
    rows = {"observed": seen.prior[:, 0], "shared": seen.prior[:, 1:], "own": np.zeros((count, 0))}
    about = {"channel": np.array(["prior"] * count), "time": np.arange(count, dtype=float)}
    return {"label": "known beforehand", **rows, **about, "axis": np.argmax(seen.prior[:, 1:] > 0, axis=1) % 3}
