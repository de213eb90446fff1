"""What discovery tries in ranging: effects of the catalogue, and regressors from the measured channels.

A regressor stands for effects that are in no list: powers, rates and lags of the pointing angles, products of two
channels, waves along the orbit, sunlight, and decays from the start of a manoeuvre. Both satellites or one of them may
have an effect; a ripple with the angles has any period and phase.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.signal import lfilter

from gravcal.calibrations.causes import listed
from gravcal.calibrations.kbr_phase_centre.model import middle
from gravcal.effects import Context, Effect, catalogue, effect
from gravcal.effects.ranging import ripples
from gravcal.estimation.records import Candidate
from gravcal.physics import frames, orbit_environment

BREAK = "ranging.phase_break"
FAMILIES = ("ranging", "timing", "attitude")
#: Searched for along the time axis; the calibration itself, once and as a share, of which noise is taken out before.
NOT_HERE = (BREAK, "ranging.phase_centre", "ranging.antenna_correction", "attitude.star_camera_noise")
#: Turns of the frame that the phase centres are given in.
FRAME = ("attitude.star_camera_misalignment", "ranging.star_camera_misalignment")
RIPPLE = "ranging.multipath"
PLACES = ("pitch_a", "yaw_a", "pitch_b", "yaw_b")
#: Satellites that an effect on attitudes may be of, by form.
SATELLITES = {"": (0, 1), "a alone": (0,), "b alone": (1,)}
SIZE = np.radians(3.0)  # rad, so that a driver is near one
#: Ripples a degree, so close that the phase of a ripple stays in step over the six degrees of a pair of wiggles.
RIPPLE_STEP = 0.07
RIPPLES_PER_DEG = np.arange(0.40, 2.05, RIPPLE_STEP)
LAGS_S = (20.0, 60.0, 180.0)
SUNLIGHT_LAGS_S = (60.0, 200.0, 2000.0)
#: Of waves along the argument of latitude; slower ones are taken up by the slow orbit error.
CYCLES = range(8, 41)
SETTLING_S = (100.0, 300.0, 900.0)


def context(aligned: xr.Dataset, pointed: xr.Dataset, nominal: np.ndarray) -> Context:
    """What the effects of the ranging look at, on whole seconds, as measured.

    Parameters
    ----------
    aligned, pointed : Dataset, "kbr_phase_centre.align" and "kbr_phase_centre.pointing"
    nominal : (2, 3) m, phase centres of the catalogue
    """
    time, distance = pointed["time"].values, pointed["range_com"].values
    line, position = np.moveaxis(pointed["line_of_sight_b"].values, 0, 1), aligned["position_i"].values[0]
    known = np.isfinite(position).all(axis=1)
    orbit, position = time[known][::10], position[known][::10]  # of the first satellite
    normal = np.cross(position[0], position[min(100, len(position) - 1)])
    along = {
        "argument": np.unwrap(orbit_environment.argument_of_latitude(position, normal)),
        "latitude": np.arcsin(position[:, 2] / np.linalg.norm(position, axis=1)),
        "sunlit": orbit_environment.sunlit(position, orbit_environment.sun_i(orbit[[0, -1]]).mean(axis=0)).astype(
            float
        ),
    }
    extra = {name: np.interp(time, orbit, values) for name, values in along.items()} | {
        "warmth": orbit_environment.warmth(time, orbit, position),
        "angle": np.moveaxis(pointed["angle"].values, 0, 1),
        "range": distance,
        "range_rate": np.gradient(distance - np.einsum("nka,ka->n", np.nan_to_num(line), nominal), time),
        "line_of_sight_b": line,
        "antenna_x": nominal[:, 0],
        "antenna_correction": np.einsum("nka,ka->n", line, nominal),
        "turning": turning(aligned, line),
    }
    return Context(time=time, epoch=middle(pointed), extra=extra)


def turning(aligned: xr.Dataset, line_b: np.ndarray) -> np.ndarray:
    """Change (n, 2, 3) s-1 of the lines of sight (n, 2, 3) by the turning of the satellites, the line itself held.

    Notes
    -----
    l' - R_bi e', by differences over two seconds; error (2 pi / 250 s)^2 / 6, a ten thousandth. The noise of R_bi is
    that of the attitude times the orbital rate.
    """
    position, quaternion = aligned["position_i"].values, aligned["quaternion"].values
    line = position[1] - position[0]
    line = line / np.linalg.norm(line, axis=1, keepdims=True)
    result = np.zeros((line.shape[0], 2, 3))
    for k, toward in enumerate((line, -line)):
        q = np.where(np.isfinite(quaternion[k]), quaternion[k], [1.0, 0.0, 0.0, 0.0])
        rotation = frames.R_bi_from_quaternion(q)[1:-1]
        result[1:-1, k] = (line_b[2:, k] - line_b[:-2, k] - np.matvec(rotation, toward[2:] - toward[:-2])) / 2
    return result


def effects_of(context: Context, centre: np.ndarray) -> list[Candidate]:
    """Effects of the catalogue that a ranging calibration can show, with one column (n, q) m on whole seconds.

    A ripple with the angles has the columns of both satellites, and its period, rad, for a place.

    Parameters
    ----------
    context : Context on whole seconds
    centre : (2, 3) m, phase centres of the solution
    """
    signals = []
    for slug, entry in catalogue().items():
        if slug.partition(".")[0] not in FAMILIES or slug in (*NOT_HERE, RIPPLE):
            continue
        if entry.channel == "range":
            signals.append(listed(entry, [entry.columns(context)]))
        elif entry.channel in ("sca_delay", "pointing_b"):
            for form, those in SATELLITES.items():
                signals.append(listed(entry, [_of_attitude(entry, context, centre, those)], form))
    angle = np.nan_to_num(context.extra["angle"])
    for period in np.radians(1 / RIPPLES_PER_DEG):
        form = f"period {np.degrees(period):.3g} deg"
        ripple = listed(effect(RIPPLE), [ripples(angle, period)], form, slice(-1))
        signals.append(replace(ripple, at=float(period)))
    return signals


def _of_attitude(entry: Effect, context, centre, those):
    """Range per parameter of an effect on the attitude of some satellites.

    The orbit side of the residual holds -l . c with the measured line of sight. Star cameras late by a second measure
    l = l_true - delay * turning; a rotation phi from true to measured attitude adds -phi . sum l x c.
    """
    centre = centre * np.isin([0, 1], those)[:, None]
    if entry.channel == "sca_delay":
        return -np.einsum("nka,ka->n", context.extra["turning"], centre)[:, None] * entry.columns(context)
    arm = np.cross(context.extra["line_of_sight_b"], centre).sum(axis=1)
    return -np.einsum("na,naq->nq", arm, entry.columns(context))


def drivers(context: Context, starts: Sequence[float]) -> list[Candidate]:
    """Regressors for effects that are in no list; a rate times its angle is a late star camera.

    Parameters
    ----------
    context : Context on whole seconds
    starts : s, of the stretches of manoeuvres
    """
    extra, time = context.extra, context.time
    angle = np.nan_to_num(extra["angle"].reshape(-1, 4)) / SIZE
    rate = np.gradient(angle, time, axis=0) * 40.0  # 250 s / 2 pi
    signals = _each("pointing", "cube", angle**3) + _each("pointing", "fourth power", angle**4)
    signals += _each("pointing", "size", np.abs(angle))
    signals += _each("pointing_rate", "itself", rate) + _each("pointing_rate", "square", rate**2)
    signals += _each("pointing_rate", "size", np.abs(rate))
    for lag in LAGS_S:
        signals += _each("pointing", f"lag {lag:g} s", _lagged(angle, lag))
    for i, first in enumerate(PLACES):
        for j in range(i + 1, 4):
            form, product = f"product of {first} and {PLACES[j]}", angle[:, i] * angle[:, j]
            signals.append(_driver("pointing", form, ["range"], product[:, None]))
    others = {
        "latitude": np.sin(extra["latitude"]),
        "eclipse": extra["warmth"] - extra["warmth"].mean(),
        "time": ((time - context.epoch) / 43200.0) ** 2,
        "range_rate": extra["range_rate"] / max(np.nanmax(np.abs(extra["range_rate"])), 1e-9),
    }
    for name, values in others.items():
        signals += _each(f"pointing*{name}", f"{name} times the angle", angle * np.nan_to_num(values)[:, None])
    for cycles in CYCLES:
        phase = cycles * extra["argument"]
        wave, form = np.stack([np.sin(phase), np.cos(phase)], axis=1), f"wave of {cycles:g} cycles a revolution"
        signals.append(_driver("latitude", form, ["range_sine", "range_cosine"], wave))
    sunlit = extra["sunlit"][:, None]
    signals.append(_driver("eclipse", "sunlight", ["range"], sunlit))
    for lag in SUNLIGHT_LAGS_S:
        signals.append(_driver("eclipse", f"sunlight with a lag of {lag:g} s", ["range"], _lagged(sunlit, lag)))
    since = time[:, None] - np.array(starts)
    for decay in SETTLING_S:
        shape = np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0).sum(axis=1, keepdims=True)
        signals.append(_driver("time", f"decay of {decay:g} s from the start of a manoeuvre", ["range"], shape))
    return signals


def _driver(channel, form, names, columns):
    return Candidate(f"unknown:{channel}", form, names, ["m"] * len(names), [columns])


def _each(channel, form, values):
    """A function (n, 4) of all four angles together and of each of them."""
    names = [f"range_{place}" for place in PLACES]
    alone = [_driver(channel, f"{form} of {p}", [names[k]], values[:, k : k + 1]) for k, p in enumerate(PLACES)]
    return [_driver(channel, f"{form} of all angles", names, values), *alone]


def _lagged(values, lag_s):
    """Series (n, q) of whole seconds through a first-order lag."""
    keep = np.exp(-1 / lag_s)
    return lfilter([1 - keep], [1, -keep], values, axis=0)
