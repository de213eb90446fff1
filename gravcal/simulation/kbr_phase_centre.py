"""A simulated ranging calibration: eight wiggles of a pair, written as Level-1 columns, and their truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from gravcal.effects import Context
from gravcal.estimation import crn
from gravcal.estimation.noise import coloured
from gravcal.physics import constants, earth, frames, orbit_environment
from gravcal.simulation import kbr_phase_centre_pair as pairs
from gravcal.simulation import sensors

BREAK_GAP = 36.0  # s on either side of a phase break that the filter cannot bridge
QUATERNION = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")


def simulate(letters: str, chosen, day: float, seed: int, effects: Mapping[str, Mapping[str, float]]):
    """Level-1 columns of a simulated day and its truth.

    Parameters
    ----------
    letters : of both satellites, "CD"
    chosen : parameters of the simulation
    day : GPS s of midnight
    seed : int
    effects : {slug: {parameter: value}}, hidden in the data

    Returns
    -------
    columns : {(product, letter): {column: array}}; the ranging has the letter "Y"
    truth : plain dict, mm where named so
    """
    rng = np.random.default_rng(seed)
    pair = pairs.draw_pair(chosen, day, rng)
    injected = known_effects(effects)
    scatter = chosen.phase_centre_scatter_mm * rng.standard_normal((2, 3))
    centre = 1e-3 * (np.array([chosen.phase_centre_a_mm, chosen.phase_centre_b_mm]) + scatter)
    columns = {("KBR1B", "Y"): ranging(pair, centre, chosen, injected, rng)}
    for k, letter in enumerate(letters):
        columns[chosen.orbit_product, letter] = _orbit(pair, k, chosen, rng)
        columns["SCA1B", letter] = _star_camera(pair, k, chosen, injected, rng)
    return columns, _truth(letters, pair, centre, chosen, (seed, day, effects))


def known_effects(effects: Mapping[str, Mapping[str, float]]) -> dict:
    """{slug: (Effect, values)} of effects to inject; an unknown slug is refused by the catalogue."""
    from gravcal.effects import catalogue, effect
    from gravcal.effects.ranging import EFFECTS

    known = catalogue() | {entry.slug: entry for entry in EFFECTS}
    found = {slug: known[slug] if slug in known else effect(slug) for slug in effects}
    return {slug: (found[slug], found[slug].values(given)) for slug, given in effects.items()}


def _added(injected, channel, context, shape):
    total = np.zeros(shape)
    for entry, values in injected.values():
        if entry.channel == channel:
            total = total + entry.contribution(context, values)
    return total


def attitudes(pair, time: np.ndarray, states) -> list[np.ndarray]:
    """True quaternions (n, 4) of both satellites."""
    rotations = pairs.nominal(*states)
    return [
        frames.quaternion_product(frames.quaternion_from_R_bi(R), pairs.turned(pair.pointing[k](time)))
        for k, R in enumerate(rotations)
    ]


def phase_range(pair, centre: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Range of the phase centres and of the centres of mass.

    Parameters
    ----------
    pair : Pair
    centre : (2, 3) m, centre of mass to phase centre, b
    time : (n,) s

    Returns
    -------
    ranges : (n,) m twice

    Notes
    -----
    rho = |u + v|, v = R_ib,B c_B - R_ib,A c_A; Remote Sens. 2022, 14, 3395, eqs. 7-9.
    """
    states = [path(time) for path in pair.path]
    u = states[1][:, :3] - states[0][:, :3]
    centre_i = []
    for k, R_bi in enumerate(pairs.nominal(*states)):
        q = pairs.turned(pair.pointing[k](time))
        nominal_b = np.matvec(np.swapaxes(frames.R_bi_from_quaternion(q), 1, 2), centre[k])
        centre_i.append(np.einsum("nji,nj->ni", R_bi, nominal_b))
    return np.linalg.norm(u + centre_i[1] - centre_i[0], axis=1), np.linalg.norm(u, axis=1)


