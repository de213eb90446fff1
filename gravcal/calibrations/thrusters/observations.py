"""Attitude against firings as discovery sees it: a smooth torque in every block, firings among the causes."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.calibrations.align import POINTING_S, WHOLE_S
from gravcal.calibrations.causes import LateTags, listed, of_late_orbit, unknown
from gravcal.calibrations.thrusters import estimate, model
from gravcal.calibrations.thrusters.model import DELAY_STEP_S, Firings, Segment
from gravcal.effects import Context, effect
from gravcal.estimation.records import Block, Candidate, Entry, Observations, Parameter, reported
from gravcal.estimation.resampling import lines_between
from gravcal.physics import frames, orbit_environment

#: In the model where firings at wrong times are tried, if they are there.
PRESENT = ("torque.thruster_firings", "timing.thruster_delay", "unknown:star_camera_in_use")

DELAYS = {"timing.thruster_delay": 1, "timing.star_camera_delay": -1}  # late firings look like an early camera
unweighed = functools.partial(listed, prior=False)  # Candidate of a listed effect without prior sizes
LATE_S = 10  # within seconds control answers a firing
HEADS = 0b111  # bits of sca_id that are heads; another is the gyroscopes
SEEN = 3.0  # sigma of a bias between heads that may move the attitude


def observe(
    products: Mapping[str, xr.Dataset], *, inertia, block_s: float, knot_s: float, camera_limit_s: float
) -> "Attitude | LateTags":
    """Observations of one day: "align" and "noise" of thrusters, "heads" where there is SCA1A.

    LateTags of the orbit alone where attitude and firings agree and the orbit is off by more than camera_limit_s.
    """
    day, noise = model.records(products["align"]), model.noise_of(products["noise"])
    late = model.late(day, inertia)
    time, angle, rate = model.off_the_orbit(products["align"])
    orbit_lag = float(np.median(angle / rate))
    if abs(orbit_lag) > camera_limit_s and abs(late) <= LATE_S:
        delay = Parameter(-orbit_lag, POINTING_S, "s")
        return of_late_orbit(products["align"], time, angle, -rate, delay, "pitch", Attitude.name)
    rows = estimate.rows_of(day.camera, noise, inertia, block_s=block_s, knot_s=knot_s)
    late = late if abs(late) > LATE_S else 0
    delays = {slug: Parameter(float(sign * late), WHOLE_S, "s") for slug, sign in DELAYS.items() if late}
    return Attitude(products["align"], day, rows, late, day.firings.late_by(late), delays, products.get("heads"))


@dataclass(frozen=True)
class Attitude(Observations):
    """Observations of a day: whitened attitude in blocks, firings among the causes."""

    aligned: xr.Dataset  #: "thrusters.align"
    records: model.Records  #: of the day
    rows: list[estimate.Rows]  #: of every block
    late: int  #: s, tags of the firings late against the attitude, 0 where by no more than LATE_S
    firings: Firings  #: when the attitude shows them
    delays: Mapping[str, Parameter] = field()  #: as the attitude shows them
    heads: xr.Dataset | None  #: "thrusters.heads"

    name = "thrusters"
    #: Whitened components; with a single camera the second and third are mixtures of pitch and yaw.
    channels = ("roll", "pitch", "yaw")
    parameters = ()
    unit, scale, start = "1", np.zeros(0), np.zeros(0)
    readable, floored = ("none",), True

    @functools.cached_property
    def signals(self) -> list[Candidate]:
        """Candidates with columns (n, 3, q) rad of the attitude in every block, not whitened."""
        segments, firings = [row.segment for row in self.rows], self.firings
        if self.late:  # firings are not where tagged: only delays are causes, columns the whole effect over `late`
            gain = estimate.gains_alone(self.rows, firings)
            whole = [segment.gains(firings) @ gain[:, None] / self.late for segment in segments]
            return [unweighed(effect(slug), [sign * one for one in whole]) for slug, sign in DELAYS.items()]
        heads = model.heads_of(segments)[:-1]
        steps = [segment.heads(heads) for segment in segments]
        value, delay, *_ = estimate.joint_fit(self.rows, firings, heads)
        span = (delay, 0.0) if DELAY_STEP_S < abs(delay) < LATE_S else (DELAY_STEP_S, -DELAY_STEP_S)
        by_delay = [segment.delay(Firings(firings.time, firings.impulse_b * value[:3]), span) for segment in segments]
        constant, mounting = effect("torque.constant"), effect("attitude.star_camera_misalignment")
        contexts = [Context(time=segment.camera.time) for segment in segments]
        by_torque = [s.after_torque(constant.columns(one)) for s, one in zip(segments, contexts, strict=True)]
        causes = [
            unweighed(effect("torque.thruster_firings"), [segment.gains(firings) for segment in segments]),
            unweighed(effect("timing.thruster_delay"), by_delay),
            unweighed(effect("timing.star_camera_delay"), [-one for one in by_delay]),  # the smooth rate is free
            unweighed(constant, by_torque),
            unweighed(mounting, [mounting.columns(one) for one in contexts]),
        ]
        quality = [segment.camera.quality[:, None, None] * np.eye(3) for segment in segments]
        causes.append(unknown("star_camera_quality", "attitude follows qual_rss", quality, "1"))
        if heads:
            names = [f"{axis}_of_{head}" for head in heads for axis in "xyz"]
            causes.append(unknown("star_camera_in_use", "attitude steps", steps, "rad", names))
            causes += self._by_the_heads(segments)
        if self.records.twin is not None:
            other = [segment.gains(self.records.twin) for segment in segments]
            causes.append(unknown("twin_firings", "impulse", other, "N m s"))
        return [*causes, *self._along_the_orbit(segments)]

    def _by_the_heads(self, segments: list[Segment]):
        """List of the candidate of attitude steps by the biases between heads; empty where SCA1A shows none."""
        if self.heads is None:
            return []
        turns = dict(zip(self.heads["code"].values.tolist(), self.heads["turn_b"].values, strict=True))
        used = {int(head) & HEADS for head in model.heads_of(segments)}
        bias = [str(name).startswith("bias") for name in self.heads["parameter"].values]
        significant = np.abs(self.heads["value"].values[bias]) > SEEN * self.heads["sigma"].values[bias]
        if len(used) < 2 or not used <= turns.keys() or not significant.any():
            return []
        cause, columns = effect("attitude.star_camera_heads"), []
        for segment in segments:
            heads_b = np.array([turns[head] for head in segment.camera.head & HEADS])
            columns.append(cause.columns(Context(time=segment.camera.time, extra={"heads_b": heads_b})))
        return [unweighed(cause, columns)]

    def _along_the_orbit(self, segments: list[Segment]):
        """Candidates of a torque in sunlight alone, its smooth part projected out, and of a dipole of the satellite."""
        orbit, position, field = (self.aligned[name].values for name in ("time_orbit", "position_i", "field_i"))
        dipole = effect("torque.residual_dipole")
        light = orbit_environment.sunlit(position, orbit_environment.sun_i(orbit[:1])).astype(float)
        by_sunlight, by_dipole = [], []
        for segment in segments:
            time = segment.camera.time
            lit = np.interp(time, orbit, light)
            by_sunlight.append(segment.sharp(segment.after_torque(lit[:, None, None] * np.eye(3))))
            R_bi = frames.R_bi_from_quaternion(segment.camera.quaternion)
            field_b = np.matvec(R_bi, lines_between(time, orbit, field))
            unit_dipoles = dipole.columns(Context(time=time, dipole_b=np.zeros((time.size, 3))))
            torque = np.cross(np.moveaxis(unit_dipoles, 2, 1), field_b[:, None, :])
            by_dipole.append(segment.after_torque(np.moveaxis(torque, 1, 2)))
        return [unknown("sunlight", "torque in sunlight", by_sunlight, "N m"), unweighed(dipole, by_dipole)]

    @functools.cached_property
    def whitened(self) -> list[Candidate]:
        """Candidates of `signals` with whitened columns (3 m, q) in every block."""
        each = ((one, zip(self.rows, one.columns, strict=True)) for one in self.signals)
        return [replace(one, columns=[row.whiten(c) for row, c in pairs]) for one, pairs in each]

    @functools.cached_property
    def inflation(self) -> float:
        """Variance inflation factor of the day over its quiet stretches, by firings at wrong times."""
        present = [one.columns for one in self.whitened if one.cause in PRESENT]
        present = [np.concatenate(columns, axis=1) for columns in zip(*present, strict=True)]
        return estimate.inflation(self.rows, present, estimate.wrong_times(self.rows, self.firings))[0]

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a stretch of time without common parameters, whitened, over the square root of the inflation."""
        made, size = [], np.sqrt(self.inflation)
        for row in self.rows:
            count, begin = row.observed.size // 3, row.segment.camera.time[0]
            time = np.tile(begin + row.segment.camera.step_s * np.arange(count), 3)
            about = row.observed / size, np.repeat(self.channels, count), 0, time
            made.append(Block.of(f"from {begin:.0f} s", *about, local=row.smooth / size))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates of `whitened` over the square root of the inflation."""
        size = np.sqrt(self.inflation)
        return [replace(one, columns=[c / size for c in one.columns]) for one in self.whitened]

    def without(self, model: Sequence[Entry]) -> xr.Dataset:
        """Aligned records with the attitude turned back by what the effects of a model add."""
        angle_b = np.zeros((self.aligned.sizes["time"], 3))
        for entry in model:
            for one in (s for s in self.signals if (s.cause, s.form) == (entry.cause, entry.form)):
                for row, angle in zip(self.rows, one.added(entry), strict=True):
                    angle_b[np.searchsorted(self.records.camera.time, row.segment.camera.time)] += angle
        turned = frames.quaternion_product(self.records.camera.quaternion, frames.from_rotation_vector(-angle_b))
        return self.aligned.assign(quaternion=self.aligned["quaternion"].copy(data=turned))


REPORT = reported(__file__, "discovery.toml")
