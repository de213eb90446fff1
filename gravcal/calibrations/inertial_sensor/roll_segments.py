"""Segments of a roll: which are good, and the bias of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.estimation import noise
from gravcal.physics import sensing

MEMORY = 3  # order of the autoregressive noise of a residual, half a minute


@dataclass(frozen=True)
class Model:
    """What stands in a segment beside the bias.

    Attributes
    ----------
    trend_degree : of the polynomial; its mean over the segment is the constant
    amplitude_degree : of the polynomials by which non-gravitational accelerations change (published: 1)
    harmonics : of the revolution by which they change beside (published: 0)
    with_offset : keep the term of the offset (published: may be dropped; erratum T-10 says no)
    """

    trend_degree: int
    amplitude_degree: int
    harmonics: int = 0
    with_offset: bool = True


def bin_length(time: np.ndarray, segment_s: float) -> float:
    """Length s of the bins of a roll; that of a segment where there is one bin only.

    Parameters
    ----------
    time : (b,) s, middles of bins; segment_s : s
    """
    return float(np.median(np.diff(time[:1000]))) if time.size > 1 else segment_s


def cut(time: np.ndarray, step_s: float, segment_s: float) -> list[slice]:
    """Slices of segments that hold no gap.

    Parameters
    ----------
    time : (b,) s, middles of bins; step_s : s; segment_s : s, length wanted
    """
    length = int(round(segment_s / step_s))
    breaks = np.flatnonzero(np.diff(time) > 1.5 * step_s) + 1
    bounds = [0, *breaks.tolist(), time.size]
    return [
        slice(first, first + length)
        for a, b in zip(bounds[:-1], bounds[1:], strict=True)
        for first in range(a, b - length + 1, length)
    ]


def uniformity(rate_b: np.ndarray) -> float:
    """Relative standard deviation of the rate about y; NaN where rates are missing.

    Parameters
    ----------
    rate_b : (b, 3) rad s-1
    """
    return float(np.std(rate_b[:, 1]) / np.abs(np.mean(rate_b[:, 1])))


def offset_terms(rate_b, gradient_b, step_s: float) -> np.ndarray:
    """Tensor of the offset in the bins of a segment; the rate of rolling changes as its straight line (b, 3, 3) s-2.

    Parameters
    ----------
    rate_b : (b, 3) rad s-1; gradient_b : (b, 3, 3) s-2; step_s : s
    """
    u = step_s * np.arange(rate_b.shape[0])
    u = u - u.mean()
    slope = (u @ (rate_b - rate_b.mean(axis=0))) / (u @ u)
    return sensing.offset_tensor(rate_b, np.broadcast_to(slope, rate_b.shape), gradient_b)


def orbital_phase(gradient_b: np.ndarray, step_s: float) -> np.ndarray:
    """Angle along the orbit since the first bin (b,) rad, from the gravity gradient: |G| = sqrt(6) n^2.

    Parameters
    ----------
    gradient_b : (b, 3, 3) s-2; step_s : s
    """
    motion = np.sqrt(np.linalg.norm(gradient_b, axis=(1, 2)) / np.sqrt(6))
    return step_s * np.cumsum(motion)


def solve_axis(axis: int, readings: np.ndarray, R_bo: np.ndarray, model: Model, phase: np.ndarray | None = None):
    """Constants of readouts of one axis over a segment.

    Parameters
    ----------
    axis : 0 x, 1 y, 2 z; readings : (b, m) any units
    R_bo : (b, 3, 3); model : Model; phase : (b,) rad along the orbit, for harmonics

    Returns
    -------
    constant, sigma : (m,) units of the readings; residual : (b, m)
    amplitude : (t, m) units, mean of a_J over the segment of each direction that turns; none about y

    Notes
    -----
    k V = -b + trend + sum_J c_iJ (a_J t + a_0J); Remote Sens. 2023, 15, 3817, eqs. 14 and 15 with direction cosines
    (erratum T-3); a_J may hold one and two cycles per revolution beside, as drag does. About y the cosine with y is
    constant: nothing is fitted, the constant holds b and a_0 (T-9).
    """
    columns = design(axis, R_bo, model, phase)
    basis, triangle = np.linalg.qr(columns)
    first = np.linalg.solve(triangle.T, np.eye(triangle.shape[0])[0])  # weights of the constant along the basis
    share = basis.T @ readings
    residual = readings - basis @ share
    variance = np.einsum("bm,bm->m", residual, residual) / (columns.shape[0] - columns.shape[1])
    mean = _changes(R_bo.shape[0], model, phase).mean(axis=0)
    coefficient = np.linalg.solve(triangle, share)[model.trend_degree + 1 :]
    amplitude = np.einsum("c,jcm->jm", mean, coefficient.reshape(-1, mean.size, readings.shape[1]))
    return first @ share, np.sqrt(variance * (first @ first)), residual, amplitude


def design(axis: int, R_bo: np.ndarray, model: Model, phase: np.ndarray | None = None) -> np.ndarray:
    """Columns (b, p) that are fitted to one axis of a segment, the constant first; arguments as of `solve_axis`."""
    u = np.linspace(-1, 1, R_bo.shape[0])
    trend = np.polynomial.legendre.legvander(u, model.trend_degree)
    change = _changes(R_bo.shape[0], model, phase)
    turning = () if axis == 1 else (0, 2)
    return np.concatenate([trend, *(R_bo[:, axis, j, None] * change for j in turning)], axis=1)


def _changes(count, model, phase):
    """How non-gravitational accelerations may change over a segment of so many bins (b, c)."""
    change = np.polynomial.legendre.legvander(np.linspace(-1, 1, count), model.amplitude_degree)
    waves = [wave(n * phase)[:, None] for n in range(1, model.harmonics + 1) for wave in (np.cos, np.sin)]
    return np.concatenate([change, *waves], axis=1)


@dataclass(frozen=True)
class Segments:
    """Constants of all segments.

    Attributes
    ----------
    time : (s,) s, middles; used : (s,) bool; uniformity, share : (s,)
    constant, sigma : (s, 3) m s-2, of k V with the offset term taken off; minus the bias for x and z; the noise is
        taken as the residual shows it, correlated or not
    volt : (s, 3) V, the same before scaling, offset term included
    offset_slope : (s, 3, 3) s-2, mean tensor: change of k V by the offset
    amplitude : (s, 2, 2) m s-2, non-gravitational acceleration along x and z of o, as x and as z sees it
    """

    time: np.ndarray
    used: np.ndarray
    uniformity: np.ndarray
    share: np.ndarray
    constant: np.ndarray
    sigma: np.ndarray
    volt: np.ndarray
    offset_slope: np.ndarray
    amplitude: np.ndarray


def solve(bins: dict, k: np.ndarray, offset: np.ndarray, model: Model, limits: dict) -> Segments:
    """Constants of every segment.

    Parameters
    ----------
    bins : of roll_bins.reduced, several spans joined
    k : (3,) m s-2 V-1; offset : (3,) m, centre of mass to test mass
    model : Model
    limits : {"step_s", "segment_s" s; "uniformity" 1; "share" 1}
    """
    rows = []
    for part in cut(bins["time"], limits["step_s"], limits["segment_s"]):
        one = {name: values[part] for name, values in bins.items()}
        whole = np.isfinite(one["linear_volt"]).all() and np.isfinite(one["R_bo"]).all()
        whole = whole and np.isfinite(one["rate_b"]).all()
        even = uniformity(one["rate_b"]) if whole else np.nan
        share = float(one["share"].min())
        used = bool(whole and even <= limits["uniformity"] and share >= limits["share"])
        solved = _segment(one, k, offset, model, limits["step_s"]) if whole else _nothing(one["time"].size)
        rows.append((float(np.mean(one["time"])), used, even, share, *solved))
    columns = [np.array(column) for column in (zip(*rows, strict=True) if rows else [[]] * 10)]
    residual = columns.pop()
    if columns[1].any():
        columns[5] = columns[5] * redness(residual[columns[1]], limits["step_s"])
    return Segments(*columns)


def redness(residual: np.ndarray, step_s: float) -> np.ndarray:
    """Ratio (3,) by which noise below a few cycles of the roll exceeds white noise of the same variance, at least one.

    Parameters
    ----------
    residual : (s, b, 3) m s-2, of the segments used; step_s : s
    """
    slow = np.linspace(0, 4 / (residual.shape[1] * step_s), 9)
    models = [noise.fit_noise(list(residual[:, :, axis]), MEMORY, step_s) for axis in range(3)]
    white = np.maximum(2 * step_s * np.mean(residual**2, axis=(0, 1)), 1e-300)
    return np.sqrt(np.maximum([m.density(slow).mean() for m in models] / white, 1.0))


def _segment(one, k, offset, model, step_s):
    """Constant, sigma, volt, mean tensor, amplitudes and residual of one segment."""
    tensor = offset_terms(one["rate_b"], one["gradient_b"], step_s)
    felt = np.matvec(tensor, offset) if model.with_offset else np.zeros((tensor.shape[0], 3))
    volt = one["linear_volt"]
    both = np.stack([k * volt - felt, volt], axis=2)
    phase = orbital_phase(one["gradient_b"], step_s)
    solved = [solve_axis(axis, both[:, axis], one["R_bo"], model, phase) for axis in range(3)]
    constant, sigma = np.array([s[0] for s in solved]), np.array([s[1] for s in solved])
    residual = np.stack([s[2][:, 0] for s in solved], axis=1)
    amplitude = np.stack([solved[axis][3][:, 0] for axis in (0, 2)])
    return constant[:, 0], sigma[:, 0], constant[:, 1], tensor.mean(axis=0), amplitude, residual


def _nothing(count):
    axis = np.full(3, np.nan)
    return axis, axis, axis, np.full((3, 3), np.nan), np.full((2, 2), np.nan), np.full((count, 3), np.nan)
