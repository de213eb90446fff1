"""The choices of the source paper: observations detrended, columns not, identity weights, one common range bias."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre.whitened import Arc
from gravcal.estimation import least_squares

DEGREE = (15, 13, None)  # polynomial removed from the observations, Remote Sens. 2022, 14, 3395, Sec. 4.1


def arcs(equations: xr.Dataset, derivative: int, trim_s: float) -> list[Arc]:
    """Every manoeuvre as the paper treats it.

    The polynomial takes the level of the range with it; the columns keep theirs, so that the mean levels of positive
    and mirror arcs act as observations of zero (erratum K-3). The bias of the range is a seventh column.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable"
    derivative : 0, 1 or 2
    trim_s : s, left out at both ends
    """
    time, found = equations["time_kbr"].values, []
    for k in range(equations.sizes["manoeuvre"]):
        start, stop = float(equations["start"][k]), float(equations["stop"][k])
        column = equations["published_column"].values
        inside = (time >= start + trim_s) & (time <= stop - trim_s) & np.isfinite(column).all(axis=1)
        index = np.flatnonzero(inside & (equations["arc"].values == k))
        if index.size < 30:
            continue
        observed = equations["observed"].values[index]
        basis = np.zeros((index.size, 0))
        if DEGREE[derivative] is not None:
            basis = least_squares.orthonormal(least_squares.polynomial(time[index], DEGREE[derivative], start, stop))
            observed = observed - basis @ (basis.T @ observed)
        part = column[index]
        if derivative == 0:
            part = np.column_stack([part, np.ones(index.size)])
        found.append(Arc(index, observed, part, np.zeros((index.size, 0))))
    return found