def _environment(pair, centre, time):
    """What effects of the ranging look at beside angle and range: lines of sight, orbit, sunlight."""
    states = [path(time) for path in pair.path]
    toward = states[1][:, :3] - states[0][:, :3]
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    lines = []
    for k, R_bi in enumerate(pairs.nominal(*states)):
        turn = frames.R_bi_from_quaternion(pairs.turned(pair.pointing[k](time)))
        lines.append(np.matvec(turn, np.matvec(R_bi, (toward, -toward)[k])))
    line, position = np.stack(lines, axis=1), states[0][:, :3]
    normal = np.cross(position[0], states[0][0, 3:])
    node = np.cross([0.0, 0.0, 1.0], normal)
    across = np.cross(normal, node) / np.linalg.norm(normal)
    every = max(time.size // 8640, 1)
    return {
        "line_of_sight_b": line,
        "antenna_x": np.asarray(centre)[:, 0],
        "antenna_correction": np.einsum("nka,ka->n", line, centre),
        "argument": np.arctan2(position @ across, position @ node),
        "warmth": orbit_environment.warmth(time, time[::every], position[::every]),
    }


def ranging(pair, centre, chosen, injected, rng) -> dict:
    """Columns of KBR1B: phase at a high rate, CRN-filtered, biased, with light-time terms.

    Parameters
    ----------
    pair : Pair
    centre : (2, 3) m
    chosen : parameters of the simulation
    injected : {slug: (Effect, values)}
    rng : source of randomness
    """
    step = chosen.phase_step_s
    time = pair.day - pairs.EDGE + step * np.arange(round((constants.DAY + 2 * pairs.EDGE) / step))
    true, com = phase_range(pair, centre, time)
    angle = np.stack([pointing(time)[:, 1:] for pointing in pair.pointing], axis=1)
    extra = {"angle": angle, "range": com, "range_rate": np.gradient(com, step)}
    if any(entry.channel == "range" for entry, _ in injected.values()):
        extra |= _environment(pair, centre, time)
    context = Context(time=time, extra=extra, epoch=pair.day + constants.DAY / 2)
    light = _light_time(com, context.extra["range_rate"])
    raw = true + _added(injected, "range", context, time.shape) - light + _phase_noise(time.size, chosen, rng)
    at = pair.day + np.arange(0, constants.DAY, chosen.ranging_step_s)
    breaks = np.sort(rng.uniform(pair.day, pair.day + constants.DAY, chosen.phase_breaks))
    bias = -float(np.round(com[0])) + np.cumsum(np.append(rng.normal(), rng.normal(scale=0.05, size=breaks.size)))
    columns = {"gps_time": at.astype(np.int64)}
    parts = [crn.operator(crn.Crn(), d, np.ones(time.size, bool), (time[0], step), at) for d in range(3)]
    for d, (name, term) in enumerate(
        zip(("biased_range", "range_rate", "range_accl"), ("corr", "rate", "accl"), strict=True)
    ):
        columns[name], columns[f"lighttime_{term}"] = parts[d](np.stack([raw, light], axis=1)).T
        columns[f"ant_centr_{term}"] = np.zeros(at.size)
    columns["biased_range"] = columns["biased_range"] + bias[np.searchsorted(breaks, at)]
    return _with_breaks(columns, at, breaks)


def _phase_noise(count, chosen, rng):
    """White noise and a part that rises towards low frequencies."""
    step = chosen.phase_step_s
    white = chosen.ranging_noise_m * np.sqrt(0.5 / step) * rng.standard_normal(count)
    if chosen.ranging_corner_hz <= 0:
        return white
    return white + coloured(lambda f: chosen.ranging_noise_m**2 * chosen.ranging_corner_hz / f, count, step, rng)


def _light_time(com, rate):
    """Light-time term of dual one-way ranging, first order (of the size and sign of KBR1B of 2023-06-01)."""
    return -com * (0.25 + rate) / constants.SPEED_OF_LIGHT


def _with_breaks(columns, at, breaks):
    """Epochs round a phase break removed, the first one after it marked."""
    distance = np.abs(at[:, None] - breaks).min(axis=1, initial=np.inf)
    kept = distance > BREAK_GAP
    first = np.zeros(at.size, dtype=np.uint8)
    after = np.searchsorted(at[kept], breaks)
    first[np.flatnonzero(kept)[after[after < kept.sum()]]] = 1
    return {name: values[kept] for name, values in (columns | {"qualflg": first}).items()}


def _orbit(pair, k, chosen, rng):
    """GNI1B or GNV1B: the true orbit and its error."""
    time = pair.day + np.arange(constants.DAY)
    state = pair.path[k](time)
    state = state + pairs.orbit_error(chosen, pair, time, state, rng)
    if chosen.orbit_product == "GNV1B":
        state = np.concatenate(earth.state_to_fixed(time, state[:, :3], state[:, 3:]), axis=1)
    return {"gps_time": time.astype(np.int64)} | dict(zip(STATE, state.T, strict=True))


def _star_camera(pair, k, chosen, injected, rng):
    """SCA1B: true attitude, mounting error, noise."""
    tag = pair.day + np.arange(constants.DAY)
    time = tag - _added(injected, "sca_delay", Context(time=tag), tag.shape)
    true = attitudes(pair, time, [path(time) for path in pair.path])[k]
    angle = sensors.star_camera_noise(time.size, chosen, rng) + 1e-6 * np.array(chosen.misalignment_urad)
    angle = angle + _added(injected, "pointing_b", Context(time=time), (time.size, 3))
    measured = sensors.star_camera(true, angle, rng)
    return {"gps_time": tag.astype(np.int64)} | dict(zip(QUATERNION, measured.T, strict=True))


def _truth(letters, pair, centre, chosen, seeded):
    seed, day, effects = seeded
    names = [f"{'+-'[w.sign < 0]}{('pitch', 'yaw')[w.axis]}" for w in pair.wiggles]
    return {
        "seed": seed,
        "day": day,
        "direction": "com_to_phase_centre",
        "phase_centre_mm": {letter: (1e3 * c).tolist() for letter, c in zip(letters, centre, strict=True)},
        "manoeuvres": [
            {"satellite": letters[w.satellite], "kind": name, "start": w.start, "stop": w.stop}
            for w, name in zip(pair.wiggles, names, strict=True)
        ],
        "misalignment_urad": list(chosen.misalignment_urad),
        "effects": {slug: dict(given) for slug, given in effects.items()},
    }


def ingested(columns: Mapping) -> dict[tuple[str, str], xr.Dataset]:
    """Simulated columns as the readers would return the files, {(product, letter): Dataset}.

    Parameters
    ----------
    columns : as `simulate` returns them
    """
    found = {}
    for (product, letter), values in columns.items():
        second = np.asarray(values["gps_time"])
        blank = np.zeros(second.size, dtype=np.uint8)
        given = {"qualflg": blank, "flag": blank} | dict(values)
        given |= {"time_second": second, "time_fraction": np.zeros(second.size), "time_tag": second.astype(float)}
        attrs = {"product": product, "satellite": letter, "file": f"{product} of {letter}"}
        found[product, letter] = xr.Dataset({n: ("record", v) for n, v in given.items()}, attrs=attrs)
    return found


def noiseless(chosen):
    """The same choices without any error, for checks of the equations."""
    quiet = ("ranging_noise_m", "orbit_error_m", "orbit_red_m", "noise_scale")
    return _replaced(chosen, dict.fromkeys(quiet, 0.0) | {"phase_breaks": 0, "ranging_corner_hz": 0.0})


def _replaced(chosen, values):
    if hasattr(chosen, "with_settings"):
        return chosen.with_settings(values)
    return replace(chosen, **values)
