"""Columns of every effect of the catalogue that a ranging calibration can show, and of the measured channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.calibrations.kbr_phase_centre import discovery_drivers
from gravcal.calibrations.kbr_phase_centre.discovery_view import Arc, View, filtered, white
from gravcal.effects import catalogue

BREAK = "ranging.phase_break"
FAMILIES = ("ranging", "timing", "attitude")
#: Searched for along the time axis below; the calibration itself.
NOT_HERE = (BREAK, "ranging.phase_centre")
BREAK_STEP_S = 30.0
#: Closer together where a half ends, which leaves only a few epochs of a break to be seen.
NEAR_CUT_S = np.arange(-55.0, 56.0, 10.0)
FILTER_S = 35.0  # half of the filter of the ranging
#: Distance of a phase break from the ends of its manoeuvre, s: half of the filter and some epochs.
BREAK_MARGIN_S = 60.0


def shapes(view: View) -> list[dict]:
    """Effects of the catalogue, as a whole and parameter by parameter, then regressors of the measured channels.

    Parameters
    ----------
    view : View

    Returns
    -------
    shapes : {"cause", "form", "names", "units", "prior", "signal"}, signal (n, q) m per parameter on whole seconds
    """
    found = [one for one in map(lambda e: _of(view, e), _entries()) if one is not None]
    return found + discovery_drivers.shapes(view)


def _entries():
    return [e for s, e in catalogue().items() if s.partition(".")[0] in FAMILIES and s not in NOT_HERE]


def _of(view, entry):
    """Shape of one effect; None where no ranging feels its channel."""
    if entry.channel == "range":
        signal = entry.columns(view.context)
    elif entry.channel == "sca_delay":
        signal = _late(view) * entry.columns(view.context)
    elif entry.channel == "pointing_b":
        signal = _turned(view, entry.columns(view.context))
    else:
        return None
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    prior = [p.prior_sigma for p in entry.parameters]
    return {"cause": entry.slug, "form": "", "names": names, "units": units, "prior": prior, "signal": signal}


def _late(view):
    """Range (n, 1) m that star cameras late by a second add to ranging minus orbit.

    The measured line of sight is that of an attitude too old: l = l_true - delay * turning, and the orbit side of
    the residual holds -l . c.
    """
    return -np.einsum("nka,ka->n", view.turning_b, view.centre.reshape(2, 3))[:, None]


def _turned(view, angle_b):
    """Range (n, q) m per parameter of a rotation (n, 3, q) rad from true to measured attitude, -phi . sum l x c."""
    line = view.context.extra["line_of_sight_b"]
    arm = np.cross(line, view.centre.reshape(2, 3)).sum(axis=1)
    return -np.einsum("na,naq->nq", arm, angle_b)


def table(view: View, shapes: list[dict]) -> np.ndarray:
    """Columns (m, q) m of all shapes side by side at the ranging epochs.

    Parameters
    ----------
    view : View
    shapes : of `shapes`
    """
    return filtered(view, np.concatenate([s["signal"] for s in shapes], axis=1))


def candidates(view: View, factors: list[np.ndarray], shapes: list[dict], columns: np.ndarray) -> list[dict]:
    """Fields of `gravcal.discovery.blocks.Candidate`.

    Parameters
    ----------
    view : View
    factors : of `discovery_view.factors`
    shapes : of `shapes`
    columns : of `table`
    """
    rows = [white(factor, columns[arc.rows]) for arc, factor in zip(view.arcs, factors, strict=True)]
    found, first = [], 0
    for shape in shapes:
        last = first + len(shape["names"])
        fixed = {n: shape[n] for n in ("cause", "form", "names", "units", "prior")}
        found += split(fixed | {"columns": [r[:, first:last] for r in rows]})
        first = last
    return found + _breaks(view, factors)


def split(whole: dict) -> list[dict]:
    """An effect with all its parameters, then with each alone; a regressor as it is.

    Parameters
    ----------
    whole : fields of Candidate
    """
    if len(whole["names"]) == 1 or whole["cause"].startswith("unknown:"):
        return [whole]
    found = [whole]
    for k, name in enumerate(whole["names"]):
        one = {"names": [name], "units": [whole["units"][k]], "prior": [whole["prior"][k]]}
        columns = [c[:, k : k + 1] for c in whole["columns"]]
        found.append(whole | one | {"form": f"{name} alone", "columns": columns})
    return found


def _breaks(view, factors):
    """A phase break in one sub-manoeuvre at each of many epochs."""
    whole, found = {}, []
    for arc in view.arcs:
        whole.setdefault(arc.label.rpartition(" ")[0], []).append(arc)
    for members in whole.values():
        epochs = np.arange(members[0].time[0] + BREAK_MARGIN_S, members[-1].time[-1] - BREAK_MARGIN_S, BREAK_STEP_S)
        cuts = [arc.time[0] + NEAR_CUT_S for arc in members[1:]]
        found += breaks(view, factors, np.unique(np.concatenate([epochs, *cuts])))
    return found


def breaks(view: View, factors: list[np.ndarray], epochs: np.ndarray) -> list[dict]:
    """Phase breaks at given epochs of one sub-manoeuvre, fields of Candidate.

    Parameters
    ----------
    view : View
    factors : of `discovery_view.factors`
    epochs : (k,) s
    """
    near = [k for k, arc in enumerate(view.arcs) if any(_felt(arc, epoch) for epoch in epochs)]
    columns = {k: white(factors[k], steps(view, view.arcs[k], epochs)) for k in near}
    found = []
    for i, epoch in enumerate(epochs):
        parts = [
            columns[k][:, i : i + 1] if k in columns and _felt(arc, epoch) else None for k, arc in enumerate(view.arcs)
        ]
        label = next(arc.label for arc in view.arcs if _felt(arc, epoch)).rpartition(" ")[0]
        one = {"cause": BREAK, "form": f"{label}, time {epoch:.0f} s", "names": ["size"], "units": ["m"]}
        found.append(one | {"prior": [1e-2], "columns": parts})
    return found


def _felt(arc, epoch):
    """Whether the filter carries a break at an epoch into a half."""
    return arc.time[0] - FILTER_S < epoch < arc.time[-1] + FILTER_S


def steps(view: View, arc: Arc, epochs: np.ndarray) -> np.ndarray:
    """Columns (n, k) of a range that is longer from an epoch on, at the rows of one sub-manoeuvre.

    Parameters
    ----------
    view : View
    arc : Arc
    epochs : (k,) s
    """
    part = view.through
    cut = {name: getattr(part, name)[arc.rows] for name in ("time", "start", "weights", "valid")}
    return replace(part, **cut)((view.context.time[:, None] >= epochs).astype(float))
