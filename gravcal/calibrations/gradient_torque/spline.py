"""Least squares over time for three angles as splines: banded normal equations and the covariance inside their band."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

DEGREE = 5  # second derivatives are cubic
ACTIVE = DEGREE + 1  # splines that differ from zero at an epoch
WIDTH = 3 * ACTIVE


@dataclass(frozen=True)
class Basis:
    """Splines at the epochs.

    value, first, second : (n, 6) active splines and their derivatives
    start : (n,) index of the first active spline
    count : number of splines
    """

    value: np.ndarray
    first: np.ndarray
    second: np.ndarray
    start: np.ndarray
    count: int


def basis(time, knot_step):
    """Splines of degree five with even knots.

    Parameters
    ----------
    time : (n,) s
    knot_step : s

    Returns
    -------
    basis : Basis
    """
    pieces = max(1, int(np.ceil((time[-1] - time[0]) / knot_step)))
    unit = (time - time[0]) / (time[-1] - time[0]) * pieces
    start = np.minimum(unit.astype(int), pieces - 1)
    local = unit - start
    step = (time[-1] - time[0]) / pieces
    shape = BSpline.basis_element(np.arange(DEGREE + 2), extrapolate=False)
    at = local[:, None] + np.arange(DEGREE, -1, -1)
    tables = [np.nan_to_num(shape.derivative(k)(at) if k else shape(at)) / step**k for k in range(3)]
    return Basis(*tables, start, pieces + DEGREE)


def normal(blocks, table):
    """Banded normal matrix and right side.

    Parameters
    ----------
    blocks : list of (operator (n, 3, 3, 3), residual (n, 3)), divided by their standard deviations; operator[:, d] is
        the derivative of the observed vector by the d-th derivative of the angles
    table : Basis

    Returns
    -------
    band : (18, 3 count) lower band
    right : (3 count,)
    """
    band, right = np.zeros((WIDTH, 3 * table.count)), np.zeros(3 * table.count)
    for operator, residual in blocks:
        tables = (table.value, table.first, table.second)
        _add(np.ascontiguousarray(operator), np.ascontiguousarray(residual), tables, table.start, (band, right))
    return band, right


def solve(band, right):
    """Solution of the banded system.

    Parameters
    ----------
    band : (18, m)
    right : (m,)
    """
    if not np.isfinite(right).all():
        raise np.linalg.LinAlgError("readings of infinite size")
    return cho_solve_banded((cholesky_banded(band, lower=True, check_finite=False), True), right, check_finite=False)


def band_covariance(band):
    """Inverse of the normal matrix inside its band.

    Parameters
    ----------
    band : (18, 3 count) lower band

    Returns
    -------
    diagonal, upper : (b, 18, 18) blocks of the inverse on the diagonal, and right of it

    Notes
    -----
    Blocks of six splines make the matrix block-tridiagonal; Z_kk = D_k^-1 + U_k Z_(k+1)(k+1) U_k^T with
    D_k the Schur complements and U_k = D_k^-1 A_k(k+1).
    """
    A, B = _blocks(band)
    inverse = np.empty_like(A)
    right = np.empty_like(B)
    schur = A[0]
    for k in range(len(A)):
        inverse[k] = np.linalg.inv(schur)
        if k + 1 < len(A):
            right[k] = inverse[k] @ B[k]
            schur = A[k + 1] - B[k].T @ right[k]
    upper = np.zeros_like(A)
    for k in range(len(A) - 2, -1, -1):
        upper[k] = -right[k] @ inverse[k + 1]
        inverse[k] = inverse[k] - upper[k] @ right[k].T
    return inverse, upper


def propagate(operator, table, covariance):
    """Covariance of linear functions of the angles and their derivatives at each epoch.

    Parameters
    ----------
    operator : (n, 3, 3, 3), as for normal
    table : Basis
    covariance : (diagonal, upper), band_covariance

    Returns
    -------
    covariance : (n, 3, 3)
    """
    tables = (table.value, table.first, table.second)
    return _sandwich(np.ascontiguousarray(operator), tables, table.start, covariance)


def _blocks(band):
    """Diagonal blocks (b, 18, 18) and blocks right of them (b - 1, 18, 18); the last one filled up with ones."""
    size = band.shape[1]
    count = -(-size // WIDTH)
    padded = np.zeros((WIDTH, (count + 1) * WIDTH))
    padded[:, :size] = band
    padded[0, size:] = 1.0
    i, j = np.arange(WIDTH)[:, None], np.arange(WIDTH)[None, :]
    origin = WIDTH * np.arange(count)[:, None, None]
    lower = np.where(i >= j, padded[np.abs(i - j), origin + np.minimum(i, j)], 0)
    A = lower + np.swapaxes(np.tril(lower, -1), 1, 2)
    offset = WIDTH + j - i
    B = np.where(offset < WIDTH, padded[np.minimum(offset, WIDTH - 1), origin + i], 0)
    return A, B[: count - 1]


@njit(cache=True)
def _row(operator, tables, k, row):
    """Derivative of the vector at epoch k by its active splines, (3, 18)."""
    value, first, second = tables
    for r in range(3):
        for j in range(ACTIVE):
            for i in range(3):
                row[r, 3 * j + i] = (
                    operator[k, 0, r, i] * value[k, j]
                    + operator[k, 1, r, i] * first[k, j]
                    + operator[k, 2, r, i] * second[k, j]
                )


@njit(cache=True)
def _add(operator, residual, tables, start, system):
    """Add rows^T rows and rows^T residual of every epoch."""
    band, right = system
    row = np.empty((3, WIDTH))
    for k in range(operator.shape[0]):
        _row(operator, tables, k, row)
        origin = 3 * start[k]
        for i in range(WIDTH):
            for r in range(3):
                right[origin + i] += row[r, i] * residual[k, r]
            for j in range(i + 1):
                total = row[0, i] * row[0, j] + row[1, i] * row[1, j] + row[2, i] * row[2, j]
                band[i - j, origin + j] += total


@njit(cache=True)
def _sandwich(operator, tables, start, covariance):
    """Rows times C times rows^T with C read from the blocks."""
    diagonal, upper = covariance
    n = operator.shape[0]
    out = np.zeros((n, 3, 3))
    row, half, C = np.empty((3, WIDTH)), np.empty((3, WIDTH)), np.empty((WIDTH, WIDTH))
    for k in range(n):
        _row(operator, tables, k, row)
        if k == 0 or start[k] != start[k - 1]:
            _gather(3 * start[k], diagonal, upper, C)
        for r in range(3):
            for i in range(WIDTH):
                half[r, i] = 0.0
                for j in range(WIDTH):
                    half[r, i] += row[r, j] * C[j, i]
            for c in range(3):
                for i in range(WIDTH):
                    out[k, r, c] += half[r, i] * row[c, i]
    return out


@njit(cache=True)
def _gather(origin, diagonal, upper, C):
    """Covariance of 18 neighbouring unknowns."""
    for i in range(WIDTH):
        b, q = divmod(origin + i, WIDTH)
        for j in range(i + 1):
            a, p = divmod(origin + j, WIDTH)
            C[i, j] = diagonal[a, p, q] if a == b else upper[a, p, q]
            C[j, i] = C[i, j]
