"""A simulated centre-of-mass calibration: seven manoeuvres, written as Level-1 columns, and their truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gravcal import catalog
from gravcal.effects import effect
from gravcal.errors import CatalogError, refuse
from gravcal.estimation.resampling import lines_between, lowpass_resampler
from gravcal.physics import constants, dynamics, earth, frames, gravity
from gravcal.simulation import added as contributed
from gravcal.simulation import flight, of_channels, sensors, within

PUBLISHED = "com_offset_session"  # design of the session that was flown, with areas and rods
#: Channels of effects that turn the body, and sub-steps over which their contributions are averaged.
EXTRA, PARTS = ("dipole_b", "torque_b"), 8
READ = {*EXTRA, "linear_b", "angular_b", "pointing_b", "field_b", "acc_delay", "sca_delay", "mag_delay"}
#: Flown before and after what is written, so that readings with late or early tags exist.
LEAD_S = 5.0
ORBITS = 10  # that are drawn to see whether a plan finds its times


@dataclass(frozen=True)
class Planned:
    """A manoeuvre before it has a time."""

    kind: str  #: "pitch", "roll" or "yaw"
    name: str  #: of its area
    area: Mapping  #: bounds of its middle, degrees
    rod: int  #: 0, 1, 2 for x, y, z
    duration: float  #: s
    share: float  #: of the full scale of the rod's current
    item: int  #: number of its table in the design


def plan(chosen, full_scale: float) -> list[Planned]:
    """List of Planned, of the settings or of their design; full_scale of the current of a rod in mA."""
    if not chosen.design:
        usual, flown = (chosen.manoeuvre_s, chosen.manoeuvre_current_share), catalog.design(PUBLISHED).manoeuvres
        flown = sorted(flown, key=lambda one: one.facts["latitude_class"], reverse=True)
        named = {f"{one.kind}_{one.facts['latitude_class']}": (one, item) for item, one in enumerate(flown)}
        return [_planned(*named[name], name, *usual) for name in chosen.manoeuvres if name]
    made = []
    for item, one in enumerate(catalog.design(chosen.design).manoeuvres):
        if one.period_s != chosen.manoeuvre_period_s or one.facts.get("rod") not in ("x", "y", "z"):
            manoeuvre = f"a {one.kind} of {one.period_s} s with rod {one.facts.get('rod')!r}"
            expected = f"one of {chosen.manoeuvre_period_s} s, as manoeuvre_period_s has it, with rod x, y or z"
            refuse(f"design {chosen.design}", manoeuvre, expected, "Correct the design.", CatalogError)
        share = one.facts.get("current_ma", full_scale) / full_scale
        name = "{}_{:.0f}_{:.0f}".format(one.kind, *one.facts["latitude_deg"])
        made += [_planned(one, item, name, one.duration_s, share)] * one.count
    return made


def _planned(manoeuvre, item, name, duration, share):
    """Planned of a manoeuvre, number `item` of a design; duration s, share of the full scale of the current."""
    area = dict(zip(("lat_min", "lat_max"), manoeuvre.facts["latitude_deg"], strict=True))
    area |= dict(zip(("lon_min", "lon_max"), manoeuvre.facts.get("longitude_deg", ()), strict=False))
    return Planned(manoeuvre.kind, name, area, "xyz".index(manoeuvre.facts["rod"]), duration, share, item)


@dataclass(frozen=True)
class Scene:
    """Everything drawn from the seed before the satellite flies."""

    orbit: object  #: (n,) s -> (n, 6) m, m s-1
    planned: tuple[Planned, ...]  #: manoeuvres in order of time
    start: np.ndarray  #: (k,) s, first edge
    stop: np.ndarray  #: (k,) s, last edge
    spans: np.ndarray  #: (s, 2) s, times that are flown and written
    offset: np.ndarray  #: (3,) m, proof mass to centre of mass
    inertia_b: np.ndarray  #: (3, 3) kg m2
    dipole_per_current: np.ndarray  #: (3,) A m2 mA-1, as true
    magnetometer_bias: np.ndarray  #: (3,) T
    mass: float  #: kg
    drag_b: np.ndarray  #: (3,) m s-2, mean drag in the body
    begin: float  #: s, from which on the orbit is known


def draw_scene(satellite: Mapping, chosen, day: float, rng) -> Scene:
    """Scene with orbit, manoeuvre times and true values drawn from rng; chosen: settings, day: GPS s of midnight."""
    planned = plan(chosen, float(satellite["torquer_full_scale"]))
    for _ in range(200):
        path = flight.drawn(chosen, chosen.eccentricity, day, day + constants.DAY, rng)
        start = flight.schedule(_starts(path, planned, chosen, day), chosen.manoeuvre_spacing_s)
        if start is not None:
            break
    else:
        raise ValueError("no orbit of 200 passes all areas; lower manoeuvre_spacing_s or widen manoeuvre_windows")
    start = start + rng.uniform(-0.5, 0.5, start.size)
    order = np.argsort(start)
    start, planned = start[order], tuple(planned[i] for i in order)
    stop = start + np.array([one.duration for one in planned])
    offset = (np.array(chosen.offset_um) + chosen.offset_scatter_um * rng.standard_normal(3)) * 1e-6
    bias = chosen.magnetometer_bias_t * rng.standard_normal(3)
    # inertia and dipole per current of the catalogue, or drawn from its prior
    spread = rng.standard_normal(6) * chosen.divisor_scatter
    inertia_sigma = np.diag(np.array(satellite["inertia_sigma"]))
    dipole_sigma = np.array(satellite["dipole_per_current_sigma"])
    return Scene(
        orbit=path,
        planned=planned,
        start=start,
        stop=stop,
        spans=_spans(start, stop, chosen, day),
        offset=offset,
        inertia_b=np.array(satellite["inertia"]) + np.diag(inertia_sigma * spread[:3]),
        dipole_per_current=np.array(satellite["dipole_per_current"]) + dipole_sigma * spread[3:],
        magnetometer_bias=bias,
        mass=float(satellite["mass_at_launch"]),
        drag_b=np.array([-satellite["x_along_velocity"] * chosen.drag_m_s2, 0.0, 0.0]),
        begin=day - 60,
    )


def _starts(path, planned, chosen, day):
    """Times (n,) s at which each manoeuvre may start: its middle in its area, all of it in a window of the day."""
    time = np.arange(day + 600, day + constants.DAY - 1200, 10.0)
    position_e = np.matvec(earth.R_ei(time), path(time)[:, :3])
    latitude = np.degrees(np.arcsin(position_e[:, 2] / np.linalg.norm(position_e, axis=1)))
    longitude, starts = np.degrees(np.arctan2(position_e[:, 1], position_e[:, 0])), []
    for one in planned:
        inside = (latitude >= one.area["lat_min"]) & (latitude <= one.area["lat_max"])
        if "lon_min" in one.area:
            inside &= (longitude >= one.area["lon_min"]) & (longitude <= one.area["lon_max"])
        starts.append(time[inside] - one.duration / 2)
    earliest, allowed = day + chosen.quiet_s + 10, flight.windows(chosen.manoeuvre_windows)
    latest = day + constants.DAY - chosen.quiet_s - max((one.duration for one in planned), default=0.0) - 10
    return [
        some[(some >= earliest) & (some <= latest) & flight.within_windows(some - day, one.duration, allowed)]
        for one, some in zip(planned, starts, strict=True)
    ]


def room(satellite: Mapping, chosen, day: float) -> Callable:
    """Function: numbers (n,) of each manoeuvre of a design -> share of ORBITS drawn orbits in which all have a time."""
    planned = plan(chosen, float(satellite["torquer_full_scale"]))
    drawn = (np.random.default_rng(seed) for seed in range(ORBITS))
    paths = [flight.drawn(chosen, chosen.eccentricity, day, day + constants.DAY, rng) for rng in drawn]
    starts = [_starts(path, planned, chosen, day) for path in paths]

    def share(counts):
        wanted = [[some for some, n in zip(one, counts, strict=True) for _ in range(n)] for one in starts]
        return np.mean([flight.schedule(one, chosen.manoeuvre_spacing_s) is not None for one in wanted])

    return share


def _spans(start, stop, chosen, day):
    """Times (s, 2) s that are written: whole seconds round each manoeuvre, overlapping ones joined, or the day."""
    if chosen.span == "day" or start.size == 0:
        length = constants.DAY if chosen.span == "day" else 2 * chosen.quiet_s
        return np.array([[day, day + length]])
    begin, end = np.floor(start - chosen.quiet_s), np.maximum.accumulate(np.ceil(stop + chosen.quiet_s))
    separate = begin[1:] > end[:-1] + 10
    joined = np.stack([begin[np.append(True, separate)], end[np.append(separate, True)]], axis=1)
    return np.clip(joined, day, day + constants.DAY)


def simulate(satellite: Mapping, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns of a simulated day and its truth; arguments as of `gravcal.simulation`."""
    within(effects, of_channels(*READ))
    rng = np.random.default_rng(seed)
    scene = draw_scene(satellite, chosen, day, rng)
    clock, clocks = sensors.draw_clock(chosen, day, rng)
    parts = [_fly_span(span, scene, satellite, chosen, effects, clock, rng) for span in scene.spans]
    columns = sensors.join(parts) | clocks
    truth = {
        "seed": seed,
        "day": day,
        "direction": "proof_mass_to_com",
        "offset_um": [float(v) for v in scene.offset * 1e6],
        "inertia_kg_m2": scene.inertia_b.tolist(),
        "dipole_per_current_a_m2_ma": scene.dipole_per_current.tolist(),
        "manoeuvres": [
            {"kind": one.kind, "area": one.name, "item": one.item, "start": float(a), "stop": float(b)}
            for one, a, b in zip(scene.planned, scene.start, scene.stop, strict=True)
        ],
        "effects": {slug: dict(values) for slug, values in effects.items()},
        "noise_scale": chosen.noise_scale,
    }
    return columns, truth


