"""Regressors from the measured channels, for effects that are in no list."""

from __future__ import annotations

import numba
import numpy as np

UNIT = {"linear": "m s-2", "angular": "rad s-2"}


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


def series(view, aligned) -> list[tuple[str, str, np.ndarray]]:
    """Drivers of one manoeuvre on its accelerometer epochs, each of unit size.

    Parameters
    ----------
    view : View
    aligned : Dataset, "align"

    Returns
    -------
    rows : list of (driver channel, form, (n,) 1)
    """
    c = view.context
    total = c.dipole_b.sum(axis=1) / max(np.abs(c.dipole_b).max(), 1e-30)
    strength = np.linalg.norm(c.field_b, axis=1)
    position = aligned["position_e"].values
    sine = np.interp(c.time, aligned["time_orbit"].values, position[:, 2] / np.linalg.norm(position, axis=1))
    start, stop = c.time[0], c.time[-1]
    u = (c.time - start) / (stop - start)
    rows = [("torquer_current*field", "current times field strength", total * strength * 2e4)]
    rows += [("torquer_current*latitude", "current times sine of latitude", total * sine)]
    rows += [("torquer_current*time", "current growing along the manoeuvre", total * (u - 0.5))]
    rows += [("torquer_current", f"squared, lag {t:g} s", _lagged(c.time, total**2, t)) for t in (0.5, 2.0, 10.0)]
    rows += [("torquer_current", f"lag {t:g} s", _lagged(c.time, total, t)) for t in (0.5, 2.0, 6.0, 20.0)]
    rows += [("torquer_current", f"hysteresis of {w:g} of full", _play(total, w)) for w in (0.3, 0.6, 1.0, 1.5)]
    rows += _edges(view)
    rows += [("time", f"decay {t:g} s from the start", np.exp(-(c.time - start) / t)) for t in (15.0, 40.0, 80.0)]
    rows += [("time", "saw-tooth of the second", (view.scene.time % 1.0) - 0.5)]
    rate = c.rate_b - c.rate_b.mean(axis=0)
    rate = rate / max(np.abs(rate).max(), 1e-30)
    rows += [("rate", f"product {a}{b}", rate[:, i] * rate[:, j]) for a, i, b, j in _PAIRS]
    rows += [("rate", f"component {'xyz'[i]}", rate[:, i]) for i in range(3)]
    return rows


_PAIRS = [(a, i, b, j) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if j >= i]


def _edges(view):
    """Decays after each edge, with the sign of the change and without."""
    time, arc = view.context.time, view.scene.window.arc
    total = arc.dipole_b.sum(axis=1)
    change = np.diff(total, prepend=0.0, append=0.0)
    edges = arc.edges + view.scene.shift
    big = np.abs(change) > 0.5 * np.abs(change).max()
    rows = []
    for decay in (0.3, 0.7, 2.0):
        since = time[:, None] - edges[big]
        shape = np.where(since >= 0, np.exp(-np.clip(since, 0, None) / decay), 0.0)
        rows.append(("torquer_edges", f"decay {decay:g} s, signed", shape @ np.sign(change[big])))
        rows.append(("torquer_edges", f"decay {decay:g} s, unsigned", shape.sum(axis=1)))
    return rows


def candidates(views, aligned, felt) -> list[dict]:  # noqa: ARG001 - torque drivers come later
    """Every driver in the linear and in the angular channel, three axes each.

    Parameters
    ----------
    views : list of View
    aligned : Dataset, "align"
    felt : what an angular acceleration does to the accelerometer
    """
    tables = [series(v, aligned) for v in views]
    found = []
    for channel, unit in UNIT.items():
        for k, (driver, form, _) in enumerate(tables[0] if tables else []):
            columns = [v.rows({channel: _three(v, t[k][2])}) for v, t in zip(views, tables, strict=True)]
            label = f"{channel} reading, {form}"
            entry = {"cause": f"unknown:{driver}", "form": label, "names": [f"{channel}_{a}" for a in "xyz"]}
            found.append(entry | {"units": [unit] * 3, "columns": [*columns, None]})
    return found


def _three(view, shape):
    resampled = view.scene.operator(shape)
    return np.einsum("n,ac->nac", resampled, np.eye(3))
