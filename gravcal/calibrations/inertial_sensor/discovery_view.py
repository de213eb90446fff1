"""A swing as discovery sees it: whitened attitude and linear voltages, in alternate stretches.

All parameters of the fit are shared by all blocks: factors, delay and offset, which the calibration reports, then start
values of the attitude and drifts of the linear readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy.linalg import solve_triangular

from gravcal.calibrations.inertial_sensor import bins, offset, scale
from gravcal.calibrations.inertial_sensor import swing as swings
from gravcal.effects import inertial_sensor as electrodes
from gravcal.effects.base import Context
from gravcal.estimation import noise
from gravcal.estimation.noise import without_lines
from gravcal.physics import frames, kinematics, sensing

CHANNELS = ("attitude", "linear")
#: Reported parameters: factors about x and about y and z, tracker delay, offset.
PARAMETERS = ("beta_x", "beta_yz", "delay", "offset_x", "offset_y", "offset_z")
STILL = 3.0  # an axis moves if its angular acceleration is above this many times the noise of a bin
STRETCH_S = 10.0  # of the blocks, between half a period of the swing and the memory of its noise


@dataclass(frozen=True)
class View:
    """A swing with its fits.

    Attributes
    ----------
    swing : swing.Swing; motion : predicted; unknowns : of the fit
    lower : (r, r) rad, Cholesky factor of the attitude; valid : (3 b,) rows that there are
    residual, design : (r,) rad, (r, p), of the attitude about the solution
    record : offset.Record; k : (3,) m s-2 V-1; tensor : (b, 3, 3) s-2; good : (b,) bins of the linear readings
    start : (6,) rad s-2 V-1, s, m, the solution
    quiet : {channel: quiet samples an axis}
    """

    swing: swings.Swing
    motion: swings.Motion
    unknowns: swings.Unknowns
    lower: np.ndarray
    valid: np.ndarray
    residual: np.ndarray
    design: np.ndarray
    record: offset.Record
    k: np.ndarray
    tensor: np.ndarray
    good: np.ndarray
    start: np.ndarray
    quiet: dict


def view(aligned: xr.Dataset, scaled: xr.Dataset, moved: xr.Dataset, **settings) -> View:
    """View of the products of a swing.

    Parameters
    ----------
    aligned, scaled, moved : Dataset, "inertial_sensor.align", "inertial_sensor.scale", "inertial_sensor.offset"
    settings : bin_s, quiet_margin_s, inertia, drift_degree, noise_order
    """
    bin_s, margin = settings["bin_s"], settings["quiet_margin_s"]
    swing = scale.prepare(aligned, bin_s, margin, np.array(settings["inertia"]))
    fitted = swings.fit(swing, scaled["batch_value"].values[: swings.FACTORS])
    maps = swings.noise_map(swing, fitted.motion)
    system = swings.linear_system(swing, fitted.unknowns, fitted.motion, maps)
    record = offset.prepare(aligned, scaled, margin, settings["drift_degree"], settings["noise_order"])
    k = scaled["k"].values[int(scaled["chosen_arm"])]
    turn = _turn(record, fitted.unknowns.factors[swings.OWNER] * np.sqrt(swing.voltage_variance))
    record = replace(record, rate_dot_b=turn, noise=_quiet_noise(aligned, bin_s, margin, settings["noise_order"]))
    tensor = sensing.offset_tensor(record.rate_b, turn, record.gradient_b)
    good = np.isfinite(record.linear_volt).all(axis=1) & np.isfinite(tensor).all(axis=(1, 2))
    place = moved["offset"].values[0]
    start = np.concatenate([fitted.unknowns.factors, [fitted.unknowns.delay], np.nan_to_num(place)])
    quiet = sum(len(b) for b in scale.quiet_blocks(aligned, aligned["volts"].values, bin_s, margin))
    about = (swing, fitted.motion, fitted.unknowns, system.lower, system.valid, system.residual, system.design)
    return View(*about, record, k, tensor, good, start, dict.fromkeys(CHANNELS, float(quiet)))


def context(seen: View, *, fine: bool) -> Context:
    """What effects of the sensor look at, on the epochs of the voltages or on the bins, from the fitted motion.

    A regressor made of the readings themselves would hold their noise, and explain it.

    Parameters
    ----------
    seen : View
    fine : epochs of the voltages; bins else
    """
    record = seen.record
    turn = record.rate_dot_b
    if fine:
        time = seen.swing.time
        known = {"rate_b": record.rate_b, "rate_dot_b": turn, "angular_b": turn}
        at = {name: np.stack([np.interp(time, record.time, c) for c in v.T], axis=1) for name, v in known.items()}
        return Context(time, epoch=time[0], **at)
    linear = _modelled(seen)
    extra = {"linear_volt": linear / seen.k, "displacement_b": -linear / electrodes.LOOP**2}
    known = {"rate_b": record.rate_b, "rate_dot_b": turn, "gradient_b": record.gradient_b}
    known |= {"linear_b": linear, "angular_b": turn}
    return Context(record.time, epoch=record.time[0], extra=extra, **known)


def _quiet_noise(aligned, bin_s, margin, order):
    """Noise of the linear readouts beside the swing; sharp lines, which a tone leaves there too, are no noise."""
    pieces, _ = without_lines(offset.quiet_readouts(aligned, bin_s, margin), bin_s)
    return offset.noise_models(pieces, order, bin_s)


def _turn(record, noise_b):
    """Angular acceleration (b, 3) rad s-2; its mean about axes that the swing leaves at rest.

    There the voltages hold noise alone, and the electrodes that turn the test mass about z also push it along x: their
    noise in the columns would explain noise in the readings.
    """
    turn = np.nan_to_num(record.rate_dot_b)
    return np.where(turn.std(axis=0) < STILL * noise_b, turn.mean(axis=0), turn)


def _modelled(seen):
    """Linear reading (b, 3) m s-2 of the model: drift and offset, without the noise that the measured one has."""
    record, offset_b = seen.record, seen.start[swings.FACTORS + 1 :]
    felt = np.matvec(np.nan_to_num(seen.tensor), offset_b)
    trend = record.trend
    slow = (seen.k * record.linear_volt - felt)[seen.good]
    return felt + trend @ np.linalg.lstsq(trend[seen.good], slow, rcond=None)[0]


def attitude_rows(seen: View, angle_b: np.ndarray) -> np.ndarray:
    """Whitened rows (r, q) of a rotation from predicted to measured attitude, (n, 3, q) rad on the tracker's tags.

    Parameters
    ----------
    seen : View
    angle_b : (m, 3, q)
    """
    swing = seen.swing
    mean, _ = bins.bin_means(swing.time_att, angle_b, swing.edges)
    rows = mean.reshape(seen.valid.size, -1)[seen.valid]
    return solve_triangular(seen.lower, np.nan_to_num(rows), lower=True)


def turned(seen: View, rate_dot_b: np.ndarray) -> np.ndarray:
    """Rotation (m, 3, q) rad at the tracker's tags after angular accelerations (n, 3, q) rad s-2 of the prediction.

    Parameters
    ----------
    seen : View
    rate_dot_b : (n, 3, q) on the epochs of the voltages
    """
    swing = seen.swing
    R_bi = frames.R_bi_from_quaternion(seen.motion.quaternion)
    rate = kinematics.running_integral(swing.time, rate_dot_b)
    angle = kinematics.angle_from_rate_change(swing.time, R_bi, rate)
    shown = np.clip(swing.time_att - seen.unknowns.delay, swing.time[0], swing.time[-1])
    return swings.interpolated(swing.time, angle, shown)


def linear_rows(seen: View, reading: np.ndarray) -> np.ndarray:
    """Whitened rows (3 b, q), axis by axis, of what is added to the linear readings, (b, 3, q) m s-2.

    Parameters
    ----------
    seen : View
    reading : (b, 3, q)
    """
    parts = [
        noise.whiten(seen.record.noise[axis], np.ascontiguousarray(reading[:, axis] / seen.k[axis]), seen.good)
        for axis in range(3)
    ]
    return np.concatenate(parts)


def blocks(seen: View) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Block`: both channels, even and odd stretches.

    Parameters
    ----------
    seen : View
    """
    count = swings.FACTORS + 1
    attitude = solve_triangular(seen.lower, np.column_stack([seen.residual, seen.design]), lower=True)
    linear = _linear_design(seen, count)
    more, width = attitude.shape[1] - 1 - count, linear.shape[1] - 4
    places = {"attitude": [*range(count), *range(count + 3, count + 3 + more)], "linear": [*range(count, count + 3)]}
    places["linear"] += range(count + 3 + more, count + 3 + more + width)
    found = []
    for channel, rows in (("attitude", attitude), ("linear", linear)):
        time, axis = rows_of(seen, channel)
        shared = np.zeros((len(rows), count + 3 + more + width))
        shared[:, places[channel]] = rows[:, 1:]
        for k, part in enumerate(stretches(seen, channel)):
            fixed = {"label": f"{channel} {('even', 'odd')[k]}", "observed": rows[part, 0], "shared": shared[part]}
            fixed |= {"own": np.zeros((part.size, 0)), "channel": np.array([channel] * part.size)}
            found.append(fixed | {"axis": axis[part], "time": time[part]})
    return found


