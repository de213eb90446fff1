"""A second simulator of ranging campaigns: two satellites on one track, dual one-way ranges, its own CRN filter.

Equations 5-13 of the KBR paper in their corrected form (K-1), the light time by iteration, the filter of KBR1B from
its definition: a rectangle of 70.7 s / 7 convolved seven times with itself, times the sum of cosines up to 0.1 Hz.
Satellite C is behind, D ahead. Seconds are seconds of the day.
"""

import numpy as np
from scipy.interpolate import BSpline, CubicSpline
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

from . import earth, noise
from .added import play
from .orbit import Orbit, make_orbit
from .scene import stream
from .writer import Writer

DATE, LIGHT, SPACING_S = "2020-09-11", 299792458.0, 29.2
CARRIER_HZ = {"C": 32702976502.448, "D": 32703646552.731}
STEP = 1.0  # s, of the phase; the filter passes nothing that this could alias
WINDOW_S, CONVOLUTIONS, BAND_HZ, GAIN_ONE_HZ = 70.7, 7, 0.1, 0.37e-3
LENGTH_S, SLEW_S, PERIOD_S = 3780.0, 15.0, 250.0
#: Amplitude densities: ranging, m Hz-1/2 (first column only); star camera about x, y, z, rad Hz-1/2.
RANGING = dict.fromkeys("xyz", ([1e-3, 2e-2, 5e-2, 8e-2, 1.0], [2.5e-6, 9e-7, 1.4e-6, 8e-7, 8e-7]))
CAMERA = {"x": ([5e-3, 0.1], [2e-5, 1e-5])} | dict.fromkeys("yz", ([3e-3, 2e-2, 0.2, 0.4], [6e-6, 2e-6, 2e-6, 5e-6]))
EFFECTS = ("multipath", "phase_break", "star_camera_delay", "odd_play")


def crn(order):
    """Weights of the filter or of its first or second derivative, every `STEP` seconds."""
    t = STEP * np.arange(-int(WINDOW_S / 2 / STEP), int(WINDOW_S / 2 / STEP) + 1)
    bell = BSpline.basis_element(np.linspace(-WINDOW_S / 2, WINDOW_S / 2, CONVOLUTIONS + 1))
    turns = 2 * np.pi / WINDOW_S * np.arange(1, round(BAND_HZ * WINDOW_S) + 1)[:, None]
    comb = [1 + 2 * np.cos(turns * t).sum(0), -2 * (turns * np.sin(turns * t)).sum(0)]
    comb.append(-2 * (turns**2 * np.cos(turns * t)).sum(0))
    one = bell(t) * comb[0]
    scale = np.sum(one * np.cos(2 * np.pi * GAIN_ONE_HZ * t))
    bells = [bell(t), bell.derivative(1)(t), bell.derivative(2)(t)]
    parts = [one, bells[1] * comb[0] + bells[0] * comb[1]]
    parts.append(bells[2] * comb[0] + 2 * bells[1] * comb[1] + bells[0] * comb[2])
    return parts[order] / scale


def wiggles(rng):
    """Begin, satellite, axis (1 pitch, 2 yaw) and sign of the eight sub-manoeuvres, in random order."""
    kinds = [(letter, axis, sign) for letter in "CD" for axis in (1, 2) for sign in (1, -1)]
    begins = 2500.0 + 10400.0 * np.arange(8) + rng.uniform(0, 2000, 8)
    return [(begin, *kinds[k]) for begin, k in zip(np.floor(begins), rng.permutation(8), strict=True)]


def wave(x):
    """Angle in degrees x seconds after the begin: slew to 2, fifteen cycles of 1, slew back."""
    slewed = np.clip(np.minimum(x, LENGTH_S - x) / SLEW_S, 0, 1)
    inside = (x > SLEW_S) & (x < LENGTH_S - SLEW_S)
    return 1 - np.cos(np.pi * slewed) + np.where(inside, np.sin(2 * np.pi * (x - SLEW_S) / PERIOD_S), 0)


