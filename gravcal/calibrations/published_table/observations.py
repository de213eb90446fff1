"""Observations of the printed table for discovery: one offset for seven manoeuvres, and what may disturb it.

The error of each number is the printed one times what repeated manoeuvres of one kind ask for. Areas, rods and the
field in the middle of each area are modelled; the direction of flight is not printed, so every heading is tried.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import detrend

from gravcal.calibrations.causes import listed, unknown
from gravcal.effects import Context, catalogue
from gravcal.estimation.records import Block, Candidate, Observations, Weighed, reported
from gravcal.physics import earth, magnetic
from gravcal.physics.frames import cross_matrix

EPOCH = 633830400.0  # s GPS, 2020-02-01 12:00
HEIGHT_M = 490e3
SPEED = 2 * np.pi / 5660.0  # rad s-1, along the orbit
WEIGHTS = np.array([1.0, 0.09, 1.0])  # of the axes x, y, z; CoM paper eq. 7
PERIOD_S, LENGTH_S, STEP_S = 12.0, 180.0, 0.5  # s, of the square wave of a rod, of a manoeuvre, between samples
#: Rod and middle of the area (latitude, longitude in deg) by kind and latitude class; Tables 2 and 3, erratum C-8.
AREAS = {
    ("pitch", "low"): (2, 15.0, -45.0),
    ("pitch", "high"): (0, 70.0, 0.0),
    ("roll", "high"): (1, 70.0, 0.0),
    ("yaw", "low"): (1, 15.0, 130.0),
}
HEADINGS = {(1, 1): "+x north", (-1, -1): "+x south", (1, -1): "+x north, yaw south", (-1, 1): "+x south, yaw north"}


def observe(_products: Mapping, *, rows: Sequence[Mapping], inertia, dipole: float, igrf_generation: int) -> "Table":
    """Observations of one variant of the table, which is all in the settings.

    Rows are {"order", "kind", "latitude_class", "value" (3,), "sigma" (3,)} um, None where nothing is printed; the
    dipole of a rod is A m2 at full scale.
    """
    arrays = [dict(row) | {n: 1e-6 * np.array(row[n], dtype=float) for n in ("value", "sigma")} for row in rows]
    return Table(arrays, (tuple(np.diag(inertia)), dipole, igrf_generation))


@dataclass(frozen=True)
class Arc:
    """One manoeuvre in the model, n samples."""

    dipole_b: np.ndarray  #: (n, 3) A m2
    alpha_b: np.ndarray  #: (n, 3) rad s-2, angular acceleration by it
    solution: np.ndarray  #: (3, 3 n) offset from the weighted rows of the reading, CoM paper eq. 6

    def answer(self, reading_b: np.ndarray) -> np.ndarray:
        """Change (3, q) m of the estimated offset by errors (n, 3, q) m s-2 of the reading."""
        return self.solution @ detrended(reading_b)


def detrended(reading_b: np.ndarray) -> np.ndarray:
    """Weighted rows (3 n, q) of a reading (n, 3, q) with mean and trend of each axis removed."""
    return (np.sqrt(WEIGHTS)[:, None] * detrend(reading_b, axis=0)).reshape(-1, reading_b.shape[2])


@functools.lru_cache(maxsize=32)
def arc(kind: str, latitude_class: str, heading: int, about: tuple, latitude: float | None = None) -> Arc:
    """Manoeuvre in the middle of its area, or at another latitude (deg); heading +1 where x points north, -1 south.

    `about` are principal moments (3,) kg m2, dipole of a rod A m2, generation of the IGRF.
    """
    moments, dipole, generation = about
    rod, middle, longitude_deg = AREAS[kind, latitude_class]
    latitude = middle if latitude is None else latitude
    time = np.arange(-LENGTH_S / 2, LENGTH_S / 2, STEP_S)
    longitude, height = np.full(time.size, np.radians(longitude_deg)), np.full(time.size, HEIGHT_M)
    position = earth.position_from_geodetic(np.radians(latitude) + SPEED * time, longitude, height)
    field_e = magnetic.field_e(EPOCH + time, position, generation)
    north_east_down = np.matvec(earth.R_en_from_position(position).swapaxes(1, 2), field_e)
    field_b = north_east_down * np.array([heading, heading, 1.0])
    wave = np.where((time // (PERIOD_S / 2)) % 2 == 0, 1.0, -1.0)
    dipole_b = dipole * wave[:, None] * np.eye(3)[rod]
    alpha = np.cross(dipole_b, field_b) / np.array(moments)
    # the reading per offset is -[alpha x]: CoM paper eq. 5, first term; the other is < 1 %
    return Arc(dipole_b, alpha, np.linalg.pinv(detrended(-cross_matrix(alpha))))


@dataclass(frozen=True)
class Table(Observations):
    """Observations of one variant of the table."""

    #: {"order", "kind", "latitude_class", "value" (3,), "sigma" (3,)} m, NaN where nothing is printed
    rows: list[Mapping]
    about: tuple  #: principal moments (3,) kg m2, dipole of a rod A m2, generation of the IGRF

    name = "published_table"
    channels = ("table",)
    parameters = ("x", "y", "z")
    unit, scale, start = "um", np.full(3, 1e6), np.zeros(3)
    whole_manoeuvres = True

    @functools.cached_property
    def printed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Offsets (n, 3) m, sigma (n, 3) m scaled by `repeatability`, 1 where not printed, and which are printed."""
        value, sigma = (np.array([row[name] for row in self.rows]) for name in ("value", "sigma"))
        known = np.isfinite(value)
        return value, np.where(known, sigma * repeatability(self.rows)[0], 1.0), known

    @functools.cached_property
    def mean(self) -> np.ndarray:
        """(3,) m, weighted mean of all manoeuvres."""
        value, sigma, known = self.printed
        return np.nansum(value / sigma**2, axis=0) / np.sum(known / sigma**2, axis=0)

    @functools.cached_property
    def blocks(self) -> list[Block]:
        """One block a manoeuvre: its numbers, and a share of the priors of all listed effects.

        With them an explanation that asks for a scale error of one half gains little. Their channel has no axis: they
        are no record.
        """
        made = []
        for row, value, sigma, known in zip(self.rows, *self.printed, strict=True):
            zeros = np.zeros(len(self._priors))
            observed = np.concatenate([(value / sigma)[known], zeros])
            columns = np.concatenate([(np.eye(3) / sigma[:, None])[known], np.zeros((zeros.size, 3))])
            channel = np.repeat(["table", "prior"], [known.sum(), zeros.size])
            axis = np.concatenate([np.flatnonzero(known), zeros + 3]).astype(int)
            time = np.concatenate([np.full(known.sum(), float(row["order"])), zeros])
            label = f"{row['order']} {row['kind']} {row['latitude_class']}"
            made.append(Block.of(label, observed, channel, axis, time, shared=columns))
        return made

    @functools.cached_property
    def candidates(self) -> list[Candidate]:
        """Candidates of `causes` with whitened columns in the block of each manoeuvre, and their rows of the priors."""
        made, (_, sigma, known) = [], self.printed
        for number, one in enumerate(self.causes):
            prior_rows = np.zeros((len(self._priors), len(one.names)))
            for k, (owner, parameter, prior) in enumerate(self._priors):
                if owner == number:
                    prior_rows[k, parameter] = 1 / (prior * np.sqrt(len(self.rows)))
            rows = zip(one.columns, sigma, known, strict=True)
            whitened = [np.concatenate([c[k] / s[k][:, None], prior_rows]) for c, s, k in rows]
            made.append(replace(one, columns=whitened, prior=[]))
        return made

    def weighed(self) -> list[Weighed]:
        """Log odds of every listed cause, in its best form, against one offset alone, the best first.

        Printed errors times a common factor f that is not known, sizes and offset drawn from their priors:
        Z = int N(y; 0, f^2 S + O O' + A P A') d ln f (O of an offset of 1 mm, A of a cause); a lucky repeat is nothing.
        """
        known = np.isfinite([row["value"] for row in self.rows]).ravel()
        y, s = (np.array([row[name] for row in self.rows]).ravel()[known] for name in ("value", "sigma"))
        offset = np.tile(np.eye(3), (len(self.rows), 1))[known]

        def log_evidence(columns, sizes):  # ln Z of columns (n, q) with prior sizes (q,)
            scaled = np.column_stack([1e-3 * offset, columns * sizes])  # a priori an offset of a millimetre
            logs = []
            for factor in np.geomspace(0.5, 60.0, 100):
                root = np.linalg.cholesky(np.diag((factor * s) ** 2) + scaled @ scaled.T)
                logs.append(-np.sum(np.linalg.solve(root, y) ** 2) / 2 - np.sum(np.log(np.diag(root))))
            return np.logaddexp.reduce(logs)

        alone, best = log_evidence(np.zeros((y.size, 0)), np.zeros(0)), {}
        for number, one in enumerate(self.causes):
            sizes = [size for owner, _, size in self._priors if owner == number]
            odds = float(log_evidence(np.concatenate(one.columns)[known], sizes) - alone) if sizes else -np.inf
            if sizes and (one.cause not in best or odds > best[one.cause].log_odds + 0.05):  # forms that are as good
                best[one.cause] = Weighed(one.cause, one.form, odds)
        return sorted(best.values(), key=lambda one: -one.log_odds)

    @functools.cached_property
    def _priors(self):
        """(index of the cause, index of the parameter in it, plausible size) of every parameter of a listed effect."""
        return [(number, k, size) for number, one in enumerate(self.causes) for k, size in enumerate(one.prior)]

    @functools.cached_property
    def causes(self) -> list[Candidate]:
        """Candidates with columns (3, q) m, change of the estimated offset of each manoeuvre, not whitened."""
        causes, mean, count = [], self.mean, len(self.rows)
        for (pitch, yaw), form in HEADINGS.items():
            heading = {"pitch": pitch, "roll": pitch, "yaw": yaw}
            arcs = {k: arc(*k, heading[k[0]], self.about) for k in AREAS}
            each = [arcs[r["kind"], r["latitude_class"]] for r in self.rows]
            whole = of_readings(form, each, mean)
            causes += [one for one in whole if len(one.names) < BETWEEN]
            for one in whole:  # each parameter by itself, so that all families are as sparse as they can be
                parts = [one.part([k], name) for k, name in enumerate(one.names)]
                causes += [replace(part, form=f"{part.form}, {form}") for part in parts]
        columns = [-mean[:, None]] * count
        causes.append(Candidate("timing.accelerometer_delay", "", ["one_minus_cosine"], ["1"], columns, [1.0]))
        order = [(r["order"] - 4.0) * np.eye(3) for r in self.rows]
        causes.append(unknown("time", "offset moves between manoeuvres", order, "m"))
        low = [float(r["latitude_class"] == "low") * np.eye(3) for r in self.rows]
        causes.append(unknown("latitude", "offset differs at low latitude", low, "m"))
        return causes


