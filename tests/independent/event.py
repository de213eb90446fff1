"""One entry: a day of Level-1 files with manoeuvres, and the truth behind them."""

import json
from pathlib import Path

import numpy as np

from . import catalogue, earth, noise, plan, scene, sensors
from .attitude import Body
from .clocks import Clocks
from .orbit import make_orbit
from .settings import Settings
from .writer import Writer

STEP_MA = 220.11 / 4096


class World:
    """Everything that all windows of the day share."""

    step_ma = STEP_MA

    def __init__(self, seed, settings):
        s = self.settings = settings
        self.seed = int(seed)
        self.effects = catalogue.parse(s.effects)
        self.day = earth.day_start(s.date)
        self.clocks = Clocks(self.rng("clocks"), s.clock_offset_s, s.clock_drift)
        leads = s.satellite == "C" if s.leads is None else s.leads
        self.torque, self.force = self._smooth(1.0 if leads else -1.0)
        self.mag_bias_nt = np.asarray(self._mag_bias() if s.mag_bias_nt is None else s.mag_bias_nt, float)
        self.body = self._body()
        shape = {"height_m": s.height_m, "inclination_deg": s.inclination_deg, "eccentricity": s.eccentricity}
        orbit = make_orbit(self.rng("orbit"), self.day + 43200, spacing_s=-28.9 if leads else 28.9, **shape)
        self.manoeuvres = plan.build(self.rng("manoeuvres"), s.manoeuvres)
        for m in self.manoeuvres:
            m.amplitude_ma = s.amplitude_ma if m.amplitude_ma == 110.0 else m.amplitude_ma
        longest = max((m.duration_s for m in self.manoeuvres), default=180.0)
        gap = longest + sum(s.window_s) + s.session_margin_s
        self.orbit = plan.schedule(self.rng("plan"), orbit, s.date, self.manoeuvres, gap, s.start_fraction)

    def rng(self, name):
        """Generator of a purpose."""
        return scene.stream(self.seed, name)

    def _smooth(self, forward):
        s, rng = self.settings, self.rng("smooth")
        torque = noise.Smooth(
            rng, s.torque_scale * rng.normal(0, 1e-6, 3), 5e-7 * s.torque_scale, 3e-8 * s.torque_scale
        )
        push = s.force_scale * np.array([forward * 8e-8, rng.normal(0, 2e-8), -4e-8])
        return torque, noise.Smooth(rng, push, 1e-8 * s.force_scale, 2e-10 * s.force_scale)

    def _mag_bias(self):
        rng = self.rng("magnetometer")
        return rng.choice([-1, 1], 3) * rng.uniform(500, 1000, 3)

    def _body(self):
        s, e = self.settings, self.effects
        xy, xz, yz = e["inertia_products"]["value"]
        inertia = np.diag(np.asarray(s.inertia, float)) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
        dipole = s.dipole_per_current * np.eye(3) * (1 + e["dipole_gain"]["value"])
        return Body(inertia, dipole, e["residual_dipole"]["value"], e["torque_lag_s"]["value"])


def _inside(times, window, *others):
    keep = (times >= window[0]) & (times < window[1])
    return times[keep], *(other[keep] for other in others)


def _samples(world, window):
    """Times of content and tags of each instrument within a window."""
    e, clocks = world.effects, world.clocks
    value = {name: e[name]["value"] for name in catalogue.TIMING}
    index, tags = clocks.accelerometer_tags(*window)
    read = clocks.to_gps(tags * 1e-6)
    acc = _inside(read - value["acc_delay_s"], window, index, tags)
    seconds = np.arange(int(window[0]) - 30, int(window[1]) + 31)
    sca = _inside(seconds - value["sca_delay_s"], window, seconds)
    board = clocks.torquer_tags(*window)
    tick = clocks.to_gps(board * 1e-6)
    mag = _inside(tick - value["mag_delay_s"], window, board // 500_000 % 2, np.rint(tick * 1e6).astype(np.int64))
    return acc, sca, mag, tick + world.settings.control_phase_s


def _write_window(world, window, state, writer):
    acc, sca, mag, ticks = _samples(world, window)
    now, state = scene.simulate(world, window, (acc[0], sca[0], mag[0]), ticks, state)
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
    return now, state


def _plain(value):
    """The same value as JSON can hold it."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _truth(world, windows, paths):
    s, day = world.settings, world.day
    names = ["kind", "area", "rod", "polarity", "amplitude_ma", "period_s", "duration_s"]
    names += ["centre_latitude_deg", "longitude_deg"]
    waves = [
        {name: getattr(m, name) for name in names}
        | {"start": m.start + day, "stop": m.stop + day, "edges": m.edges + day}
        for m in world.manoeuvres
    ]
    truth = {
        "seed": world.seed,
        "satellite": s.satellite,
        "date": s.date,
        "offset_um": s.offset_um,
        "manoeuvres": waves,
        "windows": [[a + day, b + day] for a, b in windows],
        "effects": {name: world.effects[name] for name in s.effects},
        "inertia": world.body.inertia,
        "dipole_per_current": s.dipole_per_current,
        "mag_bias_nt": world.mag_bias_nt,
        "bias": {"linear": sensors.BIAS[s.satellite][0], "angular": sensors.BIAS[s.satellite][1]},
        "clock": {"offset_s": s.clock_offset_s, "drift": s.clock_drift},
        "noise_scale": s.noise_scale,
        "files": {product: str(path) for product, path in paths.items()},
    }
    return _plain(truth)


def make_event(folder, seed, **settings):
    """Write the Level-1 files of one day into a folder; return the truth.

    Parameters
    ----------
    folder : path of the files, made if absent
    seed : int; the same seed and settings give the same bytes
    settings : fields of `settings.Settings`

    Returns
    -------
    truth : dict of plain values; times are GPS seconds past 2000-01-01 12:00:00; never written into the folder
    """
    chosen = Settings(**settings)
    world = World(seed, chosen)
    writer = Writer(folder, chosen.satellite, chosen.date, world.day)
    windows = plan.windows(world.manoeuvres, chosen.window_s, chosen.whole_day)
    scenes, state = [], None
    for window in windows:
        now, state = _write_window(world, window, state if chosen.whole_day else None, writer)
        scenes += [now] if chosen.keep_scenes else []
    writer.clocks(world.clocks)
    truth = _truth(world, windows, writer.finish())
    if chosen.truth_file is not None:
        Path(chosen.truth_file).write_text(json.dumps(truth, indent=1))
    return truth | ({"scenes": scenes} if chosen.keep_scenes else {})
