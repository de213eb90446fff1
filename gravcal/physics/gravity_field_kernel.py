"""Compiled sum of several solid-harmonic series at many points.

The series share one recursion. With x' = x R/r2, z' = z R/r2, q' = R2/r2 and for every order m

    a_m = 1, a_n = alpha_nm z' a_(n-1) - beta_nm q' a_(n-2)          n > m
    sum_k = (R/r) sum_m Re[(x' + i y')^m sum_n K_knm a_n]

there is no division by the sine of the colatitude: poles are points like any other. Holmes and Featherstone 2002,
J. Geodesy 76, eqs. 11-13, with the powers of sin(colatitude) in (x' + i y')^m.

Nearly all of the time goes into the recursion and the sum over n. These two are written in vectors of LANES points
(gravity_field_vectors.py): TILE sums and the row a_n stay in registers for all degrees.
"""

import numpy as np
from numba import njit

from gravcal.physics.gravity_field_vectors import BLOCK, LANES, TILE, lump, recur


@njit(cache=True)
def sum_series(point, tiles, alpha, beta, count):
    """Sums (n, count) of series at points (n, 3) in units of the reference radius.

    tiles (orders, tiles, degrees, TILE): real and negative imaginary parts of K in turn, degree counted from the order;
    zeros fill the last tile. alpha, beta (orders, degrees): factors of the recursion.
    """
    orders = tiles.shape[0]
    out = np.empty((point.shape[0], count))
    rows, lumped = np.empty(orders * LANES), np.empty((tiles.shape[1] * TILE, BLOCK))
    work, total = np.empty((7, BLOCK)), np.empty((count, BLOCK))
    for start in range(0, point.shape[0], BLOCK):
        size = min(BLOCK, point.shape[0] - start)
        _begin(point, start, size, work)
        total[:] = 0.0
        for m in range(orders):
            _lump_block(work[2], work[3], (alpha[m], beta[m], tiles[m]), rows[: (orders - m) * LANES], lumped)
            for k in range(count):
                _close(work[4], work[5], lumped[2 * k], lumped[2 * k + 1], total[k])
            _turn(work)
        for i in range(size):
            for k in range(count):
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
def _lump_block(z, q, order, rows, lumped):
    """Sums over the degree of one order, all points of a block; rows holds a_n of LANES points at a time."""
    alpha, beta, tiles = order
    degrees = rows.size // LANES
    for i in range(0, BLOCK, LANES):
        recur(z[i:].ctypes.data, q[i:].ctypes.data, alpha.ctypes.data, beta.ctypes.data, degrees, rows.ctypes.data)
        for t in range(tiles.shape[0]):
            lump(tiles[t].ctypes.data, rows.ctypes.data, degrees, lumped[t * TILE :, i:].ctypes.data)


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
