"""Columns of every effect that a swing can show, and of the measured channels."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from gravcal.calibrations.inertial_sensor.discovery_view import (
    CHANNELS,
    View,
    attitude_rows,
    context,
    linear_rows,
    stretches,
    turned,
)
from gravcal.effects import Effect, effect
from gravcal.effects.entries import each_alone
from gravcal.effects.inertial_sensor import EFFECTS

STEP, TONE = "accelerometer.bias_step", "accelerometer.stray_tone"
#: Effects of other families that a sensor of this kind can have.
OTHERS = (
    "accelerometer.misalignment",
    "accelerometer.angular_leak",
    "timing.accelerometer_delay",
    "timing.star_camera_delay",
)
STEP_S = 2.0
MARGIN_S = 10.0


def candidates(seen: View) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Candidate`: effects, steps, then regressors of the measured channels.

    Parameters
    ----------
    seen : View
    """
    found = [one for entry in (*EFFECTS, *map(effect, OTHERS)) for one in each_alone(_of(seen, entry))]
    time = seen.record.time
    return found + steps(seen, np.arange(time[0] + MARGIN_S, time[-1] - MARGIN_S, STEP_S)) + _drivers(seen)


def _of(seen, entry):
    """An effect with all its parameters."""
    return named(entry) | {"columns": cut(seen, **_rows(seen, entry))}


def named(entry: Effect) -> dict:
    """Fields of a candidate with all parameters of an effect, but for its columns.

    Parameters
    ----------
    entry : Effect
    """
    words = {"cause": entry.slug, "form": "", "names": [p.name for p in entry.parameters]}
    return words | {"units": [p.unit for p in entry.parameters], "prior": [p.prior_sigma for p in entry.parameters]}


def _rows(seen, entry):
    """Whitened rows by channel of an effect."""
    fine = context(seen, fine=True)
    if entry.channel == "linear_b":
        return {"linear": linear_rows(seen, entry.columns(context(seen, fine=False)))}
    if entry.channel == "angular_b":
        arm = seen.start[-3:]
        felt = np.moveaxis(np.cross(np.moveaxis(entry.columns(context(seen, fine=False)), 2, 1), arm), 1, 2)
        return {"attitude": -attitude_rows(seen, turned(seen, entry.columns(fine))), "linear": -linear_rows(seen, felt)}
    if entry.channel == "acc_delay":  # readings of before; linear ones and their model move together
        late = np.gradient(fine.angular_b, fine.time, axis=0)[:, :, None]
        return {"attitude": attitude_rows(seen, turned(seen, late))}
    if entry.channel == "sca_delay":
        late = -np.stack([np.interp(seen.swing.time_att, fine.time, c) for c in fine.rate_b.T], axis=1)
        return {"attitude": attitude_rows(seen, late[:, :, None])}
    angle = np.broadcast_to(np.eye(3), (seen.swing.time_att.size, 3, 3))
    return {"attitude": attitude_rows(seen, angle)}


def cut(seen: View, **rows) -> list[np.ndarray | None]:
    """Columns of every block from the rows of whole channels.

    Parameters
    ----------
    seen : View
    rows : {channel: (n, q)}
    """
    parts = []
    for channel in CHANNELS:
        given = rows.get(channel)
        parts += [None if given is None else given[part] for part in stretches(seen, channel)]
    return parts


def steps(seen: View, epochs: np.ndarray) -> list[dict]:
    """Fields of candidates: a step of the linear readings at each of some epochs.

    Parameters
    ----------
    seen : View
    epochs : (k,) s
    """
    time, found = seen.record.time, []
    for epoch in epochs:
        after = np.clip((time + (time[1] - time[0]) / 2 - epoch) / (time[1] - time[0]), 0, 1)
        found.append(step(epoch, cut(seen, linear=linear_rows(seen, after[:, None, None] * np.eye(3)))))
    return found


