"""One entry: a day of Level-1 files with manoeuvres, and the truth behind them."""

from dataclasses import dataclass, field

import numpy as np

from . import catalogue, earth, noise, plan, scene, sensors
from .attitude import Body
from .orbit import make_orbit
from .writer import Writer

STEP_MA = 220.11 / 4096
DIPOLE_PER_CURRENT = 0.25  # A m2 / mA
ORBIT = {"height_m": 490e3, "inclination_deg": 89.0, "eccentricity": 0.0015}
MARGIN_S = 120.0  # least time between two windows
OFFSETS_NS = np.array([0, 119, -119, 238, -238])  # of receiver time from on-board time


@dataclass(frozen=True)
class Settings:
    """All keyword arguments of `make_event`, with their defaults; units are in the names, vectors are SRF."""

    satellite: str = "C"
    date: str = "2020-02-01"
    offset_um: tuple = (107.0, 4.0, 13.0)  # proof mass -> centre of mass
    manoeuvres: list | None = None  # None: the seven; else (kind, area) pairs
    window_s: tuple = (300.0, 300.0)  # quiet time before and after each manoeuvre
    effects: dict = field(default_factory=dict)  # see catalogue.EFFECTS
    noise_change: float = 0.0  # spread of the logarithm of the noise from window to window, of each instrument
    start_fraction: float | None = None  # of the second in which each wave starts; None: random for each
    inertia: tuple = (110.49, 580.67, 649.69)  # kg m2
    control: str = "off"  # control currents during a manoeuvre: "off" or "on"
    control_phase_s: float = 0.0  # control currents change this long after each MAG tag
    sca_flips: int = 0  # number of sign changes of the quaternion along the day
    field_generation: int = 13  # of IGRF


