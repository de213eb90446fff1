"""Offset from the centre of mass to the test mass, from the common-mode voltages of a swing.

The angular acceleration is the sensor's own, with the voltage noise that the star tracker shows taken out of it. The
vector points from the centre of mass to the test mass (the published design matrix says so, erratum T-2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gravcal.estimation import kalman, least_squares, noise
from gravcal.physics import sensing


@dataclass(frozen=True)
class Record:
    """Bin means of a swing.

    Attributes
    ----------
    time : (b,) s; linear_volt : (b, 3) V, linear readouts
    rate_b, rate_dot_b : (b, 3) rad s-1, rad s-2; gradient_b : (b, 3, 3) s-2
    noise : three NoiseModel of linear_volt, V
    degree : of the polynomial that stands for bias, drag and radiation
    """

    time: np.ndarray
    linear_volt: np.ndarray
    rate_b: np.ndarray
    rate_dot_b: np.ndarray
    gradient_b: np.ndarray
    noise: tuple
    degree: int


@dataclass(frozen=True)
class Offset:
    """Offset (3,) m with covariance (3, 3) m2, scale factors held; whitened residual (3, b), chi2, dof.

    `observed` (3 b,) and `design` (3 b, p) are the whitened rows in order of time, polynomials included.
    """

    value: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    chi2: float
    dof: int
    observed: np.ndarray
    design: np.ndarray


def fit(record: Record, k: np.ndarray, axes: tuple[int, ...] = (0, 1, 2), tensor=sensing.offset_tensor) -> Offset:
    """Least squares for the offset.

    Parameters
    ----------
    record : Record
    k : (3,) m s-2 V-1
    axes : linear axes used
    tensor : (rate, rate_dot, gradient) -> (b, 3, 3) s-2

    Notes
    -----
    k V = -b + a_ng + (M - G) p; Remote Sens. 2023, 15, 3817, eq. 12 with the gravity gradient it drops.
    """
    columns = tensor(record.rate_b, record.rate_dot_b, record.gradient_b)
    good = np.isfinite(record.linear_volt).all(axis=1) & np.isfinite(columns).all(axis=(1, 2))
    trend = least_squares.polynomial(record.time, record.degree, record.time[0], record.time[-1])
    rows, right, blocks = [], [], []
    for axis in range(3):
        whitened = noise.whiten(
            record.noise[axis], np.c_[record.linear_volt[:, axis], columns[:, axis] / k[axis], trend], good
        )
        whitened *= axis in axes
        right.append(whitened[:, 0])
        rows.append(whitened[:, 1:4])
        blocks.append(whitened[:, 4:])
    return _solve(np.array(right), np.array(rows), np.array(blocks), good, axes)


def _solve(right, rows, blocks, good, axes):
    """Offset from whitened rows, (3, b), (3, b, 3) and (3, b, d)."""
    clean = np.array([least_squares.without(t, a) for t, a in zip(blocks, rows, strict=True)])
    flat = clean.reshape(-1, 3)
    covariance = least_squares.stable_inverse(flat.T @ flat)
    value = covariance @ (flat.T @ right.reshape(-1))
    left = right - rows @ value
    residual = np.array([least_squares.without(t, r) for t, r in zip(blocks, left, strict=True)])
    dof = len(axes) * (int(np.count_nonzero(good)) - blocks.shape[2]) - 3
    bins, width = blocks.shape[1:]
    design = np.zeros((bins, 3, 3 + 3 * width))
    design[:, :, :3] = rows.transpose(1, 0, 2)
    for axis in range(3):
        design[:, axis, 3 + axis * width : 3 + (axis + 1) * width] = blocks[axis]
    observed, design = right.T.reshape(-1), design.reshape(3 * bins, -1)
    return Offset(value, covariance, residual, float(np.sum(residual**2)), dof, observed, design)


def filtered(offset: Offset) -> kalman.Filtered:
    """The same offset by the Kalman filter, polynomials in its state.

    Parameters
    ----------
    offset : Offset
    """
    used = offset.design[:, np.any(offset.design != 0, axis=0)]
    start = kalman.free_start(used, 1.0)
    return kalman.filter_constants(offset.observed, used, np.zeros(used.shape[1]), start, 1.0)


def shifts(record: Record, k: np.ndarray, axes: tuple[int, ...], relative: dict) -> dict[str, np.ndarray]:
    """Change of the offset by one standard deviation of each factor.

    Parameters
    ----------
    record : Record; k : (3,) m s-2 V-1; axes : linear axes used
    relative : relative standard deviation of "beta_x", "beta_y", "ratio_x", "ratio_y", "k_y"; the ratios are J/(M l)

    Returns
    -------
    shift : {name: (3,) m}

    Notes
    -----
    beta_x scales w'_x and k_z together, beta_y scales w'_y, w'_z and k_x (erratum T-11).
    """
    acts = {
        "beta_x": ([1, 0, 0], [0, 0, 1]),
        "beta_y": ([0, 1, 1], [1, 0, 0]),
        "ratio_x": ([0, 0, 0], [0, 0, 1]),
        "ratio_y": ([0, 0, 0], [1, 0, 0]),
        "k_y": ([0, 0, 0], [0, 1, 0]),
    }
    middle = fit(record, k, axes).value
    out = {}
    for name, size in relative.items():
        turn, push = (1 + 1e-4 * np.array(part) for part in acts[name])
        moved = fit(replace(record, rate_dot_b=record.rate_dot_b * turn), k * push, axes).value
        out[name] = (moved - middle) * size * 1e4
    return out