def _fly_span(span, scene, satellite, chosen, effects, clock, rng):
    """Level-1 columns {product: {column: array}} of one contiguous span (2,) s: motion flown, then read."""
    epochs = sensors.draw_epochs(span, clock, effects, satellite)
    nodes = np.arange(np.floor(span[0]) - 8, np.ceil(span[1]) + 8)
    around = flight.environment(nodes, scene.orbit, satellite["x_along_velocity"], chosen.igrf_generation)
    steps = _steps(span, epochs, scene, satellite, chosen, rng)
    body = flight.Body(
        scene.inertia_b,
        chosen.control_frequency_rad_s,
        1.0,  # damping
        chosen.control_current_ma * float(np.mean(scene.dipole_per_current)),
        satellite["torquer_current_step"] * float(np.mean(scene.dipole_per_current)),
    )
    first = int(np.round(steps.bound[0] - around.time[0]))
    start = np.concatenate([around.target[first], around.target_rate_b[first]])
    tilt = frames.from_rotation_vector(chosen.pointing_error_rad * rng.standard_normal(3))
    start[:4] = frames.quaternion_product(start[:4], tilt)
    # aerodynamic torque that varies along the orbit, at both ends of each step
    phase = rng.uniform(0, 2 * np.pi, 3)
    size = chosen.aerodynamic_torque_n_m * rng.standard_normal(3)
    slow = size * (1 + 0.5 * np.sin(1.1e-3 * (steps.bound[:, None] - steps.bound[0]) + phase))
    slow = np.stack([slow[:-1], slow[1:]], axis=1)
    added = np.zeros_like(slow), slow
    states, control = flight.fly(steps, around, body, start, added)
    # flown again with the injected effects, the controller's part as it was with them; an effect is linear in a step:
    # what it is at the beginning, where instruments read, and its mean over the step
    parts = np.append(0.0, (np.arange(PARTS) + 0.5) / PARTS)
    inner = (steps.bound[:-1, None] + np.diff(steps.bound)[:, None] * parts).ravel()
    for closed in (True, False) if any(effect(slug).channel in EXTRA for slug in effects) else ():
        context = sensors.context_of_steps(inner, parts.size, steps, around, states, control[0], scene)
        none = np.zeros((inner.size, 3))
        contributions = [(none + contributed(effects, name, context)).reshape(-1, parts.size, 3) for name in EXTRA]
        ends = [np.stack([v[:, 0], 2 * v[:, 1:].mean(axis=1) - v[:, 0]], axis=1) for v in contributions]
        added = ends[0], slow + ends[1]
        states, control = flight.fly(steps, around, body, start, added, None if closed else control)
    motion = _motion(steps, around, scene, states, control, added)
    return sensors.read_instruments(epochs, motion, scene, satellite, chosen, effects, rng)


