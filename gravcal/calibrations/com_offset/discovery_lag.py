"""First-order lag of the torque rods, seen behind edges that are free themselves.

A rod that lags by tau follows each jump D of the commanded dipole with D (1 - exp(-t / tau)). A fit of a square wave
takes that for later edges, so that only the shape of the edges tells a lag. The edge that was commanded lies a *lead*
before the one that was fitted; where it falls between two samples is known in no manoeuvre beforehand, and for a short
lag it decides on how much of the exponential is left at the next sample. It is fitted with tau.
"""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import xarray as xr

from gravcal.calibrations.com_offset import discovery_timing, motion
from gravcal.calibrations.com_offset.discovery_view import View, felt
from gravcal.estimation.least_squares import polynomial
from gravcal.estimation.records import Entry, Lead, Shape

CAUSE = "torque.dipole_lag"
TRIED_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
#: A lead is looked for from this much below zero to this much beyond the lag.
SLACK_S = 0.05
LEADS, LEVELS = 12, 3  # tried at once, and how often about the best of them: to a millisecond
SHORTEST_S, LONGEST_S = 0.01, 4.0


def usual_lead(tau: float) -> float:
    """Lead s of a wave fitted in a band of 2 Hz: all of a short lag, less of a long one."""
    return tau / (1 + tau / 2.0)


def signal(view: View, tau: float, leads) -> dict[str, np.ndarray]:
    """What a lag does to the readings beside edges as they were fitted, {channel: (samples, 3, q)}.

    Parameters
    ----------
    view : View
    tau : s
    leads : (q,) s, by which the commanded edges are earlier than those that the accelerometer shows
    """
    slow = view.at(view.scene.sca_time)
    torque = np.cross(_swung(view.scene, slow.time, tau), slow.field_b)
    angle = np.linalg.solve(slow.inertia_b, torque.T).T
    attitude = {"attitude": np.repeat(angle[..., None], len(leads), axis=2)}
    return felt(view, _acceleration(view, tau, leads)) | attitude


def _acceleration(view, tau, leads):
    """Angular acceleration (n, 3, q) rad s-2 of lagging rods less that of the edges as they were fitted."""
    arc, time = view.scene.window.arc, view.context.time
    edges = arc.edges + view.scene.shift
    dipole = _lagging(time, edges, arc.dipole_b, _missing(arc, tau)[0], tau, np.asarray(leads, dtype=float))
    key = ("turning", CAUSE)
    if key not in view.memory:  # what a unit dipole on each axis does
        torque = np.stack([np.cross(unit, view.context.field_b) for unit in np.eye(3)], axis=2)
        view.memory[key] = np.linalg.inv(view.context.inertia_b) @ torque
    return _turning(view.memory[key], dipole, view.context.dipole_b)


@numba.njit(cache=True)
def _turning(response, dipole, fitted):
    """Products (n, 3, q) of matrices (n, 3, 3) with dipoles (n, 3, q) less one (n, 3)."""
    out = np.zeros(dipole.shape)
    for k in range(dipole.shape[0]):
        for j in range(3):
            for q in range(dipole.shape[2]):
                more = dipole[k, j, q] - fitted[k, j]
                for i in range(3):
                    out[k, i, q] += response[k, i, j] * more
    return out


def _missing(arc, tau):
    """Dipole (m + 1, 3) that lagging rods miss after each edge, and its jump there."""
    jump = np.diff(arc.dipole_b, axis=0, prepend=np.zeros((1, 3)), append=np.zeros((1, 3)))
    missing, decay = jump.copy(), np.exp(-np.diff(arc.edges) / tau)
    for k in range(1, len(jump)):
        missing[k] += missing[k - 1] * decay[k - 1]
    return missing, jump


@numba.njit(cache=True)
def _lagging(time, edges, dipole, missing, tau, leads):
    """Dipole (n, 3, q) of lagging rods at increasing epochs, for each lead."""
    out = np.zeros((time.size, 3, leads.size))
    for q in range(leads.size):
        last = -1
        for k in range(time.size):
            at = time[k] + leads[q]
            while last + 1 < edges.size and edges[last + 1] <= at:
                last += 1
            if last < 0:
                continue
            left = np.exp(-(at - edges[last]) / tau)
            for axis in range(3):
                commanded = dipole[last, axis] if last < dipole.shape[0] else 0.0
                out[k, axis, q] = commanded - missing[last, axis] * left
    return out


def _swung(scene, time, tau):
    """Dipole (n, 3) A m2 s2, twice integrated, of lagging rods less that of edges later by the lag.

    A time t after its edge a jump D has turned the body by D (t2 / 2 - tau t + tau2 (1 - exp(-t / tau))), one that is
    late by tau by D (t - tau)2 / 2 once it has happened.
    """
    arc, first = scene.window.arc, scene.shift - tau
    missing, jump = _missing(arc, tau)
    edges = arc.edges + first
    last = np.searchsorted(edges, time, side="right") - 1
    since = np.where(last >= 0, time - edges[last], np.inf)[:, None]
    early = np.where(since < tau, (np.minimum(since, tau) - tau) ** 2 / 2, 0.0) * jump[last]
    settled = tau**2 / 2 * motion.dipole_at(arc, time, first)
    return settled - tau**2 * missing[last] * np.exp(-since / tau) + early


