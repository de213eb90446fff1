"""Observation equations of one observable: ranging minus orbit, and the columns through the same filter."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.kbr_phase_centre.schemas import MANOEUVRE, OBSERVABLE, OBSERVABLES, UNITS, of
from gravcal.estimation import crn


def observable(
    aligned: xr.Dataset,
    pointed: xr.Dataset,
    *,
    variant: str,
    trim_s: float,
    quiet_margin_s: float,
    crn_window_s: float,
    crn_bandwidth_hz: float,
    nominal_m,
    published_half_width: int,
) -> xr.Dataset:
    """Ranging minus orbit and its columns at the ranging epochs.

    The range of the centres of mass, the columns and the part square in the offsets pass through the CRN filter that
    made range, rate and acceleration of the ranging product; nothing is differentiated in another way.

    Parameters
    ----------
    aligned : Dataset, "kbr_phase_centre.align"
    pointed : Dataset, "kbr_phase_centre.pointing"
    variant : "range", "range_rate" or "range_acceleration"
    trim_s : s, left out at both ends of a manoeuvre
    quiet_margin_s : s, between a manoeuvre and quiet data
    crn_window_s, crn_bandwidth_hz : s and Hz, of the filter
    nominal_m : (2, 3) m, phase centres of the catalogue, for the lever arm of pointing errors
    published_half_width : epochs on either side in the derivative of the source paper

    Returns
    -------
    equations : Dataset, "kbr_phase_centre.observable"
    """
    derivative = OBSERVABLES.index(variant)
    time, at = pointed["time"].values, aligned["time_kbr"].values
    good = pointed["usable"].values != 0
    filter_ = crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz)
    through = [crn.operator(filter_, order, good, (time[0], 1.0), at) for order in range(derivative + 1)]
    line = np.concatenate(list(pointed["line_of_sight_b"].values), axis=1)
    modelled = through[-1](np.column_stack([pointed["range_com"].values + pointed["second_order"].values, -line]))
    x = np.repeat(np.asarray(nominal_m, dtype=float).reshape(2, 3)[:, 0], 2)
    arms = line[:, [2, 1, 5, 4]] * x
    valid = through[-1].valid & (aligned["kbr_flag"].values == 0)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    epochs = np.clip(np.rint(at - time[0]).astype(int), 0, time.size - 1)
    values = {
        "time_kbr": at,
        "observed": aligned[f"reading_{variant}"].values - modelled[:, 0],
        "column": modelled[:, 1:],
        "lever": np.stack([filtered(arms) for filtered in through], axis=1),
        "published_column": published_columns(at, -line[epochs], derivative, published_half_width),
        "arc": arcs(at, spans, trim_s, quiet_margin_s),
        "segment": aligned["segment"].values,
    }
    values = {name: column[valid] for name, column in values.items()}
    return build(
        of(OBSERVABLE, variant),
        values | {n: pointed[n].values for n in MANOEUVRE},
        title=f"Observation equations of {variant}",
        observable=variant,
        unit=UNITS[derivative],
        **{n: pointed.attrs[n] for n in ("satellites", "ranging", "orbit")},
    )


def arcs(time: np.ndarray, spans: np.ndarray, trim: float, margin: float) -> np.ndarray:
    """Manoeuvre of every epoch; -1 in quiet data, -2 near a manoeuvre but not in it.

    Parameters
    ----------
    time, spans : (m,) s, and (k, 2) s, start and stop
    trim, margin : s, left out at both ends; between a manoeuvre and quiet data
    """
    result = np.full(time.size, -1)
    for start, stop in spans:
        result[(time > start - margin) & (time < stop + margin) & (result == -1)] = -2
    for index, (start, stop) in enumerate(spans):
        result[(time >= start + trim) & (time <= stop - trim)] = index
    return result


def published_columns(time: np.ndarray, columns: np.ndarray, derivative: int, half_width: int) -> np.ndarray:
    """Columns differentiated by a local cubic polynomial, once or twice.

    Parameters
    ----------
    time : (m,) s, evenly spaced but for gaps
    columns : (m, p)
    derivative : 0, 1 or 2
    half_width : epochs on either side of the polynomial

    Returns
    -------
    columns : (m, p) per s**derivative

    Notes
    -----
    D and D D of Remote Sens. 2022, 14, 3395, eqs. 17 and 19; the window is not printed (erratum K-4).
    """
    lag = np.arange(-half_width, half_width + 1)
    taps = np.linalg.pinv(np.vander(lag, 4, increasing=True))[1]
    step = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    for _ in range(derivative):
        widened = np.pad(columns, ((half_width, half_width), (0, 0)), mode="edge")
        columns = np.lib.stride_tricks.sliding_window_view(widened, lag.size, axis=0) @ (taps / step)
    return columns
