"""Regressors of the range from the measured channels, for effects that are in no list."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from gravcal.calibrations.kbr_phase_centre.discovery_view import View

PLACES = ("pitch_a", "yaw_a", "pitch_b", "yaw_b")
SIZE = np.radians(3.0)  # rad, so that a driver is near one
PERIODS_DEG = (0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 2.0, 2.4, 3.0, 3.6)
LAGS_S = (20.0, 60.0, 180.0)
#: Of waves along the argument of latitude; slower ones are taken up by the slow orbit error.
CYCLES = range(8, 41)
SETTLING_S = (100.0, 300.0, 900.0)


def shapes(view: View) -> list[dict]:
    """Every driver: {"cause", "form", "names", "units", "prior", "signal"}, signal (n, q) per unit of the range.

    Parameters
    ----------
    view : View
    """
    angle = np.nan_to_num(view.context.extra["angle"].reshape(-1, 4)) / SIZE
    rows = _of_one_angle(view, angle) + _of_pairs(view, angle) + _of_the_orbit(view) + _of_time(view)
    found = []
    for cause, form, names, signal in rows:
        signal = signal[:, None] if signal.ndim == 1 else signal
        fixed = {"cause": f"unknown:{cause}", "form": form, "names": names, "units": ["m"] * len(names)}
        found.append(fixed | {"prior": [], "signal": signal})
    return found


def _each(cause, form, values):
    """A function of all four angles together and of each of them, [(cause, form, names, (n, q))]."""
    names = [f"range_{p}" for p in PLACES]
    alone = [(cause, f"{form} of {p}", [n], values[:, k]) for k, (n, p) in enumerate(zip(names, PLACES, strict=True))]
    return [(cause, f"{form} of all angles", names, values), *alone]


def _of_one_angle(view, angle):
    """Powers, waves, rates and lags of each angle."""
    rate = np.gradient(angle, view.context.time, axis=0) * 40.0  # 250 s / 2 pi
    rows = _each("pointing", "cube", angle**3) + _each("pointing", "fourth power", angle**4)
    rows += _each("pointing", "size", np.abs(angle))
    for period in PERIODS_DEG:
        phase = 2 * np.pi * angle * SIZE / np.radians(period)
        rows += _waves(f"wave of {period:g} deg", np.sin(phase), np.cos(phase))
    rows += _each("pointing_rate", "itself", rate) + _each("pointing_rate", "square", rate**2)
    rows += _each("pointing_rate", "size", np.abs(rate))
    rows += _each("pointing_rate", "product with the angle", rate * angle)
    for lag in LAGS_S:
        keep = np.exp(-1 / lag)
        late = lfilter([1 - keep], [1, -keep], angle, axis=0)
        rows += _each("pointing", f"lag {lag:g} s", late)
    return rows


def _waves(form, sine, cosine):
    """A wave along each angle, sine and cosine."""
    rows = []
    for k, place in enumerate(PLACES):
        names = [f"range_sine_{place}", f"range_cosine_{place}"]
        rows.append(("pointing", f"{form} of {place}", names, np.stack([sine[:, k], cosine[:, k]], axis=1)))
    return rows


def _of_pairs(view, angle):
    """Products of two angles, and of an angle with another channel."""
    rows = []
    for i in range(4):
        for j in range(i + 1, 4):
            form = f"product of {PLACES[i]} and {PLACES[j]}"
            rows.append(("pointing", form, ["range"], angle[:, i] * angle[:, j]))
    extra, time = view.context.extra, view.context.time
    u = (time - view.context.epoch) / 43200.0
    others = {
        "latitude": np.sin(extra["latitude"]),
        "eclipse": extra["warmth"] - extra["warmth"].mean(),
        "time": u**2,
        "range_rate": extra["range_rate"] / max(np.nanmax(np.abs(extra["range_rate"])), 1e-9),
    }
    for name, values in others.items():
        rows += _each(f"pointing*{name}", f"{name} times the angle", angle * np.nan_to_num(values)[:, None])
    return rows


def _of_the_orbit(view):
    """Latitude, sunlight and range rate."""
    extra = view.context.extra
    rows = []
    for cycles in CYCLES:
        phase = cycles * extra["argument"]
        wave = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        rows.append(("latitude", f"wave of {cycles:g} cycles a revolution", ["range_sine", "range_cosine"], wave))
    rows.append(("eclipse", "sunlight", ["range"], extra["sunlit"]))
    for lag in (60.0, 200.0, 2000.0):
        keep = np.exp(-1 / lag)
        rows.append(
            (
                "eclipse",
                f"sunlight with a lag of {lag:g} s",
                ["range"],
                lfilter([1 - keep], [1, -keep], extra["sunlit"]),
            )
        )
    return rows


def _of_time(view):
    """Decays from the start of every sub-manoeuvre."""
    time, rows = view.context.time, []
    starts = [arc.time[0] for arc in view.arcs]
    for decay in SETTLING_S:
        shape = np.zeros(time.size)
        for start in starts:
            since = time - start
            shape += np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0)
        rows.append(("time", f"decay of {decay:g} s from the start of a manoeuvre", ["range"], shape))
    return rows