class Clocks:
    """On-board, receiver and GPS time as TIM1B and CLK1B of one day state them, and tags; seconds of the day in all."""

    def __init__(self, rng, offset_s, drift):
        self.clock_time = np.arange(-300, 86701, 10)
        self.clock_offset = offset_s + drift * self.clock_time + rng.normal(0, 1e-11, len(self.clock_time))
        self.drift = drift
        self.board_time = np.arange(5, 86400, 8)
        self.board_offset_ns = rng.choice(OFFSETS_NS, len(self.board_time), p=[0.4, 0.25, 0.25, 0.05, 0.05])

    def to_gps(self, board):
        """GPS from on-board time."""
        receiver = board + 1e-9 * np.interp(board, self.board_time, self.board_offset_ns)
        return receiver + np.interp(receiver, self.clock_time, self.clock_offset)

    def to_board(self, gps):
        """On-board from GPS time (to a nanosecond)."""
        board = np.asarray(gps, float)
        for _ in range(4):
            board = board - (self.to_gps(board) - gps)
        return board

    def accelerometer_tags(self, start, stop):
        """Indices and tags (whole microseconds, on-board) of the accelerometer rows between GPS times, with margin."""
        low, high = self.to_board(np.array([start - 30.0, stop + 30.0]))
        k = np.arange(int(low / 0.099991), int(high / 0.099991) + 1)
        return k, np.rint(7739 + 99993.6 * k - 25.6 * (k // 10)).astype(np.int64)

    def torquer_tags(self, start, stop):
        """Tags (whole microseconds, on-board) at .1 and .6 of each second between GPS times, with margin."""
        low, high = self.to_board(np.array([start - 30.0, stop + 30.0]))
        return np.arange(int(low) * 2, int(high) * 2) * 500_000 + 100_000


class World:
    """Everything that all windows of the day share."""

    step_ma, per_current = STEP_MA, DIPOLE_PER_CURRENT

    def __init__(self, seed, settings):
        s = self.settings = settings
        self.seed = int(seed)
        self.effects = catalogue.parse(s.effects)
        self.day = earth.day_start(s.date)
        self.clocks = Clocks(self.rng("clocks"), 0.1, -1.5e-8)
        ahead = 1.0 if s.satellite == "C" else -1.0  # C leads and flies with -x along the velocity
        rng = self.rng("smooth")
        self.torque = noise.Smooth(rng, rng.normal(0, 1e-6, 3), 5e-7, 3e-8)
        self.force = noise.Smooth(rng, np.array([ahead * 8e-8, rng.normal(0, 2e-8), -4e-8]), 1e-8, 2e-10)
        rng = self.rng("magnetometer")
        self.mag_bias_nt = rng.choice([-1, 1], 3) * rng.uniform(500, 1000, 3)
        dipole = DIPOLE_PER_CURRENT * np.eye(3) * (1 + self.effects["dipole_gain"]["value"])
        self.body = Body(np.diag(np.asarray(s.inertia, float)), dipole, float(self.effects["torque_lag_s"]["value"]))
        orbit = make_orbit(self.rng("orbit"), self.day + 43200, spacing_s=-28.9 * ahead, **ORBIT)
        self.manoeuvres = plan.build(self.rng("manoeuvres"), s.manoeuvres)
        gap = max((m.duration_s for m in self.manoeuvres), default=180.0) + sum(s.window_s) + MARGIN_S
        self.orbit = plan.schedule(self.rng("plan"), orbit, s.date, self.manoeuvres, gap, s.start_fraction)

    def rng(self, name):
        """Generator of a purpose."""
        return scene.stream(self.seed, name)


def _inside(times, window, *others):
    keep = (times >= window[0]) & (times < window[1])
    return times[keep], *(other[keep] for other in others)


def _samples(world, window):
    """Times of content and tags of each instrument within a window."""
    clocks, late = world.clocks, {name: world.effects[name]["value"] for name in catalogue.TIMING}
    index, tags = clocks.accelerometer_tags(*window)
    acc = _inside(clocks.to_gps(tags * 1e-6) - late["acc_delay_s"], window, index, tags)
    seconds = np.arange(int(window[0]) - 30, int(window[1]) + 31)
    sca = _inside(seconds - late["sca_delay_s"], window, seconds)
    board = clocks.torquer_tags(*window)
    tick = clocks.to_gps(board * 1e-6)
    mag = _inside(tick, window, board // 500_000 % 2, np.rint(tick * 1e6).astype(np.int64))
    return acc, sca, mag, tick + world.settings.control_phase_s


def _write_window(world, window, writer):
    acc, sca, mag, ticks = _samples(world, window)
    now = scene.simulate(world, window, (acc[0], sca[0], mag[0]), ticks)
    writer.accelerometer(acc[1], acc[2], *sensors.spoil(now, *sensors.accelerometer(now, now.at(acc[0]))))
    flips = np.sort(world.rng("flips").uniform(0, 86400, world.settings.sca_flips))
    sign = (-1.0) ** np.searchsorted(flips, sca[1])
    writer.star_camera(sca[1], sensors.star_camera(now, now.at(sca[0])) * sign[:, None])
    writer.magnetometer(mag[2], *sensors.magnetometer(now, now.at(mag[0]), mag[1]))
    (seconds,) = _inside(np.arange(int(window[0]), int(window[1]) + 1), window)
    r, v = world.orbit.position(seconds), world.orbit.velocity(seconds)
    turn = earth.gcrs_to_earth(world.settings.date, seconds)
    r_e, v_e = np.einsum("nij,nj->ni", turn, r), np.einsum("nij,nj->ni", turn, v)
    v_e = v_e - np.cross([0, 0, earth.ROTATION], r_e)
    writer.orbit("GNI1B", seconds, r, v)
    writer.orbit("GNV1B", seconds, r_e, v_e)


def make_event(folder, seed, **settings):
    """Write the Level-1 files of one day into a folder, made if absent; return the truth, which is not in it.

    Settings are fields of `Settings`; the same seed and settings give the same bytes. Times are GPS seconds.
    """
    chosen = Settings(**settings)
    world = World(seed, chosen)
    writer = Writer(folder, chosen.satellite, chosen.date, world.day)
    before, after = chosen.window_s
    for m in world.manoeuvres:
        _write_window(world, (m.start - before, m.stop + after), writer)
    writer.clocks(world.clocks)
    kinds = [(m.kind, m.start + world.day, m.stop + world.day) for m in world.manoeuvres]
    return {
        "seed": world.seed,
        "offset_um": list(chosen.offset_um),
        "manoeuvres": [dict(zip(("kind", "start", "stop"), one, strict=True)) for one in kinds],
        "effects": {name: world.effects[name] for name in chosen.effects},
        "files": {product: str(path) for product, path in writer.finish().items()},
    }
