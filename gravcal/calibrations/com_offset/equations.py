"""Reading and columns of every manoeuvre on the grid of the solution, low-passed alike; noise comes afterwards."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.equations_schema import EQUATIONS
from gravcal.effects import Context, effect
from gravcal.estimation.resampling import operator_for


def equations(aligned: xr.Dataset, smoothed: xr.Dataset, angular: xr.Dataset, **settings) -> xr.Dataset:
    """Resampled reading, columns, instruments and modes of every manoeuvre, for one angular acceleration.

    CoM paper eqs. 3-5; erratum C-12 for the operator, one for reading and columns.

    Parameters
    ----------
    aligned : Dataset, "align"
    smoothed : Dataset, "com_offset.attitude"
    angular : Dataset, "com_offset.angular_acceleration"
    settings : lowpass_hz, half_width_s, step_s

    Returns
    -------
    resampled : Dataset, "com_offset.equations"; a manoeuvre with too few samples has no epochs in it
    """
    given = [arrays(product) for product in (aligned, smoothed, angular)]
    variant = angular.attrs["variant"]
    driven, modes = int(variant != "mtq"), angular.sizes["mode_index"]
    blocks = [_none(driven, modes)]
    blocks += [_block(*given, i, settings | {"variant": variant}) for i in range(aligned.sizes["manoeuvre"])]
    values = {"grid_manoeuvre": np.repeat(np.arange(-1, len(blocks) - 1), [_size(b) for b in blocks])}
    seen = [b for b in blocks if b is not None]
    values |= {name: np.concatenate([b[name] for b in seen]) for name in ("epoch", "valid", "reading", "still")}
    turning = np.concatenate([b["turning"] for b in seen], axis=1)
    values["rate_dot_b"], values["driven_b"], values["mode"] = np.split(turning, [1, 1 + driven])
    values["rate_dot_b"] = values["rate_dot_b"][0]
    values |= {n: angular[n].values for n in ("mode_shared", "mode_catalogue")} | where(given[0])
    return build(EQUATIONS, values, variant=variant, step_s=settings["step_s"])


def arrays(product: xr.Dataset) -> dict[str, np.ndarray]:
    """Variables of a product as bare arrays, by name."""
    return {name: variable.values for name, variable in product.variables.items()}


def where(aligned) -> dict[str, np.ndarray]:
    """Kind, times (s) and latitude (rad) of every manoeuvre.

    Parameters
    ----------
    aligned : arrays of "align", by name
    """
    start, stop = aligned["start"], aligned["stop"]
    position, time = aligned["position_e"], aligned["time_orbit"]
    sine = position[:, 2] / np.linalg.norm(position, axis=1)
    latitude = np.arcsin(np.interp((start + stop) / 2, time, sine))
    return {"kind": aligned["kind"], "start": start, "stop": stop, "latitude": latitude}


def samples(smoothed, index):
    """Samples of one manoeuvre, as a slice where they are in one piece; None where there are too few.

    Parameters
    ----------
    smoothed : arrays of "com_offset.attitude", by name
    index : of the manoeuvre
    """
    inside = np.flatnonzero(smoothed["acc_manoeuvre"] == index)
    if inside.size < 200:
        return None
    whole = slice(inside[0], inside[-1] + 1)
    return whole if whole.stop - whole.start == inside.size else inside


def reading(aligned, time) -> tuple[np.ndarray, np.ndarray]:
    """Linear acceleration (n, 3) m s-2 at epochs of the record, and which of them are not usable (n,).

    Parameters
    ----------
    aligned : arrays of "align", by name
    time : (n,) s
    """
    at = np.searchsorted(aligned["time_acc"], time)
    linear = aligned["linear_b"][at]
    return linear, (aligned["acc_flag"][at] != 0) | ~np.isfinite(linear).all(axis=1)


def columns(time, rate, rate_dot, gradient) -> np.ndarray:
    """Reading per metre of offset, s-2.

    Parameters
    ----------
    time : (n,) s
    rate : (n, 3) or (3,) rad s-1
    rate_dot : (..., n, 3) rad s-2
    gradient : (n, 3, 3) or (3, 3) s-2

    Returns
    -------
    columns : (..., n, 3, 3), axis and component
    """
    context = Context(time=time, rate_b=rate, rate_dot_b=rate_dot, gradient_b=gradient)
    return effect("accelerometer.offset").columns(context)


def of_rotation(time, rate_dot) -> np.ndarray:
    """The part of the columns that an angular acceleration has; arguments and result as of `columns`."""
    return columns(time, np.zeros(3), rate_dot, np.zeros((3, 3)))


def _none(driven, modes):
    """Block without epochs, so that an event without manoeuvre has arrays of the right shape."""
    empty = {"epoch": np.zeros(0), "valid": np.zeros(0), "reading": np.zeros((0, 3))}
    return empty | {"still": np.zeros((0, 3, 3)), "turning": np.zeros((1 + driven + modes, 0, 3))}


def _size(block):
    """Number of epochs of a block."""
    return 0 if block is None else block["epoch"].size


def _block(aligned, smoothed, angular, index, settings):
    """Resampled reading, columns and angular accelerations of one manoeuvre; None without samples.

    The columns are linear in the angular acceleration, so that this is resampled, not its nine columns.
    """
    inside = samples(smoothed, index)
    if inside is None:
        return None
    time = smoothed["time_acc"][inside]
    linear, marked = reading(aligned, time)
    value, modes = angular["rate_dot_b"][inside], angular["mode"][:, inside]
    good = ~marked & np.isfinite(value).all(axis=1)
    motion = smoothed["rate_b"][inside], smoothed["gradient_b"][inside]
    operator, still = _still(time, good, *motion, _filter(aligned, smoothed, index, settings))
    if operator.valid.sum() < 60:
        return None
    driven = [value]
    if settings["variant"] != "mtq":
        driven.append(smoothed["smooth_b"][inside] + angular["ratio"] * smoothed["magnetic_b"][inside])
    series = np.stack([linear - linear[good].mean(axis=0), *driven, *modes], axis=1)
    resampled = np.moveaxis(operator(np.nan_to_num(series)), 1, 0)
    block = {"epoch": operator.time, "valid": operator.valid, "reading": resampled[0]}
    return block | {"still": still, "turning": resampled[1:]}


def _still(time, good, rate, gradient, filtered):
    """Low-pass and resampling, and the columns without angular acceleration."""
    start, stop, *settings = filtered
    operator = operator_for(time, good, max(start, time[0]), min(stop, time[-1]), *settings)
    return operator, operator(columns(time, rate, np.zeros(3), gradient))


def _filter(aligned, smoothed, index, settings):
    """First and last edge, and what the low-pass and resampling between them needs."""
    return *_ends(aligned, smoothed, index), *(settings[name] for name in ("lowpass_hz", "half_width_s", "step_s"))


def _ends(aligned, smoothed, index):
    """First and last edge as the accelerometer sees them."""
    count = int(np.isfinite(aligned["edge_lower"][index]).sum())
    late = np.nan_to_num(smoothed["acc_shift"][index])
    return aligned["edge_upper"][index, 0] + max(late, 0.0), aligned["edge_lower"][index, count - 1] + min(late, 0.0)
