"""Noise of the linear channels as measured in quiet data outside the manoeuvres."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.com_offset.schemas import NOISE, QUIET
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise
from gravcal.estimation.resampling import lowpass_resampler

#: Shortest quiet data from which the noise is measured.
QUIET_S = 300.0
#: m s-2, far below a step of any accelerometer: a channel that moves no more is dead.
SILENT = 1e-14
FREQUENCY = np.linspace(0.005, 1.0, 200)


def quiet(aligned: xr.Dataset, **settings) -> xr.Dataset:
    """Linear channels outside the manoeuvres, low-passed and resampled like the reading of a manoeuvre.

    Parameters
    ----------
    aligned : Dataset, "align"
    settings : lowpass_hz, half_width_s, step_s, quiet_margin_s

    Returns
    -------
    pieces : Dataset, "com_offset.quiet", pieces as long as a manoeuvre; NaN where there are too few samples
    """
    time, linear = aligned["time_acc"].values, aligned["linear_b"].values
    good = (aligned["acc_flag"].values == 0) & np.isfinite(linear).all(axis=1)
    found = [_quiet_piece(time, linear, good, *ends, settings) for ends in quiet_spans(aligned, settings)]
    found = [(np.zeros(0), np.zeros((0, 3))), *(one for one in found if one is not None)]
    values = {"epoch": np.concatenate([grid for grid, _ in found])}
    values["reading"] = np.concatenate([reading for _, reading in found])
    values["piece"] = np.repeat(np.arange(-1, len(found) - 1), [grid.size for grid, _ in found])
    return build(QUIET, values, step_s=settings["step_s"])


def noise(pieces: xr.Dataset, **settings) -> xr.Dataset:
    """Autoregressive model of each linear channel, none where there is too little quiet data.

    Parameters
    ----------
    pieces : Dataset, "com_offset.quiet"
    settings : drift_degree, noise_order

    Returns
    -------
    measured : Dataset, "com_offset.noise"
    """
    models, seconds = quiet_noise(pieces, settings)
    return as_dataset(models, "quiet data" if models else "none", seconds, pieces.attrs["step_s"])


def as_dataset(models: list[NoiseModel], source: str, seconds: float, step: float) -> xr.Dataset:
    """Product of three noise models."""
    order = models[0].reflection.size if models else 0
    values = {
        "reflection": np.array([m.reflection for m in models]) if models else np.zeros((3, 0)),
        "variance": np.array([m.variance for m in models]) if models else np.full((3, 1), np.nan),
        "density": np.array([m.density(FREQUENCY) for m in models]) if models else np.full((3, FREQUENCY.size), np.nan),
        "frequency": FREQUENCY,
        "seconds": seconds,
    }
    return build(NOISE, values, source_of_noise=source, step_s=step, order=order)


def models_of(measured: xr.Dataset) -> list[NoiseModel]:
    """Noise models (one an axis) of a product; none if it holds none."""
    if measured.attrs["source_of_noise"] == "none":
        return []
    step = float(measured.attrs["step_s"])
    return [
        NoiseModel(r, v, step) for r, v in zip(measured["reflection"].values, measured["variance"].values, strict=True)
    ]


def quiet_noise(pieces: xr.Dataset, settings: dict) -> tuple[list[NoiseModel], float]:
    """Noise of the linear channels outside the manoeuvres.

    Parameters
    ----------
    pieces : Dataset, "com_offset.quiet"
    settings : drift_degree, noise_order

    Returns
    -------
    noise : model of each axis, on the grid of the solution
    seconds : length of the quiet data used
    """
    step, degree = float(pieces.attrs["step_s"]), settings["drift_degree"]
    time, reading = pieces["epoch"].values, pieces["reading"].values
    seconds = step * int(np.isfinite(reading[:, 0]).sum())
    if seconds < QUIET_S:
        return [], seconds
    silent = [axis for axis, size in zip("xyz", np.nanmax(np.abs(reading), axis=0), strict=True) if size < SILENT]
    if silent:
        raise EstimationError(
            f"linear acceleration along {', '.join(silent)}: found the same reading for {seconds:.0f} s, expected "
            f"noise of 1e-10 m s-2. Fetch ACC1A again, or take another day.",
            axes=silent,
        )
    cuts = np.flatnonzero(np.diff(pieces["piece"].values)) + 1
    values = []
    for grid, own in zip(np.split(time, cuts), np.split(reading.copy(), cuts), strict=True):
        valid = np.isfinite(own[:, 0])
        drift = least_squares.polynomial(grid, degree, grid[0], grid[-1])[valid]
        own[valid] = least_squares.without(drift, own[valid])
        values.append(own)
    removed = len(values) * (degree + 1)
    return [fit_noise([v[:, a] for v in values], settings["noise_order"], step, removed) for a in range(3)], seconds


def quiet_spans(aligned, settings):
    """Pieces as long as a manoeuvre, inside the windows and clear of every manoeuvre."""
    start, stop = aligned["start"].values, aligned["stop"].values
    margin = settings["quiet_margin_s"]
    lengths = stop - start if start.size else np.full(aligned.sizes["window"], 180.0)
    ends = aligned["window_start"].values, aligned["window_stop"].values
    for window_start, window_stop, length in zip(*ends, lengths, strict=True):
        busy = [(a - margin, b + margin) for a, b in zip(start, stop, strict=True)]
        begin = window_start
        while begin + length <= window_stop:
            hit = [b for a, b in busy if a < begin + length and b > begin]
            if hit:
                begin = max(hit)
                continue
            yield begin, begin + length
            begin += length


def _quiet_piece(time, linear, good, begin, end, settings):
    inside = slice(*np.searchsorted(time, [begin, end]))
    if inside.stop - inside.start < 200:
        return None
    grid = np.arange(np.ceil(begin / settings["step_s"]), np.floor(end / settings["step_s"])) * settings["step_s"]
    operator = lowpass_resampler(
        time[inside], good[inside], grid, lowpass_hz=settings["lowpass_hz"], half_width_s=settings["half_width_s"]
    )
    if operator.valid.sum() < 100:
        return None
    return grid, operator(linear[inside] - linear[inside][good[inside]].mean(axis=0))