class Pair:
    """Both satellites: where they are, how they point."""

    def __init__(self, seed):
        self.seed, shape = seed, {"height_m": 494e3, "inclination_deg": 89.0, "eccentricity": 0.0013}
        behind = make_orbit(self.rng("orbit"), earth.day_start(DATE) + 43200, spacing_s=SPACING_S, **shape)
        ahead = Orbit(lambda t: behind.solution(t + SPACING_S), behind.to_gcrs, -SPACING_S)
        self.orbit = {"C": behind, "D": ahead}
        self.wiggles = wiggles(self.rng("wiggles"))
        mean = {letter: self.rng("mean", letter).normal(0, 4e-4, 3) for letter in "CD"}
        self.routine = {k: noise.Smooth(self.rng("routine", k), mean[k], 5e-5, 4e-5) for k in "CD"}

    def rng(self, *names):
        """Generator of a purpose."""
        return stream(self.seed, "ranging", *names)

    def angles(self, letter, t):
        """Roll, pitch and yaw (n, 3) against the line of sight, rad."""
        out = self.routine[letter](t)
        for begin, who, axis, sign in self.wiggles:
            out[:, axis] += (who == letter) * sign * np.radians(wave(t - begin))
        return out

    def attitude(self, letter, t):
        """SRF to GCRS."""
        return self.orbit[letter].reference(t) * Rotation.from_euler("ZYX", self.angles(letter, t)[:, ::-1])

    def light_time(self, t):
        """What makes an instantaneous range of a dual one-way range received at both ends at t, m."""
        place = {letter: orbit.position(t) for letter, orbit in self.orbit.items()}
        paths = {}
        for sender, receiver in ("CD", "DC"):
            here, way, speed = place[receiver], np.zeros_like(t), self.orbit[sender].velocity(t)
            fall = -earth.MU * place[sender] / np.linalg.norm(place[sender], axis=1)[:, None] ** 3
            for _ in range(4):
                back = way[:, None] / LIGHT
                there = place[sender] - speed * back + fall * back**2 / 2
                straight, ends = np.linalg.norm(here - there, axis=1), np.linalg.norm([here, there], axis=2).sum(0)
                way = straight + 2 * earth.MU / LIGHT**2 * np.log((ends + straight) / (ends - straight))
            paths[receiver] = way * CARRIER_HZ[sender]  # the carriers themselves cancel in the sum of both phases
        two_way = (paths["C"] + paths["D"]) / sum(CARRIER_HZ.values())
        return np.linalg.norm(place["D"] - place["C"], axis=1) - two_way


def hidden(pair, t, effects):
    """What hidden effects add to the range, m."""
    out = np.zeros_like(t)
    if "multipath" in effects:  # value m, satellite, axis, period rad, phase rad
        e = effects["multipath"]
        angle = pair.angles(e["satellite"], t)[:, e["axis"]]
        out += e["value"] * np.sin(2 * np.pi * angle / e["period"] + e["phase"])
    if "phase_break" in effects:  # value m, wiggle, seconds after its begin; no flag tells
        e = effects["phase_break"]
        out += e["value"] * (t > pair.wiggles[e["wiggle"]][0] + e["after"])
    if "odd_play" in effects:  # in no list: value m/rad, satellite, axis, width rad: the horn yields with a backlash
        e = effects["odd_play"]
        angle = pair.angles(e["satellite"], t)[:, e["axis"]]
        out += e["value"] * (play(angle, e["width"], angle[0]) - angle)
    return out


def make_campaign(folder, seed, effects=None, orbit_error_m=1e-3):
    """Write the Level-1 files of a ranging campaign of one day; return the truth.

    Effects are {name: settings} of `EFFECTS`; star_camera_delay: {satellite: seconds late}; orbit_error_m: of the
    written orbits, at one and two cycles per revolution.
    """
    effects, pair, day = effects or {}, Pair(seed), earth.day_start(DATE)
    if unknown := effects.keys() - set(EFFECTS):
        raise ValueError(f"not known: {unknown}")
    centre = np.array([[1444.4, -0.2, 0.4], [1444.5, 0.1, 0.2]]) + pair.rng("centre").normal(0, 0.8, (2, 3))
    centre = dict(zip("CD", centre, strict=True))
    t, seconds, epochs = np.arange(-60, 86460, STEP), np.arange(0, 86400), np.arange(0, 86400, 5)
    ends = {k: pair.orbit[k].position(t) + pair.attitude(k, t).apply(1e-3 * centre[k]) for k in "CD"}
    light = CubicSpline(knots := np.arange(-100.0, 86520.0, 30.0), pair.light_time(knots))
    phase = np.linalg.norm(ends["D"] - ends["C"], axis=1) - light(t) + hidden(pair, t, effects)
    phase += noise.coloured(pair.rng("range"), len(t), RANGING, 1 / STEP)[:, 0]
    filtered = [fftconvolve(phase - phase.mean(), crn(order), "same") for order in range(3)]
    keep = np.searchsorted(t, epochs)
    both, day = Writer(folder, "Y", DATE, day), int(day)
    both.ranging(epochs, np.stack(filtered, -1)[keep], np.stack([light(epochs, order) for order in range(3)], -1))
    both.finish()
    for letter, orbit in pair.orbit.items():
        one = Writer(folder, letter, DATE, day)
        late = effects.get("star_camera_delay", {}).get(letter, 0.0)
        error = noise.coloured(pair.rng("camera", letter), len(seconds), CAMERA, 1.0)
        seen = pair.attitude(letter, seconds - late) * Rotation.from_rotvec(error)
        one.star_camera(seconds, seen.as_quat(scalar_first=True))
        slow = noise.Smooth(pair.rng("error", letter), np.zeros(3), orbit_error_m, 0.0)
        off = orbit.reference(seconds).apply(slow(seconds))
        velocity = orbit.velocity(seconds) + np.gradient(off, axis=0)
        one.orbit("GNI1B", seconds, orbit.position(seconds) + off, velocity)
        one.finish()
    return {"phase_centre_mm": {k: v.tolist() for k, v in centre.items()}, "effects": effects, "seed": seed, "day": day}