def column(view: View, tau: float, lead: float) -> dict[str, np.ndarray]:
    """The same per second of lag, for one lead.

    Parameters
    ----------
    view : View
    tau, lead : s
    """
    return {channel: values / tau for channel, values in signal(view, tau, [lead]).items()}


def lead_of(view: View, tau: float, rest: np.ndarray, basis: np.ndarray) -> float:
    """Lead s that takes most from a residual.

    Parameters
    ----------
    view : View
    tau : s
    rest : (n,) whitened residual of the view, own columns projected out
    basis : (n, r) orthonormal, of the own columns
    """
    there = view.place("angular")
    rest, basis = rest[there], np.ascontiguousarray(basis[there].T)

    def gain(leads):
        rows = view.rows_of("angular", _acceleration(view, tau, leads))
        inside = basis @ rows
        return 2 * rest @ rows - np.einsum("nq,nq->q", rows, rows) + np.einsum("rq,rq->q", inside, inside)

    return _largest(gain, tau)


def lead_in_records(view: View, tau: float, measured: np.ndarray) -> float:
    """Lead s at which a lag describes a measured angular acceleration best.

    Parameters
    ----------
    view : View
    tau : s
    measured : (n, 3) rad s-2, at the accelerometer epochs of the view
    """
    operator = view.scene.operator
    drift = np.linalg.qr(polynomial(operator.time, 2, operator.time[0], operator.time[-1])[operator.valid])[0]

    def rows(values):
        low = operator(values)[operator.valid].reshape(len(drift), -1)
        return low - drift @ (drift.T @ low)

    rest = rows(np.nan_to_num(measured) - view.context.rate_dot_b).ravel()

    def gain(leads):
        each = rows(_acceleration(view, tau, leads)).reshape(rest.size, -1)
        return 2 * rest @ each - np.einsum("nq,nq->q", each, each)

    return _largest(gain, tau)


def _largest(gain, tau):
    """Lead of the largest gain, each time among a dozen about the best."""
    low, high = -SLACK_S, 1.3 * tau + SLACK_S
    for _ in range(LEVELS):
        leads = np.linspace(low, high, LEADS)
        best, step = leads[int(np.argmax(gain(leads)))], leads[1] - leads[0]
        low, high = best - step, best + step
    return float(best)


def edge_rows(views: list[View], smoothed: xr.Dataset, tau: float, leads) -> np.ndarray:
    """What a lag adds to the whitened rows of the edge times, (k + 1, 1).

    The star camera sees the edges later by the lag, the accelerometer by the lead.

    Parameters
    ----------
    views : list of View
    smoothed : Dataset, "com_offset.attitude"
    tau : s
    leads : one a view, s
    """
    each = np.full(smoothed["acc_shift"].size, usual_lead(tau))
    each[[v.scene.index for v in views]] = leads
    return discovery_timing.column_of(smoothed, np.append(each - tau, each.mean()))


def shape(views: list[View], smoothed: xr.Dataset, tau: float) -> Shape:
    """Shape of a lag about one that was tried.

    Parameters
    ----------
    views : list of View
    smoothed : Dataset, "com_offset.attitude"
    tau : s
    """

    def inside(value, rest, bases):
        count = len(views)
        rows = zip(views, rest[:count], bases[:count], strict=True)
        return np.array([lead_of(v, value[0], r[:, 0], b) for v, r, b in rows])

    def columns(value, leads):
        made = [v.rows(column(v, value[0], lead)) for v, lead in zip(views, leads, strict=True)]
        return [*made, edge_rows(views, smoothed, value[0], leads) / value[0]]

    tried = tau * np.geomspace(0.4, 2.5, 9)[:, None]
    ends = np.array([SHORTEST_S]), np.array([LONGEST_S])
    return Shape(("tau",), ("s",), np.array([tau]), columns, tried, *ends, inside=inside, sized=True)


def leads(views: list[View], chosen) -> tuple[Lead, ...]:
    """Leads of the manoeuvres.

    Parameters
    ----------
    views : list of View
    chosen : one a view, s
    """
    return tuple(Lead(float(v.scene.time[0]), float(lead)) for v, lead in zip(views, chosen, strict=True))


def placed(view: View, entry: Entry, records) -> Entry:
    """Entry of a model that knows the lead in a manoeuvre, from the records where it did not.

    Parameters
    ----------
    view : View
    entry : of the lag
    records : Dataset, "align", without other effects
    """
    if _known(view, entry) is not None or not _tau(entry) > 0:
        return entry
    lead = lead_in_records(view, _tau(entry), records["angular_b"].values[view.scene.rows])
    return replace(entry, leads=leads([view], [lead]))


def reading(view: View, entry: Entry) -> dict[str, np.ndarray]:
    """What an entry of a model adds to the channels of a manoeuvre, {channel: (samples, 3)}.

    Parameters
    ----------
    view : View
    entry : of the lag
    """
    tau, lead = _tau(entry), _known(view, entry)
    if not tau > 0:
        return {}
    found = signal(view, tau, [usual_lead(tau) if lead is None else lead])
    return {channel: values[:, :, 0] for channel, values in found.items()}


def _tau(entry):
    return entry.values.get("tau", np.nan)


def _known(view, entry):
    """Lead s in a manoeuvre, None where the entry does not know it."""
    start = float(view.scene.time[0])
    return next((one.lead for one in entry.leads if abs(one.start - start) < 5.0), None)