def _steps(span, epochs, scene, satellite, chosen, rng):
    """`flight.Steps` of a span (2,) s that end at every epoch that is read, every edge and every control update."""
    half = chosen.manoeuvre_period_s / 2
    edges = [np.arange(a, b + half / 2, half) for a, b in zip(scene.start, scene.stop, strict=True)]
    edges = np.concatenate([e for e in edges if e[0] > span[0] and e[-1] < span[1]] or [np.zeros(0)])
    control = np.arange(span[0] + rng.uniform(0, 1), span[1], 1.0)
    lead = np.arange(span[0] - LEAD_S, epochs.acc[0], 0.1)
    tail = np.arange(epochs.acc[-1], span[1] + LEAD_S, 0.1)
    bound = np.unique(np.concatenate([epochs.acc, epochs.sca, epochs.mag, edges, control, lead, tail]))
    bound = bound[np.concatenate([[True], np.diff(bound) > 1e-7])]
    begin = bound[:-1]
    dipole, wave = np.zeros((begin.size, 3)), np.zeros(begin.size, dtype=bool)
    for one, a, b in zip(scene.planned, scene.start, scene.stop, strict=True):
        inside = (begin >= a - 1e-7) & (begin < b - 1e-7)
        phase = np.floor((begin[inside] - a + 1e-7) / half).astype(int)
        amplitude = one.share * satellite["torquer_full_scale"] * scene.dipole_per_current[one.rod]
        dipole[inside, one.rod] = np.where(phase % 2 == 0, 1, -1) * amplitude
        wave |= inside
    return flight.Steps(bound, np.isin(begin, control), wave, dipole)


