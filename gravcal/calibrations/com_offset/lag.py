"""First-order lag of the torque rods, seen behind edges that are free themselves.

A rod that lags by tau follows each jump D of the commanded dipole with D (1 - exp(-t / tau)). A fit of a square wave
takes that for later edges, so that only the shape of the edges tells a lag. The edge that was commanded lies a *lead*
before the one that was fitted; where it falls between two samples is known in no manoeuvre beforehand, and for a short
lag it decides on how much of the exponential is left at the next sample. It is fitted with tau.
"""

from dataclasses import replace

import numpy as np
import xarray as xr
from scipy.linalg import solve_triangular

from gravcal.calibrations.com_offset.manoeuvre import Manoeuvre, at_accelerometer
from gravcal.effects.torque import lag_missing, lag_swing, lagging
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


def signal(one: Manoeuvre, tau: float, leads) -> dict[str, np.ndarray]:
    """What a lag does to the readings beside edges as they were fitted, {channel: (samples, 3, q)}.

    Leads (q,) s: by which the commanded edges are earlier than those that the accelerometer shows.
    """
    slow = one.at(one.window.time)
    torque = np.cross(lag_swing(one.arc.edges, one.arc.dipole_b, one.shift, slow.time, tau), slow.field_b)
    angle = np.linalg.solve(slow.inertia_b, torque.T).T
    attitude = {"attitude": np.repeat(angle[..., None], len(leads), axis=2)}
    return at_accelerometer(one, _acceleration(one, tau, leads)) | attitude


def _acceleration(one, tau, leads):
    """Angular acceleration (n, 3, q) rad s-2 of lagging rods less that of the edges as they were fitted."""
    arc, time = one.arc, one.context.time
    edges = arc.edges + one.acc_shift
    missing, _ = lag_missing(arc.edges, arc.dipole_b, tau)
    dipole = lagging(time, edges, arc.dipole_b, missing, tau, np.asarray(leads, dtype=float))

    def of_unit_dipoles(one):
        torque = np.stack([np.cross(unit, one.context.field_b) for unit in np.eye(3)], axis=2)
        return np.linalg.inv(one.context.inertia_b) @ torque

    return one.remembered(("unit", CAUSE), of_unit_dipoles) @ (dipole - one.context.dipole_b[:, :, None])


def per_second(one: Manoeuvre, tau: float, lead: float) -> dict[str, np.ndarray]:
    """The same per second of lag, for one lead."""
    return {channel: values / tau for channel, values in signal(one, tau, [lead]).items()}


def lead_of(one: Manoeuvre, tau: float, rest: np.ndarray, basis: np.ndarray) -> float:
    """Lead s that takes most from a whitened residual (n,) without local columns, of which (n, r) is the basis."""
    there = one.place("angular")
    rest, basis = rest[there], np.ascontiguousarray(basis[there].T)

    def gain(leads):
        rows = one.whitened_channel("angular", _acceleration(one, tau, leads))
        inside = basis @ rows
        return 2 * rest @ rows - np.einsum("nq,nq->q", rows, rows) + np.einsum("rq,rq->q", inside, inside)

    return _largest(gain, tau)


def lead_in_records(one: Manoeuvre, tau: float, measured: np.ndarray) -> float:
    """Lead s at which a lag describes an angular acceleration (n, 3) rad s-2 measured at the epochs best."""
    operator = one.operator
    drift = np.linalg.qr(polynomial(operator.time, 2, operator.time[0], operator.time[-1])[operator.valid])[0]

    def rows(values):
        low = operator(values)[operator.valid].reshape(len(drift), -1)
        return low - drift @ (drift.T @ low)

    rest = rows(np.nan_to_num(measured) - one.context.rate_dot_b).ravel()

    def gain(leads):
        each = rows(_acceleration(one, tau, leads)).reshape(rest.size, -1)
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