def repeatability(rows: list[dict]) -> tuple[float, int]:
    """Scatter of repeats of a kind and area over the printed errors, at least 1, and its degrees of freedom."""
    chi2, count = 0.0, 0
    for kind in {(r["kind"], r["latitude_class"]) for r in rows}:
        same = [r for r in rows if (r["kind"], r["latitude_class"]) == kind]
        value, sigma = (np.array([r[k] for r in same]) for k in ("value", "sigma"))
        used = np.isfinite(value).all(axis=0) & (len(same) > 1)
        if used.any():
            weight = sigma[:, used] ** -2
            mean = np.sum(value[:, used] * weight, axis=0) / weight.sum(axis=0)
            chi2 += float(np.sum((value[:, used] - mean) ** 2 * weight))
            count += int(used.sum()) * (len(same) - 1)
    return max(float(np.sqrt(chi2 / max(count, 1))), 1.0), count


#: Numbers by which kinds of manoeuvre differ: a cause with as many parameters fits any table and says nothing.
BETWEEN = 7
#: Reading that follows dI/dt, and its plausible size: Peterseim et al. 2012 saw 20 nm s-2 when a rod was switched,
#: some 50 A m2 within a second.
RATE, RATE_PRIOR = "unknown:current_rate", 4e-10
#: Effects that add to the linear reading.
READINGS = tuple(f"accelerometer.{name}" for name in ("current_leak", "angular_leak", "scale", "misalignment"))


