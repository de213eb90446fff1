"""Noise of ranging minus orbit: from quiet data, and what the star cameras add in the manoeuvres."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.kbr_phase_centre import pointing_noise
from gravcal.calibrations.kbr_phase_centre.schemas import NOISE
from gravcal.errors import EstimationError
from gravcal.estimation import least_squares
from gravcal.estimation import noise as noises

LEAST_DEGREE = 6  # fewer leave slow orbit errors of a short stretch, which raise the density at 4 mHz up to 80 times


def noise(
    equations: xr.Dataset, *, noise_order: int, noise_degree: int, quiet_length_s: float, quiet_minimum_s: float
) -> xr.Dataset:
    """Autoregressive model of the range residual in quiet data; from the manoeuvres where there is too little of it.

    Parameters
    ----------
    equations : Dataset, "kbr_phase_centre.observable" of the range
    noise_order : highest order
    noise_degree : degree of the polynomial removed from each stretch
    quiet_length_s : s, length of a stretch; where none has half of it, shorter ones will do
    quiet_minimum_s : s, of quiet data that suffice

    Returns
    -------
    measured : Dataset, "kbr_phase_centre.noise"
    """
    time = equations["time_kbr"].values
    step = float(np.median(np.diff(time))) if time.size > 1 else 5.0
    quiet = equations["arc"].values == -1
    source = "quiet"
    if quiet.sum() * step < quiet_minimum_s:
        quiet, source = equations["arc"].values >= 0, "manoeuvres"
    for least in (quiet_length_s / 2, quiet_length_s / 4):
        pieces, removed = _stretches(equations, quiet, (noise_degree, quiet_length_s, least), step)
        if pieces:
            break
    else:
        lengths = [time[part[-1]] - time[part[0]] for part in _whole(equations, quiet, step)]
        where = "quiet data" if source == "quiet" else "the manoeuvres, with less quiet data than quiet_minimum_s"
        raise EstimationError(
            f"{equations.attrs['ranging']}: found {len(lengths)} stretches of ranging with orbits and attitudes in "
            f"{where}, the longest of {max(lengths, default=0):.0f} s, expected one of {least:.0f} s without a gap "
            f"of {20 * step:.0f} s or a phase break, to measure the noise. Add the files that close the gaps, or "
            f"lower quiet_length_s.",
            usable=int(time.size),
        )
    fitted = noises.fit_noise(pieces, noise_order, step, removed)
    frequency = np.linspace(0, 0.5 / step, 257)[1:]
    values = {
        "reflection": fitted.reflection,
        "variance": fitted.variance,
        "frequency": frequency,
        "density": density(pieces, step, frequency),
        "model": fitted.density(frequency),
        "seconds": quiet.sum() * step,
    }
    residual = pointing_noise.residuals(equations, noise_degree)
    excess = pointing_noise.fit(residual, fitted) if source == "quiet" else pointing_noise.none()
    values |= {"corner": pointing_noise.CORNERS, "pointing_power": excess}
    values["in_manoeuvres"] = density([piece for piece, _ in residual], step, frequency)
    return build(NOISE, values, title="Noise of ranging minus orbit", source_data=source, step_s=step)


def _whole(equations, chosen, step):
    """Indices of every stretch without a gap or phase break."""
    index = np.flatnonzero(chosen)
    time, segment = equations["time_kbr"].values[index], equations["segment"].values[index]
    cuts = np.flatnonzero((np.diff(time) > 20 * step) | (np.diff(segment) != 0)) + 1
    return np.split(index, cuts) if index.size else []


def _stretches(equations, chosen, settings, step):
    """Residuals of stretches on their even grid, NaN where missing, and the number of parameters removed."""
    degree, length, least = settings
    time, observed, column = (equations[name].values for name in ("time_kbr", "observed", "column"))
    pieces, removed = [], 0
    for whole in _whole(equations, chosen, step):
        count = max(int(round((time[whole[-1]] - time[whole[0]]) / length)), 1)
        for part in np.array_split(whole, count):
            span = time[part[-1]] - time[part[0]]
            if span < least or part.size < 0.7 * span / step:
                continue
            used = max(int(degree * span / length), min(degree, LEAST_DEGREE))
            slow = least_squares.polynomial(time[part], used, time[part[0]], time[part[-1]])
            basis = least_squares.orthonormal(np.column_stack([slow, column[part]]))
            piece = np.full(int(round(span / step)) + 1, np.nan)
            piece[np.rint((time[part] - time[part[0]]) / step).astype(int)] = least_squares.without(
                basis, observed[part]
            )
            pieces.append(piece)
            removed += basis.shape[1]
    return pieces, removed


def density(pieces: list[np.ndarray], step_s: float, frequency_hz: np.ndarray) -> np.ndarray:
    """Mean one-sided periodogram of the pieces, Hann window, at given frequencies.

    Parameters
    ----------
    pieces : list of (n_i,), NaN where missing
    step_s : s
    frequency_hz : (m,) Hz
    """
    total = np.zeros(frequency_hz.size)
    for piece in pieces:
        window = np.hanning(piece.size + 2)[1:-1] * np.isfinite(piece)
        power = np.abs(np.fft.rfft(np.nan_to_num(piece) * window)) ** 2 * 2 * step_s / max(np.sum(window**2), 1e-300)
        total += np.interp(frequency_hz, np.fft.rfftfreq(piece.size, step_s), power)
    return total / max(len(pieces), 1)
