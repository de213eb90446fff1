"""A simulated ranging calibration: wiggles of two satellites that look at each other, and the truth."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import curve_fit

from gravcal import catalog
from gravcal.effects import Context
from gravcal.effects.ranging import BANDS_HZ, BREAK_GAP_S
from gravcal.errors import CatalogError, refuse
from gravcal.estimation import crn
from gravcal.estimation.noise import coloured, in_bands
from gravcal.physics import constants, frames, orbit_environment
from gravcal.simulation import added, flight, of_channels, sensors, within

LEAST_PERIODS = 3  # of a sub-manoeuvre
EDGE = 70.0  # s flown before and after the day, for the filters
MILLI_HZ = (2.0, 60.0)  # where the noise of the range is that of orbit and ranging, no polynomial and no filter


#: In place of what the catalogue has as it was on 2014-01-15, GRACE RL02.
BENIGN = {"orbit_red_m": 0.0, "star_camera_white_rad": 1.5e-6}


@dataclass(frozen=True)
class Wiggle:
    """One sub-manoeuvre: the satellite (0 or 1), the axis (0 pitch, 1 yaw), what it is called, and how it turns."""

    satellite: int
    axis: int
    kind: str  #: "+pitch", "-yaw", or "pitch" without offset
    start: float  #: s, of the first slew
    stop: float  #: s, of the last one
    offset: float  #: rad, signed
    amplitude: float  #: rad, of the sign of the offset
    period: float  #: s
    slew: float  #: s, of each of the two


@dataclass(frozen=True)
class Pair:
    """Both satellites of a day."""

    day: float  #: s, GPS
    path: tuple[Callable, Callable]  #: (n,) s -> (n, 6) m, m s-1, of both
    pointing: tuple[Callable, Callable]  #: (n,) s -> (n, 3) rad, roll, pitch, yaw of both
    wiggles: tuple[Wiggle, ...]  #: sub-manoeuvres in order of time


def simulate(letters: str, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns by (product, letter), the ranging of "Y", and the truth; arguments as of `gravcal.simulation`."""
    chosen = with_noise(chosen)
    within(effects, of_channels("range", "sca_delay", "pointing_b"))
    rng = np.random.default_rng(seed)
    pair = draw_pair(chosen, day, rng)
    scatter = chosen.phase_centre_scatter_mm * rng.standard_normal((2, 3))
    centre = 1e-3 * (np.array([chosen.phase_centre_a_mm, chosen.phase_centre_b_mm]) + scatter)
    columns = {("KBR1B", "Y"): ranging(pair, centre, chosen, effects, rng)}
    for k, letter in enumerate(letters):
        columns[chosen.orbit_product, letter] = _orbit(pair, k, chosen, rng)
        tag = pair.day + np.arange(constants.DAY)
        time = tag - added(effects, "sca_delay", Context(time=tag))
        R_bi = nominal(*(path(time) for path in pair.path))[k]
        true = frames.quaternion_product(frames.quaternion_from_R_bi(R_bi), turned(pair.pointing[k](time)))
        angle = sensors.star_camera_noise(time.size, chosen, rng) + 1e-6 * np.array(chosen.misalignment_urad)
        measured = sensors.star_camera(true, angle + added(effects, "pointing_b", Context(time=time)), rng)
        columns["SCA1B", letter] = sensors.attitude_columns(tag, measured)
    manoeuvres = [
        {"satellite": letters[one.satellite], "kind": one.kind, "start": one.start, "stop": one.stop}
        for one in pair.wiggles
    ]
    truth = {
        "seed": seed,
        "day": day,
        "direction": "com_to_phase_centre",
        "phase_centre_mm": {letter: (1e3 * c).tolist() for letter, c in zip(letters, centre, strict=True)},
        "manoeuvres": manoeuvres,
        "misalignment_urad": list(chosen.misalignment_urad),
        "effects": {slug: dict(values) for slug, values in effects.items()},
    }
    return columns, truth


def with_noise(chosen):
    """Settings with the noise that `noise` names: if it is benign, BENIGN in place of values left as measured."""
    if "noise" not in chosen.entries or chosen.noise == "measured":
        return chosen
    measured = catalog.parameters(chosen.calibration)
    return chosen.with_settings({n: v for n, v in BENIGN.items() if getattr(chosen, n) == getattr(measured, n)})


