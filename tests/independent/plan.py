"""When and where the manoeuvres are: areas, centre times, edges."""

from dataclasses import dataclass, field

import numpy as np

from . import earth
from .orbit import turn

ROD = {("pitch", "high"): 0, ("roll", "high"): 1, ("pitch", "low"): 2, ("yaw", "low"): 1}
LATITUDE = {"high": (66.0, 74.0), "low": (14.0, 16.0)}  # of the centre, deg
LONGITUDE = {("pitch", "low"): (-55.0, -35.0), ("yaw", "low"): (120.0, 140.0)}
SEVEN = [("pitch", "low"), *[("pitch", "high")] * 2, *[("roll", "high")] * 2, *[("yaw", "low")] * 2]


@dataclass
class Manoeuvre:
    """A square wave on one rod."""

    kind: str
    area: str
    rod: int
    amplitude_ma: float = 110.0
    period_s: float = 12.0
    duration_s: float = 180.0
    polarity: int = 1
    start: float = 0.0
    centre_latitude_deg: float = 0.0
    edges: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def stop(self):
        """Second of the day at which the wave ends."""
        return self.start + self.duration_s

    def place(self, start):
        """Put the wave at a start; all current changes, first and last included, become `edges`."""
        half = self.period_s / 2
        inner = np.arange(start + half, start + self.duration_s - 1e-9, half)
        self.start, self.edges = start, np.concatenate([[start], inner, [start + self.duration_s]])

    def current(self, seconds):
        """Current (n,) in mA just after each time."""
        count = np.searchsorted(self.edges, seconds, side="right")
        on = (count > 0) & (count < len(self.edges))
        return np.where(on, self.polarity * self.amplitude_ma * (-1.0) ** (count - 1), 0.0)


def build(rng, specs):
    """Manoeuvre objects from (kind, area) pairs; None gives the seven."""
    made = []
    for kind, area in SEVEN if specs is None else specs:
        drawn = {"polarity": int(rng.choice([-1, 1])), "centre_latitude_deg": rng.uniform(*LATITUDE[area])}
        made.append(Manoeuvre(kind, area, ROD[kind, area], **drawn))
    return made


def _track(orbit, date):
    """Times, latitude and longitude (deg, node at zero) of the day, every 10 s."""
    t = np.arange(2000.0, 84400.0, 10.0)
    x, y, z = orbit.solution(t)[:3]
    matrix = earth.gcrs_to_earth(date, [0.0])[0] @ earth.intermediate_to_gcrs(earth.day_start(date))
    greenwich = np.arctan2(matrix[0, 1], matrix[0, 0])  # rotation at midnight in the intermediate frame, to arc-minutes
    longitude = np.unwrap(np.arctan2(y, x)) - earth.ROTATION * t - greenwich
    return t, np.degrees(np.arctan2(z, np.hypot(x, y))), np.degrees(longitude)


def _crossings(track, latitude_deg):
    """Times and longitudes at which a track crosses a latitude."""
    t, latitude, longitude = track
    off = latitude - latitude_deg
    k = np.flatnonzero(off[:-1] * off[1:] <= 0)
    part = off[k] / (off[k] - off[k + 1])
    return t[k] + 10 * part, longitude[k] + part * (longitude[k + 1] - longitude[k])


def _draw(rng, manoeuvres, crossings, node_deg, gap_s):
    """Centre times for one node, or None where an area cannot be met."""
    taken = []
    for index in rng.permutation(len(manoeuvres)):
        m = manoeuvres[index]
        times, longitudes = crossings[index]
        longitudes = (longitudes + node_deg + 180) % 360 - 180
        low, high = LONGITUDE.get((m.kind, m.area), (-180.0, 180.0))
        fits = (longitudes >= low) & (longitudes <= high)
        for other, _ in taken:
            fits &= abs(times - other) > gap_s
        if not fits.any():
            return None
        taken.append((times[rng.choice(np.flatnonzero(fits))], index))
    return taken


def schedule(rng, orbit, date, manoeuvres, gap_s, start_fraction):
    """Turn the orbit until every manoeuvre has its area, place them in time order, return the orbit."""
    track = _track(orbit, date)
    crossings = [_crossings(track, m.centre_latitude_deg) for m in manoeuvres]
    for _ in range(2000):
        node = rng.uniform(0, 360)
        taken = _draw(rng, manoeuvres, crossings, node, gap_s)
        if taken is not None:
            break
    else:
        raise ValueError("no orbit meets the areas of these manoeuvres; ask for fewer or shorter windows")
    for centre, index in taken:
        m = manoeuvres[index]
        fraction = rng.uniform(0, 1) if start_fraction is None else start_fraction
        m.place(float(np.floor(centre - m.duration_s / 2)) + fraction)
    manoeuvres.sort(key=lambda m: m.start)
    return turn(orbit, np.radians(node))
