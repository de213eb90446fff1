"""Observations of an accelerometer for discovery: only their slow part is free, firings are among the causes."""

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
from gravcal.estimation.records import Block, Candidate, Entry, Fitted, Observations, reported

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
    residual = (estimate["measured"] - estimate["fitted"]).values
    residuals = np.split(residual, np.cumsum([rows.size for rows, *_ in pieces])[:-1])
    per_component = estimate.sizes["parameter"] // 6
    noises, cleaned = accelerometer.noises(aligned, pieces, residuals, noise_order, per_component, transient_sigma)
    parts = [(*one, c) for one in cleaned for c in range(6) if noises[c] is not None]
    order = dict.fromkeys(Readings.channels, noises[parts[0][3]].coefficients[-1].size)
    return Readings(aligned, parts, noises, _causes(aligned, estimate), order)


def _causes(aligned, estimate):
    """Candidates with columns (n, 6, q), firings at their estimated times; a delay has the secant over its whole size.

    The acceleration by firings on a CoM offset is part of their force: only torquers separate the two.
    """
    values = dict(zip(map(str, estimate["parameter"].values), estimate["value"].values, strict=True))
    delay = float(np.nan_to_num(values["delay"]))
    candidates = {one.cause: one for one in accelerometer.causes(aligned, delay, np.zeros((6, 6)))}
    near = max(abs(delay), NEAR_S)  # within which a delay is linear
    ends = (delay, 0.0) if abs(delay) == near else (near, -near)
    by_delay = (_foretold(aligned, ends[0]) - _foretold(aligned, ends[1])) / (ends[0] - ends[1])
    share, impulse = accelerometer.duty(aligned, delay), effect(FIRINGS)
    by_axis = np.zeros((share.shape[0], 6, 3))
    by_axis[:, 3:] = (share @ aligned["nominal_b"].values)[:, :, None] * np.eye(3)
    candidates[DELAY] = replace(candidates[DELAY], columns=[by_delay[:, :, None]])
    return [one for one in (listed(impulse, [by_axis]), *candidates.values()) if one.columns[0].any()]


def _foretold(aligned, delay_s):
    """Reading (n, 6) m s-2, rad s-2 that the thruster table predicts, tags of firings late by delay_s."""
    angular = accelerometer.duty(aligned, delay_s) @ aligned["nominal_b"].values
    return np.concatenate([np.zeros_like(angular), angular], axis=1)


@dataclass(frozen=True)
class Readings(Observations):
    """Observations of a record, whitened, less the prediction of thruster table and torquers."""

    aligned: xr.Dataset  #: "routine.align"
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, int]]  #: steps, slow part, which have a reading, component
    noises: list[NoiseModel | None]  #: of each component, None where it has no reading
    causes: list[Candidate]  #: with their columns (n, 6, q) of the whole record
    noise_order: Mapping[str, int] = field()  #: {channel: coefficients of its noise}, fitted in these rows

    name = "routine"
    channels = ("linear", "angular")
    parameters = ()
    unit, scale, start = "1", np.zeros(0), np.zeros(0)

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a stretch and component, whitened, slow part local: components share causes and nothing else."""
        observed, time, made = accelerometer.readings(self.aligned), self.aligned["time"].values, []
        observed = observed - _foretold(self.aligned, 0.0)
        observed[:, 3:] -= self.aligned["magnetic_b"].values
        for rows, slow, valid, c in self.parts:
            white = whiten(self.noises[c], np.column_stack([observed[rows, c], slow]), valid)
            label, about = f"{COMPONENTS[c]} from {time[rows[0]]:.0f} s", (self.channels[c // 3], c % 3, time[rows])
            made.append(Block.of(label, white[:, 0], *about, local=white[:, 1:]))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates with whitened columns (m, q) in every block, None where a cause does not act."""

        def white(added):  # (n, 6, q) of the whole record
            rows = [(c, added[rows, c], valid) for rows, _, valid, c in self.parts]
            return [whiten(self.noises[c], values, valid) if values.any() else None for c, values, valid in rows]

        return [replace(one, form="", columns=white(one.columns[0])) for one in self.causes]

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time (m,) s, prediction (m, 3), zero beside the slow part, rows (q, m, 3) in the unit of the component."""
        steps, _, valid, c = self.parts[number]
        columns = np.zeros((rows.shape[1], steps.size, 3))
        columns[:, :, c % 3] = unwhiten(self.noises[c], rows, valid).T
        return self.aligned["time"].values[steps], np.zeros((steps.size, 3)), columns

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:  # noqa: ARG002
        """Entry with shares of the nominal impulses in full: the baseline has taken one off."""
        return _firings_moved(entry, 1.0)

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records less what the effects of a model add to the readings."""
        added, known = np.zeros((self.aligned.sizes["time"], 6)), {one.cause: one for one in self.causes}
        for entry in (_firings_moved(one, -1.0) for one in model if one.cause in known):
            added += known[entry.cause].added(entry)[0]
        change = {"linear_b": added[:, :3], "angular_b": added[:, 3:]}
        return self.aligned.assign({name: self.aligned[name] - one for name, one in change.items()})


def _firings_moved(entry, step):
    """Entry with a step added to its shares of the nominal impulses, if its cause is the firings."""
    items = entry.parameters.items() if entry.cause == FIRINGS else ()
    moved = {n: replace(p, value=None if p.value is None else p.value + step) for n, p in items}
    return replace(entry, parameters=moved) if moved else entry


REPORT = reported(__file__, "discovery.toml")