def step(epoch: float, columns: list[np.ndarray | None]) -> dict:
    """Fields of a candidate: a step of the linear readings.

    Parameters
    ----------
    epoch : s
    columns : (n, 3) or None a block
    """
    words = {"cause": STEP, "form": f"time {epoch:.1f} s", "names": ["x", "y", "z"], "units": ["m s-2"] * 3}
    return words | {"prior": [], "columns": columns}


def waves(seen: View, axis: int):
    """Function (block, Hz) -> whitened cosine and sine (n, 2) on one axis of the linear readings.

    Parameters
    ----------
    seen : View
    axis : 0, 1 or 2
    """
    time = seen.record.time

    def columns(frequency):
        both = waves_of(time - time[0], time[1] - time[0], frequency)
        rows = linear_rows(seen, both[:, None, :] * np.eye(3)[axis][None, :, None])
        return cut(seen, attitude=np.zeros((int(seen.valid.sum()), 2)), linear=rows)

    return block_by_block(columns)


def block_by_block(columns: Callable):
    """Function (block, Hz) of a function Hz -> columns of every block; those of the last frequency are kept.

    Parameters
    ----------
    columns : as described
    """
    last = functools.lru_cache(1)(columns)
    return lambda block, frequency: last(frequency)[block]


def waves_of(time: np.ndarray, width: float, frequency: float) -> np.ndarray:
    """Cosine and sine (n, 2), means over bins.

    Parameters
    ----------
    time : (n,) s; width : s, of a bin; frequency : Hz
    """
    phase = 2 * np.pi * frequency * time
    return np.stack([np.cos(phase), np.sin(phase)], axis=1) * np.sinc(frequency * width)


def _drivers(seen):
    """Functions of the motion and of time, added to the linear readings or to the angular ones."""
    found = []
    coarse = context(seen, fine=False)
    for driver, form, shape in _series(coarse, seen):
        columns = cut(seen, linear=linear_rows(seen, shape[:, None, None] * np.eye(3)))
        found.append(unknown(driver, f"linear reading, {form}", "linear", "m s-2", columns))
    for driver, form, shape in _series(context(seen, fine=True), seen):
        columns = cut(seen, attitude=-attitude_rows(seen, turned(seen, shape[:, None, None] * np.eye(3))))
        found.append(unknown(driver, f"angular reading, {form}", "angular", "rad s-2", columns))
    return found


def unknown(driver: str, form: str, channel: str, unit: str, columns: list[np.ndarray | None]) -> dict:
    """Fields of a candidate in no list, added to the three readings of a channel.

    Parameters
    ----------
    driver, form, channel, unit : words
    columns : (n, 3) or None a block
    """
    names = [f"{channel}_{a}" for a in "xyz"]
    return {"cause": f"unknown:{driver}", "form": form, "names": names, "units": [unit] * 3, "prior": [],
            "columns": columns}  # fmt: skip


def _series(about, seen):
    """Drivers (n,) 1 on the epochs of a context, each of a size near one."""
    rate, turn = about.rate_b - about.rate_b.mean(axis=0), about.rate_dot_b
    step = np.diff(about.time, prepend=about.time[0])[:, None]
    angle = np.cumsum(np.nan_to_num(rate) * step, axis=0)
    rows = []
    for name, values in (("rate", rate), ("attitude", angle), ("angular_acceleration", turn)):
        values = np.nan_to_num(values) / max(np.nanmax(np.abs(values)), 1e-30)
        rows += [(name, f"component {a}", values[:, i]) for i, a in enumerate("xyz")]
        pairs = [(i, j) for i in range(3) for j in range(i, 3)]
        rows += [(name, f"product {'xyz'[i]}{'xyz'[j]}", values[:, i] * values[:, j]) for i, j in pairs]
        rows += [(name, f"size of {a}", np.abs(values[:, i])) for i, a in enumerate("xyz")]
        rows += [(name, f"cube of {a}", values[:, i] ** 3) for i, a in enumerate("xyz")]
    since = about.time - seen.record.time[0]
    rows += [("time", f"decay of {t:g} s", np.exp(-np.clip(since, 0, None) / t)) for t in (10.0, 30.0, 90.0)]
    return rows
