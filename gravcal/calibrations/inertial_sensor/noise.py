"""Noise of an inertial sensor: of its readings and tracker in quiet data beside a swing, and of a roll."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.special import chdtrc

from gravcal.estimation import least_squares, noise
from gravcal.estimation.noise import NoiseModel, Spectrum
from gravcal.estimation.resampling import bin_means

#: Least frequency Hz with tracker noise beside motion; knots of its spectrum; least probability of a flat spectrum.
MOTION_HZ, KNOTS, FLAT = 0.015, 4, 1e-3
READING_KNOTS = 6  # of the spectra of the linear readings


def quiet_edges(aligned: xr.Dataset, bin_s: float, margin_s: float, first: float | None = None) -> list[np.ndarray]:
    """Edges (k,) s of the quiet bins before and after the swing, of each side longer than twenty.

    With a `first` edge s all bins lie on its grid, so that aliases of fast lines go on from side to side in phase.
    """
    ends = aligned.time.values[[0, -1]]
    spans = ((ends[0], float(aligned.start) - margin_s), (float(aligned.stop) + margin_s, ends[1]))
    spans = [(a if first is None else a + (first - a) % bin_s, b) for a, b in spans]
    return [a + bin_s * np.arange(np.floor((b - a) / bin_s) + 1) for a, b in spans if b - a > 20 * bin_s]


def quiet_blocks(aligned: xr.Dataset, values: np.ndarray, *bins: float) -> list[np.ndarray]:
    """Bin means (k, m) over `quiet_edges` of values (n, m), less a cubic a side, NaN where samples are missing."""
    values = np.where((aligned.flag.values == 2).any(axis=1, keepdims=True), np.nan, values)
    blocks = [bin_means(aligned.time.values, values, one)[0] for one in quiet_edges(aligned, *bins)]
    for block in blocks:
        good = np.isfinite(block).all(axis=1)
        block[good] = least_squares.project_out(cubic(len(block))[good], block[good])
        block[~good] = np.nan
    return blocks


def cubic(count: int) -> np.ndarray:
    """Columns (count, 4) of a polynomial of degree three, the slow part of quiet data."""
    return least_squares.polynomial(np.arange(count), 3, 0, count - 1)


def spectra_of(blocks: list[np.ndarray], step_s: float) -> tuple[Spectrum, ...]:
    """Spectra of the axes of quiet blocks (n, 3) less a cubic each, down to the length of one, with their errors."""
    knots = np.geomspace(1 / (step_s * max(map(len, blocks))), 0.5 / step_s, READING_KNOTS)
    by_axis = ([(one[:, a], cubic(len(one))) for one in blocks] for a in range(3))
    return tuple(noise.fit_spectrum(one, step_s, knots, noise.STEADY) for one in by_axis)


def of_tracker(bins: Sequence[tuple[np.ndarray, ...]], variance: np.ndarray, count: int, step_s: float) -> np.ndarray:
    """Autocovariance (3, count) of tracker bins by lag, in units of `variance` (3,) rad2 of a sample over their number.

    One and zeros where their spectrum is flat, as far as is known. Bins are means (n, 3) and numbers (n,) of samples.
    A polynomial stands for the motion, below the lowest knot of the spectrum; a bin that is not full has another epoch.
    """
    covariance, samples = np.eye(1, count)[np.zeros(3, dtype=int)], max(np.max(number) for _, number in bins)
    full_bins = [np.where((number == samples)[:, None], values, np.nan) for values, number in bins if len(number) > 100]
    full_bins = [one for one in full_bins if np.isfinite(one).all(axis=1).mean() > 0.9]
    knots = np.geomspace(MOTION_HZ, 0.5 / step_s, KNOTS)
    for axis in range(3 if full_bins else 0):
        parts = [(values[:, axis], len(values), int(2 * len(values) * step_s * MOTION_HZ)) for values in full_bins]
        rows = [(one, least_squares.polynomial(np.arange(n), degree, 0, n - 1)) for one, n, degree in parts]
        spectrum = noise.fit_spectrum(rows, step_s, knots)
        deviation = spectrum.log_density - spectrum.log_density.mean()
        if not chdtrc(KNOTS - 1, deviation @ np.linalg.solve(spectrum.covariance, deviation)) > FLAT:
            density = spectrum.density(np.fft.rfftfreq(8 * count, step_s))
            covariance[axis] = np.fft.irfft(density)[:count] / (2 * step_s) * samples / variance[axis]
    return covariance


def of_segments(
    left: np.ndarray, local: Sequence[Sequence[np.ndarray]], shared: np.ndarray, count: np.ndarray, step_s: float
) -> tuple[list[NoiseModel], np.ndarray]:
    """Noise models of the axes of a roll, sums of power laws, and its residual whitened with them, (s b, 3).

    They fit periodograms of all segments, those that touch joined, of readings left (s, b, 3) less local columns (b, p)
    of each axis and segment and shared ones (s, b, f); simulated power laws pass the same projection, and go on where
    it leaves nothing. Constants and trends are noise here, a jump is none. Count (s, b) holds the numbers of the bins.
    """
    joined = np.split(np.arange(len(count)), np.flatnonzero(np.diff(count[:, 0]) > count.shape[1]) + 1)
    parts = (_of_axis(left[:, :, a, None], local[a], shared, count, joined, step_s) for a in range(3))
    models, rests = zip(*parts, strict=True)
    return list(models), np.stack(rests, axis=1)


def _of_axis(left, local, shared, count, joined, step_s):
    """Noise model, whitened residual (s b,) of an axis: left (s, b, 1), local columns [(b, p)], shared (s, b, f)."""
    bases = [least_squares.orthonormal(columns, 1e-6) for columns in local]
    project = lambda values: np.stack([v - q @ (q.T @ v) for v, q in zip(values, bases, strict=True)])  # noqa: E731

    def beside(places):
        """Function values (s, b, d) -> residuals after all columns and jumps at places, (n, d) of each joined run."""
        forms = np.concatenate([shared, noise.jump_columns(count.size, places).reshape(*count.shape, -1)], axis=2)
        basis = least_squares.orthonormal(project(forms).reshape(count.size, -1), 1e-6)

        def clean(values):
            flat = project(values).reshape(count.size, -1)
            residual = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
            return [residual[run].reshape(-1, values.shape[2]) for run in joined]

        return clean

    clean = beside(noise.jumps(lambda places: np.concatenate(beside(places)(left))[:, 0]))
    model = noise.power_laws(left, clean, count, step_s)
    return model, np.concatenate([noise.whiten(model, run[:, 0], np.ones(len(run), bool)) for run in clean(left)])
