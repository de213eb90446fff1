"""Regressors from the measured channels, for effects that are in no list."""

from __future__ import annotations

import numba
import numpy as np

UNITS = {"linear": "m s-2", "angular": "rad s-2"}
LAGS_S = (0.5, 2.0, 6.0, 20.0)
DECAYS_S = (0.3, 0.7, 2.0)
PLAY = (0.3, 0.6, 1.0, 1.5)  # widths of a play operator, in units of the largest current
SETTLING_S = (15.0, 40.0, 80.0)
CYCLES = (10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 100.0)  # of a sine, per radian of latitude


@numba.njit(cache=True)
def _lagged(time, values, lag):
    out, state = np.empty_like(values), values[0]
    for k in range(values.size):
        step = time[k] - time[k - 1] if k else 0.0
        state = values[k] + (state - values[k]) * np.exp(-step / lag)
        out[k] = state
    return out


@numba.njit(cache=True)
def _play(values, width):
    out, state = np.empty_like(values), 0.0
    for k in range(values.size):
        state = min(max(state, values[k] - width / 2), values[k] + width / 2)
        out[k] = state
    return out


def series(view) -> list[tuple[str, str, np.ndarray]]:
    """Drivers of one manoeuvre on its accelerometer epochs, each of a size near one.

    Parameters
    ----------
    view : View

    Returns
    -------
    rows : list of (driver channels, form, (n, k) 1)
    """
    key = "drivers"
    if key not in view.memory:
        current, field, rate, angle, latitude, u = base = _base(view)
        rows = _of_current(view, current) + _of_products(base)
        rows += [("latitude", f"sine of {k:g} times it", _wave(k * latitude)) for k in CYCLES]
        rows += [("time", f"decay {t:g} s from the start", np.exp(-(u * 180.0) / t)) for t in SETTLING_S]
        rows += [("time", "saw-tooth of the second", (view.scene.time % 1.0) - 0.5)]
        rows += [("eclipse", "sunlight with a lag", view.context.extra["warmth"])]
        rows += [("field", f"component {'xyz'[i]}", field[:, i]) for i in range(3)]
        view.memory[key] = [(a, b, c[:, None] if c.ndim == 1 else c) for a, b, c in rows]
    return view.memory[key]


def _wave(phase):
    return np.stack([np.sin(phase), np.cos(phase)], axis=1)


def _base(view):
    """Current 1, field 1, rate 1, pointing 1, latitude rad, time 1 of the manoeuvre."""
    c = view.context
    current = c.dipole_b.sum(axis=1) / max(np.abs(c.dipole_b).max(), 1e-30)
    rate = c.rate_b - c.rate_b.mean(axis=0)
    step = np.diff(c.time, prepend=c.time[0])[:, None]
    angle = np.cumsum(rate * step, axis=0)
    position = np.stack([np.interp(c.time, view.orbit[0], p) for p in view.orbit[1].T], axis=1)
    latitude = np.arcsin(position[:, 2] / np.linalg.norm(position, axis=1))
    u = (c.time - c.time[0]) / (c.time[-1] - c.time[0])
    scaled = (rate / max(np.abs(rate).max(), 1e-30), (angle - angle.mean(axis=0)) / max(np.abs(angle).max(), 1e-30))
    return current, c.field_b * 2e4, *scaled, latitude, u


def _of_current(view, current):
    """Functions of the torquer current alone."""
    time = view.context.time
    rows = [("torquer_current", "itself", current), ("torquer_current", "squared", current**2)]
    rows += [("torquer_current", f"squared, lag {t:g} s", _lagged(time, current**2, t)) for t in LAGS_S]
    rows += [("torquer_current", f"lag {t:g} s", _lagged(time, current, t)) for t in LAGS_S]
    rows += [("torquer_current", f"hysteresis of {w:g} of full", _play(current, w)) for w in PLAY]
    for decay in DECAYS_S:
        spikes = _spikes(view, decay)
        rows.append(("torquer_current", f"spikes at its edges, {decay:g} s, with their sign", spikes[0]))
        rows.append(("torquer_current", f"spikes at its edges, {decay:g} s, without sign", spikes[1]))
    return rows


def _spikes(view, decay):
    """Decays after each large change of the current, with the sign of the change and without."""
    time, arc = view.context.time, view.scene.window.arc
    change = np.diff(arc.dipole_b.sum(axis=1), prepend=0.0, append=0.0)
    big = np.abs(change) > 0.4 * np.abs(change).max()
    since = time[:, None] - (arc.edges + view.scene.shift)[big]
    shape = np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0)
    return shape @ np.sign(change[big]), shape.sum(axis=1)


def _of_products(base):
    """Products of two channels, and the channels that the current is multiplied with."""
    current, field, rate, angle, latitude, u = base
    strength = np.linalg.norm(field, axis=1)
    rows = [("torquer_current*field", "current times field strength", current * strength)]
    rows += [("torquer_current*field", f"current times field {'xyz'[i]}", current * field[:, i]) for i in range(3)]
    rows += [("torquer_current*latitude", "current times sine of latitude", current * np.sin(latitude))]
    rows += [("torquer_current*time", "current growing along the manoeuvre", current * (u - 0.5))]
    for name, channel in (("rate", rate), ("attitude", angle)):
        rows += [(name, f"component {'xyz'[i]}", channel[:, i]) for i in range(3)]
        rows += [
            (name, f"product {'xyz'[i]}{'xyz'[j]}", channel[:, i] * channel[:, j])
            for i in range(3)
            for j in range(i, 3)
        ]
    return rows


def shapes(view) -> list[dict]:
    """Every driver in the linear and in the angular reading, three axes each.

    Parameters
    ----------
    view : View, any of the event

    Returns
    -------
    shapes : {"cause", "form", "names", "units", "prior", "signal"}, signal: View -> signal
    """
    found = []
    for channel, unit in UNITS.items():
        for k, (driver, form, shape) in enumerate(series(view)):
            width = shape.shape[1]
            names = [f"{channel}_{a}_{w}" if width > 1 else f"{channel}_{a}" for w in range(width) for a in "xyz"]
            fixed = {"cause": f"unknown:{driver}", "form": f"{channel} reading, {form}", "names": names}
            fixed |= {"units": [unit] * len(names), "prior": []}
            found.append(fixed | {"signal": _signal(channel, k)})
    return found


def _signal(channel, index):
    def signal(view):
        shape = series(view)[index][2]
        return {channel: np.einsum("nw,ac->nawc", shape, np.eye(3)).reshape(len(shape), 3, -1)}

    return signal
