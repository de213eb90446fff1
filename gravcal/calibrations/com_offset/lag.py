"""First-order lag of the torque rods, fitted beside edge times that are free parameters themselves.

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
#: s, by which the search for a lead reaches below zero and beyond 1.3 times the lag.
SLACK_S = 0.05
LEADS, LEVELS = 12, 3  # tried at once, and how often about the best of them: to a millisecond
SHORTEST_S, LONGEST_S = 0.01, 4.0


def usual_lead(tau: float) -> float:
    """Lead (s) expected of a lag tau (s) for a wave fitted in a band of 2 Hz: tau if short, a smaller share if long."""
    return tau / (1 + tau / 2.0)


def signal(one: Manoeuvre, tau: float, leads) -> dict[str, np.ndarray]:
    """Signal {channel: (samples, 3, q)} of a lag tau (s): rods that lag minus ideal rods with edges as fitted.

    Leads (q,) s: by which the commanded edges are earlier than those that the accelerometer shows.
    """
    slow = one.at(one.window.time)
    torque = np.cross(lag_swing(one.arc.edges, one.arc.dipole_b, one.shift, slow.time, tau), slow.field_b)
    angle = np.linalg.solve(slow.inertia_b, torque.T).T
    attitude = {"attitude": np.repeat(angle[..., None], len(leads), axis=2)}
    return at_accelerometer(one, _acceleration(one, tau, leads)) | attitude


def _acceleration(view, tau, leads):
    """Angular acceleration (n, 3, q) rad s-2 of lagging rods minus that of ideal rods with edges as fitted."""
    arc, time = view.arc, view.context.time
    edges = arc.edges + view.acc_shift
    missing, _ = lag_missing(arc.edges, arc.dipole_b, tau)
    dipole = lagging(time, edges, arc.dipole_b, missing, tau, np.asarray(leads, dtype=float))

    def of_unit_dipoles(view):
        torque = np.stack([np.cross(unit, view.context.field_b) for unit in np.eye(3)], axis=2)
        return np.linalg.inv(view.context.inertia_b) @ torque

    return view.remembered(("unit", CAUSE), of_unit_dipoles) @ (dipole - view.context.dipole_b[:, :, None])


def per_second(one: Manoeuvre, tau: float, lead: float) -> dict[str, np.ndarray]:
    """Signal {channel: (samples, 3, 1)} of a lag tau (s) with one lead (s), divided by tau."""
    return {channel: values / tau for channel, values in signal(one, tau, [lead]).items()}


def lead_of(one: Manoeuvre, tau: float, rest: np.ndarray, basis: np.ndarray) -> float:
    """Lead (s) of largest chi-square gain in a whitened residual (n,) beside local columns of basis (n, r)."""
    angular = one.place("angular")
    rest, basis = rest[angular], np.ascontiguousarray(basis[angular].T)

    def gain(leads):
        rows = one.whitened_channel("angular", _acceleration(one, tau, leads))
        local_part = basis @ rows
        return 2 * rest @ rows - np.einsum("nq,nq->q", rows, rows) + np.einsum("rq,rq->q", local_part, local_part)

    return _largest(gain, tau)


def lead_in_records(one: Manoeuvre, tau: float, measured: np.ndarray) -> float:
    """Lead (s) at which a lag best fits a measured angular acceleration (n, 3) rad s-2 beside a quadratic drift."""
    operator = one.operator
    drift = np.linalg.qr(polynomial(operator.time, 2, operator.time[0], operator.time[-1])[operator.valid])[0]

    def rows(values):
        filtered = operator(values)[operator.valid].reshape(len(drift), -1)
        return filtered - drift @ (drift.T @ filtered)

    residual = rows(np.nan_to_num(measured) - one.context.rate_dot_b).ravel()

    def gain(leads):
        columns = rows(_acceleration(one, tau, leads)).reshape(residual.size, -1)
        return 2 * residual @ columns - np.einsum("nq,nq->q", columns, columns)

    return _largest(gain, tau)


def _largest(gain, tau):
    """Lead (s) that maximises `gain`, leads (q,) s -> (q,), on three grids, each finer about the best of the last."""
    low, high = -SLACK_S, 1.3 * tau + SLACK_S
    for _ in range(LEVELS):
        leads = np.linspace(low, high, LEADS)
        best, step = leads[int(np.argmax(gain(leads)))], leads[1] - leads[0]
        low, high = best - step, best + step
    return float(best)


def edge_rows(views: list[Manoeuvre], smoothed: xr.Dataset, tau: float, leads) -> np.ndarray:
    """Whitened rows (k + 1, 1) that a lag tau (s), with a lead (s) in each view, adds to the edge times.

    The star camera sees the edges later by the lag, the accelerometer by the lead.
    """
    lead_s = np.full(smoothed["acc_shift"].size, usual_lead(tau))
    lead_s[[one.index for one in views]] = leads
    return whitened_edges(smoothed, np.append(lead_s - tau, lead_s.mean()))[:, None]


def shape(views: list[Manoeuvre], smoothed: xr.Dataset, tau: float) -> Shape:
    """Shape of a lag: tau (s) refined from about one that was tried, with the best lead in each manoeuvre."""

    def inside(value, rest, bases):
        count = len(views)
        rows = zip(views, rest[:count], bases[:count], strict=True)
        return np.array([lead_of(view, value[0], residual[:, 0], b) for view, residual, b in rows])

    def columns(value, leads):
        made = [view.whitened(per_second(view, value[0], lead)) for view, lead in zip(views, leads, strict=True)]
        return [*made, edge_rows(views, smoothed, value[0], leads) / value[0]]

    tried = tau * np.geomspace(0.4, 2.5, 9)[:, None]
    ends = np.array([SHORTEST_S]), np.array([LONGEST_S])
    return Shape(("tau",), ("s",), np.array([tau]), columns, tried, *ends, inside=inside, sized=True)


def leads(views: list[Manoeuvre], chosen) -> tuple[Lead, ...]:
    """Lead record of each manoeuvre, from the chosen leads (k,) s."""
    return tuple(Lead(float(one.time[0]), float(lead)) for one, lead in zip(views, chosen, strict=True))


def placed(one: Manoeuvre, entry: Entry, records) -> Entry:
    """Entry of a lag with its lead in a manoeuvre, fitted to the records unless the entry knows it."""
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
    """Time constant (s) of an entry of a model, NaN where it has none."""
    return entry.values.get("tau", np.nan)


def known_lead(one: Manoeuvre, entry: Entry) -> float | None:
    """Lead s in a manoeuvre, None where the entry does not know it."""
    return next((record.lead for record in entry.leads if abs(record.start - one.time[0]) < 5.0), None)


def whitened_edges(smoothed: xr.Dataset, delays: np.ndarray) -> np.ndarray:
    """Edge times (k + 1,) s, or a column of partial derivatives of them, whitened by their covariance; 0 if unknown.

    They are accelerometer minus star-camera edges in each manoeuvre, then the delay against telemetry. Momentary
    readings do not show where between two samples an edge falls: the wave's period is a whole number of samples, so
    that all edges of a manoeuvre fall on the same part of it. Those commanded a whole number of samples apart share it,
    others do not, and no record says which: the covariance has an error of a sample / sqrt(12) of all and one of each.
    """
    steps = np.diff(smoothed["time_acc"].values)
    quantisation = float(np.median(steps)) ** 2 / 12 if steps.size else 0.0
    sigmas = smoothed["acc_shift_sigma"].values, smoothed["sca_shift_sigma"].values
    variance = np.append(sigmas[0] ** 2 + sigmas[1] ** 2, float(smoothed["acc_delay_sigma"]) ** 2) + quantisation
    usable = np.flatnonzero(np.isfinite(variance) & (variance > 0))
    rows = np.zeros(np.shape(delays))
    root = np.linalg.cholesky(np.diag(variance[usable]) + quantisation)
    rows[usable] = solve_triangular(root, delays[usable], lower=True)
    return rows