def _motion(steps, around, scene, states, control, added):
    """`sensors.Motion` at every bound, values after an edge; control and added hold dipole and torque of each step."""
    applied = [np.concatenate([a, a[-1:]]) for a in (control[0] + added[0][:, 0], control[1] + added[1][:, 0])]
    rods = np.concatenate([control[0], control[0][-1:]])
    position_i, field_i = (lines_between(steps.bound, around.time, one) for one in (around.position_i, around.field_i))
    quaternion, rate = states[:, :4], states[:, 4:]
    R_bi = frames.R_bi_from_quaternion(quaternion)
    field_b = np.matvec(R_bi, field_i)
    gradient_b = R_bi @ gravity.gradient_i(position_i) @ np.swapaxes(R_bi, 1, 2)
    torque = np.cross(applied[0], field_b) + applied[1] + dynamics.gravity_gradient_torque(scene.inertia_b, gradient_b)
    return sensors.Motion(
        time=steps.bound,
        quaternion=quaternion,
        rate_b=rate,
        rate_dot_b=dynamics.rate_derivative(scene.inertia_b, rate, torque),
        gradient_b=gradient_b,
        field_b=field_b,
        command_b=rods,
    )


def library(limits: Mapping, causes=()) -> list[dict]:
    """Manoeuvres that may be flown within some limits, as tables of a design: every rod where it turns the satellite.

    Information grows with the square of the current; only causes that are not linear need more than one current.
    Limits: duration_s, period_s, current_ma, rods, latitude_deg of `gravcal design --constraints`; causes: to separate.
    """
    tables, (south, north) = [], limits["latitude_deg"]
    currents = sorted(np.atleast_1d(limits["current_ma"]).tolist(), reverse=True)
    currents = currents if any(not effect(slug).linear for slug in causes) else currents[:1]
    for middle in range(-75, 90, 15):
        if not south <= middle - 5 <= middle + 5 <= north:
            continue
        # a rod along the field makes no torque: it points north at the equator, down at the poles
        useful = {"x": abs(middle) >= 30, "y": True, "z": abs(middle) <= 60}
        for rod in (one for one in limits["rods"] if useful[one]):
            kind = "pitch" if rod != "y" else "roll" if abs(middle) >= 45 else "yaw"
            timing = {"kind": kind, "duration_s": limits["duration_s"], "period_s": limits["period_s"]}
            place = {"rod": rod, "latitude_deg": [middle - 5.0, middle + 5.0]}
            tables += [timing | {"current_ma": current} | place for current in currents]
    return tables


def measured_noise(usual, known, measured) -> dict:
    """Settings with the noise of the linear channels in "com_offset.noise" (`measured`), {} where it has none.

    From 0.05 Hz to the low-pass of the calibration's settings, `known`, the densities are those measured before it,
    beyond as many times the `usual` ones as at the ends. Angular channels, star cameras, magnetometer: not measured.
    """
    if measured.attrs["source_of_noise"] != "quiet data":
        return {}
    time, node = np.arange(-400, 401) / 100, np.array(usual.noise_frequency_hz)
    band = node[(node >= 0.05) & (node <= known.lowpass_hz)]
    filters = {"lowpass_hz": known.lowpass_hz, "half_width_s": known.half_width_s}
    gain = lowpass_resampler(time, np.ones(time.size, bool), np.zeros(1), **filters)(
        np.cos(2 * np.pi * time[:, None] * band)
    )[0]
    settings = {}
    for axis, density in zip("xyz", measured["density"].values, strict=True):
        usual_amplitude = np.array(getattr(usual, f"linear_noise_{axis}"))
        amplitude = np.sqrt(np.interp(band, measured["frequency"].values, density)) / gain
        ratio = np.interp(node, band, amplitude / np.interp(band, node, usual_amplitude))
        settings[f"linear_noise_{axis}"] = (usual_amplitude * ratio).tolist()
    return settings