def _linear_design(seen, count):
    """Whitened rows of the linear readings: what is left of them, the offset, drifts."""
    record, tensor = seen.record, np.nan_to_num(seen.tensor)
    trend = record.trend
    drift = np.einsum("nk,ac->nakc", trend, np.eye(3)).reshape(record.time.size, 3, -1)
    left = seen.k * np.nan_to_num(record.linear_volt) - np.matvec(tensor, seen.start[count:])
    both = np.concatenate([left[:, :, None], tensor, drift], axis=2)
    return linear_rows(seen, np.where(seen.good[:, None, None], both, 0.0))


def rows_of(seen: View, channel: str) -> tuple[np.ndarray, np.ndarray]:
    """Time s and axis of the rows of a channel.

    Parameters
    ----------
    seen : View
    channel : name
    """
    if channel == "attitude":
        time, axis = np.repeat(seen.swing.middle, 3), np.tile([0, 1, 2], seen.swing.middle.size)
        return time[seen.valid], axis[seen.valid]
    return np.tile(seen.record.time, 3), np.repeat([0, 1, 2], seen.record.time.size)


def stretches(seen: View, channel: str) -> list[np.ndarray]:
    """Places of the rows of a channel in even and in odd stretches of time.

    Parameters
    ----------
    seen : View
    channel : name
    """
    time, _ = rows_of(seen, channel)
    number = np.floor((time - time.min()) / STRETCH_S).astype(int) % 2
    return [np.flatnonzero(number == k) for k in (0, 1)]
