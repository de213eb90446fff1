"""Observations of routine pointing for discovery: blocks of a revolution, and the effects that a range can show.

No parameter but bias and slow orbit error of each block is free in the baseline. The antenna correction is that of the
pointing as measured; its noise and phase centres are among the causes. Noise is measured beside all of them at once.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from gravcal.calibrations.align import LATE_S, WHOLE_S
from gravcal.calibrations.causes import LateTags, listed, of_late_orbit
from gravcal.calibrations.ranging import model
from gravcal.effects import Context, Effect, effect
from gravcal.estimation import least_squares, records
from gravcal.estimation.records import Candidate, Entry, Fitted, Observations, Parameter, reported

#: Effects that a range can show; a phase break begins another block.
EFFECTS = ("antenna_correction", "phase_centre", "star_camera_misalignment", "multipath", "once_per_revolution")
EFFECTS = ("attitude.star_camera_noise", *(f"ranging.{name}" for name in (*EFFECTS, "delay", "scale", "thermal")))


def observe(
    products: Mapping[str, xr.Dataset], *, nominal_m, correction_left_out: bool, determined_limit_mm: float, **settings
) -> "Routine | LateTags":
    """Observations of a day ("ranging.align"); settings as of `model.blocks`.

    correction_left_out takes the antenna correction of nominal_m (2, 3) away: a phase centre may then be named, a
    component with a larger sigma than the limit not.
    """
    rows, nominal = products["align"], np.asarray(nominal_m, dtype=float).reshape(2, 3)
    if "rate_left" in rows:  # one orbit is of another time, by the range rate
        which = int(np.argmax(np.abs(rows["late"].values[3:])))
        series = (rows[name].values for name in ("rate_time", "rate_left", "rate_change"))
        delay = Parameter(float(rows["late"].values[3 + which]), WHOLE_S, "s")
        return of_late_orbit(rows, *series, delay, "range rate", Routine.name, f"{'ab'[which]} alone")
    added = 0.0 if correction_left_out else rows["correction"].values
    ahead, segment = rows["time"].values + rows["late"].values[0], rows["segment"].values
    beyond = (ahead < rows["time"].values[0]) | (ahead > rows["time"].values[-1])  # by late tags no range is known
    rows = rows.assign(segment=("time", np.where(beyond, segment.max() + 1, segment)))  # in no block, for they are few
    late = late_columns(rows)
    made = Routine(rows, [], nominal, added, determined_limit_mm, bool(late))
    late = late.get("ranging.delay", np.zeros((1, 1)))[:, 0] * rows["late"].values[0]
    tried = np.concatenate([columns for _, columns in made.laws], axis=1)
    return replace(made, parts=model.blocks(rows, **settings, added=added - late, beside=tried))


def late_columns(rows: xr.Dataset) -> dict[str, np.ndarray]:
    """{slug: (n, 1) m s-1}: change of the range by a second of delay, over all of it, for tags off by more than LATE_S.

    Nothing else can be separated in records of different times. Lines of sight by late star cameras are those of a
    satellite turned by degrees, so that their antenna correction is all error.
    """
    ranging_s, cameras_s = rows["late"].values[0], rows["late"].values[1:3]
    camera_s = np.mean(cameras_s[np.abs(cameras_s) > LATE_S]) if np.max(np.abs(cameras_s)) > LATE_S else 0.0
    time, distance, columns = rows["time"].values, rows["range"].values, {}
    if abs(ranging_s) > LATE_S:
        range_at = CubicHermiteSpline(time, distance, rows["range_rate"].values)
        moved = np.clip(time + ranging_s, time[0], time[-1])
        columns["ranging.delay"] = (distance - range_at(moved))[:, None] / ranging_s
    if camera_s:
        columns["timing.star_camera_delay"] = rows["correction"].values[:, None] / camera_s
    return columns


@dataclass(frozen=True)
class Routine(Observations):
    """Observations of a day of routine pointing."""

    rows: xr.Dataset  #: "ranging.align"
    parts: list[model.Block]  #: revolutions with their noise
    nominal: np.ndarray  #: (2, 3) m, phase centres of the catalogue
    added: np.ndarray | float  #: (n,) m, antenna correction
    determined_limit_mm: float  #: mm, largest sigma of a component that is determined
    shifted: bool = field()  #: True if tags are minutes off

    name = "ranging"
    channels = ("range",)
    parameters = ()
    unit, scale, start = "mm", np.zeros(0), np.zeros(0)

    @functools.cached_property
    def context(self) -> Context:
        """Context of the effects at every reading: pointing, range, place on the orbit, warmth."""
        extra = {name: self.rows[name].values for name in ("range", "range_rate", "argument", "warmth")} | {
            "line_of_sight_b": -self.rows["column"].values.reshape(-1, 2, 3),
            "antenna_x": self.nominal[:, 0],
            "antenna_correction": self.rows["correction"].values,
            "correction_band": self.rows["correction_band"].values[:, 1:],
            "angle": model.angles(self.rows),
        }
        return Context(time=self.rows["time"].values, extra=extra)

    @functools.cached_property
    def blocks(self) -> list[records.Block]:
        """One block a revolution, whitened, with bias and slow orbit error as local columns."""
        observed, made, step = self.rows["observed"].values + self.added, [], model.step_of(self.rows)
        for part in self.parts:
            first = self.context.time[part.rows[0]]
            rows = part.white((observed[part.rows] - observed[part.rows].mean())[:, None])
            about = rows[:, 0], "range", 0, first + step * np.arange(len(rows))
            made.append(records.Block.of(f"from {first:.0f} s", *about, local=part.white(part.slow)))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates of the effects in every block, bias and slow orbit error projected out, whitened."""
        rows = lambda v: [p.white(least_squares.project_out(p.slow, v[p.rows])) for p in self.parts]  # noqa: E731
        return [listed(entry, rows(columns), kept=slice(columns.shape[1])) for entry, columns in self.laws]

    @functools.cached_property
    def laws(self) -> list[tuple[Effect, np.ndarray]]:
        """Effects with their columns (n, q) at every reading, of a ripple its four sizes; late tags alone if any."""
        late = late_columns(self.rows)
        made = [(one, late[one.slug] if late else one.columns(self.context)) for one in map(effect, late or EFFECTS)]
        return [(one, columns[:, : None if one.linear else 4]) for one, columns in made]

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # noqa: ARG002
        """Time (m,) s, range less orbit (m, 1) m by the phase centres of the catalogue, and rows (q, m, 1) m."""
        part, block = self.parts[number], self.blocks[number]
        predicted = np.zeros(block.time.size)
        predicted[part.place] = self.rows["column"].values[part.rows] @ self.nominal.ravel()
        return block.time, predicted[:, None], part.coloured(rows).T[:, :, None]

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:  # noqa: ARG002
        """Delays as the records show them, phase centres null where this day does not determine a component."""
        if entry.cause in late_columns(self.rows):
            far = np.abs(self.rows["late"].values) > LATE_S
            own = slice(0, 1) if entry.cause == "ranging.delay" else slice(1, 3)
            one, rest = (self.rows["late"].values[own][kept[own]] for kept in (far, ~far))
            error = max(np.ptp(one) / 2, *np.abs(rest), WHOLE_S)  # pointing off the line of sight
            return replace(entry, parameters={"delay": Parameter(float(np.mean(one)), float(error), "s")})
        if entry.cause != "ranging.phase_centre":
            return entry
        parameters, limit = dict(entry.parameters), 1e-3 * self.determined_limit_mm
        lost = [one for one, p in parameters.items() if p.sigma is not None and p.sigma > limit]
        return replace(entry, parameters=parameters | {n: replace(parameters[n], value=None, sigma=None) for n in lost})

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Rows without the effects of a model; noise of the star cameras is in the correction only."""
        rows, late = self.rows.copy(deep=True), late_columns(self.rows)
        for entry in (one for one in model if one.cause in EFFECTS):
            known = effect(entry.cause)
            if entry.cause in late:
                rows["observed"].values[:] -= late[entry.cause][:, 0] * known.values(entry.values)[0]
                continue
            name = "correction" if entry.cause == "attitude.star_camera_noise" else "observed"
            rows[name].values[:] -= known.contribution(self.context, known.values(entry.values))
        return rows.assign_attrs(model=" ".join(entry.cause for entry in model))


REPORT = reported(__file__, "discovery.toml")
