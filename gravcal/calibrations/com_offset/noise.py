"""Noise of the linear channels as measured in quiet data outside the manoeuvres."""

import numpy as np
import xarray as xr

from gravcal.calibrations import schemas
from gravcal.calibrations.building import build
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, levels
from gravcal.estimation.resampling import lowpass_resampler

SCHEMAS = schemas.of("com_offset.toml")

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
    linear, epochs, readings = aligned["linear_b"].values, [np.zeros(0)], [np.zeros((0, 3))]
    for inside, good, operator in quiet_operators(aligned, linear, settings):
        epochs.append(operator.time)
        readings.append(operator(linear[inside] - linear[inside][good].mean(axis=0)))
    values = {"epoch": np.concatenate(epochs), "reading": np.concatenate(readings)}
    values["piece"] = np.repeat(np.arange(-1, len(epochs) - 1), [grid.size for grid in epochs])
    values["near"] = nearest(aligned, epochs[1:])
    return build(SCHEMAS["quiet"], values, step_s=settings["step_s"], manoeuvres=aligned.sizes["manoeuvre"])


def nearest(aligned: xr.Dataset, times: list[np.ndarray]) -> np.ndarray:
    """Manoeuvre (k,) nearest to each piece of epochs s; 0 where there is none."""
    middle = (aligned["start"].values + aligned["stop"].values) / 2
    return np.array([np.argmin(np.abs(middle - one.mean())) if middle.size else 0 for one in times], dtype=int)


def quiet_operators(aligned, values, settings):
    """Low-pass of each piece of quiet data long enough: its samples (a slice), which of them are usable, operator."""
    time, step_s = aligned["time_acc"].values, settings["step_s"]
    usable = (aligned["acc_flag"].values == 0) & np.isfinite(values).all(axis=1)
    filters = {name: settings[name] for name in ("lowpass_hz", "half_width_s")}
    for begin, end in quiet_spans(aligned, settings):
        inside = slice(*np.searchsorted(time, [begin, end]))
        if inside.stop - inside.start < 200:
            continue
        grid = np.arange(np.ceil(begin / step_s), np.floor(end / step_s)) * step_s
        operator = lowpass_resampler(time[inside], usable[inside], grid, **filters)
        if operator.valid.sum() >= 100:
            yield inside, usable[inside], operator


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


def noise(pieces: xr.Dataset, *, drift_degree: int, noise_order: int) -> xr.Dataset:
    """Autoregressive model of each linear channel, none where there is too little quiet data.

    Parameters
    ----------
    pieces : Dataset, "com_offset.quiet"
    drift_degree : of each piece
    noise_order : highest of the model
    """
    step, reading = float(pieces.attrs["step_s"]), pieces["reading"].values
    seconds = step * int(np.isfinite(reading[:, 0]).sum())
    count = int(pieces.attrs["manoeuvres"])
    values = {
        "level": np.ones((count, 3)),
        "level_error": np.zeros((count, 3)),
        "reflection": np.zeros((3, 0)),
        "variance": np.full((3, 1), np.nan),
        "density": np.full((3, FREQUENCY.size), np.nan),
        "frequency": FREQUENCY,
        "seconds": seconds,
    }
    if seconds < QUIET_S:
        return build(SCHEMAS["noise"], values, source_of_noise="none", step_s=step, order=0)
    silent = [axis for axis, size in zip("xyz", np.nanmax(np.abs(reading), axis=0), strict=True) if size < SILENT]
    if silent:
        raise EstimationError(
            f"linear acceleration along {', '.join(silent)}: found the same reading for {seconds:.0f} s, expected "
            f"noise of 1e-10 m s-2. Fetch ACC1A again, or take another day.",
            axes=silent,
        )
    cuts, quiet_parts = np.flatnonzero(np.diff(pieces["piece"].values)) + 1, []
    for grid, own in zip(np.split(pieces["epoch"].values, cuts), np.split(reading.copy(), cuts), strict=True):
        valid = np.isfinite(own[:, 0])
        drift = least_squares.polynomial(grid, drift_degree, grid[0], grid[-1])[valid]
        own[valid] = least_squares.without(drift, own[valid])
        quiet_parts.append(own)
    removed = len(quiet_parts) * (drift_degree + 1)
    models = [fit_noise([part[:, axis] for part in quiet_parts], noise_order, step, removed) for axis in range(3)]
    values |= {name: np.array([getattr(model, name) for model in models]) for name in ("reflection", "variance")}
    values["density"] = np.array([model.density(FREQUENCY) for model in models])
    found = levels(models, quiet_parts, [drift_degree + 1] * len(quiet_parts), pieces["near"].values, count)
    values |= {"level": found.value, "level_error": found.error}
    return build(SCHEMAS["noise"], values, source_of_noise="quiet data", step_s=step, order=models[0].reflection.size)


def models_of(measured: xr.Dataset) -> list[NoiseModel]:
    """Noise models (one an axis) of a product, of all manoeuvres; none if it holds none."""
    if measured.attrs["source_of_noise"] == "none":
        return []
    step = float(measured.attrs["step_s"])
    return [
        NoiseModel(r, v, step) for r, v in zip(measured["reflection"].values, measured["variance"].values, strict=True)
    ]