def of_readings(form: str, arcs: list[Arc], mean: np.ndarray) -> list[Candidate]:
    """Candidates of errors of both readings in a form (headings), by what they add (3, q) m to offsets; mean (3,) m."""

    def made(slug, reading):  # Candidate, by the reading (n, 3, q) m s-2 of each arc
        entry = catalogue()[slug]
        return listed(entry, [arc.answer(reading(entry, arc)) for arc in arcs], form)

    def leak(entry, arc):  # reading (n, 3, q) of an effect, its drivers as in the arc
        linear, time = -cross_matrix(arc.alpha_b) @ mean, np.arange(len(arc.alpha_b), dtype=float)
        return entry.columns(Context(time=time, dipole_b=arc.dipole_b, angular_b=arc.alpha_b, linear_b=linear))

    def rate(entry, arc):  # of the current of each rod: spikes at the edges of its wave
        change = np.gradient(arc.dipole_b, STEP_S, axis=0)
        return entry.columns(Context(time=np.arange(len(change), dtype=float), dipole_b=change))

    def scale(_, arc):  # too large by a share: a gain of dipole or inertia, or of the sensor
        return np.stack([cross_matrix(arc.alpha_b * unit) @ mean for unit in np.eye(3)], axis=2)

    spikes = made("accelerometer.current_leak", rate)
    count = len(spikes.names)
    spikes = replace(spikes, cause=RATE, units=["m s-1 A-1 m-2"] * count, prior=[RATE_PRIOR] * count)
    return [*(made(slug, leak) for slug in READINGS), spikes, made("accelerometer.angular_scale", scale)]


REPORT = reported(__file__, "discovery.toml")
