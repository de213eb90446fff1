"""Ranging and attitudes less what an extended model says that its effects add to them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import discovery_drivers
from gravcal.calibrations.kbr_phase_centre.align import interpolated
from gravcal.calibrations.kbr_phase_centre.discovery_view import View, view
from gravcal.calibrations.kbr_phase_centre.schemas import OBSERVABLES
from gravcal.effects import effect
from gravcal.effects.entries import determined
from gravcal.estimation import crn
from gravcal.physics import frames


def extend(aligned, pointed, equations, measured, solved, *, model, crn_window_s, crn_bandwidth_hz, **about):
    """Aligned records without the effects of a model, so that the baseline describes what is left.

    Readings less the contribution of their effects through the filter of the ranging; attitudes turned back, at the
    time that their tags should have had. A line is left where it is: its phase differs between manoeuvres.

    Parameters
    ----------
    aligned, pointed, equations, measured, solved : Dataset, products of kbr_phase_centre, of the range
    model : list of {"cause", "form", "parameters": {name: {"value"}}}
    crn_window_s, crn_bandwidth_hz : s and Hz, of the filter
    about : nominal_m and orbit_degree, as of `discovery_view.view`

    Returns
    -------
    extended : Dataset, "kbr_phase_centre.align"
    """
    filters = {"crn_window_s": crn_window_s, "crn_bandwidth_hz": crn_bandwidth_hz}
    seen = view(aligned, pointed, equations, measured, solved, **filters, **about)
    extended = aligned.copy(deep=True)
    total = np.zeros(seen.context.time.size)
    for entry in model:
        added = contribution(seen, entry)
        if added is not None:
            total += np.where(np.isfinite(added), added, 0.0)
        else:
            _corrected(extended, entry, seen)
    _subtract(extended, pointed, total, crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz))
    return extended.assign_attrs(model=" ".join(e["cause"] for e in model))


def contribution(seen: View, entry: Mapping) -> np.ndarray | None:
    """What an entry of a model adds to the range (n,) m on whole seconds; None where it is no effect of the range.

    Parameters
    ----------
    seen : View
    entry : {"cause", "form", "parameters"}
    """
    values = determined(entry)
    if entry["cause"].startswith("unknown:"):
        shapes = discovery_drivers.shapes(seen)
        found = [s for s in shapes if (s["cause"], s["form"]) == (entry["cause"], entry["form"])]
        weights = [[values.get(n, 0.0) for n in s["names"]] for s in found]
        return sum(
            (s["signal"] @ np.array(w) for s, w in zip(found, weights, strict=True)), start=0.0 * seen.context.time
        )
    known = effect(entry["cause"])
    return known.contribution(seen.context, known.values(values)) if known.channel == "range" else None


def _corrected(extended, entry, seen):
    """Attitudes without a delay of their tags or a turn of their frame, in place."""
    known = effect(entry["cause"])
    added = known.contribution(seen.context, known.values(determined(entry)))
    values = extended["quaternion"].values
    for k in (0, 1):
        good = np.isfinite(values[k]).all(axis=1)
        if known.channel == "sca_delay":
            time = seen.context.time
            moved = interpolated(time[good], values[k][good], np.clip(time + added, *time[good][[0, -1]]), 10.0)
            values[k] = moved / np.linalg.norm(moved, axis=1, keepdims=True)
        elif known.channel == "pointing_b":
            values[k][good] = frames.quaternion_product(values[k][good], frames.from_rotation_vector(-added[good]))


def _subtract(extended: xr.Dataset, pointed: xr.Dataset, total, filter_):
    """Range, rate and acceleration less a contribution on whole seconds, in place."""
    if not total.any():
        return
    time, at = pointed["time"].values, extended["time_kbr"].values
    good = pointed["usable"].values != 0
    for derivative, name in enumerate(OBSERVABLES):
        operator = crn.operator(filter_, derivative, good, (time[0], 1.0), at)
        extended[f"reading_{name}"].values[:] -= np.where(operator.valid, operator(total), 0.0)
