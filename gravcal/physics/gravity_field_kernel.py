"""Compiled sum of several solid-harmonic series at many points; blocks of points side by side fill whole registers.

The series share one recursion. With x' = x R/r2, z' = z R/r2, q' = R2/r2 and for every order m

    a_m = 1, a_n = alpha_nm z' a_(n-1) - beta_nm q' a_(n-2)          n > m
    sum_k = (R/r) sum_m Re[(x' + i y')^m sum_n K_knm a_n]

there is no division by the sine of the colatitude: poles are points like any other. Holmes and Featherstone 2002,
J. Geodesy 76, eqs. 11-13, with the powers of sin(colatitude) in (x' + i y')^m.
"""

import numpy as np
from numba import njit

BLOCK = 256  # points side by side
ROWS = 8  # degrees added in one pass


@njit(cache=True)
def sum_series(point, table, alpha, beta):
    """Sums (n, k) of k series at points (n, 3) in units of the reference radius.

    table (orders, 2 k, degrees): real parts and negative imaginary parts of K in pairs, degree counted from the order.
    """
    orders, parts, _ = table.shape
    out = np.empty((point.shape[0], parts // 2))
    a, lumped = np.empty((table.shape[2] + ROWS, BLOCK)), np.empty((parts, BLOCK))
    work, total = np.empty((7, BLOCK)), np.empty((parts // 2, BLOCK))
    for start in range(0, point.shape[0], BLOCK):
        size = min(BLOCK, point.shape[0] - start)
        _begin(point, start, size, work)
        total[:] = 0.0
        for m in range(orders):
            _recur(work[2], work[3], alpha[m], beta[m], orders - m, a)
            _lump(table[m], orders - m, a, lumped)
            for k in range(parts // 2):
                _close(work[4], work[5], lumped[2 * k], lumped[2 * k + 1], total[k])
            _turn(work)
        for i in range(size):
            for k in range(parts // 2):
                out[start + i, k] = total[k, i]
    return out


@njit(cache=True)
def _begin(point, start, size, work):
    """Geometry x', y', z', q' of a block, and (x' + i y')^0 R/r; the last point fills the block."""
    x, y, z, q, real, imaginary, _ = work
    for i in range(BLOCK):
        k = start + min(i, size - 1)
        px, py, pz = point[k, 0], point[k, 1], point[k, 2]
        q[i] = 1.0 / (px * px + py * py + pz * pz)
        x[i], y[i], z[i] = px * q[i], py * q[i], pz * q[i]
        real[i], imaginary[i] = np.sqrt(q[i]), 0.0


@njit(cache=True)
def _recur(z, q, alpha, beta, count, a):
    """Rows a_n of one order, count of them and then up to a multiple of ROWS."""
    a[0] = 1.0
    for n in range(1, (count + ROWS - 1) // ROWS * ROWS):
        if n == 1:
            _next(alpha[n], 0.0, z, q, (a[0], a[0], a[1]))
        else:
            _next(alpha[n], beta[n], z, q, (a[n - 1], a[n - 2], a[n]))


@njit(cache=True, fastmath={"contract"})
def _next(alpha, beta, z, q, rows):
    last, before, out = rows
    for i in range(BLOCK):
        out[i] = alpha * z[i] * last[i] - beta * q[i] * before[i]


@njit(cache=True, fastmath={"contract"})
def _lump(coefficients, count, a, lumped):
    """Sums over the degree of one order, several degrees in one pass so that sums stay in registers."""
    for p in range(coefficients.shape[0]):
        row, c = lumped[p], coefficients[p]
        row[:] = 0.0
        for n in range(0, count, ROWS):
            _eight(
                (c[n], c[n + 1], c[n + 2], c[n + 3], c[n + 4], c[n + 5], c[n + 6], c[n + 7]),
                (a[n], a[n + 1], a[n + 2], a[n + 3], a[n + 4], a[n + 5], a[n + 6], a[n + 7]),
                row,
            )


@njit(cache=True, fastmath={"contract"})
def _eight(coefficients, rows, out):
    c0, c1, c2, c3, c4, c5, c6, c7 = coefficients
    a0, a1, a2, a3, a4, a5, a6, a7 = rows
    for i in range(BLOCK):
        four = c0 * a0[i] + c1 * a1[i] + c2 * a2[i] + c3 * a3[i]
        out[i] += four + c4 * a4[i] + c5 * a5[i] + c6 * a6[i] + c7 * a7[i]


@njit(cache=True, fastmath={"contract"})
def _close(real, imaginary, cosine, sine, out):
    for i in range(BLOCK):
        out[i] += real[i] * cosine[i] + imaginary[i] * sine[i]


@njit(cache=True, fastmath={"contract"})
def _turn(work):
    """(x' + i y')^m to the next order."""
    x, y, _, _, real, imaginary, kept = work
    for i in range(BLOCK):
        kept[i] = real[i] * x[i] - imaginary[i] * y[i]
    for i in range(BLOCK):
        imaginary[i] = real[i] * y[i] + imaginary[i] * x[i]
    real[:] = kept
