"""Readings of an accelerometer as discovery sees them: only their slow part is free, firings are among the causes."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.causes import listed
from gravcal.calibrations.routine import accelerometer
from gravcal.calibrations.routine.accelerometer import COMPONENTS, DELAY
from gravcal.effects import effect
from gravcal.estimation.noise import NoiseModel, unwhiten, whiten
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Observations, Reported

NEAR_S = 0.01  # a delay is linear within it
FIRINGS = "torque.thruster_firings"


def observe(
    products: Mapping[str, xr.Dataset], *, block_s: float, knot_s: float, noise_order: int, transient_sigma: float
) -> "Readings":
    """Observations of one record; settings as of `accelerometer.estimate`.

    Products are "align" and "estimate" of routine: noise, delay and size of firings are those with every cause free.
    """
    aligned, estimate = products["align"], products["estimate"]
    pieces = list(accelerometer.blocks(aligned, block_s, knot_s))
    rest = (estimate["measured"] - estimate["fitted"]).values
    left = np.split(rest, np.cumsum([rows.size for rows, *_ in pieces])[:-1])
    count = estimate.sizes["parameter"] // 6
    noises, kept = accelerometer.noises(aligned, pieces, left, noise_order, count, transient_sigma)
    parts = [(*one, c) for one in kept for c in range(6) if noises[c] is not None]
    order = dict.fromkeys(Readings.channels, noises[parts[0][3]].coefficients[-1].size)
    return Readings(aligned, parts, noises, _causes(aligned, estimate), order)


def _causes(aligned, estimate):
    """Columns beside what the model foretells, firings where they were; a late tag has the column of its whole size.

    What firings do to a satellite whose offset is not zero is in their own force: by torquers alone is it told apart.
    """
    value = dict(zip(map(str, estimate["parameter"].values), estimate["value"].values, strict=True))
    delay = float(np.nan_to_num(value["delay"]))
    made = {one.cause: one for one in accelerometer.causes(aligned, delay, np.zeros((6, 6)))}
    near = max(abs(delay), NEAR_S)  # within which a delay is linear
    ends = (delay, 0.0) if abs(delay) == near else (near, -near)
    moved = (_foretold(aligned, ends[0]) - _foretold(aligned, ends[1])) / (ends[0] - ends[1])
    share, impulse = accelerometer.duty(aligned, delay), effect(FIRINGS)
    by_axis = np.zeros((share.shape[0], 6, 3))
    by_axis[:, 3:] = (share @ aligned["nominal_b"].values)[:, :, None] * np.eye(3)
    made[DELAY] = replace(made[DELAY], columns=[moved[:, :, None]])
    return [one for one in (listed(impulse, [by_axis]), *made.values()) if one.columns[0].any()]


def _foretold(aligned, delay_s):
    """Reading (n, 6) by the thruster table, tags of firings late by so many seconds."""
    angular = accelerometer.duty(aligned, delay_s) @ aligned["nominal_b"].values
    return np.concatenate([np.zeros_like(angular), angular], axis=1)


@dataclass(frozen=True)
class Readings(Observations):
    """Observations of a record."""

    aligned: xr.Dataset  #: "routine.align"
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, int]]  #: rows, slow part, where a reading is, component
    noises: list[NoiseModel | None]  #: of each component, None where it has no reading
    causes: list[Candidate]  #: with their columns (n, 6, q) of the whole record
    noise_order: Mapping[str, int] = field()  #: of the noise, which is that of these very rows

    name = "routine"
    channels = ("linear", "angular")
    parameters = ()
    unit, scale, start = "1", np.zeros(0), np.zeros(0)

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a stretch and component: components share causes and nothing else."""
        observed, time, made = accelerometer.readings(self.aligned), self.aligned["time"].values, []
        observed = observed - _foretold(self.aligned, 0.0)
        observed[:, 3:] -= self.aligned["magnetic_b"].values
        for rows, slow, there, c in self.parts:
            white = whiten(self.noises[c], np.column_stack([observed[rows, c], slow]), there)
            label, about = f"{COMPONENTS[c]} from {time[rows[0]]:.0f} s", (self.channels[c // 3], c % 3, time[rows])
            made.append(Block.of(label, white[:, 0], *about, local=white[:, 1:]))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Causes that the record can show."""
        made = []
        for one in self.causes:
            rows = [(c, one.columns[0][rows, c], there) for rows, _, there, c in self.parts]
            white = [whiten(self.noises[c], own, there) if own.any() else None for c, own, there in rows]
            made.append(replace(one, form="", columns=white))
        return made

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time, nothing foretold beside the slow part, and rows in the unit of the component."""
        at, _, there, c = self.parts[number]
        columns = np.zeros((rows.shape[1], at.size, 3))
        columns[:, :, c % 3] = unwhiten(self.noises[c], rows, there).T
        return self.aligned["time"].values[at], np.zeros((at.size, 3)), columns

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:  # noqa: ARG002
        """Impulses in units of the nominal ones, which the model holds once."""
        return _firings_moved(entry, 1.0)

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records less what the effects of a model add to the readings."""
        added, known = np.zeros((self.aligned.sizes["time"], 6)), {one.cause: one for one in self.causes}
        for entry in (_firings_moved(one, -1.0) for one in model if one.cause in known):
            added += known[entry.cause].added(entry)[0]
        less = {"linear_b": added[:, :3], "angular_b": added[:, 3:]}
        return self.aligned.assign({name: self.aligned[name] - one for name, one in less.items()})


def _firings_moved(entry, step):
    """Entry with the share of nominal impulses moved, if it is of these."""
    rows = entry.parameters.items() if entry.cause == FIRINGS else ()
    moved = {name: replace(one, value=one.value and one.value + step) for name, one in rows}
    return replace(entry, parameters=moved) if moved else entry


REPORT = Reported(
    note="Components are looked at in stretches with a slow part free between knots, less what thruster table and "
    "torquers foretell. Two thrusters that fire together are one pair. Firings are placed where a fit with every cause "
    "free has them.",
    readings={name: " Less its slow part." for name in Readings.channels},
)