def edge_rows(views: list[Manoeuvre], smoothed: xr.Dataset, tau: float, leads) -> np.ndarray:
    """What a lag adds to the whitened rows of the edge times, (k + 1, 1).

    The star camera sees the edges later by the lag, the accelerometer by the lead.
    """
    each = np.full(smoothed["acc_shift"].size, usual_lead(tau))
    each[[one.index for one in views]] = leads
    return whitened_edges(smoothed, np.append(each - tau, each.mean()))[:, None]


def shape(views: list[Manoeuvre], smoothed: xr.Dataset, tau: float) -> Shape:
    """Shape of a lag about one that was tried."""

    def inside(value, rest, bases):
        count = len(views)
        rows = zip(views, rest[:count], bases[:count], strict=True)
        return np.array([lead_of(one, value[0], r[:, 0], b) for one, r, b in rows])

    def columns(value, leads):
        made = [one.whitened(per_second(one, value[0], lead)) for one, lead in zip(views, leads, strict=True)]
        return [*made, edge_rows(views, smoothed, value[0], leads) / value[0]]

    tried = tau * np.geomspace(0.4, 2.5, 9)[:, None]
    ends = np.array([SHORTEST_S]), np.array([LONGEST_S])
    return Shape(("tau",), ("s",), np.array([tau]), columns, tried, *ends, inside=inside, sized=True)


def leads(views: list[Manoeuvre], chosen) -> tuple[Lead, ...]:
    """Leads of the manoeuvres."""
    return tuple(Lead(float(one.time[0]), float(lead)) for one, lead in zip(views, chosen, strict=True))


def placed(one: Manoeuvre, entry: Entry, records) -> Entry:
    """Entry of a model that knows the lead in a manoeuvre, from the records where it did not."""
    if known_lead(one, entry) is not None or not _tau(entry) > 0:
        return entry
    lead = lead_in_records(one, _tau(entry), records["angular_b"].values[one.rows])
    return replace(entry, leads=leads([one], [lead]))


def contribution(one: Manoeuvre, entry: Entry) -> dict[str, np.ndarray]:
    """What an entry of a model adds to the channels of a manoeuvre, {channel: (samples, 3)}."""
    tau, lead = _tau(entry), known_lead(one, entry)
    if not tau > 0:
        return {}
    added = signal(one, tau, [usual_lead(tau) if lead is None else lead])
    return {channel: values[:, :, 0] for channel, values in added.items()}


def _tau(entry):
    return entry.values.get("tau", np.nan)


def known_lead(one: Manoeuvre, entry: Entry) -> float | None:
    """Lead s in a manoeuvre, None where the entry does not know it."""
    return next((each.lead for each in entry.leads if abs(each.start - one.time[0]) < 5.0), None)


def whitened_edges(smoothed: xr.Dataset, delays: np.ndarray) -> np.ndarray:
    """Edge times (k + 1,) s, or a column of them, over their error; 0 for those without one.

    They are edges of the accelerometer less those of the star camera in each manoeuvre, and against telemetry. Where
    between two samples of the accelerometer an edge falls cannot be told from momentary readings: the wave's period is
    a whole number of samples, so that all edges of a manoeuvre fall on the same part of it. Manoeuvres that are
    commanded a whole number of samples apart share it, others do not; which, no record says, and the covariance holds
    one error of a sample over the square root of 12 that all share and one of each.
    """
    steps = np.diff(smoothed["time_acc"].values)
    between = float(np.median(steps)) ** 2 / 12 if steps.size else 0.0
    parts = smoothed["acc_shift_sigma"].values, smoothed["sca_shift_sigma"].values
    each = np.append(parts[0] ** 2 + parts[1] ** 2, float(smoothed["acc_delay_sigma"]) ** 2) + between
    known = np.flatnonzero(np.isfinite(each) & (each > 0))
    rows = np.zeros(np.shape(delays))
    root = np.linalg.cholesky(np.diag(each[known]) + between)
    rows[known] = solve_triangular(root, delays[known], lower=True)
    return rows