def draw_pair(chosen, day: float, rng) -> Pair:
    """Pair with orbits and pointing of a day that begins at `day`, GPS s."""
    start, wiggles = day + chosen.first_start_s, []
    allowed = flight.windows(chosen.manoeuvre_windows if "manoeuvre_windows" in chosen.entries else "")
    for name, length, period, offset, amplitude, slew in _planned(chosen):
        if name:
            kind, letter = name.split("_")
            place, sign = ("ab".index(letter), int(kind.endswith("yaw"))), 1 - 2 * (kind[0] == "-")
            turn = sign * np.radians(offset), sign * np.radians(amplitude), period, slew
            begins = np.maximum(allowed[:, 0], start - day)  # in one of the windows, inf without
            inside = flight.within_windows(begins, length + 2 * slew, allowed)
            start = day + float(np.min(begins[inside], initial=np.inf))
            wiggles.append(Wiggle(*place, kind, start, start + length + 2 * slew, *turn))
        start += length + 2 * slew + chosen.quiet_s
    if wiggles and wiggles[-1].stop > day + constants.DAY - 400:
        plan = f"sub-manoeuvres until {wiggles[-1].stop - day:.0f} s"
        refuse("wiggles of a day", plan, "an end 400 s before midnight", "Lower quiet_s, or fly less.", CatalogError)
    # two bodies on one orbit, the second some seconds behind or ahead: both obey the same field exactly
    angles = rng.uniform(0, 2 * np.pi, 2)
    inclination = np.radians(chosen.inclination_deg)
    state = flight.initial_state(chosen.altitude_km * 1e3, inclination, chosen.eccentricity, *angles)
    lag = chosen.separation_km * 1e3 / np.linalg.norm(state[3:])
    begin = day - 2 * EDGE - lag
    nodes = begin + 10.0 * np.arange(int((constants.DAY + 4 * EDGE + 2 * lag) / 10) + 2)
    spline = make_interp_spline(nodes - begin, flight.fly_orbit(state, begin, nodes[-1])(nodes)[:, :3], k=9)
    speed = spline.derivative()

    def follow(delay):
        return lambda t: np.concatenate([spline(t - begin - delay), speed(t - begin - delay)], axis=1)

    pointing = tuple(_pointing(chosen, day, [one for one in wiggles if one.satellite == k], rng) for k in (0, 1))
    return Pair(day, (follow(0.0), follow(lag)), pointing, tuple(wiggles))


def _planned(chosen):
    """Tuples (name as "+pitch_b", "" for an empty place; length s, period s, offset deg, amplitude deg, slew s)."""
    if "design" not in chosen.entries or not chosen.design:  # a day of routine has none
        usual = chosen.cycles * chosen.period_s, chosen.period_s, chosen.offset_deg, chosen.amplitude_deg, chosen.slew_s
        return [(name, *usual) for name in chosen.manoeuvres]
    tables = []
    for one in catalog.design(chosen.design).manoeuvres:
        angles = abs(one.facts["offset_deg"]), one.facts["amplitude_deg"]
        tables += [(one.kind, one.duration_s, one.period_s, *angles, chosen.slew_s)] * one.count
    return [(f"{kind}_{letter}", *numbers) for letter in "ab" for kind, *numbers in tables]


def sessions(limits: Mapping, seconds: float) -> list[list[dict]]:
    """Wiggles within some limits, as plans of four sub-manoeuvres of each satellite; none where time is too short.

    limits : angle_deg, rate_deg_s, period_s as of `gravcal design --constraints`; seconds : of all four
    """
    plans, periods = [], np.atleast_1d(limits["period_s"])
    for period, share in itertools.product(periods[4 * LEAST_PERIODS * periods <= seconds].tolist(), np.arange(6) / 6):
        fixed = {"duration_s": period * int(seconds / 4 / period), "period_s": period}
        offset = round(float(share * limits["angle_deg"]), 3)
        amplitude = round(min(limits["angle_deg"] - offset, limits["rate_deg_s"] * period / (2 * np.pi)), 3)
        kinds = {"+pitch": 1, "-pitch": -1, "+yaw": 1, "-yaw": -1} if offset else {"pitch": 1, "yaw": 1}
        angles = [{"offset_deg": sign * offset, "amplitude_deg": amplitude} for sign in kinds.values()]
        tables = zip(kinds, angles, strict=True)
        plans.append([{"kind": kind, "count": 4 // len(kinds)} | fixed | angle for kind, angle in tables])
    return plans


def measured_noise(usual, _known, measured) -> dict:
    """Settings with the noise of orbit, ranging and star cameras of "kbr_phase_centre.noise", {} without quiet data.

    A power law and a white part are fitted to the spectrum of the range, with its covariance. Star cameras have the
    density that they have at the usual period.
    """
    if measured.attrs["source_data"] != "quiet":
        return {}
    knot = 1e3 * measured["knot"].values
    used = (knot > MILLI_HZ[0]) & (knot < MILLI_HZ[1])

    def log_density(f, orbit, slope, white):  # the errors of two orbits
        return np.logaddexp(np.log(2) + 2 * (orbit - slope * np.log(f)), 2 * white)

    start = [np.log(0.0035), 2.2, np.log(1e-6)]
    fitted, _ = curve_fit(
        log_density,
        knot[used],
        measured["log_density"].values[used],
        start,
        measured["log_covariance"].values[np.ix_(used, used)],
    )
    power = measured["pointing_power"].values[measured["corner"].values > 1 / usual.period_s].sum()
    settings = {"orbit_red_m": np.exp(fitted[0]), "orbit_red_slope": fitted[1], "ranging_noise_m": np.exp(fitted[2])}
    settings |= {"star_camera_white_rad": np.sqrt(power / 2), "noise_scale": 1.0}
    return {name: float(value) for name, value in settings.items()}


def _pointing(chosen, day, wiggles, rng):
    """Function (n,) s -> roll, pitch, yaw (n, 3) rad: slow motion of the control loop and the wiggles."""
    step = 20.0
    nodes = day - 4 * EDGE + step * np.arange(int((constants.DAY + 8 * EDGE) / step) + 1)
    corner = 1 / (2 * np.pi * chosen.pointing_memory_s)
    shape = lambda f: 4 * chosen.pointing_memory_s / (1 + (f / corner) ** 2) ** 2 * 2  # noqa: E731
    wander = chosen.pointing_rad * np.stack([coloured(shape, nodes.size, step, rng) for _ in range(3)], axis=1)
    mean = chosen.pointing_mean_rad * rng.standard_normal(3)
    spline = make_interp_spline(nodes - day, wander + mean, k=5)

    def at(time):
        angle = spline(time - day)
        for wiggle in wiggles:
            angle[:, 1 + wiggle.axis] += profile(wiggle, time - wiggle.start)
        return angle

    return at


def profile(wiggle: Wiggle, time: np.ndarray) -> np.ndarray:
    """Angle (n,) rad of a sub-manoeuvre at times (n,) s since its start.

    theta = theta0 + A sin(2 pi f t) between two slews; Remote Sens. 2022, 14, 3395, eqs. 1-4.
    """
    length = wiggle.stop - wiggle.start
    inside = np.clip(time - wiggle.slew, 0, length - 2 * wiggle.slew)
    ramp = np.clip(np.minimum(time, length - time) / wiggle.slew, 0, 1)
    smooth = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    return wiggle.offset * smooth + wiggle.amplitude * np.sin(2 * np.pi * inside / wiggle.period)


def nominal(state_a: np.ndarray, state_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations R_bi (n, 3, 3) of both satellites with x on the line of sight and z down."""
    line = state_b[:, :3] - state_a[:, :3]
    line = line / np.linalg.norm(line, axis=1, keepdims=True)
    rotations = []
    for x, state in ((line, state_a), (-line, state_b)):
        y = np.cross(-state[:, :3] / np.linalg.norm(state[:, :3], axis=1, keepdims=True), x)  # down cross x
        y = y / np.linalg.norm(y, axis=1, keepdims=True)
        rotations.append(np.stack([x, y, np.cross(x, y)], axis=1))
    return tuple(rotations)


def turned(angle: np.ndarray) -> np.ndarray:
    """Quaternion from nominal to body for roll, pitch and yaw (n, 3) rad, pitch and yaw towards the line of sight.

    A body turned by the rotation vector (roll, -pitch, -yaw) sees the line of sight at +pitch and +yaw.
    """
    return frames.from_rotation_vector(angle * np.array([1.0, -1.0, -1.0]))


def ranging(pair: Pair, centre: np.ndarray, chosen, effects: Mapping, rng) -> dict:
    """Columns of KBR1B: phase at a high rate, CRN-filtered, biased, with light-time terms; phase centres (2, 3) m.

    rho = |u + v|, v = R_ib,B c_B - R_ib,A c_A; Remote Sens. 2022, 14, 3395, eqs. 7-9. The light-time term is that of
    dual one-way ranging at first order, of the size and sign of KBR1B of 2023-06-01.
    """
    step = chosen.phase_step_s
    time = pair.day - EDGE + step * np.arange(round((constants.DAY + 2 * EDGE) / step))
    states = [path(time) for path in pair.path]
    u = states[1][:, :3] - states[0][:, :3]
    com = np.linalg.norm(u, axis=1)
    centre_i, lines = [], []
    for k, R_bi in enumerate(nominal(*states)):
        turn = frames.R_bi_from_quaternion(turned(pair.pointing[k](time)))
        centre_i.append(np.einsum("nji,nj->ni", R_bi, np.matvec(np.swapaxes(turn, 1, 2), centre[k])))
        lines.append(np.matvec(turn, np.matvec(R_bi, (1, -1)[k] * u / com[:, None])))
    rate, line, position = np.gradient(com, step), np.stack(lines, axis=1), states[0][:, :3]
    every, distance = max(time.size // 8640, 1), np.linalg.norm(u + centre_i[1] - centre_i[0], axis=1)
    extra = {
        "angle": np.stack([pointing(time)[:, 1:] for pointing in pair.pointing], axis=1),
        "range": com,
        "range_rate": np.gradient(distance, step),
        "line_of_sight_b": line,
        "antenna_x": centre[:, 0],
        "antenna_correction": np.einsum("nka,ka->n", line, centre),
        "argument": orbit_environment.argument_of_latitude(position, np.cross(position[0], states[0][0, 3:])),
        "warmth": orbit_environment.warmth(time, time[::every], position[::every]),
    }
    extra["correction_band"] = in_bands(extra["antenna_correction"], step, BANDS_HZ)
    context = Context(time=time, extra=extra, epoch=pair.day + constants.DAY / 2)
    light = -com * (0.25 + rate) / constants.SPEED_OF_LIGHT
    noise = chosen.ranging_noise_m * np.sqrt(0.5 / step) * rng.standard_normal(time.size)
    if chosen.ranging_corner_hz > 0:  # a part that rises towards low frequencies
        noise += coloured(lambda f: chosen.ranging_noise_m**2 * chosen.ranging_corner_hz / f, time.size, step, rng)
    phase = distance + added(effects, "range", context) - light + noise
    at = pair.day + np.arange(0, constants.DAY, chosen.ranging_step_s)
    breaks = np.sort(rng.uniform(pair.day, pair.day + constants.DAY, chosen.phase_breaks))
    bias = -float(np.round(com[0])) + np.cumsum(np.append(rng.normal(), rng.normal(scale=0.05, size=breaks.size)))
    columns = {"gps_time": at.astype(np.int64)}
    names = (("biased_range", "corr"), ("range_rate", "rate"), ("range_accl", "accl"))
    for derivative, (name, term) in enumerate(names):
        through = crn.operator(crn.Crn(), derivative, np.ones(time.size, bool), (time[0], step), at)
        columns[name], columns[f"lighttime_{term}"] = through(np.stack([phase, light], axis=1)).T
        columns[f"ant_centr_{term}"] = np.zeros(at.size)
    columns["biased_range"] = columns["biased_range"] + bias[np.searchsorted(breaks, at)]
    kept = np.abs(at[:, None] - breaks).min(axis=1, initial=np.inf) > BREAK_GAP_S
    columns["qualflg"] = np.zeros(at.size, dtype=np.uint8)
    after = np.searchsorted(at[kept], breaks)
    columns["qualflg"][np.flatnonzero(kept)[after[after < kept.sum()]]] = 1  # the first epoch after a break
    return {name: values[kept] for name, values in columns.items()}


def _orbit(pair, k, chosen, rng):
    """Columns of GNI1B or GNV1B: the true orbit with the error of a reduced-dynamic one, waves and a red part."""
    time = pair.day + np.arange(constants.DAY)
    state = pair.path[k](time)
    revolution = np.linalg.norm(np.cross(state[0, :3], state[0, 3:])) / np.sum(state[0, :3] ** 2)
    phase = revolution * (time - pair.day)[:, None]
    error_local = np.zeros((time.size, 3))
    for cycles in (0, 1, 2):
        for wave in (np.cos, np.sin):
            error_local += wave(cycles * phase) * chosen.orbit_error_m / np.sqrt(2) * rng.standard_normal(3)
    if chosen.orbit_red_m > 0:
        shape = lambda f: (chosen.orbit_red_m / np.maximum(f / 1e-3, 0.3) ** chosen.orbit_red_slope) ** 2  # noqa: E731
        error_local[:, 1] += coloured(shape, time.size, 1.0, rng)
    radial = state[:, :3] / np.linalg.norm(state[:, :3], axis=1, keepdims=True)
    along = state[:, 3:] / np.linalg.norm(state[:, 3:], axis=1, keepdims=True)
    error = (np.stack([radial, along, np.cross(radial, along)], axis=2) @ error_local[:, :, None])[:, :, 0]
    state = state + np.concatenate([error, np.gradient(error, time, axis=0)], axis=1)
    return sensors.orbit_columns(time, state, chosen.orbit_product)
